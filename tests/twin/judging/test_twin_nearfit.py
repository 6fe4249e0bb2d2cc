"""A fit along a response ends where the fit by whole solves does, next to a solve."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from calibrate import Fit
from calibrate.parameters import Parameter
from fe import Case
from twin.effects.library import effect
from twin.judging import nearfit
from twin.judging.fitting import fit_unweighted, noise_of
from twin.judging.judged import SETTLED, judge, judge_base
from twin.model.keptmodel import KeptModel, base_model
from twin.model.nearmodel import NearModel
from twin.model.prediction import Model
from twin.targets import Array, Noise, Targets

pytestmark = pytest.mark.usefixtures("solved_once")


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

    start = np.array([*at, 0.0])
    found = nearfit.fitted_near(near, t, start)
    wanted = judge(base.with_effect(own), t, starts=start)
    assert np.all(np.abs(found.theta - wanted.theta) < 0.1 * wanted.fit.sd)
    assert np.all(np.abs(found.fit.sd / wanted.fit.sd - 1) < 0.02)
    assert whole.kept[-1].jacobian is not None
    off = (found.predicted - whole.predict(found.theta))[:, whole.test.moving]
    assert float(np.sqrt((off**2).mean())) < 0.02 * noise_of(t, found.errors.gauge)  # of the demo 0.8 um


@dataclass(frozen=True)
class End:
    """A judged fit, of which a fit along a response asks where it is and how likely."""

    fit: Fit
    deviance: float
    errors: Any

    @property
    def theta(self) -> Array:
        return self.fit.theta


@pytest.mark.parametrize(("beyond", "ends_at"), [(12.0, 1.0), (8.0, 2.0)])
def test_a_fit_goes_on_from_a_solve_only_to_where_it_is_likelier(
    beyond: float, ends_at: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    deviance, solved = {1.0: 10.0, 2.0: beyond}, list[float]()

    def judged(*_: Any, starts: Array, turns: int | None = None, **__: Any) -> End:
        at = 1.0 if starts[0] < 1 else float(starts[0]) if turns == 0 else 2.0
        return End(fit_at(at, converged=turns is None), deviance[at], SimpleNamespace(gauge=None))

    model = SimpleNamespace(error_mm=lambda theta: 0.0, certify=lambda theta, derivatives: solved.append(theta[0]))
    monkeypatch.setattr(nearfit, "judge", judged)
    monkeypatch.setattr(nearfit, "noise_of", lambda targets, gauge: 1.0)
    found = nearfit.fitted_near(cast(Any, model), cast(Any, None), np.zeros(1))
    assert found.theta == [ends_at]
    assert found.deviance == deviance[ends_at]
    assert found.fit.converged
    assert solved == [1.0, 2.0][: int(ends_at)]


def fit_at(theta: float, *, converged: bool) -> Fit:
    """A fit of one parameter there."""
    return Fit(
        parameters=(Parameter("c", 0.0, 3.0),), theta=np.array([theta]), covariance=np.eye(1), chi2=1.0,
        degrees_of_freedom=1, seed=0, evaluations=1, converged=converged, reason="", at_bound=(),
    )  # fmt: skip


@pytest.mark.parametrize("missing", [0, 10])
def test_a_base_fit_along_a_response_ends_where_that_by_whole_solves_does(
    missing: int, coarsest_case: Case, make_targets: Callable[..., Targets],
    make_noise: Callable[..., Noise], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    plain, sd = make_targets(noise=make_noise(3, sd=0.001, rho=0.0, common=0.0)), 0.001
    base, start = base_model(plain, coarsest_case), np.array([0.24, 0.05])
    u = base.predict(np.array([0.19, 0.11]))
    mode = np.linspace(0.0, 1.0, len(u))[:, None, None] * np.where(plain.fixed, 0.0, 0.01)[:, None] * np.eye(3)[2]
    value = u + sd * np.random.default_rng(8).standard_normal(u.shape) - missing * mode
    t = replace(plain, value=value, covariance=np.tile(sd**2 * np.eye(3), (*u.shape[:2], 1, 1)),
                modes=mode[None], mode_names=("scale",))  # fmt: skip
    base = base_model(t, coarsest_case)
    whole = Model(base.test, base.effects, base.reference)  # keeps nothing, so that all is solved
    wanted, solved, solves = judge_base(whole, t, starts=start), Model.solved, set[bytes]()
    monkeypatch.setattr(Model, "solved", lambda m, x, **k: solves.add(x.tobytes()) or solved(m, x, **k))
    found = judge_base(base, t, starts=start)
    assert found.comparison.adequate == (not missing)
    assert len(solves) <= 6, len(solves)
    sds = fit_unweighted(whole, t, start=found.theta).sd if missing else wanted.fit.sd
    assert np.all(np.abs(found.theta - wanted.theta) < (SETTLED + 0.1) * sds)  # each fit within its own
    np.testing.assert_array_equal(found.predicted, base.predict(found.theta))
    np.testing.assert_allclose(found.predicted, whole.predict(found.theta), atol=1e-6)  # solved, not answered
