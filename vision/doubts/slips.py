"""Marks of the finger that came off their place: named, never corrected."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vision.camera import Array
from vision.marks import Mark

MIN_MARKS = 3  # of the finger: of two that part, neither is the one that slipped
MIN_FRAMES = 24
SIDE = 4  # frames at least on either side of a jump
SHARP = 2  # frames on either side of it that must show it
DEGREE = 5  # of a place as a polynomial of the finger's state
SEEN = 0.8  # share of the frames in which a mark must be seen to be compared
TOLD = 0.3  # of a frame's weight: below it a jump is as good a part of the polynomial
ALARM_SD = 8.0  # a jump over the sd of one place
LEAST_MM = 0.05  # below it the codec's frozen errors jump as well
HALF = 0.5  # of the jump must be there at once, and at the film's end


class Jump(NamedTuple):
    """A mark's jump against what the others say."""

    frame: int  # first one after it
    shift: Array  # (2,) mm, as the mark lay at rest
    score: float  # over the sd of one place


def find_slips(time: Array, value: Array, turns: Array, sd: Array, marks: Sequence[Mark]) -> tuple[str, ...]:
    """One sentence for each finger mark that jumps against the others and does not come back.

    time: (s,) s.   value: (s,p,3) mm, y unused.   turns: (s,p) rad of the finger at each mark.
    sd: (p,3) mm, stated for one place, static noise and codec.   marks: (p,).

    Without a slip a mark's place is a smooth function of where the other marks of the finger are: a
    polynomial of degree 5, 2 and 1 in their first three principal components. A slip adds a shift that from
    one frame on turns with the finger to the end. It is said when it exceeds 0.05 mm and 8 sd of one place
    (the stated sd and what the polynomial leaves, summed in squares). The frames next to it, and the last
    ones, must show half of it. At least three marks must be seen in 80 % of the frames. A mark that slips
    spoils what its neighbours are compared with: the one without which the others agree best is named.
    """
    seen = np.isfinite(value[..., 0]).mean(axis=0) >= SEEN
    steady = [p for p, mark in enumerate(marks) if mark.role == "finger" and seen[p]]
    xz, sentences = value[..., [0, 2]], []
    while len(steady) >= MIN_MARKS:
        jumps = _jumps(xz, turns, sd, steady)
        if not jumps:
            break
        remaining = {p: _jumps(xz, turns, sd, [q for q in steady if q != p]) for p in jumps}
        slipped = min(jumps, key=lambda p: (sum(j.score for j in remaining[p].values()), -jumps[p].score))
        sentences.append(_sentence(marks[slipped].name, jumps[slipped], time))
        steady = [q for q in steady if q != slipped]
    return tuple(sentences)


def _sentence(name: str, jump: Jump, time: Array) -> str:
    return (
        f"Marker {name!r} jumps by {np.hypot(*jump.shift):.2f} mm against the finger's other markers at "
        f"{time[jump.frame]:.3f} s (x {jump.shift[0]:+.2f}, z {jump.shift[1]:+.2f} mm as it lay at rest) and "
        "does not come back, like one that peels off. Nothing is corrected: glue it again and film anew, or "
        "remove its point."
    )


def _jumps(xz: Array, turns: Array, sd: Array, marks: Sequence[int]) -> dict[int, Jump]:
    """The jumps of these marks, each against the others."""
    jumps = {}
    for p in marks:
        others = [q for q in marks if q != p]
        frames = np.flatnonzero(np.isfinite(xz[:, [p, *others], 0]).all(axis=1))
        if not others or len(frames) < MIN_FRAMES:
            continue
        noise = float(np.sqrt(np.mean(sd[p, [0, 2]] ** 2)))
        basis = _basis(xz[frames][:, others].reshape(len(frames), -1), noise)
        jump = _jump(xz[frames, p], turns[frames, p], basis, noise)
        if jump is not None:
            jumps[p] = jump._replace(frame=int(frames[jump.frame]))
    return jumps


def _basis(places: Array, noise: float) -> Array:
    """Orthonormal functions (s,k) of the state that the others' places (s,2q) mm tell."""
    centred = places - places.mean(axis=0)
    _, size, axes = np.linalg.svd(centred, full_matrices=False)
    score = centred @ axes[:3].T
    unit = score / np.maximum(np.abs(score).max(axis=0), 1e-12)
    loud = size[:3] > 3.0 * noise * np.sqrt(len(places))  # motion, and not noise
    chebyshev = np.polynomial.chebyshev.chebvander(unit[:, 0], DEGREE if loud[0] else 0)
    more = unit[:, 1:] * loud[1:]
    columns = np.hstack([chebyshev, more, more[:, :1] ** 2, more[:, :1] * unit[:, :1]])
    vectors, power, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(vectors[:, power > 1e-8 * power[0]])


def _jump(place: Array, turn: Array, basis: Array, noise: float) -> Jump | None:
    """The jump that explains most of places (s,2) mm beyond the basis (s,k), None if it is none."""
    cosine, sine = np.cos(turn), np.sin(turn)
    shifted = np.stack([np.stack([cosine, sine], -1), np.stack([-sine, cosine], -1)], -1)  # (s,2,2), R
    rest = place - basis @ (basis.T @ place)
    # Sums over all frames from each on: a step there, and its part in the basis, for all steps at once.
    product = _from_here(np.einsum("tij,ti->tj", shifted, rest))
    inside = _from_here(basis[:, :, None, None] * shifted[:, None])
    count = np.arange(len(place), 0, -1)[:, None, None] * np.eye(2)
    normal = count - np.einsum("tkij,tkil->tjl", inside, inside)
    tried = slice(SIDE, len(place) - SIDE + 1)
    shift = np.linalg.solve(normal[tried] + 1e-9 * np.eye(2), product[tried, :, None])[..., 0]
    distinct = np.linalg.eigvalsh(normal[tried])[:, 0] > TOLD
    best = int(np.argmax(np.where(distinct, np.sum(shift * product[tried], axis=1), 0.0)))
    frame, shift = best + SIDE, shift[best]
    field = np.where(np.arange(len(place))[:, None] >= frame, shifted @ shift, 0.0)
    explained = field - basis @ (basis.T @ field)
    residual = rest - explained
    score = float(np.hypot(*shift) / np.hypot(noise, np.sqrt(np.mean(residual**2))))
    with_it = np.einsum("tij,ti->tj", shifted, residual + field)  # turned back
    at_once = with_it[frame : frame + SHARP].mean(axis=0) - with_it[frame - SHARP : frame].mean(axis=0)
    at_end, large = with_it[-SIDE:].mean(axis=0), np.hypot(*shift) > LEAST_MM
    lasting = min(at_once @ shift, at_end @ shift) > HALF * (shift @ shift)
    return Jump(frame, shift, score) if score > ALARM_SD and large and lasting else None


def _from_here(terms: Array) -> Array:
    """Sums over all frames from each one to the last."""
    return np.asarray(np.cumsum(terms[::-1], axis=0)[::-1])
