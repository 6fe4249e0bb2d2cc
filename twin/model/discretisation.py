"""Responses on finer meshes -> what a prediction gains from them, and what of its mesh's error remains.

The mesh is refined in one direction at a time (bellows, walls, section), in two together, and in every
direction with the other topology. All are solved once, without history, under the weight in each direction
of gravity, at theoretical constants of the silicone. `Model.on_mesh` adds the change to the finest mesh to
its prediction. What remains enters as modes of 1 sd: a change of stiffness, the other part of every change,
and a smooth error of every marker. Their sizes are those of nine truths on other meshes and elements
(docs/records/meshes.md).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fe import Case, Material, Path, solve
from fe.case import digest
from fe.element import Integers
from fe.engines.engine import Embedded
from fe.mesh.points import nearest
from fe.mesh.refine import enriched
from twin import effort
from twin.effects.protocol import Test
from twin.gravity import under, ways
from twin.laws.law import Constants, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.model.arraycache import ArrayCache, code_digest, no_cache, rounded_up
from twin.model.fingertable import table_of
from twin.model.meshchanges import STIFFNESS, Curves, MeshChanges
from twin.model.structure import Mesh, Structure
from twin.targets import Array

SAMPLES = 40  # pressures at which a finer mesh's response is sampled
COUNT = 7  # levels of its curve; the base mesh is solved on the same, so that their error cancels
MARGIN = 1.15  # highest pressure of a finer mesh over the test's: room for constants that are softer
CARRIED = 2 / 3  # of the remainder that the smooth modes carry
COARSE = 0.5  # of the scale: meshes further apart than this do not tell where they lead to
NEARBY = 3.0  # times, at most, the finer meshes reach beyond the test's pressure at theoretical constants
TURNS = 4  # steps to the pressure at which the base mesh is nearest to a displacement,
BEYOND = 2.0  # times the highest pressure is where what a mesh errs is looked for
LEAST = 3  # samples of a path that ends early
WALL = "wall:"  # and a dimension: the name of a mode that is its tolerance
SAME = 1e-7  # of the highest pressure, below which a step is the last


@dataclass(frozen=True)
class Discretisation:
    """Responses (mm) of the moving points of one model on its own mesh and on finer ones, without history.

    names (n,): the finer meshes, the last finer in every direction. law, and scale: half of the shear
    modulus at rest in MPa, of all of them; grid (k,) MPa. gravities (g, 3 + 3 h): the gravity in mm/s2 and
    hung forces in N they were solved in. base (g, k, m, 3),
    changes (n, g, k, m, 3): the model's own mesh, and what the others add to it. tested: the pressure in MPa
    up to which the changes are compared. unknown: why there are none, empty where there are. walls
    (d, g, k, m, 3): what dimensions of the chamber of these names (d,) change that are larger by their
    tolerance.
    """

    names: tuple[str, ...]
    scale: float
    grid: Array
    gravities: Array
    base: Array
    changes: Array
    tested: float = np.inf
    unknown: str = ""
    law: RubberLaw = MOONEY_RIVLIN
    walls: Array = field(default_factory=lambda: np.zeros((0, 1, 2, 0, 3)))
    wall_names: tuple[str, ...] = ()

    @staticmethod
    def none(why: str) -> "Discretisation":
        """The error of a mesh that cannot be refined: unknown, so it corrects nothing."""
        nothing = np.zeros((0, 1, 2, 0, 3))
        return Discretisation((), 1.0, np.zeros(2), np.zeros((1, 3)), nothing, nothing, unknown=why)

    # -- what a prediction takes ----------------------------------------------------------------------------

    def corrected(self, u: Array, test: Test) -> Array:
        """Displacements u (s, p, 3) mm of a test's points with the change to the finest mesh."""
        if self.unknown:
            return u
        out = u.copy()
        out[:, test.moving] += self._along(u, test, self._curves[1])[0]
        return out

    def modes(self, u: Array, test: Test) -> Array:
        """Modes (q, s, p, 3) mm, 1 sd each, of the mesh's error that remains at displacements u (s, p, 3) mm,
        not yet relative to the reference."""
        out = np.zeros((len(self.mode_names), *u.shape))
        if not self.unknown:
            out[:, :, test.moving] = self._along(u, test, self._curves[2])
        return out

    @property
    def wall_modes(self) -> slice:
        """Which of the modes are of walls: the last before those of a memory."""
        return slice(len(self.mode_names) - len(self.wall_names), len(self.mode_names))

    @property
    def mode_names(self) -> tuple[str, ...]:
        """The names (q,) of the modes."""
        if self.unknown:
            return ()
        of_mesh = (f"discretisation:{name}" for name in self._shown.mode_names)
        return (*of_mesh, *(f"{WALL}{name}" for name in self.wall_names))

    @cached_property
    def _shown(self) -> MeshChanges:
        inside = max(int((self.grid <= self.tested * (1 + 1e-9)).sum()), 2)
        return MeshChanges(self.names, self.grid, self.base, self.changes, inside)

    @cached_property
    def _curves(self) -> tuple[Curves, Curves, Curves]:
        """The base mesh, the correction and the modes over pressure."""
        of_mesh = self._shown.modes
        every = np.concatenate([of_mesh, self.walls]) if self.wall_names else of_mesh
        fields = (self.base[None], self.changes[-1:], every)
        base, correction, modes = (Curves.through(self.grid, np.moveaxis(x, 2, 0)) for x in fields)
        return base, correction, modes

    def _along(self, u: Array, test: Test, curves: Curves) -> Array:
        """Values (n, s, m, 3) mm of curves at displacements u (s, p, 3) mm of a test's points."""
        rows = self._way(test)
        return np.moveaxis(curves.at(self._pressure(u, test, rows), rows)[0], 1, 0)

    def _pressure(self, u: Array, test: Test, rows: Integers) -> Array:
        """Pressures (s,) MPa at which the base mesh is nearest to displacements u (s, p, 3) mm.

        Without effects that is pressure / scale times their own scale. What creeps or is stiffer
        elsewhere is as far bent at another pressure, and its mesh errs as much as it is bent.
        """
        base, seen = self._curves[0], u[:, None, test.moving]
        constants = self.law.of(self.law.read(_silicone(test.case)))
        q = test.path.at_output() * self.scale / constants.scale
        for _ in range(TURNS):
            value, slope = base.at(q, rows)
            ahead, square = (slope * (seen - value)).sum(axis=(1, 2, 3)), (slope**2).sum(axis=(1, 2, 3))
            step = ahead / np.maximum(square, 1e-12)
            q = np.clip(q + step, -self.grid[-1], BEYOND * self.grid[-1])  # without pressure nothing holds it
            if np.abs(step).max() < SAME * self.grid[-1]:
                break
        return q

    def _way(self, test: Test) -> Integers:
        """The rows (s,) of `gravities` nearest to gravity and hung forces of each step."""
        g = test.path.outside_at(test.path.output)
        return np.linalg.norm(g[:, None] - self.gravities, axis=2).argmin(axis=1)

    # -- whether the mesh will do ---------------------------------------------------------------------------

    @property
    def stiffness(self) -> float:
        """The part of the scale by which the stiffness may still be off, 1 sd: the first mode."""
        return STIFFNESS * self.apart

    @property
    def softer(self) -> float:
        """The part of C10 + C01 by which the finest mesh is softer."""
        return 0.0 if self.unknown else float(self._shown.softness[-1])

    @property
    def apart(self) -> float:
        """By how much the finer meshes differ in stiffness, of the scale."""
        return 0.0 if self.unknown else self._shown.apart

    @property
    def largest(self) -> float:
        """The largest change or mode in mm, at pressures that are compared."""
        inside = self.grid <= self.tested * (1 + 1e-9)
        fields = [self.changes, self._shown.modes, *([self.walls] if self.wall_names else [])]
        return max(float(np.abs(x[:, :, inside]).max(initial=0.0)) for x in fields)

    @property
    def remainder_mm(self) -> float:
        """The root mean square in mm of what neither correction nor modes carry, from the finer meshes alone.

        It is estimated at theoretical constants of the silicone: no measurement enters.
        """
        return 0.0 if self.unknown else (1 - CARRIED) * self._shown.left


