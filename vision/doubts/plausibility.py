"""Marks that contradict their stated sizes and positions in the first picture that shows them all.

Each gate raises one sentence for what would give wrong millimetres without a sign: sizes and positions in
different units, positions that are mirrored, marks that are exchanged or never seen.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera
from vision.doubts.framemarks import check_frame, frame_fit
from vision.marks import Mark, codes_of, rows_of
from vision.perspective import heights, viewpoint
from vision.plane import MIN_VISIBLE, homographies, to_plane

OFF = 1.15  # times too large or too small may a mark look
BARE_OFF = 1.35  # where neither lens nor distance is known
ALIKE = 0.7  # of the marks, that look wrong in the same way when a unit is
UNITS = {
    0.1: "positions in cm instead of mm give this",
    1 / 25.4: "positions in inches instead of mm give this",
    1e-3: "positions in m instead of mm give this",
    10.0: "sizes in cm instead of mm give this",
    25.4: "sizes in inches instead of mm give this",
    1e3: "sizes in m instead of mm give this",
}
ALMOST = 1.1  # times a unit's factor
SAGS, NEAR_MM = 0.6, 5.0  # share of its distance from the clamp that a mark may lie off at rest; beside that
APART_MM = 2.0  # marks nearer to each other are not told apart by their places
CORNERS = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]])


def check_marks(
    marks: Sequence[Mark], warp: Array, *, camera: Camera | None, frame_sd_mm: float = 0.1
) -> None:
    """Raises ValueError where the marks are not what, or not where, they are stated to be.

    warp: (p,3,3) local to ideal px of each mark in one picture of the finger at rest, NaN where not seen.
    camera: whose pixels these are; None where its lens is not known yet: the gates are wider then.
    """
    centre = warp[:, :2, 2] / warp[:, 2:, 2]
    frame = rows_of(marks)[0]
    if np.isfinite(centre[frame, 0]).sum() < MIN_VISIBLE:
        return
    check_frame(frame_fit(marks, centre, sd_mm=frame_sd_mm, camera=camera), marks)
    nominal = np.array([marks[p].position for p in frame])[:, [0, 2]]
    homography = homographies(nominal, centre[None, frame])
    if np.isnan(homography[0, 0, 0]):
        return
    check_side(marks, homography[0])
    check_faces(marks, np.isfinite(centre[:, 0]))
    check_sizes(marks, warp, homography, camera)
    check_fingers(marks, to_plane(homography, centre[None])[0])


def check_side(marks: Sequence[Mark], homography: Array) -> None:
    """Raises ValueError where the camera, which sees the marks' printed side, stands on the other side of the
    finger than their positions say: positions are mirrored, or y has the wrong sign."""
    frame = np.array([mark.position for mark in marks if mark.role == "frame"])
    (x, y, z), near = frame.mean(axis=0), homography @ (*frame.mean(axis=0)[[0, 2]], 1.0)
    front = bool(np.linalg.det(homography) / near[2] > 0)  # x runs to the left where z runs up
    if front == bool(y >= 0.0):
        return
    seen, facing = ("+y", "-y") if front else ("-y", "+y")
    up = homography @ (x, z + 1.0, 1.0)
    direction = "up" if up[1] / up[2] < near[1] / near[2] else "down"
    raise ValueError(
        f"the markers' positions are mirrored: by their x and z the camera looks from the {seen} side, but "
        f"their y = {y:g} mm says that they face the {facing} side; wanted x along the finger from the "
        f"clamp, z up (in the picture their z runs {direction}), y on the side that the camera sees; correct "
        f"the sign of z or x of all position_mm, or of y if the camera does look from the {seen} side"
    )


def check_faces(marks: Sequence[Mark], seen: NDArray[np.bool_]) -> None:
    """Raises ValueError for a mark that the camera sees (p,) and that is stated on the other side, y, of the
    finger than the frame marks."""
    y = float(np.mean([mark.position[1] for mark in marks if mark.role == "frame"]))
    for mark in (m for m, visible in zip(marks, seen, strict=True) if visible and m.role == "finger"):
        if mark.position[1] * y < 0.0 and min(abs(mark.position[1]), abs(y)) > APART_MM:
            raise ValueError(
                f"finger marker {mark.name!r} is stated at y = {mark.position[1]:g} mm and the frame markers "
                f"at y = {y:g} mm, on the other side of the finger: wanted y of one sign, as one camera sees "
                "both; correct the y of position_mm"
            )


def sides_mm(warp: Array, homography: Array) -> Array:
    """Sides (p,) mm that marks of warps (p,3,3) have as seen in the frame marks' plane (1,3,3)."""
    corners = warp @ CORNERS
    places = to_plane(homography, np.swapaxes(corners[:, :2] / corners[:, 2:], 1, 2).reshape(1, -1, 2))
    x, z = np.moveaxis(places.reshape(len(warp), 4, 2), -1, 0)
    area = 0.5 * np.abs(np.sum(x * np.roll(z, -1, axis=1) - z * np.roll(x, -1, axis=1), axis=1))
    return np.asarray(np.sqrt(area))


