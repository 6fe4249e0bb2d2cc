"""Error of lossy coding in the marks' places, from the film's own frames coded once more."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.errors.staticnoise import BETWEEN, states
from vision.film.checkpoint import Progress
from vision.film.packets import NAMES, Coding
from vision.film.video import Video, Writer
from vision.following import blurred, registration
from vision.following.reference import SURE, Follower
from vision.following.tracking import centres
from vision.following.tracks import COARSE, Followed, Method
from vision.marks import px_per_unit
from vision.plane import homographies, to_plane

Array8 = NDArray[np.int8]
# Where these numbers come from: docs/records/error-numbers.md
WINDOW = 60  # frames coded again
UNSEEN = 12  # last ones: coders look ahead, and spend less on what nothing is seen to refer to
SHIFT = np.array([5.0, 3.0])  # px, off every block grid
START, FINEST, COARSEST = 23.0, 1.0, 51.0  # rate factor tried first, and its range
COARSER, FINER = 4.5, 1.7  # of it to half the bytes, which edges take; to twice, where noise comes through
SEARCHED = 3 * UNSEEN  # frames in which the rate factor is searched: half of them are as inside a film
KEPT_GREY = 0.65  # grey levels left: x264's usual tuning leaves 0.5 at most, that for grain 0.7 at crf 18
CAMERA_GREY = 1.5  # grey levels, usual sd of a camera's noise: coding takes it away, and pays for it in bytes
CLOSE = 4.0  # rate factors, one too fine and one too coarse, between which their line tells the right one
NEAR = 0.2  # powers of two of the bytes, or rate factors, that are near enough: 15 % of the bytes


@dataclass(frozen=True)
class Again:
    """One stretch of the film, coded once more."""

    window: slice  # frames of the film
    error: Array  # (w,p,2) mm, place in the film coded again minus that in the film
    state: NDArray[np.int8]  # (w,p) what each patch did, from `states`
    level: float  # constant rate factor at which it has the film's bytes
    bytes_ratio: float  # its bytes over the film's


def coded_again(
    film: Video, follower: Follower, followed: Followed, plane: Array, frame: list[int], points: list[int],
    progress: Progress | None,
) -> list[Again]:  # fmt: skip
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
    level = None
    for start in windows(followed.ideal, state, points):
        window = slice(start, min(start + WINDOW, len(followed.ideal)))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "again.mp4"  # to open an mkv takes four times as long
            level, ratio = _matched(film, coding, window, level, path)
            inner = _inner(window.stop - window.start)
            shown = slice(window.start, window.start + inner.stop)
            again = np.array(list(_followed_again(path, follower, followed, shown, progress)))
        shift = moved_by(centres(again, follower.centre), followed.ideal[shown], plane, frame, points)
        result.append(Again(window, shift[inner], state[window][inner, points], level, ratio))
    return result


def moved_by(again: Array, before: Array, plane: Array, frame: list[int], points: list[int]) -> Array:
    """Shifts (w,p,2) mm in the plane of the marks `points`, from where they were to where they are again.

    again, before: (w,m,2) px of all marks.   plane: (f,2) mm nominal places of the marks `frame`.

    Both planes of a frame come from the same frame marks: another mark left out moves the whole plane by more
    than coding moves any mark. One that is lost only in the second pass is taken where it was: without it the
    others may have to extrapolate.
    """
    both = np.where(np.isnan(again) | np.isnan(before), before, again)
    old, new = (
        to_plane(homographies(plane, fixed[:, frame]), pixels[:, points])
        for fixed, pixels in ((before, before), (both, again))
    )
    return new - old


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
    fastest = _fastest(ideal)
    if len(ideal) <= WINDOW:
        return [fastest]
    slow = ((state[:, points] != 0) & (state[:, points] != 2)).sum(axis=1)
    count = np.convolve(slow, np.ones(WINDOW, int), mode="valid")
    count = np.where(np.abs(np.arange(len(count)) - fastest) < WINDOW, 0, count)
    return [fastest, int(np.argmax(count))] if count.max() > 0 else [fastest]


def _fastest(ideal: Array) -> int:
    """First frame of the window whose middle is the fastest motion."""
    step = np.nan_to_num(np.abs(np.diff(ideal, axis=0)).sum(axis=2)).sum(axis=1)
    peak = int(np.argmax(step)) if len(step) else 0
    return int(np.clip(peak - WINDOW // 3, 0, max(len(ideal) - WINDOW, 0)))


def _matched(
    film: Video, coding: Coding, window: slice, level: float | None, path: Path
) -> tuple[float, float]:
    """Writes the window, coded to about the film's own bytes; the rate factor, and its bytes over theirs.

    level: rate factor of another stretch, tried first; None to search it in the first frames.
    """
    # Kept in memory: a film is decoded from the last key frame before the window.
    pictures = [image for _, _, image in film.frames(window.start, window.stop)]
    noise = _noise_left(pictures)
    coding = replace(coding, grain=noise > KEPT_GREY)
    _disturb(pictures, float(np.sqrt(max(CAMERA_GREY**2 - noise**2, 0.0))), seed=window.start)
    if level is None:
        start = slice(window.start, min(window.start + SEARCHED, window.stop))
        level = _searched(lambda tried: _coded(pictures[:SEARCHED], coding, start, tried, path), START)
    off = _coded(pictures, coding, window, level, path)
    if abs(off) >= 2.0 * NEAR:  # less moves the error by 6 %, as little as other noise put back does
        level = float(np.clip(level + off * FINER, FINEST, COARSEST))
        off = _coded(pictures, coding, window, level, path)
    return level, 2.0**off


def _searched(off_at: Callable[[float], float], level: float) -> float:
    """Rate factor at which `off_at`, the logarithm of the bytes over those wanted, is nearly 0.

    It falls with the rate factor: guesses by its usual slope until one is above and one below, then false
    position, until these are CLOSE: the whole stretch is coded next, which tells what is left.
    """
    low, high = (FINEST, np.inf), (COARSEST, -np.inf)  # factors, and their logarithms
    before, tried = 0.0, np.inf
    while abs(level - tried) >= NEAR and abs(off := off_at(level)) >= NEAR:
        # Noise that only just comes through makes bytes steep: an end that stays counts half (Illinois).
        stays = 0.5 if off * before > 0 else 1.0
        if off > 0:
            low, high = (level, off), (high[0], stays * high[1])
        else:
            low, high = (low[0], stays * low[1]), (level, off)
        before, tried = off, level
        level = float(np.clip(level + off * (COARSER if off > 0 else FINER), FINEST, COARSEST))
        if np.isfinite(low[1]) and np.isfinite(high[1]):
            level = low[0] + (high[0] - low[0]) * low[1] / (low[1] - high[1])
            if high[0] - low[0] < CLOSE:
                break
    return level


def _coded(pictures: Sequence[Image], coding: Coding, window: slice, level: float, path: Path) -> float:
    """Writes the pictures of the window at that rate factor, but for the last, which do not count; logarithm
    (2) of their bytes over the film's."""
    encoder, options = coding.options(level)
    size, inner = (pictures[0].shape[1], pictures[0].shape[0]), _inner(len(pictures))
    with Writer(
        path, size, fps=coding.fps, codec=encoder, options=options, grey=True, shown=inner.stop
    ) as writer:
        for image in pictures:
            writer.add(image)
    again = Video(path).coding()
    target = _bytes(coding.size[window][inner], coding.key[window][inner])
    return float(np.log2(max(_bytes(again.size[inner], again.key[inner]), 1) / max(target, 1)))


