"""Coverage of the 95 % intervals where the truth is on another mesh and element, with an effect or without.

    python benchmarks/diagnosis/interval_coverage.py [--quick] [--draws N] [--seed N] [--json]

Each truth is solved once: nothing hidden, creep of one term, or a rubber that stiffens. N draws of each (25)
differ in picture noise, the gauge's noise, the placement of every tag and the scale. The model holds the
effect that is hidden, on the default lattice, and is corrected for its mesh. Draw 0 is fitted and judged as
`twin calibrate` and `twin add` do; the others by one linear step from there, each with its own noise model.
`agree` is the largest distance, in sds, between that step and a full fit, over one draw of each truth
(--agree). A pull is (fitted - true) / sd. --quick takes a finger of three bellows: about six CPU minutes; the
whole finger takes forty. What was solved is kept in the system's temporary folder.
"""

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.modes import markers
from benchmarks.diagnosis.trials import kept
from benchmarks.kernel.convergence import SHORT

import numpy as np

from fe import Case, Finger, Lattice, Path
from fe.case import digest
from fe.mesh.convert import converted
from fe.mesh.points import nearest
from twin import virtual
from twin.effects.library import effect
from twin.effects.protocol import Test
from twin.judging.fitting import ModelErrors
from twin.judging.judged import judge
from twin.laws.mooneyrivlin import NOMINAL, mooney_rivlin
from twin.model.basemodel import base_model
from twin.model.discretisation import SolvedAt, discretisation_error
from twin.model.prediction import Model, respond
from twin.model.structure import base_case, of_finger
from twin.targets import Array, Targets

TRUE = {"C10": 0.214, "C01": 0.083}  # MPa
BENCH = virtual.Bench(film_hz=2.0)  # the demo's noise, every fifth frame of its film
EFFECTS: dict[str, dict[str, float]] = {
    "": {},
    "stiffening": {"stiffening.C20": 0.01},
    "creep": {"creep.g1": 0.12, "creep.tau1": 2.0},
}
# None of these is a mesh of the model's; the number of cells and the element differ.
MESHES: dict[str, tuple[Lattice, str]] = {
    "7 cells a bellow": (Lattice(per_bellow=7, wall=2, across=2, up=2, centred=False), ""),
    "9 cells a bellow": (Lattice(per_bellow=9, wall=2, across=2, up=2, centred=False), ""),
    "every cell halved": (Lattice(refine=2, centred=False), ""),
    "20 nodes": (Lattice(per_bellow=8, wall=2, across=2, up=2, fillet=2), "C3D20H"),
    "tetrahedra": (Lattice(per_bellow=8, wall=2, across=2, up=2, ring=False), "C3D10H"),
}
WANTED = (0.92, 0.97)
SD = 1.959964  # sds either side hold 95 %


@dataclass(frozen=True)
class Laboratory:
    """A finger, its model without effects but corrected for its mesh, its markers, and how it is filmed."""

    finger: Finger
    model: Model
    points: Array
    nodes: Array
    course: Path
    bench: virtual.Bench

    @staticmethod
    def of(finger: Finger) -> "Laboratory":
        """The laboratory of a finger on the default lattice."""
        case = base_case(finger=finger, lattice=Lattice())
        points, nodes = markers(finger, case)
        course, still = virtual.path(BENCH), np.zeros((len(virtual.path(BENCH).output), len(points), 3))
        targets = drawn(points, nodes, still, still, course, BENCH, 0)
        model, at = base_model(targets, case), SolvedAt.beside(NOMINAL, float(course.pressure.max()))
        structure = of_finger(finger, Lattice())
        found = discretisation_error(model.test, structure=structure, solved_at=at, cache=_kept_arrays)
        return Laboratory(finger, model.on_mesh(found), points, nodes, course, BENCH)

    def truth(self, mesh: str, hidden: str) -> "Truth":
        """A truth on a mesh of MESHES with an effect of EFFECTS."""
        lattice, kind = MESHES[mesh]
        key = digest("coverage", self.finger, lattice, kind, hidden, TRUE, EFFECTS[hidden], self.points)

        def make() -> dict[str, Array]:
            case = base_case(finger=self.finger, lattice=lattice).with_material(**TRUE)
            return _solved(converted(case, kind) if kind else case, hidden, self.points, self.course)

        found = kept("truth", key, make)
        return Truth(mesh, hidden, found["u"], found["slope"], {**TRUE, **EFFECTS[hidden]})

    def targets(self, truth: "Truth", seed: int) -> Targets:
        """One draw of what would be measured."""
        return drawn(self.points, self.nodes, truth.u, truth.slope, self.course, self.bench, seed)