# -- solving the finer meshes ------------------------------------------------------------------------------


@dataclass(frozen=True)
class SolvedAt:
    """The constants and the highest pressure `top` in MPa at which finer meshes are solved."""

    constants: Constants
    top: float

    @staticmethod
    def beside(constants: Constants, pressure: float) -> "SolvedAt":
        """For constants and targets up to a pressure in MPa, with room for constants that are softer."""
        return SolvedAt(constants, rounded_up(MARGIN * max(pressure, 1e-6)))


def discretisation_error(
    test: Test, *, structure: Structure, solved_at: SolvedAt, cache: ArrayCache = no_cache
) -> Discretisation:
    """The error of the mesh of a test of this structure, from solves on finer meshes.

    solved_at: where the finer meshes are solved. Where only pressure loads the finger, and no weight, U
    depends on p / scale and the law's shape alone, so that they serve for any scale; with the shape the
    changes hardly change (0.12 of Mooney-Rivlin's share: 2 um of 60). cache: what gives the arrays, made now
    or before. Unknown where a finer mesh does not carry the test.
    """
    if structure.unknown:
        return Discretisation.none(structure.unknown)
    gravities, _ = ways(test.case, test.path)
    responses = _responses(test, structure, solved_at, gravities, cache)
    rows = range(len(gravities))
    every = (*_meshes(structure), *(f"{WALL}{name}" for name in structure.walls))
    by_mesh = {name: np.array([responses[name, k] for k in rows]) for name in every}
    names, grid = tuple(structure.finer), np.linspace(0.0, solved_at.top, SAMPLES)
    carried = np.isfinite([u for every in by_mesh.values() for u in every]).all(axis=(0, 2, 3))
    if not carried.all():  # one has its limit point before: the room for softer constants is less
        share = MARGIN * float(grid[carried].max(initial=0.0)) / solved_at.top
        if share < 1.0:
            top = 1e3 * float(test.path.pressure.max())
            return Discretisation.none(
                f"a finer mesh carries at most {share * top:.3g} kPa, the test goes to {top:.3g} kPa, so "
                "near is its limit point"
            )
        grid, by_mesh = grid[carried], {name: u[:, carried] for name, u in by_mesh.items()}
    mesh = Discretisation(
        names=names,
        scale=solved_at.constants.scale,
        law=solved_at.constants.law,
        grid=grid,
        gravities=gravities,
        base=by_mesh["base"],
        changes=np.array([by_mesh[name] - by_mesh["base"] for name in names]),
        walls=np.array([by_mesh[f"{WALL}{name}"] - by_mesh["base"] for name in structure.walls]),
        wall_names=tuple(structure.walls),
        tested=min(_tested(float(test.path.pressure.max()), solved_at.top), float(grid[-1])),
    )
    if mesh.apart > COARSE:
        return Discretisation.none(
            f"finer meshes differ in stiffness by {mesh.apart:.0%}, wanted at most {COARSE:.0%}; "
            "refine the mesh"
        )
    most, size = mesh.largest, float(np.ptp(test.case.nodes, axis=0).max())
    if most > size:
        return Discretisation.none(
            f"finer meshes would move it by {most:.3g} mm more, and it is {size:.3g} mm long, which is no "
            "estimate; refine the mesh"
        )
    return mesh


