"""What is left out is predicted better with a right effect, and no better with a wrong one; a refit takes few
whole solves, and ends where it does by whole solves alone."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case
from twin.diagnosis import refitting
from twin.diagnosis.hypotheses import Hypothesis
from twin.diagnosis.refitting import gain, refitted
from twin.diagnosis.screening import screened
from twin.diagnosis.signatures import signatures_of
from twin.effects.library import effect
from twin.judging.judged import judge
from twin.model.keptmodel import KeptModel, base_model
from twin.targets import Noise, Targets


def test_only_a_right_effect_gains_in_parts_left_out() -> None:
    rng = np.random.default_rng(3)
    fitted = rng.standard_normal((400, 3))
    own, part = np.array([False, False, True]), np.repeat([0, 1], 200)
    right: list[float] = []
    wrong: list[float] = []
    for _ in range(50):
        noise = rng.standard_normal(400)
        for size, out in ((0.5, right), (0.0, wrong)):
            y = noise + size * fitted[:, 2]
            theta = np.linalg.lstsq(fitted, y, rcond=None)[0]
            out.append(gain(y - fitted @ theta, y - fitted @ (theta * ~own), fitted, fitted[:, ~own], part))
    # half a unit in 400 values of variance 1 is a fall of chi2 of about 100
    assert np.mean(np.array(right) > 25) == 1.0
    # each part pays for one parameter fitted to the other: -1 a part, on average
    assert -4 < np.mean(wrong) < 0


def test_a_refit_by_the_response_is_that_by_whole_solves(
    coarsest_case: Case,
    make_targets: Callable[..., Targets],
    make_noise: Callable[..., Noise],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plain, own, sd = make_targets(noise=make_noise(3, sd=0.03, rho=0.0, common=0.0)), effect("creep"), 0.03
    truth = base_model(plain, coarsest_case).with_effect(own)
    u = truth.predict(np.array([0.214, 0.083, 0.15, 2.0]))
    value = u + sd * np.random.default_rng(8).standard_normal(u.shape)
    t = replace(plain, value=value, covariance=np.tile(sd**2 * np.eye(3), (*u.shape[:2], 1, 1)))

    def refit(nearby: float, *, exact: bool = False) -> tuple[Hypothesis, int]:
        monkeypatch.setattr(refitting, "NEARBY", nearby)
        base = judge(base_model(t, coarsest_case), t, starts=np.array([0.2, 0.1]))
        tangents = base.model.tangents(base.theta, [own])
        (h,) = screened(base, signatures_of(base, [own], tangents=tangents))
        found, _ = refitted(h, base, t, seed=0, tangents=tangents, exact=exact)
        whole = base.model.with_effect(own)
        assert isinstance(whole, KeptModel)
        return found, len(whole.kept)

    (whole, many), (near, few) = refit(0.0), refit(0.25)
    assert few < many
    solved, once_more = refit(0.25, exact=True)
    assert once_more == few + 1
    assert solved.score is not None
    assert not solved.score.near
    assert near.score is not None
    assert near.score.near
    assert whole.score is not None
    assert not whole.score.near
    assert whole.fit is not None
    assert near.fit is not None
    assert np.all(np.abs(near.fit.theta - whole.fit.theta) < 0.1 * whole.fit.sd)
    assert near.evidence == pytest.approx(whole.evidence, abs=0.5)
    assert near.refit is not None
    assert isinstance(near.refit.model, KeptModel)  # who goes on from it, goes on by whole solves
