"""Mistakes of strangers in what twin.toml states, and in the pictures of the board: more for `mistakes`.

`MISTAKES` must be refused; `DOUBTFUL` pass, with a sentence that names the doubt.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from tests.strangers.planting import Plant, camera_with, every, exchanged, marker, toml
from tests.strangers.studio import BOARD, FILM_START, TAG, Y
from twin.marktables import FrameTable
from twin.project.config import Config
from twin.targets import Array


def board_with(**update: object) -> Plant:
    """Another board stated."""
    return camera_with(board=BOARD.model_copy(update=update))


def boards(change: Callable[[Array], Array], *, kept: int = 9) -> Plant:
    """The first pictures of the board changed, the others removed."""

    def plant(root: Path) -> None:
        for k, path in enumerate(sorted((root / "raw" / "boards").glob("*.png"))):
            picture = change(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
            path.unlink()
            if k < kept:
                cv2.imwrite(str(path), picture)

    return plant


def one_pose(root: Path) -> None:
    """The first picture of the board nine times."""
    first, *others = sorted((root / "raw" / "boards").glob("*.png"))
    for path in others:
        shutil.copy(first, path)


def without(*names: str) -> Plant:
    """Some marks left out of twin.toml."""

    def change(c: Config) -> Config:
        rows = tuple(m for m in c.frame.markers if m.name not in names)
        points = tuple(p for p in c.points if p.name not in names)
        return c.model_copy(update={"frame": FrameTable(markers=rows), "points": points})

    return toml(change)


def text(old: str, new: str) -> Plant:
    """A text of twin.toml replaced by another."""

    def plant(root: Path) -> None:
        path = root / "twin.toml"
        before = path.read_text(encoding="utf-8")
        assert old in before, old
        path.write_text(before.replace(old, new), encoding="utf-8")

    return plant


def lost(name: str) -> Plant:
    return lambda root: (root / "raw" / name).unlink()


MISTAKES: dict[str, tuple[Plant, str]] = {
    "all positions in inches": (every(place=lambda at: [v / 25.4 for v in at]), r"in inches"),
    "all positions in m": (every(place=lambda at: [v / 1000 for v in at]), r"in m instead of mm"),
    "y and z exchanged": (every(place=lambda at: (at[0], at[2], at[1])), r"not on the finger.*z up from the bottom"),
    "x and z exchanged": (every(place=lambda at: (at[2], at[1], at[0])), r"not on the finger.*x along the finger"),
    "x mirrored": (every(place=lambda at: (-at[0], at[1], at[2])), r"points.root.position_mm = \[-20.*not on the finger"),
    "the finger's sizes twice": (every(rig=False, size=2.0), r"'root' has size_mm = 18, but looks 8"),
    "the tip's size in cm": (toml(marker("tip", size_mm=TAG / 10)), r"'tip' has size_mm = 0\.9"),
    "root and its neighbour exchanged": (exchanged("root", "p2"), r"lie in the opposite order"),
    "an id stated twice": (toml(marker("frame2", marker=3)), r"marker = 3 stands twice"),
    "a name given twice": (text('name = "frame2"', 'name = "frame3"'), r"'frame3' stands twice"),
    "three frame markers": (without("frame0", "frame1", "frame2", "frame3"), r"3 with role 'frame', wanted 6 or more"),
    "no fixed markers": (without("fixed7", "fixed8", "fixed9", "fixed10"), r"0 with role 'fixed', wanted 4"),
    "no marker on the finger": (without("root", "p2", "middle", "tip"), r"points is missing; add it"),
    "squares and markers of the board exchanged": (board_with(square_mm=16.0, marker_mm=22.0), r"marker_mm = 22: wanted less than square_mm = 16 mm"),
    "another dictionary of the board": (board_with(dictionary="DICT_6X6_50"), r"DICT_4X4_50 finds \d+ in the first 2: set that dictionary"),
    "the board as a plain chessboard": (board_with(kind="chessboard"), r"DICT_4X4_50 finds \d+ markers .*is the kind charuco"),
    "boards in one pose": (one_pose, r"tilted by at most 0\.0 degrees against each other"),
    "three boards": (boards(lambda picture: picture, kept=3), r"3 of 3 board images show .* wanted 6"),
    "boards of half the size": (
        boards(lambda picture: cv2.resize(picture, (320, 200), interpolation=cv2.INTER_AREA)), r"calibrated with 320 x 200"
    ),
    "boards on their side": (boards(lambda picture: np.ascontiguousarray(np.rot90(picture))), r"one of them lies on its side"),
    "boards out of focus": (boards(lambda picture: cv2.GaussianBlur(picture, (0, 0), 7.0)), r"in the first the picture is blurred"),
    "the film is missing": (lost("film.mkv"), r"film\.mkv"),
    "the log is missing": (lost("pressure.csv"), r"pressure\.csv"),
    "the film for the static film": (text("raw/static.mkv", "raw/film.mkv"), r"static film film\.mkv has 46 frames, wanted at least 120"),
    "the static film for the film": (text('"raw/film.mkv"', '"raw/static.mkv"'), r"the finger does not move: .* are film and log of one test"),
    "film_start_s in ms": (camera_with(film_start_s=FILM_START * 1000), r"the film 14000\.000 to .* correct .* film_start_s"),
    "film_start_s left at 0": (camera_with(film_start_s=0.0, static_start_s=0.0), r"as pressure\.csv does 14\.0 s later.*correct film_start_s"),
    "a key misspelt": (text("film_start_s", "film_starts_s"), r"film_starts_s"),
    "the pattern of the boards misspelt": (text("raw/boards/*.png", "raw/boards/*.jpg"), r"raw/boards/\*\.jpg \(cameras\.boards\)"),
}  # fmt: skip

DOUBTFUL: dict[str, tuple[Plant, str]] = {
    "two fixed ids exchanged": (
        exchanged("fixed7", "fixed10"), r"Fixed marker 'fixed7' is seen at .* its id if two are exchanged"
    ),
    "a fixed marker 15 mm off": (
        toml(marker("fixed8", position_mm=(95.0, Y, 13.0))),
        r"Fixed marker 'fixed8' is seen at x = 95\.\d, z = (28|27\.9)\.?\d? mm, stated at x = 95, z = 13 mm",
    ),
}  # fmt: skip
