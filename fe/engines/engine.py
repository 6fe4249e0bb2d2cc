"""The interface of an engine (`Engine`, `Program`), its result, and the built-in engine (`Embedded`)."""

import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import scipy

from fe.case import Case
from fe.element import Array, Integers
from fe.mesh.convert import filled, kept_nodes
from fe.path import Path as LoadPath
from fe.solver.curve import Curve
from fe.solving import Solution, solve

FARTHEST_MM = 1e6  # of a displacement
NONE, NO_COURSE = np.empty(0), np.empty((0, 0, 3))


@dataclass(frozen=True)
class EngineResult:
    """Displacements of the nodes `labels` (n,) while the pressure grows, or the reason of a failure.

    share (k,): increasing shares of the full pressure, at the engine's increments; course (k, n, 3) mm:
    displacements there, up to the last increment reached. seconds: run time. ValueError for shares that do
    not increase, and for displacements that are no finite numbers.
    """

    labels: Integers
    share: Array
    course: Array
    converged: bool
    reason: str
    seconds: float

    def __post_init__(self) -> None:
        if not (np.diff(self.share) > 0).all() or not np.isfinite(self.share).all():
            raise ValueError(f"its result has times that do not increase: {self.share[:4].tolist()} ..")
        if not (np.abs(self.course) < FARTHEST_MM).all():
            raise ValueError(f"its result has displacements that are no numbers below {FARTHEST_MM:g} mm")

    @staticmethod
    def failed(reason: str, seconds: float) -> "EngineResult":
        """No displacements, and why."""
        return EngineResult(np.empty(0, np.int64), NONE, NO_COURSE, False, reason, seconds)

    @property
    def u(self) -> Array:
        """Displacements (n, 3) mm at the whole pressure; (0, 3) where it was not reached."""
        return np.asarray(self.course[-1], float) if self.converged else np.empty((0, 3))

    def at(self, label: int) -> Array:
        """The displacement (3,) mm of one node. ValueError where the response has none."""
        row = np.flatnonzero(self.labels == label)
        if not (len(row) and self.converged):
            what = f"node {label} is not in it" if self.converged else self.reason
            raise ValueError(f"no displacement of node {label} in this response: {what}")
        return np.asarray(self.u[row[0]], float)


class Engine(Protocol):
    """Something that solves a case under a follower pressure."""

    @property
    def name(self) -> str:
        """Name of the engine."""

    def solve(
        self, case: Case, pressure: float, *, gravity: Array | None = None, levels: int = 0
    ) -> EngineResult:
        """Response of a case to a pressure in MPa and a gravity (3,) mm/s2, by default none; never raises for
        lack of convergence. levels: least number of pressures with output; 0: at the end alone."""


class Program(Engine, Protocol):
    """An engine that is another program: it solves decks, in a folder of its own."""

    @property
    def kind(self) -> str:
        """The element, of Abaqus's names, that takes the place of hex27."""

    def deck(self, case: Case, pressure: float, *, gravity: Array | None = None, levels: int = 0) -> str:
        """The deck of a case; ValueError for what it cannot solve."""

    def solve(
        self, case: Case, pressure: float, *, gravity: Array | None = None, levels: int = 0
    ) -> EngineResult:
        """As `Engine.solve`, by `deck` and `run`; the weight is applied in a step before the pressure where
        `levels` ask for output. Raises what those two raise."""
        return self.run(self.deck(case, pressure, gravity=gravity, levels=levels))

    def unfit(self, case: Case) -> str:
        """Reason why it cannot solve a case of rubber, "" if it can."""

    def run(self, text: str, *, folder: Path | None = None) -> EngineResult:
        """Response of a deck over its last step. FileNotFoundError where the program is not installed; never
        raises for lack of convergence. folder: the job's folder, with job.log."""

    def release(self) -> str:
        """The program's version. FileNotFoundError where it is not installed."""


