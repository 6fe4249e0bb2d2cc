"""What drawn films say about the numbers of the coding error in `vision/errors`.

    python benchmarks/films/codingnumbers.py [--quick] [--seed N] [--folder FOLDER]

Films of `coding` are followed without loss, then as x264, x265 and phones code them: the difference is the
error of coding. The table has the median of all films of a kind of coding and, in brackets, the least and the
largest.
"""

import os
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.films import coding as films

import numpy as np
from numpy.typing import NDArray

from vision import Video
from vision.errors import codingdrift, codingvariance, reencoding, sharederrors, staticnoise
from vision.errors.staticnoise import CREEP, REST, SHAKEN, states
from vision.film.video import Writer
from vision.following.reference import Follower, prepare
from vision.following.tracking import follow
from vision.following.tracks import Followed
from vision.marks import frame_places, rows_of

Array = NDArray[np.float64]
PX_PER_MM = films.FOCAL / films.AWAY
USED = {
    "SETTLED: frames 0 to 9 off their mean, over 30 to 49": f"{staticnoise.SETTLED} frames",
    "SETTLED: the same, frames 10 to 19": f"{staticnoise.SETTLED} frames",
    "DRIFT_PX: median wander in ten frames at rest, px": f"{staticnoise.DRIFT_PX}",
    "CREEP_SHARED: correlation while creeping, 1 frame apart": f"{sharederrors.CREEP_SHARED}",
    "CREEP_SHARED: the same, 10 frames apart": f"{sharederrors.CREEP_SHARED}",
    "CREEP_SHARED: while shaken, 3 frames apart": f"{sharederrors.CREEP_SHARED} at most",
    "STOPS: rms error after a stop over slow motion": f"{codingvariance.STOPS}",
    "FRESH: variance new at a key frame over coding again": f"{codingdrift.FRESH}",
    "SLOW: variance new in 40 frames over the same": f"{codingdrift.SLOW}",
    "UNSEEN: rms error, last 12 of 60 frames over the middle": f"{reencoding.UNSEEN} frames",
    "UNSEEN: bytes of these": f"{reencoding.UNSEEN} frames",
    "BETWEEN: rms error, first 5 of 60 frames over the middle": f"{staticnoise.BETWEEN} frames",
    "KEPT_GREY: grey levels of noise left": f"{reencoding.KEPT_GREY} at most",
    "KEPT_GREY: with tune=grain, crf 18": f"{reencoding.KEPT_GREY} at least",
    "COARSER: steps of the rate factor to half the bytes": f"{reencoding.COARSER}",
    "FINER: steps of the rate factor to twice the bytes": f"{reencoding.FINER}",
}


def rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def follower_of(film: Video, seed: int) -> Follower:
    camera, _, marks = films.laboratory(seed)
    return prepare(film, camera, marks, dictionary="DICT_4X4_50", reference_s=films.REST_S)


def followed(film: Video, seed: int) -> Followed:
    return follow(film, follower_of(film, seed), reference_s=films.REST_S, stage="film")


def cut(film: Video, path: Path, first: int, stop: int) -> Path:
    """Part of a film, without loss."""
    with Writer(path, (film.width, film.height), fps=30.0, codec="ffv1") as writer:
        for _, _, image in film.frames(first, stop):
            writer.add(image)
    return path


def together(error: Array, which: NDArray[np.bool_], lag: int) -> float:
    """Correlation of errors (t,m,2) that many frames apart, where a marker is in that state throughout."""
    both = which[lag:] & which[:-lag]
    both &= np.lib.stride_tricks.sliding_window_view(which, lag + 1, axis=0).all(axis=-1)
    a, b = error[lag:][both], error[:-lag][both]
    return float(np.nansum(a * b) / np.nansum(0.5 * (a**2 + b**2))) if len(a) > 10 else np.nan


def of_film(error: Array, state: NDArray[np.int8], keys: list[int], coded: float) -> Iterator[float]:
    """The first nine rows of one film.

    error: (t,m,2) px.   state: (t,m).   keys: rare key frames.   coded: px2, left at rest by coding again.
    """
    begins, end = error[:50], staticnoise.SETTLED + staticnoise.BETWEEN
    moves, never = (state != REST).any(axis=0), ~(state[end:] != REST).any(axis=0)
    late = begins[30:] - begins[30:].mean(axis=0)
    for part in (begins[:10], begins[10:20]):
        yield rms(part - begins[30:].mean(axis=0)) / max(rms(late), 1e-9)
    still = error[10:50]
    yield float(np.median(np.hypot(*np.moveaxis(still[10:] - still[:-10], -1, 0))))
    for which, lag in ((CREEP, 1), (CREEP, 10), (SHAKEN, 3)):
        yield together(error, state == which, lag)
    after = (state == REST) & (np.cumsum(state != REST, axis=0) > end) & moves
    slow = ((state == CREEP) | (state == SHAKEN)) & moves
    yield rms(error[after]) / rms(error[slow]) if after.any() else np.nan
    block, own = codingdrift.BLOCK, error[:, never]
    white = 0.5 * float(np.nanmean(np.diff(own, axis=0) ** 2)) / block
    steps = [own[k : k + block].mean(axis=0) - own[k - block : k].mean(axis=0) for k in keys]
    yield (0.5 * float(np.nanmean(np.array(steps) ** 2)) - white) / coded if steps else np.nan
    edges = range(0, min([*keys, len(own)]) - block, block)
    means = np.array([own[k : k + block].mean(axis=0) for k in edges])
    often = len(edges) < 3 or not keys
    yield np.nan if often else (0.5 * float(np.nanmean(np.diff(means, axis=0) ** 2)) - white) / coded


