"""Films of a board that is moved by hand: the camera from one film, the rig from films of several cameras."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.boards.board import MIN_CORNERS, NOTHING, Board, BoardView
from vision.calibration.bundle import Shot, bundle_adjust
from vision.calibration.intrinsics import MIN_IMAGES, camera_from
from vision.calibration.lens import centred
from vision.calibration.rig import Rig
from vision.calibration.stereo import MIN_COMMON, can_join, synchronous_shots
from vision.camera import Array, Camera, Image
from vision.film.picturefaults import board_edge_sd
from vision.film.video import Video
from vision.plane import fit_homography

LOOKED_AT = 300  # frames of a film, evenly spaced, in which the board is looked for
CHOSEN = 30  # frames that calibrate a camera; more add frames that are alike
SHARP = 1.4  # times the edges of the sharper quarter of the frames: what is wider is left out
EXPOSED = 0.15  # px of blur for a pixel of motion between two frames, for a rolling shutter too
TILT_WEIGHT = 0.7  # a board turned by 45 degrees counts as far as one shifted by half the picture
# For a rig: looks at so many moments, and at the frames so many periods round each; up to so many frames of a
# film at all; so many instants calibrate it.
WINDOWS, REACH, ALL, MOST = 60, 4.5, 400, 120


@dataclass(frozen=True)
class BoardFilm:
    """Views of a board that is moved, frame by frame of a film."""

    path: Path
    time: Array  # (t,) s
    size: tuple[int, int]  # px
    views: tuple[BoardView, ...]  # (t); `NOTHING` where it was not looked for
    blur: Array  # (t,) px, sd of the board's edges; NaN where it is not seen
    looked: int  # number of frames in which it was looked for

    @property
    def seen(self) -> NDArray[np.intp]:
        """The frames that show enough of the board."""
        return np.flatnonzero([len(view) >= MIN_CORNERS for view in self.views])


def read_board_film(film: Video, board: Board, *, frames: Collection[int] | None = None) -> BoardFilm:
    """The board in a film, in the frames named, else in at most 300 that are evenly spaced."""
    count = len(film.time)
    step = max(-(-count // LOOKED_AT), 1)
    rows = set(range(0, count, step)) if frames is None else set(frames)
    views, blur = [NOTHING] * count, np.full(count, np.nan)
    for index, _, picture in film.frames():
        if index in rows:
            grey = board.black_on_white(picture)
            views[index] = board.find(grey)
            if len(views[index]) >= MIN_CORNERS:
                blur[index] = board_edge_sd(grey, views[index].points, views[index].pixels)
    return BoardFilm(film.path, film.time, (film.width, film.height), tuple(views), blur, len(rows))


def camera_of_film(film: Video, board: Board, *, max_rms_px: float = 0.3) -> Camera:
    """The camera from the sharp, differently posed frames of a film of a moving board.

    Raises ValueError as `calibrate_camera`, and where fewer than 6 frames show the board.
    """
    read_as, footage = _read_as(film, board)
    rows = chosen(footage)
    pictures = _pictures(film, rows, read_as)
    camera = camera_from(pictures, _names(film, rows), read_as, max_rms_px=max_rms_px)
    summary = (
        f"{len(rows)} of the {len(footage.seen)} frames of {film.path.name} that show the board were taken, "
        f"sharp and in poses as different as there are ({footage.looked} of {len(film.time)} frames "
        "were looked at)."
    )
    return replace(camera, notes=(summary, *camera.notes))


def sharp_pictures(film: Video, board: Board) -> dict[str, Image]:
    """The sharp, differently posed frames of a film past a board, by what each is called.

    Raises ValueError where fewer than 6 frames show the board.
    """
    rows = chosen(_read_as(film, board)[1])
    return dict(zip(_names(film, rows), (picture for _, _, picture in film.chosen(rows)), strict=True))


def _names(film: Video, rows: Sequence[int]) -> list[str]:
    return [f"the frame at {film.time[i]:.2f} s of {film.path.name}" for i in rows]


def _read_as(film: Video, board: Board) -> tuple[Board, BoardFilm]:
    """The board as stated, or read in the other usual way where that finds it, and its film."""
    footage = read_board_film(film, board)
    if len(footage.seen) >= MIN_IMAGES:
        return board, footage
    for reading in board.other_readings():
        again = read_board_film(film, reading.board)
        if len(again.seen) >= MIN_IMAGES:
            return reading.board, again
    pictures = _pictures(film, list(range(0, len(film.time), max(len(film.time) // 12, 1))), board)
    raise ValueError(
        f"{len(footage.seen)} of {footage.looked} frames of {film.path.name} show at least {MIN_CORNERS} "
        f"{board.shows} of the {board.columns} x {board.rows} {board.kind} board, wanted {MIN_IMAGES}"
        + board.advice(pictures, MIN_IMAGES)
    )


def _pictures(film: Video, rows: Sequence[int], board: Board) -> list[Image]:
    """Some frames of a film, black on white."""
    indices = set(rows)
    pictures = {i: board.black_on_white(picture) for i, _, picture in film.frames() if i in indices}
    return [pictures[i] for i in rows if i in pictures]


def chosen(film: BoardFilm) -> list[int]:
    """The frames, at most 30 and in order of time, that are sharp and differ most in the board's pose.

    Frames whose edges are wider than usual, or where the board moves fast, are left out. The sharpest comes
    first; then always the one whose nearest pose among those taken is farthest away.
    """
    rows = film.seen
    quality = film.blur[rows] + EXPOSED * _speed(film)
    rows = rows[quality <= max(SHARP * np.quantile(quality, 0.25), np.sort(quality)[: CHOSEN // 2][-1])]
    pose = np.array([_pose(film.views[i], film.size) for i in rows])
    taken = [int(np.argmin(film.blur[rows]))]
    while len(taken) < min(CHOSEN, len(rows)):
        apart = np.linalg.norm(pose[:, None] - pose[None, taken], axis=2).min(axis=1)
        taken.append(int(np.argmax(apart)))
    return sorted(int(rows[k]) for k in taken)


def _speed(film: BoardFilm) -> Array:
    """Motion (n,) of the board in px from frame to frame, in the frames that show it."""
    rows = film.seen
    middle = np.array([_centre(film.views[i]) for i in rows])
    each = np.hypot(*np.diff(middle, axis=0).T) / np.diff(rows)
    return np.maximum(np.append(each, 0.0), np.append(0.0, each)) if len(rows) > 1 else np.zeros(len(rows))


def _centre(view: BoardView) -> Array:
    """Pixel (2,) of the middle of the seen points, whichever of them are seen."""
    homography = fit_homography(view.points[:, :2], view.pixels)
    seen = homography @ (*view.points[:, :2].mean(axis=0), 1.0)
    return np.asarray(seen[:2] / seen[2])


def _pose(view: BoardView, size: tuple[int, int]) -> Array:
    """Numbers (6,) of order 1 for the board's place, size and tilt in the picture, for any usual lens."""
    focal = float(max(size))
    to_ray = np.array([[focal, 0.0, size[0] / 2.0], [0.0, focal, size[1] / 2.0], [0.0, 0.0, 1.0]])
    sides = np.linalg.solve(to_ray, fit_homography(view.points[:, :2], view.pixels))
    normal = np.cross(sides[:, 0], sides[:, 1])
    normal = normal / np.linalg.norm(normal)
    spread = float(np.ptp(view.pixels, axis=0).max()) / focal
    return np.array([*(_centre(view) / focal), spread, *(TILT_WEIGHT * normal)])


