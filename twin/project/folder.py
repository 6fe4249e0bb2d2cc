"""Turn a project folder into numbered runs that say how they were made and resume if killed."""

import os
import platform
import re
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twin import effort, files
from twin.files import lock
from twin.project.config import Config
from twin.project.framesheet import with_sheet
from twin.project.record import (
    ORIGIN,
    RunExtra,
    RunRecord,
    RunSummary,
    SolvesRow,
    SourceRecord,
    StoredConfig,
    differences,
    format_of,
)
from twin.project.targetfiles import read_targets
from twin.project.toml import dump, former_keys, parse, with_effects, write
from twin.project.trust import check_folder, imported, leads_out
from twin.records import Record
from twin.targets import Targets
from twin.validation import decoded

if TYPE_CHECKING:  # the finite elements are loaded by whoever needs them
    from twin.model.structure import BuiltIn

PACKAGES = (
    "softtwin", "numpy", "scipy", "opencv-contrib-python-headless", "scikit-image", "av", "pymoo",
    "pypardiso", "mkl", "numba", "rerun-sdk", "pyvista", "pydantic",
)  # fmt: skip


@dataclass(frozen=True)
class Run:
    """One folder under runs/: what a stage writes goes in here, atomically."""

    folder: Path
    resumed: bool  # the folder of a killed run: its log.jsonl and checkpoints are there
    summary: dict[str, Any] = field(default_factory=dict)  # the stage fills it; stored in run.json

    @property
    def name(self) -> str:
        """The folder's name, 0003-calibrate."""
        return self.folder.name

    def path(self, name: str) -> Path:
        """Path of a file of this run."""
        return self.folder / name

    def write(self, record: Record, name: str = "") -> None:
        """Write a record atomically, under its own name unless another is given."""
        files.write_json(self.path(name or record.file), record)

    def write_json(self, name: str, data: Any) -> None:
        """Write JSON atomically; NaN becomes null."""
        files.write_json(self.path(name), data)

    def write_text(self, name: str, text: str) -> None:
        """Write text atomically."""
        files.write_text(self.path(name), text)

    def write_bytes(self, name: str, data: bytes) -> None:
        """Write a binary file atomically."""
        files.write_bytes(self.path(name), data)

    def write_npz(self, name: str, arrays: Mapping[str, ArrayLike]) -> None:
        """Write arrays atomically."""
        files.write_npz(self.path(name), arrays)

    def append(self, record: Mapping[str, Any]) -> None:
        """Append one record to log.jsonl; it is on the disk when this returns."""
        files.append_jsonl(self.path("log.jsonl"), record)

    def note(self, text: str) -> None:
        """Append a remark that asks nothing of the user to log.jsonl, as {"note": text}; prints nothing."""
        self.append({"note": text})

    def log(self) -> list[dict[str, Any]]:
        """The records of log.jsonl, those from before a kill included."""
        return files.read_jsonl(self.path("log.jsonl"))


