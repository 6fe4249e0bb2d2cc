"""Prediction errors of data that a model was not fitted to: blocks, cycles or parts of a film, each left out
in turn."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from calibrate import chi2_test
from calibrate.statistics import omnibus
from twin.judging.comparison import credible, freedom, slow_shapes, smooth_functions
from twin.judging.fitrecord import UnseenFilm
from twin.judging.fitting import ModelErrors
from twin.judging.judged import Judged
from twin.judging.whitening import PLAUSIBLE
from twin.records import Maybe, Record
from twin.targets import Array, Targets

PARTS = 5  # of a film of one cycle, each left out in turn
SMOOTH = 3  # courses of a forecast's smooth departures: the first three powers of pressure
BEGUN, ENDED = 0.1, 0.05  # of the top pressure, between which a cycle neither begins nor ends


class HeldOut(Record):
    """The error in sds of data that a model was not fitted to: cycles, blocks or fifths left out in turn."""

    left_out: str = Field(description="what each part is")
    folds: int = Field(description="number of parts")
    before_sd: Maybe
    after_sd: Maybe


def held_out(before: Judged, after: Judged, targets: Targets) -> HeldOut:
    """The held-out errors of two models, each by its own errors."""
    fold, name = folds(targets)
    errors = [
        foretold(j.z, j.fitted, np.repeat(fold, len(j.whitener.components)), j.whitener.valid.ravel())
        for j in (before, after)
    ]
    return HeldOut(left_out=name, folds=len(np.unique(fold)), before_sd=errors[0], after_sd=errors[1])


def foretold(z: Array, fitted: Array, fold: NDArray[np.int64], valid: NDArray[np.bool_]) -> float:
    """Root mean square error in sds of values (n,), each foretold by a fit to all other folds.

    z (n,): whitened residual. fitted (n, f): whitened derivatives of what is fitted. To first order, with the
    shared errors as all data show them: an error that many values share is taken off before.
    """
    scale = np.linalg.norm(fitted, axis=0)
    columns = fitted / np.where(scale > 0, scale, 1.0)
    errors = z.copy()
    for number in np.unique(fold):
        out = fold == number
        step = np.linalg.lstsq(columns[~out], z[~out], rcond=1e-10)[0]
        errors[out] -= columns[out] @ step
    return float(np.sqrt((errors[valid] ** 2).mean()))


def folds(targets: Targets) -> tuple[NDArray[np.int64], str]:
    """The part (s,) that each step belongs to, and what the parts are: blocks, else cycles, else fifths."""
    if len(np.unique(targets.block[~targets.held_out])) > 1:
        return targets.block, "block"
    cycle = cycles(targets.pressure)
    if cycle.max() > 0:
        return cycle, "cycle"
    return np.arange(len(cycle)) * PARTS // len(cycle), "fifth of the film"


def cycles(pressure: Array) -> NDArray[np.int64]:
    """The number (s,) of the cycle that each step belongs to: a new one begins where the pressure rises from
    rest, but for the first.

    >>> cycles(np.array([0.0, 1.0, 0.0, 0.0, 1.0, 0.5]))
    array([0, 0, 0, 0, 1, 1])
    """
    low = float(pressure.min())
    x = (pressure - low) / max(float(np.ptp(pressure)), 1e-12)
    number, loaded, out = -1, False, np.zeros(len(x), np.int64)
    for k, value in enumerate(x):
        if not loaded and value > BEGUN:
            number, loaded = number + 1, True
        elif loaded and value < ENDED:
            loaded = False
        out[k] = max(number, 0)
    return out


# -- films that no fit has seen ------------------------------------------------------------------------------


def unseen(
    errors: ModelErrors, predicted: Array, jacobian: Array, targets: Targets, films: Mapping[int, str]
) -> tuple[UnseenFilm, ...]:
    """The error of a prediction (s, p, 3) mm with derivatives (d, s, p, 3) in each block that is held out and
    was measured, by the errors that its model states; films: names by block."""
    return tuple(
        _in_block(errors, predicted, jacobian, targets, b, films.get(b, f"block {b}"))
        for b in unseen_blocks(targets)
    )


def unseen_blocks(targets: Targets) -> list[int]:
    """The blocks that are held out and were measured."""
    seen = targets.held_out & targets.valid[:, ~targets.fixed].any(axis=(1, 2))
    return [int(b) for b in np.unique(targets.block[seen])]


def forecasts(judged: Judged, targets: Targets) -> dict[int, float]:
    """By block that is held out the `surprise` of a judged model."""
    parts = judged.errors, judged.predicted, judged.jacobian, targets
    return {b: surprise(*parts, b) for b in unseen_blocks(targets)}


def surprise(
    errors: ModelErrors, predicted: Array, jacobian: Array, targets: Targets, block: int
) -> float:
    """Probability of so bad a forecast of a block that a fit has not seen, of a right model.

    The smaller of two, times two: that of what chi2 rises by where the block joins the fit (Chow 1960, doi
    10.2307/1910133), and that of smooth departures in the block alone. One linearised step takes the fit to
    its optimum, and errors that all films share are asked for once.
    """
    whole = replace(targets, held_out=targets.held_out & (targets.block != block))
    ends = []
    for data in (targets, whole):
        w = errors.whitener(data)
        z, fitted = w.whiten(data.value - predicted), w.whiten(jacobian).T
        rest = z - fitted @ np.linalg.lstsq(fitted, z, rcond=1e-12)[0]
        ends.append((w, z, fitted, float(rest @ rest)))
    (*_, before), (w, z, fitted, after) = ends
    values = w.valid[whole.block == block].sum(axis=0)
    nu = freedom(targets, len(values))
    courses = slow_shapes(whole)[:SMOOTH] * (whole.block == block)
    component = np.tile(np.arange(len(values)), len(w.valid))
    joined = chi2_test(max(after - before, 0.0), values, nu)
    departing = omnibus(z, smooth_functions(whole, w, courses), component=component,
                        static_frames_effective=nu, fitted=fitted)  # fmt: skip
    return min(1.0, 2 * min(joined, departing))


def _in_block(
    errors: ModelErrors, predicted: Array, jacobian: Array, targets: Targets, block: int, film: str
) -> UnseenFilm:
    w = errors.whitener(replace(targets, held_out=targets.block != block))
    residual = targets.value - predicted
    expected = credible(w.expected_unseen(errors.whitener(targets), jacobian), targets, w)
    return UnseenFilm(
        film=film,
        block=block,
        rms_mm=w.rms(residual, bound=PLAUSIBLE),
        raw_rms_mm=w.error(residual),
        expected_mm=expected.rms_mm,
        expected_low_mm=expected.low_mm,
        expected_high_mm=expected.high_mm,
        noise_sd_mm=w.noise_sd,
        values=w.count,
    )
