"""The noise model in mm: what scatters in the static film, and what video compression adds."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from vision.camera import Array
from vision.errors.persistence import WHITE, Persistence, innovations, persistence_of
from vision.film.checkpoint import Progress
from vision.film.video import Image, Video, Writer
from vision.following import registration
from vision.following.methods import COARSE
from vision.following.reference import Follower
from vision.following.tracks import Followed, centres
from vision.following.turns import mean_seen
from vision.marks import px_per_unit
from vision.plane import homographies, to_plane

MIN_STATIC = 120
WINDOW = 60  # frames coded again
LEAST_MM = 1e-6  # mm, sd of a mark that coding freezes
LAG = 3  # frames apart at which a creeping patch's errors are compared
MIN_SAMPLES = 10  # values that make an estimate of their own
CLEARLY = 3.0  # sds of its variance by which a point is noisier than its frames tell
SETTLE = 5  # first frames of the window, near the key frame, left out
SHIFT = np.array([5.0, 3.0])  # px, off every block grid
REST, CREEP, FAST, SHAKEN, PASSING = 0, 1, 2, 3, 4
DRIFT_PX = 0.02  # px in ten frames, or px per frame: below it a patch is at rest (ten static sds)
SETTLED = 10  # first frames of a film
BETWEEN = 5  # frames after or before a move in which a patch counts as shaken
FAST_PX = 1.0  # px per frame: below it a moving patch creeps
# A pass over decoded frames errs by 0.75 to 0.95 of what the first pass did (drawn film).
FIRST_PASS = 1.2
ALIKE = 0.8
LOSSLESS = ("ffv1", "huffyuv", "ffvhuff", "utvideo", "png", "rawvideo", "qtrle")
CODERS = {"hevc": "libx265"}


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """How measured places scatter; component 1 (y) is not observed: NaN, identity in the correlation."""

    sd: Array  # (p,3) mm, at rest
    rho: Array  # (p,3) correlation from frame to frame of what lasts, 0 to 0.98
    correlation: Array  # (3p,3p) within one frame, order point then component; from the shared homography
    frames: int  # number of static frames
    codec_sd: Array  # (p,3) mm, rms of what is added to it while a patch moves
    common_sd: Array = field(default_factory=lambda: np.zeros(3))  # (3,) mm, of sd: what all points share
    persistence: Persistence = WHITE  # of all points together


@dataclass(frozen=True)
class Codec:
    """What lossy coding adds to the static noise, (3,) mm, by what the patch does."""

    fast: Array  # sd while it moves by more than FAST_PX a frame: P-frames predict it
    creep: Array  # sd while it moves more slowly, or is shaken: P-frames lag behind it
    held: Array  # sd of the error that stays frozen in a patch that has come to rest
    rest: Array  # the same in one that has not moved yet
    shared: float = 0.75  # share of a shaken patch's variance that stays through a hold, from 0 to 0.75


def static_noise(place: Array, names: Sequence[str], film: str) -> NoiseModel:
    """Noise model of places (t,p,2) mm (x, z) or (t,p,3) mm at rest, without its codec term.

    names: (p,) of the points.   film: name of the static film.

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
    error = place[:, enough] - mean_seen(place[:, enough])
    found = persistence_of(error.reshape(len(error), -1))
    new = innovations(error, found.first)
    sd = np.zeros((len(names), place.shape[-1]))
    sd[enough] = _level(error, new, found)
    sd[~enough] = sd.max(axis=0)
    # As large as the errors themselves, and like them in what the points share.
    new = new * (sd[enough] / np.sqrt(np.maximum(_power(new), LEAST_MM**2)))
    whole = with_y if place.shape[-1] == 2 else np.asarray
    shared = np.sqrt(np.maximum(common(new), 0.0))
    return NoiseModel(
        sd=whole(sd),
        rho=whole(np.full(sd.shape, found.rho)),
        correlation=_correlation(np.nan_to_num(new), enough),
        frames=int(np.isfinite(place[:, enough, 0]).all(axis=1).sum()),
        codec_sd=np.zeros((len(names), 3)),
        common_sd=np.nan_to_num(whole(shared)),
        persistence=found,
    )


