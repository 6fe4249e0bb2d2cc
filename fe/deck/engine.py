"""What an engine is: something that solves a case; and what it gives. Every engine has a file of its own."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fe.case import Case
from fe.element import Array, Integers


@dataclass(frozen=True)
class EngineResult:
    """Final displacements u (n, 3) mm of the nodes `labels` (n,), or the reason why there are none; the time
    it took in s."""

    labels: Integers
    u: Array
    converged: bool
    reason: str
    seconds: float

    @staticmethod
    def failed(reason: str, seconds: float) -> "EngineResult":
        """No displacements, and why."""
        return EngineResult(np.empty(0, np.int64), np.empty((0, 3)), False, reason, seconds)

    def at(self, label: int) -> Array:
        """The displacement (3,) mm of one node. ValueError where the response has none."""
        row = np.flatnonzero(self.labels == label)
        if not len(row):
            what = f"node {label} is not in it" if self.converged else self.reason
            raise ValueError(f"no displacement of node {label} in this response: {what}")
        return np.asarray(self.u[row[0]], float)


class Engine(Protocol):
    """Something that solves a case under a follower pressure."""

    @property
    def name(self) -> str:
        """What it is called."""

    def solve(self, case: Case, pressure: float, *, gravity: Array | None = None) -> EngineResult:
        """The response of a case to a pressure in MPa and a gravity (3,) mm/s2, by default none; never raises
        for lack of convergence."""
