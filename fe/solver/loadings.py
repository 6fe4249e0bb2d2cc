"""A problem and its neighbours under each gravity, set of pulls and shares of the pressure along a path."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe.element import Array, Integers
from fe.mesh.spreading import spread
from fe.path import Path
from fe.solver.newton import Problem
from fe.solver.sensitivity import Differenced


@dataclass(frozen=True)
class Loadings:
    """Distinct loadings of a path: problems (g,) and their neighbours by every parameter; of_run (r,):
    loading of each stretch of constant gravity, pulls and shares."""

    path: Path
    problems: tuple[Problem, ...]
    varied: tuple[tuple[Differenced, ...], ...]
    of_run: Integers

    @staticmethod
    def of(
        problem: Problem, path: Path, varied: Sequence[Differenced], paths: Sequence[tuple[Path, Path]]
    ) -> "Loadings":
        """Loadings of a problem without weight and pulls, without duplicates. paths: paths of the varied
        neighbours."""
        starts = np.append(0, path.turns + 1)
        has_weight = any(q.has_weight for q in (problem, *(q for v in varied for q in (v.plus, v.minus))))
        if not has_weight and not path.pulls.any() and not path.chambers:
            return Loadings(path, (problem,), (tuple(varied),), np.zeros(len(starts), np.int64))
        every = [path, *(w for pair in paths for w in pair)]
        rows = np.concatenate([w.outside_of(starts) for w in every], axis=1)  # (r, size (1 + 2 v))
        size = rows.shape[1] // len(every)
        _, index, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        ways = [rows[k].reshape(-1, size) for k in index]
        return Loadings(
            path,
            tuple(_under(problem, g[0], path) for g in ways),
            tuple(
                tuple(
                    Differenced(_under(v.plus, a, path), _under(v.minus, b, path), v.step)
                    for v, a, b in zip(varied, g[1::2], g[2::2], strict=True)
                )
                for g in ways
            ),
            inverse.reshape(-1),
        )

    def everyone(self, *, without: Collection[int] = ()) -> list[Problem]:
        """All problems and neighbours, except the neighbours by the parameters numbered in `without`."""
        varied = [d for v in self.varied for n, d in enumerate(v) if n not in without]
        return [*self.problems, *(q for d in varied for q in (d.plus, d.minus))]

    def at(self, time: Array) -> Integers:
        """Loading numbers (k,) at times (k,) s."""
        return self.of_run[self.path.run(time)]

    def only(self, number: int) -> "Loadings":
        """A single loading for the whole path."""
        return Loadings(
            self.path, (self.problems[number],), (self.varied[number],), np.zeros_like(self.of_run)
        )


def _under(q: Problem, outside: Array, path: Path) -> Problem:
    """The problem under a row (3 + 3 h + c,) of gravity, pulls and shares at the places and chambers of a
    path."""
    row = path.under(outside)
    q = q.under(row["gravity"])
    for place, pull in zip(path.places, row["pulls"], strict=True):
        q = replace(q, dead=spread(q.case, place).added(q.dead, pull)) if pull.any() else q
    return q.with_shares(dict(zip(path.chambers, row["shares"].tolist(), strict=True)))