def _level(error: Array, new: Array, found: Persistence) -> Array:
    """Sd (p,c) mm of errors (t,p,c) from what is new in every frame of them (t-1,p,c) and their memory."""
    count = np.isfinite(error).sum(axis=0)
    own = np.maximum(_power(error), LEAST_MM**2) * count / (count - 1)
    told = np.maximum(_power(new), LEAST_MM**2) * found.total * count / (count - 1)
    spread = np.sqrt(2.0 / found.independent(len(error)))
    return np.asarray(np.sqrt(np.maximum(told, own / (1.0 + CLEARLY * spread))))


def _power(error: Array) -> Array:
    """Mean square (p,c) over the frames of errors (t,p,c) in which they are seen."""
    return np.asarray(np.nansum(error**2, axis=0) / np.maximum(np.isfinite(error).sum(axis=0), 1))


def common(place: Array) -> Array:
    """Mean covariance (c,) mm2 of two different points' places (t,p,c) at rest: of what all of them share.

    It is 0, give or take s^2 (2 / (t p (p - 1)))^1/2, where points err by s each on its own.
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


def _correlation(error: Array, known: NDArray[np.bool_]) -> Array:
    """Correlation (3p,3p) from errors (t,k,2|3) of the k known points of p; identity elsewhere."""
    full = np.eye(3 * len(known))
    rows = np.flatnonzero((known[:, None] & [True, error.shape[2] == 3, True]).ravel())
    full[np.ix_(rows, rows)] = np.corrcoef(error.reshape(len(error), -1), rowvar=False)
    return full


def states(ideal: Array) -> NDArray[np.int8]:
    """What patches with centres (t,p,2) px do in each frame (t,p): 0 rest, 1 creep on and on, 2 move fast,
    3 are shaken, as by a regulator's ripple, or about to move or to stop, 4 go slowly to another place."""
    speed = _moved(ideal, -1, 0)
    # A patch that a regulator's ripple shakes rests in no frame between two of its moves.
    shaken = maximum_filter1d((speed > DRIFT_PX).astype(np.int8), 2 * BETWEEN + 1, axis=0) > 0
    kinds = speed > FAST_PX, _passing(ideal), shaken, _drift(ideal) > DRIFT_PX
    out = np.select(kinds, (FAST, PASSING, SHAKEN, CREEP), REST).astype(np.int8)
    # Coding refines the first picture of a film for some frames. What never moves keeps its static noise.
    out[:SETTLED] = np.where((out[:SETTLED] == REST) & (out != REST).any(axis=0), SHAKEN, out[:SETTLED])
    return out


def _drift(ideal: Array) -> Array:
    """Distance (t,p) px in ten frames: however slow it is, a drift that goes on is drawn late; one that has
    ended is not. Near the film's ends it is that of the other side."""
    before, after = _moved(ideal, -10, 0), _moved(ideal, 0, 10)
    drift = np.minimum(before, after)
    drift[:10], drift[-10:] = after[:10], before[-10:]
    return drift


def _passing(ideal: Array) -> NDArray[np.bool_]:
    """Where (t,p) the BETWEEN frames before and those after lie more than a pixel apart in their mean, so
    that coding draws a new picture, with another error."""
    mean = uniform_filter1d(ideal, BETWEEN, axis=0, mode="nearest")
    half = (BETWEEN + 1) // 2
    return np.asarray(_moved(mean, -half, half) > FAST_PX)


def _moved(ideal: Array, before: int, after: int) -> Array:
    """Distance (t,p) px from `before` to `after` frames off, held at the film's ends; 0 for a lost mark."""
    frames = np.arange(len(ideal))
    step = ideal[np.minimum(frames + after, len(ideal) - 1)] - ideal[np.maximum(frames + before, 0)]
    return np.asarray(np.nan_to_num(np.hypot(step[..., 0], step[..., 1])))