@dataclass(frozen=True)
class Project:
    """A folder with twin.toml; every path in it is relative to the folder."""

    root: Path
    config: Config
    builtin: "BuiltIn | None" = None  # another built-in finger than the reference study's
    former_keys: tuple[str, ...] = ()  # keys of twin.toml that older versions had and that change nothing

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on twin.toml for the user, one sentence each."""
        keys = self.former_keys
        if not keys:
            return ()
        single = len(keys) == 1
        return (f"{', '.join(keys)} in twin.toml {'changes' if single else 'change'} nothing: remove "
                f"{'that line' if single else 'those lines'}.",)  # fmt: skip

    @classmethod
    def open(
        cls, root: Path | str, *, builtin: "BuiltIn | None" = None, strange: bool = False
    ) -> "Project":
        """The project in a folder; ValueError if twin.toml is not there or not right, or if the folder leads
        out of itself in a way that nobody trusted. strange: to see what it asks for."""
        folder = Path(root).resolve()
        if not (folder / "twin.toml").is_file():
            raise ValueError(
                f"{folder / 'twin.toml'} does not exist: make a project with `twin demo FOLDER` or "
                "`twin init FOLDER`, or name its folder with `--project FOLDER`"
            )
        if leads_out(folder / "twin.toml", folder):
            raise ValueError(f"{folder / 'twin.toml'} is a link out of its folder; copy the file there")
        data = files.read_bytes(folder / "twin.toml")
        config = parse(data, name="twin.toml")
        if not strange:
            check_folder(folder, config)
            config = with_sheet(config, folder)
        return cls(folder, config, builtin, tuple(former_keys(data)))

    @property
    def targets_folder(self) -> Path:
        """Folder of the targets."""
        return self.root / "targets"

    def path(self, relative: str) -> Path:
        """A path of twin.toml from the project folder."""
        return self.root / relative

    def shown(self, path: Path) -> str:
        """A path as a person reads it: from the project folder."""
        return path.relative_to(self.root).as_posix() if path.is_relative_to(self.root) else str(path)

    def targets(self) -> Targets:
        """The targets, their nodes and gravity as twin.toml has them; ValueError if there are none, or
        if gravity is stated twice, or not and the finger has weight."""
        if not (self.targets_folder / "targets.csv").is_file():
            raise ValueError(
                f"{self.targets_folder / 'targets.csv'}: no such file, so there are no displacements yet; "
                "`twin measure` makes them from the film, and displacements measured elsewhere are put "
                "there (docs/files.md)"
            )
        nodes, model = self.config.nodes, self.config.model
        targets, gravity = read_targets(self.targets_folder, nodes=nodes), model.gravity
        if model.density_kg_m3 is not None and gravity is None and targets.gravity is None:
            raise ValueError(
                f"model.density_kg_m3 = {model.density_kg_m3:g}: its weight wants the direction of gravity; "
                "add gravity = [0.0, 0.0, -1.0] under [model] of twin.toml, or one a block in targets.toml"
            )
        if gravity is None:
            return targets
        if targets.gravity is not None:
            raise ValueError(
                f"model.gravity = {list(gravity)}: targets.toml states gravity for each block; wanted it in "
                "one place; remove it from twin.toml"
            )
        direction = np.array(gravity) / np.linalg.norm(gravity)
        return replace(targets, gravity=np.tile(direction, (int(targets.block[-1]) + 1, 1)))

    def source(self) -> SourceRecord:
        """Origin of the targets; an empty record where it is unknown."""
        path = self.targets_folder / SourceRecord.file
        return files.read(SourceRecord, path) if path.is_file() else SourceRecord()

    def deck_files(self) -> list[Path]:
        """The files of the user's own mesh, none for the built-in finger."""
        if self.config.model.deck is None or not self.path(self.config.model.deck).is_file():
            return []
        from fe.deck.keywords import read_keywords

        return sorted(read_keywords(self.path(self.config.model.deck)).files)

    def material_files(self) -> list[Path]:
        """The files of the tests of the silicone itself that are there."""
        named = (self.path(test.file) for test in self.config.material_tests)
        return [path for path in named if path.is_file()]

    def effect_files(self) -> list[Path]:
        """The files of the user's own effects that are there, and those of the project that they import."""
        own = [path for name in self.config.model.effect_files if (path := self.path(name)).is_file()]
        return list(dict.fromkeys([*own, *(other for path in own for other in imported(self.root, path))]))

    def lock(self, command: str) -> AbstractContextManager[None]:
        """Hold the project for one writing command; ValueError if a living process holds it."""
        return lock(self.root / ".lock", command)

    def check_effects(self, effects: Sequence[str]) -> None:
        """Raise ValueError where `set_effects` would."""
        text = decoded((self.root / "twin.toml").read_bytes())
        parse(with_effects(text, effects).encode(), name="twin.toml")

    def set_effects(self, effects: Sequence[str]) -> "Project":
        """The project with other effects, written into twin.toml; every other line stays.
        ValueError, and nothing is written, where they are no effects."""
        path = self.root / "twin.toml"
        config = write(path, with_effects(decoded(path.read_bytes()), effects))
        return replace(self, config=with_sheet(config, self.root))

    # -- runs -----------------------------------------------------------------------------------------

    def runs(self) -> list[Path]:
        """The run folders, oldest first."""
        folders = [p for p in (self.root / "runs").glob("*-*") if p.is_dir() and re.match(r"\d{4,}-", p.name)]
        return sorted(folders, key=lambda p: int(p.name.partition("-")[0]))

    def info(self, folder: Path) -> RunRecord:
        """The record of a run; status "incomplete" where a kill came before the first write."""
        path = folder / RunRecord.file
        if path.exists():
            return files.read(RunRecord, path)
        return RunRecord(kind=kind_of(folder), status="incomplete", digest="")

    def newest(self, kind: str | tuple[str, ...] | None, file: str) -> Path | None:
        """A file of the newest done run of that kind (None: of any kind) that has it, or None."""
        kinds = (kind,) if isinstance(kind, str) else kind
        for folder in reversed(self.runs()):
            matches = kinds is None or kind_of(folder) in kinds
            if matches and (folder / file).is_file() and self.info(folder).status == "done":
                return folder / file
        return None

    def done(self, kind: str, **how: Any) -> Path | None:
        """The newest done run with this configuration and these inputs (as `new_run`), or None."""
        folder, why = self.compared(kind, **how)
        return None if why else folder

    def compared(self, kind: str, **how: Any) -> tuple[Path | None, list[str]]:
        """The run that `done` gives and [], else the newest done one and what has changed since."""
        stamp, newest = self._stamp(kind, **how), None
        why: list[str] = []
        stated = self.config.model_dump(mode="json", exclude_defaults=True)
        for folder, info in self._with_status(kind, "done"):
            if not (apart := differences(info, stamp, stated)):
                return folder, []
            newest, why = (newest, why) if newest else (folder, apart)
        return newest, why

    def killed(self, kind: str, **how: Any) -> Path | None:
        """The run that `new_run` with these arguments would resume, or None: one of the same versions."""
        return self._resumed(self._stamp(kind, **how))

    def _resumed(self, stamp: RunRecord) -> Path | None:
        runs = self._with_status(stamp.kind, "running")
        return next((f for f, i in runs if (i.digest, i.versions) == (stamp.digest, stamp.versions)), None)

    def other_versions(self, folder: Path) -> str:
        """A sentence on the versions with which a run was made, where they are others than here; else ""."""
        was, now = self.info(folder).versions, versions()
        told = [f"{name} {was.get(name, 'none')} (here {now.get(name, 'none')})"
                for name in {**was, **now} if was and was.get(name) != now.get(name)]  # fmt: skip
        return f"It was made with {', '.join(told)}, and holds." if told else ""

    @contextmanager
    def new_run(self, kind: str, **how: Any) -> Iterator[Run]:
        """Open a run folder: that of a killed run of the same configuration and inputs, else a new number.

        Leaving the block marks it done, an exception failed with its sentence; after a kill or Ctrl-C it
        stays "running", and the same command resumes it.
        `how` (all optional): seed int; tables: names of the twin.toml tables it depends on (default all);
        inputs: files and folders it reads (default targets/, the deck and the files of own effects); extra:
        what else makes it another run.
        """
        stamp = self._stamp(kind, **how)
        killed = self._resumed(stamp)
        run = Run(killed or self._next(kind), resumed=killed is not None)
        files.mend_jsonl(run.path("log.jsonl"))
        before = self.info(run.folder).started if run.resumed else ()
        stamp = stamp.model_copy(update={"started": (*before, _now())})  # every time it was started
        run.write(stamp)
        run.write_text("twin.toml", dump(self.config))
        with _recorded(run, stamp):
            yield run

    def _with_status(self, kind: str, status: str) -> Iterator[tuple[Path, RunRecord]]:
        """The runs of a kind and a status, newest first."""
        for folder in reversed(self.runs()):
            if kind_of(folder) == kind and (info := self.info(folder)).status == status:
                yield folder, info

    def _next(self, kind: str) -> Path:
        runs = self.runs()
        number = int(runs[-1].name.partition("-")[0]) + 1 if runs else 1
        folder = self.root / "runs" / f"{number:04d}-{kind}"
        folder.mkdir(parents=True)
        return folder

    def _stamp(
        self,
        kind: str,
        *,
        seed: int | None = None,
        tables: Sequence[str] | None = None,
        inputs: Sequence[Path] | None = None,
        extra: Mapping[str, Any] | None = None,
    ) -> RunRecord:
        """A run that has begun: what makes it what it is, with the digest over all of it."""
        config = self.config.model_dump(mode="json")
        read = list(inputs or [])
        if inputs is None:
            read = [self.targets_folder] if self.targets_folder.is_dir() else []
            read += [*self.deck_files(), *self.effect_files(), *self.material_files()]
        stamp = RunRecord(
            kind=kind,
            seed=seed,
            extra=RunExtra(**(extra or {})),
            config=StoredConfig(**{name: config[name] for name in (config if tables is None else tables)}),
            inputs=files.digest_of(read, root=self.root),
            format=format_of(kind),
            versions=dict(versions()),
            digest="",
            status="running",
        )
        if self.builtin is not None:
            stamp = stamp.model_copy(update={"builtin": repr(self.builtin)})
        what = stamp.model_dump(exclude_unset=True, exclude={"digest", "status", "versions"})
        what["inputs"].pop(ORIGIN, None)
        return stamp.model_copy(update={"digest": files.digest_text(what)})


