"""Effects of shape against CalculiX: what each of them changes, on one deck of C3D20R, kernel and ccx.

python benchmarks/shapes.py [--json]     a short finger, about two minutes; needs ccx
"""

import argparse
import json

import _first  # noqa: F401
import numpy as np
from convergence import SHORT, SILICONE

from fe import Lattice, Path, finger_case
from fe.calculix import CalculiX
from fe.convert import converted
from fe.deck_out import deck
from fe.engine import Embedded, Response
from twin.effect import Effect, Test
from twin.effects_shape import Ballooning, EccentricCore, WallTaper

PRESSURE = 0.02  # MPa
TIGHT = "*CONTROLS, PARAMETERS=FIELD\n1e-6,1e-6\n*STATIC"  # by default ccx stops at half a per cent
CHOSEN: list[tuple[Effect, dict[str, float]]] = [
    (WallTaper(), {"wall_taper.mm": 0.4}),
    (EccentricCore(), {"eccentric_core.mm": -0.4}),
    (Ballooning(), {"ballooning.depth": 0.4, "ballooning.place": 0.6, "ballooning.width": 8.0}),
]


def sorted_field(found: Response) -> np.ndarray:
    """Displacements (n, 3) mm by increasing label."""
    if not found.converged:
        raise SystemExit(found.reason)
    return found.u[np.argsort(found.labels)]


def main() -> None:
    """Print the table, and with --json one line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    lattice = Lattice(per_bellow=2, ring=False, centred=False)
    case = converted(finger_case(SILICONE, finger=SHORT, lattice=lattice), "C3D20RH")
    path = Path(np.array([0.0, 1.0]), np.array([0.0, PRESSURE]), np.array([1.0]))
    test = Test(case, path, case.position(4401)[None], np.array([True]))
    cases = {"base": case} | {e.name: e.before(test, values).case for e, values in CHOSEN}
    ours = {k: sorted_field(Embedded().solve(c, PRESSURE)) for k, c in cases.items()}
    theirs = {
        k: sorted_field(CalculiX().run(deck(c, PRESSURE).replace("*STATIC", TIGHT, 1)))
        for k, c in cases.items()
    }
    row = int(np.flatnonzero(np.sort(case.labels) == 4401)[0])
    print("| effect | its U3 tip / mm, kernel | ccx | largest difference over its largest displacement |")
    print("|---|---|---|---|")
    figures = {}
    for name in list(cases)[1:]:
        a, b = ours[name] - ours["base"], theirs[name] - theirs["base"]
        figures[name] = float(np.abs(a - b).max() / np.abs(b).max())
        print(f"| {name} | {a[row, 2]:.4f} | {b[row, 2]:.4f} | {figures[name]:.1e} |")
    if options.json:
        print(json.dumps({"shape_effects_against_ccx": figures}))


if __name__ == "__main__":
    main()
