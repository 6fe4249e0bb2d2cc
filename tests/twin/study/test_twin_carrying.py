"""What of a test a model carries: a limit point is a finding, and held-out blocks hold no fit."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fe import Case
from tests.twin.conftest import plain_targets
from twin.bench.workbench import as_far_as_it_carries
from twin.calibrated.problem import CalibrationProblem, Carried
from twin.effects.material import Elasticity
from twin.effects.protocol import Unsolvable
from twin.model.loadpaths import LoadPaths, Turned
from twin.model.structure import Structure
from twin.study.carrying import carried, in_words
from twin.study.loadpathfit import OnPaths
from twin.targets import Array

LIMIT, SCALE = 0.1, 0.2  # reduced pressure of the paths' limit point; scale of the truth in MPa
WAY = np.array([[-0.3, 0.0, -1.0], [-0.1, 0.0, -0.4]])  # of tip and middle


@dataclass(frozen=True)
class Bench(CalibrationProblem):
    """A workbench without a folder."""

    project: Any = None


def bends(q: Array) -> Array:
    """Displacements (s, 2, 3) mm at reduced pressures (s,): steeper and steeper towards the limit point."""
    return (200 * q + 20 * (1 - np.sqrt(1 - np.minimum(q / LIMIT, 1))))[:, None, None] * WAY


def on_paths(case: Case, top: float, *, further: float = 0.0, held_out: bool = False) -> OnPaths:
    """A test up to `top` MPa whose motion goes straight on beyond `further` of the limit, by a model that
    ends there."""
    pressure = np.array([0.0, *np.linspace(0.2, 1.0, 8) * (0.5 if held_out else 1.0) * top, 0.0, top])
    q = pressure / SCALE
    stop = further * LIMIT if further else np.inf
    u = bends(np.minimum(q, stop)) + (np.maximum(q - stop, 0.0) * 300)[:, None, None] * WAY
    time, s = np.arange(11.0), 11
    value = np.zeros((s, 3, 3))
    value[:, :2] = u
    t = plain_targets(
        time=time, pressure=pressure, log_time=time, log_pressure=pressure, value=value,
        block=np.repeat([0, 1], [9, 2]), held_out=np.repeat([False, held_out], [9, 2]),
        covariance=np.tile(1e-4 * np.eye(3), (s, 3, 1, 1)), valid=np.ones((s, 3, 3), bool),
        modes=np.zeros((0, s, 3, 3)), reference=np.array([0]), pressure_sd=np.zeros(s),
    )  # fmt: skip
    reduced = LIMIT * np.linspace(0, 1, 60) ** 0.7
    path = LoadPaths((np.array([0.3]),), ((-1.0, 1.0),), reduced, bends(reduced)[None], np.array([LIMIT]))
    config = SimpleNamespace(objective_points=("tip", "middle"), objective_component=3)
    project = SimpleNamespace(config=SimpleNamespace(calibrate=config, objective_points=("tip", "middle")))
    bench = Bench(t, Structure(case, "", {}, case.face_nodes("outside")), Elasticity(fixed={"C01": 0.06}), project=project)
    return OnPaths.on(bench, Turned((path,), np.zeros(s, np.int64)))  # type: ignore[arg-type]


def test_what_a_right_model_carries_is_all_fitted_however_near_its_limit_point(short_case: Case) -> None:
    assert carried(on_paths(short_case, 0.6 * LIMIT * SCALE)) is None
    assert carried(on_paths(short_case, 0.97 * LIMIT * SCALE)) is None  # held by the limit, and right


def test_where_the_model_balloons_and_the_finger_does_not_the_lower_pressures_are_fitted(short_case: Case) -> None:
    on = on_paths(short_case, 1.5 * LIMIT * SCALE, further=0.8)
    most = carried(on)
    assert most is not None
    assert 0.4 * LIMIT * SCALE < most.fitted < LIMIT * SCALE
    targets = on.bench.targets.carried(most.fitted, most.held_out)
    assert targets.pressure.max() <= most.fitted
    assert not targets.valid[on.bench.targets.pressure > most.fitted].any()
    assert targets.valid[on.bench.targets.pressure <= most.fitted].all()


def test_a_held_out_block_that_the_model_cannot_carry_holds_no_fit(short_case: Case) -> None:
    on = on_paths(short_case, 1.2 * LIMIT * SCALE, held_out=True)
    most = carried(on)
    assert most is not None
    assert most.fitted == pytest.approx(0.6 * LIMIT * SCALE)  # all that is fitted
    assert most.fitted < most.held_out < LIMIT * SCALE


def test_after_a_pressure_that_is_not_carried_a_memory_has_no_data() -> None:
    t = plain_targets()  # up to 20 kPa from 2 s on, down to 4 kPa at 7 s
    cut = t.carried(0.015, 0.015)
    assert cut.valid[t.time <= 1.0].all()
    assert not cut.valid[t.time >= 2.0].any()
    without = replace(t, log_time=t.time, log_pressure=t.pressure).carried(0.015, 0.015)
    assert without.valid[t.time >= 7.0].all()
    assert not without.valid[t.time == 6.0].any()
    assert cut.log_pressure.max() == cut.pressure.max() == 0.015


def test_a_solve_that_comes_less_far_is_asked_for_less() -> None:
    asked = list[Carried | None]()

    def fitted(bench: Bench) -> str:
        asked.append(bench.carried)
        if bench.targets.pressure.max() > 0.012:
            raise Unsolvable("stopped at 0.0125 MPa of 0.02", reached=0.0125)
        return "fitted"

    bench = Bench(plain_targets(), None, Elasticity())  # type: ignore[arg-type]
    assert as_far_as_it_carries(bench, fitted) == "fitted"  # type: ignore[type-var, arg-type]
    assert asked == [None, Carried(0.95 * 0.0125, 0.95 * 0.0125)]
    with pytest.raises(ValueError, match="no stable rubber; wanted constants"):
        as_far_as_it_carries(bench, lambda b: (_ for _ in ()).throw(Unsolvable("no stable rubber")))  # type: ignore[arg-type]


def test_fits_that_each_stop_a_little_lower_are_asked_for_less_and_less() -> None:
    asked = list[float]()

    def fitted(bench: Bench) -> str:
        asked.append(bench.targets.pressure.max())
        if len(asked) < 6:  # near a limit point, which constants that fit better have lower
            raise Unsolvable("limit point", reached=0.99 * asked[-1])
        return "fitted"

    assert as_far_as_it_carries(Bench(plain_targets(), None, Elasticity()), fitted) == "fitted"  # type: ignore[arg-type, type-var]
    assert np.all(np.diff(asked) <= 0)
    assert asked[-1] < 0.5 * asked[0]

    def never(bench: Bench) -> str:
        raise Unsolvable("limit point", reached=1e-4 * bench.targets.pressure.max())

    with pytest.raises(ValueError, match="limit point; wanted constants"):  # not a fit of no data
        as_far_as_it_carries(Bench(plain_targets(), None, Elasticity()), never)  # type: ignore[arg-type, type-var]


def test_steps_to_few_pressures_have_no_level_without_data(short_case: Case) -> None:
    on = on_paths(short_case, 1.5 * LIMIT * SCALE, further=0.8)
    t = on.bench.targets
    few = replace(t, valid=t.valid & (t.pressure >= 0.9 * t.pressure.max())[:, None, None])
    assert carried(OnPaths.on(replace(on.bench, targets=few), on.paths)) is None


def test_a_search_that_ends_too_stiff_is_mended_by_the_scale_that_fits_best(short_case: Case) -> None:
    on = on_paths(short_case, 0.9 * LIMIT * SCALE)
    stiff = np.array([0.5])
    starts = on.starts(stiff)
    assert starts.shape == (3, 1)
    assert on.unweighted(starts).theta[0] == pytest.approx(SCALE - 0.06, rel=1e-3)
    assert min(abs(starts[:, 0] - (SCALE - 0.06))) < 0.03
    assert len(on.starts(on.unweighted(starts).theta)) == 2  # nothing fits better


def test_the_sentence_has_the_pressures_of_the_test() -> None:
    told = in_words(0.0441, 0.045, 0.0405)
    for words in ("carries at most 44.1 kPa", "goes to 45 kPa", "up to 40.5 kPa"):
        assert words in told
    assert "at most" not in in_words(0.045, 0.045, 0.012)  # as it carries all, that is no limit
    assert "up to 12 kPa of 45 kPa" in in_words(0.045, 0.045, 0.012)
