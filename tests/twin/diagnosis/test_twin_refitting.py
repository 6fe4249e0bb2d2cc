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
from twin.effects.protocol import Effect
from twin.judging.judged import Judged, judge
from twin.model.keptmodel import KeptModel, base_model
from twin.model.nearmodel import NearModel
from twin.model.prediction import Tangents
from twin.targets import Noise, Targets

pytestmark = pytest.mark.usefixtures("solved_once")


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


SD = 0.03  # mm


def creeping(plain: Targets, case: Case) -> tuple[Targets, Effect]:
    """Targets of a finger that creeps, with noise, and the effect."""
    own = effect("creep")
    u = base_model(plain, case).with_effect(own).predict(np.array([0.214, 0.083, 0.15, 2.0]))
    value = u + SD * np.random.default_rng(8).standard_normal(u.shape)
    return replace(plain, value=value, covariance=np.tile(SD**2 * np.eye(3), (*u.shape[:2], 1, 1))), own


def missing(own: Effect, t: Targets, case: Case) -> tuple[Judged, Tangents, Hypothesis]:
    """The fit of the base model, an effect's tangents there, and the hypothesis that it is missing."""
    base = judge(base_model(t, case), t, starts=np.array([0.2, 0.1]))
    tangents = base.model.tangents(base.theta, [own])
    (h,) = screened(base, signatures_of(base, [own], tangents=tangents))
    return base, tangents, h


def test_a_refit_whose_start_has_no_equilibrium_begins_with_the_constants_of_the_base_fit(
    coarsest_case: Case,
    make_targets: Callable[..., Targets],
    make_noise: Callable[..., Noise],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    t, own = creeping(make_targets(noise=make_noise(3, sd=SD, rho=0.0, common=0.0)), coarsest_case)
    base, tangents, h = missing(own, t, coarsest_case)
    right, _ = refitted(h, base, t, seed=0, tangents=tangents)
    soft = replace(h, start={**h.start, "C10": 0.012, "C01": 0.0})  # carries a tenth of the pressure
    monkeypatch.setattr(refitting, "_foreseen", lambda model, start, *others: dict(start))
    found, judged = refitted(soft, base, t, seed=0, tangents=tangents)
    assert found.note == ""
    assert judged is not None
    assert found.evidence == pytest.approx(right.evidence, abs=2.0)
    assert isinstance(judged.model, NearModel)
    assert judged.model.whole.failures == 1


def test_a_refit_that_ends_above_the_base_model_begins_again_at_its_constants(
    coarsest_case: Case,
    make_targets: Callable[..., Targets],
    make_noise: Callable[..., Noise],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    t, own = creeping(make_targets(noise=make_noise(3, sd=SD, rho=0.0, common=0.0)), coarsest_case)
    base, tangents, h = missing(own, t, coarsest_case)
    stiff = replace(h, start={**h.start, "C10": 0.9, "C01": 0.3})
    monkeypatch.setattr(refitting, "_foreseen", lambda model, start, *others: dict(start))
    monkeypatch.setattr(refitting, "MORE", 0)  # two solves are too few from there
    found, judged = refitted(stiff, base, t, seed=0, tangents=tangents)
    assert judged is not None
    assert judged.deviance < base.deviance
    assert found.evidence is not None
    monkeypatch.setattr(refitting, "_nearer", lambda model, h, *others: model.theta(h.start))
    vain, judged = refitted(stiff, base, t, seed=0, tangents=tangents)
    assert judged is None
    assert vain.note == refitting.IN_VAIN
    assert vain.evidence is None  # a step that was never solved is no evidence


def test_a_refit_by_the_response_is_that_by_whole_solves(
    coarsest_case: Case,
    make_targets: Callable[..., Targets],
    make_noise: Callable[..., Noise],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    t, own = creeping(make_targets(noise=make_noise(3, sd=SD, rho=0.0, common=0.0)), coarsest_case)

    def refit(nearby: float, *, exact: bool = False) -> tuple[Hypothesis, int]:
        monkeypatch.setattr(refitting, "NEARBY", nearby)
        base, tangents, h = missing(own, t, coarsest_case)
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
