"""A film that lies there as a folder of pictures, with times from a file or a frame rate."""

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from vision.film.packets import Coding
from vision.film.video import Array, Image, Video, stamp_issues

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
TIMES = "times.csv"
LOSSY = (".jpg", ".jpeg")


class Pictures(Video):
    """A film that lies there as pictures, in the order of the numbers in their names.

    path: folder of PNG, JPEG, BMP or TIFF pictures, or a pattern of their names, "raw/film-*.png".
    fps: 1/s, where the folder holds no times.csv.

    times.csv has the columns file, time_s, or time_s alone with one row a picture. Raises ValueError for a
    folder without pictures, for pictures without times and for times that do not fit the pictures.
    """

    def __init__(self, path: Path | str, *, fps: float | None = None, mirrored: bool = False) -> None:
        self.path, self.mirrored = Path(path), mirrored
        self.files = _pictures(self.path)
        self.time = _times(self.files[0].parent, self.files, fps)
        picture = _read(self.files[0])
        self.height, self.width = picture.shape
        self.turns = 0
        self.issues = stamp_issues(self.path.name, self.time, 0, 0)

    def frames(self, first: int = 0, stop: int | None = None) -> Iterator[tuple[int, float, Image]]:
        """Frames from first to stop in the order of time: (index into `time`, time s, grey levels (h,w))."""
        for index, file in list(enumerate(self.files))[first:stop]:
            picture = _read(file)
            if picture.shape != (self.height, self.width):
                raise ValueError(
                    f"picture {file} has {picture.shape[1]} x {picture.shape[0]} px, "
                    f"{self.files[0].name} has {self.width} x {self.height}: wanted one size in {self.path}"
                )
            oriented = np.ascontiguousarray(picture[:, ::-1]) if self.mirrored else picture
            yield index, float(self.time[index]), oriented

    def coding(self) -> Coding:
        """mjpeg for JPEG, else png; every picture is coded on its own."""
        name = "mjpeg" if self.files[0].suffix.lower() in LOSSY else "png"
        size = np.array([file.stat().st_size for file in self.files], dtype=np.intp)
        step = np.diff(self.time)
        fps = 1.0 / float(np.median(step)) if len(step) and np.median(step) > 0 else 25.0
        return Coding(name, size, np.ones(len(size), bool), 0, fps)


def open_film(path: Path | str, *, fps: float | None = None, mirrored: bool = False) -> Video:
    """The film in a video file, or in pictures (`Pictures`, with its fps): a folder, or a name with *.

    mirrored: the camera looked into a mirror; frames are given left for right.
    """
    if Path(path).is_dir() or is_pattern(path):
        return Pictures(path, fps=fps, mirrored=mirrored)
    return Video(path, mirrored=mirrored)


def is_pattern(path: Path | str) -> bool:
    """True if a path stands for many files: its name has one of * ? [ and no file is called so.

    >>> is_pattern("raw/film-*.png"), is_pattern("raw/film.mp4")
    (True, False)
    """
    return any(c in Path(path).name for c in "*?[") and not Path(path).exists()


def _pictures(path: Path) -> tuple[Path, ...]:
    pattern = is_pattern(path)
    folder = path.parent if pattern else path
    if not folder.is_dir():
        raise ValueError(f"film {folder} does not exist: give a video file or a folder of pictures")
    every = folder.glob(path.name) if pattern else folder.iterdir()
    files = [p for p in every if p.suffix.lower() in SUFFIXES]
    if not files:
        raise ValueError(
            f"{'pattern' if pattern else 'folder'} {path} holds no picture: wanted {', '.join(SUFFIXES)}"
        )
    return tuple(sorted(files, key=lambda p: [int(n) for n in re.findall(r"\d+", p.stem)] or [-1]))


def _times(folder: Path, files: Sequence[Path], fps: float | None) -> Array:
    """Times (t,) s of the files, increasing; the files are put into their order by their names."""
    table = folder / TIMES
    if not table.is_file():
        if fps is None:
            raise ValueError(
                f"folder {folder} has no {TIMES} (columns file, time_s) and no frame rate is given: add one "
                "of them; for a project set fps in twin.toml"
            )
        return np.arange(len(files)) / fps
    with open(table, newline="", encoding="utf-8-sig") as file:
        rows = list(csv.DictReader(file))
    try:
        if rows and "file" in rows[0]:
            time_of = {row["file"]: float(row["time_s"]) for row in rows}
            time = np.array([time_of[p.name] for p in files])
        else:
            time = np.array([float(row["time_s"]) for row in rows])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{table}: {error} is missing or is no time in s; wanted the columns file, time_s with one row "
            "for every picture"
        ) from None
    if len(time) != len(files) or not np.isfinite(time).all() or np.any(np.diff(time) < 0):
        raise ValueError(
            f"{table} has {len(time)} times for {len(files)} pictures, or times that are not increasing: "
            "wanted one row for every picture, in the order of the numbers in their names"
        )
    return time


def _read(file: Path) -> Image:
    picture = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ValueError(f"picture {file} cannot be read: remove it or copy it again")
    return np.asarray(picture, dtype=np.uint8)
