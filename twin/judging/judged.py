"""A model and targets -> the model fitted and judged: by errors of its own, rebuilt where the fit ends.

What the gauge's noise and the mesh do to a prediction depends on the constants. Errors taken at other
constants judge another model, so the whitener is rebuilt at every fit, until fit and errors belong together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calibrate import Fit
from calibrate.parameters import bounds
from twin.effects.protocol import Unsolvable
from twin.judging.comparison import Comparison, compare
from twin.judging.fitting import ModelErrors, fit_model, fit_unweighted, noise_of
from twin.judging.likelihood import without_gross
from twin.judging.whitening import Whitener
from twin.model.keptmodel import KeptModel
from twin.model.nearmodel import NEARBY, NearModel
from twin.model.prediction import Model
from twin.targets import Array, Targets

ROUGH = 1.0  # sd to which a start is followed under its own errors, which are not those of its end
TURNS = 8  # steps from there, each under the errors at the last; two are enough for a model that is right
FEW = 10  # evaluations from the unweighted fit; of a model that is right three or four are enough
SETTLED = 0.25  # sd to which a fit is carried along a response: a 95 % interval off by so much covers 94 %
ENDS = 4  # ends that are solved then, at most
TRIES = 3  # solves of a turn: where it is, the step, and a shorter one where that is too long
SHARES = 0.25, 5.0  # of the step of a turn that are gone, where the steps before turn back or shrink slowly


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A model and its fit."""

    model: Model
    fit: Fit

    @property
    def theta(self) -> Array:
        """The fitted parameters (d,)."""
        return self.fit.theta

    @property
    def values(self) -> dict[str, float]:
        """The fitted parameters by name."""
        return self.model.named(self.fit.theta)

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters that end at a bound."""
        return self.fit.at_bound


@dataclass(frozen=True, kw_only=True)
class Judged(Fitted):
    """A fitted model and how it agrees, by the errors at its own fit.

    targets: those it is judged by. predicted (s, p, 3) mm. jacobian (f, s, p, 3): its derivatives by the
    parameters that are free, those not at a bound; z (n,) and fitted (n, f): residual and derivatives
    whitened. errors: what the model states of its own. deviance: chi2 + ln det of the data's covariance, -2
    ln likelihood but for a constant, by which models with different errors compare. compared: its comparison,
    once it was asked for.
    """

    targets: Targets
    errors: ModelErrors
    whitener: Whitener
    predicted: Array
    jacobian: Array
    z: Array
    fitted: Array
    deviance: float
    compared: list[Comparison] = field(default_factory=list, repr=False, compare=False)

    @property
    def testable(self) -> bool:
        """Whether there are more data than parameters."""
        return self.whitener.count - self.fitted.shape[1] > len(self.at_bound)

    @property
    def comparison(self) -> Comparison:
        """How it agrees, made when it is asked for: on its way a fit is not."""
        if not self.compared:
            names, bounded = free_names(self.fit), len(self.at_bound)
            self.compared.append(
                compare(self.targets, self.predicted, self.whitener, jacobian=self.jacobian,
                        at_bound=bounded, names=names)
            )  # fmt: skip
        return self.compared[0]


def free_names(fit: Fit) -> list[str]:
    """The names of a fit's parameters that are not at a bound."""
    return [p.name for p in fit.parameters if p.name not in fit.at_bound]


def judge(
    model: Model,
    targets: Targets,
    *,
    starts: Array | Sequence[Array],
    seed: int = 0,
    evaluations: int = 25,
    tolerance: float = 0.1,
    turns: int | None = None,
    law: float = 0.0,
) -> Judged:
    """The model fitted from starts (m, d) or (d,), with the errors at its fit, and compared.

    Of several starts the one that ends with the lowest deviance is carried on. evaluations: of one descent.
    turns: steps under rebuilt errors, by default TURNS; with 0 the descent alone. law: by which share of what
    they add the laws of the model's effects may err, 1 sd (`lawerrorlevels` says which the data ask for).
    tolerance: in sds; a fit stays where the errors rebuilt at its end move it by less. Where it does not
    stay, its reason says so. Raises Unsolvable where the model can be solved at no start.
    """
    task = _Task(model, targets, seed, evaluations, tolerance, TURNS if turns is None else turns, law)
    return task.judged(task.ended(starts))


