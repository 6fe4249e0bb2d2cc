"""The frame of loose markers, as pictures of them together with the board measure it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.inputs.foundrecordings import Tags, first, is_film
from twin.marktables import MarkerTable
from twin.project.cameratables import BoardTable
from twin.project.framesheet import SheetMarker, SheetTable
from twin.targets import Array

if TYPE_CHECKING:
    from vision.placing.loosemarkers import LooseMarkers

FRAME, FIXED = 6, 4  # markers of each role at least
DOUBT_SD = 4.0  # beyond which a typed place contradicts the pictures


@dataclass(frozen=True)
class Measured:
    """Markers in the plane that fits them best: mm to the right, up and out towards the camera."""

    codes: tuple[int, ...]
    place: Array  # (n,3)
    sd: float  # mm, of one coordinate in the plane, beside a shift and a turn of all
    pictures: int
    remarks: tuple[str, ...]


def measured(pictures: Sequence[Path], board: BoardTable, film: Tags, dictionary: str) -> Measured:
    """The markers that stand still in the film; ValueError where the pictures, or the film of rig and board,
    do not tell them.

    The film's rows are level until two markers say what is.
    """
    from vision import Board, Video
    from vision.calibration.boardfilms import sharp_pictures
    from vision.film.series import bits_of_pictures, read_picture
    from vision.placing.loosemarkers import loose_markers

    own = Board.of(**board.model_dump() | {"marker_mm": board.marker_mm or 0.0})
    if is_film(pictures):
        read = sharp_pictures(Video(pictures[0]), own)
    else:
        bits = bits_of_pictures(pictures)
        read = {path.name: read_picture(path, bits) for path in pictures}
    found = loose_markers(list(read.values()), list(read), own, dictionary=dictionary)
    still = [k for k, code in enumerate(found.codes) if code in film.still]
    if len(still) < FRAME + FIXED:
        raise ValueError(
            f"{len(still)} markers stand still in the film and lie beside the board in the pictures; wanted "
            f"{FRAME + FIXED} or more"
        )
    return _in_plane(found, still, film)


def _in_plane(found: "LooseMarkers", still: Sequence[int], film: Tags) -> Measured:
    """Places in the axes of the plane: right and up as the film's picture shows them."""
    from vision.plane import fit_homography, to_plane

    place = found.place[still]
    middle = place.mean(axis=0)
    axes = np.linalg.svd(place - middle)[2]
    out = axes[2] * -np.sign(axes[2, 2])  # the board's z points away
    flat = np.stack([axes[0], np.cross(out, axes[0])])
    codes = tuple(found.codes[k] for k in still)
    seen = first(film.centre)[[film.codes.index(code) for code in codes]]
    to_px = fit_homography((place - middle) @ flat.T, seen)
    ends = seen.mean(axis=0) + np.array([(-50.0, 0.0), (50.0, 0.0)])
    along = np.diff(to_plane(to_px[None], ends[None])[0], axis=0)[0] @ flat
    right = along / np.linalg.norm(along)
    turn = np.stack([right, np.cross(out, right), out])
    rows = np.ravel([[3 * k, 3 * k + 1, 3 * k + 2] for k in still])
    whole = np.kron(np.eye(len(still)), turn[:2])
    covariance = whole @ found.covariance[np.ix_(rows, rows)] @ whole.T
    sd = _beside_rigid(covariance, (place - middle) @ turn[:2].T)
    return Measured(codes, (place - middle) @ turn.T, sd, found.pictures, found.remarks)


def _beside_rigid(covariance: Array, place: Array) -> float:
    """Sd mm of one coordinate of places (n,2) beside what a shift and a turn of all take up."""
    count = len(place)
    moves = np.zeros((2 * count, 3))
    moves[::2, 0] = moves[1::2, 1] = 1.0
    moves[::2, 2], moves[1::2, 2] = -place[:, 1], place[:, 0]
    base = np.linalg.qr(moves)[0]
    left = np.eye(2 * count) - base @ base.T
    return float(np.sqrt(np.trace(left @ covariance @ left) / (2 * count - 3)))


