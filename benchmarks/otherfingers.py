"""Fingers of one silicone that nobody has filmed: their truth in other elements, and the model of them.

`thick` is a bellows finger with longer pleats and thicker walls than the short one of `diagnosis`, `pneunet`
two chambers in a row; both under a course of pressure of their own. Every solve is kept in a folder.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from benchmarks.diagnosis.bank import MAIN
from benchmarks.diagnosis.trialbench import EVERY

import numpy as np
from numpy.typing import NDArray

from fe import Finger, Lattice, Material
from fe import Path as Course
from twin.bodies.body import Cells
from twin.bodies.finger import BuiltIn
from twin.bodies.pneunet import PneunetTable
from twin.effects.protocol import Effect
from twin.model.discretisation import Discretisation, SolvedAt, discretisation_error
from twin.model.keptmodel import base_model
from twin.model.structure import of_body
from twin.targets import PointKind, TargetPoint, Targets
from twin.virtual.draws import Setup, noisy_targets
from twin.virtual.protocols import TOP
from twin.virtual.truthsolves import BARE, CHANGE, displaced, on_surface, truth_case

Array = NDArray[np.float64]
CORNERS = ((0, 0), (2, 0), (5, 0.9), (15, 0.9), (17, 0.3), (25, 0.3), (28, 1), (34, 1), (37, 0), (44, 0))
STEPS = np.concatenate([[0.5, 1.0, 1.5], np.arange(2.5, 43.6, 1.5)])
LOG_HZ, MARKERS = 5.0, 5
TRUE = Material(*MAIN.values)


def course() -> Course:
    """B's pressure, MPa over s: fast and slow ramps with holds."""
    t, share = np.array(CORNERS, float).T
    time = np.arange(0.0, t[-1] + 0.5 / LOG_HZ, 1 / LOG_HZ)
    return Course(time, TOP * np.interp(time, t, share), STEPS)


@dataclass(frozen=True)
class Other:
    """Another finger: its body, the truth's lattice for what an effect changes, and a finer one for the bare
    finger; folder: where its solves are kept."""

    name: str
    body: Any
    coarse: Any
    fine: Any
    folder: Path

    @cached_property
    def points(self) -> tuple[TargetPoint, ...]:
        """The markers along its lower edge, the tip last."""
        every = self.body.places
        edge = [n for n in every if n.startswith("p")]
        names = [edge[k] for k in np.linspace(0, len(edge) - 1, MARKERS - 1).round().astype(int)]
        return tuple(TargetPoint(n, PointKind.PLACE, None, every[n]) for n in (*dict.fromkeys(names), "tip"))

    @cached_property
    def places(self) -> Array:
        """Their places (p, 3) mm."""
        return np.array([p.position for p in self.points])

    @property
    def length(self) -> float:
        """Its length in mm, to the tip's marker."""
        return float(self.places[:, 0].max())

    def true(self, kind: str = "", size: float = 0.0) -> tuple[Array, Array]:
        """True displacements (s, p, 3) mm with a kind hidden, and dU/dp (s, p, 3) mm per MPa: of the bare
        finger on the finer lattice, and what the kind changes on the other."""
        fine, slope = self._solved("", 0.0, "fine")
        if not kind:
            return fine, slope
        return fine + self._solved(kind, size, "coarse")[0] - self._solved("", 0.0, "coarse")[0], slope

    def _solved(self, kind: str, size: float, mesh: str) -> tuple[Array, Array]:
        def make() -> Array:
            case = truth_case(self.body, getattr(self, mesh), material=TRUE)
            hidden = ((EVERY[kind], size),) if kind else ()
            return np.array(displaced(case, course(), on_surface(case, self.places), hidden, count=8))

        u, slope = kept(self.folder / f"{self.name}-{mesh}-{kind or 'bare'}@{size:g}.npy", make)
        return u, slope

    def targets(self, u: Array, slope: Array, seed: int) -> Targets:
        """What would be measured of it."""
        setup = Setup(sd_mm=0.015, placement_sd_mm=0.02)
        return noisy_targets(
            u, slope, course(), points=self.points, bench=setup.bench, seed=seed, fixed=0
        )

    @cached_property
    def mesh(self) -> Discretisation:
        """The error of the model's mesh, known from finer ones as `twin calibrate` knows it."""

        def cache(stage: str, tasks: Mapping[str, Callable[[], Array]]) -> dict[str, Array]:
            return {key: kept(self.folder / f"{self.name}-{key}.npy", make) for key, make in tasks.items()}

        structure, targets = of_body(self.body), self.targets(*self.true(), seed=0)
        test = base_model(targets, structure.case).test
        at = SolvedAt.beside(MAIN, TOP)
        return discretisation_error(test, structure=structure, solved_at=at, cache=cache)

    def model(self, targets: Targets, effects: tuple[Effect, ...]) -> Any:
        """Its model with effects."""
        model = base_model(targets, of_body(self.body).case).on_mesh(self.mesh)
        for e in effects:
            model = model.with_effect(e)
        return model


def fingers(folder: Path) -> dict[str, Other]:
    """The fingers B."""
    thick = Finger(
        length=46.0, bellows=3, side=2.5, top=2.4, bottom=3.0, tip_node=(46.0, 11.5, 0.0),
        middle_node=(22.0, 11.5, 0.0),
    )  # fmt: skip
    pneunet = PneunetTable(chambers=2, chamber_length_mm=10.0, base_cap_mm=6.0)
    return {
        "thick": Other("thick", BuiltIn(thick, Lattice()), CHANGE, BARE, folder),
        "pneunet": Other(
            "pneunet", pneunet, pneunet.finer(pneunet.lattice)["cells along"],
            Cells(along=3, across=3, up=5, wall=3, caps=4), folder,
        ),
    }  # fmt: skip


def kept(path: Path, make: Callable[[], Array]) -> Array:
    """An array of a file, or made and kept there."""
    if not path.exists():
        scratch = path.with_suffix(".part.npy")
        np.save(scratch, make())
        scratch.replace(path)
    return np.asarray(np.load(path))
