"""Which way of finding C10 and C01 needs how many whole solves, and how near does it come?

    python benchmarks/studymethods.py [--quick] [--json]

Twelve problems as the reference study has them: U1 and U3 of the tip and of mid length of a short finger at
three pressures, with noise of 0.02 mm. The truths have another mesh and element than the model; every second
one stiffens by C20, a law that the model lacks. All minimise the same: the RMS of the residual. A solve
follows the finger to the highest pressure; with derivatives it costs about a third more. Sum and share are
held against those of the lowest RMS that any method found: the coarse mesh, which is too stiff, puts all of
them off the truth (`mesh`). `true_share_off` is the share against the truth.

`genetic`: the study's algorithm, 562 solves, on the first two problems. `genetic, paths`: the same on the
load paths, the best of every generation solved whole, as `twin study` does. `least squares`:
Levenberg-Marquardt from three starts, solves with derivatives. `cma-es`: the package cma. `bayesian`: the
package bayesian-optimization (`pip install cma bayesian-optimization`). --quick: two problems, without
`genetic`; not written. The rows are written to `benchmarks/results/studymethods.json`.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.collected import RESULTS
from benchmarks.diagnosis.snapshots import SHORT

import numpy as np

from calibrate import Parameter, Population, least_squares
from fe import Case, Lattice, Material, Path, Variation, finger_case, solve
from twin.laws.law import Constants
from twin.laws.mooneyrivlin import mooney_rivlin
from twin.model.loadpaths import load_paths
from twin.targets import Array
from twin.virtual.truthsolves import CHANGE, on_surface, truth_case

PRESSURE = np.array([0.0, 0.01, 0.02, 0.03])  # MPa
POINTS = np.array([SHORT.tip_node, SHORT.middle_node])
AXES = (0, 2)
NOISE_MM = 0.02
SCALE_MM = 0.2  # what so coarse a mesh leaves: least squares end where steps are small against it
FREE = (Parameter("C10", 0.01, 0.5, "MPa"), Parameter("C01", 0.0, 0.5, "MPa"))
LOW, HIGH = (np.array([getattr(p, end) for p in FREE]) for end in ("low", "high"))
STARTS = np.array([[0.25, 0.1], [0.1, 0.3], [0.45, 0.02]])
GENERATIONS = 20
CMA_SOLVES, BAYES_SOLVES = 120, 40
PROBLEMS = 12
WHOLLY = 2  # of them with the genetic algorithm on whole solves: three minutes each
SEED = 7
STEP = 1e-4  # MPa, of a central difference of the case


@dataclass(frozen=True)
class Problem:
    """Measured displacements (12,) mm of a truth with known constants, and the model's case and points."""

    name: str
    constants: Constants
    measured: Array
    case: Case
    points: Array


@dataclass(eq=False)
class Solver:
    """Whole solves of the model of a problem, counted, and their seconds of processor."""

    problem: Problem
    solves: int = 0
    seconds: float = 0.0
    failed: int = 0

    def residual(self, theta: Array, *, derivatives: bool = False) -> tuple[Array, Array] | None:
        """Measured less predicted (n,) mm, and its derivatives (n, 2); None where there is no equilibrium."""
        began = time.process_time()
        case, path = self.problem.case, Path(PRESSURE, PRESSURE, PRESSURE[1:])
        around = [_varied(case, theta, k, path) for k in range(2)] if derivatives else []
        found = solve(_with(case, theta), path, variations=around)
        self.solves += 1
        self.seconds += time.process_time() - began
        if not found.converged:
            self.failed += 1
            return None
        r = self.problem.measured - _flat(found.at(self.problem.points))
        slopes = [-_flat(u) for u in found.variations_at(self.problem.points)] if derivatives else []
        return r, np.array(slopes).T

    def rms(self, theta: Array) -> float:
        """The RMS in mm; that of the measured displacements where there is no equilibrium."""
        r = self.residual(np.asarray(theta, float))
        return _rms(self.problem.measured) if r is None else _rms(r[0])


def _varied(case: Case, theta: Array, k: int, path: Path) -> Variation:
    h = STEP * np.eye(2)[k]
    return Variation((_with(case, theta + h), path), (_with(case, theta - h), path), 2 * STEP)


def _with(case: Case, theta: Array) -> Case:
    return case.with_material(C10=float(theta[0]), C01=float(theta[1]))


def _flat(u: Array) -> Array:
    return u[..., AXES].ravel()


def _rms(r: Array) -> float:
    return float(np.sqrt(np.mean(r**2)))


