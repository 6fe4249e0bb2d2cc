"""The bellows model's load paths over material share -> displacements for any C10 and C01, without a solve.

For a pressure load alone U depends on p / (C10 + C01) and the share C01 / (C10 + C01) only. Load paths at a
few shares (Chebyshev points) are solved once; between them the response is a polynomial in the share, and
along them a cubic Hermite curve in the reduced pressure.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from fe import Case, Path, solve
from twin.parallel import Keep
from twin.targets import Array

TOTAL = 0.3  # MPa, C10 + C01 of the solved paths; any other follows by scaling
REDUCED = (
    0.36  # p / (C10 + C01) to which paths are followed; beyond it no finger of this kind has an equilibrium
)
SHARES = 5
LEVELS = 18


@dataclass(frozen=True)
class LoadPaths:
    """shares (h,); reduced (k,) pressures; u (h, k, p, 3) mm at the points, and slopes; reached (h,) per
    share."""

    shares: Array
    reduced: Array
    u: Array
    reached: Array

    def predict(self, total: float, share: float, pressure: Array) -> Array | None:
        """Displacements (s, p, 3) mm at pressures (s,) MPa for C10 + C01 = total MPa and a share.

        None where the reduced pressure lies beyond what the neighbouring paths reached.
        """
        q = pressure / total
        if q.max(initial=0.0) > np.interp(share, self.shares, self.reached):
            return None
        q = np.clip(q, self.reduced[0], self.reduced[-1])
        weights = BarycentricInterpolator(self.shares, np.eye(len(self.shares)))(share)
        return self._spline(q, weights)

    def _spline(self, q: Array, weights: Array) -> Array:
        from scipy.interpolate import CubicSpline

        blended = np.einsum("h,hkpi->kpi", weights, self.u)
        return np.asarray(CubicSpline(self.reduced, blended, axis=0)(q))


def load_paths(case: Case, points: Array, *, keep: Keep, key: str) -> LoadPaths:
    """The load paths of a case at material points (p, 3) mm; `keep(stage, tasks)` makes or has them."""
    shares = 0.5 - 0.5 * np.cos(np.pi * (np.arange(SHARES) + 0.5) / SHARES)
    reduced = np.linspace(0, 1, 61) ** 1.3 * REDUCED
    keys = [f"{key}-path-{share:.6f}" for share in shares]
    tasks = {
        k: partial(_one, case, float(share), reduced, points) for k, share in zip(keys, shares, strict=True)
    }
    made = keep("load paths", tasks)
    u = np.array([made[k] for k in keys])
    reached = np.array([reduced[np.isfinite(row[:, 0, 0])].max() for row in u])
    top = np.where(reached < reduced[-1], reached, reduced[-1])
    return LoadPaths(shares, reduced, _extended(u), top)


def _one(case: Case, share: float, reduced: Array, points: Array) -> Array:
    """Displacements (k, p, 3) mm along one path; NaN beyond its end."""
    material = replace(case.materials["body"], C10=(1 - share) * TOTAL, C01=share * TOTAL, C20=0.0, prony=())
    pressure = reduced * TOTAL
    solution = solve(case.with_material(**vars(material)), Path(pressure, pressure, pressure), count=LEVELS)
    u = np.full((len(reduced), len(points), 3), np.nan)
    inside = pressure <= solution.reached * (1 + 1e-9)
    if inside.sum() > 3:
        u[inside] = solution.at(points)[inside]
    return u


def _extended(u: Array) -> Array:
    """Paths continued beyond their end by their last value: never used there, but finite for the
    polynomial."""
    out = u.copy()
    for path in out:
        good = np.isfinite(path[:, 0, 0])
        path[~good] = path[np.flatnonzero(good)[-1]]
    return out
