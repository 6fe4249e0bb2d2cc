"""Linear solves with an equilibrium's tangent by means of a tangent factorised nearby (iterative refinement).

With K0 factorised and K the equilibrium's own tangent, x = K0^-1 r is corrected by K0^-1 (r - K x): a product
K x of all columns at once and their back-substitution take a quarter of a new tangent.
"""

from collections.abc import Sequence

import numpy as np

from fe.element import Flags
from fe.kernel.assembly import State
from fe.solver.newton import Equilibrium, Reached, Residual, Step, moved

MANY = 12  # columns of which one correction costs as much as a new tangent
TURNS = 4  # corrections that cost as much as a new tangent
ACCURATE = 1e-7  # of a change: what may be left of it


class Corrected:
    """Tangent of an equilibrium: factorised, or refined from a nearby one; factorised anew where refinement
    converges too slowly. `step`: the newest factorised tangent."""

    def __init__(self, step: Step, place: Reached | None) -> None:
        self.step, self._place = step, place

    @staticmethod
    def of(equilibrium: Equilibrium) -> "Corrected":
        """The tangent of a converged equilibrium."""
        assert equilibrium.step is not None
        return Corrected(equilibrium.step, equilibrium.place)

    @property
    def slides(self) -> Flags | None:
        """Flags (f, q) of points that slide on an obstacle; None without one."""
        return self.step.slides

    def solve(self, residuals: Sequence[Residual]) -> list[State]:
        """Changes of state that cancel the residuals."""
        if self._place is not None and len(residuals) > MANY:
            self.step, self._place = self._place.factorised(), None
        changes = self.step.solve(residuals)
        if self._place is None or not changes:
            return changes
        before = np.array([np.abs(x.u).max() for x in changes])
        enough = ACCURATE * before
        for _ in range(TURNS):
            remainders = [r.plus(k) for r, k in zip(residuals, self._place.along(changes), strict=True)]
            more = self.step.solve(remainders)
            size = np.array([np.abs(x.u).max() for x in more])
            changes = [moved(x, dx) for x, dx in zip(changes, more, strict=True)]
            if (size**2 <= enough * before).all():  # the next would shrink as this one did
                return changes
            before = size
        self.step, self._place = self._place.factorised(), None
        return self.step.solve(residuals)