def sheet_of(
    found: Measured, film: Tags, *, axes: tuple[int, int] | None, near: Array
) -> SheetTable:
    """The frame that the pictures tell, with x = 0, z = 0 at a marker.

    axes: ids of that marker and of one on the level line through it; None: the one nearest to a place (2,) px
    of the film, and the film's rows.
    """
    order = list(found.codes)
    pixels = first(film.centre)[[film.codes.index(code) for code in order]]
    origin = order[int(np.argmin(np.linalg.norm(pixels - near, axis=1)))] if axes is None else axes[0]
    if lost := [code for code in axes or () if code not in order]:
        raise ValueError(f"frame.axes = {list(axes or ())}: marker {lost[0]} does not stand still beside the "
                         f"board; wanted two of {', '.join(map(str, order))}")  # fmt: skip
    flat = found.place[:, :2] - found.place[order.index(origin), :2]
    if axes is not None:
        x, z = flat[order.index(axes[1])] * np.sign(flat[order.index(axes[1]), 0] or 1.0)
        flat = flat @ np.array([[x, -z], [z, x]]) / np.hypot(x, z)
    return _sheet(found, film, flat, {})


def sheet_in_typed(
    found: Measured, film: Tags, typed: Sequence[MarkerTable], *, sd_mm: float, along: float
) -> tuple[SheetTable, tuple[str, ...]]:
    """The frame that the pictures tell in the axes of typed places, and a sentence on each that is odd.

    along: 1 where x goes to the right in the film, else -1.   sd_mm: of a typed place.
    """
    known = {mark.marker: mark for mark in typed if mark.marker in found.codes}
    rows = [k for k, code in enumerate(found.codes) if code in known]
    if len(rows) < 3:
        raise ValueError(f"{len(rows)} of the typed frame markers are in the pictures; wanted 3 or more")
    stated = np.array([known[found.codes[k]].position_mm for k in rows])
    want = stated[:, [0, 2]] * (along, 1.0)
    sd, keep = float(np.hypot(sd_mm, found.sd)), np.ones(len(rows), bool)
    while True:
        flat = moved(found.place[:, :2], found.place[rows, :2][keep], want[keep])
        away = np.linalg.norm(flat[rows] - want, axis=1)
        worst = int(np.argmax(np.where(keep, away, -1.0)))
        if away[worst] <= DOUBT_SD * sd or keep.sum() <= 3:
            break
        keep[worst] = False
    odd = tuple(
        f"Marker {known[found.codes[k]].name} (id {found.codes[k]}): typed at x = {along * want[n, 0]:.2f}, "
        f"z = {want[n, 1]:.2f} mm, the pictures show x = {along * flat[k, 0]:.2f}, z = {flat[k, 1]:.2f} mm "
        f"(+- {found.sd:.2f} mm). The pictures' place is taken."
        for n, k in enumerate(rows) if not keep[n]
    )  # fmt: skip
    roles = {code: str(mark.role) for code, mark in known.items() if code is not None}
    return _sheet(found, film, flat, roles), odd


def moved(place: Array, own: Array, want: Array) -> Array:
    """Places (n,2) under the turn and shift that bring some of them (m,2) nearest to others (m,2)."""
    a, b = own - own.mean(axis=0), want - want.mean(axis=0)
    cosine, sine = float((a * b).sum()), float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    turn = np.array([[cosine, sine], [-sine, cosine]]) / np.hypot(cosine, sine)
    return (place - own.mean(axis=0)) @ turn + want.mean(axis=0)


def _sheet(found: Measured, film: Tags, flat: Array, roles: Mapping[int, str]) -> SheetTable:
    """A frame of places (n,2) mm; roles that are not stated go round the rig in turn."""
    from vision.plane import fit_homography, to_plane

    rows = [film.codes.index(code) for code in found.codes]
    to_px = fit_homography(flat, first(film.centre)[rows])
    corners = first(film.quads.reshape(*film.quads.shape[:2], 8))[rows].reshape(1, -1, 2)
    quads = to_plane(to_px[None], corners)[0].reshape(-1, 4, 2)
    sides = np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=2).mean(axis=1)
    round_rig = np.argsort(np.arctan2(*(flat - flat.mean(axis=0)).T))
    spare = min(len(flat) // 2, len(flat) - FRAME)
    fixed = {found.codes[k] for k in round_rig[np.linspace(0, len(flat) - 1, spare).round().astype(int)]}
    is_fixed = [roles.get(code) == "fixed" if code in roles else code in fixed for code in found.codes]
    markers = tuple(
        SheetMarker(
            marker=code, role="fixed" if still else "frame",
            place_mm=(round(float(x), 4), round(float(z), 4)), size_mm=round(float(side), 2),
            out_mm=round(float(out), 4),
        )
        for code, still, (x, z), side, out in zip(
            found.codes, is_fixed, flat, sides, found.place[:, 2], strict=True)
    )  # fmt: skip
    size, sd = round(float(np.median(sides)), 2), max(round(found.sd, 4), 1e-4)
    return SheetTable(size_mm=size, sd_mm=sd, clamp_mm=0.0, markers=markers)
