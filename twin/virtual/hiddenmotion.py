"""The inertia of a truth: what a reduced model of it swings beside its equilibria."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from fe import Case
from fe.case import CaseKey, digest
from fe.dynamics.reduced import ReducedModel
from fe.mesh.points import interpolation
from twin.effects.protocol import Test
from twin.gravity import with_density
from twin.targets import Array

LOSS = 0.1  # loss factor of the silicone
DENSITY_KG_M3 = 1070.0  # where a truth has no weight
BEYOND = 0.3  # of the range of the pressure, by which it swings beyond
LEVELS, COUNT = 9, 2  # equilibria, and vibrations of each


def swinging(u: Array, test: Test, size: float) -> Array:
    """Displacements (s, p, 3) mm to which `size` times the swing after fast changes of the pressure is added;
    1 is that of a finger with its mass. Creep and softening do not count in it."""
    return u if size == 0 else u + size * swing_of(test)


def swing_of(test: Test) -> Array:
    """How far (s, p, 3) mm the points of a truth are off their equilibria along its course, by inertia."""
    path, low, high = test.path, float(test.path.pressure.min()), float(test.path.pressure.max())
    case = with_density(test.case.with_material(prony=(), mullins=None), DENSITY_KG_M3)
    levels = np.linspace(low - BEYOND * (high - low), high + BEYOND * (high - low), LEVELS)
    gravity = path.outside_at(path.output[:1])[0, :3]
    key = CaseKey(case, digest(*vars(case).values()))
    model = _model(key, tuple(levels), tuple(gravity))
    motion = model.follow(replace(path, output=np.append(path.time[:1], path.output)), loss=LOSS)
    off = motion.u[1:] - model.place(path.at_output()).reshape(motion.u[1:].shape)
    points = interpolation(case, test.points[test.moving])
    out = np.zeros((len(off), len(test.points), 3))
    out[:, test.moving] = [points @ one for one in off]
    return out


@lru_cache(maxsize=2)
def _model(key: CaseKey, levels: tuple[float, ...], gravity: tuple[float, ...]) -> ReducedModel:
    case: Case = key.case
    return ReducedModel.of(case, levels, count=COUNT, gravity=np.array(gravity))
