"""The bellows model's load paths over material share -> displacements for any C10 and C01, without a solve.

For a pressure load alone U depends on p / (C10 + C01) and the share C01 / (C10 + C01) only. Load paths at a
few shares (Chebyshev points) are solved once; between them the response is a polynomial in the share, and
along them a cubic Hermite curve in the reduced pressure. Weight (of every direction of gravity its own) asks
for the total as well.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from fe import Case, Path, solve
from fe.case import digest
from fe.element import Integers
from twin import effort
from twin.effects.baselaw import Constants
from twin.gravity import under
from twin.model.arraycache import ArrayCache, code_digest
from twin.targets import Array

TOTAL = 0.3  # MPa, C10 + C01 of the solved paths; any other follows by scaling
REDUCED = (
    0.36  # p / (C10 + C01) to which paths are followed; beyond it no finger of this kind has an equilibrium
)
FIRST = 0.1  # reduced pressure that is tried first on a structure of which nothing is known
SHARES, MORE = 5, 3  # nodes from 0 to 1, and how many more from the least share that is stable
LEVELS = 18
TOTALS = 7
BESIDE = 0.02  # of the share is what a polynomial serves beyond its ends
NOTHING: Mapping[str, Array] = {"gravity": np.zeros(3)}  # from outside


@dataclass(frozen=True)
class LoadPaths:
    """shares (h,); reduced (k,) pressures; u (h, k, p, 3) mm at the points, and slopes; reached (h,) per
    share; lowest: the least share that they serve."""

    shares: Array
    reduced: Array
    u: Array
    reached: Array
    lowest: float = 0.0

    def predict(self, constants: Constants, pressure: Array) -> Array | None:
        """Displacements (s, p, 3) mm at pressures (s,) MPa for constants of the silicone.

        None where the reduced pressure lies beyond what the neighbouring paths reached, where one share
        cannot even carry its weight, or below the least share.
        """
        return self.along(constants.share, pressure / constants.total)

    def along(self, share: float, q: Array) -> Array | None:
        """As `predict`, for a share and reduced pressures (s,)."""
        if share < self.lowest - BESIDE or not self.reached.all():
            return None
        if q.max(initial=0.0) > np.interp(share, self.shares, self.reached):
            return None
        q = np.clip(q, self.reduced[0], self.reduced[-1])
        weights = _blend(self.shares, share)
        return self._spline(q, weights)

    def _spline(self, q: Array, weights: Array) -> Array:
        from scipy.interpolate import CubicSpline

        blended = np.einsum("h,hkpi->kpi", weights, self.u)
        return np.asarray(CubicSpline(self.reduced, blended, axis=0)(q))


def reach(case: Case, wanted: float, *, cache: ArrayCache, key: str) -> float:
    """The reduced pressure p / (C10 + C01) to which a case of a fingerprint `key` can be followed, at most
    `wanted`."""
    own = digest("reach", code_digest(), key, wanted)
    return float(cache("reach of the load paths", {own: partial(_reach, case, wanted)})[own][0])


def _reach(case: Case, wanted: float) -> Array:
    """One number (1,): doubled until there is no equilibrium, as nothing is known of the structure."""
    case, top = case.with_material(**Constants.at(TOTAL, 0.3).named), min(FIRST, wanted)
    while True:
        pressure = np.array([0.0, top * TOTAL])
        with effort.counted(effort.PATHS):
            reached = solve(case, Path(pressure, pressure, pressure), count=8).reached / TOTAL
        if reached < top * (1 - 1e-9) or top >= wanted:
            return np.array([min(1.2 * reached, wanted)])  # other shares may go a little further
        top = min(2 * top, wanted)


@dataclass(frozen=True)
class Sheets:
    """Load paths at several totals C10 + C01 (m,) MPa, increasing: of a structure that is not of one material
    or has weight or forces of its own, whose displacements depend on the total, too."""

    totals: Array
    paths: tuple[LoadPaths, ...]

    def predict(self, constants: Constants, pressure: Array) -> Array | None:
        """As `LoadPaths.predict`, by a polynomial in the logarithm of the total."""
        total = constants.total
        found = [one.along(constants.share, pressure / total) for one in self.paths]
        beside = int(np.clip(np.searchsorted(self.totals, total), 1, len(self.totals) - 1))
        if found[beside - 1] is None or found[beside] is None:
            return None
        known = [k for k, u in enumerate(found) if u is not None]
        weights = _blend(np.log(self.totals[known]), np.log(total))
        return np.asarray(sum(w * u for w, u in zip(weights, (found[k] for k in known), strict=True)), float)


@dataclass(frozen=True)
class Turned:
    """Load paths in every direction of gravity, and which of them (s,) acts on each step of the targets."""

    ways: tuple[LoadPaths | Sheets, ...]
    of_step: Integers

    def predict(
        self, constants: Constants, pressure: Array, *, steps: Integers | None = None
    ) -> Array | None:
        """As `LoadPaths.predict`, the pressures (k,) MPa being those of the steps (k,), by default all."""
        number, out = self.of_step if steps is None else self.of_step[steps], []
        for k in np.unique(number):
            u = self.ways[k].predict(constants, pressure[number == k])
            if u is None:
                return None
            out.append(u)
        return np.concatenate(out)[np.argsort(np.argsort(number, kind="stable"))]


def sheets(
    case: Case,
    points: Array,
    *,
    cache: ArrayCache,
    key: str,
    top: float,
    totals: tuple[float, float],
    lowest: float = 0.0,
    outside: Mapping[str, Array] = NOTHING,
) -> Sheets:
    """The load paths of a case between two totals C10 + C01 in MPa; see `load_paths`."""
    x = 0.5 - 0.5 * np.cos(np.pi * (np.arange(TOTALS) + 0.5) / TOTALS)
    at = totals[0] * (totals[1] / totals[0]) ** x
    every = [
        load_paths(
            case, points, cache=cache, key=key, top=top, total=float(t), lowest=lowest, outside=outside
        )
        for t in at
    ]
    return Sheets(at, tuple(every))


def load_paths(
    case: Case,
    points: Array,
    *,
    cache: ArrayCache,
    key: str,
    top: float = REDUCED,
    total: float = TOTAL,
    lowest: float = 0.0,
    outside: Mapping[str, Array] = NOTHING,
) -> LoadPaths:
    """The load paths of a case at material points (p, 3) mm, followed to a reduced pressure `top` or to their
    end. cache: what gives the arrays; key: the case's fingerprint. total: C10 + C01 in MPa at which they are
    solved; lowest: the least share, 0 or below; outside: gravity and pulls, as `Path.under` has them, by
    default none."""
    count = SHARES if lowest == 0 else SHARES + MORE
    shares = 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
    shares = lowest + (1 - lowest) * shares
    reduced = np.linspace(0, 1, 61) ** 1.3 * top
    what = (code_digest(), key, points, total, reduced, LEVELS, *outside.values())
    keys = [digest("load path", *what, float(share)) for share in shares]
    tasks = {
        k: partial(along_path, case, float(share), total, reduced, points, outside)
        for k, share in zip(keys, shares, strict=True)
    }
    made = cache("load paths", tasks)
    u = np.array([made[k] for k in keys])
    reached = np.array([reduced[np.isfinite(row[:, 0, 0])].max(initial=0.0) for row in u])
    return LoadPaths(shares, reduced, _extended(u), np.minimum(reached, reduced[-1]), lowest)


def along_path(
    case: Case, share: float, total: float, reduced: Array, points: Array, outside: Mapping[str, Array]
) -> Array:
    """Displacements (k, p, 3) mm along one path; NaN beyond its end."""
    pressure, case = reduced * total, case.with_material(**Constants.at(total, share).named)
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
    # SciPy takes the nodes in an order drawn at random: without a seed no two runs end in the same bits
    return np.asarray(BarycentricInterpolator(nodes, np.eye(len(nodes)), rng=0)(x))


def _extended(u: Array) -> Array:
    """Paths continued beyond their end by their last value: never used there, but finite for the
    polynomial."""
    out = u.copy()
    for path in out:
        good = np.flatnonzero(np.isfinite(path[:, 0, 0]))
        last = path[good[-1]] if len(good) else 0.0
        path[len(good) :] = last
    return out
