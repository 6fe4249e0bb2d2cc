"""Finite-element solves of a truth: curves over pressure in each direction of gravity, and whole courses.

The truth's elements are 20-node hexahedra (Abaqus C3D20H) of a lattice of its own. What an effect changes is
solved on the lattice `CHANGE`; the bare finger once more on the finer `BARE`, so that the truth as a whole is
free of its mesh's error to a few micrometres.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fe import Case, Finger, Lattice, Material, Path, Variation, solve
from fe.mesh.convert import converted
from fe.mesh.mirror import mirrored
from fe.mesh.points import nearest
from twin.bodies.body import Body
from twin.bodies.finger import BuiltIn
from twin.effects.protocol import Test
from twin.gravity import G
from twin.targets import Array
from twin.virtual.hidden import Kind
from twin.virtual.protocols import TOP, WAYS

DENSITY = 1.07e-9  # tonne/mm3
SILICONE = Material(0.214, 0.083, density=DENSITY)
CHANGE = Lattice(per_bellow=8, wall=2, fillet=1, across=2, up=2)
LATTICE = Lattice(per_bellow=7, wall=2, across=2, up=2, centred=False)  # finer than the model's
BARE = Lattice(per_bellow=12, wall=3, fillet=2, across=3, up=3)
ELEMENT = "C3D20H"
LEVELS: Array = np.concatenate([[-0.06], np.linspace(0.0, 1.0, 17) ** 1.3 * 1.15]) * TOP  # MPa, of the curves
COUNT, ALL = 8, 12  # levels that are solved: of a table of curves, of one truth


def truth_lattice(body: Body) -> Any:
    """A lattice for the truth of a body, finer than the model's: of the finger `CHANGE`, else that on which
    the error of the model's is checked."""
    return CHANGE if isinstance(body, BuiltIn) else body.finer(body.lattice)["check"]


def truth_case(
    body: Body | Finger,
    lattice: Any,
    *,
    material: Material = SILICONE,
    element: str | None = ELEMENT,
    whole: bool = False,
) -> Case:
    """The bare body in the truth's elements; None: in the model's, on a lattice of its own."""
    body = BuiltIn(body, lattice) if isinstance(body, Finger) else body
    case = body.case(lattice, material)
    case = case if element is None else converted(case, element)
    return mirrored(case) if whole else case


def on_surface(case: Case, points: Array) -> Array:
    """The points (p, 3) mm of the truth's own surface that are nearest to places (p, 3) mm."""
    return np.array([nearest(case, x) for x in points])


def truth_test(case: Case, course: Path, points: Array) -> Test:
    """The test of a truth, its points (p, 3) mm on the truth's own surface."""
    return Test(case, course, on_surface(case, points), np.ones(len(points), bool))


def curves(test: Test, *, ways: Array | None = None) -> Array:
    """Displacements (w, k, p, 3) mm of a test's points at LEVELS in each direction of gravity (w, 3), without
    history. ValueError where there is no equilibrium."""
    out = []
    for direction in np.array(WAYS) if ways is None else ways:
        solution = solve(test.case, Path(LEVELS, LEVELS, LEVELS, gravity=G * direction), count=COUNT)
        if not solution.converged:
            raise ValueError(f"the truth {solution.reason}")
        out.append(solution.at(test.points))
    return np.array(out)


def history(test: Test) -> Array:
    """Displacements (s, p, 3) mm of a test's points along its whole course."""
    solution = solve(test.case, test.path, count=COUNT)
    if not solution.converged:
        raise ValueError(f"the truth {solution.reason}")
    return solution.at(test.points)


def slopes(kinds: Sequence[Kind], test: Test) -> Array:
    """Derivatives (v, w, k, p, 3) mm per unit of size of the curves, where nothing is hidden."""
    out = []
    for direction in np.array(WAYS):
        course = Path(LEVELS, LEVELS, LEVELS, gravity=G * direction)
        variations = []
        for kind in kinds:
            h = 1e-3 * kind.range[1]
            a, b = (kind.before(replace(test, path=course), s * h) for s in (1, -1))
            variations.append(Variation((a.case, a.path), (b.case, b.path), h))
        out.append(solve(test.case, course, count=COUNT, variations=variations).variations_at(test.points))
    return np.moveaxis(np.array(out), 0, 1)


def solved(kind: Kind, test: Test, size: float) -> Array:
    """Solves that a kind of truth needs at a size: its curves or its course."""
    changed = kind.before(test, size)
    if kind.part == "history":
        return history(changed)
    return curves(replace(changed, path=test.path))


# -- one truth, solved as a whole ----------------------------------------------------------------------------


def displaced(
    case: Case,
    course: Path,
    points: Array,
    hidden: tuple[tuple[Kind, float], ...] = (),
    *,
    count: int = ALL,
) -> tuple[Array, Array]:
    """True displacements (s, p, 3) mm of a truth's points (p, 3) mm along a course with all that is hidden,
    the unloaded finger being 0, and their slopes dU/dp (s, p, 3) mm per MPa.

    count: levels of pressure that are solved. ValueError where there is no equilibrium.
    """
    if any(kind.whole for kind, _ in hidden):
        case = mirrored(case)
    plain = Test(case, course, points, np.ones(len(points), bool))
    u, slope, test = _respond(plain, hidden, count)
    varying = [(kind, size) for kind, size in hidden if kind.along is not None]
    if varying:
        rest = tuple((k, s) for k, s in hidden if k.along is None)
        still, _, _ = _respond(plain, rest, count)
        factor = np.prod([k.along(course.at_output() / TOP) for k, _ in varying if k.along], axis=0)
        u = still + factor[:, None, None] * (u - still)
    for kind, size in hidden:
        u = kind.after(u, test, size)
    return u, slope


def _respond(
    test: Test, hidden: tuple[tuple[Kind, float], ...], count: int
) -> tuple[Array, Array, Test]:
    for kind, size in hidden:
        test = kind.before(test, size)
    solution = solve(test.case, test.path, count=count)
    if not solution.converged:
        raise ValueError(f"the truth {solution.reason}; hide less of it")
    return solution.at(test.points), solution.per_pressure(test.points), test


def tangents(case: Case, course: Path, points: Array, kind: Kind) -> Array:
    """Derivatives (3, s, p, 3) mm of a truth's displacements by C10, C01 (mm per MPa) and the size of what is
    hidden (mm per unit), where nothing is."""
    case = mirrored(case) if kind.whole else case
    test, h = truth_test(case, course, points), 1e-3 * kind.range[1]
    plus, minus = (kind.before(test, s * h) for s in (1, -1))
    if kind.part == "history":  # a softening or a relaxation below 0 means nothing
        plus, minus = kind.before(test, 0.02 * kind.range[1]), test
        h = 0.01 * kind.range[1]
    variations = [
        *(_constant(test, name, 1e-4) for name in ("C10", "C01")),
        Variation((plus.case, plus.path), (minus.case, minus.path), h),
    ]
    solution = solve(test.case, test.path, count=COUNT, variations=variations)
    if not solution.converged:
        raise ValueError(f"the truth {solution.reason}")
    rows = solution.variations_at(test.points)
    if kind.part in ("picture", "motion"):
        u = solution.at(test.points)
        rows[2] = (kind.after(u, test, h) - kind.after(u, test, -h)) / (2 * h)
    return rows


def _constant(test: Test, name: str, h: float) -> Variation:
    old = getattr(SILICONE, name)
    a, b = (test.case.with_material(**{name: old + s * h}) for s in (1, -1))
    return Variation((a, test.path), (b, test.path), h)
