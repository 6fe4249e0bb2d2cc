"""Natural vibrations of a fitted model about held pressures: frequencies, damping, what moves."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from fe import Case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.mass import Attached, mass_matrix
from fe.dynamics.vibration import Modes, modes
from fe.mesh.mirror import AXIS, middle_plane, mirrored, symmetry_support
from twin.calibrated.predictions import why_none
from twin.calibrated.problem import CalibrationProblem
from twin.effects.protocol import Unsolvable
from twin.gravity import is_heavy, of_targets, pulls_across, with_density
from twin.judging.fitrecord import FitRecord
from twin.model.prediction import Model
from twin.targets import Array

SECTIONS = 24  # along the finger, in each of which the mean motion is taken
TONNE = 1e-6  # of a gram
ON_PLANE = 1e-6  # mm
UP = "bends up and down"
STEP = 0.01  # of a parameter's sd, over which a frequency is differenced


@dataclass(frozen=True)
class WantedVibrations:
    """What is asked for: pressures in MPa, the number of vibrations at each, the loss factor of the silicone
    beside its creep, its density in kg/m3 where the model has none, and masses in g by place (3,) mm."""

    pressures: tuple[float, ...]
    count: int = 4
    loss: float = 0.0
    kg_m3: float | None = None
    attached: Mapping[str, tuple[Array, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Vibrating:
    """The vibrations at one pressure in MPa about displacements u (n, 3) mm of a case; sd (m,) Hz of the
    frequencies by the fit, None where it gives none."""

    case: Case
    pressure: float
    u: Array
    found: Modes
    sd: Array | None

    @property
    def moves(self) -> list[str]:
        """What each vibration moves, in words."""
        return [motion_of(self.case, shape, bool(s))
                for shape, s in zip(self.found.shape, self.found.sideways, strict=True)]  # fmt: skip


def vibrations(problem: CalibrationProblem, record: FitRecord, asked: WantedVibrations) -> list[Vibrating]:
    """The vibrations of a fitted model about each held pressure, all creep at its end.

    ValueError where nothing states the density. Raises Unsolvable where there is no equilibrium.
    """
    model, theta = problem.model(), record.fit.theta
    sd = record.fit.sd
    varied = [] if why_none(record) else [k for k in range(len(theta)) if np.isfinite(sd[k]) and sd[k] > 0]
    out = []
    for pressure in asked.pressures:
        at = partial(_at, problem, model, asked, pressure)
        here = at(theta)
        slopes = np.array([(at(theta + STEP * sd[k] * np.eye(len(theta))[k]).found.frequency
                            - here.found.frequency) / (STEP * sd[k]) for k in varied])  # fmt: skip
        spread = None
        if varied:
            covariance = record.fit.covariance[np.ix_(varied, varied)]
            spread = np.sqrt(np.einsum("km,kl,lm->m", slopes, covariance, slopes))
        out.append(replace(here, sd=spread))
    return out


def check_density(problem: CalibrationProblem, record: FitRecord, kg_m3: float | None) -> None:
    """ValueError where neither the model nor kg_m3 states the density of every material."""
    model = problem.model()
    with_density(model.put(model.named(record.fit.theta)).case, kg_m3)


def _at(
    problem: CalibrationProblem, model: Model, asked: WantedVibrations, pressure: float, theta: Array
) -> Vibrating:
    targets = problem.targets
    direction = of_targets(targets).reshape(-1, 3)[0]
    held = HeldLoad(pressure, gravity=direction)
    settled = replace(held.path, time=np.array([0.0, 1.0, 1e4]), output=np.array([1e4]),
                      pressure=np.array([0.0, pressure, pressure]))  # fmt: skip
    test = replace(model, test=replace(model.test, path=settled)).put(model.named(theta))
    case, path = test.case, test.path
    if targets.shares:
        first = {name: float(shares[0]) for name, shares in targets.shares.items()}
        case = replace(case, shares={**case.shares, **first})
    weighs = is_heavy(case)
    case = with_density(case, asked.kg_m3)
    if symmetry_support(case) is not None and (_aside(case, asked) or (weighs and pulls_across(path))):
        case = mirrored(case)
    felt = HeldLoad(float(path.at_output()[0]), path.gravity if weighs else 0 * path.gravity)
    if weighs and asked.attached:
        places = np.array([place for place, _ in asked.attached.values()])
        weight = np.array([[TONNE * grams] for _, grams in asked.attached.values()]) * felt.gravity
        felt = replace(felt, places=places, pulls=weight)
    loaded = at_rest(case, felt)
    if not loaded.converged:
        raise Unsolvable(f"no equilibrium at {1e3 * pressure:.4g} kPa: {loaded.reason}")
    masses = [Attached(place, TONNE * grams) for place, grams in asked.attached.values()]
    found = modes(loaded, count=asked.count, attached=masses, loss=asked.loss)
    return Vibrating(case, pressure, loaded.state.u, found, None)


def _aside(case: Case, asked: WantedVibrations) -> bool:
    """True if a mass hangs beside the plane of symmetry."""
    return any(abs(place[AXIS] - middle_plane(case)) > ON_PLANE for place, _ in asked.attached.values())


# -- what moves ----------------------------------------------------------------------------------------------


def motion_of(case: Case, shape: Array, sideways: bool) -> str:
    """What a vibration (n, 3) moves, in words, by where its kinetic energy lies: in the mean motion of the
    sections across the finger, or inside them."""
    mass: Array = np.asarray(mass_matrix(case).sum(axis=1), float).reshape(-1, 3)[:, 0]
    x = case.nodes[:, 0]
    section = np.minimum((SECTIONS * (x - x.min()) / np.ptp(x)).astype(int), SECTIONS - 1)
    weight = np.bincount(section, mass, SECTIONS)
    moved = np.stack([np.bincount(section, mass * shape[:, d], SECTIONS) for d in range(3)], axis=1)
    mean: Array = moved / np.maximum(weight, 1e-300)[:, None]
    if symmetry_support(case) is not None:  # of the whole finger
        mean[:, [0, 2] if sideways else [AXIS]] = 0.0
    energy = (mass[:, None] * shape**2).sum()
    along, aside, up = (weight[:, None] * mean**2).sum(axis=0) / energy
    if along > 0.7:
        return "stretches"
    if aside > 0.5:
        return "sways aside"
    if along + up > 0.5:
        return UP
    return "twists" if sideways or _twists(case, shape, mass) else "walls breathe"


def _twists(case: Case, shape: Array, mass: Array) -> bool:
    """True if half of a motion's energy is a turn about the finger's axis."""
    middle = np.average(case.nodes, axis=0, weights=mass)
    arm = np.cross([1.0, 0.0, 0.0], case.nodes - middle)
    across = (mass * (shape * arm).sum(axis=1) ** 2 / np.maximum((arm**2).sum(axis=1), 1e-9)).sum()
    return bool(across > 0.5 * (mass[:, None] * shape**2).sum())
