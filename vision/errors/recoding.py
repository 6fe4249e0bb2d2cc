"""What coding does to the marks' places, seen by coding the film's own frames once more."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.errors.noise import states
from vision.film.checkpoint import Progress
from vision.film.packets import NAMES, Coding
from vision.film.video import Video, Writer
from vision.following import blurred, registration
from vision.following.methods import COARSE, Method
from vision.following.reference import Follower
from vision.following.tracks import Followed, centres
from vision.marks import px_per_unit
from vision.plane import homographies, to_plane

WINDOW = 60  # frames coded again
SETTLE = 5  # first frames of the window, near its key frame, left out
SHIFT = np.array([5.0, 3.0])  # px, off every block grid
START, FINEST, COARSEST = 23.0, 1.0, 51.0  # rate factor tried first, and its range
OCTAVE = 4.0  # more of it halve the bytes: 6 where the picture's edges take them, 3 where its noise does
TRIES = 4
KEPT_GREY = (
    0.65  # grey levels left: x264's usual tuning leaves 0.5 at most, that for grain 0.7 and more at crf 18
)
CAMERA_GREY = 1.5  # grey levels, usual sd of a camera's noise: coding takes it away, and pays for it in bytes
NEAR = 0.2  # powers of two of the bytes that are near enough: a step of the quantiser by 15 %


@dataclass(frozen=True)
class Again:
    """One stretch of the film, coded once more."""

    window: slice  # frames of the film
    error: Array  # (w,p,2) mm, place in the film coded again minus that in the film
    state: NDArray[np.int8]  # (w,p) what each patch did, from `states`
    level: float  # constant rate factor at which it has the film's bytes
    bytes_ratio: float  # its bytes over the film's


def coded_again(
    film: Video,
    follower: Follower,
    followed: Followed,
    plane: Array,
    frame: list[int],
    points: list[int],
    progress: Progress | None,
) -> list[Again]:
    """The stretches round the fastest motion and where most marks move slowly; none for a lossless film.

    They are shifted off the block grid, get the noise back that coding took from them, are coded with the
    film's own B-frames, key frames and bytes a frame, and tracked again: the difference of the two places is
    what one pass of the codec does, and the camera's noise where it moves.

    plane: (f,2) mm nominal places of the frame marks, rows `frame` of the marks.
    points: rows of the output.
    """
    coding, state, result = film.coding(), states(followed.ideal), []
    if coding.lossless:
        return []
    level = START
    for first in windows(followed.ideal, state, points):
        window = slice(first, min(first + WINDOW, len(followed.ideal)))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "again.mkv"
            level, ratio = _matched(film, coding, window, level, path)
            again = np.array(list(_followed_again(path, follower, followed, window, progress)))
        place = [
            to_plane(homographies(plane, pixels[:, frame]), pixels[:, points])
            for pixels in (centres(again, follower.centre), followed.ideal[window])
        ]
        own = place[0] - place[1]
        result.append(Again(window, own[SETTLE:], state[window][SETTLE:, points], level, ratio))
    return result


def described(film: Video, parts: Sequence[Again]) -> tuple[str, ...]:
    """A sentence about how the film was coded and coded again; none for a lossless film."""
    if not parts:
        return ()
    coding = film.coding()
    encoder = NAMES["hevc" if coding.codec == "hevc" else "h264"]
    stretches = " and ".join(
        f"at {film.time[part.window.start]:.1f} s (crf {part.level:.0f}, {part.bytes_ratio:.2f} of its bytes)"
        for part in parts
    )
    return (
        f"{film.path.name} is {coding.described()}. Its compression error comes from stretches that were "
        f"coded once more by {encoder} in the same way, {stretches}.",
    )


def windows(ideal: Array, state: NDArray[np.int8], points: Sequence[int]) -> list[int]:
    """First frames of what is coded again: the fastest motion, and where most marks move slowly besides.

    ideal: (t,m,2) px.   state: (t,m).
    """
    first = _fastest(ideal)
    if len(ideal) <= WINDOW:
        return [first]
    slow = ((state[:, points] != 0) & (state[:, points] != 2)).sum(axis=1)
    count = np.convolve(slow, np.ones(WINDOW, int), mode="valid")
    count = np.where(np.abs(np.arange(len(count)) - first) < WINDOW, 0, count)
    return [first, int(np.argmax(count))] if count.max() > 0 else [first]


def _fastest(ideal: Array) -> int:
    """First frame of the window whose middle is the fastest motion."""
    step = np.nan_to_num(np.abs(np.diff(ideal, axis=0)).sum(axis=2)).sum(axis=1)
    peak = int(np.argmax(step)) if len(step) else 0
    return int(np.clip(peak - WINDOW // 3, 0, max(len(ideal) - WINDOW, 0)))


def _matched(film: Video, coding: Coding, window: slice, level: float, path: Path) -> tuple[float, float]:
    """Writes the window, coded to about the film's own bytes; the rate factor, and its bytes over theirs.

    level: rate factor that is tried first.
    The logarithm of the bytes falls with the rate factor, the faster the more noise is left: false position.
    """
    wanted = max(_bytes(coding.size[window], coding.key[window]), 1)
    left = _noise_left(film, window)
    coding = replace(coding, grain=left > KEPT_GREY)
    noise = float(np.sqrt(max(CAMERA_GREY**2 - left**2, 0.0)))
    low, high = (FINEST, np.inf), (COARSEST, -np.inf)  # factors, and the logarithms of their bytes
    off = np.inf
    for _ in range(TRIES):
        _write(film, coding, window, level, noise, path)
        again = Video(path).coding()
        off = float(np.log2(max(_bytes(again.size, again.key), 1) / wanted))
        low, high = ((level, off), high) if off > 0 else (low, (level, off))
        guess = level + off * OCTAVE
        if np.isfinite(low[1]) and np.isfinite(high[1]):
            guess = low[0] + (high[0] - low[0]) * low[1] / (low[1] - high[1])
        guess = float(np.clip(guess, FINEST, COARSEST))
        if abs(off) < NEAR or guess == level:
            break
        level = guess
    return level, 2.0**off


def _bytes(size: NDArray[np.intp], key: NDArray[np.bool_]) -> int:
    """Bytes of the frames that are no key frames, without those at the window's start; of all if all are."""
    size, key = size[SETTLE:], key[SETTLE:]
    return int(size[~key].sum()) if (~key).any() else int(size.sum())


