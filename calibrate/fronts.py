"""Several misfits at once -> the parameters at which none gets smaller without another getting larger.

The front is found by NSGA-II (Deb et al. 2002, doi:10.1109/4235.996017) as pymoo has it (Blank and Deb 2020,
doi:10.1109/ACCESS.2020.2990567).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate.genetic import PENALTY
from calibrate.parameters import Array, Parameter, bounds

SIZE, GENERATIONS = 60, 40
FLAT = 1e-9  # of an objective's size: it does not change along a front


@dataclass(frozen=True, eq=False)
class Front:
    """Points of a Pareto front, by their first objective: theta (n, d) and objectives values (n, m)."""

    theta: Array
    values: Array

    @property
    def knee(self) -> int:
        """Number of the point farthest from the plane through the best of each objective, on the side of the
        origin, with each objective scaled to 0 .. 1 along the front (Das 1999,
        doi:10.1007/s001580050111)."""
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        wide = np.where(high - low > FLAT * np.abs(high), high - low, np.inf)
        return int(((self.values - low) / wide).sum(axis=1).argmin())

    def spread(self, count: int) -> list[int]:
        """Numbers of at most `count` points, evenly along the front, the best of each objective and the knee
        among them."""
        kept = {self.knee, *map(int, self.values.argmin(axis=0))}
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        wide = np.where(high > low, high - low, np.inf)
        x = (self.values - low) / wide
        while len(kept) < min(count, len(x)):  # the point farthest from those that are kept
            apart = np.linalg.norm(x[:, None] - x[sorted(kept)], axis=2).min(axis=1)
            if apart.max() <= 0.0:
                break
            kept.add(int(apart.argmax()))
        return sorted(kept)


def pareto_front(
    objectives: Callable[[Array], Array | None],
    parameters: Sequence[Parameter],
    *,
    starts: Array,
    seed: int,
    size: int = SIZE,
    generations: int = GENERATIONS,
    step: Callable[[], None] = lambda: None,
) -> Front:
    """The front of objectives (m,) of theta (d,), to be made small, within the bounds; None where there are
    none, as for a model that cannot be solved.

    starts (k, d): members of the first generation, such as the best of each objective; the others are drawn.
    seed: all randomness comes from it. step: called after each generation. Raises ValueError where no point
    has objectives.
    """
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.core.termination import NoTermination
    from pymoo.problems.static import StaticProblem

    low, high = bounds(tuple(parameters))
    m = next((len(v) for theta in starts if (v := objectives(theta)) is not None), 0)
    if not m:
        raise ValueError("front: no start has objectives; wanted one at which the model can be solved")
    first = low + (high - low) * np.random.default_rng(seed).random((size, len(low)))
    first[: len(starts)] = np.clip(starts, low, high)[:size]
    problem = Problem(n_var=len(low), n_obj=m, xl=low, xu=high)
    algorithm: Any = NSGA2(pop_size=size, sampling=first)
    algorithm.setup(problem, seed=seed, termination=NoTermination())
    every: list[tuple[Array, Array]] = []
    with np.errstate(all="ignore"):  # crowding of points beside each other divides by nothing
        for _ in range(generations):
            asked = algorithm.ask()
            x = np.array(asked.get("X"), float)
            found = [objectives(theta) for theta in x]
            every += [(theta, v) for theta, v in zip(x, found, strict=True) if v is not None]
            cost = np.array([np.full(m, PENALTY) if v is None else v for v in found])
            Evaluator().eval(StaticProblem(problem, F=cost), asked)
            algorithm.tell(infills=asked)
            step()
    theta, values = np.array([t for t, _ in every]), np.array([v for _, v in every])
    rows = _best(values)
    rows = rows[np.lexsort(values[rows].T[::-1])]
    return Front(theta[rows], values[rows])


def _best(values: Array) -> Any:
    """Numbers (k,) of the rows (n, m) that no other is better than, of equal ones the first."""
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

    _, first = np.unique(values, axis=0, return_index=True)
    first = np.sort(first)
    return first[NonDominatedSorting().do(values[first], only_non_dominated_front=True)]
