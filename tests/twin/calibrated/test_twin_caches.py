"""A project's cache: what was made is served and not made again, and finer meshes serve for constants nearby."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from twin.calibrated import problem as problem_module
from twin.calibrated.caches import FolderCache, SolvedList, Store
from twin.calibrated.problem import CalibrationProblem
from twin.effects.material import Elasticity
from twin.laws.mooneyrivlin import NOMINAL, mooney_rivlin
from twin.messages import Say
from twin.model.discretisation import Discretisation, SolvedAt
from twin.model.structure import BuiltIn, of_finger
from twin.targets import Array, Noise, Targets


def logged(log: Path, value: float) -> Array:
    """An array, and a line in a file for every time it is made."""
    with log.open("a", encoding="utf-8") as file:
        file.write(f"{value}\n")
    return np.full(2, value)


def test_an_array_is_made_once(tmp_path: Path, say: Say) -> None:
    cache, log = FolderCache(tmp_path / "cache", say), tmp_path / "log"
    first = cache("stage", {"a": partial(logged, log, 1.0), "b": partial(logged, log, 2.0)})
    again = cache("stage", {"b": partial(logged, log, 9.0), "c": partial(logged, log, 3.0)})
    np.testing.assert_array_equal([first["a"], first["b"], again["b"], again["c"]], [[1, 1], [2, 2], [2, 2], [3, 3]])
    assert sorted(log.read_text().split()) == ["1.0", "2.0", "3.0"]


def test_finer_meshes_serve_where_they_reach(tmp_path: Path) -> None:
    solved = SolvedList(tmp_path / "solved.json")
    assert solved.serving(mooney_rivlin(0.2, 0.1), 0.02, low=0.7, high=1.15) is None
    first, second = SolvedAt(mooney_rivlin(0.2, 0.1), 0.024), SolvedAt(mooney_rivlin(0.2, 0.1), 0.04)
    for one in (first, second, first):
        solved.add(one)
    assert solved.known == [first, second]
    serving = partial(solved.serving, low=0.7, high=1.15)
    assert serving(mooney_rivlin(0.2, 0.1), 0.0203) == first  # another log of the same pressure
    assert serving(mooney_rivlin(0.2, 0.1), 0.03) == second
    assert serving(mooney_rivlin(0.2, 0.1), 0.05) is None  # none reaches as far
    assert serving(mooney_rivlin(0.18, 0.09), 0.0225) == second  # softer: at 1.11 times the pressure
    assert serving(mooney_rivlin(0.5, 0.1), 0.02) is None


def test_a_list_from_before_there_were_laws_is_read(tmp_path: Path) -> None:
    file = tmp_path / "solved.json"
    file.write_text('[{"C10": 0.2, "C01": 0.1, "top_MPa": 0.03}]')
    assert SolvedList(file).known == [SolvedAt(mooney_rivlin(0.2, 0.1), 0.03)]
    file.write_text('[{"values": {"C10": 0.2}, "top_MPa": 0.03}]')
    with pytest.raises(ValueError, match=r"C01 is not among the constants {'C10': 0.2}.*remove the file"):
        list(SolvedList(file).known)


@pytest.fixture(params=[True, False], ids=["folder", "memory"])
def bench(
    request: pytest.FixtureRequest, short_builtin: BuiltIn, make_targets: Callable[..., Targets], make_noise: Callable[..., Noise], tmp_path: Path
) -> CalibrationProblem:
    targets = make_targets(noise=make_noise(3, sd=0.01, rho=0.0, common=0.0))
    structure = of_finger(short_builtin.finger, short_builtin.lattice)
    return CalibrationProblem(targets, structure, Elasticity(), store=Store(tmp_path if request.param else None))


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[SolvedAt]:
    """Where the finer meshes were solved; beyond 0.028 MPa they have no equilibrium."""
    found: list[SolvedAt] = []

    def solved(*_: object, solved_at: SolvedAt, **__: object) -> Discretisation:
        if solved_at.top > 0.028:
            raise ValueError("no equilibrium")
        found.append(solved_at)
        return Discretisation.none("not solved here")

    monkeypatch.setattr(problem_module, "discretisation_error", solved)
    return found


def test_constants_without_an_equilibrium_never_serve(bench: CalibrationProblem, made: list[SolvedAt], say: Say) -> None:
    with pytest.raises(ValueError, match="no equilibrium"):
        bench.mesh(np.array([0.2, 0.04]), bench.model(()), say)
    for C10 in (0.22, 0.2, 0.3, 0.7):  # the first has 1.08, 0.76 and 0.35 of the others' C10 + C01
        bench.mesh(np.array([C10, 0.04]), bench.model(()), say)
    assert {one.constants for one in made} == {NOMINAL}
    # of less pressure over C10 + C01 the last asks for so little that the first would be too coarse
    assert [one.top for one in made] == pytest.approx([0.027, 0.027, 0.027, 0.0094])


def test_a_new_log_of_the_same_pressure_is_served(bench: CalibrationProblem, made: list[SolvedAt], say: Say) -> None:
    theta = np.array([0.22, 0.04])
    for factor in (1.0, 1.004, 0.996, 0.5):
        t = replace(bench.targets, log_pressure=factor * bench.targets.log_pressure)
        other = replace(bench, targets=t)
        other.mesh(theta, other.model(()), say)
    assert made[0] == made[1] == made[2] != made[3]
    assert made[3].top < 0.6 * made[0].top
    heavy = replace(bench, structure=replace(bench.structure, key="another"))
    heavy.mesh(1.05 * theta, heavy.model(()), say)
    # what served another structure does not serve this
    assert made[4].top == pytest.approx(made[0].top / 1.05, abs=1e-3)
    assert made[4] != made[0]
