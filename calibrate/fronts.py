"""Pareto front of several misfits: parameters at which none gets smaller without another getting larger.

It is found by NSGA-II (Deb et al. 2002, doi:10.1109/4235.996017) as pymoo has it (Blank and Deb 2020,
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
    """Points of a Pareto front in order of their first objective: theta (n, d), objectives values (n, m).

    >>> import numpy as np
    >>> values = np.array([[0.0, 1.0], [0.1, 0.3], [1.0, 0.0]])
    >>> Front(values, values).knee
    1
    """

    theta: Array
    values: Array

    @property
    def knee(self) -> int:
        """Index of the knee: the point farthest below the plane through the best of each objective.

        Each objective is scaled to 0 .. 1 along the front (Das 1999, doi:10.1007/s001580050111).
        """
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        wide = np.where(high - low > FLAT * np.abs(high), high - low, np.inf)
        return int(((self.values - low) / wide).sum(axis=1).argmin())

    def spread(self, count: int) -> list[int]:
        """Indices of at most `count` points, evenly along the front, with the knee and the best of each
        objective."""
        indices = {self.knee, *map(int, self.values.argmin(axis=0))}
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        wide = np.where(high > low, high - low, np.inf)
        x = (self.values - low) / wide
        while len(indices) < min(count, len(x)):  # the point farthest from the chosen ones
            apart = np.linalg.norm(x[:, None] - x[sorted(indices)], axis=2).min(axis=1)
            if apart.max() <= 0.0:
                break
            indices.add(int(apart.argmax()))
        return sorted(indices)


def pareto_front(
    objectives: Callable[[Array], Array | None],
    parameters: Sequence[Parameter],
    *,
    starts: Array,
    seed: int,
    size: int = SIZE,
    generations: int = GENERATIONS,
    step: Callable[[], None] = lambda: None,
    **operators: Any,
) -> Front:
    """Pareto front, within the bounds, of objectives to be minimised.

    objectives: theta (d,) -> (m,), None for a model that cannot be solved. starts (k, d): members of the
    first generation, such as the best of each objective; the others are drawn. seed: all randomness comes
    from it. step: called after each generation. operators: `crossover`, `mutation`, `selection` of pymoo in
    place of those of its NSGA2. Raises ValueError where no point has objectives.

    >>> import numpy as np
    >>> front = pareto_front(lambda x: np.array([x[0] ** 2, (x[0] - 1) ** 2]), [Parameter("x", -2.0, 2.0)],
    ...                      starts=np.array([[0.0], [1.0]]), seed=1, size=20, generations=10)
    >>> front.theta.min() >= 0, front.theta.max() <= 1, front.theta[front.knee, 0].round(1)
    (np.True_, np.True_, np.float64(0.5))
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
    sampling = low + (high - low) * np.random.default_rng(seed).random((size, len(low)))
    sampling[: len(starts)] = np.clip(starts, low, high)[:size]
    problem = Problem(n_var=len(low), n_obj=m, xl=low, xu=high)
    algorithm: Any = NSGA2(pop_size=size, sampling=sampling, **operators)
    algorithm.setup(problem, seed=seed, termination=NoTermination())
    every: list[tuple[Array, Array]] = []
    with np.errstate(all="ignore"):  # crowding of points beside each other divides by nothing
        for _ in range(generations):
            infills = algorithm.ask()
            x = np.array(infills.get("X"), float)
            rows = [objectives(theta) for theta in x]
            every += [(theta, v) for theta, v in zip(x, rows, strict=True) if v is not None]
            cost = np.array([np.full(m, PENALTY) if v is None else v for v in rows])
            Evaluator().eval(StaticProblem(problem, F=cost), infills)
            algorithm.tell(infills=infills)
            step()
    theta, values = np.array([t for t, _ in every]), np.array([v for _, v in every])
    rows = _best(values)
    rows = rows[np.lexsort(values[rows].T[::-1])]
    return Front(theta[rows], values[rows])


def _best(values: Array) -> Any:
    """Indices (k,) of the non-dominated rows of values (n, m), without duplicates."""
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

    _, index = np.unique(values, axis=0, return_index=True)
    index = np.sort(index)
    return index[NonDominatedSorting().do(values[index], only_non_dominated_front=True)]
