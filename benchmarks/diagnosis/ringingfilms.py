"""Virtual films of a finger of three bellows that rings: the truth by a reduced model on one mesh, and the
statics that are diagnosed, tables of equilibria on another."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property

from benchmarks.kernel.beams import DENSITY
from benchmarks.kernel.convergence import SHORT, SILICONE

import numpy as np
import pandas
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import twin
from fe import Case, Lattice, Path, finger_case
from fe.dynamics.loading import HeldLoad, LoadedState, at_rest
from fe.dynamics.reduced import ReducedModel
from fe.dynamics.vibration import modes
from fe.mesh.points import interpolation
from twin.effects.library import effect
from twin.effects.loads import first_order_lag
from twin.effects.protocol import Test
from twin.targets import Targets

Array = NDArray[np.float64]
FINGER = SHORT
PLACES = {f"p{k}": (FINGER.length * x, 11.5, 0.0) for k, x in enumerate((0.4, 0.6, 0.8, 1.0), start=1)}
SD = 0.05  # mm
FAST = 6.0  # times as fast as a finger of nine bellows rings one of three, and so is all of its course
HZ, LOG_HZ = 240.0, 600.0  # a telephone's slow motion, as so short a finger rings at 30 Hz
LEVELS = np.linspace(-6e-3, 30e-3, 7)  # MPa, of the truth's equilibria
TABLE = np.linspace(-12e-3, 42e-3, 10)  # of the model's, whose mesh is stiffer
TIP_MASS = 6.0  # times as dense as silicone is the tip's cap, where it carries something
COMPLIANCE = 2e-3  # rad/(N mm), of a clamp that gives way: it does under what the motion makes of its moment
TRUTH, MODEL = (Lattice(per_bellow=k, ring=False, centred=False) for k in (4, 3))
BODIES = ("plain", "loaded", "soft")  # of the truth


def case_of(lattice: Lattice, body: str = "plain") -> Case:
    """The finger on a mesh, with more mass in its tip, or on a soft clamp."""
    case = finger_case(replace(SILICONE, density=DENSITY), finger=FINGER, lattice=lattice)
    if body == "loaded":
        x = case.nodes[case.connectivity].mean(axis=1)[:, 0]
        cap = np.flatnonzero(x > FINGER.length - FINGER.tip_cap)
        (name,) = case.materials
        heavy = replace(case.materials[name], density=TIP_MASS * DENSITY)
        sets = {name: np.setdiff1d(np.arange(len(x)), cap), "loaded_tip": cap}
        case = replace(case, element_sets={**case.element_sets, **sets},
                       materials={**case.materials, "loaded_tip": heavy})  # fmt: skip
    if body == "soft":
        still = Path(np.array([0.0, 1.0]), np.zeros(2), np.array([1.0]))
        test = Test(case, still, np.zeros((0, 3)), np.zeros(0, bool))
        case = effect("clamp").before(test, {"clamp.compliance": COMPLIANCE}).case
    return case


@cache
def truth(body: str) -> ReducedModel:
    """The reduced model of a true finger."""
    return ReducedModel.of(case_of(TRUTH, body), LEVELS.tolist(), count=2)


@dataclass(frozen=True)
class Statics:
    """Equilibria of the finger on a mesh, at pressures TABLE for the nominal silicone."""

    lattice: Lattice

    @cached_property
    def _states(self) -> list[LoadedState]:
        case = case_of(self.lattice)
        return [at_rest(case, HeldLoad(float(pressure))) for pressure in TABLE]

    @cached_property
    def _table(self) -> CubicSpline:
        points = interpolation(self._states[0].problem.case, np.array(list(PLACES.values())))
        return CubicSpline(TABLE, np.array([points @ loaded.state.u for loaded in self._states]))

    @cached_property
    def _hz(self) -> CubicSpline:
        """Frequency up and down, of every other one."""
        found = [modes(loaded, count=4) for loaded in self._states[::2]]
        return CubicSpline(TABLE[::2], [m.frequency[~m.sideways][0] for m in found])

    def __call__(self, values: Mapping[str, float], pressure: Array) -> Array:
        """Displacements (s, 4, 3) mm: those of a silicone as stiff as `values["E"]` times the nominal one,
        and by the share `values["more"]` stiffer under 10 kPa."""
        return np.asarray(self._table(pressure / (values["E"] * (1 + values["more"] * pressure / 1e-2))))

    def hz(self, stiff: float, pressure: float) -> float:
        """The frequency in Hz under a pressure in MPa, of a silicone so many times as stiff."""
        return float(self._hz(pressure / stiff) * np.sqrt(stiff))


@cache
def statics(lattice: Lattice) -> Statics:
    """The tables of a mesh."""
    return Statics(lattice)


@dataclass(frozen=True)
class Film:
    """A film: what is hidden and in what size, its course of the pressure, and the seed of its noise."""

    kind: str
    seed: int

    @cached_property
    def _drawn(self) -> np.random.Generator:
        return np.random.default_rng([self.seed, sum(map(ord, self.kind))])

    @cached_property
    def course(self) -> tuple[Array, Array]:
        """Times in s and pressures in MPa of its corners: a slow rise, and two fast steps."""
        rng = np.random.default_rng([self.seed, 1])
        first, top, last = rng.uniform([5e-3, 11e-3, 4e-3], [8e-3, 14e-3, 8e-3])
        up, down = rng.uniform(0.05, 0.12, 2)
        time = np.cumsum([0.0, 0.4, 1.6, 0.5, up, 2.2 - up, down, 2.3 - down])
        return time / FAST, np.array([0.0, 0.0, first, first, top, top, last, last])

    def pressure(self, time: Array) -> Array:
        """Pressures (t,) MPa of the gauge."""
        return np.interp(time, *self.course)

    def displaced(self, time: Array) -> Array:
        """True displacements (s, 4, 3) mm at times (s,) s."""
        rng = self._drawn
        body = {"added_mass": "loaded", "soft_clamp": "soft"}.get(self.kind, "plain")
        model = truth(body)
        points = interpolation(model.case, np.array(list(PLACES.values())))
        if self.kind in ("nothing", "lag"):
            fine = np.arange(0.0, time[-1] + 0.01, 2e-4)
            tau = rng.uniform(0.05, 0.25) / FAST if self.kind == "lag" else 0.0
            late = first_order_lag(fine, self.pressure(fine), tau)
            u = model.place(np.interp(time, fine, late)).reshape(len(time), -1, 3)
        else:
            loss = {"material_damping": rng.uniform(0.25, 0.5), "air_drag": 0.03}.get(
                self.kind, rng.uniform(0.06, 0.14))  # fmt: skip
            drag = rng.uniform(0.04, 0.1) if self.kind == "air_drag" else 0.0  # at a swing of 5 kPa
            omega2 = float(model.square[:, 0].mean())
            corners, pressure = self.course
            path = Path(corners, pressure, np.concatenate([[0.0], time[time > 0]]))
            u = model.follow(path, loss=loss, drag=drag * 3 * np.pi / 4 / (omega2 * 5e-3)).u[-len(time) :]
        return np.array([points @ one for one in u])

    @cached_property
    def targets(self) -> Targets:
        """What would be measured."""
        time, log = np.arange(0.0, self.course[0][-1], 1 / HZ), np.arange(0.0, self.course[0][-1], 1 / LOG_HZ)
        u = self.displaced(time)
        seen = u + SD * np.random.default_rng([self.seed, 2]).standard_normal(u.shape)
        rows = {"time_s": time, "pressure_kPa": 1e3 * self.pressure(time)}
        rows |= {f"{n}_{a}_mm": seen[:, k, i] for k, n in enumerate(PLACES) for i, a in ((0, "x"), (2, "z"))}
        course = pandas.DataFrame({"time_s": log, "pressure_kPa": 1e3 * self.pressure(log)})
        return twin.read_table(pandas.DataFrame(rows), points=PLACES, sd_mm=SD, log=course)
