"""A fit under priors and under Student's t: what moves it, what it is judged by, and what is said."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calibrate import Parameter
from calibrate.robust import scale_of
from tests.twin.judging.test_twin_judged import Spring
from twin.judging.fitting import ModelErrors, whitened
from twin.judging.judged import Judged, judge
from twin.judging.likelihood import (
    GROSS,
    SHOWN,
    down_weighted,
    prior_rows,
    priors_of,
    weights_in_words,
    weights_of,
    without_gross,
)
from twin.targets import Array, KnownValue, Noise, Targets

TRUE, SD, STEPS = np.array([0.3, 5.0]), 0.01, 60
GROSS_AT = ((9, 0, 2), (17, 1, 0), (25, 0, 2), (33, 1, 2), (41, 0, 1), (49, 0, 2), (55, 1, 2))  # 2 % of the values


@pytest.fixture
def draw(make_targets: Callable[..., Targets], make_noise: Callable[..., Noise]) -> Callable[..., Targets]:
    """`draw(seed, gross=mm)`: what a spring would be measured as, some values off by so many mm."""
    time = np.linspace(0.0, 9.0, STEPS)
    shape = STEPS, 3, 3
    quiet = make_targets(
        time=time, pressure=0.02 * np.sin(np.pi * time / 9) ** 2, block=np.zeros(STEPS, np.int64), value=np.zeros(shape),
        covariance=np.tile(SD**2 * np.eye(3), (*shape[:2], 1, 1)), valid=np.ones(shape, bool), held_out=np.zeros(STEPS, bool),
        modes=np.zeros((0, *shape)), pressure_sd=np.zeros(STEPS), noise=make_noise(3, sd=SD, rho=0.3, common=0.2),
    )  # fmt: skip

    def drawn(seed: int, *, gross: float = 0.0, **changes: Any) -> Targets:
        rng = np.random.default_rng(seed)
        value = Spring(quiet).predict(TRUE) + SD * rng.standard_normal(shape)
        for at in GROSS_AT:
            value[at] += gross
        return replace(quiet, value=value, **changes)

    return drawn


def test_where_a_model_has_no_equilibrium_a_fit_may_not_go(draw: Callable[..., Targets]) -> None:
    targets = draw(0)
    model = Spring(targets, solvable=0.2)
    derivatives = model.jacobian

    def solved(theta: Array) -> Array:
        model.predict(theta)  # raises where there is no equilibrium, as whole models do
        return derivatives(theta)

    model.jacobian = solved  # type: ignore[method-assign]
    w = ModelErrors.of(model, TRUE, targets).whitener(targets)  # type: ignore[arg-type]
    residual, jacobian, _ = whitened(model, targets, w)  # type: ignore[arg-type]
    z = residual(TRUE)
    assert z is not None
    assert jacobian(TRUE).shape == (len(z), 2)
    beyond = np.array([0.1, 5.0])
    assert residual(beyond) is None
    assert jacobian(beyond).shape == (len(z), 2)
    assert np.isnan(jacobian(beyond)).all()


def judged(t: Targets) -> Judged:
    return judge(Spring(t), t, starts=np.array([0.4, 1.0]), tolerance=1e-3)  # type: ignore[arg-type]


def own_whitener(t: Targets, found: Judged) -> Any:
    return ModelErrors.of(found.model, found.theta, t).whitener(t)


def test_gross_errors_move_least_squares_and_hardly_the_t(draw: Callable[..., Targets]) -> None:
    clean = judged(draw(1))
    sd = clean.fit.sd
    plain, t = judged(draw(1, gross=1.0)), judged(draw(1, gross=1.0, tails=4.0))
    assert np.abs((plain.theta - clean.theta) / sd).max() > 5
    assert np.abs((t.theta - clean.theta) / sd).max() < 0.7
    assert not plain.comparison.adequate
    assert t.comparison.adequate
    assert np.all((t.fit.sd > sd) & (t.fit.sd < 1.4 * sd))  # sqrt(7/5) = 1.18 of normal errors
    # the test leaves out what is gross, and what follows it by the memory of the noise
    left_out = clean.comparison.degrees_of_freedom - t.comparison.degrees_of_freedom
    assert len(GROSS_AT) <= left_out <= 3 * len(GROSS_AT)


def test_what_is_gross_is_named_with_its_weight(draw: Callable[..., Targets]) -> None:
    t = draw(1, gross=1.0, tails=4.0)
    found = judged(t)
    residual, w = t.value - found.predicted, own_whitener(t, found)
    rows = down_weighted(t, residual, w)
    named = {(row.step, t.names.index(row.point), int(row.component[1]) - 1) for row in rows}
    assert set(GROSS_AT) <= named
    assert [row.weight for row in rows] == sorted(row.weight for row in rows)
    assert all(row.weight < 5 / (4 + GROSS**2) for row in rows)
    assert rows[0].weight == np.nanmin(weights_of(t, residual, w))
    text = weights_in_words(t, residual, w)
    assert f"{rows[0].point} {rows[0].component} at {rows[0].time_s:.3g} s (weight {rows[0].weight:.2g})" in text
    scale = scale_of(w.whiten(residual))
    assert 1.0 <= scale < 1.2
    assert f"of {w.count} values lie more than {5 * scale:.2g} sd off the model. They hardly count" in text


def test_a_model_that_does_not_fit_has_a_wide_scale_and_no_gross_errors(draw: Callable[..., Targets]) -> None:
    t = draw(1, tails=4.0)
    off = t.value + 0.5 * np.sin(np.arange(STEPS))[:, None, None]
    found = judged(replace(t, value=off))
    assert not found.comparison.adequate
    text = weights_in_words(replace(t, value=off), off - found.predicted, own_whitener(t, found))
    assert "times as wide as their errors: the model does not fit yet." in text


def test_so_many_gross_values_are_none(draw: Callable[..., Targets]) -> None:
    t = draw(1, tails=4.0)
    found = judged(t)
    residual = t.value - found.predicted + np.where((np.arange(STEPS) % 8 == 0)[:, None, None], 3.0, 0.0)  # in every eighth step
    w = own_whitener(t, found)
    assert "So many are no gross errors: the model does not fit" in weights_in_words(t, residual, w)
    assert len(down_weighted(t, residual, w)) == SHOWN
    assert without_gross(t, residual, w) is t


def test_without_gross_errors_the_t_agrees_within_half_an_sd(draw: Callable[..., Targets]) -> None:
    apart = []
    for seed in range(4):
        clean, t = judged(draw(seed)), judged(draw(seed, tails=4.0))
        apart.append((t.theta - clean.theta) / clean.fit.sd)
        assert t.comparison.degrees_of_freedom == clean.comparison.degrees_of_freedom
    assert np.sqrt(np.mean(np.square(apart))) == pytest.approx(0.28, abs=0.15)  # as in test_calibrate_robust
    t = draw(0, tails=4.0)
    found = judged(t)
    assert "all of them count" in weights_in_words(t, t.value - found.predicted, own_whitener(t, found))
    assert down_weighted(draw(0), t.value - found.predicted, own_whitener(t, found)) == ()


def test_a_prior_moves_the_fit_as_precisions_add_up(draw: Callable[..., Targets]) -> None:
    free = judged(draw(2))
    prior = KnownValue(name="c", mean=float(free.theta[0] + 2 * free.fit.sd[0]), sd=float(free.fit.sd[0]))
    t = draw(2, known=(prior, KnownValue(name="creep.g1", mean=0.1, sd=0.1)))
    found = judged(t)
    assert found.theta[0] == pytest.approx(free.theta[0] + free.fit.sd[0], abs=0.02 * free.fit.sd[0])  # half way
    assert found.fit.sd[0] == pytest.approx(free.fit.sd[0] / np.sqrt(2), rel=0.02)
    assert found.fit.degrees_of_freedom == free.fit.degrees_of_freedom + 1
    (row,) = prior_rows(found.fit, t)  # of the one parameter that the model has
    assert row.by_data == pytest.approx(free.theta[0], abs=0.05 * free.fit.sd[0])
    assert row.moved_sd == pytest.approx(1.0, abs=0.05)
    assert row.apart_sd == pytest.approx(np.sqrt(2), abs=0.07)
    assert row.sentence.startswith("Prior: c = ")
    assert "disagree" not in row.sentence


def test_a_prior_that_contradicts_the_data_is_told(draw: Callable[..., Targets]) -> None:
    free = judged(draw(2))
    sd = float(free.fit.sd[0])
    t = draw(2, known=(KnownValue(name="c", mean=float(free.theta[0]) + 10 * sd, sd=sd),))
    (row,) = prior_rows(judged(t).fit, t)
    assert row.apart_sd == pytest.approx(10 / np.sqrt(2), rel=0.1)
    assert f"Prior and data disagree: they lie {row.apart_sd:.1f} sd" in row.sentence


def test_combinations_have_priors_where_both_constants_are_fitted() -> None:
    both = (Parameter("C10", 0.01, 0.5, "MPa"), Parameter("C01", 0.0, 0.5, "MPa"))
    known = tuple(KnownValue(name=name, mean=0.3, sd=0.1) for name in ("C10", "C10+C01", "share", "clamp.k"))
    t: Any = type("Known", (), {"known": known})
    theta: Array = np.array([0.2, 0.05])
    assert [p.value(theta) for p in priors_of(both, t)] == pytest.approx([-1.0, -0.5, -1.0])
    assert [p.held.name for p in priors_of(both[:1], t)] == ["C10"]
