"""A model at its parameters -> the modes of its own discretisation error, from solves on finer meshes.

The mesh is refined in one direction at a time (bellows, walls, section) and in two together; the change of
the prediction on each is one mode, 1 sd. One more mesh, finer in every direction and of the other topology,
measures what the modes do not carry; that remainder enters as small smooth modes of every marker and axis.
The finer meshes are solved without history, under the weight in each direction of gravity.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from fe import Case, Path, solve
from fe.case import digest
from fe.mesh.points import nearest
from twin.effects.baselaw import Constants
from twin.effects.protocol import Test
from twin.gravity import under, ways
from twin.model.arraycache import ArrayCache, code_digest, no_cache, rounded_up
from twin.model.prediction import Model
from twin.model.structure import Mesh, Structure
from twin.targets import Array, Targets

SAMPLES = 40  # pressures at which a finer mesh's response is sampled
COUNT = 7  # levels of its curve; the base mesh is solved on the same, so that their error cancels
MARGIN = 1.15  # highest pressure of a finer mesh over the test's: room for constants that are softer
# The check mesh is not the limit. Tried on one truth on a still finer mesh: 2.5 times what it shows was too
# little for an adequate fit, 5 times was enough.
SAFETY = 5.0
SMOOTH = (0.5, 1, 2, 3)  # powers of pressure of the remainder's modes


@dataclass(frozen=True)
class Discretisation:
    """modes (q, s, p, 3) mm, 1 sd each, with names; check (s, p, 3) mm: the change on the mesh that tests
    them; remainder_mm: rms of what they leave of it (NaN before it is measured); unknown: why there
    are no modes."""

    modes: Array
    names: tuple[str, ...]
    check: Array
    remainder_mm: float = float("nan")
    spread: Array | None = None  # (q, d): what each mode shifts the base model's parameters by
    unknown: str = ""


@dataclass(frozen=True)
class SolvedAt:
    """Where finer meshes are solved: the silicone's constants, and up to which pressure `top` in MPa."""

    constants: Constants
    top: float

    @staticmethod
    def beside(constants: Constants, pressure: float) -> "SolvedAt":
        """For constants and targets up to a pressure in MPa, with room for constants that are softer."""
        return SolvedAt(constants, rounded_up(MARGIN * max(pressure, 1e-6)))


def discretisation_error(
    model: Model,
    theta: Array,
    *,
    structure: Structure,
    solved_at: SolvedAt | None = None,
    cache: ArrayCache = no_cache,
) -> Discretisation:
    """The modes of a model of this structure at theta; their remainder is yet to be measured (NaN).

    solved_at: where the finer meshes are solved, by default at the model's own constants. Where only
    pressure loads the finger, and no weight, U depends on p / (C10 + C01) and the share alone, so that they
    serve for any sum; with the share the shapes hardly change (0.12 of it: 2 um of 60). cache: what gives the
    arrays, made now or before. Raises ValueError where a finer mesh has no equilibrium.
    """
    test = model.put(model.named(theta))
    own, q = _constants(test.case), test.path.at_output()
    at = solved_at or SolvedAt.beside(own, float(test.path.pressure.max()))
    gravities, of_step = ways(test.case, test.path)
    made = _responses(test, structure, at, gravities, cache)
    grid, moving = np.linspace(0.0, at.top, SAMPLES), test.moving
    modes = np.zeros((len(structure.finer), len(q), len(test.points), 3))
    for k, name in enumerate(structure.finer):
        change = np.zeros((len(q), int(moving.sum()), 3))
        for way in range(len(gravities)):
            steps = of_step == way
            differs = made[name, way] - made["base", way]
            change[steps] = _at(grid, differs, q[steps] * at.constants.total / own.total)
        modes[k][:, moving] = change - change[model.reference].mean(axis=0)
    names = tuple(f"discretisation:{name}" for name in structure.finer)
    return Discretisation(modes[:-1], names[:-1], modes[-1])


