"""Coding error of marks at rest, which changes at rare key frames, and while others move.

A key frame draws the picture anew, with another error that stays until the next; where others move, what
stays changes too. Frame marks, which never move, tell how much; it becomes modes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.errors.independenterrors import Rest
from vision.errors.sharederrors import Named, orthogonal
from vision.errors.staticnoise import SETTLED
from vision.following.markrotations import mean_seen
from vision.marks import Mark
from vision.plane import Plane, misplaced

# Where these numbers come from: docs/records/error-numbers.md
LONG = 60  # frames between key frames from which the noise's own persistence does not hold the step
MOST = 12  # key frames of a film that get modes; courses that do
LEAST = 0.1  # of a frame mark's noise, rms of a course that counts
BLOCK = 40  # frames in whose mean the error is taken
FRESH = 0.6  # variance that a key frame draws anew over what coding leaves at rest; drawn film: 0.2 to 1.4
WORTH = 6.0  # degrees of freedom that this is worth, from its scatter
SLOW = 0.014  # of the variance is new from block to block; drawn film of crf 23 to 28: 0.001 to 0.05
FEW = 4.0  # degrees of freedom that this is worth for all blocks, and what all change for one of them
MOST_NEW = 0.95  # of the variance, from block to block


@dataclass(frozen=True)
class CodingDrift:
    """Coding error of marks at rest beyond the static film's noise, each axis of one mark's centre."""

    blocks: tuple[slice, ...]  # (b,) stretches of the film
    covariance: Array  # (b,b) mm2, of its means in them
    flicker: float  # mm2, new in every frame of the film and not in those of the static film
    noise_mm: float  # usual sd of a mark in the static film, against which it matters


def stretches(keys: NDArray[np.intp], frames: int) -> list[slice]:
    """The frames from each key frame to the next."""
    edges = [0, *(int(k) for k in keys if 0 < k < frames), frames]
    return [slice(a, b) for a, b in pairwise(edges)]


def rare(parts: Sequence[slice]) -> bool:
    """True if key frames are so few that the noise's persistence misses the steps at them."""
    return parts[-1].stop >= LONG * len(parts)


def coding_drift(
    film: Plane, quiet: Plane, place: Array, rest: Rest, frozen: float, keys: Sequence[slice],
    quiet_keys: Sequence[slice],
) -> CodingDrift:  # fmt: skip
    """The error in the film, whose key frames are rare.

    film, quiet: frame marks in all frames of the film, and of the static film.   place: (t,p,2) mm in that.
    frozen: mm2, what coding leaves in marks at rest.   keys, quiet_keys: stretches between key frames.

    What is left of f frame marks has 2 f - 8 degrees of freedom. What is drawn anew is told by the film's key
    frames, by those of the static film in all its marks, and by what coding leaves: each counts as much as
    it has degrees of freedom. How it changes in between is told by the film alone: where nothing moves,
    coders repeat more. A point has the frame marks' share on top of its own.
    """
    blocks, of = _blocks(keys)
    free, seen = _freedom(film), np.isfinite(place[..., 0]).any(axis=0)
    share = shares(rest)
    variance = float(np.mean(rest.noise.sd[:, [0, 2]] ** 2 / share))
    noise = rest.noise.persistence.lasting * variance
    estimates = [(FRESH * frozen / float(share.mean()) - noise, WORTH if frozen > 0.0 else 0.0)]
    estimates.append(_redrawn(_steps(film.residual, keys), rest, free, free))
    steps = _steps(np.concatenate([place[:, seen], quiet.residual], axis=1), quiet_keys)
    estimates.append(_redrawn(steps, rest, 2.0 * int(seen.sum()) + free, float(share[seen].sum()) + free))
    weight = sum(count for _, count in estimates)
    drawn = max(sum(estimate * count for estimate, count in estimates) / weight, 0.0) if weight else 0.0
    # The noise's own steps from block to block; not where it is a small part, and would go on growing.
    mean = rest.noise.persistence.of_mean
    static_step = 2.0 * (mean(BLOCK) - mean(2 * BLOCK)) * variance * noise / max(drawn + noise, 1e-30)
    correlation = _block_correlation(film.residual, blocks, of, free, drawn + noise, static_step)
    # Where others move, coders draw B-frames of what rests less exactly.
    flicker = max(_new(film) - _new(quiet), 0.0)
    return CodingDrift(tuple(blocks), drawn * correlation, flicker, float(np.sqrt(variance)))


def shares(rest: Rest) -> Array:
    """Variance (p,2) of each place relative to a mark's centre: the frame marks' is in it."""
    variance = max(rest.frame_variance, 1e-30)
    return np.asarray(1.0 + np.where(rest.frame_variance > 0.0, rest.homography / variance, 0.0))