@dataclass(frozen=True)
class Truth:
    """What is hidden on which mesh: displacements u (s, p, 3) mm and dU/dp (s, p, 3) mm per MPa, and the true
    values by name."""

    mesh: str
    hidden: str
    u: Array
    slope: Array
    values: Mapping[str, float]


@dataclass(frozen=True)
class Row:
    """One parameter over the draws of one truth: how many intervals hold it, mean and sd of the pulls, the
    mean half width of an interval."""

    mesh: str
    hidden: str
    name: str
    draws: int
    covered: int
    mean: float
    sd: float
    half_width: float


def drawn(
    points: Array, nodes: Array, u: Array, slope: Array, course: Path, bench: virtual.Bench, seed: int
) -> Targets:
    """One draw of what would be measured of true displacements u (s, p, 3) mm of markers at nodes (p,)."""
    names = (*(f"p{k}" for k in range(len(points) - 1)), "tip")
    at = virtual.at_nodes(names, nodes, points)
    return virtual.noisy_targets(u, slope, course, points=at, bench=bench, seed=seed)


def _solved(case: Case, hidden: str, points: Array, course: Path) -> dict[str, Array]:
    own = np.array([nearest(case, x) for x in points])
    test = Test(case, course, own, np.ones(len(own), bool))
    if hidden:
        test = effect(hidden).before(test, {**TRUE, **EFFECTS[hidden]})
    u, _, solution = respond(test, (), start=None)
    return {"u": u, "slope": solution.per_pressure(own)}


