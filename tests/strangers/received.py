"""Folders received from strangers: is a file outside them read before `twin trust`?

`outside_paths`: keys of twin.toml that name files, and places in a recorded project, each with a link out of
the folder; `outside_read`: those at which the link was not asked about, or was opened all the same.
"""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import get_args, get_origin

from pydantic import BaseModel

from tests.strangers.planted import STAGES, Lines
from tests.strangers.planting import camera_with, toml
from tests.strangers.studio import make
from twin.project import trust
from twin.project.cameratables import MeasureTable
from twin.project.config import Config
from twin.project.folder import Project
from twin.tablemodel import _dictionary, _inside

LINK = "raw/link"
# Places in the recorded project, and what twin.toml says of them where it says nothing by itself.
PLACES = {
    "raw/film.mkv": None, "raw/static.mkv": None, "raw/pressure.csv": None, "raw/boards/b04.png": None,
    "raw/boards": None, "raw/boards/times.csv": None,
    "raw/mended.csv": toml(lambda c: c.model_copy(update={"measure": MeasureTable(corrections="raw/mended.csv")})),
    "raw/lens.yml": camera_with(boards=None, board=None, camera_file="raw/lens.yml"),
    "raw/words.yml": camera_with(dictionary="raw/words.yml"),
    "runs": None, "targets": None, "cache": None, "twin.toml": None,
}  # fmt: skip
_opened: list[str] | None = None


def _heard(event: str, arguments: tuple[object, ...]) -> None:
    if _opened is not None and event == "open" and isinstance(arguments[0], str | bytes | os.PathLike):
        _opened.append(os.path.realpath(os.fsdecode(arguments[0])))


sys.addaudithook(_heard)


@contextmanager
def opened() -> Iterator[list[str]]:
    """The files, where they really lie, that Python opens meanwhile."""
    global _opened
    _opened = found = []
    try:
        yield found
    finally:
        _opened = None


def validators(part: object) -> set[object]:
    """What checks the values of a key, or of a part of its kind."""
    told = getattr(part, "__metadata__", None) or getattr(part, "metadata", ())
    return {getattr(one, "func", None) for one in told}


def with_path(table: type[BaseModel], path: str) -> list[BaseModel]:
    """A table for each of its keys that names a file, and of the tables below it, with this path alone."""
    found = []
    for name, field in table.model_fields.items():
        outer = get_args(field.annotation)
        kinds = dict.fromkeys([field.annotation, *outer, *(one for kind in outer for one in get_args(kind))])
        told: list[object] = [one for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)
                              for one in with_path(kind, path)]  # fmt: skip
        if any(validators(kind) & {_inside, _dictionary} for kind in (field, *kinds)):
            told.append(path)
        several = any(get_origin(kind) is tuple for kind in kinds)
        found += [table.model_construct(**{name: (one,) if several else one}) for one in told]
    return found


def unasked(folder: Path) -> tuple[int, int]:
    """Keys of twin.toml that name files, and how many of them a link may stand at that nobody is asked about."""
    (folder / "raw").mkdir(parents=True)
    (folder / LINK).symlink_to(folder.parent / "secret")
    every = with_path(Config, LINK)
    return len(every), sum(LINK not in [one.name for one in trust.links(folder, c)] for c in every)


def is_read(base: Path, name: str, folder: Path, stages: Sequence[str] = tuple(STAGES)) -> bool:
    """Whether one of the stages passes a link out of a recorded project, or opens what lies there."""
    root, secret = folder / "batch", folder / "outside" / "secret"
    shutil.copytree(base, root)
    secret.parent.mkdir()
    if plant := PLACES[name]:
        plant(root)
    if (root / name).exists():
        (root / name).rename(secret)
    else:
        secret.write_text("a word that nobody may see\n", encoding="utf-8")
    (root / name).symlink_to(secret)
    passed, said = False, Lines()
    with opened() as files:
        for stage in stages:
            try:
                STAGES[stage](Project.open(root), said)
                passed = True
            except ValueError as error:
                said.append(str(error))
    inside = os.path.realpath(secret)
    shutil.rmtree(root)
    shutil.rmtree(secret.parent)
    return passed or any(f == inside or f.startswith(inside + os.sep) for f in files) or "nobody" in "".join(said)


def figures() -> dict[str, int]:
    """`outside_paths` and `outside_read`."""
    with tempfile.TemporaryDirectory() as place:
        keys, passed = unasked(Path(place) / "keys")
        base = make(Path(place) / "base")
        read = [name for name in PLACES if is_read(base, name, Path(place))]
    for name in read:
        print(f"read outside: {name}")
    return {"outside_paths": keys + len(PLACES), "outside_read": passed + len(read)}