def judge_base(
    model: Model, targets: Targets, *, starts: Array | Sequence[Array], seed: int = 0
) -> Judged:
    """A model that may lack an effect, fitted from starts (m, d) or (d,) and judged.

    Ordinary least squares come first: where an effect is missing, weights by the errors of the measurement
    pay for it with these errors, and with constants. From their end the fit is weighted. Where that, after
    its first descent or in its end, does not fit and asks shared errors for more than is stated of them, the
    unweighted one is kept, whose error is the smallest of all. Priors, tests of the silicone and heavy tails
    need the weights from the start. The way there is taken along the model's response, the end is solved.
    """
    if not targets.bare:
        return judge(model, targets, starts=starts, seed=seed)
    unweighted = _unweighted(model, targets, starts, seed)
    left = targets.rms(targets.value - model.predict(unweighted.theta))
    whole = _Task(model, targets, seed, FEW, 0.1, TURNS, 0.0)
    along = replace(whole, model=_answering(model, unweighted.theta, left))
    rough = along.first(unweighted.theta)
    weighted = along.judged(rough)
    if not _pays(weighted):
        weighted = whole.judged(whole.settled(whole._at(along.settled(rough).fit)))
    return whole.judged(whole._at(unweighted)) if _pays(weighted) else weighted


def _answering(model: Model, theta: Array, error_mm: float) -> Model:
    """The model, which answers by its response about theta (d,) where it keeps its solves and that errs by
    less than NEARBY of an error that there is anyhow."""
    if not isinstance(model, KeptModel):
        return model
    return NearModel.of(model, model, theta, {}, limit_mm=NEARBY * error_mm)


def _unweighted(model: Model, targets: Targets, starts: Array | Sequence[Array], seed: int) -> Fit:
    """The unweighted fit; along its response, if a model keeps its solves, until a solve with derivatives
    moves it by less than SETTLED."""
    start = np.atleast_2d(starts)[0]
    noise = noise_of(targets, model.per_pressure(start) * targets.pressure_error[:, None, None])
    fit = fit_unweighted(_answering(model, start, noise), targets, start=starts, seed=seed)
    for _ in range(ENDS if isinstance(model, KeptModel) else 0):
        near = _answering(model, fit.theta, noise)
        again = fit_unweighted(near, targets, start=fit.theta, seed=seed)
        if np.all(np.abs(again.theta - fit.theta) <= SETTLED * again.sd):
            break
        fit = again
    return fit


def _pays(judged: Judged) -> bool:
    """Whether a fit pays for what is missing with shared errors beyond what is stated of them."""
    return bool(judged.comparison.beyond) and not judged.comparison.adequate


def judge_fit(model: Model, targets: Targets, fit: Fit, *, law: float = 0.0) -> Judged:
    """A fitted model judged by the errors at its fit, without another fit; law as in `judge`."""
    task = _Task(model, targets, fit.seed, 1, 0.1, TURNS, law)
    end = task._at(fit)
    return task.judged(replace(end, fit=fit))


def judged_by(
    targets: Targets, predicted: Array, errors: ModelErrors, w: Whitener
) -> tuple[Targets, Whitener]:
    """The targets that a fit with this prediction (s, p, 3) mm is judged by, and their whitener: all of them,
    or those without gross errors where these hardly count."""
    without = without_gross(targets, targets.value - predicted, w)
    return (without, w) if without is targets else (without, errors.whitener(without))


@dataclass(frozen=True)
class _End:
    """The end of a descent, with the errors there."""

    fit: Fit
    errors: ModelErrors
    whitener: Whitener
    predicted: Array

    @cached_property
    def deviance(self) -> float:
        return float(self.fit.chi2 + self.whitener.log_det)


