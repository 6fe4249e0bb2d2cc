"""Doubts from the first picture: marks in front of or behind where they are stated, and marks glued elsewhere
on the finger or the rig. Each doubt is one sentence; nothing is refused."""

from collections.abc import Sequence

import numpy as np

from vision.camera import Array, Camera
from vision.doubts.plausibility import sides_mm
from vision.marks import Mark, codes_of, rows_of
from vision.perspective import heights, to_own_plane, viewpoint
from vision.plane import MIN_VISIBLE, homographies, to_plane

SIZE_SD = 0.005  # of a mark's side, relative: its print, and its corners in one picture
CLEAR = 3.0  # sds
LEAST_MM = 3.0  # off the stated height
STANDS_MM = 0.3  # how well the finger is set up along the frame
ACROSS_MM, SHARE = 3.0, 0.12  # off the line of the others; of the largest sag, beside that
FIXED_MM = 5.0  # off the stated place: more than a ruler's error in any frame marker moves it
SHORTENS = 1.2  # times square of the sag over the distance: more than any bent line is drawn back at its end


def doubts(marks: Sequence[Mark], warp: Array, *, camera: Camera, placement_sd_mm: float) -> tuple[str, ...]:
    """Sentences on marks that may lie elsewhere than stated.

    warp: (p,3,3) local to ideal px of each mark in one picture of the finger at rest, NaN where not seen.
    placement_sd_mm: how well the finger's marks are placed.
    """
    centre, frame = warp[:, :2, 2] / warp[:, 2:, 2], rows_of(marks)[0]
    if np.isfinite(centre[frame, 0]).sum() < MIN_VISIBLE:
        return ()
    nominal = np.array([mark.position for mark in marks])[:, [0, 2]]
    homography = homographies(nominal[frame], centre[None, frame])
    view = viewpoint(camera, homography)
    height = heights(marks, frame)
    place = to_own_plane(to_plane(homography, centre[None]), height, view)[0]
    return (
        *_heights(marks, sides_mm(warp, homography), height, view.distance),
        *_places(marks, place, nominal, placement_sd_mm),
        *_fixed(marks, place, nominal),
    )


def _heights(marks: Sequence[Mark], side: Array, height: Array, distance: float) -> tuple[str, ...]:
    """A sentence where the finger's marks look larger or smaller than frame marks of equal size."""
    size, coded = np.array([mark.size_mm for mark in marks]), list(codes_of(marks))
    seen = np.isfinite(side)
    finger, rig = ([p for p in coded if seen[p] and marks[p].role == role] for role in ("finger", "frame"))
    if min(len(finger), len(rig)) < 2 or len(set(size[[*finger, *rig]].tolist())) > 1:
        return ()
    ratio = np.log(side * (1.0 - height / distance) / size)
    sd = SIZE_SD + np.hypot(*(np.std(ratio[rows], ddof=1) / np.sqrt(len(rows)) for rows in (finger, rig)))
    larger = float(np.median(ratio[finger]) - np.median(ratio[rig]))
    off = larger * abs(distance)
    if abs(larger) < CLEAR * sd or abs(off) < LEAST_MM:
        return ()
    how, where, much = ("larger", "nearer to", "large") if off > 0 else ("smaller", "farther from", "small")
    return (
        f"The finger's markers look {100 * abs(larger):.1f} % {how} than those of the frame, though all "
        f"have one size_mm: they seem to lie about {abs(off):.0f} mm {where} the camera than stated, which "
        f"is {_of_plane(float(np.median(height[finger])) * np.sign(distance))}. All displacements would be "
        f"{100 * abs(larger):.1f} % too {much}: check the y of all position_mm, and size_mm.",
    )


def _of_plane(height: float) -> str:
    if abs(height) < 0.05:
        return "the plane of the frame markers"
    return f"{abs(height):.1f} mm {'in front of' if height > 0 else 'behind'} the frame markers"


def _places(marks: Sequence[Mark], place: Array, nominal: Array, sd_mm: float) -> tuple[str, ...]:
    """Sentences on marks of the finger that are not glued where they are stated; a sag at rest is none, and
    what is measured is nowhere else."""
    rows = [
        p
        for p in codes_of(marks)
        if marks[p].role == "finger" and not marks[p].measured and np.isfinite(place[p, 0])
    ]
    if not rows:
        return ()
    away, along = place[rows] - nominal[rows], np.maximum(np.abs(nominal[rows, 0]), 1.0)
    back = SHORTENS * away[:, 1] ** 2 / along
    off = np.where(away[:, 0] > 0, away[:, 0], np.maximum(-away[:, 0] - back, 0.0))
    beside = _off_line(along, away[:, 1])
    odd = (off > CLEAR * np.hypot(sd_mm, STANDS_MM)) | (beside > ACROSS_MM + SHARE * np.abs(away[:, 1]).max())
    return tuple(_sentence(marks[p].name, place[p], nominal[p]) for p in np.array(rows)[odd])


def _sentence(name: str, seen: Array, nominal: Array) -> str:
    x, z = np.round(seen, 1) + 0.0
    return (
        f"Finger marker {name!r} is seen at x = {x:.1f}, z = {z:.1f} mm at rest, stated at x = "
        f"{nominal[0]:.4g}, z = {nominal[1]:.4g} mm, and the finger's sag does not explain it. If it is "
        "glued there, correct its position_mm or node: its motion is compared with the model's at the "
        "stated place."
    )


def _fixed(marks: Sequence[Mark], place: Array, nominal: Array) -> tuple[str, ...]:
    """A sentence for each fixed mark that lies elsewhere on the rig than stated."""
    off = np.nan_to_num(np.hypot(*(place - nominal).T))
    rows = [p for p in codes_of(marks) if marks[p].role == "fixed" and off[p] > FIXED_MM]
    return tuple(
        f"Fixed marker {marks[p].name!r} is seen at x = {place[p, 0]:.1f}, z = {place[p, 1]:.1f} mm, stated "
        f"at x = {nominal[p, 0]:.4g}, z = {nominal[p, 1]:.4g} mm. It should not move wherever it is, so that "
        "displacements stay right: correct its position_mm, or its id if two are exchanged."
        for p in rows
    )


def _off_line(along: Array, sag: Array) -> Array:
    """Distance (p,) in mm of the odd mark at rest off the line of all others that agrees best with them: a
    bent line x, x^2 through the clamp. 0 for the others, and where they are fewer than four."""
    off, line = np.zeros(len(sag)), np.column_stack([along, along**2])
    if len(sag) < 4:
        return off
    residual = np.zeros((len(sag), len(sag)))
    for k in range(len(sag)):
        others = np.arange(len(sag)) != k
        residual[k] = sag - line @ np.linalg.lstsq(line[others], sag[others], rcond=None)[0]
    odd = int(np.argmin([np.delete(row, k) @ np.delete(row, k) for k, row in enumerate(residual)]))
    off[odd] = abs(residual[odd, odd])
    return off