def _kept_arrays(stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
    def one(make: Callable[[], Array]) -> dict[str, Array]:
        return {"array": make()}

    return {key: kept("mesh", key, partial(one, make))["array"] for key, make in tasks.items()}


# -- draws -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Estimates:
    """Parameters (d,) of one draw with their covariance (d, d)."""

    theta: Array
    covariance: Array


def pulls(
    laboratory: Laboratory, truth: Truth, seeds: Sequence[int], *, agree: bool
) -> tuple[list[Row], float]:
    """The rows of one truth, and how far a linear and a full refit are apart, in sds (0: not asked)."""
    model = laboratory.model.with_effect(effect(truth.hidden)) if truth.hidden else laboratory.model
    true = model.theta(truth.values)
    first = judge(model, laboratory.targets(truth, seeds[0]), starts=true)
    errors = ModelErrors.of(model, first.theta, laboratory.targets(truth, seeds[0]))
    found = [linear(model, first.theta, errors, laboratory.targets(truth, seed)) for seed in seeds]
    distance = 0.0
    if agree:
        full = judge(model, laboratory.targets(truth, seeds[-1]), starts=true)
        off = (found[-1].theta - full.theta) / full.fit.sd
        distance = float(np.abs(off).max())
    names = [p.name for p in model.parameters]
    return [row(truth, name, found, true, names) for name in (*names, "sum", "share")], distance


def linear(model: Model, theta: Array, errors: ModelErrors, targets: Targets) -> Estimates:
    """The estimates of a draw by one linear step from theta (d,), with the noise model of its own."""
    w = errors.whitener(targets)
    A = w.whiten(model.jacobian(theta)).T
    covariance = np.asarray(np.linalg.inv(A.T @ A), float)
    z = w.whiten(targets.value - model.predict(theta))
    return Estimates(theta + covariance @ (A.T @ z), covariance)


def row(truth: Truth, name: str, found: Sequence[Estimates], true: Array, names: Sequence[str]) -> Row:
    values = np.array([_of(name, e, names) for e in found])  # (draws, 2): value and sd
    wanted = _of(name, Estimates(true, np.eye(len(true))), names)[0]
    pull = (values[:, 0] - wanted) / values[:, 1]
    return Row(
        truth.mesh, truth.hidden, name, len(found), int((np.abs(pull) <= SD).sum()), float(pull.mean()),
        float(pull.std()), float(SD * values[:, 1].mean()),
    )  # fmt: skip


def _of(name: str, found: Estimates, names: Sequence[str]) -> tuple[float, float]:
    """A parameter, or the sum or share of the constants, with its sd to first order."""
    gradient, constants = np.zeros(len(names)), mooney_rivlin(*found.theta[:2])
    if name == "sum":
        gradient[:2], value = 1.0, constants.scale
    elif name == "share":
        gradient[:2] = np.array([-constants["C01"], constants["C10"]]) / constants.scale**2
        value = constants["C01"] / constants.scale
    else:
        k = list(names).index(name)
        gradient[k], value = 1.0, float(found.theta[k])
    return value, float(np.sqrt(gradient @ found.covariance @ gradient))


# -- the table ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Total:
    """One parameter over all truths, with an effect in the model or without."""

    model: str
    name: str
    draws: int
    covered: float
    pull_rms: float


def totals(rows: Sequence[Row]) -> list[Total]:
    """The coverage of each parameter over the truths of each model, and of all parameters."""
    out = []
    for hidden in dict.fromkeys(r.hidden for r in rows):
        own = [r for r in rows if r.hidden == hidden]
        out += [
            _total(hidden or "base", n, [r for r in own if r.name == n])
            for n in dict.fromkeys(r.name for r in own)
        ]
    for title in ("without effect", "with effect"):
        some = [r for r in rows if bool(r.hidden) == (title == "with effect")]
        out += [_total(title, "all", some)] if some else []
    return out


def _total(model: str, name: str, rows: Sequence[Row]) -> Total:
    draws = sum(r.draws for r in rows)
    square = sum(r.draws * (r.mean**2 + r.sd**2) for r in rows) / draws
    return Total(model, name, draws, sum(r.covered for r in rows) / draws, float(np.sqrt(square)))


def line(r: Row) -> str:
    """One line of the table by truths."""
    return (
        f"{r.mesh:18s} {r.hidden:10s} {r.name:15s} pull {r.mean:+6.2f} sd {r.sd:5.2f}  "
        f"{r.covered:3d} of {r.draws}  +- {r.half_width:.3g}"
    )


def main() -> int:
    """Print the table; the exit code is 1 where the coverage over all parameters is not within WANTED."""
    typed = options(__doc__, {
        "--draws": (25, "of each truth (25)"),
        "--seed": (1, "of the draws"),
        "--agree": "a full fit of one more draw of each truth",
        "--hidden": {"nargs": "*", "choices": tuple(EFFECTS), "help": "these effects alone"},
    }, quick="a finger of three bellows", json="one JSON line")  # fmt: skip
    laboratory = Laboratory.of(SHORT if typed.quick else Finger())
    rows: list[Row] = []
    agree = 0.0
    for hidden in EFFECTS if typed.hidden is None else typed.hidden:
        for mesh in MESHES:
            seeds = range(typed.seed, typed.seed + typed.draws)
            some, off = pulls(laboratory, laboratory.truth(mesh, hidden), seeds, agree=typed.agree)
            rows, agree = [*rows, *some], max(agree, off)
            for r in some:
                print(line(r), file=sys.stderr, flush=True)
    found = totals(rows)
    if typed.json:
        print(
            json.dumps(
                {"totals": [asdict(t) for t in found], "rows": [asdict(r) for r in rows], "agree": agree}
            )
        )
    else:
        print(f"{'model':15s} {'parameter':16s} draws  covered  pull rms")
        for t in found:
            print(f"{t.model:15s} {t.name:16s} {t.draws:5d} {t.covered:8.1%} {t.pull_rms:9.2f}")
        print(f"linear and full refit differ by at most {agree:.2f} sd")
    return int(any(not WANTED[0] <= t.covered <= WANTED[1] for t in found if t.name == "all"))


if __name__ == "__main__":
    sys.exit(main())
