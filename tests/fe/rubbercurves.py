"""What is missing in Mooney-Rivlin for real silicone, and what adding it does to load modes held out.

Published curves of nominal stress over stretch, in tension, equibiaxial tension and pure shear. A curve's noise is what a polynomial of degree 8 (or half as many as its
points) leaves of it. Mooney-Rivlin is fitted and tested for lack of fit on smooth functions; so is each
candidate with it: effects of the material that one slow pull can show, and errors of the machine. A candidate
is named where BIC falls by more than 6 against the base and against each other physics, and it does not end
at a bound. More terms of a named physics are kept only where they leave an adequate fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import Fit, Parameter, bic, least_squares, omnibus
from fe import Material
from tests.fe.lawpoints import nominal_stress
from twin.effects.material import Stiffening

Array = NDArray[np.float64]
Row = dict[str, Any]
MODES = {"uniaxial": "UT", "equibiaxial": "ET", "planar": "PS"}
DEGREE, SMOOTH, STEP = 8, 5, 1e-6  # of the noise's polynomial, of the smooth functions; of differences
NAMED, ADEQUATE = 6.0, 1e-3  # fall of BIC; probability of the lack of fit
BASE = (Parameter("C10", 0.0, 2.0, "MPa", start=0.1), Parameter("C01", 0.0, 2.0, "MPa", start=0.05))


@dataclass(frozen=True)
class Curve:
    """One test: stretch (k,), nominal stress (k,) MPa, and the stress's noise."""

    mode: str
    stretch: Array
    stress: Array
    sd: float  # MPa
    free: int  # degrees of freedom of that


@dataclass(frozen=True)
class Candidate:
    """Parameters besides C10 and C01, all 0 where nothing is missing, and the physics they are of."""

    name: str
    physics: str
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class Fitted:
    """A candidate that was fitted to some curves."""

    candidate: Candidate
    fit: Fit
    bic: float
    p_value: float
    at_bound: tuple[str, ...]

    @property
    def theta(self) -> dict[str, float]:
        return dict(zip(_names(self.candidate), self.fit.theta.tolist(), strict=True))


CANDIDATES = (
    Candidate("none", "none", ()),
    Candidate("stiffening", "stiffening", Stiffening(1).parameters),
    Candidate("stiffening:2", "stiffening", Stiffening(2).parameters),
    Candidate("load_zero", "load_zero", (Parameter("zero", -0.2, 0.2, "MPa", null=0.0, typical=0.005),)),
    Candidate("strain_gain", "strain_gain", (Parameter("gain", -0.2, 0.2, "", null=0.0, typical=0.01),)),
)