def _blocks(keys: Sequence[slice]) -> tuple[list[slice], NDArray[np.intp]]:
    """Blocks (b,) of the film, none across a key frame, and the stretch (b,) of each."""
    blocks, of = [], []
    for k, part in enumerate(keys):
        count = max(round((part.stop - part.start) / BLOCK), 1)
        edges = np.linspace(part.start, part.stop, count + 1).round().astype(int).tolist()
        blocks += [slice(a, b) for a, b in pairwise(edges)]
        of += [k] * count
    return blocks, np.array(of)


def _freedom(plane: Plane) -> int:
    return max(2 * int(np.count_nonzero(plane.seen.any(axis=0))) - 8, 0)


def _redrawn(
    steps: list[tuple[float, int, int]], rest: Rest, free: float, size: float
) -> tuple[float, float]:
    """Variance mm2 of what key frames draw anew, and its degrees of freedom.

    steps: from `_steps`.   free: values in each.   size: sum of their variances over that of a frame mark.
    """
    if not steps or free < 1:
        return 0.0, 0.0
    mean = rest.noise.persistence.of_mean
    noise = [0.5 * rest.frame_variance * (mean(before) + mean(after)) for _, before, after in steps]
    return float(np.mean([step for step, _, _ in steps])) / size - float(np.mean(noise)), free * len(steps)


def _steps(place: Array, keys: Sequence[slice]) -> list[tuple[float, int, int]]:
    """Half the squared step mm2 of places (t,m,2) at each key frame, summed; frames before and after it."""
    steps = []
    for a, b in pairwise(keys):
        before = place[max(a.start, a.stop - BLOCK) : a.stop]
        after = place[b.start : min(b.stop, b.start + BLOCK)]
        if min(len(before), len(after)) >= SETTLED:
            steps.append((_half(mean_seen(before), mean_seen(after)), len(before), len(after)))
    return steps


def _block_correlation(
    residual: Array, blocks: Sequence[slice], of: NDArray[np.intp], free: int, variance: float, static: float
) -> Array:
    """Correlation (b,b) of blocks' errors of that variance mm2; frame marks tell what each one changes.

    static: mm2 of half their squared steps that are stated elsewhere.
    """
    means = [mean_seen(residual[block]) for block in blocks]
    same = of[1:] == of[:-1]
    step = np.array([_half(a, b) for a, b in pairwise(means)]) / max(free, 1) - static
    usual = (SLOW * variance * FEW + free * float(step[same].sum())) / (FEW + free * int(same.sum()))
    step = np.maximum((FEW * usual + free * step) / (FEW + free), 0.0)
    age = -np.log(1.0 - np.minimum(step / max(variance, 1e-30), MOST_NEW))
    age = np.concatenate([[0.0], np.cumsum(np.where(same, age, 0.0))])
    apart = np.minimum(np.abs(np.subtract.outer(age, age)), 500.0)  # more would underflow
    return np.where(np.equal.outer(of, of), np.exp(-apart), 0.0)


def _half(before: Array, after: Array) -> float:
    return 0.5 * float(np.nansum((after - before) ** 2))


def _new(plane: Plane) -> float:
    """Variance mm2 of a frame mark that is new in every frame."""
    power = np.diff(plane.residual, axis=0) ** 2
    count = np.maximum(np.isfinite(power).sum(axis=0), 1)
    return 0.5 * float(np.sum(np.nansum(power, axis=0) / count)) / max(_freedom(plane), 1)


def key_modes(
    error: CodingDrift, steps: NDArray[np.intp], reference: NDArray[np.intp],
    marks: Sequence[Mark], still: NDArray[np.bool_], plane: Plane, place: Array,
) -> Named:  # fmt: skip
    """Errors that stay in marks at rest, relative to the reference: of each mark that always rests, and of
    the plane.

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


def courses(error: CodingDrift, steps: NDArray[np.intp], reference: NDArray[np.intp]) -> Array:
    """Orthogonal courses (k,s) mm, 1 sd each, of the coding drift less its mean over the reference.

    They are those of Karhunen and Loeve, the largest first, without those far below the noise.
    """
    power, turn = np.linalg.eigh(error.covariance)
    within = np.array(
        [(steps >= block.start) & (steps < block.stop) for block in error.blocks], dtype=np.float64
    )
    within -= within[:, reference].mean(axis=1, keepdims=True)
    root = np.sqrt(np.maximum(power, 0.0))[:, None] * turn.T
    _, size, course = np.linalg.svd(root @ within, full_matrices=False)
    significant = (size > LEAST * error.noise_mm * np.sqrt(len(steps)))[:MOST]
    return np.asarray((size[:, None] * course)[: len(significant)][significant])
