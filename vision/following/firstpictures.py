"""Marks in the first pictures of a film, and the way out for those that are not seen.

Coded marks are found by their codes. From the frame marks among them follows where all others should be: of
several markers of one id the one that is meant, natural features, plain dots.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.boards.board import flipped
from vision.camera import Array, Camera, Image
from vision.dictionaries import other_dictionary
from vision.film.picturefaults import picture_trouble
from vision.film.video import Video
from vision.following.dots import Dot, find_dots
from vision.following.identity import GATE, assign
from vision.following.registration import project
from vision.marks import (
    Mark,
    codes_of,
    corner_warp,
    detect,
    detect_all,
    detect_wanted,
    dot_warp,
    dots_of,
    patches_of,
)
from vision.plane import MIN_VISIBLE, fit_homography, homographies, to_plane

START_FRAMES = 5  # frames searched for marks that the first one does not show
NEAR = 1.5  # sides of a marker of which several are seen: how far it may be from where the frame marks put it
CLEAR = 2.0  # times as far must all others of its id be
MOST_OFF, AGREES, PLAIN = 20, 0.02, 3.0  # ids by which all may be off; share of the rig's size; times worse


def first_seen(pictures: Sequence[Image], camera: Camera, marks: Sequence[Mark], dictionary: str) -> Array:
    """Warps (p,3,3), local to ideal px, of every mark in the first picture that shows it; else NaN."""
    seed: Array = np.full((len(marks), 3, 3), np.nan)
    for picture in pictures:
        find_missing(picture, camera, marks, dictionary, seed, {})
        if np.isfinite(seed).all():
            break
    return seed


def find_missing(
    image: Image, camera: Camera, marks: Sequence[Mark], dictionary: str, seed: Array, dots: dict[int, Dot]
) -> NDArray[np.bool_]:
    """Fill the warps of marks that the picture shows and that were missing; says which were filled."""
    missing = np.isnan(seed[:, 0, 0])
    codes = {code for p, code in codes_of(marks).items() if missing[p]}
    quads, _ = detect_wanted(image, dictionary, codes)
    for p, code in codes_of(marks).items():
        if missing[p] and code in quads:
            seed[p] = corner_warp(camera.undistort(quads[code]))
    for p, warp in told_apart(image, camera, marks, dictionary, seed).items():
        seed[p] = warp
    _lay_patches(marks, seed)
    _find_dots(image, camera, marks, seed, dots)
    return missing & np.isfinite(seed[:, 0, 0])


def told_apart(
    image: Image, camera: Camera, marks: Sequence[Mark], dictionary: str, seed: Array
) -> dict[int, Array]:
    """Warps (3,3) by row of marks that are missing because the picture shows several of their id.

    seed: (p,3,3) warps of the marks that are found, NaN for the others. The one that lies where the frame
    marks put its stated place is taken, if all others of its id lie clearly elsewhere, as on a second sheet.
    """
    missing = {p: code for p, code in codes_of(marks).items() if np.isnan(seed[p, 0, 0])}
    homography = _frame_homography(marks, seed) if missing else None
    if homography is None:
        return {}
    nominal = np.array([mark.position for mark in marks])[:, [0, 2]]
    seen, warps = detect_all(image, dictionary), {}
    for p, code in missing.items():
        quads = [camera.undistort(quad) for name, quad in seen if name == code]
        side = marks[p].size_mm
        place, beside = _in_picture(homography, nominal[p] + [(0.0, 0.0), (side, 0.0)])
        away = np.array([np.hypot(*(quad.mean(axis=0) - place)) for quad in quads])
        order = np.argsort(away)
        reach = NEAR * float(np.hypot(*(beside - place)))
        if len(quads) > 1 and away[order[0]] < reach and away[order[1]] > CLEAR * max(away[order[0]], reach):
            warps[p] = corner_warp(quads[order[0]])
    return warps


def _lay_patches(marks: Sequence[Mark], seed: Array) -> None:
    """Lay missing natural features where the frame marks say that they were picked, upright to +y."""
    missing = {p: kind for p, kind in patches_of(marks).items() if np.isnan(seed[p, 0, 0])}
    homography = _frame_homography(marks, seed) if missing else None
    if homography is None:
        return
    for p, kind in missing.items():
        half, (x, z) = 0.5 * kind.size_mm, kind.seen_mm
        warp = homography @ np.array([[-half, 0.0, x], [0.0, -half, z], [0.0, 0.0, 1.0]])
        seed[p] = warp / warp[2, 2]


def _find_dots(
    image: Image, camera: Camera, marks: Sequence[Mark], seed: Array, dots: dict[int, Dot]
) -> None:
    """Look for missing dots where the frame marks say that they should be, dark or light ones."""
    missing = [p for p in dots_of(marks) if np.isnan(seed[p, 0, 0])]
    homography = _frame_homography(marks, seed) if missing else None
    if homography is None:
        return
    nominal = np.array([mark.position for mark in marks])[:, [0, 2]]
    guess = _in_picture(homography, nominal)
    size = np.array([mark.size_mm for mark in marks])
    rim = _in_picture(homography, nominal + 0.5 * size[:, None] * (1.0, 0.0))
    radius = np.linalg.norm(rim - guess, axis=1)
    candidates: list[Dot] = []
    for p in missing:
        for is_dark in (True, False):
            seen = find_dots(
                image, camera, guess[p], np.full(2, radius[p]), search=2.0 * radius[p], dark=is_dark
            )
            candidates += [
                d for d in seen if all(np.hypot(*(d.centre - f.centre)) > 0.5 * d.radius for f in candidates)
            ]
    apart = np.linalg.norm(guess[missing][:, None] - guess[missing][None], axis=-1) + np.diag(
        [np.inf] * len(missing)
    )
    gate = np.minimum(2.0 * radius[missing], GATE * apart.min(axis=1))
    chosen, _ = assign(guess[missing], np.array([dot.centre for dot in candidates]).reshape(-1, 2), gate)
    for p, j in zip(missing, chosen, strict=True):
        if j >= 0:
            seed[p], dots[p] = dot_warp(candidates[j].centre, candidates[j].radius), candidates[j]


def _frame_homography(marks: Sequence[Mark], seed: Array) -> Array | None:
    """Homography (3,3) from the frame marks' plane (mm) to ideal px, from those that are found; None where
    these are fewer than 4, or tell none."""
    frame = [p for p, mark in enumerate(marks) if mark.role == "frame" and np.isfinite(seed[p, 0, 0])]
    if len(frame) < MIN_VISIBLE:
        return None
    nominal = np.array([marks[p].position for p in frame])[:, [0, 2]]
    homography = fit_homography(nominal, seed[frame, :2, 2])
    return homography if np.isfinite(homography[0, 0]) else None


def _in_picture(homography: Array, places: Array) -> Array:
    """Ideal pixels (n,2) of places (n,2) mm in the plane."""
    return project(homography, np.concatenate([places.T, np.ones((1, len(places)))]))


def check_size(film: Video, camera: Camera) -> None:
    """Raises ValueError for a film of another size than the camera was calibrated with."""
    if (film.height, film.width) == tuple(camera.size) != (film.width, film.height):
        raise ValueError(
            f"film {film.path.name} has {film.width} x {film.height} px, the camera was calibrated with "
            f"{camera.size[0]} x {camera.size[1]}: one of them lies on its side; turn the board images by 90 "
            "degrees as the film is turned, and calibrate again"
        )
    if (film.width, film.height) != tuple(camera.size):
        raise ValueError(
            f"film {film.path.name} has {film.width} x {film.height} px, the camera was calibrated with "
            f"{camera.size[0]} x {camera.size[1]}: film and boards must come from the same setting"
        )


def check_start(
    film: Video, looked: Sequence[Image], marks: Sequence[Mark], dictionary: str, seed: Array
) -> None:
    """Raises ValueError where the first pictures show no coded mark, one twice, too few of the frame, marks
    left for right, or marks whose ids are all off by one number."""
    gone = np.isnan(seed[list(codes_of(marks)), 0, 0])
    if gone.mean() > 0.5:
        _check_mirrored(film, looked[0], dictionary)
    seen, several = detect(looked[0], dictionary)
    _check_ids(film, seen, marks)
    if gone.all():
        raise ValueError(_none_found(film, looked, dictionary))
    twice = several & {code for p, code in codes_of(marks).items() if np.isnan(seed[p, 0, 0])}
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


def _check_ids(film: Video, seen: dict[int, Array], marks: Sequence[Mark]) -> None:
    """Raises ValueError where the frame marks lie where they are stated only if one number is added to all
    ids.   seen: corners (4,2) raw px by id."""
    codes = {p: code for p, code in codes_of(marks).items() if marks[p].role == "frame"}

    def misfit(off: int) -> float:
        rows = [p for p, code in codes.items() if code + off in seen]
        if len(rows) <= max(MIN_VISIBLE, len(codes) - 2):
            return np.inf
        nominal = np.array([marks[p].position for p in rows])[:, [0, 2]]
        pixels = np.array([seen[codes[p] + off].mean(axis=0) for p in rows])[None]
        away = to_plane(homographies(nominal, pixels), pixels)[0] - nominal
        return float(np.nan_to_num(np.sqrt(np.mean(away**2)) / np.ptp(nominal, axis=0).max(), nan=np.inf))

    off = min(range(-MOST_OFF, MOST_OFF + 1), key=misfit)
    if off == 0 or misfit(off) > AGREES or misfit(0) < PLAIN * AGREES:
        return
    raise ValueError(
        f"film {film.path.name} shows the frame markers in their places only if all ids of twin.toml are "
        f"{abs(off)} too {'small' if off > 0 else 'large'}: {'raise' if off > 0 else 'lower'} every "
        f"marker = ... by {abs(off)}"
    )


def _check_mirrored(film: Video, picture: Image, dictionary: str) -> None:
    """Raises ValueError for a film that shows its markers left for right: at most chance shows one then."""
    seen, turned = (len(detect(picture, dictionary)[0]) for picture in (picture, flipped(picture)))
    if turned >= MIN_VISIBLE and turned > 2 * seen:
        raise ValueError(
            f"film {film.path.name} shows {seen} markers of {dictionary}, but {turned} when its pictures are "
            "turned left for right: it is mirrored; set mirrored = true in [[cameras]]"
        )


def unseen(film: str, gone: Sequence[Mark], marks: Sequence[Mark], seen: set[int]) -> str:
    """The sentence for finger marks that the first frames do not show.   seen: all ids that they show."""
    codes = set(codes_of(marks).values())
    unused = sorted(seen - codes)
    named = ", ".join(
        f"{m.name!r}" + (f" (id {code})" if (code := getattr(m.kind, "code", None)) is not None else "")
        for m in gone
    )
    hint = (
        f"seen, and of no stated marker, are the ids {', '.join(map(str, unused))}: correct the id"
        if unused else "no other id is seen: correct its id, uncover it in the first frames"
    )  # fmt: skip
    single = len(gone) == 1
    return (
        f"film {film} does not show the finger's marker{'' if single else 's'} {named} in its first frames, "
        f"where every marker of the finger has to be seen; {hint}, or remove it from the finger's markers"
    )


def _none_found(film: Video, looked: Sequence[Image], dictionary: str) -> str:
    better = other_dictionary(looked[:1], dictionary)
    hint = (
        f"{better[0]} finds {better[1]}: set that dictionary"
        if better
        else "no other predefined dictionary finds any: "
        + (picture_trouble(looked[0]) or "check focus, light and the markers' white border")
    )
    return f"film {film.path.name} shows no marker of {dictionary} in its first {len(looked)} frames; {hint}"
