"""Mistakes of strangers in what twin.toml states, and in the pictures of the board: more for `mistakes`."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from tests.strangers.planting import Plant, camera_with, every, exchanged, marker, toml
from tests.strangers.studio import BOARD, FILM_START, TAG, Y
from twin.project.config import Config, FrameTable
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
    "y and z exchanged": (every(place=lambda at: (at[0], at[2], at[1])), r"."),
    "x and z exchanged": (every(place=lambda at: (at[2], at[1], at[0])), r"."),
    "x mirrored": (every(place=lambda at: (-at[0], at[1], at[2])), r"mirrored"),
    "the finger's sizes twice": (every(rig=False, size=2.0), r"."),
    "the tip's size in cm": (toml(marker("tip", size_mm=TAG / 10)), r"'tip' has size_mm = 0\.9"),
    "two fixed ids exchanged": (exchanged("fixed7", "fixed10"), r"have each other's places"),
    "root and its neighbour exchanged": (exchanged("root", "p2"), r"lie in the opposite order"),
    "a fixed marker 15 mm off": (
        toml(marker("fixed8", position_mm=(95.0, Y, 13.0))), r"'fixed8' lies 1[45]\.\d mm"
    ),
    "an id stated twice": (toml(marker("frame2", marker=3)), r"."),
    "a name given twice": (toml(marker("frame2", name="frame3")), r"."),
    "three frame markers": (without("frame0", "frame1", "frame2", "frame3"), r"."),
    "no fixed markers": (without("fixed7", "fixed8", "fixed9", "fixed10"), r"."),
    "no marker on the finger": (without("root", "p2", "middle", "tip"), r"."),
    "board squares in cm": (board_with(square_mm=2.2, marker_mm=1.6), r"."),
    "board squares in inches": (board_with(square_mm=22 / 25.4, marker_mm=16 / 25.4), r"."),
    "squares and markers of the board exchanged": (board_with(square_mm=16.0, marker_mm=22.0), r"."),
    "board squares of a page printed at 70 %": (board_with(square_mm=15.4, marker_mm=11.2), r"."),
    "another dictionary of the board": (board_with(dictionary="DICT_6X6_50"), r"."),
    "the board as a plain chessboard": (board_with(kind="chessboard"), r"."),
    "boards in one pose": (one_pose, r"."),
    "three boards": (boards(lambda picture: picture, kept=3), r"."),
    "boards of half the size": (
        boards(lambda picture: cv2.resize(picture, (320, 200), interpolation=cv2.INTER_AREA)), r"."
    ),
    "boards on their side": (boards(lambda picture: np.ascontiguousarray(np.rot90(picture))), r"."),
    "boards out of focus": (boards(lambda picture: cv2.GaussianBlur(picture, (0, 0), 7.0)), r"."),
    "the film is missing": (lost("film.mkv"), r"film\.mkv"),
    "the log is missing": (lost("pressure.csv"), r"pressure\.csv"),
    "the film for the static film": (text("raw/static.mkv", "raw/film.mkv"), r"."),
    "the static film for the film": (text('"raw/film.mkv"', '"raw/static.mkv"'), r"."),
    "film_start_s in ms": (camera_with(film_start_s=FILM_START * 1000), r"."),
    "film_start_s left at 0": (camera_with(film_start_s=0.0, static_start_s=0.0), r"."),
    "a key misspelt": (text("film_start_s", "film_starts_s"), r"film_starts_s"),
    "the pattern of the boards misspelt": (text("raw/boards/*.png", "raw/boards/*.jpg"), r"."),
}  # fmt: skip