def codec_sd(codec: Codec, ideal: Array, rest: Array) -> Array:
    """Extra sd (t,p,3) mm of patches with centres (t,p,2) px; none for one still at its rest (p,2) px."""
    state = states(ideal)[..., None]
    away = np.nan_to_num(np.hypot(*np.moveaxis(ideal - rest, -1, 0)))[..., None] > DRIFT_PX
    return np.where(
        state == FAST, codec.fast, np.where(state != REST, codec.creep, np.where(away, codec.held, 0.0))
    )


def codec_noise(
    film: Video,
    follower: Follower,
    followed: Followed,
    plane: Array,
    frame: list[int],
    points: list[int],
    progress: Progress | None,
) -> Codec:
    """Codec error, seen by coding the film's own frames once more.

    The 60 frames round the fastest motion, and the 60 in which most marks creep, are shifted off the block
    grid, coded again as the film was, and tracked again; the difference of the two places is what one pass of
    the codec does. The error differs with what a patch does, and no static film shows it: at rest P-frames
    hold one image and its error, a patch that creeps lags behind, a fast one is predicted.

    plane: (f,2) mm nominal places of the frame marks, rows `frame` of the marks.
    points: rows of the output.
    """
    name, crf = film.coding()
    if name in LOSSLESS:
        return Codec(*np.zeros((4, 3)))
    parts = []
    for first in _windows(followed.ideal, points):
        window = slice(first, min(first + WINDOW, len(followed.ideal)))
        again = np.array(list(_again(film, follower, followed, window, name, crf, progress)))
        ideal = centres(again, follower.centre)
        place = [
            to_plane(homographies(plane, pixels[:, frame]), pixels[:, points])
            for pixels in (ideal, followed.ideal[window])
        ]
        parts.append(((place[0] - place[1])[SETTLE:], states(followed.ideal)[window][SETTLE:, points]))
    return _with_creep(_terms(*parts[0]), parts)


def _windows(ideal: Array, points: list[int]) -> list[int]:
    """First frames of what is coded again: the fastest motion, and where most marks creep besides."""
    first = _fastest(ideal)
    creeping = _slow(states(ideal)[:, points]).sum(axis=1)
    count = np.convolve(creeping, np.ones(WINDOW, int), mode="valid") if len(ideal) > WINDOW else np.zeros(0)
    count = np.where(np.abs(np.arange(len(count)) - first) < WINDOW, 0, count)
    return [first, int(np.argmax(count))] if len(count) and count.max() > 0 else [first]


def _with_creep(terms: Codec, parts: list[tuple[Array, NDArray[np.int8]]]) -> Codec:
    """The terms of the first window, that of slow patches from all windows together, where it is more.

    What creeps through a hold, with the regulator's ripple, is not what comes to rest after a fast motion.
    """
    error = np.concatenate([own[_slow(state)] for own, state in parts])
    if len(error) < MIN_SAMPLES:
        return terms
    creep = np.fmax(terms.creep, with_y(_alike(FIRST_PASS * np.sqrt(_mean_square(error)))))
    return replace(terms, creep=creep, shared=_stays(parts, terms.shared))


def _stays(parts: list[tuple[Array, NDArray[np.int8]]], most: float) -> float:
    """Share of shaken patches' variance that stays: the correlation of their errors LAG frames apart."""
    products, powers, count = 0.0, 0.0, 0
    for error, state in parts:
        both = (state[LAG:] == SHAKEN) & (state[:-LAG] == SHAKEN)
        both &= np.isfinite(error[LAG:] + error[:-LAG]).all(axis=-1)
        after, before = error[LAG:][both], error[:-LAG][both]
        products += float(np.sum(after * before))
        powers += 0.5 * float(np.sum(after**2 + before**2))
        count += len(after)
    return float(np.clip(products / powers, 0.0, most)) if count >= MIN_SAMPLES and powers > 0 else most


