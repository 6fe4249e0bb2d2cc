"""Reference patches: each mark averaged over the first seconds of a film, and where its true centre is."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera, Image
from vision.dictionaries import dictionary_of
from vision.film.video import Video
from vision.following import blurred, registration
from vision.following.dots import Dot
from vision.following.firstpictures import START_FRAMES, check_size, check_start, find_missing, unseen
from vision.following.influence import Quarters, quarters
from vision.following.printedpattern import CELLS_BEYOND, printed_centres
from vision.marks import Mark, codes_of, detect, px_per_unit, registered_of

MIN_REFERENCE = 10
MAX_REFERENCE = 40  # frames averaged into the reference patches; more gain nothing against the codec
# Covering 6 % of a marker lowers its correlation to 0.97 and moves it by up to 0.07 px; motion blur of 5 px
# leaves 0.98 and 0.01 px.
MIN_CORRELATION = 0.97
SURE = 0.87  # another marker of the dictionary reaches 0.86; noisy film may not go below this


@dataclass(frozen=True, kw_only=True)
class Follower:
    """Reference patches of one film and how to lay them on a picture."""

    camera: Camera
    marks: tuple[Mark, ...]
    dictionary: str
    seed: Array  # (p,3,3) local to ideal px in the first reference frame; NaN when never found
    templates: registration.Templates  # of the coded marks and natural features, in their order
    coded: NDArray[np.intp]  # their rows
    centre: Array  # (p,2) local coordinates of the mark's centre
    dots: dict[int, Dot]  # by row of the marks, as the first frame shows them
    least: Array  # (coded,) correlation below which a coded mark is not believed
    quarters: Quarters  # of the templates
    spectra: blurred.Spectra  # of the templates
    usual: Array  # (coded,) share of a patch's power that its fit leaves at rest


def prepare(
    film: Video, camera: Camera, marks: Sequence[Mark], *, dictionary: str, reference_s: float
) -> Follower:
    """Reference patches: each mark averaged over the film's first reference_s seconds, and its true centre.

    Raises ValueError when no marker is seen (says which other dictionary finds some), when fewer than 10
    frames make the reference, or when the picture's size is not the camera's.
    """
    check_size(film, camera)
    reference = reference_frames(film, reference_s)
    coded = np.array(registered_of(marks), dtype=np.intp)
    seed, dots, single = _start(film, camera, marks, dictionary, coded)
    mean, least, usual = _average(
        islice(film.frames(), min(len(reference), MAX_REFERENCE)), camera, single, seed[coded]
    )
    templates = registration.templates(mean, single.grid)
    centre = np.zeros((len(marks), 2))
    codes = codes_of(marks)
    printed = np.flatnonzero(np.isin(coded, list(codes)))  # the middle of a natural feature is its centre
    centre[coded[printed]] = printed_centres(
        mean[printed, 0], single.grid, list(codes.values()), dictionary, px_per_unit(seed[coded[printed]])
    )
    return Follower(
        camera=camera,
        marks=tuple(marks),
        dictionary=dictionary,
        seed=seed,
        templates=templates,
        coded=coded,
        centre=centre,
        dots=dots,
        least=least,
        quarters=quarters(templates),
        spectra=blurred.spectra(templates),
        usual=usual,
    )


def _average(
    frames: Iterable[tuple[int, float, Image]], camera: Camera, single: registration.Templates, seed: Array
) -> tuple[Array, Array, Array]:
    """Mean patches with slopes (p,3,n) of the frames, the least correlation (p,) to believe a match, and the
    share (p,) of a patch's power that its fit to the mean leaves.

    A single frame's patch, with which they are compared, is as noisy as they are: it leaves twice as much.
    """
    total, (count, match_sum) = np.zeros((len(seed), 3, single.grid.shape[1])), np.zeros((2, len(seed)))
    seen, lens = np.flatnonzero(np.isfinite(seed[:, 0, 0])), registration.lens_of(camera)
    for _, _, image in frames:
        warp, match = registration.register(image, lens, single, seed[seen], px_per_unit(seed[seen]), seen)
        good = match > SURE
        total[seen[good]] += registration.patches(image, lens, warp[good], single.grid)
        count[seen[good]] += 1
        match_sum[seen[good]] += match[good]
    mean = total / np.maximum(count, 1)[:, None, None]
    mean[count == 0] = _blank(single.grid)
    usual = match_sum / np.maximum(count, 1)
    least = np.maximum(np.minimum(MIN_CORRELATION, 1.0 - 4.0 * (1.0 - usual)), SURE)
    return mean, least, 0.5 * (1.0 - np.minimum(usual, 1.0) ** 2)


def reference_frames(film: Video, reference_s: float) -> NDArray[np.intp]:
    """Frames of the first reference_s seconds; raises ValueError for fewer than 10."""
    frames = np.flatnonzero(film.time <= film.time[0] + reference_s)
    if len(frames) < MIN_REFERENCE:
        raise ValueError(
            f"film {film.path.name} has {len(frames)} frames in its first {reference_s} s, wanted "
            f"{MIN_REFERENCE} for the reference: keep the finger at rest longer or raise reference_s"
        )
    return frames


def _start(
    film: Video, camera: Camera, marks: Sequence[Mark], dictionary: str, coded: NDArray[np.intp]
) -> tuple[Array, dict[int, Dot], registration.Templates]:
    """First warps (p,3,3), dots and templates from the frame in which each mark is first seen."""
    seed: Array = np.full((len(marks), 3, 3), np.nan)
    dots: dict[int, Dot] = {}
    patch, grid, looked = None, np.empty(0), []
    for _, _, image in islice(film.frames(), START_FRAMES):
        fresh = find_missing(image, camera, marks, dictionary, seed, dots)
        looked.append(image)
        if not np.isfinite(seed[coded]).any():
            continue
        if patch is None:
            grid = registration.local_grid(*_grid_size(seed[coded], dictionary))
            patch = np.tile(_blank(grid), (len(coded), 1, 1))
        new = np.flatnonzero(fresh[coded])
        patch[new] = registration.patches(image, registration.lens_of(camera), seed[coded[new]], grid)
        if np.isfinite(seed).all():
            break
    check_start(film, looked, marks, dictionary, seed)
    assert patch is not None  # else it would have raised
    return seed, dots, registration.templates(patch, grid)


def check_fingers_seen(film: Video, follower: Follower) -> None:
    """Raises ValueError for a mark of the finger that the film's first frames do not show: it has no
    reference, and is lost for good. Names the ids that are seen and stand for no mark."""
    gone = [m for m, w in zip(follower.marks, follower.seed, strict=True)
            if m.role == "finger" and np.isnan(w[0, 0])]  # fmt: skip
    if gone:
        image = next(iter(film.frames()))[2]
        seen = set(detect(image, follower.dictionary)[0])
        raise ValueError(unseen(film.path.name, gone, follower.marks, seen))


def _grid_size(seed: Array, dictionary: str) -> tuple[int, float]:
    """Points along a side of the patch (about one per px) and its half side in local units."""
    half = 1.0 + CELLS_BEYOND * 2.0 / (dictionary_of(dictionary).markerSize + 2)
    return int(np.clip(np.ceil(2.0 * half * np.nanmedian(px_per_unit(seed))), 24, 160)), half


def _blank(grid: Array) -> Array:
    """A patch (3,n) that can be normalised and matches nothing: for marks that were never seen."""
    x, y, _ = grid
    return np.stack(
        [np.sin(9 * x) * np.sin(7 * y), 9 * np.cos(9 * x) * np.sin(7 * y), 7 * np.sin(9 * x) * np.cos(7 * y)]
    )
