"""The error that stays in marks at rest until coding draws their picture anew, as modes."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.errors.modes import Named, orthogonal
from vision.errors.standing import Standing
from vision.marks import Mark
from vision.plane import Plane, misplaced

LONG = 60  # frames between key frames from which the noise's own persistence does not hold the step
MOST = 12  # key frames of a film that get modes
LEAST, MOST_COURSES = 0.1, 12  # of a frame mark's noise, rms of a course that counts; and how many do


def stretches(keys: NDArray[np.intp], frames: int) -> list[slice]:
    """The frames from each key frame to the next."""
    edges = [0, *(int(k) for k in keys if 0 < k < frames), frames]
    return [slice(a, b) for a, b in pairwise(edges)]


def rare(parts: Sequence[slice]) -> bool:
    """Whether key frames are so few that the noise's persistence misses the steps at them."""
    return parts[-1].stop >= LONG * len(parts)


def key_modes(
    error: Standing, steps: NDArray[np.intp], reference: NDArray[np.intp],
    marks: Sequence[Mark], still: NDArray[np.bool_], plane: Plane, place: Array,
) -> Named:  # fmt: skip
    """What stays in marks at rest, relative to the reference: of each that always rests, and of the plane.

    steps: (s,) frames that are kept.   reference: (r,) among them.   still: (p,) marks that never move; the
    others have the codec's modes.
    plane, place: frame marks, and places (s,p,2) mm, in the steps.
    """
    shift = np.nan_to_num(misplaced(plane, place))
    modes: dict[str, Array] = {}
    for k, course in enumerate(courses(error, steps, reference)):
        for p in np.flatnonzero(still).tolist():
            for component in (0, 2):
                field = np.zeros((*place.shape[:2], 3))
                field[:, p, component] = course
                modes[f"codec:{marks[p].name}:{component + 1}:key{k + 1}"] = field
        for n, field in enumerate(orthogonal(course[:, None, None] * shift)):
            modes[f"codec:frame:{n + 1}:key{k + 1}"] = field
    return modes


def courses(error: Standing, steps: NDArray[np.intp], reference: NDArray[np.intp]) -> Array:
    """Orthogonal courses (k,s) mm, 1 sd each, of the standing error less its mean over the reference.

    They are those of Karhunen and Loeve, the largest first, without those far below the noise.
    """
    power, turn = np.linalg.eigh(error.covariance)
    within = np.array(
        [(steps >= block.start) & (steps < block.stop) for block in error.blocks], dtype=np.float64
    )
    within -= within[:, reference].mean(axis=1, keepdims=True)
    root = np.sqrt(np.maximum(power, 0.0))[:, None] * turn.T
    _, size, course = np.linalg.svd(root @ within, full_matrices=False)
    kept = (size > LEAST * error.noise_mm * np.sqrt(len(steps)))[:MOST_COURSES]
    return np.asarray((size[:, None] * course)[: len(kept)][kept])
