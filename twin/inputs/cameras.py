"""The cameras of a project: what they are calibrated from, films of the board and their times, and the lens
that a run found, as camera.json or rig.json holds it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from twin import files
from twin.csvtable import Table, read_sheet
from twin.judging.fitrecord import Rows, check_covariance
from twin.project.cameratables import CameraTable
from twin.project.folder import Project
from twin.records import Record
from twin.tablemodel import Finite, NotNegative

if TYPE_CHECKING:
    from vision import Board, Camera, Video
    from vision.calibration.rig import Rig
    from vision.camera import Array


Three = tuple[Finite, Finite, Finite]


class CameraRecord(Record):
    """A lens."""

    file: ClassVar[str] = "camera.json"
    matrix: tuple[Three, Three, Three]  # of the camera, px
    distortion: tuple[Finite, Finite, Finite, Finite, Finite]  # k1, k2, p1, p2, k3
    size: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]  # px
    rms_px: NotNegative  # reprojection error
    images: int = Field(ge=0)
    covariance: Rows  # of focal lengths, centre and distortion
    model: tuple[str, ...]  # which of the distortion were fitted
    covered: tuple[tuple[Finite, Finite], ...]  # hull of where the board was seen, px
    remarks: tuple[str, ...]  # what was found of the images, in words
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _focused(self) -> Self:
        if self.matrix[0][0] <= 0 or self.matrix[1][1] <= 0:
            raise ValueError(
                f"matrix: the focal lengths are {self.matrix[0][0]:g} and {self.matrix[1][1]:g} px; wanted "
                "them above 0"
            )
        check_covariance(self.covariance, 9)
        return self


class RigRecord(Record):
    """Several cameras."""

    file: ClassVar[str] = "rig.json"
    cameras: tuple[CameraRecord, ...] = Field(min_length=2)
    turn: tuple[Any, ...]  # of each camera from the first, with the shift in mm
    shift: tuple[Any, ...]
    covariance: tuple[Any, ...]  # of turns and shifts
    remarks: tuple[str, ...]  # in words


def stored_rig(path: Path) -> "Rig":
    """The cameras of a rig.json."""
    from vision.calibration.rig import Rig

    return Rig.from_dict(files.plain(files.read(RigRecord, path)))


def stored_cameras(path: Path) -> "tuple[Camera, ...]":
    """The cameras (c,) of a camera.json or a rig.json."""
    from vision import Camera

    if path.name == RigRecord.file:
        return stored_rig(path).cameras
    return (Camera.from_dict(files.plain(files.read(CameraRecord, path))),)


def calibrated(project: Project, table: CameraTable) -> "Camera":
    from vision import Video, calibrate_camera
    from vision.calibration.boardfilms import camera_of_film

    images, board = board_images(project, table), board_of(project, table)
    film = board_film(images)
    if film is not None:
        return camera_of_film(Video(film, mirrored=table.mirrored), board, max_rms_px=table.max_rms_px)
    return calibrate_camera(images, board, max_rms_px=table.max_rms_px, mirrored=table.mirrored)


def is_film(project: Project, table: CameraTable) -> bool:
    return board_film(board_images(project, table)) is not None


def board_of(project: Project, table: CameraTable) -> "Board":
    from vision import Board

    assert table.board is not None  # the configuration refuses boards without it
    keys = table.board.model_dump() | {"marker_mm": table.board.marker_mm or 0.0}
    return Board.of(**keys | {"dictionary": dictionary_name(project, table.board.dictionary)})


def read_lens(project: Project, table: CameraTable) -> "Camera":
    from vision import Video
    from vision.calibration.camerafile import read_camera

    film = Video(project.path(table.film))
    path = project.path(table.camera_file or "")
    return read_camera(path, name=table.name, size=(film.width, film.height))


def lens_of(project: Project, table: CameraTable) -> "Camera":
    """The camera of a table, calibrated now where no run has done it. ValueError where it is refused."""
    done = project.done("camera", **camera_inputs(project))
    if done is None:
        return read_lens(project, table) if table.camera_file else calibrated(project, table)
    name = CameraRecord.file if len(project.config.cameras) == 1 else RigRecord.file
    return stored_cameras(done / name)[project.config.cameras.index(table)]


def camera_table(project: Project) -> CameraTable:
    if not project.config.cameras:
        raise ValueError("twin.toml has no [[cameras]]: there is no film to measure; targets measured "
                         "elsewhere go into targets/, and `twin calibrate` starts from them")  # fmt: skip
    return project.config.cameras[0]


def camera_inputs(project: Project) -> dict[str, Any]:
    tables = project.config.cameras
    if len(tables) == 1:
        return _one_camera_inputs(project, tables[0])
    each = [_one_camera_inputs(project, table) for table in tables]
    inputs = list(dict.fromkeys(path for camera in each for path in camera["inputs"]))
    extra = {table.name: camera["extra"] for table, camera in zip(tables, each, strict=True)}
    return {"tables": (), "inputs": inputs, "extra": {"rig": extra}}


def _one_camera_inputs(project: Project, table: CameraTable) -> dict[str, Any]:
    if table.camera_file is not None:
        path = project.path(table.camera_file)
        if not path.is_file():
            raise ValueError(
                f"cameras.camera_file = {table.camera_file!r}: no such file in {project.root}; copy it there "
                "or correct twin.toml"
            )
        return {"tables": (), "inputs": [path], "extra": {"name": table.name, "film": table.film}}
    board = table.board
    assert board is not None  # the configuration refuses boards without it
    extra = {"board": board.model_dump(), "max_rms_px": table.max_rms_px, "mirrored": table.mirrored}
    dictionary = dictionary_files(project, board.dictionary)
    stamps = stamps_file(project, table)
    inputs = [*board_images(project, table), *dictionary, *([stamps] if stamps else [])]
    return {"tables": (), "inputs": inputs, "extra": extra}


def board_images(project: Project, table: CameraTable) -> list[Path]:
    """The pictures of the board."""
    from vision.film.numbering import is_litter

    every = project.root.glob(table.boards or "")
    images = sorted(p for p in every if p.is_file() and not is_litter(p))
    if not images:
        raise ValueError(f"cameras.boards = {table.boards!r}: no file matches in {project.root}; put the "
                         "images of the board there, or correct the glob in twin.toml")  # fmt: skip
    return images


def dictionary_name(project: Project, name: str) -> str:
    """A dictionary as vision takes it: OpenCV's name, or the path of a file in the project."""
    return name if name.startswith("DICT_") else str(project.path(name))


def dictionary_files(project: Project, name: str) -> list[Path]:
    """The file of a dictionary that is none of OpenCV's."""
    if name.startswith("DICT_"):
        return []
    if not project.path(name).is_file():
        raise ValueError(
            f"dictionary = {name!r}: no such file in {project.root}; copy it there or correct twin.toml"
        )
    return [project.path(name)]


def camera_path(project: Project) -> Path:
    """The file camera.json, or rig.json of several cameras, made from the board images as they are now."""
    name = CameraRecord.file if len(project.config.cameras) == 1 else RigRecord.file
    done, why = project.compared("camera", **camera_inputs(project))
    if done is None or why:
        told = f"{project.shown(done)} is stale: {why[0]}" if done else f"no {name} yet"
        raise ValueError(f"{told}; run `twin camera` first")
    return done / name


def result_of(project: Project, stage: str, folder: Path, *, skipped: bool = False) -> dict[str, Any]:
    """The result of a stage as --json prints it."""
    summary = files.plain(project.info(folder).summary)
    return {
        "stage": stage,
        "status": "skipped" if skipped else "done",
        "run": project.shown(folder),
    } | summary


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
