"""The cameras of a project: what they are calibrated from, and the lens that a run found."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin import files
from twin.inputs.boardtimes import board_film, stamps_file
from twin.inputs.camerarecord import CameraRecord, RigRecord, stored_cameras
from twin.project.cameratables import CameraTable
from twin.project.folder import Project

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Board, Camera

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
    every = project.root.glob(table.boards or "")
    images = sorted(p for p in every if p.is_file() and not files.is_litter(p))
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
