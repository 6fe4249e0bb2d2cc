"""The model's load paths over the shape of a law -> displacements for any of its constants, without a solve.

For a pressure load alone U depends on p / scale and the shape only, such as C01 / (C10 + C01). Load paths at
a few values of each (Chebyshev points) are solved once; between them the response is a polynomial in the
shape, and along them a cubic Hermite curve in the reduced pressure. Weight (of every direction of gravity
its own) asks for the scale as well. A law whose shape has more than MOST numbers has no load paths.
"""

from dataclasses import dataclass
from functools import partial, reduce
from itertools import product
from typing import Any

import numpy as np
import scipy

from fe import Case, Path, solve
from fe.case import digest
from fe.element import Integers
from fe.path import Outside
from twin import effort
from twin.gravity import under
from twin.laws.law import Constants, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.model.arraycache import ArrayCache, code_digest
from twin.model.firstorder import MarkerPoints
from twin.targets import Array

MOST = 2  # numbers of a shape
SCALE = 0.3  # MPa, of the solved paths; any other follows
REDUCED = 0.36  # p / scale to which paths are followed; beyond it no finger of this kind has an equilibrium
FIRST = 0.1  # reduced pressure that is tried first on a structure of which nothing is known
LEVELS = 18
SCALES = 7
BESIDE = 0.02  # of a shape's range is what a polynomial serves beyond its ends
NOTHING: Outside = {"gravity": np.zeros(3)}  # from outside


@dataclass(frozen=True)
class LoadPaths:
    """nodes: the values (h,) of each number of the shape, and ends, between which they serve; reduced (k,)
    pressures; u (n, k, p, 3) mm at the points, of every combination of them; reached (n,) on each."""

    nodes: tuple[Array, ...]
    ends: tuple[tuple[float, float], ...]
    reduced: Array
    u: Array
    reached: Array

    def predict(self, constants: Constants, pressure: Array) -> Array | None:
        """Displacements (s, p, 3) mm at pressures (s,) MPa for constants of the silicone.

        None where the reduced pressure lies beyond what the neighbouring paths reached, where one of them
        cannot even carry its weight, or beyond the ends.
        """
        return self.along(constants.shape, pressure / constants.scale)

    def along(self, shape: tuple[float, ...], q: Array) -> Array | None:
        """As `predict`, for a shape and reduced pressures (s,)."""
        if not self.reached.all() or any(
            not low - BESIDE * (high - low) <= x <= high + BESIDE * (high - low)
            for x, (low, high) in zip(shape, self.ends, strict=True)
        ):
            return None
        if q.max(initial=0.0) > self._reached(shape):
            return None
        q = np.clip(q, self.reduced[0], self.reduced[-1])
        each = (_blend(nodes, x) for nodes, x in zip(self.nodes, shape, strict=True))
        return self._spline(q, reduce(np.multiply.outer, each, np.ones(())).ravel())

    def limit(self, constants: Constants) -> float:
        """The pressure in MPa up to which the model has an equilibrium with these constants."""
        return self._reached(constants.shape) * constants.scale if self.reached.all() else 0.0

    def _reached(self, shape: tuple[float, ...]) -> float:
        """The reduced pressure that the paths around a shape reached, linear between them."""
        out = self.reached.reshape([len(nodes) for nodes in self.nodes])
        for nodes, x in zip(self.nodes, shape, strict=True):
            rows = out.reshape(len(nodes), -1).T
            out = np.reshape([np.interp(x, nodes, row) for row in rows], out.shape[1:])
        return float(out)

    def _spline(self, q: Array, weights: Array) -> Array:
        from scipy.interpolate import CubicSpline

        blended = np.einsum("h,hkpi->kpi", weights, self.u)
        return np.asarray(CubicSpline(self.reduced, blended, axis=0)(q))


