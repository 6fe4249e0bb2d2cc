"""The noise model in mm: what scatters in the static film, its memory, and what patches do."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from vision.camera import Array
from vision.following.markrotations import mean_seen

# Where these numbers come from: docs/records/error-numbers.md
MIN_STATIC = 120
LEAST_MM = 1e-6  # mm, sd of a mark that coding freezes
REST, CREEP, FAST, SHAKEN, PASSING = 0, 1, 2, 3, 4
DRIFT_PX = 0.02  # px in SETTLED frames, or px per frame: below it a patch is at rest (ten static sds)
SETTLED = 10  # frames in which coding refines a first picture, and in which a drift goes on and on
BETWEEN = 5  # frames after or before a move in which a patch counts as shaken
FAST_PX = 1.0  # px: a patch that is farther off, or moves by more in a frame, is drawn anew
MOST_RHO = 0.98  # of what lasts: a memory of 50 frames
LAGS = 14  # number of lags that are compared
TOWARDS_LONG = 0.25  # a lag counts with this power of its length: slow errors harm a fit most
SURE = 3.0  # sds of the lag-1 correlation from which noise lasts at all


@dataclass(frozen=True)
class Persistence:
    """Noise: white, plus a part that lasts."""

    lasting: float  # share of the variance that is correlated from frame to frame
    rho: float  # correlation of that part from one frame to the next
    total: float  # variance over that of what is new in every frame, as `innovations` has it
    first: float  # correlation of the whole from one frame to the next

    def of_mean(self, count: int) -> float:
        """Variance of the mean of successive values, relative to a single value.

        >>> WHITE.of_mean(100)
        0.01
        >>> slow = Persistence(lasting=0.5, rho=0.9, total=1.0, first=0.45)
        >>> round(slow.of_mean(100), 4)  # as if 11 values were independent
        0.091
        """
        return float(of_mean(np.array(self.lasting), np.array(self.rho), count))

    def independent(self, frames: int) -> float:
        """Number of independent values that tell a variance as well as these frames do (Bartlett 1946)."""
        lasts = self.lasting**2 * self.rho**2 / (1.0 - self.rho**2)
        return max(frames / (1.0 + 2.0 * lasts), 2.0)


WHITE = Persistence(0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """Scatter of measured places; component 1 (y) is not observed: NaN, identity in the correlation."""

    sd: Array  # (p,3) mm, at rest
    rho: Array  # (p,3) correlation from frame to frame of what lasts, 0 to 0.98
    correlation: Array  # (3p,3p) within one frame, order point then component; from the shared homography
    frames: int  # number of static frames
    codec_sd: Array  # (p,3) mm, rms of what is added to it while a patch moves
    common_sd: Array = field(default_factory=lambda: np.zeros(3))  # (3,) mm, of sd: what all points share
    persistence: Persistence = WHITE  # of all points together


def static_noise(
    place: Array, names: Sequence[str], film: str, parts: Sequence[slice] = (slice(None),)
) -> NoiseModel:
    """Noise model of places (t,p,2) mm (x, z) or (t,p,3) mm at rest, without its codec term.

    names: (p,) of the points.   film: name of the static film.   parts: stretches of it whose means are taken
    off, one for all: at rare key frames places step, which is stated apart.

    How long noise lasts is that of all points together (`persistence_of`). What is new in every frame tells
    which points are noisier, and how they are correlated: of slow errors a film of rest holds too few. A
    point that scatters by more than three sds of that keeps its own variance. One that is seen in fewer than
    120 frames takes the largest sd of the others. Raises ValueError when none is seen more often.
    """
    count = np.isfinite(place[..., 0]).sum(axis=0)
    enough = count >= MIN_STATIC
    if not enough.any():
        most = int(np.argmax(count))
        raise ValueError(
            f"static film {film} shows marker {names[most]!r} in {count[most]} frames and none in more, "
            f"wanted {MIN_STATIC}: film the markers at rest for longer"
        )
    error = np.concatenate([place[part][:, enough] - mean_seen(place[part][:, enough]) for part in parts])
    persistence = persistence_of(error.reshape(len(error), -1))
    new = innovations(error, persistence.first)
    sd = np.zeros((len(names), place.shape[-1]))
    sd[enough] = _level(error, new, persistence)
    sd[~enough] = sd.max(axis=0)
    # As large as the errors themselves, and like them in what the points share.
    new = new * (sd[enough] / np.sqrt(np.maximum(_power(new), LEAST_MM**2)))
    to_xyz = with_y if place.shape[-1] == 2 else np.asarray
    shared = np.sqrt(np.maximum(common(new), 0.0))
    return NoiseModel(
        sd=to_xyz(sd),
        rho=to_xyz(np.full(sd.shape, persistence.rho)),
        correlation=_correlation(np.nan_to_num(new), enough),
        frames=int(np.isfinite(place[:, enough, 0]).all(axis=1).sum()),
        codec_sd=np.zeros((len(names), 3)),
        common_sd=np.nan_to_num(to_xyz(shared)),
        persistence=persistence,
    )


def _level(error: Array, new: Array, persistence: Persistence) -> Array:
    """Sd (p,c) mm of errors (t,p,c) from what is new in every frame of them (t-1,p,c) and their memory."""
    count = np.isfinite(error).sum(axis=0)
    variance = np.maximum(_power(error), LEAST_MM**2) * count / (count - 1)
    from_new = np.maximum(_power(new), LEAST_MM**2) * persistence.total * count / (count - 1)
    spread = np.sqrt(2.0 / persistence.independent(len(error)))
    return np.asarray(np.sqrt(np.maximum(from_new, variance / (1.0 + SURE * spread))))


def _power(error: Array) -> Array:
    """Mean square (p,c) over the frames of errors (t,p,c) in which they are seen."""
    return np.asarray(np.nansum(error**2, axis=0) / np.maximum(np.isfinite(error).sum(axis=0), 1))


def common(place: Array) -> Array:
    """Mean covariance (c,) mm2 of two different points' places (t,p,c) at rest: of what all of them share.

    It is 0, give or take s^2 (2 / (t p (p - 1)))^1/2, where points err by s each on its own.

    >>> shake = np.array([-1.0, 1.0, -1.0, 1.0])[:, None, None]  # mm, alike in three points
    >>> common(np.tile(shake, (1, 3, 2)))
    array([1., 1.])
    """
    seen = np.isfinite(place[..., 0])
    error = np.nan_to_num(place - mean_seen(place))
    count = seen.sum(axis=1)
    pairs = (error.sum(axis=1) ** 2 - (error**2).sum(axis=1)).sum(axis=0)
    return np.asarray(pairs / max(int(np.sum(count * (count - 1))), 1))


def hidden_in_static(place: Array, names: Sequence[str], film: str) -> tuple[str, ...]:
    """One sentence about the points (t,p,2) that the static film shows too rarely to tell their noise."""
    count = np.isfinite(place[..., 0]).sum(axis=0)
    few = [name for name, n in zip(names, count, strict=True) if n < MIN_STATIC]
    if not few:
        return ()
    return (
        f"The static film {film} shows {', '.join(map(repr, few))} in fewer than {MIN_STATIC} frames: the "
        "largest noise of the other markers is taken. Film these at rest for longer.",
    )


def with_y(xz: Array) -> Array:
    """Components x, z (...,2) as x, y, z (...,3) with y NaN."""
    return np.stack([xz[..., 0], np.full(xz.shape[:-1], np.nan), xz[..., 1]], axis=-1)


def _correlation(error: Array, enough: NDArray[np.bool_]) -> Array:
    """Correlation (3p,3p) from errors (t,k,2|3) of the k known points of p; identity elsewhere."""
    full = np.eye(3 * len(enough))
    rows = np.flatnonzero((enough[:, None] & [True, error.shape[2] == 3, True]).ravel())
    full[np.ix_(rows, rows)] = np.corrcoef(error.reshape(len(error), -1), rowvar=False)
    return full


def while_moving(extra: Array, moves: NDArray[np.bool_]) -> Array:
    """Rms (p,3) of the codec's sd (s,p,3) over the frames in which a point moves, 0 if it never does."""
    chosen = moves[..., None]
    return np.sqrt(np.sum(extra**2 * chosen, axis=0) / np.maximum(chosen.sum(axis=0), 1))