def _write(film: Video, coding: Coding, window: slice, level: float, noise: float, path: Path) -> None:
    size = (film.width - film.width % 2, film.height - film.height % 2)
    encoder, options = coding.options(level)
    rng = np.random.default_rng(window.start)
    with Writer(path, size, fps=coding.fps, codec=encoder, options=options) as writer:
        for _, _, image in film.frames(window.start, window.stop):
            writer.add(_noisy(_shifted(image)[: size[1], : size[0]], noise, rng))


def _noisy(image: Image, sd: float, rng: np.random.Generator) -> Image:
    """The picture with white noise of that sd in grey levels; random numbers for one row in eight."""
    if not sd > 0.0:
        return image
    drawn = np.float32(sd) * rng.standard_normal((len(image) // 8 + 1, image.shape[1]), dtype=np.float32)
    order = rng.integers(0, len(drawn), len(image))
    turn = rng.integers(0, image.shape[1])
    noise = np.roll(drawn, turn, axis=1)[order]
    return np.asarray(np.clip(np.rint(image + noise), 0, 255), dtype=np.uint8)


def _noise_left(film: Video, window: slice) -> float:
    """Sd in grey levels of the noise that the film's frames still show.

    Differences of successive frames tell the noise; what moves are few of the pixels. In whole grey levels
    their median is too coarse: the mean square of all that are no larger than noise is taken.
    """
    first = film.frames(window.start, window.start + 4)
    pictures = [image[::4, ::4].astype(np.float32) for _, _, image in first]
    steps = [b - a for a, b in pairwise(pictures)]
    power = [float(np.mean(step[np.abs(step) < 4.0 * CAMERA_GREY] ** 2)) for step in steps]
    return float(np.sqrt(0.5 * np.median(power))) if power else 0.0


def _followed_again(
    path: Path, follower: Follower, followed: Followed, window: slice, progress: Progress | None
) -> Iterator[Array]:
    """Warps (p,3,3) in each frame of the window after one more pass of the codec."""
    count = window.stop - window.start
    for index, _, image in Video(path).frames(0, count):
        at = window.start + index
        plain = ~np.isin(followed.method[at], COARSE)[:, None, None]
        adjusted = followed.method[at] == Method.ADJUSTED
        yield _laid(image, follower, np.where(plain, followed.warp[at], np.nan), adjusted)
        if progress is not None:
            progress("codec", index + 1, count)


def _shifted(image: Image) -> Image:
    return np.roll(image, (int(SHIFT[1]), int(SHIFT[0])), axis=(0, 1))


def _laid(image: Image, follower: Follower, warp: Array, adjusted: NDArray[np.bool_]) -> Array:
    """The coded marks registered anew in a shifted picture, started where they were.

    adjusted: (p,) those whose blur and light were fitted, as they are now; without it they would lie aside.
    """
    rows = np.flatnonzero(np.isfinite(warp[follower.coded, 0, 0]))
    marks = follower.coded[rows]
    result = np.full(warp.shape, np.nan)
    lens = registration.lens_of(follower.camera, (SHIFT[0], SHIFT[1]))
    result[marks], match = registration.register(
        image, lens, follower.templates, warp[marks], px_per_unit(warp[marks]), rows
    )
    result[marks[match < 0.5]] = np.nan
    for k in np.flatnonzero(adjusted[marks] & (match >= 0.5)).tolist():
        found = blurred.adjust(
            image, lens, follower.templates, follower.spectra, int(rows[k]), start=result[marks[k]],
            usual=float(follower.usual[rows[k]]), match=float(match[k]),
        )  # fmt: skip
        result[marks[k]] = np.nan if found is None else found.warp
    return result