def reach(case: Case, law: RubberLaw, most: float, *, cache: ArrayCache, key: str) -> float:
    """The reduced pressure p / scale to which a case of a fingerprint `key` can be followed with a law, at
    most `wanted`."""
    task_key = digest("reach", code_digest(), key, law.name, most)
    return float(cache("reach of the load paths", {task_key: partial(_reach, case, law, most)})[task_key][0])


def _reach(case: Case, law: RubberLaw, most: float) -> Array:
    """One number (1,): doubled until there is no equilibrium, as nothing is known of the structure."""
    case, top = case.with_material(**law.usual(SCALE).terms), min(FIRST, most)
    while True:
        pressure = np.array([0.0, top * SCALE])
        with effort.counted(effort.PATHS):
            reached = solve(case, Path(pressure, pressure, pressure), count=8).reached / SCALE
        if reached < top * (1 - 1e-9) or top >= most:
            return np.array([min(1.2 * reached, most)])  # other shapes may go a little further
        top = min(2 * top, most)


@dataclass(frozen=True)
class Sheets:
    """Load paths at several scales (m,) MPa, increasing: of a structure that is not of one material or has
    weight or forces of its own, whose displacements depend on the scale, too."""

    scales: Array
    paths: tuple[LoadPaths, ...]

    def predict(self, constants: Constants, pressure: Array) -> Array | None:
        """As `LoadPaths.predict`, by a polynomial in the logarithm of the scale."""
        scale, shape = constants.scale, constants.shape
        fields = [paths.along(shape, pressure / scale) for paths in self.paths]
        beside = int(np.clip(np.searchsorted(self.scales, scale), 1, len(self.scales) - 1))
        if fields[beside - 1] is None or fields[beside] is None:
            return None
        reached = [k for k, u in enumerate(fields) if u is not None]
        weights = _blend(np.log(self.scales[reached]), np.log(scale))
        rows = (fields[k] for k in reached)
        return np.asarray(sum(w * u for w, u in zip(weights, rows, strict=True)), float)


    def limit(self, constants: Constants) -> float:
        """As `LoadPaths.limit`, of the two scales beside."""
        beside = int(np.clip(np.searchsorted(self.scales, constants.scale), 1, len(self.scales) - 1))
        return min(paths.limit(constants) for paths in self.paths[beside - 1 : beside + 1])


@dataclass(frozen=True)
class Turned:
    """Load paths in every direction of gravity, which of them (s,) acts on each step of the targets, and
    what their points tell of the markers; None: they are the markers."""

    ways: tuple[LoadPaths | Sheets, ...]
    of_step: Integers
    followed: MarkerPoints | None = None

    def predict(
        self, constants: Constants, pressure: Array, *, steps: Integers | None = None
    ) -> Array | None:
        """As `LoadPaths.predict`, of the markers, at pressures (k,) MPa of the steps (k,), by default all."""
        number, out = self.of_step if steps is None else self.of_step[steps], []
        for k in np.unique(number):
            u = self.ways[k].predict(constants, pressure[number == k])
            if u is None:
                return None
            out.append(u)
        u = np.concatenate(out)[np.argsort(np.argsort(number, kind="stable"))]
        return u if self.followed is None else self.followed.seen(u)

    def limit(self, constants: Constants) -> float:
        """As `LoadPaths.limit`, in the direction of gravity in which it is least."""
        return min(way.limit(constants) for way in self.ways)


def sheets(
    case: Case,
    points: Array,
    law: RubberLaw = MOONEY_RIVLIN,
    *,
    cache: ArrayCache,
    key: str,
    top: float,
    scales: tuple[float, float],
    wide: bool = False,
    held: tuple[float, ...] | None = None,
    outside: Outside = NOTHING,
) -> Sheets:
    """The load paths of a case between two scales in MPa; see `load_paths`."""
    x = 0.5 - 0.5 * np.cos(np.pi * (np.arange(SCALES) + 0.5) / SCALES)
    at_scales = scales[0] * (scales[1] / scales[0]) ** x
    how: dict[str, Any] = {"cache": cache, "key": key, "top": top, "wide": wide, "held": held}
    every = [load_paths(case, points, law, scale=float(s), outside=outside, **how) for s in at_scales]
    return Sheets(at_scales, tuple(every))


