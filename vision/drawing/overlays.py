"""One picture of a followed film: the frame of the largest motion, with every mark as it was followed."""

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.film.video import Video
from vision.following.firstpictures import first_seen
from vision.following.markercentres import no_lens
from vision.following.tracks import Method, Tracks
from vision.marks import Mark, codes_of, detect, px_per_unit, rows_of
from vision.plane import MIN_VISIBLE, fit_homography

PATH, CENTRE, SPREAD, GONE, DARK = (
    (0, 159, 230), (233, 180, 86), (115, 230, 60), (60, 60, 255), (25, 25, 25),
)  # fmt: skip
ELLIPSE_PX = 12.0  # semi-axis that the usual ellipse is enlarged to
BESIDE = np.array([24.0, -18.0])  # px in a picture 1280 px wide, name from centre
FINE = 4  # bits of a pixel's fraction that OpenCV draws with


def farthest(tracks: Tracks) -> int:
    """The frame in which the marks are farthest from where each was first seen."""
    seen = np.isfinite(tracks.position[..., 0])
    start = tracks.position[np.argmax(seen, axis=0), np.arange(seen.shape[1])]
    return int(np.argmax(np.nan_to_num((tracks.position - start) ** 2).sum(axis=(1, 2))))


def overlay(film: Video, tracks: Tracks) -> NDArray[np.uint8]:
    """Picture (h,w,3), blue green red, of the film's frame in which the marks are farthest from their start.

    Each mark with its name, its centre, its path up to that frame and the ellipse of the fit's covariance,
    enlarged by the factor that is written below; a lost one in red where it was last seen, or, not seen
    before, not at all. Raises ValueError when the film does not show that frame.
    """
    frame = farthest(tracks)
    grey: Image | None = next((image for _, _, image in film.frames(frame, frame + 1)), None)
    if grey is None:
        raise ValueError(
            f"{film.path.name} does not show frame {frame}: it has changed since it was followed"
        )
    picture = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    factor = _factor(tracks.covariance[frame])
    unit = max(picture.shape[1] / 1280.0, 0.5)  # lines and letters keep their share of the picture
    for p in range(len(tracks.names)):
        _path(picture, tracks.position[: frame + 1, p])
    for p, name in enumerate(tracks.names):
        seen = np.flatnonzero(tracks.method[: frame + 1, p] != Method.LOST)
        if not len(seen):
            continue
        place, lost = tracks.position[seen[-1], p], seen[-1] != frame
        if lost:
            _mark(picture, place, cv2.MARKER_TILTED_CROSS, GONE, unit)
            name += f" lost since {tracks.time[seen[-1] + 1]:.2f} s"
        else:
            _ellipse(picture, place, tracks.covariance[frame, p] * factor**2)
            _mark(picture, place, cv2.MARKER_CROSS, CENTRE, unit)
        write_text(picture, name, place + unit * BESIDE, unit, GONE if lost else (255, 255, 255))
    caption = f"{tracks.time[frame]:.2f} s; paths up to here; ellipses: 1 sd of the fit x {factor:g}"
    write_text(picture, caption, np.array([8.0, picture.shape[0] - 10.0]), unit, (255, 255, 255))
    return picture


def _factor(covariance: Array) -> float:
    """Round factor that brings the usual sd (p,2,2) px2 to some pixels."""
    variance = 0.5 * np.trace(covariance, axis1=1, axis2=2)
    finite = variance[np.isfinite(variance) & (variance > 0)]
    if not len(finite):
        return 1.0
    enlargement = ELLIPSE_PX / float(np.sqrt(np.median(finite)))
    power = 10.0 ** np.floor(np.log10(enlargement))
    return float(power * max(step for step in (1, 2, 5) if step * power <= enlargement * (1 + 1e-9)))


def _path(picture: NDArray[np.uint8], position: Array) -> None:
    """The way (t,2) px, with gaps where the mark is lost."""
    for a, b in pairwise(position):
        if np.isfinite(a[0]) and np.isfinite(b[0]):
            cv2.line(picture, _fixed(a), _fixed(b), PATH, 1, cv2.LINE_AA, FINE)


def _ellipse(picture: NDArray[np.uint8], place: Array, covariance: Array) -> None:
    if not np.isfinite(covariance).all():
        return
    power, axes = np.linalg.eigh(covariance)
    angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    size = np.sqrt(np.maximum(power[::-1], 0.0))
    cv2.ellipse(picture, _fixed(place), _fixed(size), angle, 0.0, 360.0, SPREAD, 1, cv2.LINE_AA, FINE)


def _mark(
    picture: NDArray[np.uint8], place: Array, kind: int, colour: tuple[int, int, int], unit: float
) -> None:
    x, y = np.round(place).astype(int)
    cv2.drawMarker(picture, (int(x), int(y)), colour, kind, round(14 * unit), 1, cv2.LINE_AA)


def write_text(
    picture: NDArray[np.uint8], text: str, place: Array, unit: float, colour: tuple[int, int, int]
) -> None:
    """Letters with a dark rim, inside the picture."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * unit, 1)
    x = int(np.clip(place[0], 2, max(picture.shape[1] - width - 2, 2)))
    y = int(np.clip(place[1], height + 2, picture.shape[0] - 4))
    # A thicker stroke would be a wider font: the rim is the same letters a pixel off.
    for dx, dy, ink in ((-1, 0, DARK), (1, 0, DARK), (0, -1, DARK), (0, 1, DARK), (0, 0, colour)):
        corner = (x + dx, y + dy)
        cv2.putText(picture, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * unit, ink, 1, cv2.LINE_AA)


def _fixed(place: Array) -> tuple[int, int]:
    x, y = np.round(place * 2**FINE).astype(int)
    return int(x), int(y)


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
