"""Turn board images, or a file of another program, into the camera, and several cameras into a rig."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.project import files
from twin.project.config import CameraTable
from twin.project.folder import Project, Say
from twin.stages.boardtimes import board_film, board_times, stamps_file

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Board, Camera
    from vision.calibration.rig import Rig

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def run_camera(project: Project, say: Say) -> dict[str, Any]:
    """Calibrate the camera from its board images into runs/NNNN-camera/camera.json, unless that is done.

    Several cameras are calibrated together, into rig.json.
    """
    table = camera_table(project)
    how = _camera_inputs(project)
    done = project.done("camera", **how)
    if done is not None:
        say(f"Already done in {project.shown(done)}, skipped.")
        return result_of(project, "camera", done, skipped=True)
    if len(project.config.cameras) > 1:
        return _run_rig(project, say, how)
    with project.new_run("camera", **how) as run:
        camera = _read_camera(project, table) if table.camera_file else _calibrated(project, table)
        given = 0 if table.camera_file else len(_images(project, table))
        run.write_json("camera.json", camera.to_dict())
        run.summary.update(
            rms_px=camera.rms_px, images=camera.images, given=given, model=" ".join(camera.model),
            sd=dict(zip(PARAMETERS, camera.stdevs.tolist(), strict=True)), remarks=list(camera.remarks),
            notes=list(camera.notes),
        )  # fmt: skip
        run.summary["headline"] = f"reprojection RMS {camera.rms_px:.3f} px"
        for sentence in camera.notes:
            run.note(sentence)
    for sentence in camera.remarks:
        say(sentence)
    source = table.camera_file or (
        f"{camera.images} frames of {table.boards}" if _is_film(project, table)
        else f"{camera.images} of {given} board images"
    )  # fmt: skip
    say(f"Calibrated from {source}. Reprojection RMS {camera.rms_px:.3f} px, accepted up to "
        f"{table.max_rms_px:g} px. Wrote {project.shown(run.path('camera.json'))}.")  # fmt: skip
    return result_of(project, "camera", run.folder)


def _calibrated(project: Project, table: CameraTable) -> "Camera":
    from vision import Video, calibrate_camera
    from vision.calibration.boardfilms import camera_of_film

    images, board = _images(project, table), _board(project, table)
    film = board_film(images)
    if film is not None:
        return camera_of_film(Video(film, mirrored=table.mirrored), board, max_rms_px=table.max_rms_px)
    return calibrate_camera(images, board, max_rms_px=table.max_rms_px, mirrored=table.mirrored)


def _is_film(project: Project, table: CameraTable) -> bool:
    return board_film(_images(project, table)) is not None


def _board(project: Project, table: CameraTable) -> "Board":
    from vision import Board

    assert table.board is not None  # the configuration refuses boards without it
    stated = table.board.model_dump() | {"marker_mm": table.board.marker_mm or 0.0}
    return Board.of(**stated | {"dictionary": dictionary_name(project, table.board.dictionary)})


def _run_rig(project: Project, say: Say, how: dict[str, Any]) -> dict[str, Any]:
    """Calibrate every camera, then all of them together from the pictures of one name."""
    tables = project.config.cameras
    with project.new_run("camera", **how) as run:
        cameras = [_calibrated(project, table) for table in tables]
        rig = _joined(project, cameras)
        remarks = [f"{t.name}: {r}" for t, c in zip(tables, cameras, strict=True) for r in c.remarks]
        run.write_json("rig.json", rig.to_dict())
        run.summary.update(
            rms_px={t.name: c.rms_px for t, c in zip(tables, cameras, strict=True)},
            images={t.name: c.images for t, c in zip(tables, cameras, strict=True)},
            remarks=[*remarks, *rig.remarks], headline=rig.remarks[0],
        )  # fmt: skip
        for sentence in (f"{t.name}: {n}" for t, c in zip(tables, cameras, strict=True) for n in c.notes):
            run.note(sentence)
    for sentence in remarks:
        say(sentence)
    for sentence in rig.remarks[1:]:
        say(sentence)
    say(f"{rig.remarks[0]} Wrote {project.shown(run.path('rig.json'))}.")
    return result_of(project, "camera", run.folder)


def _joined(project: Project, cameras: list["Camera"]) -> "Rig":
    """All cameras together: from pictures of one name, or from films of one moving board."""
    from vision import Video
    from vision.calibration.boardfilms import rig_of_films
    from vision.calibration.stereo import calibrate_rig

    tables = project.config.cameras
    images, board = [_images(project, table) for table in tables], _board(project, tables[0])
    limit = max(table.max_rms_px for table in tables)
    films = [board_film(paths) for paths in images]
    if None not in films:
        opened = [Video(p, mirrored=t.mirrored) for p, t in zip(films, tables, strict=True) if p is not None]
        times = [board_times(project, t, film) for t, film in zip(tables, opened, strict=True)]
        return rig_of_films(opened, times, board, cameras, max_rms_px=limit)
    if any(films):
        raise ValueError(
            "cameras.boards: one camera has a film of the board, another has pictures; wanted films of one "
            "moving board for all cameras, or pictures for all"
        )
    mirrored = [table.mirrored for table in tables]
    return calibrate_rig(images, board, cameras, max_rms_px=limit, mirrored=mirrored)


def _read_camera(project: Project, table: CameraTable) -> "Camera":
    from vision import Video
    from vision.calibration.camerafile import read_camera

    film = Video(project.path(table.film))
    path = project.path(table.camera_file or "")
    return read_camera(path, name=table.name, size=(film.width, film.height))


def lens_of(project: Project, table: CameraTable) -> "Camera":
    """The camera of a table, calibrated now where no run has done it. ValueError where it is refused."""
    from vision import Camera
    from vision.calibration.rig import Rig

    done = project.done("camera", **_camera_inputs(project))
    if done is None:
        return _read_camera(project, table) if table.camera_file else _calibrated(project, table)
    if len(project.config.cameras) == 1:
        return Camera.from_dict(files.read_json(done / "camera.json"))
    rig = Rig.from_dict(files.read_json(done / "rig.json"))
    return rig.cameras[project.config.cameras.index(table)]


def camera_table(project: Project) -> CameraTable:
    if not project.config.cameras:
        raise ValueError("twin.toml has no [[cameras]]: there is no film to measure; targets measured "
                         "elsewhere go into targets/, and `twin calibrate` starts from them")  # fmt: skip
    return project.config.cameras[0]


def _camera_inputs(project: Project) -> dict[str, Any]:
    tables = project.config.cameras
    if len(tables) == 1:
        return _one_camera_inputs(project, tables[0])
    each = [_one_camera_inputs(project, table) for table in tables]
    inputs = list(dict.fromkeys(path for one in each for path in one["inputs"]))
    extra = {table.name: one["extra"] for table, one in zip(tables, each, strict=True)}
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
    own = dictionary_files(project, board.dictionary)
    stamps = stamps_file(project, table)
    inputs = [*_images(project, table), *own, *([stamps] if stamps else [])]
    return {"tables": (), "inputs": inputs, "extra": extra}


def _images(project: Project, table: CameraTable) -> list[Path]:
    """The pictures of the board."""
    images = sorted(p for p in project.root.glob(table.boards or "") if p.is_file())
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
    name = "camera.json" if len(project.config.cameras) == 1 else "rig.json"
    done = project.done("camera", **_camera_inputs(project))
    if done is None:
        older = project.newest("camera", name)
        why = f"{project.shown(older)} was made from other images or settings" if older else f"no {name} yet"
        raise ValueError(f"{why}: run `twin camera` first")
    return done / name


def result_of(project: Project, stage: str, folder: Path, *, skipped: bool = False) -> dict[str, Any]:
    """What --json prints."""
    summary = project.info(folder).get("summary", {})
    return {
        "stage": stage,
        "status": "skipped" if skipped else "done",
        "run": project.shown(folder),
    } | summary
