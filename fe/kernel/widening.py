"""A system in which more unknowns meet than in its elements: those of faces that touch each other."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fe.element import Array, Integers
from fe.kernel.matrix import Symmetric
from fe.kernel.pattern import Pattern, Places


@dataclass(frozen=True)
class Wider:
    """The wider pattern, and where (nnz,) the entries of the narrow one are in it."""

    pattern: Pattern
    narrow: Places

    @staticmethod
    def of(narrow: Pattern, unknowns: Integers) -> "Wider":
        """The pattern in which the unknowns (g, k) of each group meet each other, too; -1 is none of them."""
        pattern = narrow.joined(Pattern.of(unknowns, len(narrow.indptr) - 1))
        rows, columns = narrow.entries
        return Wider(pattern, pattern.places(rows[:, None], columns[:, None]).ravel())

    def spread(self, data: Array) -> Array:
        """The values (nnz,) of the narrow pattern in the wider one."""
        out = np.zeros(len(self.pattern.indices))
        out[self.narrow] = data
        return out

    @cached_property
    def matrix(self) -> Symmetric:
        """The solver for it."""
        return Symmetric(self.pattern.indptr, self.pattern.indices)
