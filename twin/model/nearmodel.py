"""A model that is solved where its response does not reach, and answers by its response near its solves.

A refit takes steps from its start. Where they are short, a second whole solve brings nothing that the first
one's derivatives do not say: the response states its error there, and up to a limit in mm it answers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fe import Solution
from twin.effects.protocol import Effect
from twin.model.keptmodel import KeptModel
from twin.model.prediction import Model, Solved
from twin.model.prediction import Tangents as SolvedTangents
from twin.model.response import Surrogate, Tangents
from twin.targets import Array

NEARBY = 0.25  # of the noise: a response that states so small an error serves for a whole solve
FORESEEN = 0.1  # of a move, by which the response may miss it and its derivatives still serve
BLIND = 10.0  # moves, by which it states to err where it foresees nothing: of the demo's laws 0.1, 1 and 240


@dataclass(frozen=True)
class NearModel(Model):
    """A whole model, its response, and the error in mm, rms over what moves, up to which that serves."""

    whole: KeptModel = field(default=None, compare=False, repr=False)  # type: ignore[assignment]
    limit_mm: float = 0.0
    _known: list[Surrogate] = field(default_factory=list, init=False, compare=False, repr=False)

    @staticmethod
    def of(
        whole: KeptModel, base: KeptModel, theta: Array, tangents: Tangents, *, limit_mm: float
    ) -> "NearModel":
        """The model of all that it and its base have solved, as `Surrogate.of` takes it."""
        out = NearModel(
            whole.test, whole.effects, whole.reference, mesh=whole.mesh, parent=whole.parent,
            rests=whole.rests, whole=whole, limit_mm=limit_mm,
        )  # fmt: skip
        out._known.append(Surrogate.of(whole, base, theta, tangents))
        return out

    @property
    def response(self) -> Surrogate:
        """The response, with all that was solved."""
        return self._known[-1]

    def certify(self, theta: Array, *, derivatives: bool = False) -> None:
        """Solve the whole model at theta (d,): with derivatives where they are asked for, the response has
        none or states an error of BLIND times the move there, or what it foresaw is off by more than its
        limit and FORESEEN of the move."""
        response, solve = self.response, None
        if response.reaches(theta) and not derivatives:
            (u, sd), near = response.answer(theta), response.nearest(theta).u
            if self._rms(sd) <= max(self.limit_mm, BLIND * self._rms(u - near)):
                solve = self.whole.values(theta)
                missed, moved = self._rms(solve.u - u), self._rms(solve.u - near)
                if missed > max(self.limit_mm, FORESEEN * moved):
                    solve = None
        self._known[:] = [response.joined(solve) if solve else response.certified(theta)]

    def _rms(self, field: Array) -> float:
        return float(np.sqrt((field[:, self.test.moving] ** 2).mean()))

    def is_solved(self, theta: Array) -> bool:
        """True if it answers at theta (d,) by a whole solve."""
        return any(np.array_equal(s.theta, theta) for s in self.response.solves)

    def error_mm(self, theta: Array) -> float:
        """The error in mm of the response at theta (d,), 1 sd, rms over what moves; infinite before a whole
        solve of its own."""
        response = self.response
        if not response.solves or not response.reaches(theta):
            return float("inf")
        _, sd = response.answer(theta)
        return self._rms(sd)

    def solved(self, theta: Array, *, derivatives: bool = False) -> Solved:
        """As `Model.solved`, with the solution of the nearest whole solve."""
        if self.error_mm(theta) > self.limit_mm:
            self.certify(theta)
        return self.response.solved(theta, derivatives=derivatives)

    def solution(self, theta: Array) -> Solution:
        """The solution of the nearest whole solve."""
        self.solved(theta)
        return self.response.solution(theta)

    def per_pressure(self, theta: Array) -> Array:
        """As `Model.per_pressure`, at the nearest whole solve."""
        self.solved(theta)
        return self.response.per_pressure(theta)

    def modes(self, theta: Array) -> Array:
        """As `Model.modes`, from the nearest whole solve."""
        self.solved(theta)
        return self.response.modes(theta)

    def with_effect(self, effect: Effect) -> Model:
        """The whole model with one more effect."""
        return self.whole.with_effect(effect)

    def tangents(self, theta: Array, effects: Sequence[Effect]) -> SolvedTangents:
        """As `Model.tangents`, by whole solves."""
        return self.whole.tangents(theta, effects)
