"""Turn board images, or a file of another program, into the camera, and several cameras into a rig."""

from typing import TYPE_CHECKING, Any

from twin.inputs.cameras import CameraRecord, RigRecord, board_film, board_times
from twin.messages import Say
from twin.project.folder import Project

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Camera
    from vision.calibration.rig import Rig
from twin.inputs.cameras import (
    board_images,
    board_of,
    calibrated,
    camera_inputs,
    camera_table,
    is_film,
    read_lens,
    result_of,
)

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def run_camera(project: Project, say: Say) -> dict[str, Any]:
    """Calibrate the camera from its board images into runs/NNNN-camera/camera.json, unless that is done.

    Several cameras are calibrated together, into rig.json.
    """
    table = camera_table(project)
    how = camera_inputs(project)
    done = project.done("camera", **how)
    if done is not None:
        say(f"Already done in {project.shown(done)}, skipped. {project.other_versions(done)}".rstrip())
        return result_of(project, "camera", done, skipped=True)
    if len(project.config.cameras) > 1:
        return _run_rig(project, say, how)
    with project.new_run("camera", **how) as run:
        camera = read_lens(project, table) if table.camera_file else calibrated(project, table)
        image_count = 0 if table.camera_file else len(board_images(project, table))
        run.write(CameraRecord(**camera.to_dict()))
        run.summary.update(
            rms_px=camera.rms_px, images=camera.images, given=image_count, model=" ".join(camera.model),
            sd=dict(zip(PARAMETERS, camera.stdevs.tolist(), strict=True)), remarks=list(camera.remarks),
            notes=list(camera.notes),
        )  # fmt: skip
        run.summary["headline"] = f"reprojection RMS {camera.rms_px:.3f} px"
        for sentence in camera.notes:
            run.note(sentence)
    for sentence in camera.remarks:
        say(sentence)
    source = table.camera_file or (
        f"{camera.images} frames of {table.boards}" if is_film(project, table)
        else f"{camera.images} of {image_count} board images"
    )  # fmt: skip
    say(f"Calibrated from {source}. Reprojection RMS {camera.rms_px:.3f} px, accepted up to "
        f"{table.max_rms_px:g} px. Wrote {project.shown(run.path('camera.json'))}.")  # fmt: skip
    return result_of(project, "camera", run.folder)


def _run_rig(project: Project, say: Say, how: dict[str, Any]) -> dict[str, Any]:
    """Calibrate every camera, then all of them together from the pictures of one name."""
    tables = project.config.cameras
    with project.new_run("camera", **how) as run:
        cameras = [calibrated(project, table) for table in tables]
        rig = _joined(project, cameras)
        remarks = [f"{t.name}: {r}" for t, c in zip(tables, cameras, strict=True) for r in c.remarks]
        run.write(RigRecord(**rig.to_dict()))
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
    images, board = [board_images(project, table) for table in tables], board_of(project, tables[0])
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