def curve(mode: str, stretch: Array, stress: Array) -> Curve:
    """The curve with the noise that a polynomial leaves of it; stress (k,) or (k,3,3) MPa."""
    stress = stress[:, 0, 0] if stress.ndim == 3 else stress
    degree = min(DEGREE, len(stretch) // 2 - 1)
    left = stress - np.polynomial.Chebyshev.fit(stretch, stress, degree)(stretch)
    free = len(stretch) - degree - 1
    return Curve(mode, stretch, stress, float(np.sqrt((left**2).sum() / free)), free)


def published(folder: Path, source: str) -> dict[str, Curve]:
    """The three tests of one source, by mode."""
    import h5py  # of the developer's tools

    with h5py.File(folder / "hyperelastic" / "data.h5") as file:
        return {
            mode: curve(mode, *(np.array(file[source][key][what]) for what in ("stretch", "stress")))
            for mode, key in MODES.items()
        }


def stress_of(theta: Mapping[str, float], test: Curve) -> Array:
    """Predicted nominal stress (k,) MPa."""
    law = Material(theta["C10"], theta["C01"], C20=theta.get("stiffening.C20", 0.0),
                   C30=theta.get("stiffening.C30", 0.0))  # fmt: skip
    stretch = 1.0 + (test.stretch - 1.0) * (1.0 + theta.get("gain", 0.0))
    return nominal_stress(law, stretch, test.mode) + theta.get("zero", 0.0)


def _names(candidate: Candidate) -> list[str]:
    return [p.name for p in (*BASE, *candidate.parameters)]


def fitted(candidate: Candidate, tests: Sequence[Curve]) -> Fitted:
    """The candidate with Mooney-Rivlin, fitted to the curves."""
    parameters, names = (*BASE, *candidate.parameters), _names(candidate)

    def residual(theta: Array) -> Array:
        at = dict(zip(names, theta.tolist(), strict=True))
        return np.concatenate([(test.stress - stress_of(at, test)) / test.sd for test in tests])

    def jacobian(theta: Array) -> Array:
        step = STEP * np.eye(len(theta))
        return np.array([(residual(theta + s) - residual(theta - s)) / (2 * STEP) for s in step]).T

    start = np.array([0.0 if p.start is None else p.start for p in parameters])
    fit = least_squares(residual, jacobian, parameters, start=start)
    z, J = residual(fit.theta), jacobian(fit.theta)
    near = [min(x - p.low, p.high - x) < 1e-9 for p, x in zip(parameters, fit.theta, strict=True)]
    bound = tuple(name for name, at in zip(names, near, strict=True) if at)
    free = [name not in bound for name in names]
    component = np.repeat(np.arange(len(tests)), [len(test.stretch) for test in tests])
    nu = [float(test.free) for test in tests]
    p = omnibus(z, _smooth(tests), component=component, static_frames_effective=nu, fitted=J[:, free])
    return Fitted(candidate, fit, bic(fit.chi2, int(np.sum(free)), len(z)), p, bound)


def _smooth(tests: Sequence[Curve]) -> Array:
    """Polynomials of the logarithm of the stretch (n, b), each curve's own."""
    blocks = []
    for k, test in enumerate(tests):
        x = np.log(test.stretch)
        own = np.polynomial.legendre.legvander(2 * (x - x.min()) / np.ptp(x) - 1, SMOOTH)
        row = np.zeros((len(x), len(tests), SMOOTH + 1))
        row[:, k] = own
        blocks.append(row.reshape(len(x), -1))
    return np.concatenate(blocks)


def named(every: Sequence[Fitted]) -> Fitted | None:
    """The addition that the curves call for, by the rule of this file; None where there is none."""
    base = every[0]
    more = [f for f in every[1:] if not set(f.at_bound) & {p.name for p in f.candidate.parameters}]
    if base.p_value > ADEQUATE or not more:
        return None
    best = min(more, key=lambda f: f.bic)
    rivals = [f.bic for f in every if f.candidate.physics != best.candidate.physics]
    if min(rivals) - best.bic <= NAMED:
        return None
    simple = next(f for f in more if f.candidate.physics == best.candidate.physics)
    return best if best.p_value > ADEQUATE else simple


def verdict(found: Fitted | None, base: Fitted) -> str:
    """The verdict in words."""
    if base.p_value > ADEQUATE:
        return "none needed"
    if found is None:
        return "none of these"
    name = found.candidate.physics
    return name if found.p_value > ADEQUATE else f"{name}, no law of it adequate"


def rms(theta: Mapping[str, float], test: Curve) -> float:
    """Root mean square error of a prediction, MPa."""
    return float(np.sqrt(np.mean((test.stress - stress_of(theta, test)) ** 2)))


def judged(tests: Sequence[Curve], held: Sequence[Curve]) -> Row:
    """Fits, verdict, and the errors on held-out tests before and after the named addition."""
    every = [fitted(c, tests) for c in CANDIDATES]
    found = named(every)
    after = found or every[0]
    both = {
        test.mode: {"before_MPa": rms(every[0].theta, test), "after_MPa": rms(after.theta, test)}
        for test in held
    }
    return {
        "verdict": verdict(found, every[0]),
        "named": found.candidate.name if found else "",
        "p_before": every[0].p_value,
        "held_out": both,
    }


def better(row: Row) -> bool:
    """Whether stiffening is named, and every held-out mode predicted better with it."""
    errors = row["held_out"].values()
    return "stiffening" in row["named"] and all(e["after_MPa"] < e["before_MPa"] for e in errors)
