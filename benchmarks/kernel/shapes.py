"""Effects of shape and a layer against CalculiX: what each of them changes, on one deck of C3D20R, kernel and
ccx.

python benchmarks/kernel/shapes.py [--json]     a short finger, about four minutes; needs ccx

The layer is ccx's own, as `deck.writer` writes it: membranes (M3D8) of a linear elastic material on the faces
of the flat bottom.
"""

import json
import os
import sys
from dataclasses import dataclass, replace

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.kernel.convergence import SHORT, SILICONE

import numpy as np

from fe import Case, Lattice, Path, finger_case
from fe.case import Layer
from fe.engines.calculix import CalculiX
from fe.engines.engine import Embedded, EngineResult
from fe.engines.writer import deck
from fe.mesh.convert import converted
from twin.effects.protocol import Effect, Test
from twin.effects.shape import Ballooning, EccentricCore, WallTaper
from twin.effects.supports import flat_bottom

PRESSURE = 0.02  # MPa
TIGHT = "*CONTROLS, PARAMETERS=FIELD\n1e-6,1e-6\n*STATIC"  # by default ccx stops at half a per cent
CHOSEN: list[tuple[Effect, dict[str, float]]] = [
    (WallTaper(), {"wall_taper.mm": 0.4}),
    (EccentricCore(), {"eccentric_core.mm": -0.4}),
    (Ballooning(), {"ballooning.depth": 0.4, "ballooning.place": 0.6, "ballooning.width": 8.0}),
]


LAYER = Layer("bottom", 0.3, 0.3)  # N/mm, -
CELLS = (1, 2, 4)  # a bellow


@dataclass(frozen=True)
class Effects:
    """What an effect changes, mm: ours and theirs (n, 3), nodes by increasing label; row: the tip's."""

    ours: np.ndarray
    theirs: np.ndarray
    row: int

    @property
    def difference(self) -> float:
        """The largest difference over the largest displacement."""
        return float(np.abs(self.ours - self.theirs).max() / np.abs(self.theirs).max())

    def line(self, name: str) -> str:
        """A line of the table."""
        a, b = self.ours[self.row, 2], self.theirs[self.row, 2]
        return f"| {name} | {a:.4f} | {b:.4f} | {self.difference:.1e} |"


def sorted_field(found: EngineResult) -> np.ndarray:
    """Displacements (n, 3) mm by increasing label."""
    if not found.converged:
        raise SystemExit(found.reason)
    return found.u[np.argsort(found.labels)]


def tight(text: str) -> str:
    """A deck with ccx's tolerances as they are wanted here."""
    return text.replace("*STATIC", TIGHT, 1)


def finger(per_bellow: int) -> Case:
    """The short finger in C3D20R."""
    lattice = Lattice(per_bellow=per_bellow, ring=False, centred=False)
    return converted(finger_case(SILICONE, finger=SHORT, lattice=lattice), "C3D20RH")


def tip(case: Case) -> int:
    """The row of the tip, nodes by increasing label."""
    return int(np.flatnonzero(np.sort(case.labels) == 4401)[0])


def shaped() -> dict[str, Effects]:
    """The effects of shape."""
    case = finger(2)
    path = Path(np.array([0.0, 1.0]), np.array([0.0, PRESSURE]), np.array([1.0]))
    test = Test(case, path, case.position(4401)[None], np.array([True]))
    cases = {"": case} | {e.name: e.before(test, values).case for e, values in CHOSEN}
    ours = {k: sorted_field(Embedded().solve(c, PRESSURE)) for k, c in cases.items()}
    theirs = {k: sorted_field(CalculiX().run(tight(deck(c, PRESSURE)))) for k, c in cases.items()}
    row = tip(case)
    return {k: Effects(ours[k] - ours[""], theirs[k] - theirs[""], row) for k in list(cases)[1:]}


def layered(per_bellow: int, *, pressure: float = PRESSURE) -> Effects:
    """A layer in the flat bottom. Without it both agree to 2e-5 of the motion: the kernel's is the base."""
    case = finger(per_bellow)
    case = replace(case, surfaces={**case.surfaces, "bottom": flat_bottom(case)})
    with_it = replace(case, layer=LAYER)
    bare, ours = (sorted_field(Embedded().solve(c, pressure)) for c in (case, with_it))
    theirs = sorted_field(CalculiX().run(tight(deck(with_it, pressure))))
    return Effects(ours - bare, theirs - bare, tip(case))


def main() -> None:
    """Print the table, and with --json one line."""
    typed = options(__doc__, json="one JSON line")
    print("| effect | its U3 tip / mm, kernel | ccx | largest difference over its largest displacement |")
    print("|---|---|---|---|")
    found = shaped() | {f"layer, {n} cells a bellow": layered(n) for n in CELLS}
    for name, effects in found.items():
        print(effects.line(name))
    if typed.json:
        print(json.dumps({"shape_effects_against_ccx": {k: e.difference for k, e in found.items()}}))


if __name__ == "__main__":
    main()
