"""The project of a further batch, made from the former batch on its rig."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twin import files
from twin.batches.former import calibration_files, camera_kept
from twin.inputs.cameras import dictionary_files
from twin.messages import Say
from twin.project.folder import Project, named_after
from twin.project.toml import with_key, write
from twin.project.trust import former_batch, remember
from twin.validation import decoded


def run_init_like(folder: Path, say: Say, *, like: Path) -> dict[str, Any]:
    """Make a folder with the twin.toml of a former batch under a new name, and with what the rig shares.

    Copied are the board pictures (or the camera file), the deck, own dictionaries and own effects; the
    effects of the former model are kept. Films, log and targets belong to one batch: they are not copied, nor
    is an effect of one marker at one time.
    """
    former = Project.open(like)
    root = folder.resolve()
    text = decoded((former.root / "twin.toml").read_bytes())
    for key, value in {"name": named_after(root), "like": _way(root, former.root)}.items():
        text = with_key(text, "project", key, value)
    had = former.config.model.effects
    effects = [label for label in had if "@" not in label]
    with files.whole_folder(root) as draft:
        config = write(draft / "twin.toml", with_key(text, "model", "effects", effects))
        (draft / "raw").mkdir()
        for file in _shared(former):
            place = draft / file.relative_to(former.root)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, place)
    remember(root, former_batch(root, config))  # whose folder the user has named
    say(f"Wrote {folder / 'twin.toml'} like {former.root.name}, whose rig it has.")
    for sentence in (_effects_kept(had, effects), *_wanted(former), camera_kept(Project.open(root))):
        if sentence:
            say(sentence)
    return {"stage": "init", "status": "done", "project": str(folder), "like": str(like)}


def _effects_kept(had: Sequence[str], effects: Sequence[str]) -> str:
    """A sentence on the effects kept from the former batch; empty where it had none."""
    dropped = [label for label in had if label not in effects]
    out = (
        f"The model keeps its effects, {', '.join(effects)}: `twin calibrate` fits them again."
        if effects
        else ""
    )
    if dropped:
        out += f" Left out: {', '.join(dropped)}, of its film alone."
    return out.strip()


def _shared(former: Project) -> list[Path]:
    """The files that belong to the rig and the model, not to one batch."""
    names = {c.dictionary for c in former.config.cameras}
    names |= {c.board.dictionary for c in former.config.cameras if c.board}
    dictionaries = [path for name in sorted(names) for path in dictionary_files(former, name)]
    cached = sorted((former.root / "cache").glob("*"))  # what depends on the finger, not on the batch
    solved = [path for path in cached if path.is_file() and not path.is_symlink()]
    shared = [
        *calibration_files(former),
        *dictionaries,
        *former.deck_files(),
        *([former.path(former.config.frame.sheet)] if former.config.frame.sheet else []),
        *former.effect_files(),
        *solved,
    ]
    for path in shared:
        if not path.is_relative_to(former.root):
            raise ValueError(f"{path} lies outside {former.root}; wanted it below that folder, to copy it")
    return list(dict.fromkeys(shared))


def _wanted(former: Project) -> list[str]:
    """Files that the user has to bring, one sentence each."""
    tests = [test.file for test in former.config.material_tests]
    if tests:
        return [f"Put {', '.join(tests)} of the new silicone there, or remove [[material_tests]].",
                *_wanted_films(former)]  # fmt: skip
    return _wanted_films(former)


def _wanted_films(former: Project) -> list[str]:
    """Films, logs and times that the user has to bring, one sentence each."""
    cameras, log = former.config.cameras, former.config.pressure
    if foreign := former.config.imports:
        named = dict.fromkeys(file for table in foreign for file in (table.file, table.log) if file)
        return [f"Put {', '.join(named)} there."]
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