def _terms(error: Array, state: NDArray[np.int8]) -> Codec:
    """Codec terms from the differences (t,p,2) mm of two passes and what the patches did (t,p).

    A patch that has come to rest keeps the error of its motion, which is larger than that of one that never
    moved.
    """
    never = (state == REST).all(axis=0)
    still = error[:, never]
    frozen = _mean_square(still.mean(axis=0))
    jitter = _mean_square(still - still.mean(axis=0))  # is in the static noise already
    everywhere = _mean_square(error[state != REST])
    come = (state == REST) & (np.cumsum(state != REST, axis=0) > 0)
    terms, kept = [], frozen + jitter
    for chosen, otherwise in ((state == FAST, everywhere), (_slow(state), everywhere), (come, kept)):
        enough = np.count_nonzero(chosen) >= MIN_SAMPLES
        terms.append(np.maximum((_mean_square(error[chosen]) if enough else otherwise) - jitter, frozen))
    fast, creep, held, rest = (with_y(_alike(FIRST_PASS * np.sqrt(term))) for term in (*terms, frozen))
    return Codec(fast, creep, held, rest)


def _alike(sd: Array) -> Array:
    """Sd (2,) of both axes, neither below ALIKE of the other: the windows show few ways to move, and a patch
    is late the way it moves."""
    return np.maximum(sd, ALIKE * sd[::-1])


def _slow(state: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Where patches creep, are shaken or pass."""
    return (state == CREEP) | (state == SHAKEN) | (state == PASSING)


def _mean_square(error: Array) -> Array:
    """Mean square (2,) over all values that are seen, 0 without any."""
    seen = error[np.isfinite(error).all(axis=-1)]
    return np.mean(seen**2, axis=0) if len(seen) else np.zeros(2)


def _fastest(ideal: Array) -> int:
    """First frame of the window whose middle is the fastest motion."""
    step = np.nan_to_num(np.abs(np.diff(ideal, axis=0)).sum(axis=2)).sum(axis=1)
    peak = int(np.argmax(step)) if len(step) else 0
    return int(np.clip(peak - WINDOW // 3, 0, max(len(ideal) - WINDOW, 0)))


def _again(
    film: Video,
    follower: Follower,
    followed: Followed,
    window: slice,
    name: str,
    crf: float,
    progress: Progress | None,
) -> Iterator[Array]:
    """Warps (p,3,3) in each frame of the window after one more pass of the codec."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "again.mkv"
        size = (film.width - film.width % 2, film.height - film.height % 2)
        with Writer(path, size, fps=10.0, codec=CODERS.get(name, "libx264"), crf=crf) as writer:
            for _, _, image in islice(film.frames(), window.start, window.stop):
                writer.add(_shifted(image)[: size[1], : size[0]])
        for index, _, image in Video(path).frames():
            at = window.start + index
            plain = ~np.isin(followed.method[at], COARSE)[:, None, None]
            yield _laid(image, follower, np.where(plain, followed.warp[at], np.nan))
            if progress is not None:
                progress("codec", index + 1, window.stop - window.start)


def _shifted(image: Image) -> Image:
    return np.roll(image, (int(SHIFT[1]), int(SHIFT[0])), axis=(0, 1))


def _laid(image: Image, follower: Follower, warp: Array) -> Array:
    """The coded marks registered anew in a shifted picture, started where they were."""
    rows = np.flatnonzero(np.isfinite(warp[follower.coded, 0, 0]))
    marks = follower.coded[rows]
    result = np.full(warp.shape, np.nan)
    result[marks], match = registration.register(
        image,
        registration.lens_of(follower.camera, (SHIFT[0], SHIFT[1])),
        follower.templates,
        warp[marks],
        px_per_unit(warp[marks]),
        rows,
    )
    result[marks[match < 0.5]] = np.nan
    return result