def thinned_noise(noise: NoiseModel, frames: int, steps: int) -> NoiseModel:
    """The noise model with the correlation from step to step where not every frame is a step."""
    return noise if steps == frames else replace(noise, rho=noise.rho ** (frames / steps))


def states(ideal: Array) -> NDArray[np.int8]:
    """States (t,p) of patches with centres (t,p,2) px: 0 rest, 1 creep on and on, 2 move fast, 3 are shaken,
    as by a regulator's ripple, or about to move or to stop, 4 go slowly to another place.

    >>> place = np.clip(2.0 * np.arange(60.0) - 40.0, 0.0, 40.0)  # px: at rest, 2 px a frame, at rest
    >>> states(np.stack([place, 0.0 * place], axis=1)[:, None])[[12, 18, 30, 44, 55], 0]
    array([0, 4, 2, 3, 0], dtype=int8)
    """
    speed = _moved(ideal, -1, 0)
    # A patch that a regulator's ripple shakes rests in no frame between two of its moves.
    shaken = scipy.ndimage.maximum_filter1d((speed > DRIFT_PX).astype(np.int8), 2 * BETWEEN + 1, axis=0) > 0
    kinds = speed > FAST_PX, _passing(ideal), shaken, _drift(ideal) > DRIFT_PX
    out = np.select(kinds, (FAST, PASSING, SHAKEN, CREEP), REST).astype(np.int8)
    # Coding refines the first picture of a film for some frames. What never moves keeps its static noise.
    out[:SETTLED] = np.where((out[:SETTLED] == REST) & (out != REST).any(axis=0), SHAKEN, out[:SETTLED])
    return out


