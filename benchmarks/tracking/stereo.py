"""Real film of a board by four cameras: squares of 54 mm on frames that the calibration never saw.

    python benchmarks/tracking/stereo.py [--quick] [--json]

Every second instant calibrates all four cameras together; in the others the board's squares are measured by
each pair of cameras and by all four. Then the other way round. `stereo_mean_mm` is the mean error of the
pair that is worst; `stereo_pull_sd` the rms of error over stated sd, over all pairs and both halves. Data:
$SOFTTWIN_DATA/charuco_4cam, from caliscope.
"""

import csv
import itertools
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import SHARED
from benchmarks.commandline import whole

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from vision import Camera, Video
from vision.boards.board import BoardView
from vision.boards.charuco import CharucoBoard
from vision.calibration.bundle import CornerNoise, Shot, bundle_adjust
from vision.calibration.rig import OWN, Rig, project, same, triangulate
from vision.calibration.stereo import synchronous_shots
from vision.camera import Array

DATA = SHARED / "charuco_4cam"
BOARD = CharucoBoard(
    columns=4, rows=5, square_mm=54.0, marker_mm=40.5, dictionary="DICT_4X4_1000", inverted=True
)
SIZE = (1280, 720)  # px


def read(folder: Path, most: int | None) -> tuple[list[Any], list[Array]]:
    """Corners in the first `most` frames of every camera, and their time stamps (t,) s."""
    with (folder / "timestamps.csv").open() as file:
        rows = list(csv.DictReader(file))
    times = [np.array([float(r["frame_time"]) for r in rows if int(r["cam_id"]) == c]) for c in range(4)]
    found = []
    for c in range(4):
        pictures = (picture for *_, picture in Video(folder / f"cam_{c}.mp4").frames())
        found.append([BOARD.find(BOARD.black_on_white(p)) for p in itertools.islice(pictures, most)])
    return found, [t[:most] for t in times]


def alone(found: Sequence[BoardView]) -> Camera:
    """One camera from its own pictures, k3 held: twelve corners a picture do not tell it."""
    used = [(v.points.astype(np.float32), v.pixels.astype(np.float32)) for v in found if len(v) >= 8]
    rms, matrix, distortion, *_ = cv2.calibrateCamera(
        [p for p, _ in used], [q for _, q in used], SIZE, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
    )
    return Camera(
        np.asarray(matrix), np.asarray(distortion).ravel()[:5], SIZE, rms, len(used),
        model=("k1", "k2", "p1", "p2"),
    )  # fmt: skip


def locate(
    rig: Rig, shots: Sequence[Shot], noise: CornerNoise, *, square_mm: float
) -> tuple[Array, Array, Array]:
    """Corners of one board at one instant: which (n,3) mm on the board, where (n,3) mm in the rig's frame,
    and the covariance (3n,3n) mm2 of all these places, calibration included.

    shots: of one instant, of different cameras; corners that only one of them shows are left out.
    noise: of the corners, from `bundle`.

    Generalised least squares of all corners at once: a time error moves a whole picture, shows as distance
    from the epipolar lines and is taken out.
    """
    points = _common([v.points for v in shots])
    if not len(points):
        return points, np.empty((0, 3)), np.empty((0, 0))
    rows = [same(v.points, points) for v in shots]
    kept = [v.only(mine) for v, (mine, _) in zip(shots, rows, strict=True)]
    ideal = np.full((len(kept), len(points), 2), np.nan)
    for pixels, v, (_, row) in zip(ideal, kept, rows, strict=True):
        pixels[row] = rig.cameras[v.camera].undistort(v.pixels)
    unit = np.broadcast_to(np.eye(2), (*ideal.shape, 2))
    place, _ = triangulate(rig.matrices[[v.camera for v in kept]], ideal, unit)
    weight = block_diag(*[np.linalg.inv(noise.covariance(v, square_mm)) for v in kept])
    spread, turned = np.empty((0, 0)), np.empty((0, 0))
    for _ in range(4):
        residual, slope, shared = _free_points(rig.parameters, kept, [row for _, row in rows], place)
        heavy = weight @ slope
        spread = np.asarray(np.linalg.inv(slope.T @ heavy), dtype=np.float64)
        place = place + (spread @ (heavy.T @ residual)).reshape(-1, 3)
        turned = spread @ (heavy.T @ shared)
    return points, place, spread + turned @ rig.covariance @ turned.T


