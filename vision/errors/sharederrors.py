"""Errors that many values share, from what is known of the rig: one field a mode, 1 sd each, by name.

A name is its source, then what it belongs to: `placement:tip:x`. `errors.errorbudget` sums them by source.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from vision.camera import Array
from vision.errors.staticnoise import CREEP, FAST, FAST_PX, PASSING, REST, SHAKEN
from vision.following.markrotations import mean_seen
from vision.marks import Mark, with_role

Named = Mapping[str, Array]  # name to (s,p,3) mm
# Where these numbers come from: docs/records/error-numbers.md
LEVEL = 0.2  # slope of the line to a neighbour that still runs along the finger
MIN_HOLD, MAX_HOLDS = 3, 60  # frames that make a hold; how many of all marks get modes, the longest first
LONG = 20  # frames in which a late picture falls behind, or catches up
CREEP_SHARED = 0.75  # of a creeping patch's variance; correlation at lags of 1 to 30 frames: 0.73 to 0.76
REDRAWN_PX = 0.004  # px at most; benchmarks/tracking/film_accuracy.py: pulls are 1.2 without it
BETWEEN_PX = 0.0008  # px, registration between pixels: on lossless film means of holds have pull 2 without it
DRIFTING = 0.5  # of what stays in a creeping patch's variance falls behind or catches up; half is constant
ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))  # of the largest mode's power: less is no mode
UNLIKELY = 0.001  # chance below which residuals contradict what is stated


@dataclass(frozen=True)
class Stated:
    """Stated accuracy of the rig, 1 sd each."""

    placement_mm: float = 0.3  # mm, a finger mark's centre from its nominal place, each axis
    place_mm: float = 0.02  # mm, its material point from the place that the film at rest shows, each axis
    scale: float = 0.001  # relative, all lengths together
    frame_mm: float = 0.1  # mm, a frame mark's centre from its nominal place, each axis
    node_mm: float = 0.1  # mm, the material point at a nominal place from the model's, each axis
    height_mm: float = 0.3  # mm, a finger mark's distance from the frame marks' plane (its y)
    out_of_plane_mm: float = 0.3  # mm, a finger mark's motion towards the camera at its largest displacement
    # where the body stands in the frame, one row (x mm, z mm, turn rad from x towards z) for each error
    pose: tuple[tuple[float, float, float], ...] = ()


def scale(value: Array, sd: float, of_place: Array | None = None) -> Named:
    """All lengths wrong by one factor: displacements (s,p,3) mm times its sd.

    of_place: (s,p,2) mm, what measured places that are off by their own length add.

    >>> scale(np.array([[[10.0, 0.0, -20.0]]]), 0.001)
    {'scale': array([[[ 0.01,  0.  , -0.02]]])}
    """
    return {"scale": (value if of_place is None else value + with_zero_y(of_place)) * sd}


def placement(value: Array, marks: Sequence[Mark], turns: Array, sd: float) -> Named:
    """Tags glued off their stated place by sd mm: the offset d turns with the tag, u errs by (R - 1) d.

    turns: (s,p) rad from x towards z.
    """
    modes: dict[str, Array] = {}
    for p in (p for p in with_role(marks, "finger") if not marks[p].measured):
        for axis, field in zip("xz", _turned(turns[:, p]), strict=True):
            _add(modes, f"placement:{marks[p].owner}:{axis}", value, p, sd * field)
    return modes


def node(value: Array, marks: Sequence[Mark], slope: Array, sd: float, measured_sd: float) -> Named:
    """Material points that are not the model's by sd mm, by measured_sd where the film shows their place: u
    errs by (du/dx) d along the finger, (du/dz) d across it.   slope: (s,p,2,2) from `slopes`."""
    modes: dict[str, Array] = {}
    for p in with_role(marks, "finger"):
        size = measured_sd if marks[p].measured else sd
        for k, axis in enumerate("xz"):
            _add(modes, f"node:{marks[p].owner}:{axis}", value, p, size * slope[:, p, :, k])
    return modes


def slopes(value: Array, marks: Sequence[Mark], turns: Array) -> Array:
    """Slopes (s,p,2,2) of the displacement's x and z by the material point's x and z; 0 off the finger.

    Across the finger it is that of the turn (s,p) rad, R - 1. Along it is the chord between the neighbouring
    finger marks, stretch included, less what their heights make of it; of the first and the last mark, whose
    chord to the one neighbour is the slope half way, that of the turn and what the chord stretches beyond.
    """
    out = np.zeros((*turns.shape, 2, 2))
    points, finger = np.array([mark.position for mark in marks]), with_role(marks, "finger")
    along, across = _turned(turns)
    for p in finger:
        out[:, p] = np.stack([along[:, p], across[:, p]], axis=-1)
        a, b = _beside(points, finger, p)
        if points[b, 0] <= points[a, 0]:
            continue
        (x, _, z), moved = points[b] - points[a], (value[:, b] - value[:, a])[:, [0, 2]]
        if p in (a, b):
            own = (points[[a, b], 2] - points[p, 2])[:, None] * across[:, [a, b]]
            stretch = (moved - own[:, 1] + own[:, 0]) / x - (along[:, a] + along[:, b]) / 2.0
            out[:, p, :, 0] += np.nan_to_num(stretch)
        else:
            chord = (moved - z * across[:, p]) / x
            out[:, p, :, 0] = np.where(np.isfinite(chord), chord, along[:, p])
    return out


def of_places(slope: Array, error: Array) -> Array:
    """Errors (...,s,p,2) mm that errors (...,p,2) mm of measured places make: a model that is asked error mm
    further moves by slope times it more.   slope: (s,p,2,2), 0 where the place is stated."""
    return -np.einsum("spij,...pj->...spi", slope, error)


def pose(value: Array, places: Array, slope: Array, errors: Sequence[Sequence[float]]) -> Named:
    """The body stands elsewhere in the frame than stated: displacements turn by as much, and measured places
    (p,2) mm are off by a rigid motion.   errors: rows (x mm, z mm, turn rad), 1 sd each; turn from x to z.

    >>> pose(np.array([[[1.0, 0, 2]]]), np.zeros((1, 2)), np.zeros((1, 1, 2, 2)), [(0.0, 0.0, 0.01)])
    {'pose:1': array([[[-0.02,  0.  ,  0.01]]])}
    """
    turned, about = (x @ np.array([[0.0, 1.0], [-1.0, 0.0]]) for x in (value[..., [0, 2]], places))
    return {
        f"pose:{k + 1}": with_zero_y(turn * turned + of_places(slope, turn * about + np.array([x, z])))
        for k, (x, z, turn) in enumerate(errors)
    }


def _beside(points: Array, finger: Sequence[int], p: int) -> tuple[int, int]:
    """The next finger marks along the finger on either side; the mark itself where there is none."""
    apart = {q: points[q] - points[p] for q in finger}
    level = [q for q, d in apart.items() if abs(d[2]) <= LEVEL * abs(d[0])]
    before = max((q for q in level if apart[q][0] < 0), key=lambda q: apart[q][0], default=p)
    return before, min((q for q in level if apart[q][0] > 0), key=lambda q: apart[q][0], default=p)


def reference_mode(value: Array, marks: Sequence[Mark], sd: Array, shared: Array | None = None) -> Named:
    """Errors of the reference, which is subtracted from every step.

    sd: (p,3) mm of each mark's mean place; 0 in y, which one camera does not observe.   shared: (3,) mm, of
    what is alike in all marks, None where it is not told apart.
    """
    axes = [component for component in range(3) if shared is None or component != 1]
    modes: dict[str, Array] = {}
    for component in axes if shared is not None else ():
        modes[f"reference:shared:{component + 1}"] = np.broadcast_to(
            shared * np.eye(3)[component], value.shape
        )
    for p, mark in enumerate(marks):
        for component in axes:
            mode = np.zeros(value.shape)
            mode[:, p, component] = sd[p, component]
            modes[f"reference:{mark.name}:{component + 1}"] = mode
    return modes


def redrawn(
    value: Array, ideal: Array, rest: NDArray[np.intp], marks: Sequence[Mark], coded_mm: float
) -> Named:
    """Finger marks on other pixels than in the reference: a constant error where they are off their rest, and
    one after their largest displacement, of registration between pixels and of coding, which draws them anew.

    ideal: (s,p,2) px centres.   rest: (r,) steps of the reference.   coded_mm: what coding leaves in a mark
    at rest, of which REDRAWN_PX count at most.
    """
    off = ideal - mean_seen(ideal[rest])
    away = np.nan_to_num(np.hypot(off[..., 0], off[..., 1]))
    modes: dict[str, Array] = {}
    source = "codec" if coded_mm > 0.0 else "static"
    for p in with_role(marks, "finger"):
        top = int(np.argmax(away[:, p]))
        if away[top, p] <= FAST_PX:
            continue
        mm_per_px = float(np.nan_to_num(np.linalg.norm(value[top, p, [0, 2]]))) / away[top, p]
        size = np.hypot(BETWEEN_PX * mm_per_px, min(REDRAWN_PX * mm_per_px, coded_mm))
        where = {"moved": away[:, p] > FAST_PX, "after": np.arange(len(away)) > top}
        for name, steps in where.items():
            for component in (0, 2):
                field = np.zeros((len(value), 2))
                field[steps, component // 2] = size
                _add(modes, f"{source}:{marks[p].name}:{component + 1}:{name}", value, p, field)
    return modes


def codec(
    extra: Array, state: NDArray[np.int8], marks: Sequence[Mark], shaken_shared: float = CREEP_SHARED
) -> tuple[Named, Array, tuple[str, ...]]:
    """Compression error in three parts: modes that all frames of a rest share, the sd (s,p,3) mm that is left
    as independent, and a sentence where there are more rests than modes.

    extra: (s,p,3) mm, sd of the coding error.   state: (s,p) from `vision.errors.staticnoise.states`.
    shaken_shared: share of a shaken patch's variance that stays, as the film's own coding shows it.

    P-frames repeat a picture that hardly changes, with its error: no mean over the hold makes it smaller.
    """
    slow = (state != FAST) & (state != PASSING) & (np.nan_to_num(extra) > 0).any(axis=2)
    share = np.select([state == CREEP, state == SHAKEN], [CREEP_SHARED, shaken_shared], 1.0)
    runs = [(stop - start, p, start) for p in range(slow.shape[1]) for start, stop in _runs(slow[:, p])]
    modes, independent_sd = {}, extra.copy()
    for count, (length, p, start) in enumerate(sorted(runs, reverse=True)[:MAX_HOLDS]):
        frames = slice(start, start + length)
        independent_sd[frames, p] *= np.sqrt(1.0 - share[frames, p])[:, None]
        shared = extra[frames, p] * np.sqrt(share[frames, p])[:, None]
        for component in np.flatnonzero((np.nan_to_num(shared) > 0).any(axis=0)):
            mode = np.zeros(extra.shape)
            mode[frames, p, component] = np.nan_to_num(shared[:, component])
            name = f"codec:{marks[p].name}:{component + 1}:{count + 1}"
            modes[name] = mode
            if length >= LONG and (state[frames, p] != REST).all():
                ramp = np.linspace(-1.0, 1.0, length)[:, None, None]
                modes[name], late = np.sqrt(1.0 - DRIFTING) * mode, np.sqrt(DRIFTING) * mode
                late[frames] *= ramp / np.sqrt(np.mean(ramp**2))
                modes[f"{name}:drift"] = late
    few = len(runs) - MAX_HOLDS
    sentence = (
        f"Video compression leaves a constant error while a marker rests ({len(runs)} rests). The "
        f"{MAX_HOLDS} longest are modelled; for the {few} shortest, averages look more precise than they are."
    )
    return modes, independent_sd, (sentence,) if few > 0 else ()


def _runs(held: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and one past the last frame of every hold."""
    edge = np.flatnonzero(np.diff(np.concatenate([[0], held.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edge.reshape(-1, 2) if b - a >= MIN_HOLD]


def frame(shift: Array, rest: NDArray[np.intp], slope: Array, sd: float) -> Named:
    """Frame marks off their nominal places by sd mm: the frame they span is wrong, the same in all steps, and
    with it the places that are measured at rest.

    shift: (2f,s,p,2) mm of places for each of them 1 mm off, from `vision.plane.misplaced`.
    rest: (r,) steps of the reference, whose shift is subtracted like their places.   slope: (s,p,2,2) of
    measured places, as in `of_places`.

    Only six combinations of them are seen while all frame marks are (an affine map and two perspective
    terms); the orthogonal ones that matter are returned, the largest first.
    """
    count = np.maximum(np.isfinite(shift[:, rest]).sum(axis=1), 1)
    at_rest = np.nansum(shift[:, rest], axis=1) / count
    moved = shift - at_rest[:, None] + of_places(slope, at_rest)
    return {f"frame:{k + 1}": field for k, field in enumerate(orthogonal(sd * np.nan_to_num(moved)))}


def orthogonal(fields: Array) -> list[Array]:
    """The few orthogonal fields (s,p,3) mm that together are as large as many (n,s,p,2), largest first."""
    flat = fields.reshape(len(fields), -1)
    power, turn = np.linalg.eigh(flat @ flat.T)
    rows = [k for k in np.argsort(power)[::-1] if power[k] > ROUNDING * max(power[-1], 1e-30)]
    return [with_zero_y(field) for field in (flat.T @ turn[:, rows]).T.reshape(-1, *fields.shape[1:])]


def frame_sd(
    misfit: Array, names: Sequence[str], nominal_sd: float, *,
    fitted: int, noise: float = 0.0, advice: str = "",
) -> tuple[float, tuple[str, ...]]:  # fmt: skip
    """Sd in mm of frame marks about their nominal places: as stated, or from their misfit where that is more.

    misfit: (f,2) or (f,3) mm, what is left of them after the fit of `fitted` numbers (8 of a homography, 6 of
    a rigid motion), which takes up as many of their degrees of freedom; NaN for marks never seen.
    noise: mm2, of one component's mean.   advice: what else may be wrong.
    """
    seen, power = np.isfinite(misfit[:, 0]), np.nan_to_num(misfit**2).sum(axis=1)
    free = int(seen.sum()) * misfit.shape[1] - fitted
    if free < 1 or scipy.special.chdtrc(free, power.sum() / (nominal_sd**2 + noise)) > UNLIKELY:
        return nominal_sd, ()
    estimate = float(np.sqrt(power.sum() / free - noise))
    return estimate, (
        f"The frame markers are {estimate:.3f} mm off their stated places, {names[int(np.argmax(power))]!r} "
        f"most; stated is {nominal_sd:g} mm (frame_sd_mm). {estimate:.3f} mm is used: measure their places "
        f"again{advice}.",
    )


def sync(time: Array, value: Array, sd_s: float) -> Array:
    """The film's clock off the pressure's by sd_s: velocity (s,p,3) mm/s times it.

    time: (s,) s, increasing.   value: (s,p,3) mm; where a mark is lost its velocity is that of the steps
    round the gap.

    >>> value = np.array([[[0.0, 0, 0]], [[0.0, 0, -1.0]], [[0.0, 0, -2.0]]])  # 10 mm/s
    >>> sync(np.array([0.0, 0.1, 0.2]), value, 0.005)[1, 0]  # a clock that is 5 ms off
    array([ 0.  ,  0.  , -0.05])
    """
    result = np.zeros(value.shape)
    for p in range(value.shape[1]):
        seen = np.isfinite(value[:, p, 0])
        if np.count_nonzero(seen) > 1:
            for component in (0, 2):
                filled = np.interp(time, time[seen], value[seen, p, component])
                result[:, p, component] = sd_s * np.gradient(filled, time)
    return result


def stacked(parts: Sequence[Named], seen: NDArray[np.bool_]) -> tuple[Array, tuple[str, ...]]:
    """Modes (k,s,p,3) mm and their names (k,); 0 where a point is not seen (s,p)."""
    fields = {name: field for part in parts for name, field in part.items()}
    result = np.zeros((len(fields), *seen.shape, 3))
    for row, field in zip(result, fields.values(), strict=True):
        np.multiply(np.nan_to_num(field), seen[..., None], out=row)
    return result, tuple(fields)


def _turned(turn: Array) -> tuple[Array, Array]:
    """(R - 1) e_x and (R - 1) e_z, (...,2) each, of turns (...) rad from x towards z."""
    cosine, sine = np.cos(turn) - 1.0, np.sin(turn)
    return np.stack([cosine, sine], axis=-1), np.stack([-sine, cosine], axis=-1)


def _add(modes: dict[str, Array], name: str, value: Array, p: int, xz: Array) -> None:
    """Write (s,2) mm of point p into the mode of that name."""
    modes.setdefault(name, np.zeros(value.shape))[:, p, ::2] = xz


def with_zero_y(xz: Array) -> Array:
    """Fields (...,3) mm of fields (...,2) of x and z; 0 in y."""
    return np.stack([xz[..., 0], np.zeros(xz.shape[:-1]), xz[..., 1]], axis=-1)
