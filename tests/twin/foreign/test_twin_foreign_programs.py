"""Somebody's program is asked once for each question, and every answer that is none is refused by its cause."""

from pathlib import Path

import numpy as np
import pytest

from calibrate import Parameter
from tests.messages import says
from twin.effects.protocol import Unsolvable
from twin.foreign.programs import Simulator, Values, Variant, along_curve, simulator
from twin.targets import Array

STIFFNESS = Parameter("k", 1e-4, 1e-2, "MPa/mm", start=1e-3)
PRESSURE = np.array([0.0, 0.01, 0.02])


def spring(values: Values, pressure: Array) -> Array:
    """One point that moves down in proportion to the pressure, mm."""
    return pressure[:, None, None] / values["k"] * np.array([0.0, 0.0, -1.0])


def asked(program: Simulator, pressure: Array = PRESSURE) -> Array:
    return program.at({"k": 1e-3}, pressure, PRESSURE, 1)


def test_a_run_is_made_once_and_kept_in_a_folder(tmp_path: Path) -> None:
    calls: list[float] = []

    def counted(values: Values, pressure: Array) -> Array:
        calls.append(values["k"])
        return spring(values, pressure)

    for _ in range(2):  # as after a program that was stopped
        program = simulator(counted, [STIFFNESS], keep=tmp_path / "runs")
        np.testing.assert_array_equal(asked(program), asked(program))
        asked(program, 1.1 * PRESSURE)
        program.at({"k": 2e-3}, PRESSURE, PRESSURE, 1)
    assert calls == [1e-3, 1e-3, 2e-3]


def test_what_it_is_given_cannot_be_changed_by_it() -> None:
    def rude(values: dict[str, float], pressure: Array) -> Array:
        values["k"] *= 2
        pressure += 1.0
        return np.zeros((3, 1, 3))

    values, pressure = {"k": 1e-3}, PRESSURE.copy()
    simulator(rude, [STIFFNESS]).at(values, pressure, PRESSURE, 1)
    assert values == {"k": 1e-3}
    np.testing.assert_array_equal(pressure, PRESSURE)


def test_without_pressures_an_answer_is_a_curve_over_the_pressure() -> None:
    program = simulator(lambda values: spring(values, PRESSURE), [STIFFNESS])
    assert not program.takes_pressure
    np.testing.assert_allclose(asked(program)[:, 0, 2], [0.0, -10.0, -20.0])
    np.testing.assert_allclose(asked(program, np.array([0.005, 0.015, 0.03]))[:, 0, 2], [-5.0, -15.0, -30.0])
    branches = np.array([0.0, 5.0, 9.0, 7.0])[:, None, None] * np.ones(3)  # 5 up and 7 down at one pressure
    up_down = np.array([0.0, 0.01, 0.02, 0.01])
    np.testing.assert_allclose(along_curve(branches, up_down, up_down)[:, 0, 0], [0.0, 6.0, 9.0, 6.0])
    kept = simulator(lambda values: branches, [STIFFNESS]).at({"k": 1e-3}, up_down, up_down, 1)
    np.testing.assert_allclose(kept, branches)  # where the pressure is that of the data, its answer as it is


@pytest.mark.parametrize(
    ("answer", "error", "words"),
    [
        (lambda v, p: 1 / 0, Unsolvable, ("failed at k = 0.001", "ZeroDivisionError")),
        (lambda v, p: np.full((3, 1, 3), np.nan), Unsolvable, ("nan at step 0", "k = 0.001")),
        (lambda v, p: np.zeros((3, 2, 3)), ValueError, ("(3, 2, 3)", "wanted (3, 1, 3)")),
        (lambda v, p: "far", ValueError, ("gave str", "(3, 1, 3)")),
        (lambda: 0, ValueError, ("takes 0 arguments", "predict(values, pressure)")),
    ],
)  # fmt: skip
def test_what_is_no_answer_is_refused(answer: object, error: type[Exception], words: tuple[str, ...]) -> None:
    with pytest.raises(error) as raised:
        asked(simulator(answer, [STIFFNESS]))  # type: ignore[arg-type]
    says(str(raised.value), *words)


def test_answers_that_scatter_are_found_by_two_runs() -> None:
    rng = np.random.default_rng(3)
    noisy = simulator(lambda v, p: spring(v, p) + 0.1 * rng.standard_normal((len(p), 1, 3)), [STIFFNESS])
    pressure = np.linspace(0, 0.02, 400)
    assert noisy.scatter({"k": 1e-3}, pressure, 1) == pytest.approx(0.1, rel=0.1)  # of 1200 values: 2 %
    assert simulator(spring, [STIFFNESS]).scatter({"k": 1e-3}, pressure, 1) == 0.0


def test_a_variant_wants_a_value_at_which_it_is_absent() -> None:
    with pytest.raises(ValueError, match=r"variant taper: no null; wanted .* null=0.0"):
        Variant(Parameter("taper", -1.0, 1.0))
    with pytest.raises(ValueError, match="'Taper': wanted a name of small letters"):
        Variant(Parameter("Taper", -1.0, 1.0, null=0.0))
    with pytest.raises(ValueError, match="each with a name of its own"):
        simulator(spring, [STIFFNESS], variants=[Variant(Parameter("k", -1.0, 1.0, null=0.0))])
