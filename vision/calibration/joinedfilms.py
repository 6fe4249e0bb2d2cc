"""The rig of several cameras from films of one board that is moved before them, by their time stamps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vision.boards.board import Board
from vision.calibration.boardfilms import read_board_film
from vision.calibration.bundle import Shot, bundle_adjust
from vision.calibration.lens import centred
from vision.calibration.rig import Rig
from vision.calibration.stereo import MIN_COMMON, can_join, synchronous_shots
from vision.camera import Array, Camera
from vision.film.video import Video

WINDOWS, REACH = 60, 4.5  # looks at so many moments, and at the frames so many periods round each
MOST = 120  # instants that calibrate the rig
ALL = 400  # frames of a film, up to which every frame is looked at


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
    wanted = _frames(times)
    found = [
        [centred(view, camera) for view in read_board_film(film, board, frames=rows).views]
        for film, rows, camera in zip(films, wanted, cameras, strict=True)
    ]
    shots, lags = synchronous_shots(found, times, cameras)
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
    first, last = max(t[0] for t in times), min(t[-1] for t in times)
    moments = np.linspace(first, last, WINDOWS + 2)[1:-1]
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
    kept = set(shared[:: -(-len(shared) // MOST)])
    return [v for v in shots if v.instant in kept]
