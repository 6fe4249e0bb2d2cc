"""What a project folder may do on this computer: a folder received from a stranger gets no more than its own
files. Its programs run, and its links are followed, only once their reader has said `twin trust`.

What is trusted stands in a file of the user's own, outside every project, by digests: a program by its text,
so that it is trusted in every folder and no more once it is changed; a link by its two ends.
"""

import hashlib
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from twin.project import files
from twin.project.config import Config

OWN = ("runs", "cache", "targets")  # folders that commands write to, or read text from


def trust_file() -> Path:
    """Where what is trusted stands: softtwin/trusted.json in the user's folder of settings."""
    base = os.environ.get("XDG_CONFIG_HOME") or os.environ.get("APPDATA") or str(Path.home() / ".config")
    return Path(base) / "softtwin" / "trusted.json"


def digest_of_program(text: bytes) -> str:
    """The digest by which a program is trusted: that of its text."""
    return hashlib.sha256(text).hexdigest()


def digest_of_link(path: Path) -> str:
    """The digest by which a path that leads elsewhere is trusted: that of its two ends."""
    return hashlib.sha256(f"{path.absolute()} -> {path.resolve()}".encode()).hexdigest()


def trusted() -> dict[str, str]:
    """What each trusted digest is of. ValueError where the file is damaged."""
    path = trust_file()
    if not path.exists():
        return {}
    found = files.read_json(path)
    if not isinstance(found, dict) or not all(isinstance(v, str) for v in found.values()):
        raise ValueError(f"{path}: wanted digests and what they are of; remove it and trust again")
    return found


def remember(digests: dict[str, str]) -> None:
    """Trust these digests, with what they are of, from now on."""
    if digests:
        files.write_json(trust_file(), {**trusted(), **digests})


def check_programs(root: Path, names: Sequence[str]) -> None:
    """Raise ValueError where a Python file of a project has not been trusted as it is now."""
    there = [name for name in names if (root / name).is_file()]  # who reads them says what is missing
    if not there:
        return
    known = trusted()
    for name in there:
        if digest_of_program((root / name).read_bytes()) not in known:
            raise ValueError(
                f"{name} is a program that would run with all your rights, and it has not been trusted as it "
                f"is now; read it, then trust it with `twin trust -p {root}`, or remove it from "
                "model.effect_files"
            )


def check_folder(root: Path, config: Config) -> None:
    """Raise ValueError where a project folder leads out of itself: by a link in runs/, cache/ or targets/, or
    by a path of twin.toml that is a link to somewhere else and has not been trusted."""
    for name in OWN:
        for path in [root / name, *_below(root / name)]:
            if path.is_symlink():
                raise ValueError(
                    f"{path} is a link: wanted a folder and files of the project's own, as commands write "
                    "there; replace it by what it leads to, or remove it"
                )
    astray = [path for path in named_files(root, config) if leads_out(path, root)]
    known = trusted() if astray else {}
    for path in astray:
        if digest_of_link(path) not in known:
            raise ValueError(
                f"{path.relative_to(root)} leads to {path.resolve()}, outside the project folder: wanted a "
                f"file in it; copy it there, or follow it from now on with `twin trust -p {root}`"
            )


def _below(folder: Path) -> Iterable[Path]:
    """All paths below a folder; links are named and not followed."""
    for parent, folders, names in os.walk(folder):
        yield from (Path(parent) / name for name in (*folders, *names))


def leads_out(path: Path, root: Path) -> bool:
    """Whether a path of a project folder leads out of it."""
    return not path.resolve().is_relative_to(root.resolve())


def named_files(root: Path, config: Config) -> list[Path]:
    """The files that twin.toml names, as far as they are there."""
    model, pressure = config.model, config.pressure
    names = [model.deck, *model.effect_files, None if pressure is None else pressure.file]
    for camera in config.cameras:
        board = None if camera.board is None else camera.board.dictionary
        names += [camera.film, camera.static, camera.boards, camera.camera_file, camera.dictionary, board]
    found = [path for name in dict.fromkeys(names) if name for path in sorted(root.glob(name))]
    return list(dict.fromkeys(found))
