"""A further batch on the rig of a former one: its former batch, and a test of the camera."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twin import files
from twin.inputs.cameras import dictionary_name, stored_cameras
from twin.project.folder import Project
from twin.targets import Array


def former_of(project: Project) -> Project | None:
    """The batch that twin.toml names under like; None where it names none. ValueError where it is gone."""
    like = project.config.project.like
    if like is None:
        return None
    if not (project.path(like) / "twin.toml").is_file():
        raise ValueError(
            f"project.like = {like!r}: no project in {project.path(like).resolve()}; correct the folder in "
            "twin.toml, or remove the line"
        )
    return Project.open(project.path(like), builtin=project.builtin)


def camera_kept(project: Project) -> str:
    """Sentence on the fit of the former batch's camera to the rig's fixed markers; "" without a camera to
    keep. ValueError where it does not fit.
    """
    try:
        former = former_of(project)
    except files.UNREADABLE as error:  # the new batch alone was moved: what is done of it holds
        return f"Whether the former batch's camera still fits cannot be checked: {error}."
    cameras = project.config.cameras
    if former is None or not cameras or not _same_camera(project, former):
        return ""
    name, film = former.root.name, project.path(cameras[0].film)
    if not any(project.root.glob(cameras[0].film)):
        return (f"The camera of {name} is kept. `twin check` and `twin recalibrate` test by the fixed "
                f"markers whether it still fits, once {cameras[0].film} is there.")  # fmt: skip
    seen, unknown = _seen_before(former), f"Whether the camera of {name} still fits cannot be checked"
    if len(cameras) > 1:
        return f"{unknown}: there are several cameras. `twin camera` checks them with new pictures."
    if seen is None:
        return f"{unknown}: {name} has not been measured."
    return _tested(project, name, film, *seen)


def _tested(project: Project, name: str, film: Path, camera: Any, then: Mapping[str, Array]) -> str:
    """The sentence for a camera that fits; ValueError for one that does not."""
    from vision.calibration.lens import view_misfit
    from vision.film.series import open_film
    from vision.following.markercentres import locate

    table = project.config.cameras[0]
    opened = open_film(film, fps=table.fps, mirrored=table.mirrored)
    remedy = f"photograph the board anew, replace {table.boards or table.camera_file}, and run `twin camera`"
    if (opened.width, opened.height) != camera.size:
        raise ValueError(f"{table.film} has {opened.width} x {opened.height} px, but the camera of {name} "
                         f"{camera.size[0]} x {camera.size[1]}: it does not fit; {remedy}")  # fmt: skip
    picture = next(iter(opened.frames()))[2]
    markers = locate(picture, dictionary=dictionary_name(project, table.dictionary), camera=camera)
    centre = {int(i): c for i, c in zip(markers.ids, markers.centre, strict=True)}
    rig = [m for m in project.config.frame.markers if m.name in then and m.marker in centre]
    defines = np.array([m.role == "frame" for m in rig])
    if defines.sum() < 4 or defines.all():
        return (f"Whether the camera of {name} still fits cannot be checked: the first frame of {table.film}"
                f" shows {int(defines.sum())} coded markers of the frame and {int((~defines).sum())} fixed "
                "ones; wanted 4 and 1 or more.")  # fmt: skip
    now = np.array([centre[m.marker or 0] for m in rig])
    misfit = view_misfit(camera, np.array([then[m.name] for m in rig]), now, defines=defines)
    where = f"the fixed markers lie {misfit:.2f} px (rms) from where it would see them"
    if misfit > table.max_rms_px:
        raise ValueError(f"the camera of {name} does not fit: {where}, accepted up to {table.max_rms_px:g} "
                         f"px (cameras.max_rms_px); its focus or zoom has changed, or markers of the rig "
                         f"have moved; {remedy}, or correct position_mm")  # fmt: skip
    return f"The camera of {name} still fits: {where}, accepted up to {table.max_rms_px:g} px."


def _seen_before(former: Project) -> tuple[Any, dict[str, Array]] | None:
    """The former batch's camera, and the raw px (2,) at which its film shows every marker first."""
    tracks, camera = former.newest("measure", "tracks.npz"), former.newest("camera", "camera.json")
    if tracks is None or camera is None:
        return None
    arrays = files.read_npz(tracks, "names", "position")
    positions = {}
    for name, track in zip(arrays["names"].tolist(), np.moveaxis(arrays["position"], 1, 0), strict=True):
        visible = np.flatnonzero(np.isfinite(track[:, 0]))
        if len(visible):
            positions[name] = track[visible[0]]
    return stored_cameras(camera)[0], positions


def _same_camera(project: Project, former: Project) -> bool:
    """True where board pictures and camera file are equal to the former batch's."""
    digests, former_digests = (
        sorted(files.digest_of(calibration_files(p), root=p.root).values()) for p in (project, former)
    )
    return bool(digests) and digests == former_digests


def calibration_files(project: Project) -> list[Path]:
    """The files that the cameras were calibrated with."""
    named = [camera.camera_file or camera.boards or "" for camera in project.config.cameras]
    return sorted({path for name in named for path in project.root.glob(name) if path.is_file()})
