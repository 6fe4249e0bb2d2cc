"""The engine that is built in: this package's own kernel."""

import time
from dataclasses import dataclass

import numpy as np

from fe.case import Case
from fe.deck.engine import EngineResult
from fe.element import Array
from fe.path import Path
from fe.solving import solve


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
        found = solve(case, Path(ramp, pressure * ramp, share, gravity=weight))
        seconds = time.perf_counter() - start
        if not found.converged:
            return EngineResult.failed(found.reason, seconds)
        course = found.fields(range(len(share)))
        return EngineResult(case.labels, share, course, True, found.reason, seconds)