def _tested(pressure: float, top: float) -> float:
    """The pressure in MPa up to which changes are compared: the test's own, at theoretical constants.

    So it does not depend on what is fitted, unless the fitted constants are so far from these that the finer
    meshes are solved up to a quite different `top`.
    """
    nominal = rounded_up(pressure)
    return nominal if nominal <= top <= NEARBY * nominal else top


def _meshes(structure: Structure) -> dict[str, Mesh]:
    return {"base": structure.base, **structure.finer}


def meshes_key(test: Test, structure: Structure) -> str:
    """A digest of all that the finer meshes' responses depend on but for where they are solved: code, meshes,
    points, dead forces, gravity, hung forces."""
    forces = {name: tuple(map(float, f)) for name, f in test.case.forces.items()}
    meshes = [mesh.key for mesh in (structure.base, *structure.finer.values())]
    gravities, _ = ways(test.case, test.path)
    points = test.points[test.moving]
    hung = gravities, test.path.places, test.path.chambers
    return digest("meshes", code_digest(), meshes, points, repr(forces), *hung, SAMPLES, COUNT)


def _silicone(case: Case) -> Material:
    """The silicone of a case."""
    return next(m for name, m in case.materials.items() if name not in case.kept)


def _responses(
    test: Test, structure: Structure, solved_at: SolvedAt, gravities: Array, cache: ArrayCache
) -> dict[tuple[str, int], Array]:
    """The response (k, p, 3) mm of the moving points on each mesh, by its name and the way of gravity; those
    with other walls have WALL before their names."""
    walls = {f"{WALL}{name}": mesh for name, mesh in structure.walls.items()}
    meshes, points = {**_meshes(structure), **walls}, test.points[test.moving]
    key, grid = meshes_key(test, structure), np.linspace(0.0, solved_at.top, SAMPLES)
    forces = {name: tuple(map(float, f)) for name, f in test.case.forces.items()}
    table, known = table_of(structure), {}
    if table and not forces and not gravities.any() and table.serves(solved_at.constants, solved_at.top):
        tabulated = partial(table.response, constants=solved_at.constants, pressure=grid, points=points)
        known = {(name, 0): tabulated(mesh) for name, mesh in _meshes(structure).items()}
        meshes = walls
    paths = [Path(grid, grid, grid, **test.path.under(g)) for g in gravities]
    keys = {
        (name, row): digest("discretisation", key, mesh.key, repr(solved_at), row)
        for name, mesh in meshes.items()
        for row in range(len(gravities))
    }
    tasks = {
        keys[name, row]: partial(_response, mesh, solved_at.constants, forces, path, points)
        for name, mesh in reversed(meshes.items())  # the largest first
        for row, path in enumerate(paths)
    }
    arrays = cache("error of the mesh", tasks) if tasks else {}
    return known | {place: arrays[key] for place, key in keys.items()}


