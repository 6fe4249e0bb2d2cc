"""A picture with every mark circled: found, missing, or of no stated mark."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.drawing.overlays import write_text
from vision.film.video import Video
from vision.following.firstpictures import first_seen
from vision.following.markercentres import no_lens
from vision.marks import Mark, codes_of, detect, px_per_unit, rows_of
from vision.plane import MIN_VISIBLE, fit_homography

REACH = 1.6  # of a mark's half side: a circle clear of its corners
FOUND, MISSING, UNUSED = (115, 230, 60), (60, 60, 255), (0, 200, 255)


def ring_sheet(film: Video, marks: Sequence[Mark], *, dictionary: str) -> tuple[NDArray[np.uint8], int]:
    """The film's first frame (h,w,3), blue green red, with a circle and the name round each mark, and how
    many are found.

    Green is found, red is where a mark that is not found should be, as the frame marks say; yellow are ids of
    no mark. The lens is left out: it may not be known yet.
    """
    picture = next(iter(film.frames()))[2]
    seen = first_seen([picture], no_lens(picture), marks, dictionary)
    is_found = np.isfinite(seen[:, 0, 0])
    centre, radius = _expected(seen, marks)
    quads = detect(picture, dictionary)[0]
    codes = set(codes_of(marks).values())
    drawn = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    unit = max(picture.shape[1] / 1280.0, 0.5)
    for p, mark in enumerate(marks):
        label = mark.name if is_found[p] else f"{mark.name} not found"
        _ring(drawn, centre[p], radius[p], label, FOUND if is_found[p] else MISSING, unit)
    for code, quad in quads.items():
        if code not in codes:
            reach = 0.8 * float(np.linalg.norm(quad[2] - quad[0]))
            _ring(drawn, quad.mean(axis=0), reach, f"id {code} of no mark", UNUSED, unit)
    legend = f"green: found ({int(is_found.sum())} of {len(marks)}); red: not found; yellow: an id of no mark"
    write_text(drawn, legend, np.array([8.0, drawn.shape[0] - 10.0]), unit, (255, 255, 255))
    return drawn, int(is_found.sum())


def _expected(seen: Array, marks: Sequence[Mark]) -> tuple[Array, Array]:
    """Places (p,2) px of marks with warps (p,3,3), seen or expected, and the radius (p,) px of a circle round
    each; NaN where too few of the frame are seen to tell."""
    centre, radius = seen[:, :2, 2].copy(), REACH * px_per_unit(seen)
    frame = [p for p in rows_of(marks)[0] if np.isfinite(centre[p, 0])]
    hidden = np.isnan(centre[:, 0])
    if len(frame) >= MIN_VISIBLE and hidden.any():
        place = np.array([mark.position for mark in marks])[:, [0, 2]]
        homography = fit_homography(place[frame], centre[frame])
        ends = np.concatenate([place, place + (0.5, 0.0) * np.array([[m.size_mm] for m in marks])])
        mapped = np.column_stack([ends, np.ones(len(ends))]) @ homography.T
        pixels = (mapped[:, :2] / mapped[:, 2:]).reshape(2, -1, 2)
        centre[hidden] = pixels[0, hidden]
        radius[hidden] = REACH * np.linalg.norm(pixels[1] - pixels[0], axis=1)[hidden]
    return centre, radius


def numbered(picture: Image, centre: Array) -> NDArray[np.uint8]:
    """The grey picture (h,w) as (h,w,3), blue green red, with the number of each place (k,2) px, from 1."""
    drawn = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    unit = max(picture.shape[1] / 1280.0, 0.5)
    for k, place in enumerate(centre):
        _ring(drawn, place, 5.0 * unit, str(k + 1), UNUSED, unit)
    return drawn


def _ring(
    drawn: NDArray[np.uint8],
    centre: Array,
    radius: float,
    label: str,
    colour: tuple[int, int, int],
    unit: float,
) -> None:
    if not np.all(np.abs(centre) < 4.0 * max(drawn.shape)):  # NaN, or far outside
        return
    x, y = np.round(centre).astype(int)
    cv2.circle(drawn, (int(x), int(y)), max(round(radius), 3), colour, max(round(1.5 * unit), 1), cv2.LINE_AA)
    write_text(drawn, label, centre + 0.75 * radius * np.array([1.0, -1.0]), unit, colour)
