"""What drawn tests have in common: a camera before the finger, tags, a board in many poses, a log."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fe import Case
from twin.marktables import MarkerTable
from twin.project.cameratables import BoardTable
from vision import Mark
from vision.boards.charuco import CharucoBoard
from vision.kinds import CodedMarker
from vision.marks import codes_of

Array = NDArray[np.float64]
Pose = tuple[Array, Array]  # rvec, tvec
Spots = Sequence[tuple[float, float]]  # x, z mm
FACING = np.array([[-1.0, 0, 0], [0, 0, -1.0], [0, -1.0, 0]])  # looks along -y, z up


def before(middle: Sequence[float] | Array, away: float, degrees: Sequence[float] | Array) -> Pose:
    """Pose of a camera so many mm before a place, which looks along -y, turned about its own axes."""
    turned = np.asarray(cv2.Rodrigues(np.deg2rad(degrees))[0]) @ FACING
    tvec = np.array([0.0, 0.0, away]) - turned @ np.asarray(middle)
    return np.asarray(cv2.Rodrigues(turned)[0]).ravel(), tvec


def tags(frame: Spots, fixed: Spots, finger: Spots, *, size: float, y: float) -> tuple[Mark, ...]:
    """Coded tags of these roles in a plane, named by role and number, which is their code."""
    spots = [("frame", s) for s in frame] + [("fixed", s) for s in fixed] + [("finger", s) for s in finger]
    return tuple(
        Mark(f"{role}{i}", CodedMarker(i, size), (float(x), y, float(z)), role)
        for i, (role, (x, z)) in enumerate(spots)
    )


def rig(frame: Spots, fixed: Spots, *, size: float, y: float) -> tuple[Mark, ...]:
    """Tags of a rig, f1, f2 ... and c1, c2 ..., with codes from 10."""
    still = [("frame", f"f{k + 1}", at) for k, at in enumerate(frame)]
    still += [("fixed", f"c{k + 1}", at) for k, at in enumerate(fixed)]
    return tuple(
        Mark(name, CodedMarker(10 + k, size), (float(x), y, float(z)), role)
        for k, (role, name, (x, z)) in enumerate(still)
    )


def still_tables(marks: Sequence[Mark]) -> tuple[MarkerTable, ...]:
    """The tables [[frame.markers]] of twin.toml: of all tags that are not on the finger."""
    still = [m for m in marks if m.role != "finger"]
    codes = codes_of(still)
    return tuple(
        MarkerTable.model_validate({
            "marker": codes[k], "name": m.name, "role": m.role, "position_mm": m.position,
            "size_mm": m.size_mm,
        })
        for k, m in enumerate(still)
    )


def board_table(board: CharucoBoard) -> BoardTable:
    """The table [cameras.board] of twin.toml."""
    return BoardTable(
        columns=board.columns, rows=board.rows, square_mm=board.square_mm, marker_mm=board.marker_mm
    )


def board_poses(
    board: CharucoBoard, distance: float, reach: tuple[float, float], rng: np.random.Generator
) -> list[Pose]:
    """Poses of a board: its middle all over the picture, to `reach` mm (x, y), tilted to every side."""
    across, down = np.meshgrid(reach[0] * np.array([-1.0, 0, 1]), reach[1] * np.array([-1.0, 0, 1]))
    size = np.array([board.columns * board.square_mm, board.rows * board.square_mm, 0.0])
    poses = []
    for k, (x, y) in enumerate([*zip(across.ravel(), down.ravel()), *((0.0, 0.0),) * 5]):
        angle = 2.4 * k  # golden angle: no two boards lean the same way
        lean = np.deg2rad(rng.uniform(22.0, 38.0)) * np.array([np.cos(angle), np.sin(angle), 0.0])
        spin = np.array([0.0, 0.0, rng.uniform(-0.3, 0.3)])
        turned = np.asarray(cv2.Rodrigues(lean)[0]) @ np.asarray(cv2.Rodrigues(spin)[0])
        middle = np.array([x, y, distance * (1.0 + rng.uniform(-0.08, 0.05))])
        rvec = np.asarray(cv2.Rodrigues(turned)[0], dtype=np.float64).ravel()
        poses.append((rvec, np.asarray(middle - turned @ size / 2)))
    return poses


def side_face(case: Case) -> Array:
    """Material points (k, 3) mm round the side face of a finger: its lower edge, and back over the pleats."""
    skin = case.nodes[np.unique(case.face_nodes("outside"))]
    x = np.round(skin[:, 0], 6)
    columns = [skin[x == at] for at in np.unique(x)]
    lower = [c[np.lexsort((-c[:, 1], np.round(c[:, 2], 6)))[0]] for c in columns]
    upper = [c[np.lexsort((c[:, 1], np.round(c[:, 2], 6)))[-1]] for c in columns]
    return np.array(lower + upper[::-1])


def write_log(path: Path, time: Array, pressure: Array) -> None:
    """A pressure log: times in s, readings in MPa."""
    rows = [f"{t:.2f},{p:.7f}" for t, p in zip(time, pressure, strict=True)]
    path.write_text("\n".join(["time_s,pressure_MPa", *rows]) + "\n", encoding="utf-8")
