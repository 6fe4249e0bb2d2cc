"""Solved finer meshes, in a folder or in memory: arrays by their keys, and the constants they hold for."""

from collections.abc import Callable, Mapping
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


@dataclass(frozen=True)
class FolderCache:
    """The arrays of a folder, one file a key; what is missing is made by the executor in use, and a killed
    run keeps what was finished."""

    folder: Path
    say: Say

    def __call__(self, stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
        """The array of every task by its key."""
        path = {key: self.folder / f"{key}.npz" for key in tasks}
        missing = [key for key in tasks if not path[key].exists()]
        executor = current() if len(missing) > 1 else Serial()  # one alone gains nothing elsewhere
        results = executor.ended([tasks[key] for key in missing])
        for done, (k, array) in enumerate(results, start=1):  # by its key: in any order
            self.say.progress(stage, done, len(missing))
            files.write_npz(path[missing[k]], {"array": array})
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
        missing = [key for key in tasks if key not in self.arrays]
        executor = current() if len(missing) > 1 else Serial()
        for done, (k, array) in enumerate(executor.ended([tasks[key] for key in missing]), start=1):
            self.say.progress(stage, done, len(missing))
            self.arrays[missing[k]] = array
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
