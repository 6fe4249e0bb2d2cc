"""Solved finer meshes, in a folder or in memory: arrays by their keys, and the constants they hold for."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import RootModel, model_validator

from twin import files
from twin.executors.local import Serial, current
from twin.laws.law import Constants, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.messages import Say
from twin.model.arraycache import ArrayCache
from twin.model.discretisation import SolvedAt
from twin.records import Record
from twin.tablemodel import Finite, Positive
from twin.targets import Array

FURTHER = 1.7  # at most: curves of few levels that reach much too far are coarse where it counts


def _made(tasks: Mapping[str, Callable[[], Array]], stage: str, say: Say) -> Iterator[tuple[str, Array]]:
    """The array of each task with its key, in the order in which the executor in use ends them."""
    executor, keys = current() if len(tasks) > 1 else Serial(), list(tasks)  # one gains nothing elsewhere
    for done, (k, array) in enumerate(executor.ended(list(tasks.values())), start=1):
        say.progress(stage, done, len(tasks))
        yield keys[k], array


@dataclass(frozen=True)
class FolderCache:
    """The arrays of a folder, one file a key; what is missing is made by the executor in use, and a killed
    run keeps what was finished."""

    folder: Path
    say: Say

    def __call__(self, stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
        """The array of every task by its key."""
        path = {key: self.folder / f"{key}.npz" for key in tasks}
        for key, array in _made({k: v for k, v in tasks.items() if not path[k].exists()}, stage, self.say):
            files.write_npz(path[key], {"array": array})
        return {key: np.asarray(files.read_npz(path[key], "array")["array"], float) for key in tasks}


class SolvedRow(Record):
    values: dict[str, Finite]
    top_MPa: Positive

    @model_validator(mode="before")
    @classmethod
    def _former(cls, row: Any) -> Any:
        """A row, also in the former format without named values (C10, C01, top_MPa)."""
        if not (isinstance(row, dict) and set(row) == {"C10", "C01", "top_MPa"}):
            return row
        return {"values": {name: row[name] for name in ("C10", "C01")}, "top_MPa": row["top_MPa"]}


class SolvedRows(RootModel[tuple[SolvedRow, ...]]):
    """Constants and pressures at which finer meshes were solved."""


@dataclass(frozen=True)
class SolvedList:
    """The constants of a law and pressures at which the finer meshes of one structure were solved, in a JSON
    file, or in memory where path is None."""

    path: Path | None
    law: RubberLaw = MOONEY_RIVLIN
    memory: list[SolvedAt] = field(default_factory=list)

    @property
    def known(self) -> list[SolvedAt]:
        """Constants and pressures, the oldest first."""
        if self.path is None:
            return self.memory
        rows = files.read(SolvedRows, self.path).root if self.path.exists() else ()
        for row in rows:
            if missing := set(self.law.names) - row.values.keys():
                raise ValueError(
                    f"{self.path}: {', '.join(sorted(missing))} is not among the constants "
                    f"{dict(row.values)}; wanted those of {self.law.name}: remove the file, and the finer "
                    "meshes are solved again"
                )
        return [SolvedAt(self.law.of(row.values), row.top_MPa) for row in rows]

    def serving(
        self, constants: Constants, pressure: float, *, low: float = 0.0, high: float = np.inf
    ) -> SolvedAt | None:
        """The oldest solve that serves constants up to a pressure in MPa; None without one.

        Its scale is `low` to `high` times the scale of the constants; its pressure, scaled likewise, is at
        least theirs and at most FURTHER times that.
        """
        for solved in self.known:
            scale = solved.constants.scale / constants.scale
            if low <= scale <= high and scale * pressure <= solved.top <= FURTHER * scale * pressure:
                return solved
        return None

    def add(self, solved: SolvedAt) -> None:
        """Append a solve, once."""
        if self.path is None:
            self.memory.append(solved)
        elif solved not in self.known:
            every = ((former.constants, former.top) for former in (*self.known, solved))
            rows = tuple(SolvedRow(values=c.named, top_MPa=top) for c, top in every)
            files.write_json(self.path, SolvedRows(rows))


@dataclass(frozen=True)
class MemoryCache:
    """The arrays of this process; those that are missing are made by the executor in use."""

    arrays: dict[str, Array]
    say: Say

    def __call__(self, stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
        """The array of every task by its key."""
        for key, array in _made({k: v for k, v in tasks.items() if k not in self.arrays}, stage, self.say):
            self.arrays[key] = array
        return {key: self.arrays[key] for key in tasks}


@dataclass(frozen=True)
class Store:
    """The store of solved finer meshes: a folder, or None for this process alone."""

    folder: Path | None = None
    arrays: dict[str, Array] = field(default_factory=dict)
    lists: dict[str, list[SolvedAt]] = field(default_factory=dict)

    def cache(self, say: Say) -> ArrayCache:
        """The arrays by their keys."""
        return MemoryCache(self.arrays, say) if self.folder is None else FolderCache(self.folder, say)

    def solved(self, key: str, law: RubberLaw) -> SolvedList:
        """The constants of a law and pressures that were solved for one structure, by its key."""
        if self.folder is None:
            return SolvedList(None, law, self.lists.setdefault(key, []))
        return SolvedList(self.folder / f"{key}-solved.json", law)
