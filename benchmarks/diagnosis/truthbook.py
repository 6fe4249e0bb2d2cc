"""Snapshots of hidden truths -> true displacements of any kind, size and pair, between the sizes solved.

    python benchmarks/diagnosis/truthbook.py      # the error of interpolation, by leaving one size out

A truth is the bare finger on its finest mesh and, added to it, what each hidden kind changes on another
mesh: a polynomial in its size through all sizes solved. What changes the pressure or the picture alone is
exact.
"""

import os
import sys
from collections.abc import Sequence
from functools import lru_cache

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
import benchmarks  # noqa: F401
from benchmarks.diagnosis.snapshots import DATA, LATER, POINTS, SMOOTH

import numpy as np
from scipy.interpolate import CubicSpline

from fe import Path
from twin.effects.protocol import Test
from twin.targets import Array
from twin.virtual.draws import fixed_markers
from twin.virtual.hidden import KINDS, Kind
from twin.virtual.protocols import PROTOCOLS, TOP, WAYS, Protocol
from twin.virtual.truthsolves import LEVELS

Hidden = tuple[tuple[Kind, float], ...]
EVERY = range(len(POINTS))
SD_MM = 0.015  # of the noise that the errors are told against


@lru_cache(maxsize=1)
def book() -> dict[str, Array]:
    """The arrays of the snapshots, of later kinds too."""
    found: dict[str, Array] = {}
    for file in (DATA, LATER) if LATER.exists() else (DATA,):
        with np.load(file) as data:
            found |= {name: data[name].astype(float) for name in data.files}
    return found


def solved_sizes(kind: Kind) -> tuple[float, ...]:
    """The sizes of a kind that have a solve, but 0."""
    start = f"{kind.key}@"
    return tuple(sorted(float(n.removeprefix(start)) for n in book() if n.startswith(start)))


def changes(kind: Kind, *, without: float | None = None) -> Array:
    """Coefficients (m, ...) of size, size^2 .. of what a kind changes, through its sizes but `without`, and
    with its slope at 0 where that was solved."""
    sizes = np.array([s for s in solved_sizes(kind) if s != without])
    null = book()["course" if kind.part == "history" else "bare"]
    values = [book()[f"{kind.key}@{s:g}"] - null for s in sizes]
    count, top = len(sizes), np.abs(sizes).max()
    rows = [(sizes / top) ** (k + 1) for k in range(count + 1)]
    number = next((k for k, one in enumerate(SMOOTH) if one.name == kind.key), None)
    if number is None or "slopes" not in book():
        powers = np.array(rows[:count]).T
    else:
        powers = np.vstack([np.array(rows).T, np.eye(count + 1)[0]])
        values.append(book()["slopes"][number] * top)
    found = np.tensordot(np.linalg.inv(powers), np.array(values), 1)
    return found / np.array([top ** (k + 1) for k in range(len(found))]).reshape(-1, *(1,) * (found.ndim - 1))


@lru_cache(maxsize=64)
def _changes(kind: Kind) -> Array:
    return changes(kind)


def on_curves(curves: Array, pressure: Array, way: Array) -> Array:
    """Displacements (s, p, 3) mm on curves (w, k, p, 3) over LEVELS at pressures (s,) MPa."""
    out = np.empty((len(pressure), *curves.shape[2:]))
    for k in range(len(curves)):
        out[way == k] = CubicSpline(LEVELS, curves[k])(pressure[way == k])
    return out


def displaced(protocol: Protocol, hidden: Hidden, rows: Sequence[int]) -> Array:
    """True displacements (s, p, 3) mm of the places `rows`, the unloaded finger being 0, and of the fixed
    markers where the camera sees them move."""
    course, at = protocol.course, list(rows)
    fixed = [p.position for p in fixed_markers(protocol.fixed)]
    points = np.array([*POINTS[at], *fixed])
    moving = np.arange(len(points)) < len(at)
    test = Test(None, course, points, moving)  # type: ignore[arg-type]
    for kind, size in hidden:
        test = kind.before(test, size) if kind.part == "path" else test
    path = test.path
    factor = path.stiffness_at(path.output)
    p = path.at_output() / factor
    weight = np.abs(course.gravity).max() > 0
    up = book()["fine"][:2].mean(axis=0)[:, at]
    way = protocol.block
    weightless = on_curves(np.repeat(up[None], len(WAYS), 0), p, way)
    u = weightless
    if weight:
        u = u + (on_curves(book()["fine"][:, :, at], p, way) - weightless) / factor[:, None, None]
    for kind, size in hidden:
        if kind.part in ("static", "history"):
            u = u + _added(kind, size, course, p, way, at)
    pictures = [(k, s) for k, s in hidden if k.part == "picture"]
    if pictures:
        u = np.concatenate([u, np.zeros((len(u), len(fixed), 3))], axis=1)
    for kind, size in pictures:
        u = kind.after(u, test, size)
    return u


def _added(kind: Kind, size: float, course: Path, p: Array, way: Array, at: list[int]) -> Array:
    """What a kind adds (s, p, 3) mm at pressures p (s,) MPa; weight does not count beside it."""
    factor = np.ones(len(p)) if kind.along is None else kind.along(course.at_output() / TOP)
    out: Array = np.zeros(())
    for k, c in enumerate(_changes(kind)):
        if kind.part == "history":
            rows = c[:, at][np.isin(PROTOCOLS["P5"].steps, course.output)]
        else:
            rows = on_curves(c[:, :, at], p, way)
        out = out + (size ** (k + 1)) * (factor ** (k + 1))[:, None, None] * rows
    return out


def slope(protocol: Protocol) -> Array:
    """dU/dp (s, p, 3) mm per MPa of the bare finger."""
    fine, h = book()["fine"], 1e-5
    p, way = protocol.course.at_output(), protocol.block
    return (on_curves(fine, p + h, way) - on_curves(fine, p - h, way)) / (2 * h)


def left_out(kind: Kind) -> float:
    """The largest root mean square (mm) that the polynomial misses a size by where that is left out."""
    worst, null = 0.0, book()["course" if kind.part == "history" else "bare"]
    sizes = solved_sizes(kind)
    for s in sizes:
        if s in (min(sizes), max(sizes)):
            continue
        c = changes(kind, without=s)
        told = sum(s ** (k + 1) * x for k, x in enumerate(c))
        worst = max(worst, float(np.sqrt(((told - (book()[f"{kind.key}@{s:g}"] - null)) ** 2).mean())))
    return worst


def table(kinds: Sequence[Kind]) -> dict[str, float]:
    """The error of interpolation of each kind, mm."""
    return {
        k.name: left_out(k) for k in kinds if k.part in ("static", "history") and len(solved_sizes(k)) > 2
    }


def main() -> int:
    found = table(list(KINDS.values()))
    for name, error in found.items():
        size = np.sqrt((displaced(PROTOCOLS["P5"], ((KINDS[name], KINDS[name].sizes[-1]),), EVERY)
                        - displaced(PROTOCOLS["P5"], (), EVERY)) ** 2).mean()  # fmt: skip
        print(
            f"{name:24s} {1e3 * error:8.3f} um, {error / SD_MM:6.3f} sd; the largest size moves {size:.3f} mm"
        )
    return 0 if max(found.values()) < 0.1 * SD_MM else 1


if __name__ == "__main__":
    sys.exit(main())