def program(executable: str, what: str, install: str) -> str:
    """The path of an engine's program. FileNotFoundError where it is not installed."""
    path = shutil.which(executable)
    if path is None:
        raise FileNotFoundError(f"{executable}: not found, wanted {what}; {install}")
    return path


@dataclass(frozen=True)
class Embedded:
    """This package's own kernel."""

    name: str = "embedded"

    def solve(
        self, case: Case, pressure: float, *, gravity: Array | None = None, levels: int = 0
    ) -> EngineResult:
        """The response of a case to a pressure in MPa and a gravity (3,) mm/s2, by default none."""
        start, weight = time.perf_counter(), np.zeros(3) if gravity is None else gravity
        ramp, share = np.array([0.0, 1.0]), np.linspace(0.0, 1.0, max(levels, 1) + 1)[1:]
        solution = solve(case, LoadPath(ramp, pressure * ramp, share, gravity=weight))
        seconds = time.perf_counter() - start
        if not solution.converged:
            return EngineResult.failed(solution.reason, seconds)
        course = solution.fields(range(len(share)))
        return EngineResult(case.labels, share, course, True, solution.reason, seconds)


LEAST = 4  # increments, rest included, through which a cubic spline goes


def over_pressure(result: EngineResult, case: Case, kind: str, *, top: float) -> tuple[Array, Array]:
    """Pressures (k,) MPa from 0 to the last one reached, and displacements (k, n, 3) mm of a case's nodes
    there.

    kind: the element that replaced hex27; top: the full pressure in MPa. ValueError where displacements of
    some nodes are missing.
    """
    order = np.argsort(result.labels)
    index = np.searchsorted(result.labels, case.labels, sorter=order)
    rows = order[np.minimum(index, len(order) - 1)]
    there = result.labels[rows] == case.labels
    needed = _needed(case, kind)
    if not there[needed].all():
        label = int(case.labels[needed][~there[needed]][0])
        raise ValueError(f"the result has no displacement of node {label}")
    u = np.where(there[:, None], result.course[:, rows], 0.0)
    if case.element.name == "hex27":
        u = filled(case, kind, u)
    share = result.share
    if share[0] > 0.0:  # nothing was put on before the pressure
        share, u = np.append(0.0, share), np.concatenate([np.zeros_like(u[:1]), u])
    return top * share, u


def _needed(case: Case, kind: str) -> Integers:
    """Rows of the nodes for which the program must return displacements."""
    return kept_nodes(case, kind) if case.element.name == "hex27" else np.unique(case.connectivity)


def along(case: Case, path: LoadPath, courses: Sequence[tuple[Array, Array]], number: Integers) -> Solution:
    """The solution of a case along a path, from a course in each direction of gravity: pressures (k,) MPa and
    displacements (k, n, 3) mm; number (s,): which of them belongs to an output time.

    A cubic spline runs through the increments of the program that solved it; derivatives and pressure modes
    are absent. Nodes that its elements do not have are interpolated by its shape functions.
    """
    output = path.at_output()
    return Solution(
        case=case, path=path, curves=tuple(_curve(*c) for c in courses), number=number, pressure=output,
        slopes=np.zeros((0, len(output))), history=None, iterations=0, reason="converged",
    )  # fmt: skip


def _curve(pressure: Array, u: Array) -> Curve:
    none, nothing = np.zeros(len(pressure)), np.zeros((len(pressure), 1, 1))
    return Curve(
        pressure=pressure, u=u, p=nothing, rotation=none,
        u_slope=np.asarray(scipy.interpolate.CubicSpline(pressure, u, axis=0)(pressure, 1)), p_slope=nothing,
        rotation_slope=none, derivative=np.zeros((0, *u.shape)), p_derivative=np.zeros((0, *nothing.shape)),
        touch=np.zeros((len(u), 3)), touch_derivative=np.zeros((0, len(u), 3)),
        iterations=0, reason="converged",
    )  # fmt: skip