def problems(count: int) -> Iterator[Problem]:
    """The problems, each with constants of its own."""
    rng = np.random.default_rng(SEED)
    model = finger_case(Material(), finger=SHORT, lattice=Lattice(per_bellow=2, ring=False, centred=False))
    for k in range(count):
        total, share = rng.uniform(0.2, 0.45), rng.uniform(0.05, 0.6)
        own = mooney_rivlin(total * (1 - share), total * share)
        stiffer = 0.03 if k % 2 else 0.0
        material = Material(own["C10"], own["C01"], C20=stiffer)
        truth = truth_case(SHORT, CHANGE, material=material)
        found = solve(truth, Path(PRESSURE, PRESSURE, PRESSURE[1:]))
        if not found.converged:
            raise RuntimeError(f"problem {k}: the truth {found.reason}")
        u = _flat(found.at(on_surface(truth, POINTS)))
        name = f"{k + 1}: {own.told}" + (", C20 0.03 MPa" if stiffer else "")
        yield Problem(name, own, u + NOISE_MM * rng.normal(size=u.shape), model, on_surface(model, POINTS))


# -- methods: a solver and a seed -> the best theta (2,) -----------------------------------------------------


def genetic(solver: Solver, seed: int) -> Array:
    population = Population(FREE, seed=seed)
    for _ in range(GENERATIONS):
        asked = population.ask()
        population.tell(asked, np.array([solver.rms(theta) for theta in asked]))
    assert population.best is not None
    return population.best[0]


def genetic_on_paths(solver: Solver, seed: int) -> Array:
    problem = solver.problem
    began, made = time.process_time(), []

    def cache(_: str, tasks: dict[str, Callable[[], Array]]) -> dict[str, Array]:
        made.extend(tasks)
        return {key: task() for key, task in tasks.items()}

    paths = load_paths(problem.case, problem.points, cache=cache, key="study methods")
    solver.solves += len(made)
    solver.seconds += time.process_time() - began
    population = Population(FREE, seed=seed)
    for _ in range(GENERATIONS):
        asked = population.ask()
        began = time.process_time()
        costs = np.array([_on_paths(problem, paths, theta) for theta in asked])
        solver.seconds += time.process_time() - began
        population.tell(asked, costs)
        assert population.best is not None
        solver.rms(population.best[0])
    return population.best[0]


def _on_paths(problem: Problem, paths: Any, theta: Array) -> float:
    u = paths.predict(mooney_rivlin(*map(float, theta)), PRESSURE[1:])
    return _rms(problem.measured) if u is None else _rms(problem.measured - _flat(u))


def least(solver: Solver, seed: int) -> Array:
    known: dict[bytes, tuple[Array, Array] | None] = {}

    def at(theta: Array) -> tuple[Array, Array] | None:
        if theta.tobytes() not in known:
            known[theta.tobytes()] = solver.residual(theta, derivatives=True)
        return known[theta.tobytes()]

    def residual(theta: Array) -> Array | None:
        found = at(theta)
        return None if found is None else found[0] / SCALE_MM

    def jacobian(theta: Array) -> Array:
        found = at(theta)
        assert found is not None
        return found[1] / SCALE_MM

    fits = (least_squares(residual, jacobian, FREE, start=start, tolerance=0.1) for start in STARTS)
    return min(fits, key=lambda fit: fit.chi2).theta


def evolution(solver: Solver, seed: int) -> Array:
    import cma

    own = {"bounds": [[0, 0], [1, 1]], "seed": seed, "maxfevals": CMA_SOLVES, "verbose": -9, "tolfun": 1e-6}
    found = cma.CMAEvolutionStrategy([0.5, 0.3], 0.25, own)
    found.optimize(lambda x: solver.rms(LOW + (HIGH - LOW) * np.asarray(x)))
    return np.asarray(LOW + (HIGH - LOW) * found.result.xbest)


def bayesian(solver: Solver, seed: int) -> Array:
    from bayes_opt import BayesianOptimization

    def score(C10: float, C01: float) -> float:
        return -float(np.log(solver.rms(np.array([C10, C01]))))

    own = BayesianOptimization(
        score, {p.name: (p.low, p.high) for p in FREE}, random_state=seed, verbose=0
    )
    own.maximize(init_points=8, n_iter=BAYES_SOLVES - 8)
    assert own.max is not None
    return np.array([own.max["params"][p.name] for p in FREE])