def load_paths(
    case: Case,
    points: Array,
    law: RubberLaw = MOONEY_RIVLIN,
    *,
    cache: ArrayCache,
    key: str,
    top: float = REDUCED,
    scale: float = SCALE,
    wide: bool = False,
    held: tuple[float, ...] | None = None,
    outside: Outside = NOTHING,
) -> LoadPaths:
    """The load paths of a case at material points (p, 3) mm, followed to a reduced pressure `top` or to their
    end. law: of the silicone. cache: what gives the arrays; key: the case's fingerprint. scale: in MPa
    at which they are solved; wide: over all shapes that a fit may end at; held: at this shape alone, whatever
    shape is asked for; outside: gravity and pulls, as `Path.under` has them, by default none. ValueError for
    a law whose shape has more than MOST numbers, unless it is held."""
    if held is None and len(law.shapes) > MOST:
        raise ValueError(
            f"law {law.name!r}: its shape has {len(law.shapes)} numbers; load paths serve {MOST} at most"
        )
    nodes = tuple(shape.nodes(wide=wide) for shape in law.shapes)
    ends = tuple(shape.ends(wide=wide) for shape in law.shapes)
    if held is not None:
        nodes, ends = tuple(np.array([x]) for x in held), ((-np.inf, np.inf),) * len(held)
    reduced = np.linspace(0, 1, 61) ** 1.3 * top
    what = (code_digest(), key, law.name, points, scale, reduced, LEVELS, *outside.values())
    every = [law.at(scale, tuple(map(float, shape))) for shape in product(*nodes)]
    keys = [digest("load path", *what, c) for c in every]
    tasks = {
        k: partial(along_path, case, c, scale, reduced, points, outside)
        for k, c in zip(keys, every, strict=True)
    }
    arrays = cache("load paths", tasks)
    u = np.array([arrays[k] for k in keys])
    reached = np.array([reduced[np.isfinite(row[:, 0, 0])].max(initial=0.0) for row in u])
    return LoadPaths(nodes, ends, reduced, _extended(u), np.minimum(reached, reduced[-1]))


def along_path(
    case: Case, constants: Constants, scale: float, reduced: Array, points: Array, outside: Outside
) -> Array:
    """Displacements (k, p, 3) mm along the path of constants of a scale, at reduced pressures (k,); NaN
    beyond its end."""
    pressure, case = reduced * scale, case.with_material(**constants.terms)
    path = Path(pressure, pressure, pressure, **outside)
    with effort.counted(effort.PATHS):
        solution = solve(under(case, path), path, count=LEVELS)
    u = np.full((len(reduced), len(points), 3), np.nan)
    inside = pressure <= solution.reached * (1 + 1e-9)
    if inside.sum() > 3:
        u[inside] = solution.at(points)[inside]
    return u


def _blend(nodes: Array, x: float) -> Array:
    """Weights (n,) of values at the nodes (n,) in their polynomial's value at x."""
    if len(nodes) == 1:
        return np.ones(1)
    # SciPy takes the nodes in an order drawn at random: without a seed no two runs end in the same bits
    return np.asarray(scipy.interpolate.BarycentricInterpolator(nodes, np.eye(len(nodes)), rng=0)(x))


def _extended(u: Array) -> Array:
    """Paths continued beyond their end by their last value: never used there, but finite for the
    polynomial."""
    out = u.copy()
    for path in out:
        good = np.flatnonzero(np.isfinite(path[:, 0, 0]))
        last = path[good[-1]] if len(good) else 0.0
        path[len(good) :] = last
    return out
