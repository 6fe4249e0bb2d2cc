"""What was followed so far in, files of a killed run out, and back: a film is never followed twice."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.identity import Memory

EVERY = 250  # frames in one file

# What a frame shows, see `vision.tracks`.
Row = tuple[Array, Array, NDArray[np.int8], Array, NDArray[np.bool_], Array]
COLUMNS = 6


class Keeper(Protocol):
    """Where a run keeps named arrays: each written whole or not at all."""

    def load(self, name: str) -> Mapping[str, NDArray[Any]] | None:
        """The arrays of that name, None where there are none."""
        ...

    def save(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep the arrays under that name."""
        ...


@dataclass(frozen=True)
class State:
    """What the next frame is followed from."""

    last: Array  # (p,3,3) warps where marks were last seen
    before: Array  # (p,3,3) and a frame before that
    memory: Memory


def stored(keeper: Keeper, stage: str, part: int, rows: list[Row], state: State) -> None:
    """Keep the rows of one part of a stage, and the state after them."""
    arrays = {f"row{k}": np.array([row[k] for row in rows]) for k in range(COLUMNS)}
    kept = {f"memory_{f.name}": getattr(state.memory, f.name) for f in fields(Memory)}
    keeper.save(f"{stage}-{part:04d}", arrays | kept | {"last": state.last, "before": state.before})


def restored(keeper: Keeper, stage: str) -> tuple[list[Row], State | None, int]:
    """Rows of all parts that are kept, the state after them (None without any), and the number of parts."""
    rows: list[Row] = []
    state, part = None, 0
    while (found := keeper.load(f"{stage}-{part:04d}")) is not None:
        columns = [found[f"row{k}"] for k in range(COLUMNS)]
        rows += [tuple(column[i] for column in columns) for i in range(len(columns[0]))]
        memory = Memory(**{f.name: found[f"memory_{f.name}"] for f in fields(Memory)})
        state, part = State(found["last"], found["before"], memory), part + 1
    return rows, state, part
