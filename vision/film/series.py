"""A film that lies there as a folder of pictures, with times from a file or a frame rate."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.numbering import in_order, is_litter, times_of_numbers, told_of_numbers
from vision.film.packets import Coding
from vision.film.video import Array, Image, Video, stamp_issues

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
TIMES = "times.csv"
LOSSY = (".jpg", ".jpeg")
LOOKED_AT = 16  # pictures, for the bits that their grey levels have


class Pictures(Video):
    """A film that lies there as pictures, in the order of the numbers in their names.

    path: folder of PNG, JPEG, BMP or TIFF pictures, or a pattern of their names, "raw/film-*.png".
    fps: 1/s of the camera, whose pictures the names count, where the folder holds no times.csv.

    times.csv has the columns file, time_s, or time_s alone with one row a picture. Raises ValueError for a
    folder without pictures, for pictures without times and for times that do not fit the pictures.
    """

    def __init__(self, path: Path | str, *, fps: float | None = None, mirrored: bool = False) -> None:
        self.path, self.mirrored = Path(path), mirrored
        self.files, self.time, told = _timed(_pictures(self.path), fps)
        self.bits = bits_of_pictures(self.files)
        self.height, self.width = read_picture(self.files[0], self.bits).shape
        self.turns = 0
        self.issues = (*stamp_issues(self.path.name, self.time, 0, 0), *told)
        if self.bits not in (8, 16):
            self.issues += (f"{self.path.name}: the grey levels have {self.bits} bits in pictures of 16.",)

    def frames(self, first: int = 0, stop: int | None = None) -> Iterator[tuple[int, float, Image]]:
        """Frames from first to stop in the order of time: (index into `time`, time s, grey levels (h,w))."""
        for index, file in list(enumerate(self.files))[first:stop]:
            picture = read_picture(file, self.bits)
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
    files = sorted(p for p in every if p.suffix.lower() in SUFFIXES and not is_litter(p))
    if not files:
        raise ValueError(
            f"{'pattern' if pattern else 'folder'} {path} holds no picture: wanted {', '.join(SUFFIXES)}"
        )
    return tuple(files)


def _timed(files: Sequence[Path], fps: float | None) -> tuple[tuple[Path, ...], Array, tuple[str, ...]]:
    """Files of a folder in order, their times (t,) s, of times.csv or else by their names, and remarks."""
    table = files[0].parent / TIMES
    if table.exists():
        return *_tabled(table, files), ()
    if fps is None:
        raise ValueError(
            f"folder {table.parent} has no {TIMES} (columns file, time_s) and no frame rate is given: add "
            "one of them; for a project set fps in twin.toml"
        )
    ordered, numbers = in_order(files)
    if not numbers:
        raise ValueError(
            f"{table.parent}: several numbers change in the names, as from {ordered[0].name} to "
            f"{ordered[1].name}, and it is unknown which counts the pictures; name those of one camera by a "
            f"pattern, such as cam1_*, or give {TIMES} with the columns file, time_s"
        )
    time = times_of_numbers(numbers, fps, where=table.parent)
    return tuple(ordered), time, told_of_numbers(ordered, numbers)


def _tabled(table: Path, files: Sequence[Path]) -> tuple[tuple[Path, ...], Array]:
    """Files in order, and their times (t,) s in a table, which orders names that have no order."""
    if not table.is_file():
        raise ValueError(f"{table} is no file: wanted the columns file, time_s")
    with open(table, newline="", encoding="utf-8-sig") as file:
        rows = list(csv.DictReader(file))
    named = bool(rows) and "file" in rows[0]
    try:
        ordered: Sequence[Path] = in_order(files)[0]
    except ValueError:
        if not named:
            raise
        ordered = ()
    try:
        stamps = [float(row["time_s"]) for row in rows]
        if named:
            time_of = dict(zip((row["file"] for row in rows), stamps, strict=True))
            if len(time_of) < len(rows):
                raise ValueError("a file twice")
            ordered = ordered or sorted(files, key=lambda p: time_of[p.name])
            stamps = [time_of[p.name] for p in ordered]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{table}: {error} is missing or is no time in s; wanted the columns file, time_s with one row "
            "for every picture"
        ) from None
    time = np.array(stamps)
    if len(time) != len(files) or not np.isfinite(time).all() or np.any(np.diff(time) < 0):
        raise ValueError(
            f"{table} has {len(time)} times for {len(files)} pictures, or times that are not increasing: "
            "wanted one row for every picture, in the order of the numbers in their names"
        )
    return tuple(ordered), time


def bits_of_pictures(files: Sequence[Path]) -> int:
    """Bits of the grey levels in pictures of 16 bits, from the brightest of a few of them: 8, 10, 12, 14 or
    16; 8 for pictures of 8."""
    if _levels(files[0]).dtype == np.uint8:
        return 8
    few = np.unique(np.linspace(0, len(files) - 1, LOOKED_AT).round().astype(int))
    brightest = max(int(_levels(files[k]).max()) for k in few)
    return next(bits for bits in (8, 10, 12, 14, 16) if brightest < 2**bits)


def read_picture(file: Path, bits: int | None = None) -> Image:
    """Grey levels (h,w) of a picture, 0 to 255. bits: of its levels where it has 16, by default as they tell.

    ValueError for a file that is none, for a stack of several and for pictures of other numbers.
    """
    levels = _levels(file)
    if levels.dtype == np.uint8:
        return np.asarray(levels, dtype=np.uint8)
    shift = (bits_of_pictures([file]) if bits is None else bits) - 8
    return np.asarray(np.minimum(levels >> shift, 255), dtype=np.uint8)


def _levels(file: Path) -> NDArray[Any]:
    """Grey levels (h,w) of a picture as it has them, in 8 or 16 bits."""
    if not file.exists():
        raise ValueError(f"picture {file} is missing")
    if not file.is_file():
        raise ValueError(f"picture {file} is no file: wanted a picture of the kind {', '.join(SUFFIXES)}")
    if file.suffix.lower() in (".tif", ".tiff") and (pages := cv2.imcount(str(file))) > 1:
        raise ValueError(
            f"picture {file} is a stack of {pages} pictures: wanted one picture in a file; split it, with "
            "times.csv or fps, or make a film of it"
        )
    levels = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if levels is None:
        raise ValueError(f"picture {file} cannot be read: remove it or copy it again")
    if levels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"picture {file} holds {levels.dtype}: wanted grey levels of 8 or 16 bits")
    return levels
