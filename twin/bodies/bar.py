"""A solid bar, held at one end: for tests of a silicone by its weight, or by weights that hang from it."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from twin.bodies.body import GAP, Arrow, Cells, CellTable, Place, Sketch, edge_places, marks
from twin.tablemodel import Positive

if TYPE_CHECKING:  # the finite elements are loaded by whoever needs them
    from fe import Case, Material

SLENDER = 1.0  # times its larger side that a bar is long, at least
CELL = 0.5  # of the smaller side that a cell is long, about
MOST = 24  # cells along it


class BarTable(CellTable):
    """Dimensions of a solid bar, held at x = 0. It has no chamber: weight and hung weights load it.

    >>> bar = BarTable(length_mm=80.0, width_mm=10.0, height_mm=10.0)
    >>> bar.lattice.along, bar.places["tip"]
    (16, (80.0, 5.0, 0.0))
    """

    kind: ClassVar[str] = "bar"
    bends_down: ClassVar[bool] = False
    remedy: ClassVar[str] = "make it thicker or shorter"

    length_mm: Positive = Field(default=100.0, description="free length from the clamp to the end, mm")
    width_mm: Positive = Field(default=30.0, description="width across, mm")
    height_mm: Positive = Field(default=30.0, description="height, mm")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        side = max(self.width_mm, self.height_mm)
        if self.length_mm < SLENDER * side:
            raise ValueError(
                f"model.bar.length_mm = {self.length_mm:g}: shorter than its larger side of {side:g} mm; "
                "wanted a bar that bends; make it longer, or width_mm and height_mm smaller"
            )
        return self

    @property
    def body(self) -> Self:
        """The bar itself."""
        return self

    @property
    def lattice(self) -> Cells:
        """Cells about half as long as the smaller side is wide."""
        along = math.ceil(self.length_mm / (CELL * min(self.width_mm, self.height_mm)))
        return Cells(along=min(max(along, 4), MOST), across=1, up=2)

    def case(self, lattice: Cells, material: "Material") -> "Case":
        """Half of the bar on a lattice."""
        from fe.mesh.extruding import between, box_grid, extruded, hollow_case

        along, across, up, _, _ = lattice.counts
        quads = box_grid(between([0, self.width_mm / 2], [across]), between([0, self.height_mm], [up]))
        cells = extruded(quads, between([0, self.length_mm], [along])).reshape(-1, 27, 3)
        solid = np.ones(len(cells), bool)
        nodes = marks(self.length_mm, self.width_mm / 2, 0.0)
        return hollow_case(cells, solid, material=material, marks=nodes)

    def finer(self, lattice: Cells) -> Mapping[str, Cells]:
        """Finer lattices; a bar has no walls of its own."""
        return {name: cells for name, cells in super().finer(lattice).items() if name != "walls"}

    @property
    def places(self) -> dict[str, Place]:
        """Places along the lower edge, and off it half way up the side."""
        y, z = self.width_mm / 2, self.height_mm / 2
        off = {f"off{k + 1}": (x * self.length_mm, y, z) for k, x in enumerate((0.25, 0.5, 0.75, 0.95))}
        return edge_places(self.length_mm, y, 0.0) | off

    @property
    def sketch(self) -> Sketch:
        """Its height and width."""
        gap, w, h = GAP * self.length_mm, self.width_mm / 2, self.height_mm
        return Sketch(
            side=(),
            along=(Arrow(f"height {h:g}", (0.0, 0.0), (0.0, h), gap),),
            across=(Arrow(f"width {self.width_mm:g}", (-w, 0.0), (w, 0.0), -1.6 * GAP * self.width_mm),),
            left=self.length_mm / 2, right=self.length_mm / 2,
        )  # fmt: skip
