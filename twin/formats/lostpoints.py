"""Places that are none: how programs write that a point was lost, and points that jump or are exchanged."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.formats.recorded import Recorded
from twin.targets import Array

FAR = 5.0  # times the usual step of a point, from a lost place to the ones beside it
HELD = 4  # rows with exactly one place, amid motion, that are asked about
CROSSED = 0.25  # of the steps of two points, what is left of them once they are exchanged
MOST_POINTS = 60  # that are looked at in pairs: fields of thousands have no names to exchange
ALONE = 3.0  # times the largest jump of the other points


def without_lost(recorded: Recorded) -> Recorded:
    """The points without places that stand for a lost one: 0, -1, -9999 and the like in all components, or
    exactly the first place again, far from the rows beside it. What may be so is said."""
    position, remarks = recorded.position.copy(), []
    steps = _usual_steps(position)
    rest = np.all((position == 0.0) | np.isnan(position), axis=(1, 2))  # displacements that are all 0
    for kind, odd in _odd(position).items():
        for p in np.flatnonzero(odd.any(axis=0)).tolist():
            whole = rest if rest[0] and kind == "0" else np.zeros(len(rest), bool)
            rows = [
                run for run in _runs(odd[:, p] & ~whole)
                if _is_far(recorded.position[:, p], run, ~odd[:, p], steps[p])
            ]  # fmt: skip
            if not rows:
                continue
            count, where = sum(j - i for i, j in rows), ", ".join(f"{i} to {j - 1}" for i, j in rows[:3])
            name = recorded.names[p]
            what = f"{name} is exactly {kind} in rows {where} (from 0), far from the rows beside them"
            if len(recorded.names) == 1 and kind == "at its first place":
                remarks.append(f"{what}: was it lost there? Then leave the cells empty.")
                continue
            for i, j in rows:
                position[i:j, p] = np.nan
            remarks.append(f"{what}, as a lost point is written: {count} positions count as not seen.")
    remarks += _held(recorded.names, position, steps)
    return replace(recorded, position=position, remarks=(*recorded.remarks, *remarks))


def _odd(position: Array) -> dict[str, NDArray[np.bool_]]:
    """Rows (s,p) in which a point may be lost, by how it is written."""
    seen = np.isfinite(position)
    low, high = (np.where(seen, position, fill) for fill in (np.inf, -np.inf))
    alike = np.where(seen.any(axis=2) & (low.min(axis=2) == high.max(axis=2)), low.min(axis=2), np.nan)
    size = np.abs(np.where(seen, position, 0.0))
    nines = np.isin(size, (999.0, 9999.0, 99999.0, 999999.0, 9999999.0, 999.9, 9999.9)) | (size >= 1e10)
    at = np.argmax(seen.any(axis=2), axis=0)
    first = position[at, np.arange(position.shape[1])]
    home = seen.any(axis=2) & np.all((position == first) | ~seen, axis=2)
    home[: 1 + int(np.argmin(home.all(axis=1)))] = False  # at rest before anything moves
    whole = home.all(axis=1)
    return {
        "0": alike == 0.0, "-1": alike == -1.0, "9999": nines.any(axis=2),
        "at its first place": home & (alike != 0.0) & ~(whole & (len(first) > 1))[:, None],
    }  # fmt: skip


def _runs(mask: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """First rows and rows past the last, of the stretches (s,) that are True."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _usual_steps(position: Array) -> Array:
    """Large but usual steps (p,) from row to row, of rows that are not odd."""
    odd = np.any([*_odd(position).values()], axis=0)
    clean = np.where(odd[..., None], np.nan, position)
    step = _distance(clean[1:], clean[:-1])
    moving = np.where(step > 0.0, step, np.nan)
    some = np.isfinite(moving).any(axis=0)
    usual = np.zeros(position.shape[1])
    if some.any():
        usual[some] = np.nanpercentile(moving[:, some], 95, axis=0)
    return usual


def _distance(a: Array, b: Array) -> Array:
    """Distances of places (...,3) over the components that both have; NaN for none."""
    square = (a - b) ** 2
    return np.where(np.isfinite(square).any(axis=-1), np.sqrt(np.nansum(square, axis=-1)), np.nan)


def _is_far(place: Array, run: tuple[int, int], usable: NDArray[np.bool_], step: float) -> bool:
    """True where a run of rows lies far from the usable rows (s,) beside it."""
    seen = np.flatnonzero(usable & np.isfinite(place).any(axis=1))
    if len(seen) < 3:
        return False
    beside = [*seen[seen < run[0]][-1:], *seen[seen >= run[1]][:1]]
    jumps = _distance(place[beside], place[run[0]])
    return bool(np.all(jumps > FAR * step))


def _held(names: Sequence[str], position: Array, steps: Array) -> Iterator[str]:
    """Sentences on points whose place is exactly repeated amid motion: the last one before they were lost?"""
    for p, name in enumerate(names):
        place = position[:, p]
        same = np.r_[False, np.all((place[1:] == place[:-1]) | np.isnan(place[1:]), axis=1)]
        same &= np.isfinite(place).any(axis=1)
        for i, j in _runs(same):
            after = _distance(place[j], place[i]) if j < len(place) else np.nan
            if j - i >= HELD and i > 1 and steps[p] > 0.0 and after > FAR * steps[p]:
                yield (
                    f"{name} has exactly one place in rows {i - 1} to {j - 1} (from 0) and then jumps by "
                    f"{after:.3g}: is that the last one before it was lost? Then leave the cells empty."
                )
                break


def identity_faults(names: Sequence[str], place: Array, time: Array) -> tuple[str, list[str]]:
    """The sentence on two points (s,p,3) mm that exchange their places, "" without; and those on points that
    jump alone. time: (s,) s."""
    if not 1 < len(names) <= MOST_POINTS or len(place) < 4:
        return "", []
    step = _distance(place[1:], place[:-1])  # (s-1,p)
    usual = np.nan_to_num(np.nanpercentile(np.where(np.isfinite(step), step, 0.0), 90, axis=0))
    for a in range(len(names)):
        for b in range(a + 1, len(names)):
            straight = step[:, a] + step[:, b]
            crossed = _distance(place[1:, a], place[:-1, b]) + _distance(place[1:, b], place[:-1, a])
            far = straight > FAR * (usual[a] + usual[b])
            rows = np.flatnonzero((crossed < CROSSED * straight) & far) + 1
            if len(rows):
                when = ", ".join(f"{time[row]:.4g}" for row in rows[:4])
                return (
                    f"points {names[a]} and {names[b]} exchange places at {when} s: wanted each name on "
                    "one mark; exchange them there in the file, or leave the cells empty"
                ), []
    jumps = []
    for p, name in enumerate(names):
        others = np.nanmax(np.nan_to_num(np.delete(step, p, axis=1)), axis=1)
        far = step[:, p] > max(FAR * float(usual[p]), 1.0)
        alone = np.flatnonzero(far & (step[:, p] > ALONE * others))
        if len(alone):
            k = int(alone[0])
            jumps.append(
                f"{name} jumps by {step[k, p]:.3g} mm at {time[k + 1]:.4g} s, where the other points move by "
                f"{others[k]:.2g} mm at most: was another mark taken for it? Then leave the cells empty."
            )
    return "", jumps
