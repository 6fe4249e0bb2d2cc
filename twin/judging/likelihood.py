"""Whitened residuals, the tails of their errors and priors -> what least squares minimise; and which values
hardly count in it."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate import Fit, Parameter
from calibrate.fit import Jacobian, Residual
from calibrate.priors import Prior, rows_beside, with_priors
from calibrate.profiles import Held
from calibrate.robust import parted, student, weights
from twin.judging.fitrecord import DownWeighted, PriorRow
from twin.judging.whitening import Whitener
from twin.laws.mooneyrivlin import NAMES, WIDEST_SHARE
from twin.targets import Array, Targets

TOTAL, SHARE = "+".join(NAMES), "share"
APART = 3.0  # sd of their difference, by which a prior and the data disagree
GROSS = 5.0  # times its scale is a value off the model: normal errors do it once in two million
WIDE = 1.5  # times as wide as their errors the values scatter where the model is said not to fit
MOST = 0.1  # of all values may be gross errors; more are a model that does not fit
SHOWN = 20  # of the values that count least, those that fit.json keeps


def held(parameters: Sequence[Parameter], name: str) -> Held:
    """The quantity of a name that a profile or a prior holds: a parameter, C10+C01 or share."""
    if name == TOTAL:
        return Held.total(parameters, *NAMES)
    if name == SHARE:
        return Held.share(parameters, *NAMES, least=WIDEST_SHARE)
    return Held.parameter(parameters, name)


def priors_of(parameters: Sequence[Parameter], targets: Targets) -> tuple[Prior, ...]:
    """The priors of what a model with these parameters has."""
    names = {p.name for p in parameters}
    both = {TOTAL, SHARE} if set(NAMES) <= names else set()
    priors = [k for k in targets.known if k.name in names | both]
    return tuple(Prior(held(parameters, k.name), k.mean, k.sd) for k in priors)


def posed(
    residual: Residual, jacobian: Jacobian, parameters: Sequence[Parameter], targets: Targets, w: Whitener
) -> tuple[Residual, Jacobian, Jacobian | None]:
    """A residual that is white (`whitening`), its derivatives and the rows of its information where these are
    others, under the tails that the errors of targets have, and with a value more for each prior."""
    information, priors = None, priors_of(parameters, targets)
    if targets.tails:
        residual, jacobian, information = student(residual, jacobian, targets.tails, modes=w.mode_innovations)
    if priors:
        residual, jacobian = with_priors(residual, jacobian, priors)
        information = information and rows_beside(information, priors)
    return residual, jacobian, information


def whitening(targets: Targets, w: Whitener) -> Callable[[Array], Array]:
    """The map of fields (..., s, p, 3) mm to white values for `posed`: shared errors stay in it where tails
    are heavy, as a gross error would leave with them and come into every value that shares them."""
    return w.innovations if targets.tails else w.whiten


# -- priors in words -----------------------------------------------------------------------------------------


def prior_rows(fit: Fit, targets: Targets) -> tuple[PriorRow, ...]:
    """The influence of each prior on a fit."""
    return tuple(_row(prior, fit) for prior in priors_of(fit.parameters, targets))


def _row(prior: Prior, fit: Fit) -> PriorRow:
    name, unit, pull = prior.held.name, prior.held.unit, prior.share_in(fit)
    sentence = f"Prior: {name} = {prior.mean:.3g} +- {prior.sd:.3g} {unit}".rstrip()
    if np.isnan(pull.moved):
        sentence += "; what these data alone say of it is not known."
    else:
        without = f"{pull.without:.3g} +- {pull.sd_without:.3g} {unit}".rstrip()
        sentence += f"; these data alone say {without}. The prior moved it by {abs(pull.moved):.2g} sd of "
        sentence += "theirs."
    if pull.apart > APART:
        sentence += (
            f" Prior and data disagree: they lie {pull.apart:.1f} sd of their difference apart. Correct the "
            "one that is wrong, or look for what the model lacks; the fit lies between them."
        )
    return PriorRow(
        name=name, unit=unit, mean=prior.mean, sd=prior.sd, value=pull.value, by_data=pull.without,
        sd_by_data=pull.sd_without, moved_sd=pull.moved, apart_sd=pull.apart, sentence=sentence,
    )  # fmt: skip


# -- values that hardly count --------------------------------------------------------------------------------


def weights_of(targets: Targets, residual: Array, w: Whitener) -> Array:
    """The weight (s, p, 3) of every value with a residual (s, p, 3) mm, NaN where there is no data."""
    innovations, _, scale = parted(w.innovations(residual), w.mode_innovations, targets.tails)
    out, sizes = np.full(residual.shape, np.nan), weights(innovations, targets.tails, scale=scale)
    sizes = sizes.reshape(w.valid.shape)
    out[:, w.components[:, 0], w.components[:, 1]] = np.where(w.valid, sizes, np.nan)
    return out


def gross(targets: Targets, residual: Array, w: Whitener) -> NDArray[np.bool_]:
    """Flags (s, p, 3) of gross errors: more than GROSS times as far off as the t has its scale."""
    least = float(weights(np.array(GROSS), targets.tails))
    return np.nan_to_num(weights_of(targets, residual, w), nan=1.0) < least


def without_gross(targets: Targets, residual: Array, w: Whitener) -> Targets:
    """The targets without gross errors, by which a fit that gives them little weight is to be judged;
    unchanged where errors are normal, or where more than MOST of all values are off and the model does not
    fit."""
    if not targets.tails:
        return targets
    off = gross(targets, residual, w)
    few = off.sum() <= MOST * w.count
    return replace(targets, valid=targets.valid & ~off) if few and off.any() else targets


def down_weighted(targets: Targets, residual: Array, w: Whitener) -> tuple[DownWeighted, ...]:
    """The gross errors, the one that counts least first; SHOWN at most."""
    if not targets.tails:
        return ()
    sizes, off = weights_of(targets, residual, w), np.argwhere(gross(targets, residual, w))
    order = np.argsort([sizes[tuple(index)] for index in off], kind="stable")[:SHOWN]
    return tuple(
        DownWeighted(
            point=targets.names[p], component=f"U{i + 1}", step=int(s), time_s=float(targets.time[s]),
            residual_mm=float(residual[s, p, i]), weight=float(sizes[s, p, i]),
        )
        for s, p, i in off[order]
    )  # fmt: skip


def weights_in_words(targets: Targets, residual: Array, w: Whitener) -> str:
    """The effect of the errors' tails on the fit, one or two sentences; "" where errors are normal."""
    if not targets.tails:
        return ""
    count, rows = int(gross(targets, residual, w).sum()), down_weighted(targets, residual, w)
    scale = parted(w.innovations(residual), w.mode_innovations, targets.tails)[2]
    wide = (
        f" The others scatter {scale:.2g} times as wide as their errors: the model does not fit yet."
        if scale > WIDE else ""
    )  # fmt: skip
    off = f"{GROSS * scale:.2g} sd off the model"
    if not count:
        return f"Student's t: no value lies more than {off}; all of them count.{wide}"
    if count > MOST * w.count:
        return (
            f"Student's t: {count} of {w.count} values lie more than {off}. So many are no gross errors: the "
            "model does not fit, and the test of the fit leaves none of them out."
        )
    named = ", ".join(
        f"{row.point} {row.component} at {row.time_s:.3g} s (weight {row.weight:.2g})" for row in rows[:3]
    )
    more = "" if count <= 3 else f" The others stand in fit.json (down_weighted, {SHOWN} at most)."
    return (
        f"Student's t: {count} of {w.count} values lie more than {off}. They hardly count, and the test of "
        f"the fit leaves them out: {named}.{more}{wide}"
    )
