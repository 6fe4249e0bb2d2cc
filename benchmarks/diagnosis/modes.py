"""Pulls of the discretisation modes: a much finer mesh is the truth, the default mesh is fitted to it.

    python benchmarks/diagnosis/modes.py [--quick] [--json] [--draws N]

C10, C01 and the pressure of film A are drawn between 0.7 and 1.3 of their nominal values. The truth, without
noise, is solved on the default lattice with every cell divided in two in each direction and cells not
centred on the pleats. The model, corrected for its mesh, fits C10 and C01 to it as `twin calibrate` does;
what it then misses is the mesh's error alone. --quick takes a finger of three bellows and 8 draws
(about five minutes), else the whole finger and 12.
"""

import json
import os
import sys
from dataclasses import asdict, dataclass, replace

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.trials import NOMINAL
from benchmarks.kernel.convergence import SHORT

import numpy as np

from fe import Case, Finger, Lattice, Material
from twin import virtual
from twin.judging.judged import judge
from twin.laws.mooneyrivlin import mooney_rivlin
from twin.model.basemodel import base_model
from twin.model.discretisation import SolvedAt, discretisation_error
from twin.model.prediction import Model
from twin.model.structure import base_case, of_finger
from twin.targets import Array, Targets

TRUTH = 2  # divisions of every cell
LATTICE = Lattice()
FINE = replace(LATTICE, refine=TRUTH, centred=False)
BENCH = virtual.Bench(film_hz=2.0)  # the demo's noise, every fifth frame of its film
SPREAD = (0.7, 1.3)  # of the nominal values
LARGE_PULL = 2.0
HEAD = (
    "C10  C01  p    before   corrected after mm stated   C pull  bellows walls section both    left sds  chi2"
)


@dataclass(frozen=True)
class Row:
    """One draw: errors of all markers and axes against the truth in mm, rms, and pulls.

    before_mm: of the plain mesh with the truth's own constants; corrected_mm: with the measured change;
    after_mm: corrected and fitted; stated_mm: 1 sd of the modes. parameters: error of the fitted C10 + C01
    over its sd. modes: amplitudes in sds; left_sd: what all modes leave over the noise of one value. chi2:
    square of the whitened error over the number of values, 1 for noise alone.
    """

    factors: tuple[float, ...]
    before_mm: float
    corrected_mm: float
    after_mm: float
    stated_mm: float
    parameters: float
    modes: tuple[float, ...]
    left_sd: float
    chi2: float


def measured(finger: Finger, factors: Array) -> Row:
    """The row of one draw; ValueError or RuntimeError where a mesh has no equilibrium."""
    theta, case = NOMINAL * factors[:2], base_case(finger=finger, lattice=LATTICE)
    course = virtual.path(BENCH)
    course = replace(course, pressure=factors[2] * course.pressure)
    points, nodes = markers(finger, case)
    truth = virtual.truth_case(finger, FINE, material=Material(*theta), element=None)
    u, slope = virtual.displaced(truth, course, points)
    names = (*(f"p{k}" for k in range(len(points) - 1)), "tip")
    film = virtual.noisy_targets(
        u, slope, course, points=virtual.at_nodes(names, nodes, points), bench=BENCH, seed=1
    )
    targets = exact(film, u)
    model, top = base_model(targets, case), float(course.pressure.max())
    at = SolvedAt.beside(mooney_rivlin(*theta), top)
    found = discretisation_error(model.test, structure=of_finger(finger, LATTICE), solved_at=at)
    return replace(judged(model.on_mesh(found), targets, theta=theta), factors=tuple(factors.tolist()))


def exact(film: Targets, u: Array) -> Targets:
    """The targets of a film with the true displacements u (s, p, 3) mm in place of what was measured."""
    value = np.where(film.valid, 0.0, np.nan)
    value[:, : u.shape[1]] += u - u[film.reference].mean(axis=0)
    return replace(film, value=value)


