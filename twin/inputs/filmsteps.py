"""How many frames of a film become steps where twin.toml does not say: as many as a fit holds in memory."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from twin.fitmemory import MOST_BYTES, MOST_STEPS, steps_held
from twin.inputs.films import RIG

if TYPE_CHECKING:
    from vision import Displacements

OWN = 2  # errors of a film that are not the camera's: of the join with the log, of a rolling shutter


def room(films: int) -> Callable[[Sequence[str], int, int], int]:
    """What tells the most evenly spaced steps of one of so many films that are fitted together, from the
    names of its errors, the values in a step, and the steps of its reference.

    >>> names = [f"node:{k}" for k in range(300)] + [f"codec:{k}" for k in range(400)]
    >>> [room(films)(names, 48, 54) for films in (1, 2, 4)]
    [1490, 442, 90]
    """

    def most(names: Sequence[str], values: int, reference: int) -> int:
        rig = sum(name.partition(":")[0] in RIG for name in names)  # once for all films
        errors = rig + films * (len(names) - rig + OWN)
        return steps_held(values, errors, rest=reference, parts=films)

    return most


def said_of_steps(moved: "Displacements", *, stated: bool) -> tuple[str, ...]:
    """A sentence where memory alone makes fewer frames into steps; none where their number is stated."""
    frames = len(moved.tracks.time)
    if stated or moved.most_steps >= min(frames, MOST_STEPS):
        return ()
    return (
        f"{len(moved.time)} of the {frames} frames are kept: the {len(moved.mode_names)} errors that the "
        f"values of {len(moved.names)} markers share leave room for no more in the "
        f"{MOST_BYTES / 1e9:.0f} GB of a fit. `steps` under [measure] of twin.toml states another number.",
    )