def check_sizes(marks: Sequence[Mark], warp: Array, homography: Array, camera: Camera | None) -> None:
    """Raises ValueError where marks look more than 15 % larger or smaller than their size says, in the scale
    of the frame marks' positions; names the unit that explains it."""
    side, size = sides_mm(warp, homography), np.array([mark.size_mm for mark in marks])
    height = heights(marks, rows_of(marks)[0])
    if camera is not None:
        side = side * (1.0 - height / viewpoint(camera, homography).distance)
    seen = np.isfinite(side)
    ratio = np.where(seen, side / size, 1.0)
    most = np.where((camera is None) & (np.abs(height) > 0.1), BARE_OFF, OFF)
    wrong = np.abs(np.log(ratio)) > np.log(most)
    if not wrong.any():
        return
    usual = float(np.median(ratio[seen]))
    alike = np.abs(np.log(ratio[seen] / usual)) < np.log(OFF)
    if max(usual, 1.0 / usual) > OFF and alike.mean() >= ALIKE:
        raise ValueError(_all_wrong(usual, float(np.median(side[seen])), float(np.median(size[seen]))))
    worst = int(np.argmax(np.where(wrong, np.abs(np.log(ratio)), 0.0)))
    raise ValueError(
        f"marker {marks[worst].name!r} has size_mm = {size[worst]:g}, but looks {side[worst]:.3g} mm wide in "
        f"the scale of the frame markers; wanted both within 15 %: measure the side of its black square "
        "without the white border, or the dot's diameter"
    )


def _all_wrong(ratio: float, side: float, size: float) -> str:
    near = [text for factor, text in UNITS.items() if max(ratio / factor, factor / ratio) < ALMOST]
    likely = near[0] if near else "either all sizes or all positions are wrong by that factor"
    return (
        f"size_mm and position_mm contradict each other: in the scale of the frame markers' positions the "
        f"markers are {side:.3g} mm wide (median), size_mm says {size:g} mm, which is {1.0 / ratio:.3g} "
        f"times as much; {likely}; wanted both in mm, within 15 %: correct position_mm, or size_mm (the side "
        "of the black square without its white border)"
    )


def check_fingers(marks: Sequence[Mark], place: Array) -> None:
    """Raises ValueError where finger marks lie, at rest, in another order than stated, or far from their
    positions.   place: (p,2) mm, x and z, where all marks are seen."""
    coded = codes_of(marks)
    rows = [p for p in coded if marks[p].role == "finger" and np.isfinite(place[p, 0])]
    nominal = np.array([mark.position for mark in marks])[:, [0, 2]]
    turned = [
        (a, b) for i, a in enumerate(rows) for b in rows[i + 1 :]
        if np.linalg.norm(nominal[b] - nominal[a]) > APART_MM
        and (place[b] - place[a]) @ (nominal[b] - nominal[a]) < 0.0
    ]  # fmt: skip
    if len(rows) > 2 and len(turned) == len(rows) * (len(rows) - 1) // 2:
        raise ValueError(
            "the finger's markers lie on the finger in the reverse of the stated order: wanted x from the "
            "clamp to the tip, for the finger's markers and for those of the rig; correct position_mm"
        )
    if turned:
        a, b = max(turned, key=lambda pair: float(np.linalg.norm(nominal[pair[1]] - nominal[pair[0]])))
        raise ValueError(
            f"markers {marks[a].name!r} (id {coded[a]}) and {marks[b].name!r} (id {coded[b]}) lie in the "
            f"opposite order on the finger than stated: seen at x = {place[a, 0]:.1f} and {place[b, 0]:.1f} "
            f"mm, stated at {nominal[a, 0]:g} and {nominal[b, 0]:g} mm; exchange their marker ids, or "
            "correct position_mm"
        )
    for p in rows:
        away, most = float(np.linalg.norm(place[p] - nominal[p])), SAGS * abs(nominal[p, 0]) + NEAR_MM
        if away > most:
            raise ValueError(
                f"finger marker {marks[p].name!r} lies {away:.1f} mm from its stated place at rest: seen at "
                f"x = {place[p, 0]:.1f}, z = {place[p, 1]:.1f} mm, stated at x = {nominal[p, 0]:.4g}, z = "
                f"{nominal[p, 1]:.4g} mm; wanted at most {most:.3g} mm, more than a soft finger sags: "
                "correct its position_mm or node (mm from the clamp), or its marker id"
            )
