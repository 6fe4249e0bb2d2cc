"""Records of the project itself: `run.json` of every run and `source.json` of the targets; and how two runs
differ in what they were made from."""

import re
from collections.abc import Iterator, Mapping, Sequence
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
    format: int = 1  # of the figures, as in FORMATS
    versions: dict[str, str] = Field(default={})  # told, but none of what makes a run another one
    builtin: str | None = None  # another built-in finger than the study's
    digest: str  # over all of the above but the versions
    started: tuple[str, ...] = ()
    status: str
    seconds: NotNegative | None = None
    cpu_s: NotNegative | None = None  # of this process and its workers
    solves: dict[str, SolvesRow] = Field(default={})  # by kind
    finished: str | None = None
    summary: RunSummary = RunSummary()


# Of the figures of each kind of run, raised by hand where the same inputs and settings give others; 1 for a
# kind that is not named. A run of another format is stale; versions, of softtwin too, change nothing.
FORMATS: dict[str, int] = {
    **dict.fromkeys(("measure", "film"), 2),  # 2: coding errors as the film itself shows them
    **dict.fromkeys(("calibrate", "compare", "diagnose", "add", "drop"), 2),  # 2: tolerances of walls
}
ORIGIN = "targets/source.json"  # says which run measured the targets, no bit of them


def format_of(kind: str) -> int:
    """The present format of the figures of a kind of run.

    >>> format_of("print")
    1
    """
    return FORMATS.get(kind, 1)


def changed_format(was: RunRecord) -> list[str]:
    """A clause where the figures of a run are of another format than now."""
    now = format_of(was.kind)
    return [] if was.format == now else [f"its figures are of format {was.format}, those of now of {now}"]


def changed_files(was: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """How digests of files by their paths differ, a clause for each file.

    >>> changed_files({"a.png": "1", "b.png": "2"}, {"a.png": "3"})
    ['a.png has changed since', 'b.png is gone']
    """
    names = [name for name in {**was, **now} if name != ORIGIN and was.get(name) != now.get(name)]
    return [
        *(f"{name} has changed since" for name in names if name in was and name in now),
        *(f"{name} is gone" for name in names if name not in now),
        *(f"{name} is new" for name in names if name not in was),
    ]


def changed_tables(
    was: Mapping[str, Any], now: Mapping[str, Any], stated: Mapping[str, Any]
) -> Iterator[tuple[str, str]]:
    """The names of table and key, "" of a table without keys, in which configurations differ.

    was: of a run, by any version: a key that it does not have counts only where it is among those of now that
    are `stated`, as against a default.

    >>> list(changed_tables({"dic": {"a": 1}}, {"dic": {"a": 2, "new": 0}}, {"dic": {"a": 2}}))
    [('dic', 'a')]
    """
    for name, table in now.items():
        if was.get(name) is None or table is None:
            if name in (was if table is None else stated) and table is not was.get(name):
                yield name, ""
            continue
        before, by_user = _keys(was[name]), _keys(stated.get(name, {}))
        for key, value in _keys(table).items():
            if not (_agree(before[key], value, by_user.get(key)) if key in before else key not in by_user):
                yield name, key


def _keys(table: Any) -> Mapping[str, Any]:
    """The keys of a table; an array of tables counts as one value."""
    return table if isinstance(table, Mapping) else {"": table}


def _agree(was: Any, now: Any, stated: Any) -> bool:
    """True where values are equal but for keys that `was` does not have and nobody has stated."""
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        return not any(changed_tables({"": was}, {"": now}, {"": stated}))
    if isinstance(was, Sequence) and isinstance(now, Sequence) and not isinstance(now, str):
        given = stated if isinstance(stated, Sequence) and len(stated) == len(now) else [None] * len(now)
        return len(was) == len(now) and all(map(_agree, was, now, given))
    return bool(was == now)


def differences(was: RunRecord, now: RunRecord, stated: Mapping[str, Any]) -> list[str]:
    """What has changed from a run to one of now, one clause each; [] where it need not be made again.

    stated: the configuration of now without its defaults.
    """
    then, present = was.model_dump(mode="json"), now.model_dump(mode="json")
    leaves = dict(_leaves(then["extra"])), dict(_leaves(present["extra"]))
    values = [(key, *(side.get(key) for side in leaves)) for key in {**leaves[0], **leaves[1]}]
    values += [(key, then[key], present[key]) for key in ("seed", "builtin")]
    inputs = ({re.sub(r"^runs/\d+-", "runs/", k): v for k, v in run.inputs.items()} for run in (was, now))
    return [
        *changed_format(was),
        *changed_files(*inputs),
        *(changed_place(*key) for key in changed_tables(then["config"], present["config"], stated)),
        *(f"{key} was {before} and is {value}" for key, before, value in values if before != value),
    ]  # fmt: skip


def changed_place(table: str, key: str) -> str:
    """The clause for a key of twin.toml, or an array of tables, that has changed."""
    return f"{f'[{table}] {key}' if key else f'[[{table}]]'} of twin.toml has changed since"


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The values in a table of tables, by their dotted names."""
    if not isinstance(value, Mapping):
        yield name, value
        return
    for key, part in value.items():
        yield from _leaves(part, f"{name}.{key}" if name else key)


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
