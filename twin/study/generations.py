"""Load paths and targets -> the reference study's genetic algorithm, generation by generation, resumable."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate import Parameter, Population
from calibrate.genetic import ELITE
from twin.laws.law import Constants
from twin.model.enginemodel import EnginePaths
from twin.model.loadpaths import Turned
from twin.project.folder import Run
from twin.targets import Array, Targets

SEEN = 5.0  # sds: a motion that is less tells a search little
FAR = 5.0  # times as far along another axis: it is that along which the structure bends


@dataclass(frozen=True)
class Objective:
    """RMS over points of one displacement component at the first arrival at top pressure.

    steps (1 + r,): that step and those of the reference, with their pressures in MPa; rows (j,): the points;
    component: 0, 1, 2; measured (j,) mm.
    """

    steps: NDArray[np.int64]
    rows: Array
    component: int
    measured: Array
    pressure: Array

    @staticmethod
    def of(targets: Targets, names: tuple[str, ...], component: int) -> "Objective":
        """The objective of targets; ValueError where a point is not observed at that step, or the points move
        along another axis."""
        step = first_arrival(targets)
        rows = np.array([targets.names.index(n) for n in names])
        measured = targets.value[step, rows, component]
        if not np.isfinite(measured).all():
            lost = names[int(np.flatnonzero(~np.isfinite(measured))[0])]
            raise ValueError(
                f"point {lost!r} has no U{component + 1} at step {step}, the first arrival at top pressure, "
                "wanted a value in mm; choose other [calibrate] objective_points"
            )
        if (far := moving_component(targets, names, component)) != component:
            raise ValueError(
                f"calibrate.objective_component = {component + 1}: at the top pressure {', '.join(names)} "
                f"hardly move in U{component + 1}, but in U{far + 1}, and constants that are fitted to noise "
                f"are nobody's; write objective_component = {far + 1} under [calibrate] in twin.toml"
            )
        steps = np.append(step, targets.reference[targets.rests[targets.reference] == targets.rests[step]])
        return Objective(steps, rows, component, measured, targets.pressure[steps])

    def sd_mm(self, targets: Targets) -> float:
        """Standard error of a measured value in mm: the root of their mean variance."""
        variance = targets.covariance[self.steps[0], self.rows, self.component, self.component]
        return float(np.sqrt(variance.mean()))

    def cost(self, constants: Constants, paths: Turned | EnginePaths, rows: Array) -> float:
        """The RMS in mm; inf where the model has no equilibrium at that pressure. rows (r,): those of the
        targets that the paths belong to."""
        seen = self.predicted(constants, paths, rows, self.pressure[:1])
        return float("inf") if seen is None else float(np.sqrt(((seen[0] - self.measured) ** 2).mean()))

    def predicted(
        self, constants: Constants, paths: Turned | EnginePaths, rows: Array, pressure: Array
    ) -> Array | None:
        """The component (k, j) in mm at pressures (k,) MPa, relative to the reference; None where there is no
        equilibrium."""
        pressures = np.append(pressure, self.pressure[1:])
        steps = np.append(np.full(len(pressure), self.steps[0]), self.steps[1:])
        u = paths.predict(constants, pressures, steps=steps)
        if u is None:
            return None
        columns = [int(np.flatnonzero(rows == r)[0]) for r in self.rows]
        seen = u[:, columns, self.component]
        return np.asarray(seen[: len(pressure)] - seen[len(pressure) :].mean(axis=0))


def moving_component(targets: Targets, names: Sequence[str], component: int = 2) -> int:
    """The component in which points move at the first arrival at top pressure: the one given, unless they
    hardly move in it and far in another."""
    step, rows = first_arrival(targets), [targets.names.index(n) for n in names]
    size = np.sqrt((np.nan_to_num(targets.value[step, rows]) ** 2).mean(axis=0))
    sd = np.sqrt(targets.covariance[step, rows, component, component].mean())
    far = int(size.argmax())
    return far if size[component] < SEEN * sd and size[far] > FAR * size[component] else component


def first_arrival(targets: Targets) -> int:
    """The first step within 1 % of the top pressure, of those that are fitted; in a test without pressure,
    by weights, the one that moves most."""
    used = targets.used.any(axis=(1, 2))
    if not used.any():
        raise ValueError("targets: no value is fitted; wanted some with valid 1 in a block not held out")
    pressure = np.where(used, targets.pressure, -np.inf)
    if pressure.max() > 0.0:
        return int(np.flatnonzero(pressure >= 0.99 * pressure.max())[0])
    moved = np.where(targets.used, targets.value, 0.0) ** 2
    return int(moved.sum(axis=(1, 2)).argmax())


@dataclass(frozen=True)
class Generation:
    """Best individual so far, its RMS in mm, all candidates (m, d) and their costs (m,) in mm."""

    number: int
    best: Array
    rms_mm: float
    candidates: Array
    costs: Array


def search(
    parameters: tuple[Parameter, ...],
    cost: Callable[[dict[str, float]], float],
    run: Run,
    *,
    seed: int,
    size: int,
    generations: int,
    tell: Callable[[str, int, int], None],
    ahead: Callable[[list[dict[str, float]]], None] = lambda every: None,
) -> list[Generation]:
    """All generations of the genetic algorithm; a killed run's recorded ones are replayed, bit for bit.

    cost(values) -> mm, inf for a model that cannot be solved (logged, ranked last). ahead(candidates) is told
    those of a generation before their costs are asked for. Each generation is one record of log.jsonl before
    the next begins.
    """
    records = [r for r in run.log() if r.get("event") == "generation"]
    recorded = [
        (np.array(r["candidates"]), np.array([np.inf if c is None else c for c in r["costs"]]))
        for r in records
    ]
    population = Population.replay(parameters, recorded, seed=seed, size=size)
    names = [p.name for p in parameters]
    out: list[Generation] = []
    best: tuple[Array, float] = (np.zeros(len(names)), np.inf)
    for x, c in recorded:
        best = _better(best, x, c)
        out.append(Generation(len(out) + 1, best[0], best[1], x, c))
    while len(out) < generations:
        x = population.ask()
        every = [dict(zip(names, row, strict=True)) for row in x]
        ahead(every)
        c = np.array([cost(values) for values in every])
        population.tell(x, c)
        best = _better(best, x, c)
        out.append(Generation(len(out) + 1, best[0], best[1], x, c))
        costs = [float(v) if np.isfinite(v) else None for v in c]
        run.append({"event": "generation", "number": len(out), "candidates": x.tolist(), "costs": costs})
        tell("genetic algorithm", len(out), generations)
    return out


def evaluations(size: int, generations: int) -> int:
    """Number of candidates that a search evaluates: all of the first generation, all but the elite later."""
    return size + (generations - 1) * (size - ELITE)


def _better(best: tuple[Array, float], x: Array, c: Array) -> tuple[Array, float]:
    k = int(np.argmin(c))
    return (x[k].copy(), float(c[k])) if c[k] < best[1] else best
