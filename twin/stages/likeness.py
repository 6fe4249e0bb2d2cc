"""A further batch on the same rig: a project made from the former, and whether its camera still fits."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twin.project import files
from twin.project.folder import Project, Say
from twin.project.toml import decoded, with_key
from twin.stages.cameras import dictionary_files, dictionary_name
from twin.targets import Array


def run_init_like(folder: Path, say: Say, *, like: Path) -> dict[str, Any]:
    """Make a folder with the twin.toml of a former batch under a new name, and with what the rig shares.

    Copied are the board pictures (or the camera file), the deck, own dictionaries and own effects. Films, log
    and targets belong to one batch: they are not copied, and no effect is in the model yet.
    """
    former = Project.open(like)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(
            f"{folder} is there already and is never overwritten; name a folder that does not exist"
        )
    root = folder.resolve()
    text = decoded((former.root / "twin.toml").read_bytes())
    for key, value in {"name": root.name, "like": _way(root, former.root)}.items():
        text = with_key(text, "project", key, value)
    with files.whole_folder(root) as draft:
        files.write_text(draft / "twin.toml", with_key(text, "model", "effects", []))
        (draft / "raw").mkdir()
        for file in _shared(former):
            place = draft / file.relative_to(former.root)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, place)
    say(f"Wrote {folder / 'twin.toml'} like {former.root.name}, whose rig it has.")
    for sentence in (*_wanted(former), camera_kept(Project.open(root))):
        if sentence:
            say(sentence)
    return {"stage": "init", "status": "done", "project": str(folder), "like": str(like)}


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
    """Whether the former batch's camera still fits, as the rig's fixed markers show it, in one sentence; ""
    where there is no camera to keep. ValueError where it does not fit."""
    try:
        former = former_of(project)
    except ValueError as error:  # the new batch alone was moved: what is done of it holds
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
    found = locate(picture, dictionary=dictionary_name(project, table.dictionary), camera=camera)
    centre = {int(i): c for i, c in zip(found.ids, found.centre, strict=True)}
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
    from vision import Camera

    tracks, camera = former.newest("measure", "tracks.npz"), former.newest("camera", "camera.json")
    if tracks is None or camera is None:
        return None
    found = files.read_npz(tracks)
    first = {}
    for name, track in zip(found["names"].tolist(), np.moveaxis(found["position"], 1, 0), strict=True):
        known = np.flatnonzero(np.isfinite(track[:, 0]))
        if len(known):
            first[name] = track[known[0]]
    return Camera.from_dict(files.read_json(camera)), first


def _same_camera(project: Project, former: Project) -> bool:
    """Whether the pictures of the board, or the camera file, are the former batch's."""
    own, others = (
        sorted(files.digest_of(_calibration(p), root=p.root).values()) for p in (project, former)
    )
    return bool(own) and own == others


def _calibration(project: Project) -> list[Path]:
    """The files that the cameras were calibrated with."""
    named = [camera.camera_file or camera.boards or "" for camera in project.config.cameras]
    return sorted({path for name in named for path in project.root.glob(name) if path.is_file()})


def _shared(former: Project) -> list[Path]:
    """The files that belong to the rig and the model, not to one batch."""
    names = {c.dictionary for c in former.config.cameras}
    names |= {c.board.dictionary for c in former.config.cameras if c.board}
    own = [path for name in sorted(names) for path in dictionary_files(former, name)]
    shared = [*_calibration(former), *own, *former.deck_files(), *former.effect_files()]
    for path in shared:
        if not path.is_relative_to(former.root):
            raise ValueError(f"{path} lies outside {former.root}; wanted it below that folder, to copy it")
    return list(dict.fromkeys(shared))


def _wanted(former: Project) -> list[str]:
    """What the user has to bring, one sentence each."""
    cameras, log = former.config.cameras, former.config.pressure
    if not cameras or log is None:
        return ["Put the batch's displacements into targets/."]
    several = former.config.films
    films = [path for camera in cameras for path in (camera.film, camera.static)]
    films += [path for f in several for path in (f.file, f.static, f.pressure) if path is not None]
    films = list(dict.fromkeys(path for path in films if path != log.file))
    clocks = several or cameras
    stamps = [f"film_start_s = {c.film_start_s:g}" for c in clocks] if log.join == "stamps" else []
    stamps += [f"static_start_s = {c.static_start_s:g}" for c in clocks if c.static_start_s is not None]
    clock = f" Correct {', '.join(stamps)} in twin.toml: they belong to one film." if stamps else ""
    return [f"Put {', '.join([*films, log.file])} there.{clock}"]


def _way(root: Path, former: Path) -> str:
    """The former batch's folder from the new one; ValueError where the two lie on different drives."""
    return Path(os.path.relpath(former, root)).as_posix()
