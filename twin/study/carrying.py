"""The load paths of a model and targets -> up to which pressure constants that fit the rest carry the load.

Where a model lacks what holds its walls, constants that fit low pressures reach a limit point below the top
one, and constants that carry the top one fit nothing. Then the fit is made of what the model can carry, and
that it carries no more is a finding.
"""

from dataclasses import dataclass

import numpy as np

from calibrate import Fit
from twin.calibrated.problem import Carried
from twin.study.loadpathfit import OnPaths
from twin.targets import Array, Targets

LEVELS = 9  # of the top pressure, from all of it to a fifth, that are tried
NEAR, CLOSE = 1.1, 1.5  # times the pressure of a fit is its limit point, where that holds it, or may hold it
BETTER = 0.5  # of the misfit at lower pressures is what a fit to these alone leaves, at most
NOISE = 3.0  # times the noise: a misfit below is none
SEARCHED = 16  # scales from which a fit begins


@dataclass(frozen=True)
class FitUpTo:
    """A fit of the constants to the steps up to a pressure `top` in MPa; limit: what the model carries there,
    MPa; None where no constants carry it."""

    on: OnPaths
    top: float
    fit: Fit | None
    limit: float

    def within(self, times: float) -> bool:
        """True where the limit point is less than so many times the pressure, or there is no fit."""
        return self.fit is None or self.limit < times * self.top

    @property
    def misfit(self) -> float:
        """What the fit leaves of these steps, mm."""
        return np.inf if self.fit is None else self.rms(self.fit.theta)

    def rms(self, theta: Array) -> float:
        """What constants (d,) leave of the steps up to the level, mm."""
        t = self.on.bench.targets
        u = self.on.predicted(theta)
        return np.inf if u is None else t.rms(t.value - u)


def carried(on: OnPaths) -> Carried | None:
    """Up to which pressure targets are to be fitted; None where the model carries all of them, as well as it
    fits them. Blocks that are held out never hold the fit of the others."""
    if on.bench.jobs is not None:
        return None
    t = on.bench.targets
    highest, used = float(t.pressure.max()), float(t.pressure[t.used.any(axis=(1, 2))].max())
    whole = _level(on, highest)
    noise = _noise(t)
    if highest <= 0.0 or not whole.within(CLOSE) or whole.misfit < NOISE * noise:
        return None
    lowest = float(t.pressure[t.used.any(axis=(1, 2)) & (t.pressure > 0.0)].min())
    for top in np.unique(np.append(np.maximum(used * np.linspace(1.0, 0.2, LEVELS), lowest), used))[::-1]:
        level = _level(on, float(top))
        if level.fit is None or (level.within(NEAR) and level.misfit > NOISE * noise):
            continue
        gains = whole.fit is None or level.misfit < BETTER * level.rms(whole.fit.theta)
        return Carried(float(top), _reach(level, highest)) if gains else None
    return None


def _reach(level: FitUpTo, highest: float) -> float:
    return max(level.top, min(level.limit / NEAR, highest))


def _noise(t: Targets) -> float:
    """Root mean square sd in mm of the values that fits use."""
    variance = np.diagonal(t.covariance, axis1=2, axis2=3)[t.used]
    return float(np.sqrt(variance.mean()))


def cut(on: OnPaths, most: Carried) -> OnPaths:
    """The base model on its load paths, with targets up to a pressure."""
    return OnPaths.on(on.bench.carrying(most), on.paths)


def _level(on: OnPaths, top: float) -> FitUpTo:
    """The level of a pressure, from the best of evenly spread scales at the usual shape."""
    at = cut(on, Carried(top, top))
    t, elasticity = at.bench.targets, at.bench.elasticity
    low, high = np.array([(p.low, p.high) for p in elasticity.parameters]).T
    scales, shape = np.geomspace(*elasticity.scales, SEARCHED), elasticity.initial.shape
    every = [elasticity.law.at(float(scale), shape) for scale in scales]
    thetas = np.clip([[c[p.name] for p in elasticity.parameters] for c in every], low, high)
    fields = [at.predicted(theta) for theta in thetas]
    rms = [np.inf if u is None else t.rms(t.value - u) for u in fields]
    k = int(np.argmin(rms))
    if not np.isfinite(rms[k]):
        return FitUpTo(at, top, None, 0.0)
    fit = at.unweighted(thetas[k][None])
    return FitUpTo(at, top, fit, at.limit(fit.theta))


def in_words(limit: float, highest: float, fitted: float) -> str:
    """Sentences on a model that carries less than the test; pressures in MPa: what it carries, the highest of
    the test, and up to which it is fitted.

    >>> print(in_words(0.044, 0.045, 0.04).partition(": ")[0])
    With constants that fit the lower pressures this model carries at most 44 kPa, the test goes to 45 kPa
    """
    if limit >= highest:
        return (
            f"Fit and comparison use what lies up to {1e3 * fitted:.3g} kPa of {1e3 * highest:.3g} kPa: "
            "constants that fit more of it carry it no more. `twin diagnose` looks for what is missing."
        )
    return (
        f"With constants that fit the lower pressures this model carries at most {1e3 * limit:.3g} kPa, the "
        f"test goes to {1e3 * highest:.3g} kPa: its walls balloon where the real ones do not. Reinforcement, "
        "a law that is stiffer at large stretch, or another wall is missing. Fit and comparison use what "
        f"lies up to {1e3 * fitted:.3g} kPa; `twin diagnose` looks for what is missing."
    )
