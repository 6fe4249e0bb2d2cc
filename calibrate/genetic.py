"""Genetic algorithm of the reference study: a population within bounds, by ask and tell.

Population 30, elitism 2, tournament selection, arithmetic crossover (0.8 a mating), uniform mutation
(0.2 a gene): 30 + 19 * 28 = 562 evaluations in 20 generations, the best never gets worse. Built on pymoo
(J. Blank and K. Deb, doi:10.1109/ACCESS.2020.2990567), which has neither the crossover nor the elitism.

Pareto front of several misfits: parameters at which none gets smaller without another getting larger. It is
found by NSGA-II (Deb et al. 2002, doi:10.1109/4235.996017) as pymoo has it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymoo.algorithms.soo.nonconvex.ga import GA, FitnessSurvival
from pymoo.core.crossover import Crossover
from pymoo.core.evaluator import Evaluator
from pymoo.core.mutation import Mutation
from pymoo.core.population import Population as Individuals
from pymoo.core.problem import Problem
from pymoo.core.termination import NoTermination
from pymoo.operators.selection.tournament import TournamentSelection
from pymoo.problems.static import StaticProblem

from calibrate.parameters import Array, Parameter, bounds

PENALTY = 1e12  # cost of a model that failed: ranks last, and stays finite (a NaN would win tournaments)
TOURNAMENT = 3
ELITE = 2  # the best that survive unchanged


class ArithmeticCrossover(Crossover):
    """Whole arithmetic crossover: the children a p + (1 - a) q and (1 - a) p + a q of parents p and q.

    a is uniform between 0 and 1, one a mating; prob: probability of a mating. Raises ValueError for none.
    """

    def __init__(self, prob: float = 0.8) -> None:
        super().__init__(2, 2, prob=_probability("crossover", prob))

    def _do(self, problem: Problem, X: Array, *_: Any, random_state: Any = None, **__: Any) -> Array:
        a = random_state.random((X.shape[1], 1))  # one a mating
        children = np.stack([a * X[0] + (1 - a) * X[1], (1 - a) * X[0] + a * X[1]])
        return np.clip(children, problem.xl, problem.xu)  # rounding may leave a bound by one bit


class UniformMutation(Mutation):
    """Uniform mutation: each gene, with the probability prob_gene, is drawn anew between its bounds.

    Raises ValueError for no probability.
    """

    def __init__(self, prob_gene: float = 0.2) -> None:
        super().__init__(prob=1.0)
        self.prob_gene = _probability("mutation", prob_gene)

    def _do(self, problem: Problem, X: Array, *_: Any, random_state: Any = None, **__: Any) -> Array:
        drawn = problem.xl + (problem.xu - problem.xl) * random_state.random(X.shape)
        return np.where(random_state.random(X.shape) < self.prob_gene, drawn, X)


def _probability(name: str, p: float) -> float:
    if not 0 <= p <= 1:
        raise ValueError(f"population: {name} {p}: wanted a probability, 0 .. 1")
    return p


class _Elitist(GA):
    """pymoo's GA with generational replacement: the elite and all offspring survive."""

    def __init__(self, elitism: int, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.elitism = elitism

    pop: Individuals

    def _advance(self, infills: Individuals = None, **_: Any) -> None:
        elite = FitnessSurvival().do(self.problem, self.pop, n_survive=self.elitism)
        self.pop = Individuals.merge(elite, infills)


def _cheapest(individuals: Individuals, rounds: NDArray[np.int64], **_: Any) -> NDArray[np.int64]:
    """Winner (m, 1) of each tournament, rounds (m, TOURNAMENT); a tie goes to the one drawn first."""
    cost = individuals.get("F")[:, 0]
    return rounds[np.arange(len(rounds)), np.argmin(cost[rounds], axis=1)][:, None]


class Population:
    """A population that gives candidates by `ask` and takes their costs by `tell`, once each a generation.

    parameters: names and bounds. size: individuals. seed: all randomness comes from it, whatever the
    state of numpy's global generator. elitism: number of the best that survive unchanged. crossover,
    mutation: any operators of pymoo, such as `pymoo.operators.crossover.sbx.SBX()`; by default those of the
    reference study, `ArithmeticCrossover(0.8)` and `UniformMutation(0.2)`. Raises ValueError for settings
    that make no generation.

    >>> population = Population([Parameter("C10", 0.0, 1.0), Parameter("C01", 0.0, 1.0)], seed=1)
    >>> for generation in range(20):
    ...     x = population.ask()
    ...     population.tell(x, abs(x.sum(axis=1) - 0.3))
    >>> theta, cost = population.best
    >>> population.evaluations, bool(cost < 0.01)
    (562, True)
    """

    def __init__(
        self,
        parameters: Sequence[Parameter],
        *,
        size: int = 30,
        seed: int,
        elitism: int = ELITE,
        crossover: Crossover | None = None,
        mutation: Mutation | None = None,
    ) -> None:
        low, high = bounds(tuple(parameters))
        if not (size >= TOURNAMENT and 1 <= elitism < size):
            raise ValueError(
                f"population: size {size} and elitism {elitism}: wanted size >= {TOURNAMENT} and "
                "1 <= elitism < size"
            )
        self.generation = 0
        self.evaluations = 0
        self.best: tuple[Array, float] | None = None
        self._asked: Individuals = None
        self._problem = Problem(n_var=len(low), n_obj=1, xl=low, xu=high)
        self._algorithm = _Elitist(
            elitism,
            pop_size=size,
            n_offsprings=size - elitism,
            selection=TournamentSelection(func_comp=_cheapest, pressure=TOURNAMENT),
            crossover=crossover or ArithmeticCrossover(),
            mutation=mutation or UniformMutation(),
            eliminate_duplicates=False,
            output=None,
        )
        self._algorithm.setup(self._problem, seed=seed, termination=NoTermination())

    def ask(self) -> Array:
        """Candidates (m, d) of the next generation: all of the first, size - elitism later.

        Asking again before `tell` gives the same candidates.
        """
        if self._asked is None:
            self._asked = self._algorithm.ask()
        return np.array(self._asked.get("X"), float)

    def tell(self, x: Array, cost: Array) -> None:
        """Take the costs (m,) of the candidates x (m, d) last asked for.

        A cost that is not finite (a model that failed) counts as PENALTY. Raises ValueError where x is
        not what `ask` gave, bit for bit, or where the costs are not one a candidate.
        """
        cost = np.asarray(cost, float)
        if not np.array_equal(np.asarray(x, float), self.ask()):
            raise ValueError(
                f"population: the candidates of generation {self.generation + 1} are not those asked for; "
                "another seed, other bounds or other settings made them"
            )
        if cost.shape != (len(x),):
            raise ValueError(f"population: {len(x)} candidates need {len(x)} costs, got shape {cost.shape}")
        cost = np.where(np.isfinite(cost), np.minimum(cost, PENALTY), PENALTY)
        Evaluator().eval(StaticProblem(self._problem, F=cost[:, None]), self._asked)
        self._algorithm.tell(infills=self._asked)
        self._asked = None
        self.generation += 1
        self.evaluations += len(cost)
        k = int(np.argmin(cost))
        if self.best is None or cost[k] < self.best[1]:
            self.best = np.array(x[k], float), float(cost[k])

    @classmethod
    def replay(
        cls, parameters: Sequence[Parameter], records: Iterable[tuple[Array, Array]], **settings: Any
    ) -> "Population":
        """Population at the end of a recorded run, with records (x, cost) of every generation.

        No state is read from a file: the recorded costs go through `ask` and `tell` again, so what follows
        is bit-equal to the run that was never interrupted. settings: those of the run. Raises ValueError
        where the records are not of this seed, these bounds and settings.
        """
        population = cls(parameters, **settings)
        for x, cost in records:
            population.tell(np.asarray(x, float), np.asarray(cost, float))
        return population


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
