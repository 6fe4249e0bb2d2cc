"""What the JSON files of a project hold: one model for each file, by which it is written and read.

A model lies where its maker does. Here are what all of them are made of, and the two of the project itself.
"""

from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo

from twin.tablemodel import Finite, NotNegative


class Record(BaseModel):
    """A JSON file, or a part of one: frozen, and a key that it does not know is an error.

    What was given is written, so a key with a default may be absent. A description is what docs/files.md says
    of a key; a key without one shares the row above it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, validate_by_name=True)
    file: ClassVar[str] = ""  # its name in the folder of a run


class Loose(BaseModel):
    """A part of a record that other versions made too: what is named is checked, other keys may be there."""

    model_config = ConfigDict(extra="allow", frozen=True)


def _or_null(value: Any, info: ValidationInfo) -> Any:
    """Null for what is infinite or not known; a file says so itself."""
    unknown = info.mode == "python" and isinstance(value, float) and not abs(value) < float("inf")
    return None if unknown else value


Maybe = Annotated[Finite | None, BeforeValidator(_or_null)]
MaybeSize = Annotated[NotNegative | None, BeforeValidator(_or_null)]


Reach = Annotated[float, BeforeValidator(lambda value: float("inf") if value is None else value)]  # null: inf


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
    """What makes a run what it is, and how it ended."""

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
    """Where the targets come from."""

    file: ClassVar[str] = "source.json"
    run: RunName | None = None  # that measured them
    films: tuple[SourceFilm, ...] = ()  # where there are several
    format: str = ""  # of the program that measured them elsewhere
    files: dict[str, dict[str, str]] = Field(default={})  # SHA-256
    stated: dict[str, Any] = Field(default={})  # what was stated of them