def named_after(folder: Path) -> str:
    """The name of a batch in a folder. ValueError where no text file can hold it."""
    name = folder.resolve().name
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        raise ValueError(f"{folder}: its name is no UTF-8 text; wanted a folder of another name") from None
    return name


def kind_of(folder: Path) -> str:
    """The kind in a run folder's name: calibrate for 0003-calibrate."""
    return folder.name.partition("-")[2]


@cache
def versions() -> Mapping[str, str]:
    """The versions that a run depends on; packages that are not installed are left out. Asked for once, as
    the first lines of all their files are read for it."""
    installed = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return MappingProxyType(installed)


def dataset(name: str) -> Path:
    """Folder of a data set: of a clone of the repository, else of the installed wheel, which has `quick`.
    Raises ValueError where neither has it."""
    places = (Path(__file__).resolve().parents[2] / "datasets", Path(sys.prefix) / "share" / "softtwin")
    for folder in places:
        if (folder / name / "twin.toml").is_file():
            return folder / name
    raise ValueError(
        f"data set {name!r} is not there (looked in {places[0]} and {places[1]}): an installed wheel has the "
        "quick demo alone, `twin demo --quick`; a clone of the repository has all (`pip install -e .`)"
    )


@contextmanager
def _recorded(run: Run, stamp: RunRecord) -> Iterator[None]:
    """Write in run.json how the block ended."""
    start, cpu, before = time.monotonic(), effort.processor_s(), effort.so_far()
    status = "running"  # what an interrupt leaves
    try:
        yield
        status = "done"
    except Exception as error:
        name = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        status = f"failed: {name}{error}"
        raise
    finally:
        took = {"seconds": time.monotonic() - start, "cpu_s": effort.processor_s() - cpu}
        end: dict[str, Any] = {"status": status, "finished": _now()}
        end |= {name: round(s, 3) for name, s in took.items()}
        solved = effort.since(before)
        if status != "running" and os.path.isdir(run.folder):
            if solved:
                end["solves"] = {k: SolvesRow(n=s.n, cpu_s=round(s.cpu_s, 3)) for k, s in solved.items()}
                run.note(f"Solved: {effort.in_words(solved)}.")
            run.write(stamp.model_copy(update=end | {"summary": RunSummary(**run.summary)}))


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")
