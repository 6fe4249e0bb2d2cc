"""A walk over all frames of a film that keeps its rows, so that a killed run never follows a frame twice."""

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from vision.film.decoding import ahead
from vision.film.video import Image, Video

EVERY = 250  # frames in one file

Row = tuple[NDArray[Any], ...]  # what one frame shows
State = TypeVar("State")  # what the next frame is followed from: an array, or a dataclass of such
Progress = Callable[[str, int, int], None]


class Keeper(Protocol):
    """Store of a run's named arrays: each written whole or not at all."""

    def load(self, name: str) -> Mapping[str, NDArray[Any]] | None:
        """The arrays of that name, None where there are none."""
        ...

    def save(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep the arrays under that name."""
        ...


def every_frame(
    film: Video,
    step: Callable[[Image, State], tuple[Row, State]],
    state: State,
    *,
    nothing: Row,
    stage: str,
    progress: Progress | None = None,
    keeper: Keeper | None = None,
) -> list[Row]:
    """The rows of all frames, up to the last that can be decoded.

    step: the row of a picture and the next state.   state: the first one.   nothing: row of a frame that is
    not there.   keeper: where a killed run left what it had followed, and where this one does, as `stage`.
    """
    rows, state, part = _restored(keeper, stage, state)
    fresh: list[Row] = []
    for index, _, image in ahead(film.frames()):
        if index < len(rows):
            continue
        row, state = step(image, state)
        new = [*[nothing] * (index - len(rows)), row]
        rows.extend(new)
        fresh.extend(new)
        if keeper is not None and len(fresh) >= EVERY:
            columns = {f"row{k}": np.array([row[k] for row in fresh]) for k in range(len(row))}
            keeper.save(f"{stage}-{part:04d}", columns | _arrays(state))
            fresh, part = [], part + 1
        if progress is not None:
            progress(stage, index + 1, len(film.time))
    return rows


def _restored(keeper: Keeper | None, stage: str, state: State) -> tuple[list[Row], State, int]:
    """Rows of all parts that are kept, the state after them, and the number of parts."""
    rows: list[Row] = []
    part = 0
    while keeper is not None and (arrays := keeper.load(f"{stage}-{part:04d}")) is not None:
        columns = [arrays[f"row{k}"] for k in range(sum(name.startswith("row") for name in arrays))]
        rows += zip(*columns, strict=True)
        state, part = _like(state, arrays), part + 1
    return rows, state, part


def _arrays(state: Any, name: str = "state") -> dict[str, NDArray[Any]]:
    """The state's arrays by their names."""
    if not is_dataclass(state):
        return {name: state}
    parts = [_arrays(getattr(state, f.name), f"{name}_{f.name}") for f in fields(state)]
    return {key: array for part in parts for key, array in part.items()}


def _like(state: Any, arrays: Mapping[str, NDArray[Any]], name: str = "state") -> Any:
    """A state like this one from its arrays."""
    if not is_dataclass(state):
        return arrays[name]
    parts = {f.name: _like(getattr(state, f.name), arrays, f"{name}_{f.name}") for f in fields(state)}
    kind: Any = type(state)
    return kind(**parts)
