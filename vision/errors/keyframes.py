"""What draws a picture at rest anew, with another error, which stays: key frames, and motion beside it."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from vision.camera import Array
from vision.errors.modes import Named, orthogonal
from vision.errors.noise import REST, SETTLED
from vision.errors.variance import Rest
from vision.following.turns import mean_seen
from vision.marks import Mark
from vision.plane import Plane, misplaced

LONG = 60  # frames between key frames from which the noise's own persistence does not hold the step
ENOUGH = 30  # frames of a stretch whose mean is compared
MOST = 12  # key frames of a film that get modes
MOST_MOVES = 4  # beginnings and ends of motion that do
CHANCE = 0.05  # that the means of stretches differ so by their noise
LEAST_STEPS = 5  # of a stretch whose mean is compared
LEAST = 1e-6  # of the largest singular value


def stretches(keys: NDArray[np.intp], frames: int) -> list[slice]:
    """The frames from each key frame to the next."""
    edges = [0, *(int(k) for k in keys if 0 < k < frames), frames]
    return [slice(a, b) for a, b in pairwise(edges)]


def rare(parts: Sequence[slice]) -> bool:
    """Whether key frames are so few that the noise's persistence misses the steps at them."""
    return parts[-1].stop >= LONG * len(parts)


def moves(keys: NDArray[np.intp], state: NDArray[np.int8]) -> NDArray[np.intp]:
    """Frames in which a motion in the picture begins or ends: coding then draws what rests anew as well.

    state: (t,m) from `vision.errors.noise.states`. They are ENOUGH frames or more from each other and from
    key frames, and MOST_MOVES at most.
    """
    moving = (state[SETTLED:] != REST).any(axis=1)
    turns = np.flatnonzero(np.diff(moving.astype(np.int8))) + SETTLED + 1
    apart: list[int] = []
    for turn in turns.tolist():
        if all(abs(turn - edge) >= ENOUGH for edge in (*apart, *keys.tolist(), 0, len(state))):
            apart.append(turn)
    if len(apart) > MOST_MOVES:
        apart = [apart[k] for k in np.linspace(0, len(apart) - 1, MOST_MOVES).round().astype(int)]
    return np.array(apart, dtype=np.intp)


def telling(parts: Sequence[slice]) -> list[slice]:
    """The stretches that tell the step between them: two or more; else none."""
    long = [part for part in parts if part.stop - part.start >= ENOUGH]
    return long if len(long) > 1 else []


def step_variance(place: Array, plane: Plane, rest: Rest, parts: Sequence[slice]) -> float:
    """Variance in mm2, of one mark's centre in each axis, of the error that stays between key frames.

    place: (t,p,2) mm at rest.   plane: of the frame marks there.   parts: from `telling`.

    The means of the stretches differ by it and by the noise of a mean. A point has the frame marks' share on
    top of its own; what is left of the frame marks has 2 f - 8 degrees of freedom.
    """
    count = float(np.mean([rest.noise.persistence.of_mean(part.stop - part.start) for part in parts]))
    free = 2 * np.count_nonzero(plane.seen.any(axis=0)) - 8
    share = 1.0 + rest.homography / rest.frame_variance
    own = rest.noise.sd[:, [0, 2]] ** 2
    known = np.isfinite(place[..., 0]).any(axis=0)
    found = _between(place[:, known], parts) + _between(plane.residual, parts)
    noise = count * (float(own[known].sum()) + free * rest.frame_variance)
    return max(found - noise, 0.0) / (float(share[known].sum()) + free)


def frame_step_variance(plane: Plane, rest: Rest, groups: Sequence[Sequence[slice]]) -> float:
    """The same from the frame marks alone, in a film in which others move.

    plane: in that film.   groups: stretches that are compared with each other; 0 if noise may do it.
    """
    free = 2 * np.count_nonzero(plane.seen.any(axis=0)) - 8
    parts = [[part for part in group if part.stop - part.start >= LEAST_STEPS] for group in groups]
    told = [group for group in parts if len(group) > 1]
    if free < 1 or not told:
        return 0.0
    means = [rest.noise.persistence.of_mean(part.stop - part.start) for group in told for part in group]
    weight = np.array([len(group) - 1.0 for group in told])
    found = np.array([_between(plane.residual, group) for group in told]) @ weight / weight.sum()
    noise = float(np.mean(means)) * rest.frame_variance
    freedom = free * float(weight.sum())
    if float(found) / free < noise * chi2.isf(CHANCE, freedom) / freedom:
        return 0.0
    return float(found) / free - noise


def _between(place: Array, parts: Sequence[slice]) -> float:
    """Variance of the stretches' means of places (t,p,2), summed over those that all stretches show."""
    means = np.array([mean_seen(place[part]) for part in parts])
    return float(np.var(means[:, np.isfinite(means).all(axis=(0, 2))], axis=0, ddof=1).sum())


def key_modes(
    variance: float, parts: Sequence[slice], steps: NDArray[np.intp], reference: NDArray[np.intp],
    marks: Sequence[Mark], still: NDArray[np.bool_], plane: Plane, place: Array, word: str = "key",
) -> Named:  # fmt: skip
    """Steps at key frames, relative to the reference: of each mark that always rests, and of the plane.

    variance: from `step_variance`.   parts: all stretches of the film.   steps: (s,) frames that are kept.
    reference: (r,) among the steps.   still: (p,) marks that never move; the others have the codec's modes.
    plane, place: frame marks, and places (s,p,2) mm, in the steps.   word: of the modes' names.
    """
    within = np.array([(steps >= part.start) & (steps < part.stop) for part in parts], dtype=np.float64)
    within -= within[:, reference].mean(axis=1, keepdims=True)
    _, size, course = np.linalg.svd(within, full_matrices=False)
    shift = np.nan_to_num(misplaced(plane, place))
    modes: dict[str, Array] = {}
    for k in np.flatnonzero(size > LEAST * max(float(size[0]), 1e-300)):
        step = np.sqrt(variance) * size[k] * course[k]
        for p in np.flatnonzero(still).tolist():
            for component in (0, 2):
                field = np.zeros((*place.shape[:2], 3))
                field[:, p, component] = step
                modes[f"codec:{marks[p].name}:{component + 1}:{word}{k + 1}"] = field
        for n, field in enumerate(orthogonal(step[:, None, None] * shift)):
            modes[f"codec:frame:{n + 1}:{word}{k + 1}"] = field
    return modes