def rig_of_films(
    films: Sequence[Video],
    times: Sequence[Array],
    board: Board,
    cameras: Sequence[Camera],
    *,
    max_rms_px: float = 0.3,
) -> Rig:
    """The rig of cameras that filmed a moving board.

    films: of each camera.   times: (t,) s of their frames on one clock; cameras that start together and
    have no stamps give those of their films.   cameras: each from its own calibration.
    max_rms_px: px, largest error of the corners that is accepted, the errors of the stamps apart.

    Frames need not be taken at the same moments: corners are moved along their speed to common ones, and a
    lag of a camera's stamps of up to 2 frames is found (`synchronous_shots`). Raises ValueError where two
    cameras share fewer than 5 moments or the error is above the limit.
    """
    can_join(board)
    frames = _frames(times)
    views = [
        [centred(view, camera) for view in read_board_film(film, board, frames=rows).views]
        for film, rows, camera in zip(films, frames, cameras, strict=True)
    ]
    shots, lags = synchronous_shots(views, times, cameras)
    shots = _shared(shots)
    rig, noise = bundle_adjust(shots, cameras, square_mm=board.square_mm)
    rms = np.sqrt(noise.own + noise.shared)
    if rms.max() > max_rms_px:
        raise ValueError(
            f"board corners in the films fit the cameras together to {rms.max():.3f} px only, wanted at most "
            f"{max_rms_px} px: move the board slowly, light it well, and check that the time stamps of the "
            "films are of one clock"
        )
    late = ", ".join(f"{lag:+.2f}" for lag in lags[1:])
    base = np.linalg.norm(rig.shift[1:], axis=1)
    return replace(
        rig,
        remarks=(
            f"{len(cameras)} cameras from {len({v.instant for v in shots})} moments of the films of a moving "
            f"board, reprojection RMS {rms.max():.3f} px, up to {base.max():.1f} mm apart. Against the first "
            f"camera the stamps lag by {late} frames, which is taken out.",
        ),
    )


def _frames(times: Sequence[Array]) -> list[list[int]]:
    """Frames of each film in which the board is looked for: all of short films, else those round even moments
    of the time that all films share, so that all see the same moments."""
    if max(len(t) for t in times) <= ALL:
        return [list(range(len(t))) for t in times]
    start, end = max(t[0] for t in times), min(t[-1] for t in times)
    moments = np.linspace(start, end, WINDOWS + 2)[1:-1]
    period = float(np.median(np.concatenate([np.diff(t) for t in times])))
    near = [np.abs(t[:, None] - moments).min(axis=1) <= REACH * period for t in times]
    return [np.flatnonzero(rows).tolist() for rows in near]


def _shared(shots: Sequence[Shot]) -> list[Shot]:
    """Shots of moments that two cameras see, 120 moments at most; ValueError for too few."""
    moments = [v.instant for v in shots]
    shared = sorted({i for i in moments if moments.count(i) > 1})
    if len(shared) < MIN_COMMON:
        raise ValueError(
            f"two cameras see the board together at {len(shared)} moments, wanted {MIN_COMMON} or more: move "
            "it where the pictures of the cameras overlap, and check that the time stamps are of one clock"
        )
    taken = set(shared[:: -(-len(shared) // MOST)])
    return [v for v in shots if v.instant in taken]