def _free_points(
    theta: Array, shots: list[Shot], rows: list[NDArray[np.intp]], place: Array
) -> tuple[Array, Array, Array]:
    """Residual (m,), derivatives to the places (m,3n) and to the rig's parameters (m,15c)."""
    residual, slope, shared = [], [], []
    for v, row in zip(shots, rows, strict=True):
        m = 2 * len(row)
        pixels, to_camera, to_pose = project(theta[v.camera], np.zeros(3), np.zeros(3), place[row])
        own, wide = np.zeros((m, *place.shape)), np.zeros((m, theta.size))
        own[np.arange(m), np.repeat(row, 2)] = to_pose[:, 3:]
        wide[:, OWN * v.camera : OWN * (v.camera + 1)] = to_camera
        residual.append((v.pixels - pixels).ravel())
        slope.append(own.reshape(m, -1))
        shared.append(wide)
    return np.concatenate(residual), np.concatenate(slope), np.concatenate(shared)


def _common(points: Sequence[Array]) -> Array:
    """Board points (n,3) that stand in at least two of the lists."""
    every, count = np.unique(np.concatenate(points), axis=0, return_counts=True)
    return np.asarray(every[count >= 2])


def squares(rig: Rig, noise: CornerNoise, shots: list[Shot], cameras: tuple[int, ...]) -> Array:
    """Errors (n,) mm of the squares' sides and their stated sd (n,), as (2,n)."""
    rows = []
    for instant in sorted({v.instant for v in shots}):
        here = [v for v in shots if v.instant == instant and v.camera in cameras]
        if len(here) < 2:
            continue
        points, place, covariance = locate(rig, here, noise, square_mm=BOARD.square_mm)
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        for i, j in zip(*np.nonzero(np.triu(np.abs(apart - BOARD.square_mm) < 1e-3)), strict=True):
            side = place[j] - place[i]
            length = float(np.linalg.norm(side))
            slope = np.zeros(place.shape)
            slope[j], slope[i] = side / length, -side / length
            rows.append((length - BOARD.square_mm, np.sqrt(slope.ravel() @ covariance @ slope.ravel())))
    return np.array(rows).T


def held_out(
    folder: Path, *, halves: tuple[int, ...] = (0, 1), most: int | None = None
) -> dict[str, Array]:
    """Errors and stated sds (2,n) mm of each pair of cameras and of all four; each half is held out once."""
    found, times = read(folder, most)
    result: dict[str, list[Array]] = {}
    whole = [alone(pictures) for pictures in found]
    shots, lags = synchronous_shots(found, times, whole)
    print(f"frames by which the cameras lag: {lags.tolist()}", file=sys.stderr)
    for half in halves:
        calibrating = [v for v in shots if v.instant % 2 != half]
        own = [[BoardView(v.points, v.pixels) for v in calibrating if v.camera == c] for c in range(4)]
        cameras = [alone(pictures) for pictures in own]
        rig, noise = bundle_adjust(calibrating, cameras, square_mm=BOARD.square_mm)
        kept = [v for v in shots if v.instant % 2 == half]
        for group in (*itertools.combinations(range(4), 2), (0, 1, 2, 3)):
            result.setdefault("-".join(map(str, group)), []).append(squares(rig, noise, kept, group))
    return {name: np.concatenate(parts, axis=1) for name, parts in result.items()}


def figures(quick: bool) -> dict[str, Any]:
    """Mean error of the worst pair and rms pull; None where the films are absent."""
    if not DATA.is_dir():
        return {"stereo_mean_mm": None, "stereo_pull_sd": None}
    found = held_out(DATA, halves=(0,) if quick else (0, 1))
    pairs = {name: value for name, value in found.items() if len(name) == 3}
    print(
        "| cameras | squares | mean mm | sd mm | stated sd mm | pull rms |\n|---|---|---|---|---|---|",
        file=sys.stderr,
    )
    for name, (error, sd) in found.items():
        stated, pull = (np.sqrt(np.mean(x**2)) for x in (sd, error / sd))
        told = f"{len(error)} | {error.mean():+.3f} | {error.std():.3f} | {stated:.3f} | {pull:.2f}"
        print(f"| {name} | {told} |", file=sys.stderr)
    pulls = np.concatenate([error / sd for error, sd in pairs.values()])
    worst = max((error for error, _ in pairs.values()), key=lambda error: abs(error.mean()))
    return {
        "stereo_mean_mm": float(worst.mean()),
        "stereo_mean_se_mm": float(worst.std() / np.sqrt(len(worst))),
        "stereo_pull_sd": float(np.sqrt(np.mean(pulls**2))),
        "stereo_pull_se": float(np.std(pulls**2) / np.sqrt(len(pulls)) / (2.0 * np.sqrt(np.mean(pulls**2)))),
    }


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="half of the frames"))
