"""The genetic algorithm: the reference study's counts and operators, bit-reproducible, resumed bit-equal."""

import json

import numpy as np
import pytest
from pymoo.operators.crossover.sbx import SBX

from calibrate import Parameter, Population
from calibrate.genetic import ArithmeticCrossover, UniformMutation

STUDY = (Parameter("C10", 0.01, 0.5, "MPa"), Parameter("C01", 0.0, 0.5, "MPa"))


def ridge(x: np.ndarray) -> np.ndarray:
    """Costs (m,) that see C10 + C01 well and the share hardly, as the study's two displacements do."""
    return np.sqrt((10 * (x.sum(axis=1) - 0.297)) ** 2 + (0.3 * (x[:, 1] - 0.083)) ** 2)


def run(population: Population, generations: int, cost=ridge) -> list[tuple[np.ndarray, np.ndarray]]:
    records = []
    for _ in range(generations):
        x = population.ask()
        records.append((x, cost(x)))
        population.tell(*records[-1])
    return records


def same(a: list[tuple[np.ndarray, np.ndarray]], b: list[tuple[np.ndarray, np.ndarray]]) -> bool:
    return len(a) == len(b) and all(np.array_equal(p, q) for g, h in zip(a, b) for p, q in zip(g, h))


def test_counts_bounds_and_a_best_that_never_gets_worse() -> None:
    population, best = Population(STUDY, seed=1), []
    for generation in range(20):
        x = population.ask()
        assert x.shape == (30 if generation == 0 else 28, 2)
        assert np.all((x >= [0.01, 0.0]) & (x <= [0.5, 0.5]))
        population.tell(x, ridge(x))
        best.append(population.best[1])
    assert population.evaluations == 30 + 19 * 28
    assert population.generation == 20
    assert np.all(np.diff(best) <= 0)
    assert best[-1] < 0.2 * best[0]
    assert best[-1] == ridge(population.best[0][None])[0]


def test_the_elite_survives_and_nothing_else_of_the_parents() -> None:
    population = Population(STUDY, seed=3)
    (x, cost), (y, _) = run(population, 2)
    survivors = population._algorithm.pop.get("X")
    two = x[np.argsort(cost)[:2]]
    assert np.array_equal(survivors[:2], two)
    assert np.array_equal(survivors[2:], y)


def test_a_seed_fixes_every_bit_whatever_numpy_s_global_state() -> None:
    np.random.seed(0)  # noqa: NPY002 - the global state is what must not matter
    first = run(Population(STUDY, seed=7), 6)
    np.random.seed(99)  # noqa: NPY002
    assert same(first, run(Population(STUDY, seed=7), 6))
    assert not same(first, run(Population(STUDY, seed=8), 6))


def test_killed_after_generation_7_and_replayed_from_json_it_goes_on_bit_equal() -> None:
    whole = run(Population(STUDY, seed=5), 20)
    text = json.dumps([[x.tolist(), cost.tolist()] for x, cost in whole[:7]])
    resumed = Population.replay(STUDY, json.loads(text), seed=5)
    assert resumed.generation == 7
    assert resumed.evaluations == 30 + 6 * 28
    assert same(whole[7:], run(resumed, 13))


def test_a_resume_after_an_ask_without_tell_is_bit_equal_too() -> None:
    whole = run(Population(STUDY, seed=5), 3)
    population = Population.replay(STUDY, whole[:2], seed=5)
    assert np.array_equal(population.ask(), population.ask())
    population.tell(*whole[2])


