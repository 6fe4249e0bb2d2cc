"""Chambers that carry other shares of the pressure in each stretch of a path: as each does alone, with memory,
with derivatives."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Path, Support, Variation, solve
from fe.element import Array

TOP = 0.02  # MPa
TIME = np.arange(6.0)
LOAD = np.array([0.0, TOP, 0.0, TOP, 0.0, TOP])
SHARES = np.repeat([[1.0, 0.0], [0.0, 1.0], [0.5, 1.0]], 2, axis=0)  # two log times each


@pytest.fixture(scope="module")
def case(cube: Callable[..., Case]) -> Case:
    """A bar of 4 x 1 x 1 mm whose top and front are under pressure, each a surface of its own."""
    bar = cube((2, 1, 1), supports=(Support("x0", (0, 1, 2)),), shift=0.03)
    both = np.concatenate([bar.surfaces["z1"], bar.surfaces["y0"]])
    return replace(
        bar, nodes=bar.nodes * [4.0, 1.0, 1.0], surfaces=bar.surfaces | {"both": both}, pressurised="both"
    )


def path(shares: Array = SHARES) -> Path:
    return Path(TIME, LOAD, TIME, chambers=("z1", "y0"), shares=shares)


def test_each_stretch_moves_as_with_its_own_shares_alone(case: Case) -> None:
    every = solve(case, path()).at(case.nodes)
    assert np.abs(every[1]).max() > 0.05
    for k, (top, front) in zip((1, 3, 5), SHARES[::2], strict=True):
        own = solve(replace(case, shares={"z1": top, "y0": front}), Path(TIME, LOAD, TIME)).at(case.nodes)
        np.testing.assert_allclose(every[k], own[k], rtol=0, atol=1e-9)
    one = solve(replace(case, pressurised="z1"), Path(TIME, LOAD, TIME)).at(case.nodes)
    # a face without pressure is a face that nobody loads; its open edges are, so that Newton ends elsewhere
    np.testing.assert_allclose(every[1], one[1], rtol=0, atol=1e-6)


def test_a_chamber_that_nobody_names_keeps_the_share_of_the_deck(case: Case) -> None:
    stated = replace(case, shares={"z1": 1.0, "y0": 0.25})
    one = replace(path(), chambers=("z1",), shares=SHARES[:, :1])
    found = solve(stated, one).at(case.nodes)
    own = solve(replace(case, shares={"z1": 0.0, "y0": 0.25}), Path(TIME, LOAD, TIME)).at(case.nodes)
    np.testing.assert_allclose(found[3], own[3], rtol=0, atol=1e-9)


def test_what_creeps_under_one_chamber_is_left_when_the_other_is_filled(case: Case) -> None:
    """The second stretch goes on from where the first has crept to: not as where the first had no pressure."""
    creeping = case.with_material(prony=((0.3, 2.0),))
    after = path(np.repeat([[1.0, 0.0], [0.0, 1.0]], [3, 3], axis=0))
    quiet = replace(after, pressure=np.where(TIME < 3, 0.0, LOAD))
    first, second = (solve(creeping, one).at(case.nodes) for one in (after, quiet))
    assert np.abs(first[3] - second[3]).max() > 1e-3
    left = first[2]  # without pressure, before the other is filled
    assert (left * first[1]).sum() > 0.5 * np.linalg.norm(left) * np.linalg.norm(first[1])  # its way


@pytest.mark.parametrize("creep", [(), ((0.2, 1.5),)], ids=["elastic", "creeping"])
def test_derivatives_to_a_share_and_a_modulus_agree_with_whole_solves(case: Case, creep: tuple) -> None:  # type: ignore[type-arg]
    base, h = case.with_material(prony=creep), 1e-4

    def carried(x: float) -> tuple[Case, Path]:
        return base, path(SHARES + x * np.array([0.0, 1.0]))

    def stiffer(x: float) -> tuple[Case, Path]:
        return base.with_material(C10=next(iter(base.materials.values())).C10 + x), path()

    sides = [(change(h), change(-h)) for change in (carried, stiffer)]
    found = solve(base, path(), variations=[Variation(*pair, h) for pair in sides]).variations_at(case.nodes)
    for row, (plus, minus) in zip(found, sides, strict=True):
        wanted = (solve(*plus).at(case.nodes) - solve(*minus).at(case.nodes)) / (2 * h)
        assert np.abs(wanted).max() > 0.01
        np.testing.assert_allclose(row, wanted, rtol=0, atol=2e-4 * np.abs(wanted).max())


def test_shares_of_another_number_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shares of shape \(6, 1\): wanted \(2,\)"):
        path(SHARES[:, :1])
