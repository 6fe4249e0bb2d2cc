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

    def solve(self, case: Case, pressure: float, *, gravity: Array | None = None) -> EngineResult:
        """The response of a case to a pressure in MPa and a gravity (3,) mm/s2, by default none."""
        start, weight = time.perf_counter(), np.zeros(3) if gravity is None else gravity
        ramp = np.array([0.0, 1.0])
        found = solve(case, Path(ramp, pressure * ramp, ramp[1:], gravity=weight))
        seconds = time.perf_counter() - start
        if not found.converged:
            return EngineResult.failed(found.reason, seconds)
        return EngineResult(case.labels, found.fields([0])[0], True, found.reason, seconds)
