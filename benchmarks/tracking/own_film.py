"""Recordings of a newcomer's own film, drawn: a finger before the printed sheet, a board, and a log."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.tracking.studio import FACING, before, board_poses, write_log

import cv2
import numpy as np

from twin.marktables import MarkerTable
from twin.targets import Array
from vision import Camera, Mark
from vision.boards.charuco import CharucoBoard
from vision.drawing import synthetic
from vision.kinds import CodedMarker

SIZE, RATE, FRAMES, STILL = (800, 500), 10.0, 66, 300
PX_PER_MM, AWAY, RIG_AWAY = 3.0, 900.0, 1200.0  # mm, of the film, and of pictures of the rig
FILM_START, STATIC_START, LOG_END = 34.0, 1.0, 45.0  # s on the clock of the log
TOP_MPA = 0.03
BOARD = CharucoBoard(columns=8, rows=6, square_mm=15.0, marker_mm=11.2)  # another than the template's
SINKS = np.array([(0.0, -1.5), (-0.6, -6.0), (-1.5, -12.0), (-5.0, -25.0)])  # mm at the top, by id
ALONG = (20.0, 45.0, 65.0, 108.0)  # x mm, near the lower edge of the side face
TAG_MM, UP_MM = 7.0, 4.0


def pressure(time: Array) -> Array:
    """MPa at times on the log's clock: two rises, as the protocol of the docs has."""
    share = np.interp(time - FILM_START, [2.0, 3.4, 4.4, 5.4], [0.0, 0.6, 0.6, 1.0])
    return TOP_MPA * share


def finger_tags(y: float) -> tuple[Mark, ...]:
    """The tags of the finger at rest."""
    return tuple(Mark(f"t{k}", CodedMarker(k, TAG_MM), (x, y, UP_MM), "finger") for k, x in enumerate(ALONG))


def _lens() -> Camera:
    focal = PX_PER_MM * AWAY
    matrix = np.array([[focal, 0.0, 0.5 * SIZE[0] + 2.0], [0.0, focal, 0.5 * SIZE[1] - 3.0], [0, 0, 1.0]])
    return Camera(matrix, np.array([-0.1, 0.0, 0.0, 0.0, 0.0]), SIZE)


def _marks(rig: Sequence[MarkerTable]) -> list[Mark]:
    sides = [(m, m.marker, m.size_mm) for m in rig]
    return [Mark(m.name, CodedMarker(k or 0, mm or 0.0), m.position_mm, m.role) for m, k, mm in sides]


def write_rig(folder: Path, rig: Sequence[MarkerTable], *, seed: int = 1) -> None:
    """Pictures of the board lying in the middle of the rig, from nine sides."""
    middle = np.mean([m.position_mm for m in rig], axis=0)
    half = 0.5 * BOARD.square_mm * np.array([BOARD.columns, BOARD.rows, 0.0])
    folder.mkdir(parents=True)
    poses = board_poses(BOARD, RIG_AWAY, (8.0, 5.0), np.random.default_rng(seed))[:9]
    for k, (turn, shift) in enumerate(poses):
        turned = np.asarray(cv2.Rodrigues(turn)[0]) @ FACING  # world to the board's axes, to the camera's
        pose = np.asarray(cv2.Rodrigues(turned)[0]).ravel(), shift - turned @ (middle - FACING.T @ half)
        picture = synthetic.board_image(
            _lens(), BOARD, (turn, shift), seed=seed + k, marks=_marks(rig), marks_pose=pose
        )
        cv2.imwrite(str(folder / f"r{k:02d}.png"), picture)


def write_recordings(
    raw: Path, rig: Sequence[MarkerTable], *, still: int = STILL, seed: int = 1
) -> Mapping[int, Array]:
    """film.mkv, static.mkv, pictures of a board and log.csv in a folder, and the true places (3,) mm of the
    finger's tags at rest, by id.   rig: the sheet's markers, seen from +y.   still: frames of static.mkv."""
    y = rig[0].position_mm[1]
    on_rig = _marks(rig)
    own = finger_tags(y)
    marks = [*on_rig, *own]
    middle = np.mean([m.position for m in on_rig], axis=0)
    lens = _lens()
    time = np.arange(FRAMES) / RATE
    share = pressure(time + FILM_START) / TOP_MPA
    for name, shares in (("film", share), ("static", np.zeros(still))):
        place = np.tile([m.position for m in marks], (len(shares), 1, 1)).astype(np.float64)
        place[:, len(on_rig) :, ::2] += shares[:, None, None] * SINKS
        synthetic.film(
            raw / f"{name}.mkv", camera=lens, pose=before(middle, AWAY, [0.6, 0.8, 0.3]), marks=marks,
            positions=place, rotations=np.zeros(place.shape[:2]), fps=RATE, codec="rawvideo",
            seed=seed + len(shares),
        )  # fmt: skip
    (raw / "board").mkdir(parents=True)
    for k, pose in enumerate(board_poses(BOARD, AWAY, (50.0, 25.0), np.random.default_rng(seed))[:10]):
        picture = synthetic.board_image(lens, BOARD, pose, seed=seed + k)
        cv2.imwrite(str(raw / "board" / f"b{k:02d}.png"), picture)
    log = np.arange(0.0, LOG_END, 0.02)
    noise = 1e-5 * np.random.default_rng(seed).standard_normal(len(log))
    write_log(raw / "log.csv", log, pressure(log) + noise)
    return {k: np.array(mark.position) for k, mark in enumerate(own)}
