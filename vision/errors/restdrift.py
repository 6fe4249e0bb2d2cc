"""Trend, drift or jump in the places of marks that should be at rest, against the noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vision.camera import Array
from vision.following.markrotations import mean_seen

# Where these numbers come from: docs/records/error-numbers.md
BLOCKS = 6  # parts of the time whose means are compared
FEW = 4  # frames in a part, at least: one that is found elsewhere is no drift
CLEAR = 10.0  # sds of a part's mean by white noise: noise of neighbouring frames is alike
MOST_MM = 0.25  # beyond it a mark moves; below it a drift is told
TELL_MM = 0.03
TURNS = 3  # jumps to and fro between two places, which no finger at rest does
BETWEEN = 0.2  # of the way, either side of its middle, is in between
RARE = 0.15  # of the frames, in between


@dataclass(frozen=True)
class Unrest:
    """The mark that moves most in a time of rest."""

    name: str
    mm: float  # between the two parts of the time that differ most
    moves: bool  # by more than is accepted


def unrest(place: Array, names: Sequence[str]) -> Unrest | None:
    """The mark that clearly moves most in places (t,p,2) mm that should be at rest; None where nothing does.

    The time is cut into parts. The range of their means is compared with the noise from frame to frame, which
    a slow motion hardly touches. What is clear and below 0.03 mm is no matter, nor is a corner that is found
    at one of two pixels by turns.
    """
    blocks = min(BLOCKS, max(2, len(place) // FEW))
    parts = [part for part in np.array_split(place, blocks) if len(part) >= FEW]
    if len(parts) < 2:
        return None
    means = np.array([mean_seen(part) for part in parts])
    counts = np.array([np.isfinite(part[..., 0]).sum(axis=0) for part in parts])
    noise = _noise(place)
    worst: Unrest | None = None
    for p, name in enumerate(names):
        enough = counts[:, p] >= FEW
        if enough.sum() < 2:
            continue
        apart = np.linalg.norm(means[enough, p][:, None] - means[enough, p][None], axis=-1)
        mm, sd = float(apart.max()), noise[p] * np.sqrt(2.0 / counts[enough, p].min())
        if mm <= max(CLEAR * sd, TELL_MM) or (worst is not None and mm <= worst.mm):
            continue
        ends = means[enough, p][list(np.unravel_index(int(apart.argmax()), apart.shape))]
        if not _flips(place[:, p], ends):
            worst = Unrest(name, mm, mm > MOST_MM)
    return worst


def check_rest(
    place: Array, time: Array, names: Sequence[str], *, film: str, static: bool
) -> tuple[str, ...]:
    """A sentence where a mark drifts a little at rest; raises ValueError where one moves.

    place: (t,p,2) mm during the rest.   time: (t,) s.   static: whether it is the static film.
    """
    drift = unrest(place, names)
    if drift is None:
        return ()
    span = f"between {time[0]:.2f} and {time[-1]:.2f} s"
    if static:
        what = "which tells the noise of a finger at rest"
        need = "film it again, vented and at rest"
    else:
        what = "to whose mean all displacements are relative (reference_s)"
        need = "start the film before the finger moves, shorten reference_s, or cut the film to begin at rest"
    if drift.moves:
        raise ValueError(
            f"{film}: the finger is not at rest {span}, {what}: marker {drift.name!r} moves by "
            f"{drift.mm:.2g} mm, wanted at most {MOST_MM:g} mm; {need}"
        )
    return (
        f"{film}: marker {drift.name!r} drifts by {drift.mm:.2g} mm {span}, {what}. Displacements may be "
        "off by as much.",
    )


def _flips(place: Array, ends: Array) -> bool:
    """True if places (t,2) mm jump to and fro between two (2,2) mm, with hardly one in between."""
    between = ends[1] - ends[0]
    along = ((place - ends[0]) @ between / (between @ between))[np.isfinite(place[:, 0])]
    sure = along[np.abs(along - 0.5) > BETWEEN]
    turns = int(np.count_nonzero(np.diff(sure > 0.5)))
    return turns >= TURNS and len(along) - len(sure) < RARE * len(along)


def _noise(place: Array) -> Array:
    """Sd (p,) mm of a place from its changes from frame to frame, less their median, which a steady motion
    has."""
    steps = np.diff(place, axis=0)
    sd = np.zeros(place.shape[1])
    for p in range(place.shape[1]):
        of_mark = steps[np.isfinite(steps[:, p, 0]), p]
        if len(of_mark):
            away = np.linalg.norm(of_mark - np.median(of_mark, axis=0), axis=1)
            # The median distance of a normal scatter in two axes is 1.177 sd; a step has two places.
            sd[p] = np.median(away) / 1.177 / np.sqrt(2.0)
    return sd
