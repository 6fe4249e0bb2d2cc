"""Films of the calibration board in a project: which they are, and when their frames were taken."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.csvtable import Table, read_sheet
from twin.project.cameratables import CameraTable
from twin.project.folder import Project

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Video
    from vision.camera import Array

CAMERA, TIME = ("camera", "cam_id"), ("time_s", "frame_time")  # headings, and those of caliscope


def board_film(images: list[Path]) -> Path | None:
    """The film among what `boards` names, None for pictures; ValueError for several films."""
    from vision.film.series import SUFFIXES

    films = [path for path in images if path.suffix.lower() not in SUFFIXES]
    if films and len(images) > 1:
        raise ValueError(
            f"cameras.boards names {films[0].name} and {len(images) - 1} more files: wanted one film of the "
            "board, or pictures of it (PNG, JPEG, BMP, TIFF)"
        )
    return films[0] if films else None


def board_times(project: Project, table: CameraTable, film: "Video") -> "Array":
    """Times (t,) s of a board film's frames on the clock of all cameras: of the file with time stamps, else
    of the film itself, as if all cameras had started at once."""
    path = stamps_file(project, table)
    if path is None:
        return film.time - film.time[0]
    stamps = _stamps(path, table.name, [t.name for t in project.config.cameras])
    if len(stamps) != len(film.time):
        raise ValueError(
            f"{path}: {len(stamps)} time stamps of camera {table.name!r}, but {film.path.name} has "
            f"{len(film.time)} frames: wanted one row for every frame"
        )
    return stamps


def stamps_file(project: Project, table: CameraTable) -> Path | None:
    """The table of time stamps, None where there is none; ValueError where it is missing."""
    if table.board_times is None:
        return None
    path = project.path(table.board_times)
    if not path.is_file():
        raise ValueError(
            f"cameras.board_times = {table.board_times!r}: no such file in {project.root}; copy it there or "
            "correct twin.toml"
        )
    return path


def _stamps(path: Path, name: str, cameras: list[str]) -> "Array":
    """Times (t,) s of one camera in a table of its own or of all cameras."""
    sheet = read_sheet(path, wanted="camera,time_s with one row for every frame of every camera")
    time = next((t for t in TIME if t in sheet.header), None)
    if time is None:
        raise ValueError(
            f"{path} has the columns {', '.join(sheet.header)}: wanted time_s, and camera where several "
            "cameras stand in one file"
        )
    camera = next((c for c in CAMERA if c in sheet.header), None)
    table = sheet.table([time] if camera is None else [time, camera])
    seconds = table.numbers(time, unit="s")
    stamps = seconds if camera is None else seconds[_rows(table, camera, name, cameras)]
    if np.any(np.diff(stamps) <= 0):
        row = int(np.argmax(np.diff(stamps) <= 0))
        raise ValueError(
            f"{path}: the stamps of camera {name!r} do not increase: {stamps[row]:g} s is followed by "
            f"{stamps[row + 1]:g} s; wanted the frames of each camera in order"
        )
    return stamps


def _rows(table: Table, column: str, name: str, cameras: list[str]) -> list[int]:
    """Rows of one camera: called by its name, or by numbers in the order of twin.toml."""
    called = table.cells[column]
    labels = sorted(set(called), key=lambda text: (len(text), text))
    if name not in labels and len(labels) == len(cameras):
        name = labels[cameras.index(name)]
    rows = [row for row, text in enumerate(called) if text == name]
    if not rows:
        raise ValueError(
            f"{table.path}, column {column}: {', '.join(labels)}; wanted the names of the cameras, "
            f"{', '.join(cameras)}, or one number for each in their order"
        )
    return rows
