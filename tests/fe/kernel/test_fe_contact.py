"""A plane that the structure cannot pass: closed form, CalculiX, mesh, derivatives, and its kink in pressure."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from fe import Case, Material, Path, Support, Variation, solve
from fe.case import Contact
from fe.element import Array
from fe.engines.calculix import CalculiX
from fe.engines.writer import deck
from fe.kernel.contact import SMOOTH, ObstacleFaces
from fe.mesh.convert import converted
from fe.obstacles import Flat
from fe.solver.curve import trace
from fe.solver.newton import Problem, equilibrium

Cube = Callable[..., Case]
TOP = 0.03  # MPa
UP = (0.0, 0.0, 1.0)


def at_top(case: Case, top: float = TOP) -> Array:
    """Displacements (n, 3) mm of all nodes at a pressure in MPa."""
    solution = solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, top]), np.array([1.0])))
    assert solution.reason == "converged"
    return solution.fields([0])[0]


@pytest.mark.parametrize("kind", ["hex27", "C3D20R", "C3D10"])
@pytest.mark.parametrize("stiffness", [0.5, 20.0])  # past the parabola, and on it
def test_a_block_is_pressed_on_a_plane(cube: Cube, kind: str, stiffness: float) -> None:
    case = cube((2, 2, 2), supports=(Support("x0", (0,)), Support("y0", (1,))))
    lid = np.tile([0.0, 0.0, -0.05], (len(case.node_sets["z1"]), 1))
    case = replace(case, supports=(*case.supports, Support("z1", (2,), lid)))
    case = converted(case, kind) if kind != "hex27" else case
    u = at_top(replace(case, contact=Contact("z0", Flat((0.0, 0.0, 2.0), 0.02), stiffness)), 0.0)
    m = case.materials["body"]

    def gap(depth: float) -> float:
        """Of an incompressible block under uniaxial compression, per area at rest."""
        s = 1 - 0.05 - (0.02 - depth)
        push = stiffness * (depth if depth > SMOOTH / 2 else (depth + SMOOTH / 2) ** 2 / (2 * SMOOTH))
        return push + 2 * (s - s**-2) * (m.C10 + m.C01 / s)

    wanted = 0.02 - brentq(gap, -SMOOTH / 2, 0.07)
    # K = 1000 mu: the block is 1e-3 softer than an incompressible one
    np.testing.assert_allclose(u[case.node_sets["z0"], 2], wanted, rtol=0, atol=1e-4)
    assert at_top(case, 0.0)[case.node_sets["z0"], 2].max() < wanted - 0.001  # without the plane


def test_the_tangent_is_the_derivative_of_the_force(short: Case) -> None:
    rng = np.random.default_rng(3)
    plane = ObstacleFaces(replace(short, contact=Contact("outside", Flat((0.3, -0.2, 1.0), 1.0), 0.7)))
    x = short.nodes + rng.uniform(-0.02, 0.02, short.nodes.shape)
    d, h = rng.normal(size=x.shape), 1e-6
    dofs, K = plane.tangent(x)
    force = -(plane.force(x + h * d) - plane.force(x - h * d)).ravel() / (2 * h)
    ours = np.bincount(dofs.ravel(), (K @ d.ravel()[dofs][..., None]).ravel(), x.size)
    assert np.abs(force).max() > 1.0
    # piecewise quadratic or linear: but for points that pass from one to the other within h
    np.testing.assert_allclose(ours, force, rtol=0, atol=1e-4 * np.abs(force).max())
    np.testing.assert_allclose(K, np.swapaxes(K, 1, 2), atol=0)


def test_newton_converges_quadratically_on_a_plane(short: Case) -> None:
    problem = Problem.of(replace(short, contact=Contact("outside", Flat(UP, -2.0), 0.5)))
    near = equilibrium(problem, trace(problem, np.array([0.0, 0.015, 0.03])).state(0.03), load=0.03)
    assert near.state is not None
    found = equilibrium(problem, near.state, load=0.0302, last=None)
    assert found.reason == "converged"
    assert found.iterations <= 4


@pytest.mark.slow
def test_a_finger_lies_on_the_table(short: Case) -> None:
    row = int(np.flatnonzero(short.labels == 4401)[0])
    assert at_top(short)[row, 2] < -4.0
    tips = []
    for stiffness in (0.1, 1.0, 10.0):
        case = replace(short, contact=Contact("outside", Flat(UP, -2.0), stiffness))
        u = at_top(case)
        tips.append(u[row, 2])
        plane = Problem.of(case).plane
        assert plane is not None
        assert plane.force(case.nodes + u)[:, 2].sum() > 0.1  # N, of the half
        assert not plane.force(case.nodes + u)[:, :2].any()
    # held up higher by what is stiffer, in ever smaller steps; its lowest point is on the plane
    assert tips[0] < tips[1] < tips[2] < tips[1] + 0.2 * (tips[1] - tips[0])
    assert (case.nodes + u)[:, 2].min() == pytest.approx(-2.0, abs=0.1)


def lying(cube: Cube, silicone: Material, n: int, contact: Contact | None) -> Case:
    """A clamped beam of 20 x 2 x 2 mm and its weight, in 5 n x n x n cells."""
    case = cube((5 * n, n, n), material=replace(silicone, density=2e-8), supports=(Support("x0", (0, 1, 2)),))
    return replace(case, nodes=case.nodes * [20.0, 2.0, 2.0], contact=contact)


def sagged(case: Case) -> Array:
    """Displacements (n, 3) mm under the weight."""
    path = Path(np.array([0.0, 1.0]), np.zeros(2), np.array([1.0]), gravity=np.array([0.0, 0.0, -9810.0]))
    solution = solve(case, path, count=1)
    assert solution.reason == "converged"
    return solution.fields([0])[0]


@pytest.mark.slow
def test_the_answer_converges_with_the_mesh(cube: Cube, silicone: Material) -> None:
    pushes, middles = [], []
    for n in (1, 2, 3):
        case = lying(cube, silicone, n, Contact("z0", Flat(UP, -1.0), 1.0))
        u, plane = sagged(case), Problem.of(case).plane
        assert plane is not None
        pushes.append(plane.force(case.nodes + u)[:, 2].sum())
        middle = np.linalg.norm(case.nodes - [12.0, 1.0, 1.0], axis=1).argmin()
        middles.append(u[middle, 2])
    free = sagged(lying(cube, silicone, 2, None))
    assert free[:, 2].min() < -4.0  # mm: a node of the beam's end
    # stiffness is per area: more nodes are in contact and push as much, to 0.3 % from mesh to mesh
    assert abs(pushes[2] - pushes[1]) < min(0.5 * abs(pushes[1] - pushes[0]), 0.005 * pushes[2])
    assert abs(middles[2] - middles[1]) < 0.002 * abs(middles[2])


@pytest.mark.slow
def test_the_curve_follows_the_touch(short: Case) -> None:
    case = replace(short, contact=Contact("outside", Flat(UP, -2.0), 1.0))
    at, output = short.position(4401)[None], np.linspace(0.05, 1.0, 20)
    found = solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, TOP]), output))
    own = [at_top(case, float(q))[short.labels == 4401][0] for q in TOP * output[5::5]]
    # mm: what BENT allows between levels is met at their middles, and less elsewhere
    np.testing.assert_allclose(found.at(at)[5::5, 0], own, rtol=0, atol=2e-3)


def test_derivatives_of_a_touching_finger(stub: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-9)
    heavy, path = (
        stub.with_material(density=1e-9),
        Path(
            np.array([0.0, 1.0]), np.array([0.0, TOP]), np.array([1.0]), gravity=np.array([0.0, 0.0, -9810.0])
        ),
    )
    points = np.array([stub.position(n) for n in (4401, 5848)])

    def test(distance: float, stiffness: float, C10: float) -> Case:
        plane = Contact("outside", Flat((0.1, 0.0, 1.0), distance), stiffness)
        return replace(heavy.with_material(C10=C10), contact=plane)

    at, typical = np.array([0.0, 0.3, 0.214]), np.array([1.0, 0.3, 0.02])
    found = solve(test(*at), path, variations=[
        Variation((test(*(at + h)), path), (test(*(at - h)), path), float(h.max()))
        for h in 1e-6 * np.diag(typical)
    ])  # fmt: skip
    assert found.converged
    for ours, h in zip(found.variations_at(points), np.diag(typical), strict=True):
        values = []
        for step in (1e-3, -1e-3, 2e-3, -2e-3):
            one = solve(test(*(at + step * h)), path, start=found)
            assert one.converged
            values.append(one.at(points))
        theirs = (8 * (values[0] - values[1]) - (values[2] - values[3])) / (12e-3 * h.max())
        assert np.abs(theirs).max() * h.max() > 1e-3  # mm: it is felt
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6 * np.abs(theirs).max())


def test_contact_agrees_with_calculix(cube: Cube, silicone: Material, require: Callable[[str], None]) -> None:
    require("ccx")
    heavy, top, stiffness = replace(silicone, density=2e-8), -0.06, 0.2
    case = cube((3, 2, 2), material=heavy, supports=(Support("x0", (0, 1, 2)),))
    case = converted(replace(case, nodes=case.nodes * [10.0, 3.0, 3.0]), "C3D20R")
    lying = replace(case, contact=Contact("z0", Flat(UP, top), stiffness))
    text = deck(lying, 0.0, gravity=np.array([0.0, 0.0, -9810.0]))
    found = CalculiX().run(text.replace("0.05, 1., 1e-6, 0.1", "0.1, 1., 1e-6, 0.5"))
    assert found.reason == "converged"
    free, ours = sagged(case), sagged(lying)
    effect = np.abs(free - ours).max()
    assert effect > 0.09  # mm, what the plane does, of 0.16
    theirs = np.array([found.at(n) for n in case.labels])
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=0.01 * effect)
