"""Which frames of a film become steps: a stated number, or as many as their errors leave room for."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vision.errors.errormodel import Placed
from vision.following.tracks import Followed
from vision.placing.views import steps_of

FEW = 100  # steps in which errors are counted first
# The names of errors, values in a step, steps of the reference -> most evenly spaced steps besides these
Room = Callable[[Sequence[str], int, int], int]


def placed_steps(
    film: Followed, steps: int | Room, place: Callable[[NDArray[np.intp]], Placed]
) -> tuple[int, NDArray[np.intp], Placed]:
    """Most evenly spaced steps, the frames (s,) that are kept with them, and what is placed in them.

    A room is asked for FEW steps, and again for as many as it gave: rests that FEW do not show have errors
    of their own. Of fewer steps there are not more errors, so that the second answer holds.
    """

    def room(placed: Placed) -> int:
        if isinstance(steps, int):
            return steps
        names = [name for part in placed.modes for name in part]
        values = int(np.isfinite(placed.value).any(axis=0).sum())
        return steps(names, values, len(film.reference))

    most = steps if isinstance(steps, int) else room(place(steps_of(film, FEW)))
    frames = steps_of(film, most)
    placed = place(frames)
    if (fewer := room(placed)) < most:
        most, frames = fewer, steps_of(film, fewer)
        placed = place(frames)
    return most, frames, placed
