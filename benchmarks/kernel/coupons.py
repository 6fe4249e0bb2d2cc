"""What is a tension test worth beside the film? The interval of C01 / (C10 + C01) with it and without.

    python benchmarks/kernel/coupons.py [--quick] [--json]

The film is of a finger of three bellows whose truth lies on another mesh. Its specimen is the same silicone,
its area wrong by 2 % (1 sd), its stress noisy by 1 kPa. Each draw has noise of its own in film and tests, and
is fitted without a test, with tension, and with tension, planar and equibiaxial tension.
`joint_ci_ratio`: width of the share's 95 % interval with tension over that without, the median of the draws;
`joint_ci_ratio_three`: with three tests. `joint_coverage`: of the intervals of C10 and C01 with a tension
test, the share that holds the truth. --quick: 2 draws on a coarse mesh, not 20 on the default one.
"""

import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import whole
from benchmarks.kernel.convergence import SHORT

import numpy as np

from fe import Case, Lattice, Material
from fe.homogeneous import Kind, nominal_stress
from twin import virtual
from twin.bench.profiling import sd_of
from twin.coupons.pulltest import PullTest
from twin.coupons.testtable import MaterialTestTable
from twin.judging.judged import Judged, judge
from twin.laws.mooneyrivlin import NOMINAL
from twin.model.basemodel import base_model
from twin.model.discretisation import SolvedAt, discretisation_error
from twin.model.memo import KeptModel
from twin.model.structure import base_case, of_finger
from twin.targets import Array, MaterialCurve, Targets

RUBBER = Material(C10=0.214, C01=0.083)
STRAIN = np.linspace(0.01, 0.7, 70)  # the finger reaches a stretch of 1.5
NOISE, SCALE = 0.001, 2.0  # MPa; % of 1 sd
TESTS: tuple[Kind, ...] = ("uniaxial", "planar", "equibiaxial")
FILM = ((0.0, 0.0), (2.0, 0.0), (5.0, 30.0), (9.0, 30.0), (10.0, 0.0), (12.0, 0.0))
BENCH = virtual.Bench(film_hz=3.0)
DRAWS, FEW = 20, 2
MODEL, TRUTH = Lattice(), Lattice(per_bellow=7, wall=2, across=2, up=2, centred=False)
COARSE = Lattice(per_bellow=2, ring=False, centred=False)


def markers(case: Case) -> tuple[Array, Array]:
    """Places (5, 3) mm and node labels (5,) of markers on the lower edge of the side, the tip last."""
    x = np.linspace(SHORT.length / 5, SHORT.length, 5)
    wanted = np.stack([x, np.full_like(x, SHORT.width / 2), np.zeros_like(x)], axis=1)
    rows = np.linalg.norm(case.nodes[:, None] - wanted, axis=2).argmin(axis=0)
    return case.nodes[rows], case.labels[rows]


def tested(kind: Kind, seed: int) -> MaterialCurve:
    """The curve of one test of the silicone, with errors of this seed."""
    rng = np.random.default_rng([seed, TESTS.index(kind)])
    stress = nominal_stress(RUBBER, STRAIN, kind) * (1 + SCALE / 100 * rng.standard_normal())
    table = MaterialTestTable(name=kind, file="raw/test.csv", kind=kind, sd_MPa=NOISE, scale_percent=SCALE)
    noisy = stress + NOISE * rng.standard_normal(len(STRAIN))
    return PullTest(table, STRAIN, noisy, None, len(STRAIN), ()).curve()


def model_of(targets: Targets, lattice: Lattice) -> KeptModel:
    """The model of the finger on a lattice, with the error of its mesh."""
    model = base_model(targets, base_case(finger=SHORT, lattice=lattice))
    at = SolvedAt.beside(NOMINAL, float(targets.log_pressure.max()))
    return model.on_mesh(discretisation_error(model.test, structure=of_finger(SHORT, lattice), solved_at=at))


def share_width(judged: Judged) -> float:
    """The width of the share's 95 % interval, by the covariance."""
    return 2 * 1.96 * sd_of(judged.fit, "share")


def figures(quick: bool) -> Mapping[str, Any]:
    """`joint_ci_ratio` and what stands beside it."""
    lattice, truth = (COARSE, replace(COARSE, ring=True)) if quick else (MODEL, TRUTH)
    case = base_case(finger=SHORT, lattice=lattice)
    (points, labels), course = markers(case), virtual.path(BENCH, protocol=FILM)
    hidden = virtual.truth_case(SHORT, truth, material=RUBBER, element=None)
    u, slope = virtual.displaced(hidden, course, points)
    names, rows, held, model = ("p1", "p2", "p3", "p4", "tip"), [], [], None
    for seed in range(FEW if quick else DRAWS):
        film = virtual.noisy_targets(
            u, slope, course, points=virtual.at_nodes(names, labels, points), bench=BENCH, seed=seed
        )
        model = model or model_of(film, lattice)
        start, widths = NOMINAL.named, []
        for count in (0, 1, len(TESTS)):
            curves = tuple(tested(kind, seed) for kind in TESTS[:count])
            found = judge(model, replace(film, curves=curves), starts=model.theta(start), seed=seed)
            start = found.values
            widths.append(share_width(found))
            if count == 1:
                true = np.array([RUBBER.C10, RUBBER.C01])
                held += (np.abs(found.theta - true) <= 1.96 * found.fit.sd).tolist()
        rows.append(widths)
        print(f"draw {seed}: widths of the share's interval {np.round(widths, 4)}", flush=True)
    alone, one, three = np.array(rows).T
    return {
        "joint_ci_ratio": float(np.median(one / alone)),
        "joint_ci_ratio_three": float(np.median(three / alone)),
        "share_width_alone": float(np.median(alone)),
        "joint_coverage": float(np.mean(held)),
        "joint_draws": len(rows),
    }


def joint_ci_ratio(*, quick: bool) -> float:
    """Width of the 95 % interval of C01 / (C10 + C01) with a tension test over that without."""
    return float(figures(quick)["joint_ci_ratio"])


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick=f"{FEW} draws on a coarse mesh"))