def _inner(count: int) -> slice:
    """Frames of a stretch of that many that are coded as inside a film: not those near its key frame, nor the
    last, if there are others."""
    return slice(BETWEEN, count - UNSEEN if count > 2 * UNSEEN else count)


def _bytes(size: NDArray[np.intp], key: NDArray[np.bool_]) -> int:
    """Bytes of the frames that are no key frames; of all if all are."""
    return int(size[~key].sum()) if (~key).any() else int(size.sum())


def _disturb(pictures: list[Image], noise: float, *, seed: int) -> None:
    """Shifts the pictures off the block grid, in place, and adds noise of that sd in grey levels."""
    rng = np.random.default_rng(seed)
    height, width = (side - side % 2 for side in pictures[0].shape)
    rows = _noise_rows(noise, (width, height), rng)
    for k, image in enumerate(pictures):
        pictures[k] = _noisy(_shifted(image)[:height, :width], rows, rng)


def _noise_rows(sd: float, size: tuple[int, int], rng: np.random.Generator) -> Array8:
    """White noise of that sd in whole grey levels: one row for every four of the picture, twice as long."""
    rows = sd * rng.standard_normal((size[1] // 4 + 1, size[0]), dtype=np.float32)
    return np.tile(np.clip(np.rint(rows), -127, 127).astype(np.int8), 2)


def _noisy(image: Image, rows: Array8, rng: np.random.Generator) -> Image:
    """The picture with noise of rows that are drawn for it and shifted: to draw all anew takes longer than to
    code it."""
    turn = int(rng.integers(0, image.shape[1]))
    noise = rows[:, turn : turn + image.shape[1]][rng.integers(0, len(rows), len(image))]
    return np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), dtype=np.uint8)


def _noise_left(pictures: Sequence[Image]) -> float:
    """Sd in grey levels of the noise that a film's successive pictures still show, from the first of them.

    Their differences tell the noise; what moves are few of the pixels. In whole grey levels their median is
    too coarse: the mean square of all that are no larger than noise is taken.
    """
    sparse = [image[::4, ::4].astype(np.float32) for image in pictures[:4]]
    steps = [b - a for a, b in pairwise(sparse)]
    power = [float(np.mean(step[np.abs(step) < 4.0 * CAMERA_GREY] ** 2)) for step in steps]
    return float(np.sqrt(0.5 * np.median(power))) if power else 0.0


def _followed_again(
    path: Path, follower: Follower, followed: Followed, window: slice, progress: Progress | None
) -> Iterator[Array]:
    """Warps (p,3,3) in each frame of the window after one more pass of the codec."""
    count = window.stop - window.start
    for index, _, image in Video(path).frames(0, count):
        frame = window.start + index
        plain = ~np.isin(followed.method[frame], COARSE)[:, None, None]
        adjusted = followed.method[frame] == Method.ADJUSTED
        yield _laid(image, follower, np.where(plain, followed.warp[frame], np.nan), adjusted)
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
    result[marks], match, _, grey = registration.register_quarters(
        image, lens, follower.templates, warp[marks], px_per_unit(warp[marks]), rows
    )
    result[marks[match <= SURE]] = np.nan
    soft = adjusted[marks] & (match > SURE)
    each = blurred.adjust(
        image, lens, follower.templates, follower.spectra, rows[soft], start=result[marks[soft]],
        usual=follower.usual[rows[soft]], match=match[soft], grey=grey[soft],
    )  # fmt: skip
    for p, fit in zip(marks[soft], each, strict=True):
        result[p] = np.nan if fit is None else fit.warp
    return result
