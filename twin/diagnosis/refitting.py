"""A hypothesis -> its refit, judged by its own errors, and its gain at every size of law errors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from calibrate import bic
from twin.diagnosis.evidence import apart, occam, orthonormal
from twin.diagnosis.hypotheses import Hypothesis, Refit, Score
from twin.diagnosis.signatures import null, prior_sd
from twin.effects.protocol import Effect, Theta, Unsolvable
from twin.judging.fitting import fit_model, noise_of
from twin.judging.heldout import folds
from twin.judging.judged import Judged, judge, judge_fit
from twin.judging.lawerrorlevels import Level, asked_for, levels
from twin.judging.lawerrors import averaged
from twin.model.keptmodel import KeptModel
from twin.model.nearmodel import NEARBY, NearModel
from twin.model.prediction import Model
from twin.targets import Array, Targets

NEAR = 2.0  # of 2 ln likelihood, that the next step would gain: then the derivatives say the rest
CLOSE = 2e-3  # or this share of its evidence: what is behind by more is told apart without
DOUBT = 5e-3  # of an evidence, by which it may err then: of the demo 38, 28 and 0 of 10,300
MORE = 4  # times a refit of two solves is carried on, where it would gain more
VAIN = 2  # steps of one to where there is no equilibrium, after which the derivatives say the rest
NEARER = (1.0, 0.5, 0.25, 0.125, 0.0625)  # of the sizes that the first order says
UNSOLVED = 0.25  # of its fall of deviance that a refit's next step promises: with more, what is solved counts
IN_VAIN = "beside it the model misses more than without it"


def with_effects(base: Judged, effects: Sequence[Effect]) -> Model:
    """The base model with effects more."""
    model: Model = base.model
    for e in effects:
        model = model.with_effect(e)
    return model


def near_with_effects(
    base: Judged,
    effects: Sequence[Effect],
    targets: Targets,
    tangents: Mapping[str, Sequence[Array]],
) -> Model:
    """The base model with effects more, which answers by its response where that errs by less than NEARBY of
    the noise; tangents: of effects at the base fit, by label."""
    whole = with_effects(base, effects)
    if not (isinstance(whole, KeptModel) and isinstance(base.model, KeptModel)):
        return whole
    limit = NEARBY * noise_of(targets, base.errors.gauge)
    return NearModel.of(whole, base.model, base.theta, tangents, limit_mm=limit)


def refitted(
    h: Hypothesis,
    base: Judged,
    targets: Targets,
    *,
    starts: Sequence[Theta] = (),
    seed: int,
    tangents: Mapping[str, Sequence[Array]] = MappingProxyType({}),
    exact: bool = False,
) -> tuple[Hypothesis, Judged | None]:
    """The hypothesis with its refit and score, and the judged model; a note where there is no equilibrium.

    starts: further values of the base model's parameters from which it is tried too; tangents: of effects at
    the base fit, by label; exact: its end is solved, too.
    """
    model = near_with_effects(base, h.effects, targets, tangents)
    begun = [_foreseen(model, h.start, base, targets, seed), *({**h.start, **s} for s in starts)]
    rows = np.array([model.theta(_allowed(model, values, base.values)) for values in begun])
    try:
        try:
            judged, at_levels = _descended(model, targets, rows, seed, least=CLOSE * h.hint)
            astray = judged.deviance > base.deviance
        except Unsolvable:
            astray = True
        if astray:  # the start lay beyond what the first order tells
            nearer = _nearer(model, h, base, targets, seed)
            judged, at_levels = _descended(model, targets, nearer, seed, least=CLOSE * h.hint)
        if judged.deviance > base.deviance:
            return replace(h, note=IN_VAIN), None
        if exact and isinstance(model, NearModel) and not model.is_solved(judged.theta):
            model.certify(judged.theta)
            judged = judge_fit(model, targets, judged.fit)
            at_levels = levels(judged, targets)
    except Unsolvable as error:
        return replace(h, note=str(error)), None
    promised = base.deviance - at_levels[0].deviance
    if judged.deviance - at_levels[0].deviance > UNSOLVED * promised:  # far from its end
        at_levels = levels(judged, targets, ahead=False)
    score = scored(judged, at_levels, h.effects, base, targets)
    score = replace(score, near=isinstance(model, NearModel) and not model.is_solved(judged.theta))
    refit = Refit.of(replace(judged, model=with_effects(base, h.effects)))
    step = next(each.step for each in at_levels if each.law == score.law)
    return replace(h, refit=refit, score=score, start=_gone_on(judged, step)), judged


def _descended(
    model: Model, targets: Targets, starts: Array, seed: int, *, least: float
) -> tuple[Judged, Sequence[Level]]:
    """A refit from starts (m, d) or (d,), and its levels of law errors: two solves, carried on where the next
    step would gain more than `least`. Raises Unsolvable."""
    judged = judge(model, targets, starts=starts, seed=seed, evaluations=2, turns=0)
    at_levels, most = levels(judged, targets), 3
    for _ in range(MORE):
        if judged.deviance - at_levels[0].deviance < max(NEAR, least):
            break
        last = judged
        judged = judge(model, targets, starts=last.theta, seed=seed, evaluations=most, turns=0)
        at_levels = levels(judged, targets)
        stuck = np.array_equal(judged.theta, last.theta)
        if stuck and isinstance(model, NearModel) and model.whole.failures >= VAIN:
            break
        most = 2 * most if stuck else 3  # a shorter step takes more tries
    return judged, at_levels


def _nearer(model: Model, h: Hypothesis, base: Judged, targets: Targets, seed: int) -> Array:
    """A start (d,) with the constants of the base fit, which carry the test, and as much of the effects as
    lies below the base model: all that the first order says, or a half, a quarter .. of it; the least that is
    tried where none does."""
    null = {p.name: p.null or 0.0 for e in h.effects for p in e.amplitudes}
    for share in NEARER:
        part = {n: null[n] + share * (x - null[n]) if n in null else x for n, x in h.start.items()}
        theta = model.theta({**part, **base.values})
        try:
            tried = judge(model, targets, starts=theta, seed=seed, evaluations=1, turns=0)
            if tried.deviance < base.deviance:
                break
        except Unsolvable:
            continue
    return theta


def _foreseen(model: Model, start: Theta, base: Judged, targets: Targets, seed: int) -> dict[str, float]:
    """Where the response foresees the fit from a start, under the errors of the base model: nearer to the end
    than what the first order says; the start itself where it foresees nothing."""
    if not isinstance(model, NearModel):
        return dict(start)
    theta = model.theta(_allowed(model, start, base.values))
    if not model.response.reaches(theta):
        return dict(start)
    try:
        fit = fit_model(model.response, targets, base.whitener, start=theta, seed=seed)
    except Unsolvable:
        return dict(start)
    return model.named(fit.theta) if np.isfinite(fit.chi2) else dict(start)


def _allowed(model: Model, start: Theta, base: Theta) -> Theta:
    """A start (to first order, it may lie where no rubber is stable) brought back towards the base's values
    until the model may go there."""
    for back in (0.0, 0.25, 0.5, 0.75):
        values = {n: x + back * (base.get(n, x) - x) for n, x in start.items()}
        if model.allowed(values):
            return values
    return {**start, **base}


def _gone_on(judged: Judged, step: Array) -> dict[str, float]:
    """The values of a judged model a step (f,) of its free parameters further."""
    moves = dict(zip([n for n in judged.values if n not in judged.at_bound], step, strict=True))
    return {
        p.name: float(np.clip(judged.values[p.name] + moves.get(p.name, 0.0), p.low, p.high))
        for p in judged.model.parameters
    }


def scored(
    judged: Judged, at_levels: Sequence[Level], effects: Sequence[Effect], base: Judged, targets: Targets
) -> Score:
    """The gains over the base of a judged model with more effects, at its levels of law errors."""
    free = [p.name for p in judged.model.parameters if p.name not in judged.at_bound]
    lost = bic(0.0, len(judged.fit.theta) - len(base.fit.theta), judged.whitener.count)
    fall = np.array([base.deviance - each.deviance for each in at_levels])
    lost_at = [lost_to_priors(judged, each, free, effects) for each in at_levels]
    evidence = [f - x for f, x in zip(fall, lost_at, strict=True)]
    level = asked_for(at_levels, evidence)
    return Score(
        evidence=averaged(evidence),
        delta_bic=averaged(fall - lost),
        size=float(np.sqrt(max(fall[0], 0.0))),
        law=level.law,
        p_value=level.p_value,
        p_exact=at_levels[0].p_value,
        held_out={e.name: held_out(judged, e, targets) for e in effects} if len(effects) > 1 else {},
    )


def lost_to_priors(judged: Judged, level: Level, free: Sequence[str], effects: Sequence[Effect]) -> float:
    """The Occam factor of the effects' free parameters, at a size of law errors."""
    parameters = {p.name: p for e in effects for p in e.parameters if p.name in free}
    if not parameters:
        return 0.0
    of_effects = np.array([name in parameters for name in free])
    names = [name for name in free if name in parameters]
    sd = np.array([prior_sd(parameters[name]) for name in names])
    columns = apart(level.fitted[:, of_effects], orthonormal(level.fitted[:, ~of_effects])) * sd
    values = judged.values
    amount = np.array([0.0 if parameters[n].null is None else values[n] - null(parameters[n]) for n in names])
    amount = amount + np.where([parameters[n].null is None for n in names], 0.0, level.step[of_effects])
    return occam(amount / sd, columns.T @ columns)


