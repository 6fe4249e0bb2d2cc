"""Virtual tests of a finger in closed form: how often profile and posterior hold the truth.

Each trial draws the noise, and by how much a mesh is too stiff (5 %, 1 sd), fits C10, C01 and a creep that is
near its bound, and asks `profile_likelihood` and a chain on `twin.calibrated.posterior.Density` for 95 %
intervals of the three and of C10 + C01. Chains have 750 steps, some 30 autocorrelation times after their beginning.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate import Fit, Parameter, least_squares, profile_likelihood
from calibrate.fit import Jacobian, Residual
from calibrate.posteriors import END, sampled
from calibrate.profiles import Held
from twin.calibrated.posterior import Density
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.targets import Array

PARAMETERS = (
    Parameter("C10", 0.01, 1.5, "MPa", typical=0.02), Parameter("C01", 0.0, 0.5, "MPa", typical=0.02),
    Parameter("g1", 0.0, 0.4, typical=0.02),
)  # fmt: skip
TRUE = np.array([0.21, 0.09, 0.05])
STIFFNESS, NOISE = 0.05, 1.2  # of the mesh, as a share, and mm: 1 sd
PRESSURE = np.concatenate([np.linspace(0.0, 0.02, 12), np.full(8, 0.02), np.linspace(0.02, 0.0, 6)])  # MPa
CREPT = np.concatenate([np.zeros(12), 1 - np.exp(-np.arange(8) / 3.0), np.full(6, 0.9)])
PLACES = np.array([0.4, 0.7, 1.0])  # of the length
WALKING, STEPS = 32, 750


def displacements(theta: Array) -> Array:
    """Displacements (m, n) mm of a bending finger with parameters theta (m, 3): along its axis and across."""
    total, share = theta[:, 0] + theta[:, 1], theta[:, 1] / (theta[:, 0] + theta[:, 1])
    softer = 1 + theta[:, 2, None] * CREPT
    bend = 10 * PRESSURE / total[:, None] * softer
    bend = bend + (0.6 - share[:, None]) * bend**2
    across = -40 * np.sin(bend[:, :, None] * PLACES) * PLACES
    along = -25 * (1 - np.cos(bend[:, :, None] * PLACES)) * PLACES
    return np.concatenate([across, along], axis=1).reshape(len(theta), -1)


def slopes(theta: Array) -> Array:
    """Derivatives (n, 3) of `displacements` at theta (3,)."""
    h = 1e-5 * np.diag([p.step for p in PARAMETERS])
    return np.asarray((displacements(theta + h) - displacements(theta - h)).T / (2 * np.diag(h)))


class ClosedResponse:
    """What a density asks of a response, answered in closed form: every value is a field of its own."""

    parameters, law = PARAMETERS, MOONEY_RIVLIN

    def coefficients(self, thetas: Array) -> Array:
        """Displacements (m, n) mm."""
        return displacements(thetas)


def density(measured: Array) -> Density:
    """The log density of measured displacements (n,) mm."""
    rows = np.column_stack([measured, np.eye(len(measured))]) / NOISE
    response: Any = ClosedResponse()
    small, unit = np.linalg.qr(rows).R, np.eye(3)
    return Density(response, small, lambda theta: np.zeros(len(theta)), unit, STIFFNESS, guard=False)


def around(measured: Array, theta: Array) -> tuple[Residual, Jacobian]:
    """Residual (n,) and derivatives (n, 3), whitened by the noise and the mesh's stiffness at theta (3,)."""
    mode = STIFFNESS / NOISE * slopes(theta)[:, :2] @ theta[:2]
    size = float(mode @ mode)
    lost = (1 - 1 / np.sqrt(1 + size)) / size

    def white(x: Array) -> Array:
        return np.asarray(x / NOISE - lost * np.multiply.outer(mode, mode @ x / NOISE))

    return (lambda t: white(measured - displacements(t[None])[0])), (lambda t: -white(slopes(t)))


def values(theta: Array) -> Array:
    """C10, C01, g1 and C10 + C01 (m, 4) of theta (m, 3)."""
    return np.column_stack([theta, theta[:, :2].sum(axis=1)])


NAMES = ("C10", "C01", "g1", "C10+C01")


@dataclass(frozen=True)
class Trial:
    """The 95 % intervals (4, 2) of one virtual test by profile and by posterior."""

    profile: Array
    posterior: Array


def trial(seed: int) -> Trial:
    """One virtual test."""
    rng = np.random.default_rng(seed)
    stiff = TRUE * np.array([*[np.exp(STIFFNESS * rng.normal())] * 2, 1.0])
    measured = displacements(stiff[None])[0]
    measured = measured + NOISE * rng.normal(size=len(measured))
    fit = fitted(measured)
    chain = sampled(made := density(measured), started(made, fit, rng), seed=seed, most=STEPS)
    return Trial(
        profile=by_profile(measured, fit),
        posterior=np.percentile(values(made.true(chain.samples)), END, axis=0).T,
    )  # fmt: skip


def fitted(measured: Array) -> Fit:
    """The fit, under errors as at the last fit before it."""
    theta = TRUE
    for _ in range(3):
        fit = least_squares(*around(measured, theta), PARAMETERS, start=theta, tolerance=0.01)
        theta = fit.theta
    return fit


def started(made: Density, fit: Fit, rng: np.random.Generator) -> Array:
    """Where the walkers (w, 4) begin: about the fit, inside the bounds."""
    sd = np.where(np.isfinite(fit.sd), np.nan_to_num(fit.sd), [p.step for p in PARAMETERS])
    x = np.column_stack([fit.theta + 0.5 * sd * rng.normal(size=(4096, 3)), rng.normal(size=4096)])
    return x[np.isfinite(made(x))][:WALKING]


def by_profile(measured: Array, fit: Fit) -> Array:
    """The intervals (4, 2) by profile, open where it reaches no end."""
    out = []
    for name in NAMES:
        held = Held.total(PARAMETERS, "C10", "C01") if "+" in name else Held.parameter(PARAMETERS, name)
        found = profile_likelihood(lambda t: around(measured, t), held=held, theta=fit.theta)
        out.append([s * np.inf if e.limit else e.value for s, e in zip((-1, 1), found.ends[-1], strict=True)])
    return np.array(out)


def coverage(trials: Sequence[Trial]) -> Mapping[str, Any]:
    """The share of intervals that hold the truth, by kind, over all values and for each."""
    wanted, out = values(TRUE[None])[0], {}
    for kind in ("profile", "posterior"):
        ends = np.array([getattr(one, kind) for one in trials])
        held = (ends[:, :, 0] <= wanted) & (wanted <= ends[:, :, 1])
        out[f"coverage_{kind}"] = float(held.mean())
        out[f"coverage_{kind} of"] = dict(zip(NAMES, held.mean(axis=0).round(3).tolist(), strict=True))
    return {"trials": len(trials), **out}
