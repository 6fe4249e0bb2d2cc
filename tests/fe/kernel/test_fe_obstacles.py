"""Round obstacles and obstacles on springs: derivatives of their forces, Hertz, balance, limits of the spring."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Material, Path, Solution, Support, Variation, solve
from fe.case import Contact, Spring
from fe.element import Array
from fe.kernel.assembly import State
from fe.kernel.contact import ObstacleFaces
from fe.mesh.mirror import mirrored
from fe.obstacles import Flat, Obstacle, Round
from fe.solver.newton import Problem, equilibrium, imbalance

Cube = Callable[..., Case]
DOWN = (0.0, 0.0, -1.0)
BALL, ROD = Round((0.5, 0.45, -2.0), 2.3), Round((0.4, 0.0, -2.0), 2.3, (0.1, 2.0, 0.0))
SPRING = Spring(0.4, (0.2, 0.1, -1.0))


def moved(faces: ObstacleFaces, x: Array, d: Array) -> Array:
    """Minus the change (n, 3) N of the forces along d (n, 3) mm, by differences."""
    h = 1e-6
    return -(faces.force(x + h * d) - faces.force(x - h * d)) / (2 * h)


@pytest.mark.parametrize("spring", [None, SPRING], ids=["fixed", "sprung"])
@pytest.mark.parametrize(("friction", "slide"), [(0.0, 0.2), (0.5, 0.005), (0.5, 0.2)])  # sticks; slides
@pytest.mark.parametrize("obstacle", [Flat((0.1, -0.2, 1.0), 0.3), BALL, ROD], ids=["flat", "ball", "rod"])
def test_the_tangent_is_the_derivative_of_the_force(
    cube: Cube, obstacle: Obstacle, friction: float, slide: float, spring: Spring | None
) -> None:
    case = replace(cube((2, 2, 1), shift=0.05), contact=Contact("z0", obstacle, 0.7, friction, spring))
    rng = np.random.default_rng(5)
    before = case.nodes + rng.uniform(-0.001, 0.001, case.nodes.shape)
    faces = ObstacleFaces(case).after(before)
    x = before + [slide, 0.3 * slide, 0.0] + rng.uniform(-0.001, 0.001, case.nodes.shape)
    d = rng.normal(size=x.shape)
    wanted = moved(faces, x, d)
    assert np.abs(wanted).max() > 0.01  # N/mm
    np.testing.assert_allclose(-faces.change(x, d), wanted, rtol=0, atol=2e-6 * np.abs(wanted).max())
    K = faces.tangent(x)[1]
    np.testing.assert_allclose(K, np.swapaxes(K, 1, 2), atol=1e-15)


def test_a_ball_is_met_along_its_normal(cube: Cube) -> None:
    faces = ObstacleFaces(replace(cube((2, 2, 1)), contact=Contact("z0", BALL, 0.7)))
    x = cube((2, 2, 1)).nodes
    force = faces.force(x)
    arm = x - BALL.centre
    touched = np.abs(force).max(axis=1) > 1e-3
    assert touched.sum() > 5
    # no moment about the centre: each pressure points at it
    assert np.abs(np.cross(arm, force).sum(axis=0)).max() < 1e-12
    assert (force[touched, 2] > 0).all()


def test_a_ball_on_a_thick_sheet_is_as_hertz_has_it(cube: Cube, silicone: Material) -> None:
    """Hertz (1882, doi 10.1515/crll.1882.92.156), for a bonded incompressible sheet of 60 mm (Dimitriadis and
    others 2002, doi 10.1016/S0006-3495(02)75620-8)."""
    R, depth, thick = 20.0, 0.2, 60.0
    quarter = cube((7, 7, 5), material=silicone, supports=(
        Support("z0", (0, 1, 2)), Support("x0", (0,)), Support("y0", (1,))))  # fmt: skip
    t = quarter.nodes
    nodes = thick * np.stack([t[:, 0] ** 2, t[:, 1] ** 2, 1 - (1 - t[:, 2]) ** 2], axis=1)
    ball = Round((0.0, 0.0, thick + R - depth), R)
    top = quarter.surfaces["z1"]
    near = top[(nodes[quarter.connectivity[top[:, 0]]].max(axis=1)[:, :2] < 10.0).all(axis=1)]
    case = replace(
        quarter, nodes=nodes, surfaces={**quarter.surfaces, "near": near},
        contact=Contact("near", ball, 100.0),
    )  # fmt: skip
    found = solve(case, Path(np.array([0.0, 1.0]), np.zeros(2), np.array([1.0])), count=1)
    assert found.reason == "converged"
    E, chi = 3 * silicone.shear / 0.75, np.sqrt(R * depth) / thick
    hertz = 4 / 3 * E * np.sqrt(R) * depth**1.5 * (1 + 1.133 * chi + 1.283 * chi**2)
    # the half model that is known is that across y; of the other half the quarter's force is doubled here.
    # 3 %: 2 across the edge of contact with elements as large, 1 of a depth of 1 % of the radius
    assert 2 * found.contact_force[0, 2] == pytest.approx(-hertz, rel=0.03)


UNDER = Round((9.0, 0.0, -5.1), 5.0, (0.0, 1.0, 0.0))
SIDEWAYS = Spring(0.4, (0.3, 0.0, -1.0))
TOP = 2e-3  # MPa, bends the bar by 1 mm


def bar(cube: Cube, obstacle: Obstacle, *, friction: float = 0.0, spring: Spring | None = None) -> Case:
    """Half of a bar of 12 x 3 x 3 mm, clamped at x0 and bent by the pressure on its top onto an obstacle."""
    case = cube((3, 1, 1), supports=(Support("x0", (0, 2)), Support("y0", (1,))), pressurised="z1")
    contact = Contact("z0", obstacle, 5.0, friction, spring)
    return replace(case, nodes=case.nodes * [12.0, 1.5, 3.0], contact=contact)


def at_top(case: Case) -> Solution:
    found = solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, TOP]), np.array([1.0])), count=2)
    assert found.reason == "converged"
    return found


def test_the_support_bears_what_pressure_and_rod_do(cube: Cube) -> None:
    case = bar(cube, UNDER)
    found = at_top(case)
    problem, curve = Problem.of(case), found.curves[0]
    state = State(curve.u[-1], curve.p[-1])
    x, held = case.nodes + state.u, case.node_sets["x0"]
    borne = imbalance(problem, state, TOP, None).force
    pressed = TOP * problem.kernel.pressure.force(x)
    there = (borne[held].sum(axis=0) + pressed.sum(axis=0))[[0, 2]]
    assert found.contact_force[0, 2] > 0.01  # N
    # of the half; Newton leaves 1e-7 of the bar's size in its displacements
    ours = found.contact_force[0]
    np.testing.assert_allclose(there, -ours[[0, 2]] / 2, atol=1e-4 * np.abs(ours).max())


def test_a_whole_model_bears_twice_what_its_half_does(cube: Cube) -> None:
    case = bar(cube, UNDER, spring=SIDEWAYS)
    ours, theirs = at_top(case), at_top(mirrored(case))
    assert ours.contact_force[0, 2] > 0.01  # N
    # Newton leaves 1e-7 of 12 mm, times 5 MPa/mm and 10 mm2
    np.testing.assert_allclose(ours.contact_force, theirs.contact_force, atol=6e-5)


def test_a_stiff_spring_holds_the_rod_and_a_soft_one_lets_it_go(cube: Cube) -> None:
    def push(stiffness: float | None) -> float:
        spring = None if stiffness is None else Spring(stiffness, DOWN)
        return float(at_top(bar(cube, UNDER, spring=spring)).contact_force[0, 2])

    fixed, stiff, softer, soft = map(push, (None, 1e6, 0.01, 1e-6))
    assert stiff == pytest.approx(fixed, rel=1e-5)
    assert 0.1 * fixed < softer < 0.95 * fixed
    assert 0 < soft < 2 * 1e-6 * 2.0  # N: it is in balance, and no point of the bar moves by 2 mm


@pytest.mark.parametrize("friction", [0.0, pytest.param(0.4, marks=pytest.mark.slow)])
def test_the_force_of_contact_has_the_derivatives_of_whole_solves(
    cube: Cube, friction: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-9)
    path = Path(np.array([0.0, 1.0]), np.array([0.0, TOP]), np.array([1.0]))

    def test(C10: float, radius: float) -> Case:
        ball = Round((9.0, 0.0, -5.1), radius)
        return bar(cube, ball, friction=friction, spring=SIDEWAYS).with_material(C10=C10)

    at, typical = np.array([0.214, 5.0]), np.array([0.02, 0.1])
    found = solve(test(*at), path, count=2, variations=[
        Variation((test(*(at + h)), path), (test(*(at - h)), path), float(h.max()))
        for h in 1e-6 * np.diag(typical)
    ])  # fmt: skip
    assert found.contact_force[0, 2] > 0.01  # N
    for ours, h in zip(found.contact_variations[:, 0], 1e-3 * np.diag(typical), strict=True):
        plus, minus = (solve(test(*(at + s * h)), path, count=2).contact_force[0] for s in (1, -1))
        theirs = (plus - minus) / (2 * h.max())
        assert np.abs(theirs).max() * 1e3 * h.max() > 1e-4  # N: it is felt
        # differences over steps of 1e-3 of what is typical
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-3 * np.abs(theirs).max())
