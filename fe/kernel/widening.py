"""A system in which more unknowns meet than in its elements: those of faces that touch each other."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fe.element import Array, Integers
from fe.kernel.matrix import Symmetric
from fe.kernel.pattern import Pattern, Places
from fe.kernel.reduced import Reduced


@dataclass(frozen=True)
class Wider:
    """The wider pattern, where (nnz,) the entries of the narrow one are in it, and its solver."""

    pattern: Pattern
    narrow: Places
    matrix: Symmetric | Reduced

    @staticmethod
    def of(narrow: Pattern, unknowns: Integers, solver: Callable[[Pattern], Symmetric | Reduced]) -> "Wider":
        """The pattern in which the unknowns (g, k) of each group meet each other, too; -1 is none of them."""
        pattern = narrow.joined(Pattern.of(unknowns, len(narrow.indptr) - 1))
        rows, columns = narrow.entries
        places = pattern.places(rows[:, None], columns[:, None]).ravel()
        return Wider(pattern, places, solver(pattern))

    def spread(self, data: Array) -> Array:
        """The values (nnz,) of the narrow pattern in the wider one."""
        out = np.zeros(len(self.pattern.indices))
        out[self.narrow] = data
        return out
