"""A fit along a response ends where the fit by whole solves does, and is solved there."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fe import Case
from twin.effects.library import effect
from twin.judging.fitting import noise_of
from twin.judging.judged import Judged, judge
from twin.judging.nearfit import EXACT, fitted_near
from twin.model.keptmodel import KeptModel, base_model
from twin.model.nearmodel import NearModel
from twin.targets import Array, Noise, Targets


def test_the_end_of_a_fit_along_a_response_is_solved_and_that_of_whole_solves(
    coarsest_case: Case, make_targets: Callable[..., Targets], make_noise: Callable[..., Noise]
) -> None:
    plain, sd = make_targets(noise=make_noise(3, sd=0.001, rho=0.0, common=0.0)), 0.001
    own, at = effect("stiffening"), np.array([0.2, 0.1])
    base = base_model(plain, coarsest_case)
    u = base.with_effect(own).predict(np.array([0.19, 0.11, 0.02]))
    value = u + sd * np.random.default_rng(8).standard_normal(u.shape)
    t = replace(plain, value=value, covariance=np.tile(sd**2 * np.eye(3), (*u.shape[:2], 1, 1)))
    tangents = {label: [0.8 * x for x in each] for label, each in base.tangents(at, [own]).items()}  # wrong
    whole = KeptModel(base.test, (*base.effects, own), base.reference, parent=base)
    near = NearModel.of(whole, base, at, tangents, limit_mm=0.5 * sd)

    def fit(model: NearModel, start: Array) -> Judged:
        return judge(model, t, starts=start)

    start = np.array([*at, 0.0])
    found = fitted_near(near, t, fit, start)
    wanted = judge(base.with_effect(own), t, starts=start)
    assert found.model is whole
    assert np.all(np.abs(found.theta - wanted.theta) < 0.1 * wanted.fit.sd)
    assert np.all(np.abs(found.fit.sd / wanted.fit.sd - 1) < 0.02)
    assert whole.kept[-1].jacobian is not None
    off = (found.predicted - whole.predict(found.theta))[:, whole.test.moving]
    assert float(np.sqrt((off**2).mean())) < EXACT * noise_of(t, found.errors.gauge)