def meshes_key(test: Test, structure: Structure) -> str:
    """A digest of all that the finer meshes' responses depend on but for where they are solved: code, meshes,
    points, dead forces, gravity."""
    forces = {name: tuple(map(float, f)) for name, f in test.case.forces.items()}
    meshes = [mesh.key for mesh in (structure.base, *structure.finer.values())]
    gravities, _ = ways(test.case, test.path)
    points = test.points[test.moving]
    return digest("meshes", code_digest(), meshes, points, repr(forces), gravities, SAMPLES, COUNT)


def _constants(case: Case) -> Constants:
    """The constants of the silicone in a case."""
    own = next(m for name, m in case.materials.items() if name not in case.kept)
    return Constants(own.C10, own.C01)


def _responses(
    test: Test, structure: Structure, at: SolvedAt, gravities: Array, cache: ArrayCache
) -> dict[tuple[str, int], Array]:
    """The response (k, p, 3) mm of the moving points on each mesh, by its name and the way of gravity."""
    meshes, points = {"base": structure.base, **structure.finer}, test.points[test.moving]
    key, grid = meshes_key(test, structure), np.linspace(0.0, at.top, SAMPLES)
    forces = {name: tuple(map(float, f)) for name, f in test.case.forces.items()}
    keys = {
        (name, way): digest("discretisation", key, mesh.key, repr(at), way)
        for name, mesh in meshes.items()
        for way in range(len(gravities))
    }
    tasks = {
        keys[name, way]: partial(_response, mesh, at.constants, forces, g, grid, points)
        for name, mesh in reversed(meshes.items())  # the largest first
        for way, g in enumerate(gravities)
    }
    made = cache("error of the mesh", tasks)
    return {place: made[key] for place, key in keys.items()}


def unknown(targets: Targets, why: str) -> Discretisation:
    """What stands for the modes of a mesh that cannot be refined."""
    shape = targets.value.shape
    return Discretisation(np.zeros((0, *shape)), (), np.zeros(shape), unknown=why)


def _response(
    mesh: Mesh,
    constants: Constants,
    forces: dict[str, Any],
    gravity: Array,
    grid: Array,
    points: Array,
) -> Array:
    """Displacements (k, p, 3) mm of points (p, 3) mm at pressures (k,) MPa in a gravity (3,) mm/s2, without
    history."""
    case = under(replace(mesh.build().with_material(**constants.named), forces=forces), gravity)
    solution = solve(case, Path(grid, grid, grid, gravity=gravity), count=COUNT)
    if not solution.converged:
        raise ValueError(
            f"error of the mesh: the finer mesh of {len(case.nodes)} nodes {solution.reason}; wanted a "
            "solution up to the highest pressure: fix C10 or C01 in twin.toml [model] fixed, or film at a "
            "lower pressure"
        )
    # Surfaces of meshes that follow one geometry differ a little: a point of one may lie beside another.
    return solution.at(np.array([nearest(solution.case, x) for x in points]))


def _at(grid: Array, values: Array, q: Array) -> Array:
    return CubicSpline(grid, values, axis=0)(np.clip(q, grid[0], grid[-1]))


def with_remainder(
    mesh: Discretisation, size: float, pressure: Array, moving: Any, reference: Any
) -> Discretisation:
    """The modes, and for what they leave smooth modes of `size` mm for each moving marker and axis."""
    x = np.clip(pressure / max(float(pressure.max()), 1e-12), 0.0, None)
    smooth = []
    for point in np.flatnonzero(moving):
        for axis in range(3):
            for power in SMOOTH:
                mode = np.zeros(mesh.modes.shape[1:])
                mode[:, point, axis] = SAFETY * size * x**power
                smooth.append(mode - mode[reference].mean(axis=0))
    names = (*mesh.names, *("discretisation:remainder",) * len(smooth))
    modes = np.concatenate([mesh.modes, np.array(smooth)])
    return replace(mesh, modes=modes, names=names, remainder_mm=size)
