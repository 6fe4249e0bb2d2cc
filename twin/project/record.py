"""Records of the project itself: `run.json` of every run and `source.json` of the targets."""

from typing import Annotated, Any, ClassVar

from pydantic import Field

from twin.records import Loose, Record
from twin.tablemodel import Finite, NotNegative


class StoredModel(Loose):
    effects: tuple[str, ...] = ()
    effect_files: tuple[str, ...] = ()


class StoredConfig(Loose):
    """The configuration that a run was made with, by any version."""

    model: StoredModel = StoredModel()


class RunExtra(Loose):
    effects: tuple[str, ...] = ()
    laws: tuple[str, ...] = ()


class RunSummary(Loose):
    headline: str = ""


class SolvesRow(Record):
    """Solves of one kind."""

    n: int
    cpu_s: NotNegative


class RunRecord(Record):
    """A run: configuration, inputs and versions that it was made from, and how it ended."""

    file: ClassVar[str] = "run.json"
    kind: str
    seed: int | None = None
    extra: RunExtra = RunExtra()
    config: StoredConfig = StoredConfig()
    inputs: dict[str, str] = Field(default={})
    versions: dict[str, str] = Field(default={})
    builtin: str | None = None  # another built-in finger than the study's
    digest: str  # over all of the above
    started: tuple[str, ...] = ()
    status: str
    seconds: NotNegative | None = None
    cpu_s: NotNegative | None = None  # of this process and its workers
    solves: dict[str, SolvesRow] = Field(default={})  # by kind
    finished: str | None = None
    summary: RunSummary = RunSummary()


RunName = Annotated[str, Field(pattern=r"^(\d{4,}-[a-z-]+)?$")]  # a folder of runs/, and no path


class SourceFilm(Record):
    name: str
    block: int
    held_out: bool
    shift_s: Finite  # what its clock was moved by
    run: RunName = ""  # that measured it


class SourceRecord(Record):
    """Origin of the targets."""

    file: ClassVar[str] = "source.json"
    run: RunName | None = None  # that measured them
    films: tuple[SourceFilm, ...] = ()  # where there are several
    format: str = ""  # of the program that measured them elsewhere
    files: dict[str, dict[str, str]] = Field(default={})  # SHA-256
    stated: dict[str, Any] = Field(default={})  # what was stated of them