@pytest.mark.parametrize("change", [{"seed": 6}, {"seed": 5, "mutation": UniformMutation(0.3)}, {"seed": 5, "size": 20}])
def test_records_of_another_run_are_refused(change: dict) -> None:
    records = run(Population(STUDY, seed=5), 3)
    with pytest.raises(ValueError, match="not those asked for"):
        Population.replay(STUDY, records, **change)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_failed_models_rank_last_and_the_search_goes_on(bad: float) -> None:
    population = Population(STUDY, seed=2)

    def failing(x: np.ndarray) -> np.ndarray:
        return np.where(x[:, 0] < 0.15, bad, ridge(x))  # a third of the box cannot be solved

    records = run(population, 20, failing)
    assert population.best[0][0] >= 0.15
    assert population.best[1] < 0.1
    assert np.all(np.isfinite(population._algorithm.pop.get("F")))
    assert np.isfinite(records[-1][1]).mean() > 0.6


def test_arithmetic_crossover_stays_between_the_parents_without_mutation() -> None:
    population = Population(STUDY, seed=4, mutation=UniformMutation(0.0), crossover=ArithmeticCrossover(1.0))
    (x, _), (children, _) = run(population, 2)
    # Whole arithmetic crossover: the two children of a mating have the parents' sum.
    pairs = children.reshape(2, 14, 2).sum(axis=0)
    sums = (x[:, None] + x[None]).reshape(-1, 2)
    distance = np.abs(pairs[:, None] - sums[None]).sum(axis=2).min(axis=1)
    assert np.max(distance) < 1e-12  # rounding of a sum of two numbers below 1
    assert np.all(children.min(axis=0) >= x.min(axis=0))
    assert np.all(children.max(axis=0) <= x.max(axis=0))


def test_mutation_draws_a_fifth_of_the_genes_anew() -> None:
    population = Population(STUDY, size=402, seed=4, crossover=ArithmeticCrossover(0.0))
    (x, _), (children, _) = run(population, 2)
    new = [~np.isin(children[:, k], x[:, k]) for k in range(2)]
    # 800 genes at 0.2: sd of the share 0.014, four of them allowed.
    assert np.mean(new) == pytest.approx(0.2, abs=0.057)
    drawn = children[:, 0][new[0]]
    assert drawn.min() < 0.1  # over the whole range, not around the parent
    assert drawn.max() > 0.4


def test_a_tournament_of_three_prefers_the_cheaper() -> None:
    population = Population(STUDY, size=300, seed=4, crossover=ArithmeticCrossover(0.0), mutation=UniformMutation(0.0))
    (x, cost), (children, _) = run(population, 2)
    rank = {tuple(row): k for k, row in enumerate(x[np.argsort(cost)])}
    mean = np.mean([rank[tuple(row)] for row in children]) / 299
    # The best of three uniform ranks has mean 1/4; 298 draws, sd 0.19 / 17 = 0.011, four of them allowed.
    assert mean == pytest.approx(0.25, abs=0.045)


def test_any_crossover_of_pymoo_serves_and_the_default_is_the_studys() -> None:
    by_name = Population(STUDY, seed=5, crossover=ArithmeticCrossover(0.8), mutation=UniformMutation(0.2))
    whole = run(Population(STUDY, seed=5), 4)
    assert same(whole, run(by_name, 4))
    assert not same(whole, run(Population(STUDY, seed=5, crossover=SBX()), 4))


IMPOSSIBLE = [{"size": 2}, {"elitism": 0}, {"elitism": 30}]


@pytest.mark.parametrize("settings", IMPOSSIBLE)
def test_impossible_settings_are_refused(settings: dict) -> None:
    with pytest.raises(ValueError, match="population:"):
        Population(STUDY, seed=1, **settings)


@pytest.mark.parametrize("operator", [ArithmeticCrossover, UniformMutation])
def test_impossible_probabilities_are_refused(operator: type) -> None:
    for p in (1.2, -1.0):
        with pytest.raises(ValueError, match="wanted a probability"):
            operator(p)


def test_costs_of_the_wrong_number_are_refused() -> None:
    population = Population(STUDY, seed=1)
    with pytest.raises(ValueError, match="30 candidates need 30 costs"):
        population.tell(population.ask(), np.zeros(29))