@dataclass(frozen=True)
class _Task:
    """One model, its targets, and how it is fitted."""

    model: Model
    targets: Targets
    seed: int
    evaluations: int
    tolerance: float
    turns: int
    law: float

    def ended(self, starts: Array | Sequence[Array]) -> _End:
        """The settled end of the descent that comes lowest of those from starts (m, d) or (d,)."""
        ends, failed = [], list[Unsolvable]()
        for start in np.atleast_2d(np.asarray(starts, float)):
            try:
                ends.append(self.first(start))
            except Unsolvable as error:
                failed.append(error)
        if not ends:
            raise max(failed, key=lambda error: error.reached)
        return self.settled(min(ends, key=lambda e: e.deviance))

    def first(self, start: Array) -> _End:
        """The end of a descent under the errors at its start."""
        w = self._errors(start).whitener(self.targets)
        fit = self._fit(w, start, self.evaluations, tolerance=max(ROUGH, self.tolerance))
        if not np.isfinite(fit.chi2):
            raise Unsolvable(fit.reason)
        return self._at(fit)

    def settled(self, end: _End) -> _End:
        """The end that errors rebuilt there move no more; the best on the way, where there is no such end.

        A step at a time (iteratively reweighted least squares), so that the errors are never far behind. How
        the steps r shrink or turn back tells by which share w of one to go (Irons and Tuck 1969, doi
        10.1002/nme.1620010306), and that w r is what is left to go:

            w_k = -w_(k-1) r_(k-1) . (r_k - r_(k-1)) / |r_k - r_(k-1)|^2
        """
        best, done, share = end, end.fit.evaluations, 1.0
        last: Array | None = None
        if not self.turns:
            return end
        for _ in range(self.turns):
            near = self.tolerance / max(share, 1.0)
            fit = self._fit(end.whitener, end.fit.theta, TRIES, tolerance=near)
            if not fit.converged and np.array_equal(fit.theta, end.fit.theta):
                fit = self._fit(end.whitener, end.fit.theta, self.evaluations)
            done = fit.evaluations + end.fit.evaluations
            if np.array_equal(fit.theta, end.fit.theta):
                return replace(end, fit=replace(fit, evaluations=done))
            step = np.nan_to_num((fit.theta - end.fit.theta) / fit.sd)  # none at a bound
            if last is not None:
                change = step - last
                foreseen = -share * float(last @ change) / max(float(change @ change), 1e-300)
                share = float(np.clip(foreseen, *SHARES))
            last = step
            theta = np.clip(end.fit.theta + share * (fit.theta - end.fit.theta), *bounds(fit.parameters))
            end = self._at(replace(fit, theta=theta, evaluations=done))
            best = min(best, end, key=lambda e: e.deviance)
        reason = f"the errors of gauge and mesh, rebuilt {self.turns} times at the fit, still move it"
        return replace(best, fit=replace(best.fit, evaluations=done, converged=False, reason=reason))

    def judged(self, end: _End) -> Judged:
        """An end as it is judged; parameters at a bound are free nowhere."""
        free = [p.name not in end.fit.at_bound for p in end.fit.parameters]
        jacobian = self.model.jacobian(end.fit.theta)[free]
        targets, w = judged_by(self.targets, end.predicted, end.errors, end.whitener)
        return Judged(
            model=self.model,
            fit=end.fit,
            targets=targets,
            errors=end.errors,
            whitener=w,
            predicted=end.predicted,
            jacobian=jacobian,
            z=w.whiten(targets.value - end.predicted),
            fitted=w.whiten(jacobian).T,
            deviance=end.deviance,
        )

    def _errors(self, theta: Array) -> ModelErrors:
        return ModelErrors.of(self.model, theta, self.targets, law=self.law)

    def _fit(self, w: Whitener, start: Array, evaluations: int, *, tolerance: float | None = None) -> Fit:
        return fit_model(
            self.model, self.targets, w, start=start, seed=self.seed, evaluations=evaluations,
            tolerance=tolerance or self.tolerance,
        )  # fmt: skip

    def _at(self, fit: Fit) -> _End:
        """The fit with chi2 and covariance under the errors at its end."""
        errors = self._errors(fit.theta)
        w = errors.whitener(self.targets)
        refit = self._fit(w, fit.theta, 1)
        result = replace(refit, evaluations=fit.evaluations, converged=fit.converged, reason=fit.reason)
        return _End(result, errors, w, self.model.predict(fit.theta))