def of_window(folder: Path, plain: Video, film: Video, way: films.Way, seed: int) -> Iterator[float]:
    """The rows of 60 frames coded alone, and of the noise and the bytes that coding leaves."""
    part = cut(plain, folder / "part.mkv", 60, 120)
    again = Video(films.coded(part, folder / "window.mkv", way))
    error = followed(again, seed).ideal - followed(Video(part), seed).ideal
    yield rms(error[48:]) / rms(error[12:36])
    size = again.coding().size.astype(float)
    yield float(size[48:].mean() / size[12:36].mean())
    yield rms(error[:5]) / rms(error[12:36])
    yield reencoding._noise_left([image for _, _, image in film.frames(60, 64)])
    grain = films.Way("libx264", {"crf": "18", "tune": "grain"})
    one = Video(films.coded(part, folder / "grain.mkv", grain))
    yield reencoding._noise_left([image for _, _, image in one.frames(0, 4)])
    coding, window = film.coding(), slice(60, 120)
    path = folder / "again.mkv"
    level, _ = reencoding._matched(film, coding, window, None, path)
    pictures = [image for _, _, image in film.frames(60, 120)]
    left = reencoding._noise_left(pictures)
    coding = replace(coding, grain=left > reencoding.KEPT_GREY)
    reencoding._disturb(pictures, max(reencoding.CAMERA_GREY**2 - left**2, 0.0) ** 0.5, seed=60)
    off = [reencoding._coded(pictures, coding, window, level + more, path) for more in (-2.0, 0.0, 4.0)]
    yield 4.0 / (off[1] - off[2])
    yield 2.0 / (off[0] - off[1])


def left_at_rest(film: Video, again: Followed, seed: int) -> float:
    """Mean square error, px2, that coding the film once more leaves in markers at rest."""
    frame, points = rows_of(films.laboratory(seed)[2])
    ready, nominal = follower_of(film, seed), frame_places(films.laboratory(seed)[2])
    terms = codingvariance.codec_terms(
        reencoding.coded_again(film, ready, again, nominal, frame, points, None)
    )
    return float(np.mean(terms.rest[[0, 2]] ** 2)) * PX_PER_MM**2


def table(quick: bool, seed: int, folder: Path) -> dict[str, dict[str, list[float]]]:
    """Row to kind of coding to one value a film."""
    found: dict[str, dict[str, list[float]]] = {row: defaultdict(list) for row in USED}
    truth: dict[int, Followed] = {}
    for kind, ways in (films.QUICK if quick else films.FULL).items():
        for way in ways:
            drawn, _ = films.draw(folder, seed, way.fps)
            plain = Video(drawn)
            if way.fps not in truth:
                truth[way.fps] = followed(plain, seed)
            film = Video(films.coded(drawn, folder / "coded.mkv", way))
            coding, again, true = film.coding(), followed(film, seed), truth[way.fps].ideal
            keys = [k for k in film.keys().tolist() if 40 <= k <= len(film.time) - 10]
            rare = keys if coding.every >= codingdrift.LONG else []
            own = of_film(again.ideal - true, states(true), rare, left_at_rest(film, again, seed))
            values = [*own, *of_window(folder, plain, film, way, seed)]
            for row, value in zip(USED, values, strict=True):
                found[row][kind].append(value)
    return found


def main() -> None:
    """Print the table."""
    more = {"--seed": (1, "of the drawn films"), "--folder": (Path, "where drawn films are kept")}
    typed = options(__doc__, more, quick="four ways of coding in place of 19")
    with tempfile.TemporaryDirectory() as place:
        found = table(typed.quick, typed.seed, typed.folder or Path(place))
    kinds = list(films.FULL)
    print(f"| number | used | {' | '.join(kinds)} |\n|---|---|{'---|' * len(kinds)}")
    for row, used in USED.items():
        cells = []
        for kind in kinds:
            values = np.array([v for v in found[row][kind] if np.isfinite(v)])
            cells.append(
                f"{np.median(values):.2g} ({values.min():.2g} to {values.max():.2g})" if len(values) else ""
            )
        print(f"| {row} | {used} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
