"""What inertia adds to a prediction along a fast course of the pressure: a swing, with its errors.

Statics give where the finger would be at rest, with its creep, weight and all effects. About that it swings
as a reduced model of it does about its own equilibria. The rubber of that model does not creep: it has the
stiffness that creep leaves at the frequency of the vibration, less what the finest mesh is softer by.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix

from fe import Case, Path
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.onevibration import driven
from fe.dynamics.reduced import ReducedModel, ReducedMotion
from fe.dynamics.vibration import modes
from fe.mesh.points import interpolation
from twin.calibrated.predictions import Beside
from twin.effects.protocol import Test, Unsolvable
from twin.gravity import is_heavy, with_density
from twin.model.prediction import Model
from twin.targets import Array

LEVELS = 9  # of pressure, at which the reduced model has equilibria: an odd number
MARGIN = 0.15  # of the range that one vibration swings over, by which they go beyond it
COUNT = 6  # vibrations of which that up and down is one
PER_PERIOD = 20  # times at which one vibration is looked at
LATER = 1.5  # periods after the largest swing, at which the reduced model is checked again


@dataclass(frozen=True)
class Damping:
    """The loss factor of a vibration, twice its damping ratio, its sd, and where it comes from. beside: it
    comes on top of what the creep of the model loses; else the larger of the two counts."""

    loss: float = 0.12
    sd: float = 0.06
    source: str = "assumed, as two real fingers have it: a ratio of 0.04 to 0.09"
    beside: bool = False

    def with_creep(self, creep: float) -> float:
        """The loss factor of a model whose creep alone gives one."""
        return self.loss + creep if self.beside else max(self.loss, creep)


@dataclass(frozen=True, kw_only=True)
class Swing(Beside):
    """What inertia adds, the frequency in Hz without damping, the damping ratio, and the largest error in mm
    that the reduced model states."""

    frequency: float
    damping: float
    error: float


@dataclass(frozen=True)
class WantedSwing:
    """How a vibration dies, and the density in kg/m3 where the model has none."""

    damping: Damping
    kg_m3: float | None = None

    def __call__(self, model: Model, theta: Array, rows: slice, u: Array, factors: Array) -> Swing:
        """What inertia adds in the steps `rows` of a model, whose step before them is at rest.

        u (s, p, 3) mm and factors (q, s, p, 3) mm: what statics predict, and its errors. Errors of the swing:
        what the reduced model states; the frequency, by the stiffness that the film and the mesh leave open;
        the damping. ValueError without a density, under a hung weight, and where the reduced model has no
        equilibrium.
        """
        test = model.put(model.named(theta))
        case, path = _alone(test, rows, self.kg_m3)
        case, frequency, creep = _as_it_vibrates(case, path, model.mesh.softer if model.mesh else 0.0)
        loss = self.damping.with_creep(creep)
        path = _longer(path, (1 + LATER) / frequency)
        reduced = _reduced(case, path, frequency, loss / 2)
        motion = reduced.follow(path, loss=loss)
        at = float(motion.time[motion.swing.argmax()])
        points = interpolation(case, test.points[test.moving])
        motion = reduced.certified(motion, [at, at + LATER / frequency], at=points)

        known = model.mesh.stiffness if model.mesh else 0.0
        doubt = 0.5 * float(np.hypot(_relative(u[rows], factors[:, rows]), known))
        faster = reduced.follow(_stretched(path, 1 + doubt), loss=loss)
        damped = reduced.follow(path, loss=loss + self.damping.sd)
        off = _off(reduced, motion)
        every = (off, _off(reduced, faster), _off(reduced, damped))
        swing, later, slower = (_seen(model, theta, test, rows, points, x) for x in every)
        stated = np.zeros_like(swing)
        stated[rows, test.moving] = motion.error[1:-1]
        return Swing(
            u=swing, factors=np.array([stated, later - swing, slower - swing]),
            shape=off, frequency=frequency, damping=loss / 2,
            error=float(stated.max()),
        )  # fmt: skip


def _alone(test: Test, rows: slice, kg_m3: float | None) -> tuple[Case, Path]:
    """The case with a density, and the path of one course alone, from the rest before it, under what pulls
    and fills it there. ValueError where something hangs on it."""
    whole, case = test.path, test.case
    output = whole.output[rows.start - 1 : rows.stop]
    outside = whole.outside_at(output[-1:])[0]
    pulls, shares = np.split(outside[3:], [whole.places.size])
    if pulls.any():
        raise ValueError("inertia of a finger on which something hangs: wanted a course without a weight")
    if whole.chambers:
        here = dict(zip(whole.chambers, shares.tolist(), strict=True))
        case = replace(case, shares={**case.shares, **here})
    inside = whole.time[(whole.time > output[0]) & (whole.time < output[-1])]
    time = np.concatenate([output[:1], inside, output[-1:]])
    gravity = outside[:3] * is_heavy(case)
    return with_density(case, kg_m3), Path(time, whole.pressure_at(time), output, gravity=gravity)


def _longer(path: Path, by: float) -> Path:
    """The path whose last pressure is held for a time in s more, which is one more output."""
    end, held = path.time[-1] + by, path.pressure[-1]
    return replace(path, time=np.append(path.time, end), pressure=np.append(path.pressure, held),
                   output=np.append(path.output, end))  # fmt: skip


def _as_it_vibrates(case: Case, path: Path, softer: float) -> tuple[Case, float, float]:
    """The case without creep that is as stiff as the finger vibrates, the frequency in Hz of its slowest
    vibration, up and down where it has one, and the loss factor by its creep.

    softer: part by which the finest mesh is softer. Raises Unsolvable without an equilibrium.
    """
    top = float(path.pressure.max())
    loaded = at_rest(case, HeldLoad(top, path.gravity))
    if not loaded.converged:
        raise Unsolvable(f"no equilibrium at {1e3 * top:.4g} kPa: {loaded.reason}")
    found = modes(loaded, count=COUNT)
    k = int(np.flatnonzero(~found.sideways)[0]) if not found.sideways.all() else 0
    omega = 2 * np.pi * float(found.frequency[k])
    stiff = {}
    for name, material in case.materials.items():
        left = 1.0 - sum(g / (1 + (omega * tau) ** 2) for g, tau in material.prony)
        stiff[name] = material.instant.stiffened(left * (1 - softer))
    frequency = float(found.frequency[k]) * np.sqrt(1 - softer)
    return replace(case, materials=stiff), frequency, 2 * float(found.damping[k])


def _reduced(case: Case, path: Path, frequency: float, damping: float) -> ReducedModel:
    """The reduced model over the pressures that one vibration swings over."""
    step = 1 / (PER_PERIOD * frequency)
    time = np.unique(np.append(path.time, np.arange(path.time[0], path.output[-1], step)))
    pressure = path.pressure_at(time)
    swung = np.append(driven(time, pressure, omega=2 * np.pi * frequency, damping=damping), pressure)
    low, high = float(swung.min()), float(swung.max())
    beyond = MARGIN * (high - low)
    levels = np.linspace(low - beyond, high + beyond, LEVELS)
    try:
        return ReducedModel.of(case, levels.tolist(), gravity=path.gravity)
    except ValueError as error:
        raise ValueError(f"inertia of this course: {error}; change the pressure more slowly") from error


def _relative(u: Array, factors: Array) -> float:
    """The sd of the largest displacement (s, p, 3) mm over it."""
    k = int(np.abs(u).argmax())
    sd = np.sqrt((factors.reshape(len(factors), -1)[:, k] ** 2).sum())
    return float(sd / max(abs(u.ravel()[k]), 1e-12))


def _stretched(path: Path, by: float) -> Path:
    """The path in a time that runs faster: a finger whose frequencies are higher by a factor follows it as
    this one follows the path."""
    first = path.output[0]
    return replace(path, time=first + by * (path.time - first), output=first + by * (path.output - first))


def _off(reduced: ReducedModel, motion: ReducedMotion) -> Array:
    """How far (s, n, 3) mm a motion is off its equilibria, without the rest before and the time after."""
    u = motion.u[1:-1]
    return np.asarray(u - reduced.place(motion.path.at_output()[1:-1]).reshape(u.shape))


def _seen(model: Model, theta: Array, test: Test, rows: slice, points: csr_matrix, off: Array) -> Array:
    """What a motion (k, n, 3) mm in the steps `rows` changes of all that is seen (s, p, 3) mm."""
    values = model.named(theta)
    nothing = np.zeros((len(test.path.output), len(test.points), 3))
    out = nothing.copy()
    out[rows, test.moving] = [points @ one for one in off]
    for effect in model.effects:
        out, nothing = effect.after(out, test, values), effect.after(nothing, test, values)
    return np.asarray(out - nothing)
