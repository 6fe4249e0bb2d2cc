"""Dimensions that nobody states exactly, as parameters of the fit: nodes move with them, to first order."""

from collections.abc import Mapping
from dataclasses import replace

from fe import Case
from fe.mesh.inner import least_volume_ratio
from fe.mesh.mirror import mirrored, symmetry_support
from twin.effects.labels import OPEN
from twin.effects.phrases import number, way
from twin.effects.protocol import Effect, Order, Owner, Test, Theta, Unsolvable, symmetric
from twin.targets import Array

LEAST = 0.05  # of an element's volume must be left anywhere
MOST = 3.0  # sds that a dimension may be off
QUARTER = 0.25  # of an sd: by so much two meshes are off whose difference tells how the nodes move


class OpenDimensions(Effect):
    """Dimensions of the chamber are larger than stated by `open_dimensions.<dimension>`, mm.

    moves: by dimension, how the nodes (n, 3) of a case move for 1 mm of it, and those of the whole that its
    half is mirrored to (None of a whole); sds: of the dimensions, mm.
    """

    name = OPEN
    sentence = "dimensions of the chamber are others than stated"
    order = Order.GEOMETRY
    belongs = Owner.BODY

    def __init__(self, moves: Mapping[str, tuple[Array, Array | None]], sds: Mapping[str, float]) -> None:
        self.moves = dict(moves)
        self.parameters = tuple(
            p for key, sd in sds.items()
            for p in symmetric(f"{OPEN}.{key}", most=MOST * sd, unit="mm", step=0.1 * sd, likely=2 * sd)
        )  # fmt: skip

    @staticmethod
    def of(case: Case, larger: Mapping[str, tuple[Case, Case]], sds: Mapping[str, float]) -> "OpenDimensions":
        """The effect of dimensions with these sds in mm.

        larger: by dimension the mesh of `case` with it smaller and larger by QUARTER of its sd. ValueError
        where they are not the same mesh.
        """
        moves: dict[str, tuple[Array, Array | None]] = {}
        for key, (less, more) in larger.items():
            if not less.nodes.shape == more.nodes.shape == case.nodes.shape:
                raise ValueError(
                    f"model.open.{key}: with an sd of {sds[key]:g} mm the mesh has another number of cells; "
                    "wanted a smaller sd"
                )
            per_mm, whole = 1 / (2 * QUARTER * sds[key]), None
            if symmetry_support(case) is not None:
                whole = per_mm * (mirrored(more).nodes - mirrored(less).nodes)
            moves[key] = per_mm * (more.nodes - less.nodes), whole
        return OpenDimensions(moves, sds)

    def before(self, test: Test, theta: Theta) -> Test:
        """Raises Unsolvable where an element is all but turned over."""
        sizes = {key: theta[f"{OPEN}.{key}"] for key in self.moves}
        if not any(sizes.values()):
            return test
        nodes = test.case.nodes.copy()
        for key, mm in sizes.items():
            half, whole = self.moves[key]
            nodes += mm * (half if whole is None or len(half) == len(nodes) else whole)
        if (ratio := least_volume_ratio(test.case, nodes)) < LEAST:
            raise Unsolvable(
                f"{self.told(theta)}: an element keeps {ratio:.2g} of its volume, wanted {LEAST:g}"
            )
        return replace(test, case=replace(test.case, nodes=nodes))

    def told(self, values: Theta) -> str:
        sizes = {key: values[f"{OPEN}.{key}"] for key in self.moves}
        ways = {key: f"{number(mm)} mm {way(mm, 'larger', 'smaller')}" for key, mm in sizes.items()}
        return ", ".join(f"{key} is {much} than stated" for key, much in ways.items())