# -- what each of several effects foretells ------------------------------------------------------------------


def held_out(judged: Judged, effect: Effect, targets: Targets) -> float:
    """The fall of chi2 in parts that are left out, which an effect of a judged model brings. What ends at a
    bound is held there, and goes with the effect."""
    names = [p.name for p in judged.model.parameters]
    columns = judged.whitener.whiten(judged.model.jacobian(judged.theta)).T
    amplitudes = {p.name: p for p in effect.amplitudes}
    values = judged.values
    amount = np.array([values[n] - null(amplitudes[n]) if n in amplitudes else 0.0 for n in names])
    free = np.array([n not in judged.at_bound for n in names])
    of_effect = np.array([n in {p.name for p in effect.parameters} for n in names])
    part = np.where(targets.held_out, -1, folds(targets)[0])
    each = np.repeat(part, len(judged.z) // len(part))
    return gain(judged.z, judged.z + columns @ amount, columns[:, free], columns[:, free & ~of_effect], each)


def gain(z: Array, without: Array, fitted: Array, others: Array, part: NDArray[np.int64]) -> float:
    """The fall of chi2 in left-out parts that an effect brings.

    z (n,): whitened residual at a fit with it, without (n,): once it is taken out; fitted (n, f): whitened
    derivatives by what was fitted, others (n, g): by all but the effect's; part (n,): the part of each value,
    below 0 for none. Cross-validation by parts (Stone 1974, doi 10.1111/j.2517-6161.1974.tb00994.x).
    """
    total = 0.0
    for k in np.unique(part[part >= 0]):
        inside, outside = part == k, (part >= 0) & (part != k)
        if outside.sum() > fitted.shape[1]:
            total += _left(without, others, outside, inside) - _left(z, fitted, outside, inside)
    return total


def _left(z: Array, columns: Array, train: NDArray[np.bool_], test: NDArray[np.bool_]) -> float:
    """chi2 of z in `test` after a fit of columns in `train`, its step kept short where `train` says
    little."""
    lengths = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(lengths > 0, lengths, 1.0)
    inner = scaled[train].T @ scaled[train] + 1e-6 * np.eye(scaled.shape[1])
    step = np.linalg.solve(inner, scaled[train].T @ z[train])
    residual = z[test] - scaled[test] @ step
    return float(residual @ residual)
