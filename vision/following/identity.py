"""Identity of dots: prediction, assignment, and dots that are lost rather than swapped."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from vision.camera import Array, Camera, Image
from vision.following.dots import Dot, find_dots

CLEAR = 2.0  # another match must be so many times worse,
CLEAR_PX = 1.0  # and so many px besides, for an assignment to be believed
GATE = 0.4  # of the distance to the nearest other dot: nearer to its own place than to any other's
TOUCH_PX = 3.0  # rims that come nearer than this while dots vanish leave their identity open
SAME_SIZE = 0.05  # relative, of a half-axis from frame to frame
ADAPTS = 0.1  # share of a frame in the half-axes that are expected: the view changes slowly
NEIGHBOURS = 3  # marks of the body that carry the guess of a hidden dot
PATIENCE = 10  # frames for which a hidden dot without neighbours is looked for where it was


@dataclass(frozen=True, kw_only=True)
class DotMemory:
    """Memory of q dots among p marks before a frame."""

    rows: NDArray[np.intp]  # (q,) their rows among the marks
    body: NDArray[np.bool_]  # (p,) marks that move with the finger
    axes: Array  # (q,2) px, half-axes as they were lately
    dark: NDArray[np.bool_]  # (q,)
    place: Array  # (q,2) ideal px where they were last seen
    step: Array  # (q,2) px, their last step; 0 for a dot at rest or lost
    snapshot: Array  # (q,p,2) ideal px of all marks in the frame in which the dot was last seen
    hidden: NDArray[np.intp]  # (q,) frames since then
    open: NDArray[np.bool_]  # (q,) vanished next to another one: which is which cannot be told any more


def assign(guess: Array, places: Array, gate: Array) -> tuple[NDArray[np.intp], NDArray[np.int8]]:
    """Index (a,) of the place among (b,2) that belongs to each guess (a,2), -1 for none, and doubts (a,).

    The sum of distances within the gates (a,) is least (Hungarian method). In doubt, and given none, is who
    could nearly as well have another place that is free (1), or another guess's in exchange for its own (2).

    >>> guess, seen = np.array([[0.0, 0.0], [50.0, 0.0]]), np.array([[51.0, 0.0], [1.0, 0.0]])
    >>> assign(guess, seen, np.array([10.0, 10.0]))
    (array([1, 0]), array([0, 0], dtype=int8))
    """
    chosen, doubt = np.full(len(guess), -1), np.zeros(len(guess), dtype=np.int8)
    if not len(guess) or not len(places):
        return chosen, doubt
    apart = np.linalg.norm(guess[:, None] - places[None], axis=-1)
    cost = np.where(apart <= gate[:, None], apart, 1e6)
    for i, j in np.transpose(scipy.optimize.linear_sum_assignment(cost)).tolist():
        chosen[i] = j if cost[i, j] < 1e6 else -1
    owned = set(chosen.tolist())
    for i, j in enumerate(chosen.tolist()):
        if j < 0:
            continue
        free = [apart[i, k] for k in range(len(places)) if k not in owned]
        if min(free, default=np.inf) < CLEAR * apart[i, j] + CLEAR_PX:
            doubt[i] = max(doubt[i], 1)
        for n, k in enumerate(chosen.tolist()):
            distance, swapped = (apart[n, k], apart[i, k]) if k >= 0 else (0.0, 0.0)
            if n != i and apart[n, j] + swapped < CLEAR * (apart[i, j] + distance) + CLEAR_PX:
                doubt[i] = doubt[n] = 2
    chosen[doubt > 0] = -1
    return chosen, doubt


def follow_dots(
    image: Image, camera: Camera, memory: DotMemory, places: Array
) -> tuple[DotMemory, list[Dot | None]]:
    """The dots in one picture, and what is known after it.

    places: (p,2) ideal px of the marks that are found by their code, NaN for all others.

    First those seen in the last frame, where the same step once more takes them; then the others, where the
    nearest marks of the finger carry them. Who is in doubt is lost; dots that could be exchanged, or vanish
    touching each other, stay lost.
    """
    now, count = places.copy(), len(memory.rows)
    dots: list[Dot | None] = [None] * count
    visible = np.flatnonzero((memory.hidden == 0) & ~memory.open)
    doubt = _look(image, camera, memory, visible, memory.place + memory.step, now, dots)
    later = np.array([q for q in range(count) if dots[q] is None and not memory.open[q] and not doubt[q]])
    if len(later):
        guess = np.array([_carried(memory, q, now) for q in range(count)])
        doubt |= _look(image, camera, memory, later.astype(np.intp), guess, now, dots)
    return _remember(memory, dots, now, doubt), dots


def _look(
    image: Image,
    camera: Camera,
    memory: DotMemory,
    which: NDArray[np.intp],
    guess: Array,
    now: Array,
    dots: list[Dot | None],
) -> NDArray[np.int8]:
    """Find and assign some dots, written into `now` and `dots`; says which of all are in doubt."""
    taken = [dot.centre for dot in dots if dot is not None]
    doubt = np.zeros(len(memory.rows), dtype=np.int8)
    which = which[np.isfinite(guess[which, 0])]
    gate = _gates(memory, which)
    candidates: list[Dot] = []
    for q, reach in zip(which, gate, strict=True):
        seen = find_dots(
            image,
            camera,
            guess[q],
            memory.axes[q],
            search=float(max(reach, 2.0)),
            dark=bool(memory.dark[q]),
            tolerance=SAME_SIZE,
        )
        for dot in seen:
            occupied = [*taken, *(candidate.centre for candidate in candidates)]
            if all(np.hypot(*(dot.centre - place)) > 0.5 * dot.radius for place in occupied):
                candidates.append(dot)
    chosen, unsure = assign(guess[which], np.array([dot.centre for dot in candidates]).reshape(-1, 2), gate)
    doubt[which] = unsure
    for q, j in zip(which, chosen, strict=True):
        if j >= 0:
            dots[q], now[memory.rows[q]] = candidates[j], candidates[j].centre
    return doubt


def _gates(memory: DotMemory, which: NDArray[np.intp]) -> Array:
    """Largest distance (n,) px of each from its guess: less than half the way to any other dot."""
    gates = np.empty(len(which))
    for i, q in enumerate(which):
        others = np.delete(memory.snapshot[q][memory.rows], q, axis=0)
        others = others[np.isfinite(others[:, 0])]
        nearest = np.linalg.norm(others - memory.place[q], axis=1).min() if len(others) else np.inf
        gates[i] = min(GATE * nearest, 3.0 * memory.axes[q, 1] + np.hypot(*memory.step[q]))
    return gates


def _carried(memory: DotMemory, q: int, now: Array) -> Array:
    """Place (2,) to which the nearest marks of the body take dot q by a similarity; where it was, if fewer
    than two do and it is not gone for long; else NaN."""
    then = memory.snapshot[q]
    near = np.flatnonzero(memory.body & np.isfinite(then[:, 0]) & np.isfinite(now[:, 0]))
    near = near[np.argsort(np.linalg.norm(then[near] - memory.place[q], axis=1))[:NEIGHBOURS]]
    if len(near) < 2:
        return memory.place[q] if memory.hidden[q] < PATIENCE else np.full(2, np.nan)
    a, b = (places[near, 0] + 1j * places[near, 1] for places in (then, now))
    turn = np.vdot(a - a.mean(), b - b.mean()) / np.vdot(a - a.mean(), a - a.mean())
    z = b.mean() + turn * (memory.place[q] @ [1.0, 1j] - a.mean())
    return np.array([z.real, z.imag])


def start(
    seed: Array, *, rows: NDArray[np.intp], body: NDArray[np.bool_], axes: Array, dark: NDArray[np.bool_]
) -> DotMemory:
    """Memory of q dots at rest, from the places (p,2) ideal px of all marks; NaN for those not seen."""
    count = len(rows)
    return DotMemory(
        rows=rows,
        body=body,
        axes=axes,
        dark=dark,
        place=seed[rows],
        step=np.zeros((count, 2)),
        snapshot=np.tile(seed, (count, 1, 1)),
        hidden=np.where(np.isfinite(seed[rows, 0]), 0, PATIENCE),
        open=np.zeros(count, dtype=bool),
    )


def _remember(memory: DotMemory, dots: list[Dot | None], now: Array, doubt: NDArray[np.int8]) -> DotMemory:
    seen = np.array([dot is not None for dot in dots])
    place, step, snapshot = memory.place.copy(), np.zeros_like(memory.step), memory.snapshot.copy()
    axes = memory.axes.copy()
    for q, dot in enumerate(dots):
        if dot is None:
            continue
        place[q] = dot.centre
        axes[q] += ADAPTS * (dot.axes - axes[q])
        if memory.hidden[q] == 0:
            step[q] = place[q] - memory.place[q]
        snapshot[q] = now
    vanished = ~seen & (memory.hidden == 0)
    guess = memory.place + memory.step
    apart = np.linalg.norm(guess[:, None] - guess[None], axis=-1)
    near = apart < memory.axes[:, None, 1] + memory.axes[None, :, 1] + TOUCH_PX
    np.fill_diagonal(near, False)
    touching = vanished & (near & vanished).any(axis=1)
    hidden = np.where(seen, 0, memory.hidden + 1)
    return replace(
        memory,
        axes=axes,
        place=place,
        step=step,
        snapshot=snapshot,
        hidden=hidden,
        open=memory.open | touching | (doubt == 2),
    )