def _drift(ideal: Array) -> Array:
    """Distance (t,p) px in SETTLED frames: however slow it is, a drift that goes on is drawn late; one that
    has ended is not. Near the film's ends it is that of the other side."""
    before, after = _moved(ideal, -SETTLED, 0), _moved(ideal, 0, SETTLED)
    drift = np.minimum(before, after)
    drift[:SETTLED], drift[-SETTLED:] = after[:SETTLED], before[-SETTLED:]
    return drift


def _passing(ideal: Array) -> NDArray[np.bool_]:
    """Mask (t,p): the BETWEEN frames before and those after lie more than a pixel apart in their mean, so
    that coding draws a new picture, with another error."""
    mean = scipy.ndimage.uniform_filter1d(ideal, BETWEEN, axis=0, mode="nearest")
    half = (BETWEEN + 1) // 2
    return np.asarray(_moved(mean, -half, half) > FAST_PX)


def _moved(ideal: Array, before: int, after: int) -> Array:
    """Distance (t,p) px from `before` to `after` frames off, held at the film's ends; 0 for a lost mark."""
    frames = np.arange(len(ideal))
    step = ideal[np.minimum(frames + after, len(ideal) - 1)] - ideal[np.maximum(frames + before, 0)]
    return np.asarray(np.nan_to_num(np.hypot(step[..., 0], step[..., 1])))



def of_mean(lasting: Array, rho: Array, count: int) -> Array:
    """Variance of the mean of `count` successive values, relative to a single value: white noise, and a share
    `lasting` that is an autoregression with rho."""
    lag = np.arange(1, count)
    weight = np.sum((1.0 - lag / count) * _left(rho, lag), axis=-1)
    return np.asarray((1.0 + 2.0 * lasting * weight) / count)


def _left(rho: Array | float, lag: NDArray[np.intp]) -> Array:
    """Correlation (...,l) that is left after some frames: rho^lag, 0 where that would underflow."""
    power = np.log(np.maximum(np.asarray(rho)[..., None], 1e-300)) * lag
    return np.where(power > -500.0, np.exp(np.maximum(power, -500.0)), 0.0)


def persistence_of(error: Array) -> Persistence:
    """The memory that all errors (t,n) at rest share, each about its own mean; NaN where not seen.

    Video compression repeats what hardly changes, and its error with it: the correlation at a lag of 1 would
    tell too short a memory. Half the mean square difference at lags up to half of the film is
    w + v (1 - rho^lag), which least squares fit; w, v >= 0. Errors are first divided by the sd of what is new
    in them: by their own sd, of which a film knows little, the slow ones would count less.
    """
    unit = _scaled(error, error)
    if not unit.size:
        return WHITE
    ahead, behind = np.nan_to_num(unit[1:]), np.nan_to_num(unit[:-1])
    lag1 = float(np.sum(ahead * behind) / np.sum(np.nan_to_num(unit) ** 2))
    if lag1 < SURE * _scatter(np.nan_to_num(unit)):
        return WHITE
    unit = _scaled(unit, innovations(unit, lag1))
    lags = np.unique(np.round(np.geomspace(1, len(error) // 2, LAGS)).astype(int))
    semivariance = np.array([0.5 * np.nanmean((unit[lag:] - unit[:-lag]) ** 2) for lag in lags])
    weight = lags**TOWARDS_LONG
    best, result = np.inf, (0.0, 1.0, 0.0)
    for rho in np.exp(-1.0 / np.geomspace(0.3, -1.0 / np.log(MOST_RHO), 80)):
        terms = np.stack([np.ones(len(lags)), 1.0 - _left(rho, lags)], axis=1) / semivariance[:, None]
        (white, lasts), misfit = scipy.optimize.nnls(terms * weight[:, None], weight)
        if misfit < best:
            best, result = misfit, (float(rho), float(white), float(lasts))
    rho, white, lasts = result
    return Persistence(lasts / (white + lasts), rho, white + lasts, lag1)


def _scatter(unit: Array) -> float:
    """Sd of the pooled lag-1 correlation of white errors (t,n), which may be correlated with each other."""
    correlation = unit.T @ unit / len(unit)
    return float(np.sqrt((correlation**2).sum() / len(unit)) / unit.shape[1])


def _scaled(error: Array, by: Array) -> Array:
    """Errors (t,n) over the rms of others (s,n), without those that have none."""
    size = np.sqrt(np.nansum(by**2, axis=0) / np.maximum(np.isfinite(by).sum(axis=0), 1))
    return np.asarray(error[:, size > 0] / size[size > 0])


def innovations(error: Array, lag1: float) -> Array:
    """Innovations (t-1,...): the new part in every frame but the first of errors (t,...) with the correlation
    `lag1` from frame to frame.

    It is nearly white, so that it tells how points are correlated, and which are noisier, ten times better
    than the errors themselves.
    """
    return np.asarray(error[1:] - lag1 * error[:-1])
