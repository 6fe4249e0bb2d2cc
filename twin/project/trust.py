"""Rights of a project folder on this computer: a folder received from a stranger gets no more than its own
files. Its programs run, and its links are followed, only once their reader has said `twin trust`.

What is trusted stands in a file of the user's own, outside every project, by digests: a program by its text,
so that it is trusted in every folder and no more once it is changed; a link by its two ends.
"""

import ast
import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin import files
from twin.project.config import Config

OWN = ("runs", "cache", "targets")  # folders that commands write to, or read text from
TIMES = "times.csv"  # which is read beside the pictures of a pattern


@dataclass(frozen=True)
class Asked:
    """A program or a link of a project, which has to be trusted."""

    name: str  # its path from the project folder
    what: str
    digest: str


def trust_file() -> Path:
    """Path of the list of what is trusted: softtwin/trusted.json in the user's folder of settings."""
    base = os.environ.get("XDG_CONFIG_HOME") or os.environ.get("APPDATA") or str(Path.home() / ".config")
    return Path(base) / "softtwin" / "trusted.json"


def trusted() -> dict[str, str]:
    """Description of each trusted program or link, by digest. ValueError where the file is damaged."""
    path = trust_file()
    digests = files.read_json(path) if path.exists() else {}
    if not isinstance(digests, dict) or not all(isinstance(v, str) for v in digests.values()):
        raise ValueError(f"{path}: wanted digests and what they are of; remove it and trust again")
    return digests


def remember(root: Path, requests: Iterable[Asked]) -> None:
    """Trust programs and links of a project from now on."""
    if new := {request.digest: f"{root / request.name}: {request.what}" for request in requests}:
        files.write_json(trust_file(), {**trusted(), **new})


def programs(root: Path, names: Sequence[str]) -> list[Asked]:
    """The Python files of a project that are there, each with the files of the project that it imports; who
    runs them says what is missing."""
    return [_program(root, name) for name in names if (root / name).is_file()]


def _program(root: Path, name: str) -> Asked:
    text, others = (root / name).read_bytes(), files.digest_of(imported(root, root / name), root=root)
    also = f", and imports {', '.join(others)}," if others else ""
    what = f"a program of {len(text.splitlines())} lines that would run with all your rights{also}"
    return Asked(name, what, _digest(b"".join([text, *(f"\0{k}\0{v}".encode() for k, v in others.items())])))


def imported(root: Path, program: Path) -> list[Path]:
    """The files of a project that a Python file imports, and those that these import in turn: modules and
    packages beside it or in the project folder."""
    found, todo = dict[Path, None](), [program]
    while todo:
        for name in _imports(todo.pop()):
            for folder in dict.fromkeys((program.parent, root)):
                new = [p for end in (".py", ".*so", ".*pyd", "/**/*") for p in folder.glob(name + end)]
                todo += (new := [p for p in new if p.is_file() and p not in (*found, program)])
                found |= dict.fromkeys(new)
    return sorted(found)


def _imports(path: Path) -> set[str]:
    """The first names of the modules that a Python file imports; none where it is no Python."""
    try:
        nodes = list(ast.walk(ast.parse(path.read_bytes())))
    except (SyntaxError, ValueError, RecursionError):
        return set()
    named = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    for node in (node for node in nodes if isinstance(node, ast.ImportFrom)):
        named |= {node.module} if node.module else {alias.name for alias in node.names}
    return {name.partition(".")[0] for name in named}


def check_programs(root: Path, config: Config) -> None:
    """Raise ValueError where an own effect leads out of the project folder: such a program never runs."""
    for name in config.model.effect_files:
        if leads_out(root / name, root):
            raise ValueError(
                f"model.effect_files: {name} lies outside the project folder, in {(root / name).resolve()}; "
                "copy it into effects/"
            )


def links(root: Path, config: Config) -> list[Asked]:
    """The files that twin.toml names, alone or by their folder, and that lie outside the project folder, and
    its former batch where that lies elsewhere."""
    # every text counts as a path: no key of twin.toml that names a file can be forgotten
    texts = dict.fromkeys(_texts(config.model_dump(exclude={"project"})))
    every = [path for text in texts for path in _below(root, text)]
    if special := [path for path in every if files.is_special(path)]:
        raise ValueError(f"{special[0]} is a FIFO, a socket or a device; wanted a file, or nothing there")
    named = dict.fromkeys(path for path in every if leads_out(path, root))
    what = "a link to {}, outside the project folder"
    return [*former_batch(root, config), *(_asked(root, path, what) for path in named)]


def former_batch(root: Path, config: Config) -> list[Asked]:
    """The former batch that twin.toml names; none where it lies beside the project, as the report reads the
    batches there anyway."""
    if config.project.like is None:
        return []
    path, beside = root / config.project.like, root.resolve().parent
    near = path.resolve().parent == beside or not leads_out(path, root)
    what = "the former batch in {}, which does not lie beside this project"
    return [] if near or not (path / "twin.toml").is_file() else [_asked(root, path, what)]


def _asked(root: Path, path: Path, what: str) -> Asked:
    """A path that leads out of a project; its digest is of both ends."""
    end = path.resolve()
    name = path.relative_to(root).as_posix()
    return Asked(name, what.format(end), _digest(f"{path.absolute()} -> {end}".encode()))


def _digest(of: bytes) -> str:
    return hashlib.sha256(of).hexdigest()


def check_trusted(root: Path, requests: Sequence[Asked]) -> None:
    """Raise ValueError where a program or a link has not been trusted in its present state."""
    digests = trusted() if requests else {}
    for request in requests:
        if request.digest not in digests:
            raise ValueError(
                f"{request.name} is {request.what}, and it has not been trusted as it is now; look at it, "
                f"then trust it with `twin trust -p {files.typed(root)}`, or take it out of the project"
            )


def check_folder(root: Path, config: Config) -> None:
    """Raise ValueError where a project folder leads out of itself: by a link in runs/, cache/ or targets/, or
    by a path of twin.toml that is a link to somewhere else and has not been trusted."""
    for path in (path for name in OWN for path in _below(root, name)):
        if path.is_symlink() or files.is_special(path):
            kind = "link" if path.is_symlink() else "FIFO, a socket or a device"
            raise ValueError(
                f"{path} is a {kind}: wanted a folder and files of the project's own, as commands write "
                "there; replace it by what it leads to, or remove it"
            )
    check_programs(root, config)
    check_trusted(root, links(root, config))


def leads_out(path: Path, root: Path) -> bool:
    """True for a path that leads out of a project folder."""
    return not path.resolve().is_relative_to(root.resolve())


def _texts(value: Any) -> Iterator[str]:
    """All texts in a configuration: some of them are paths."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list | tuple):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _texts(item)


def _below(root: Path, pattern: str) -> Iterator[Path]:
    """Paths in a folder that a text of twin.toml names as a path or a pattern; below them links, which are
    not followed, FIFOs and devices."""
    try:
        paths = sorted(root.glob(pattern)) or [path for path in [root / pattern] if path.is_symlink()]
    except (ValueError, NotImplementedError, OSError):  # no pattern: another text
        return
    if any(mark in pattern for mark in "*?["):
        paths += sorted({path.with_name(TIMES) for path in paths} - {*paths})
    for path in paths:
        yield path
        if leads_out(path, root):  # what lies behind a link is none of the project's
            continue
        for parent, folders, names in os.walk(path):
            below = (Path(parent) / name for name in (*folders, *names))
            yield from (other for other in below if other.is_symlink() or files.is_special(other))
