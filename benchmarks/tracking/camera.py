"""Cameras from boards: drawn ones against the truth, real ones against their halves; real markers.

    python benchmarks/tracking/camera.py [--quick] [--json]

Drawn: every camera has its own lens (f, centre, k1 k2 p1 p2) and ten pictures of a board in random poses, of
each kind in turn; the lens model is chosen by the program. A pull is error over stated sd, of fx fy cx cy; 1
is right. Real ($SOFTTWIN_DATA): `opencv_boards` left and right; each set is split into halves at random, and
the squared difference of the two cameras over their covariances, by number of parameters, should be 1.
"""

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import SHARED
from benchmarks.commandline import whole

import cv2
import numpy as np
from numpy.typing import NDArray

from vision import Board, Camera, calibrate_camera, locate
from vision.boards.charuco import CharucoBoard
from vision.boards.chessboard import Chessboard
from vision.boards.circles import AsymmetricCircleBoard, CircleBoard
from vision.calibration import lens
from vision.drawing import synthetic
from vision.following.registration import project
from vision.plane import fit_homography

Array = NDArray[np.float64]
BOARDS = (
    CharucoBoard(columns=8, rows=6, square_mm=11.0, marker_mm=8.0, dictionary="DICT_5X5_100"),
    Chessboard(columns=8, rows=6, square_mm=10.0),
    CircleBoard(columns=8, rows=6, square_mm=10.0),
    AsymmetricCircleBoard(columns=4, rows=11, square_mm=7.0),
)
PICTURES, HALVES = 10, 40
MODEL = ("k1", "k2", "p1", "p2")


def drawn_camera(rng: np.random.Generator) -> Camera:
    focal, off = rng.uniform(700.0, 1100.0), rng.normal(0.0, 8.0, 2)
    matrix = np.array(
        [[focal, 0, 320 + off[0]], [0, focal * (1 + rng.normal(0, 2e-3)), 240 + off[1]], [0, 0, 1]]
    )
    terms = rng.normal(0.0, (0.12, 0.1, 1e-3, 1e-3))
    return Camera(matrix, np.array([*terms, 0.0]), (640, 480))


def pose(rng: np.random.Generator, camera: Camera, board: Board) -> tuple[Array, Array]:
    """A board tilted by up to 30 degrees that fills about half of the picture, anywhere in it."""
    points = board.points
    rvec = np.array([*np.deg2rad(rng.uniform(-30, 30, 2)), rng.uniform(-0.3, 0.3)])
    extent = np.max(np.ptp(points[:, :2], axis=0) / camera.size)
    distance = camera.matrix[0, 0] * extent / rng.uniform(0.5, 0.65)
    place = np.array([*rng.uniform(-0.1, 0.1, 2) * distance * (640 / camera.matrix[0, 0]), distance])
    return rvec, place - cv2.Rodrigues(rvec)[0] @ points.mean(axis=0)


def drawn(board: Board, rng: np.random.Generator, folder: Path) -> tuple[Array, Camera]:
    """Pulls (4,) of fx fy cx cy of one drawn camera, and what was found."""
    truth = drawn_camera(rng)
    paths = [folder / f"{i}.png" for i in range(PICTURES)]
    for path in paths:
        seed = int(rng.integers(1 << 30))
        picture = synthetic.board_image(truth, board, pose(rng, truth, board), seed=seed)
        cv2.imwrite(str(path), picture)
    found = calibrate_camera(paths, board)
    return (found.parameters - truth.parameters)[:4] / found.stdevs[:4], found


def pulls(count: int) -> dict[str, float]:
    """Rms pull by kind of board, over `count` cameras each."""
    rng, told = np.random.default_rng(7), {}
    for board in BOARDS:
        with tempfile.TemporaryDirectory() as folder:
            each = [drawn(board, rng, Path(folder)) for _ in range(count)]
        told[board.kind] = float(np.sqrt(np.mean([p**2 for p, _ in each])))
        rms = np.median([camera.rms_px for _, camera in each])
        sd = np.median([camera.stdevs[0] for _, camera in each])
        said = f"{board.kind:12s} {count} cameras: rms {rms:.4f} px, sd of fx {sd:.3f} px, pull"
        print(f"{said} {told[board.kind]:.2f}", file=sys.stderr)
    return told


def real_halves(paths: list[Path], board: Board) -> tuple[float, float]:
    """Reprojection rms (px) of all pictures, and the mean normalised difference of random halves."""
    camera = calibrate_camera(paths, board)
    views = [
        board.find(np.asarray(cv2.imread(str(p), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)) for p in paths
    ]
    rng, found = np.random.default_rng(0), []
    for _ in range(HALVES):
        order = rng.permutation(len(views))
        halves = [[views[i] for i in order[k::2]] for k in (0, 1)]
        fits = [lens.fit_lens(half, camera.size, MODEL) for half in halves]
        both = sum(lens.covariance(fit, half)[0] for fit, half in zip(fits, halves, strict=True))[:8, :8]
        gap = (fits[0].camera.parameters - fits[1].camera.parameters)[:8]
        found.append(gap @ np.linalg.solve(both, gap) / 8.0)
    return camera.rms_px, float(np.mean(found))


def real(folder: Path) -> dict[str, Any]:
    """Figures of the real pictures."""
    told: dict[str, Any] = {}
    for side in ("left", "right"):
        board = Chessboard(columns=9, rows=6, square_mm=25.0)
        rms, halves = real_halves(sorted(folder.glob(f"{side}*.jpg")), board)
        told |= {f"camera_{side}_rms_px": rms, f"camera_{side}_halves": halves}
        print(f"{side}: rms {rms:.4f} px; halves differ by {halves:.2f} of their covariance", file=sys.stderr)
    picture = np.asarray(cv2.imread(str(folder / "gboriginal.png"), cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    found = locate(picture, dictionary=str(folder / "tutorial_dict.yml"))
    plane = np.stack([found.ids % 5, found.ids // 5], axis=1) * 50.0
    homography = fit_homography(plane, found.centre)
    nominal = project(homography, np.concatenate([plane.T, np.ones((1, len(plane)))]))
    rms = float(np.sqrt(np.mean((found.centre - nominal) ** 2)))
    print(f"gboriginal: {len(found.ids)} of 35, centres to the plane {rms:.4f} px rms", file=sys.stderr)
    return told | {"gboriginal_found": len(found.ids), "gboriginal_rms_px": rms}


def figures(quick: bool) -> dict[str, Any]:
    """Pulls of drawn cameras, and the figures of real boards where their pictures are there."""
    by_kind = pulls(6 if quick else 25)
    told: dict[str, Any] = {"camera_pull_sd": float(np.sqrt(np.mean([p**2 for p in by_kind.values()])))}
    folder = SHARED / "opencv_boards"
    return told | (real(folder) if folder.is_dir() else {})


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="6 cameras of each kind in place of 25"))
