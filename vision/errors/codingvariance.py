"""Variance that lossy coding adds to the noise at rest, by state of the patch: from the film's frames, coded
again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.errors.reencoding import Again
from vision.errors.sharederrors import CREEP_SHARED, MIN_HOLD
from vision.errors.staticnoise import CREEP, DRIFT_PX, FAST, PASSING, REST, SETTLED, SHAKEN, states, with_y
from vision.following.markrotations import mean_seen

# Where these numbers come from: docs/records/error-numbers.md
RESTS = 2.0  # rests of marks, as many as count as much as what is known before: STOPS of the slow error
STOPS = 0.9  # error kept in a rest over that of slow motion, drawn film


@dataclass(frozen=True)
class Codec:
    """Sd (3,) in mm that lossy coding adds to the static noise, by state of the patch."""

    fast: Array  # sd while it moves by more than FAST_PX a frame: P-frames predict it
    creep: Array  # sd while it moves more slowly, or is shaken: P-frames lag behind it
    held: Array  # sd of the error that stays frozen in a patch that has come to rest
    rest: Array  # the same in one that has not moved yet
    shared: float = CREEP_SHARED  # share of a shaken patch's variance that stays through a hold


NOTHING = Codec(*np.zeros((4, 3)))


def codec_sd(codec: Codec, ideal: Array, rest: Array) -> Array:
    """Extra sd (t,p,3) mm of patches with centres (t,p,2) px; none for one still at its rest (p,2) px."""
    state = states(ideal)[..., None]
    away = np.nan_to_num(np.hypot(*np.moveaxis(ideal - rest, -1, 0)))[..., None] > DRIFT_PX
    return np.where(
        state == FAST, codec.fast, np.where(state != REST, codec.creep, np.where(away, codec.held, 0.0))
    )


def codec_terms(parts: Sequence[Again]) -> Codec:
    """Coding error by what patches did, from stretches of the film that were coded again; 0 without any.

    The error differs with what a patch does, and no static film shows it: at rest P-frames hold one image
    and its error, a patch that creeps lags behind, a fast one is predicted. What creeps through a hold, with
    the regulator's ripple, is not what comes to rest after a fast motion.
    """
    if not parts:
        return NOTHING
    never = [(part.state == REST).all(axis=0) for part in parts]
    still = [part.error[:, rests] for part, rests in zip(parts, never, strict=True)]
    # A frame in which a mark, or the plane, is not seen takes nothing from the others.
    frozen = _mean_square(np.concatenate([mean_seen(error) for error in still]))
    # Is in the static noise already.
    jitter = _mean_square(np.concatenate([(error - mean_seen(error)).reshape(-1, 2) for error in still]))
    everywhere = _pooled(parts, [part.state != REST for part in parts], frozen + jitter)
    fast = _pooled(parts, [part.state == FAST for part in parts], everywhere)
    slow = _pooled(parts, [np.isin(part.state, (CREEP, SHAKEN, PASSING)) for part in parts], everywhere)
    squares = (np.maximum(term - jitter, 0.0) for term in (fast, slow, _held(parts, slow)))
    # Both axes together: windows show few ways to move, and a patch is late the way it moves.
    moving, creep, held, rest = (with_y(np.full(2, np.sqrt(np.mean(t)))) for t in (*squares, frozen))
    return Codec(moving, creep, held, rest, shared=_stays(parts))


def _pooled(parts: Sequence[Again], chosen: Sequence[NDArray[np.bool_]], otherwise: Array) -> Array:
    """Mean square (2,) mm2 of the errors that are chosen (w,p), all stretches; `otherwise` for too few."""
    error = np.concatenate([part.error[which] for part, which in zip(parts, chosen, strict=True)])
    return _mean_square(error) if np.isfinite(error).all(axis=-1).sum() >= SETTLED else otherwise


def _held(parts: Sequence[Again], slow: Array) -> Array:
    """Mean square (2,) mm2 of the error that patches keep which have come to rest.

    It is one value a rest, and a stretch shows few: they are drawn to what is known of slow patches.
    """
    power, rests = np.zeros(2), 0
    for part in parts:
        come = (part.state == REST) & (np.cumsum(part.state != REST, axis=0) > 0)
        come &= np.isfinite(part.error).all(axis=-1)
        for p in np.flatnonzero(come.sum(axis=0) >= SETTLED):
            power, rests = power + np.mean(part.error[come[:, p], p] ** 2, axis=0), rests + 1
    return np.asarray((power + RESTS * STOPS**2 * slow) / (rests + RESTS))


def _stays(parts: Sequence[Again]) -> float:
    """Share of shaken patches' variance that stays: the correlation of their errors a shortest hold apart."""
    products, powers, count = 0.0, 0.0, 0
    for part in parts:
        error, shaken = part.error, part.state == SHAKEN
        later, sooner = slice(MIN_HOLD, None), slice(-MIN_HOLD)
        both = shaken[later] & shaken[sooner] & np.isfinite(error[later] + error[sooner]).all(axis=-1)
        after, before = error[later][both], error[sooner][both]
        products += float(np.sum(after * before))
        powers += 0.5 * float(np.sum(after**2 + before**2))
        count += len(after)
    enough = count >= SETTLED and powers > 0
    return float(np.clip(products / powers, 0.0, CREEP_SHARED)) if enough else CREEP_SHARED


def _mean_square(error: Array) -> Array:
    """Mean square (2,) over all values that are seen, 0 without any."""
    seen = error[np.isfinite(error).all(axis=-1)]
    return np.mean(seen**2, axis=0) if len(seen) else np.zeros(2)