def judged(model: Model, targets: Targets, *, theta: Array) -> Row:
    """The pulls of a model on its mesh in targets without noise, whose truth has the constants theta (2,)."""
    found = judge(model, targets, starts=theta)
    error, w = targets.value - found.predicted, found.whitener
    first, modes, moving = len(targets.mode_names), model.modes(found.theta), ~targets.fixed
    one = np.ones(2)
    return Row(
        factors=(),
        before_mm=_rms((targets.value - model.on_mesh(None).predict(theta))[:, moving]),
        corrected_mm=_rms((targets.value - model.predict(theta))[:, moving]),
        after_mm=_rms(error[:, moving]),
        stated_mm=_rms(np.sqrt((modes**2).sum(axis=0))[targets.valid & moving[:, None]]),
        parameters=float((found.theta - theta).sum() / np.sqrt(one @ found.fit.covariance @ one)),
        modes=tuple(w.amplitudes(error)[first : first + len(modes)].tolist()),
        left_sd=w.rms(error, gauge=True) / w.noise_sd,
        chi2=float((w.whiten(error) ** 2).sum()) / w.count,
    )


def markers(finger: Finger, case: Case) -> tuple[Array, Array]:
    """Places (p, 3) mm and node labels (p,) of markers on the flat lower edge of the side, the tip last."""
    bellow = (finger.length - finger.base_cap - finger.tip_cap) / finger.bellows
    x = finger.base_cap + bellow * np.linspace(0.5, finger.bellows - 0.5, 6)
    x = np.append(x, finger.length)
    wanted = np.stack([x, np.full_like(x, finger.width / 2), np.zeros_like(x)], axis=1)
    rows = np.linalg.norm(case.nodes[:, None] - wanted, axis=2).argmin(axis=0)
    return case.nodes[rows], case.labels[rows]


def _rms(x: Array) -> float:
    return float(np.sqrt(np.nanmean(np.square(x))))


def line(r: Row) -> str:
    """One line of the table."""
    factors, modes = " ".join(f"{x:.2f}" for x in r.factors), " ".join(f"{x:+6.2f}" for x in r.modes)
    return (
        f"{factors} {r.before_mm:8.4f} {r.corrected_mm:8.4f} {r.after_mm:8.4f} {r.stated_mm:8.4f} "
        f"{r.parameters:+7.2f}  {modes} {r.left_sd:8.3f} {r.chi2:8.4f}"
    )


def summary(rows: list[Row]) -> dict[str, float]:
    """Figures of all draws; `covered` is the share of draws whose error is no larger than stated."""
    pulls = np.array([r.modes for r in rows])
    return {
        "draws": len(rows),
        "mode_pull_rms": _rms(pulls),
        "mode_pull_largest": float(np.abs(pulls).max()),
        "parameter_pull_rms": _rms(np.array([r.parameters for r in rows])),
        "left_sd": max(r.left_sd for r in rows),
        "chi2": max(r.chi2 for r in rows),
        "covered": float(np.mean([r.after_mm <= r.stated_mm for r in rows])),
    }


def main() -> int:
    """Print the table; the exit code is 1 where a pull of a mode is larger than LARGE_PULL."""
    typed = options(__doc__, {
        "--draws": (int, "how many (12)"),
        "--seed": (1, "of the draws"),
    }, quick="a finger of three bellows, 8 draws", json="the same as one JSON object")  # fmt: skip
    count = typed.draws or (8 if typed.quick else 12)
    rows: list[Row] = []
    print(HEAD, file=sys.stderr)
    for factors in np.random.default_rng(typed.seed).uniform(*SPREAD, (count, 3)):
        try:
            rows.append(measured(SHORT if typed.quick else Finger(), factors))
        except (ValueError, RuntimeError) as error:  # a mesh has no equilibrium
            print(f"{factors.round(2)} {error}", file=sys.stderr, flush=True)
        else:
            print(line(rows[-1]), file=sys.stderr, flush=True)
    if not rows:
        return 1
    found = {"tried": count} | summary(rows)
    if typed.json:
        print(json.dumps(found | {"rows": [asdict(r) for r in rows]}))
    else:
        print("\n".join(f"{name:20s} {value:.3g}" for name, value in found.items()))
    return int(found["mode_pull_largest"] > LARGE_PULL)


if __name__ == "__main__":
    sys.exit(main())