def _response(
    mesh: Mesh,
    constants: Constants,
    forces: dict[str, Any],
    path: Path,
    points: Array,
) -> Array:
    """Displacements (k, p, 3) mm of points (p, 3) mm along a path of k pressures, without history; NaN beyond
    its end."""
    case = under(replace(mesh.build().with_material(**constants.terms), forces=forces), path)
    with effort.counted(effort.FINER):
        solution = solve(case, path, count=COUNT)
    out, inside = np.full((len(path.output), len(points), 3), np.nan), path.pressure <= solution.reached
    if solution.converged or inside.sum() > LEAST:
        # surfaces of meshes that follow one geometry differ a little: a point of one may lie beside another
        u = solution.at(np.array([nearest(solution.case, x) for x in points]))
        out[inside | solution.converged] = u[inside | solution.converged]
    return out


# -- linear tetrahedra: they cannot bend, nor keep their volume, without being too stiff ---------------------

SMALL = 1e-3  # of the shear modulus: a pressure at which the structure is linear
LARGEST = 10_000  # nodes of a mesh of linear tetrahedra of which the quadratic one is solved: 80,000 there


def stiffness_doubt(case: Case) -> str:
    """A sentence on the stiffness of a mesh of 4-node tetrahedra beside 10-node ones; "" for other
    elements."""
    if len(case.element.local) != 4:
        return ""
    sentence = f"Its linear tetrahedra ({case.element.name}) are too stiff for rubber"
    if len(case.nodes) > LARGEST:
        return f"{sentence}. Mesh it with C3D10H."
    pressure = SMALL * min(m.shear for m in case.materials.values())
    moved = [
        float(np.abs(solution.u[: len(case.nodes)]).max()) if solution.converged else np.nan
        for solution in (Embedded().solve(c, pressure) for c in (case, enriched(case)))
    ]
    share = 1 - moved[0] / moved[1]
    if not np.isfinite(share):
        return f"{sentence}. Mesh it with C3D10H."
    return (
        f"{sentence}: at a small pressure they move {100 * share:.0f} % less than 10-node ones on the same "
        "mesh. Mesh it with C3D10H."
    )
