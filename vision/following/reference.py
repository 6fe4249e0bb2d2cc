"""Reference patches: each mark averaged over the first seconds of a film, and where its true centre is."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from vision.boards.board import flipped
from vision.camera import Array, Camera, Image
from vision.dictionaries import dictionary_of, other_dictionary
from vision.film.picturefaults import picture_trouble
from vision.film.video import Video
from vision.following import blurred, registration
from vision.following.dots import Dot, find_dots
from vision.following.identity import GATE, assign
from vision.following.printed import CELLS_BEYOND, printed_centres
from vision.following.repeated import told_apart
from vision.following.uneven import Quarters, quarters
from vision.marks import (
    Mark,
    codes_of,
    corner_warp,
    detect,
    dot_warp,
    dots_of,
    patches_of,
    px_per_unit,
    registered_of,
)
from vision.plane import MIN_VISIBLE, fit_homography

MIN_REFERENCE = 10
MAX_REFERENCE = 40  # frames averaged into the reference patches; more gain nothing against the codec
START_FRAMES = 5  # frames searched for marks that the first one does not show
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
    own = np.flatnonzero(np.isin(coded, list(codes)))  # the middle of a natural feature is its centre
    centre[coded[own]] = printed_centres(
        mean[own, 0], single.grid, list(codes.values()), dictionary, px_per_unit(seed[coded[own]])
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
    total, count, match_sum = (
        np.zeros((len(seed), 3, single.grid.shape[1])),
        np.zeros(len(seed)),
        np.zeros(len(seed)),
    )
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
        fresh = _seed(image, camera, marks, dictionary, seed, dots)
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
    if np.isfinite(seed[coded, 0, 0]).sum() < 0.5 * len(coded):
        _check_mirrored(film, looked[0], dictionary)
    check_start(film, looked, marks, dictionary, seed)
    assert patch is not None  # else it would have raised
    return seed, dots, registration.templates(patch, grid)


def _seed(
    image: Image,
    camera: Camera,
    marks: Sequence[Mark],
    dictionary: str,
    seed: Array,
    dots: dict[int, Dot],
) -> NDArray[np.bool_]:
    """Fill the warps of marks that the picture shows and that were missing; says which were filled."""
    missing = np.isnan(seed[:, 0, 0])
    found, _ = detect(image, dictionary)
    for p, code in codes_of(marks).items():
        if missing[p] and code in found:
            seed[p] = corner_warp(camera.undistort(found[code]))
    for p, warp in told_apart(image, camera, marks, dictionary, seed).items():
        seed[p] = warp
    _seed_patches(marks, seed)
    _seed_dots(image, camera, marks, seed, dots)
    return missing & np.isfinite(seed[:, 0, 0])


def _seed_patches(marks: Sequence[Mark], seed: Array) -> None:
    """Lay missing natural features where the frame marks say that they were picked, upright to +y."""
    frame = [p for p, mark in enumerate(marks) if mark.role == "frame" and np.isfinite(seed[p, 0, 0])]
    missing = {p: kind for p, kind in patches_of(marks).items() if np.isnan(seed[p, 0, 0])}
    if len(frame) < MIN_VISIBLE or not missing:
        return
    nominal = np.array([mark.position for mark in marks])[:, [0, 2]]
    homography = fit_homography(nominal[frame], seed[frame, :2, 2])
    for p, kind in missing.items():
        half, (x, z) = 0.5 * kind.size_mm, kind.seen_mm
        warp = homography @ np.array([[-half, 0.0, x], [0.0, -half, z], [0.0, 0.0, 1.0]])
        seed[p] = warp / warp[2, 2]


def _seed_dots(
    image: Image, camera: Camera, marks: Sequence[Mark], seed: Array, dots: dict[int, Dot]
) -> None:
    """Look for missing dots where the frame marks say that they should be, dark or light ones."""
    frame = [p for p, mark in enumerate(marks) if mark.role == "frame" and np.isfinite(seed[p, 0, 0])]
    missing = [p for p in dots_of(marks) if np.isnan(seed[p, 0, 0])]
    if len(frame) < 4 or not missing:
        return
    nominal = np.array([mark.position for mark in marks])[:, [0, 2]]
    homography = fit_homography(nominal[frame], seed[frame, :2, 2])
    guess = _in_picture(homography, nominal)
    size = np.array([mark.size_mm for mark in marks])
    rim = _in_picture(homography, nominal + 0.5 * size[:, None] * (1.0, 0.0))
    radius = np.linalg.norm(rim - guess, axis=1)
    found: list[Dot] = []
    for p in missing:
        for is_dark in (True, False):
            seen = find_dots(
                image, camera, guess[p], np.full(2, radius[p]), search=2.0 * radius[p], dark=is_dark
            )
            found += [
                d for d in seen if all(np.hypot(*(d.centre - f.centre)) > 0.5 * d.radius for f in found)
            ]
    apart = np.linalg.norm(guess[missing][:, None] - guess[missing][None], axis=-1) + np.diag(
        [np.inf] * len(missing)
    )
    gate = np.minimum(2.0 * radius[missing], GATE * apart.min(axis=1))
    chosen, _ = assign(guess[missing], np.array([dot.centre for dot in found]).reshape(-1, 2), gate)
    for p, j in zip(missing, chosen, strict=True):
        if j >= 0:
            seed[p], dots[p] = dot_warp(found[j].centre, found[j].radius), found[j]


def _in_picture(homography: Array, places: Array) -> Array:
    """Ideal pixels (n,2) of places (n,2) mm in the plane."""
    return registration.project(homography, np.concatenate([places.T, np.ones((1, len(places)))]))


def check_size(film: Video, camera: Camera) -> None:
    """Raises ValueError for a film of another size than the camera was calibrated with."""
    if (film.width, film.height) != tuple(camera.size):
        raise ValueError(
            f"film {film.path.name} has {film.width} x {film.height} px, the camera was calibrated with "
            f"{camera.size[0]} x {camera.size[1]}: film and boards must come from the same setting"
        )


def first_seen(pictures: Sequence[Image], camera: Camera, marks: Sequence[Mark], dictionary: str) -> Array:
    """Warps (p,3,3), local to ideal px, of every mark in the first picture that shows it; else NaN."""
    seed: Array = np.full((len(marks), 3, 3), np.nan)
    for picture in pictures:
        _seed(picture, camera, marks, dictionary, seed, {})
        if np.isfinite(seed).all():
            break
    return seed


def check_start(
    film: Video, looked: Sequence[Image], marks: Sequence[Mark], dictionary: str, seed: Array
) -> None:
    """Raises ValueError where the first pictures show no coded mark, one twice, or too few of the frame."""
    if np.isnan(seed[list(codes_of(marks)), 0, 0]).all():
        raise ValueError(_none_found(film, looked, dictionary))
    missing = {code for p, code in codes_of(marks).items() if np.isnan(seed[p, 0, 0])}
    twice = detect(looked[0], dictionary)[1] & missing
    if twice:
        raise ValueError(
            f"film {film.path.name} shows marker {min(twice)} more than once: print and glue every id once"
        )
    frame = [np.isfinite(warp[0, 0]) for mark, warp in zip(marks, seed, strict=True) if mark.role == "frame"]
    if sum(frame) < MIN_VISIBLE:
        raise ValueError(
            f"film {film.path.name} shows {sum(frame)} of {len(frame)} frame markers at its start, wanted at "
            f"least {MIN_VISIBLE}: uncover them, and check their ids and the dictionary {dictionary}"
            + (f"; {trouble}" if (trouble := picture_trouble(looked[0])) else "")
        )


def _check_mirrored(film: Video, first: Image, dictionary: str) -> None:
    """Raises ValueError for a film that shows its markers left for right: at most chance shows one then."""
    seen, turned = (len(detect(picture, dictionary)[0]) for picture in (first, flipped(first)))
    if turned >= MIN_VISIBLE and turned > 2 * seen:
        raise ValueError(
            f"film {film.path.name} shows {seen} markers of {dictionary}, but {turned} when its pictures are "
            "turned left for right: it is mirrored; set mirrored = true in [[cameras]]"
        )


def check_fingers_seen(film: Video, follower: Follower) -> None:
    """Raises ValueError for a mark of the finger that the film's first frames do not show: it has no
    reference, and is lost for good. Names the ids that are seen and stand for no mark."""
    gone = [m for m, w in zip(follower.marks, follower.seed, strict=True)
            if m.role == "finger" and np.isnan(w[0, 0])]  # fmt: skip
    if gone:
        image = next(iter(film.frames()))[2]
        seen = set(detect(image, follower.dictionary)[0])
        raise ValueError(unseen(film.path.name, gone, follower.marks, seen))


def unseen(film: str, gone: Sequence[Mark], marks: Sequence[Mark], seen: set[int]) -> str:
    """The sentence for finger marks that the first frames do not show.   seen: all ids that they show."""
    stated = set(codes_of(marks).values())
    unused = sorted(seen - stated)
    named = ", ".join(
        f"{m.name!r}" + (f" (id {code})" if (code := getattr(m.kind, "code", None)) is not None else "")
        for m in gone
    )
    hint = (
        f"seen, and of no stated marker, are the ids {', '.join(map(str, unused))}: correct the id"
        if unused else "no other id is seen: correct its id, uncover it in the first frames"
    )  # fmt: skip
    one = len(gone) == 1
    return (
        f"film {film} does not show the finger's marker{'' if one else 's'} {named} in its first frames, "
        f"where every marker of the finger has to be seen; {hint}, or remove it from the finger's markers"
    )


def _none_found(film: Video, looked: Sequence[Image], dictionary: str) -> str:
    other = other_dictionary(looked[:1], dictionary)
    hint = (
        f"{other[0]} finds {other[1]}: set that dictionary"
        if other
        else "no other predefined dictionary finds any: "
        + (picture_trouble(looked[0]) or "check focus, light and the markers' white border")
    )
    return f"film {film.path.name} shows no marker of {dictionary} in its first {len(looked)} frames; {hint}"


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