METHODS: dict[str, Callable[[Solver, int], Array]] = {
    "least squares": least,
    "genetic, paths": genetic_on_paths,
    "cma-es": evolution,
    "bayesian": bayesian,
    "genetic": genetic,
}


def row_of(problem: Problem, method: str) -> dict[str, Any]:
    """What a method found of a problem, and at what cost."""
    solver, began = Solver(problem), time.process_time()
    theta = METHODS[method](solver, SEED)
    spent, solves, failed = time.process_time() - began, solver.solves, solver.failed
    return {
        "problem": problem.name, "method": method, "solves": solves, "failed": failed, "cpu_s": spent,
        "solving_cpu_s": solver.seconds, "rms_mm": solver.rms(theta), "C10": float(theta[0]),
        "C01": float(theta[1]), "true_C10": problem.constants["C10"], "true_C01": problem.constants["C01"],
    }  # fmt: skip


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row a method: medians over its problems; above: the largest RMS over the lowest that any found."""
    out, found = [], lowest(rows)
    for method in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == method]
        best = [found[row["problem"]] for row in own]
        off = np.array([_off(*_sum_and_share(a), *_sum_and_share(b)) for a, b in zip(own, best, strict=True)])
        out.append(
            {"method": method, "problems": len(own)}
            | {key: float(np.median([row[key] for row in own])) for key in ("solves", "cpu_s", "rms_mm")}
            | {"above": max(a["rms_mm"] / b["rms_mm"] for a, b in zip(own, best, strict=True))}
            | dict(zip(("total_off", "share_off"), map(float, np.median(off, axis=0)), strict=True))
            | {"true_share_off": float(np.median([abs(_sum_and_share(r)[1] - _true_share(r)) for r in own]))}
        )
    return out


def lowest(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Of each problem the row with the lowest RMS."""
    return {row["problem"]: row for row in sorted(rows, key=lambda row: -row["rms_mm"])}


def mesh(rows: list[dict[str, Any]]) -> float:
    """By how much the sum of the lowest RMS is off the truth, median over the problems."""
    own = lowest(rows).values()
    return float(np.median([(r["C10"] + r["C01"]) / (r["true_C10"] + r["true_C01"]) - 1 for r in own]))


def _sum_and_share(row: dict[str, Any]) -> tuple[float, float]:
    total = row["C10"] + row["C01"]
    return total, row["C01"] / total


def _true_share(row: dict[str, Any]) -> float:
    return row["true_C01"] / (row["true_C10"] + row["true_C01"])


def _off(total: float, share: float, best_total: float, best_share: float) -> tuple[float, float]:
    return abs(total / best_total - 1), abs(share - best_share)


def table(rows: list[dict[str, Any]]) -> None:
    """Prints a summary."""
    heads = ("method", "problems", "whole solves", "s", "RMS, mm", "worst, of the lowest", "sum off",
             "share off", "off the true share")  # fmt: skip
    print(f"| {' | '.join(heads)} |")
    print("|---|---|---|---|---|---|---|---|---|")
    for r in rows:
        print(
            f"| {r['method']} | {r['problems']} | {r['solves']:.0f} | {r['cpu_s']:.1f} | {r['rms_mm']:.4f} "
            f"| {r['above']:.3f} | {r['total_off']:.2%} | {r['share_off']:.3f} | {r['true_share_off']:.2f} |"
        )


def main() -> int:
    typed = options(__doc__, quick="two problems, without `genetic`; not written", json="one JSON line")
    rows = []
    for k, problem in enumerate(problems(2 if typed.quick else PROBLEMS)):
        for method in list(METHODS)[: -1 if typed.quick or k >= WHOLLY else None]:
            rows.append(row_of(problem, method))
            told = "{problem}, {method}: {solves} solves, {cpu_s:.1f} s, {rms_mm:.4f} mm".format(**rows[-1])
            print(told, file=sys.stderr, flush=True)
    methods, stiffer = summary(rows), mesh(rows)
    if not typed.quick:
        text = "[\n" + ",\n".join(json.dumps(r) for r in rows) + "\n]"
        parts = f'"methods": {json.dumps(methods, indent=1)},\n"mesh": {stiffer},\n"rows": {text}'
        (RESULTS / "studymethods.json").write_text(f"{{{parts}}}\n", encoding="utf-8")
    if typed.json:
        print(json.dumps({"methods": methods, "mesh": stiffer, "rows": rows}))
    else:
        table(methods)
        print(f"The mesh puts the sum of the lowest RMS {stiffer:+.0%} off the truth.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
