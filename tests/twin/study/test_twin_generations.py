"""The genetic algorithm's stage: resumed bit for bit, infeasible candidates last, the study's objective."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying
from twin.effects.material import Elasticity
from twin.laws.mooneyrivlin import mooney_rivlin
from twin.model.loadpaths import LoadPaths, Turned
from twin.project.folder import Run
from twin.study.generations import Generation, Objective, first_arrival, search
from twin.targets import Targets

PARAMETERS = Elasticity().parameters


def nothing(stage: str, done: int, total: int) -> None:
    del stage, done, total


def bowl(values: dict[str, float]) -> float:
    """A cost with its best at (0.2, 0.1), and no equilibrium where C10 is large."""
    if values["C10"] > 0.3:
        return float("inf")
    return float(np.hypot(values["C10"] - 0.2, values["C01"] - 0.1)) * 100


def searched(
    folder: Path, cost: Callable[[dict[str, float]], float], *, seed: int = 1
) -> list[Generation]:
    folder.mkdir(exist_ok=True)
    return search(PARAMETERS, cost, Run(folder, False), seed=seed, size=12, generations=9, tell=nothing)


def test_a_killed_search_resumes_bit_for_bit(tmp_path: Path) -> None:
    whole = searched(tmp_path / "whole", bowl)
    calls = 0

    def killed(values: dict[str, float]) -> float:
        nonlocal calls
        calls += 1
        if calls > 12 + 4 * 10 + 3:  # in the sixth generation: two of twelve survive without a call
            raise KeyboardInterrupt
        return bowl(values)

    with pytest.raises(KeyboardInterrupt):
        searched(tmp_path / "cut", killed)
    assert len(Run(tmp_path / "cut", True).log()) == 5
    again: list[dict[str, float]] = []

    def counted(values: dict[str, float]) -> float:
        again.append(values)
        return bowl(values)

    resumed = searched(tmp_path / "cut", counted)
    assert len(again) == 4 * 10  # only the generations that were not recorded
    assert [g.number for g in resumed] == list(range(1, 10))
    for a, b in zip(whole, resumed, strict=True):
        np.testing.assert_array_equal(a.candidates, b.candidates)
        np.testing.assert_array_equal(a.costs, b.costs)
        np.testing.assert_array_equal(a.best, b.best)
        assert a.rms_mm == b.rms_mm
    assert (tmp_path / "cut" / "log.jsonl").read_bytes() == (tmp_path / "whole" / "log.jsonl").read_bytes()


def test_what_cannot_be_solved_is_logged_and_never_best(tmp_path: Path) -> None:
    found = searched(tmp_path / "run", bowl, seed=4)
    first = found[0]
    assert np.isinf(first.costs).any()  # else this test would see nothing
    costs = [c for r in Run(tmp_path / "run", True).log() for c in r["costs"]]
    assert costs.count(None) == sum(int(np.isinf(g.costs).sum()) for g in found)
    assert all(np.isfinite(g.rms_mm) for g in found)
    best = [g.rms_mm for g in found]
    assert best == sorted(best, reverse=True)
    assert best[-1] == min(c for c in costs if c is not None)
    # ranked last: hardly any child stands where its parents could not
    later = np.concatenate([g.costs for g in found[3:]])
    assert np.isinf(later).mean() < 0.5 * max(np.isinf(first.costs).mean(), 0.1)


def test_a_search_without_any_equilibrium_ends(tmp_path: Path) -> None:
    found = searched(tmp_path / "run", lambda values: float("inf"))
    assert len(found) == 9
    assert np.isinf(found[-1].rms_mm)


@pytest.fixture
def paths() -> Turned:
    """Two points whose U3 is -100 and -40 mm per unit of p / C, reached up to 0.2."""
    reduced = np.linspace(0.0, 0.3, 11)
    u = np.zeros((3, 11, 2, 3))
    u[:, :, 0, 2], u[:, :, 1, 2] = -100 * reduced, -40 * reduced
    return Turned((LoadPaths((np.array([0.1, 0.5, 0.9]),), ((0.0, 1.0),), reduced, u, np.full(3, 0.2)),), np.zeros(8, int))


def test_the_objective_is_the_rms_at_the_first_arrival(
    paths: Turned, make_targets: Callable[..., Targets]
) -> None:
    t = make_targets()
    assert first_arrival(t) == 3  # the top of the ramp, at 2 s; it is held until 6 s
    value = t.value.copy()
    value[3, :2, 2] = [-7.0, -2.0]
    value[4, :2, 2] = [-99.0, -99.0]  # later: not looked at
    objective = Objective.of(replace(t, value=value), ("tip", "middle"), 2)
    cost = objective.cost(mooney_rivlin(0.2, 0.05), paths, np.array([0, 1]))
    # p / C = 0.02 / 0.25 = 0.08: -8 and -3.2 mm against -7 and -2
    assert cost == pytest.approx(np.sqrt((1.0**2 + 1.2**2) / 2), rel=1e-9)
    assert objective.cost(mooney_rivlin(0.05, 0.04), paths, np.array([0, 1])) == np.inf


def test_points_that_move_along_another_axis_are_not_searched_by_their_noise(
    make_targets: Callable[..., Targets],
) -> None:
    t = make_targets()
    value = t.value.copy()
    value[3, :2] = [[0.1, -1.1, 0.02], [0.0, -0.4, -0.01]]  # sds are 0.01 mm
    aside = replace(t, value=value)
    with pytest.raises(ValueError, match=saying("U3", "U2", "objective_component = 2")):
        Objective.of(aside, ("tip", "middle"), 2)
    assert Objective.of(aside, ("tip", "middle"), 1).component == 1
    value[3, :2, 2] = [0.2, 0.1]  # little beside the other, and seen well
    assert Objective.of(replace(t, value=value), ("tip", "middle"), 2).component == 2


def test_a_point_that_is_not_seen_then_is_named(make_targets: Callable[..., Targets]) -> None:
    t = make_targets()
    value, valid = t.value.copy(), t.valid.copy()
    value[3, 1, 2], valid[3, 1, 2] = np.nan, False
    lost = replace(t, value=value, valid=valid)
    with pytest.raises(ValueError, match=saying("'middle'", "U3", "3", "objective_points")):
        Objective.of(lost, ("tip", "middle"), 2)
    assert Objective.of(lost, ("tip",), 2).rows.tolist() == [0]


def test_without_pressure_the_search_looks_at_the_step_that_moves_most(make_targets: Callable[..., Targets]) -> None:
    value = np.zeros((8, 3, 3))
    value[4:6, :2, 2] = [[-1.0, -0.4], [-3.0, -1.0]]
    t = make_targets(pressure=np.zeros(8), log_pressure=np.zeros(181), value=value)
    assert first_arrival(t) == 5
    with pytest.raises(ValueError, match="no value is fitted"):
        first_arrival(replace(t, valid=np.zeros((8, 3, 3), bool)))
