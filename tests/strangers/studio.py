"""A small drawn project that is right: one camera, seven frame, four fixed and four finger markers, lossless.

What strangers do wrong is planted in it by `planting`.
"""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.tracking.studio import before, still_tables

import cv2
import numpy as np

from twin import files
from twin.gauge.pressuretable import PressureTable
from twin.marktables import FrameTable, PointTable
from twin.project.cameratables import BoardTable, CameraTable, MeasureTable
from twin.project.config import Config, ProjectTable
from twin.project.toml import dump
from twin.targets import Array
from vision import Board, Camera, Mark
from vision.drawing import synthetic
from vision.kinds import CodedMarker

SIZE, RATE, FRAMES, STILL = (640, 400), 10.0, 46, 120
MIDDLE, Y, TAG = np.array([45.0, 11.5, -15.0]), 11.5, 9.0
BOARD = BoardTable(columns=7, rows=5, square_mm=22.0, marker_mm=16.0)
STATIC_START, FILM_START, LOG_END = 0.5, 14.0, 26.0  # s on the clock of the log
RAMP_S, PEAK_MPA = (2.0, 3.2), 0.03
SINKS = {"root": (0.0, -1.5), "p2": (-0.6, -6.0), "middle": (-1.5, -11.0), "tip": (-4.0, -20.0)}  # mm
POINTS = {"root": 20.0, "p2": 37.0, "middle": 54.0, "tip": 110.0}  # x mm on the lower edge of the side face
PLACES = {
    "frame": [(-24, 26), (30, 30), (70, 30), (120, 26), (-24, -58), (45, -60), (120, -58)],
    "fixed": [(5, 28), (95, 28), (-26, -15), (122, -18)],
}


def marks_of() -> list[Mark]:
    """All marks as they are really glued."""
    flat = [(role, x, z) for role, spots in PLACES.items() for x, z in spots]
    still = [
        Mark(f"{role}{k}", CodedMarker(k, TAG), (float(x), Y, float(z)), role)
        for k, (role, x, z) in enumerate(flat)
    ]
    finger = [
        Mark(n, CodedMarker(20 + k, TAG), (x, Y, 0.0), "finger") for k, (n, x) in enumerate(POINTS.items())
    ]
    return still + finger


def camera() -> tuple[Camera, tuple[Array, Array]]:
    """The camera and its pose, 420 mm before the plane."""
    matrix = np.array([[1350.0, 0, 322], [0, 1351.0, 198], [0, 0, 1]])
    return Camera(matrix, np.array([-0.1, 0.0, 0.0, 0.0, 0.0]), SIZE), before(MIDDLE, 420.0, [2.0, 1.5, 0.0])


def ramp(time: Array) -> Array:
    """The share of the peak pressure at times of the film."""
    low, high = RAMP_S
    return np.clip((time - low) / (high - low), 0.0, 1.0)


def motion(marks: Sequence[Mark], time: Array) -> Array:
    """Places (t,p,3) mm: the finger's marks sink as the pressure rises."""
    place = np.tile([m.position for m in marks], (len(time), 1, 1)).astype(np.float64)
    for p, mark in enumerate(marks):
        if mark.name in SINKS:
            place[:, p, ::2] += np.outer(ramp(time), SINKS[mark.name])
    return place


def draw(
    path: Path,
    place: Array,
    *,
    marks: Sequence[Mark] | None = None,
    seed: int = 0,
    blur_px: float = 0.8,
) -> None:
    """A film, lossless, of marks at places (t,p,3) mm."""
    lens, pose = camera()
    synthetic.film(
        path,
        camera=lens,
        pose=pose,
        marks=list(marks or marks_of()),
        positions=place,
        rotations=np.zeros(place.shape[:2]),
        fps=RATE,
        blur_px=blur_px,
        codec="rawvideo",
        seed=seed,
    )


def film_time() -> Array:
    return np.arange(FRAMES) / RATE


def log_text(
    *, time: Array | None = None, factor: float = 1.0, head: str = "time_s,pressure_MPa", shift: float = 0.0
) -> str:
    """The log of the test, times a factor, `shift` s late."""
    t = np.arange(0.0, LOG_END, 0.02) if time is None else time
    noise = 1e-5 * np.random.default_rng(5).standard_normal(len(t))
    p = factor * (PEAK_MPA * ramp(t - FILM_START - shift) + noise)
    return head + "\n" + "".join(f"{a:.2f},{b:.9g}\n" for a, b in zip(t, p))


def config_of() -> Config:
    """The twin.toml of the project that is right."""
    points = tuple(
        PointTable(name=m.name, marker=m.kind.code, size_mm=TAG, position_mm=m.position)
        for m in marks_of()
        if m.role == "finger"
    )
    side = CameraTable(
        name="side",
        film="raw/film.mkv",
        static="raw/static.mkv",
        boards="raw/boards/*.png",
        board=BOARD,
        film_start_s=FILM_START,
        static_start_s=STATIC_START,
    )
    return Config(
        project=ProjectTable(name="stranger"),
        cameras=(side,),
        pressure=PressureTable(),
        measure=MeasureTable(),
        frame=FrameTable(markers=still_tables(marks_of())),
        points=points,
    )


def draw_boards(folder: Path) -> None:
    """The board in nine poses, all tilted otherwise."""
    rng, board, (lens, _) = np.random.default_rng(3), Board.of(**BOARD.model_dump()), camera()
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(9):
        angle, lean = 2.4 * k, rng.uniform(0.35, 0.6)
        tilt, _ = cv2.Rodrigues(np.array([lean * np.cos(angle), lean * np.sin(angle), rng.normal(0, 0.2)]))
        middle = np.r_[rng.uniform(-40, 40), rng.uniform(-22, 22), rng.uniform(400, 470)]
        pose = (cv2.Rodrigues(tilt)[0].ravel(), middle - tilt @ np.array([77.0, 55.0, 0.0]))
        cv2.imwrite(str(folder / f"b{k:02d}.png"), synthetic.board_image(lens, board, pose, seed=k))


def make(root: Path) -> Path:
    """The project that is right, in a folder."""
    (root / "raw").mkdir(parents=True)
    draw_boards(root / "raw" / "boards")
    draw(root / "raw" / "film.mkv", motion(marks_of(), film_time()), seed=1)
    draw(root / "raw" / "static.mkv", motion(marks_of(), np.zeros(STILL)), seed=2)
    files.write_text(root / "raw" / "pressure.csv", log_text())
    files.write_text(root / "twin.toml", dump(config_of()))
    return root
