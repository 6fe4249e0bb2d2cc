"""A film at a glance: where the coded marks are in some of its frames, by their corners alone, in seconds."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera, Image
from vision.film.picturefaults import combed
from vision.film.video import Video
from vision.following.firstpictures import START_FRAMES, check_size, check_start, first_seen
from vision.following.reference import reference_frames
from vision.marks import Mark, codes_of, detect_wanted

IN_REST, IN_REST_OF_FILM = 12, 30  # frames that are looked at
IN_FLICKER, SPARSE = 60, 4  # first frames of the rest whose pixels are compared, and every how many px


@dataclass(frozen=True)
class Glimpses:
    """Some frames of a film."""

    first: Image  # the first picture
    time: Array  # (k,) s
    ideal: Array  # (k,p,2) px, middle of the corners of each coded mark; NaN where its code is not read
    twice: NDArray[np.bool_]  # (k,p) where its code is read in several places, so that none is its own
    warp: Array  # (p,3,3) local to ideal px where each mark is first seen; NaN for one that is not
    rest: NDArray[np.bool_]  # (k,) frames of the reference
    unused: dict[int, Array]  # centres (2,) raw px in the first picture of ids that no mark has
    combs: Array  # (k,) share of the pixels in which odd and even rows show two moments
    flicker: float  # grey levels by which pixels change from frame to frame at rest, on average; NaN for one
    light: float  # share by which the picture's mean grey level does; NaN for one


def glimpses(
    film: Video, camera: Camera, marks: Sequence[Mark], *, dictionary: str, reference_s: float | None
) -> Glimpses:
    """Some frames of a film.   reference_s: length of its rest, s; None where all of it is rest.

    Raises ValueError as `prepare` does for another size than the camera's and for too short a rest.
    """
    check_size(film, camera)
    count = len(film.time)
    rest = np.arange(count) if reference_s is None else reference_frames(film, reference_s)
    wanted = sorted({
        *range(min(START_FRAMES, count)),
        *_even(rest, IN_REST),
        *_even(np.arange(count), IN_REST_OF_FILM),
    })  # fmt: skip
    coded = codes_of(marks)
    start: list[Image] = []
    rows: list[tuple[int, float, Array, list[bool], float]] = []
    unused: dict[int, Array] = {}
    for index, time, image in film.chosen(wanted):
        quads, several = detect_wanted(image, dictionary, coded.values())
        if len(start) < START_FRAMES:
            start.append(image)
        if not rows:
            unused = {code: quad.mean(axis=0) for code, quad in quads.items() if code not in coded.values()}
        place = np.full((len(marks), 2), np.nan)
        for p, code in coded.items():
            if code in quads:
                place[p] = camera.undistort(quads[code]).mean(axis=0)
        twofold = [coded.get(p) in several for p in range(len(marks))]
        rows.append((index, time, place, twofold, combed(image)))
    frames, times, places, twice, combs = zip(*rows, strict=True)
    warp = first_seen(start, camera, marks, dictionary)
    return Glimpses(
        start[0],
        np.array(times),
        np.array(places),
        np.array(twice),
        warp,
        np.isin(np.array(frames), rest),
        unused,
        np.array(combs),
        *_changes(film, min(len(rest), IN_FLICKER)),
    )


def check_glimpses(film: Video, seen: Glimpses, marks: Sequence[Mark], dictionary: str) -> None:
    """Raises ValueError, as `prepare` does, where the first frames show too few marks."""
    check_start(film, [seen.first], marks, dictionary, seen.warp)


def _changes(film: Video, count: int) -> tuple[float, float]:
    """Grey levels by which pixels change from one of the first frames to the next, on average, and the share
    by which the mean grey level does."""
    sparse = (image[::SPARSE, ::SPARSE].astype(np.float64) for _, _, image in film.frames(0, count))
    changes = [
        (np.abs(after - before).mean(), abs(after.mean() - before.mean()) / max(before.mean(), 1.0))
        for before, after in pairwise(sparse)
    ]
    pixels, light = np.mean(changes, axis=0) if changes else (np.nan, np.nan)
    return float(pixels), float(light)


def _even(frames: NDArray[np.intp], most: int) -> list[int]:
    return [
        int(frames[k]) for k in np.linspace(0, len(frames) - 1, min(len(frames), most)).round().astype(int)
    ]
