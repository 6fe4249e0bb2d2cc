"""Changes of an equilibrium by a tangent that is factorised nearby, corrected until they are its own.

With K0 factorised and K the equilibrium's own tangent, x = K0^-1 r is corrected by K0^-1 (r - K x) (iterative
refinement): a product K x of all columns at once and their back-substitution take a quarter of a new tangent.
"""

from collections.abc import Sequence

import numpy as np

from fe.element import Flags
from fe.kernel.assembly import State
from fe.solver.newton import Equilibrium, Reached, Residual, Step, moved

TURNS = 4  # corrections that cost as much as a new tangent
ACCURATE = 1e-7  # of a change: what may be left of it


class Corrected:
    """The tangent of an equilibrium: the one that it was found with, or corrections of it; a new one where
    they shrink too slowly. `step`: the newest one that is factorised."""

    def __init__(self, step: Step, place: Reached | None) -> None:
        self.step, self._place = step, place

    @staticmethod
    def of(found: Equilibrium) -> "Corrected":
        """That of an equilibrium which was found."""
        assert found.step is not None
        return Corrected(found.step, found.place)

    @property
    def slides(self) -> Flags | None:
        """Where (f, q) the surface slides on a plane, or None without a plane."""
        return self.step.slides

    def solve(self, residuals: Sequence[Residual]) -> list[State]:
        """For each change of the residuals the change of state that cancels it."""
        changes = self.step.solve(residuals)
        if self._place is None or not changes:
            return changes
        before = np.array([np.abs(x.u).max() for x in changes])
        enough = ACCURATE * before
        for _ in range(TURNS):
            left = [r.plus(k) for r, k in zip(residuals, self._place.along(changes), strict=True)]
            more = self.step.solve(left)
            size = np.array([np.abs(x.u).max() for x in more])
            changes = [moved(x, dx) for x, dx in zip(changes, more, strict=True)]
            if (size**2 <= enough * before).all():  # the next would shrink as this one did
                return changes
            before = size
        self.step, self._place = self._place.factorised(), None
        return self.step.solve(residuals)
