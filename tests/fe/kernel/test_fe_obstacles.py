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
    """Hertz (1882, doi 10.1515/crll.1882.92.156), for a bonded incompressible sheet of 100 mm (Dimitriadis and
    others 2002, doi 10.1016/S0006-3495(02)75620-8)."""
    R, depth, thick = 20.0, 0.2, 100.0
    quarter = cube((7, 7, 5), material=silicone, supports=(
        Support("z0", (0, 1, 2)), Support("x0", (0,)), Support("y0", (1,))))  # fmt: skip
    t = quarter.nodes
    nodes = thick * np.stack([t[:, 0] ** 3, t[:, 1] ** 3, 1 - (1 - t[:, 2]) ** 3], axis=1)
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


ROD_BELOW = Round((38.0, 0.0, -12.0), 10.0, (0.0, 1.0, 0.0))
TOP = 0.03  # MPa


def lying(short: Case, **more: object) -> Case:
    """A short finger that bends onto a rod."""
    return replace(short, contact=Contact("outside", ROD_BELOW, 5.0, **more))  # type: ignore[arg-type]


def at_top(case: Case) -> Solution:
    found = solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, TOP]), np.array([1.0])))
    assert found.reason == "converged"
    return found


def test_the_clamp_bears_what_pressure_and_rod_do(short: Case) -> None:
    case = lying(short)
    found = at_top(case)
    problem, curve = Problem.of(case), found.curves[0]
    state = State(curve.u[-1], curve.p[-1])
    x, clamp = case.nodes + state.u, problem.kernel.clamped
    borne = imbalance(problem, state, TOP, None).force
    pressed = TOP * problem.kernel.pressure.force(x)
    reaction = borne[clamp].sum(axis=0), np.cross(x[clamp], borne[clamp]).sum(axis=0)
    load = pressed.sum(axis=0), np.cross(x, pressed).sum(axis=0)
    assert found.contact_force[0, 2] > 0.4  # N
    for ours, there, own, rows in (
        (found.contact_force[0], reaction[0], load[0], [0, 2]), (found.contact_moment[0], reaction[1], load[1], [1])
    ):  # fmt: skip
        # of the half; Newton leaves 1e-7 of the finger's size in its displacements
        np.testing.assert_allclose((there + own)[rows], -ours[rows] / 2, atol=1e-4 * np.abs(ours).max())


def test_a_whole_model_bears_twice_what_its_half_does(short: Case) -> None:
    case = lying(short)
    for half, whole in zip(_touch(at_top(case)), _touch(at_top(mirrored(case))), strict=True):
        np.testing.assert_allclose(half, whole, atol=1e-4 * np.abs(whole).max())


def _touch(found: Solution) -> tuple[Array, Array]:
    return found.contact_force[0], found.contact_moment[0]


def test_a_stiff_spring_holds_the_rod_and_a_soft_one_lets_it_go(short: Case) -> None:
    fixed = at_top(lying(short)).contact_force[0, 2]
    pushes = [at_top(lying(short, spring=Spring(k, DOWN))).contact_force[0, 2] for k in (1e6, 1.0, 1e-3)]
    assert pushes[0] == pytest.approx(fixed, rel=1e-5)
    assert 0.1 * fixed < pushes[1] < 0.95 * fixed
    # in equilibrium with its spring: it cannot go further than the free finger's tip, 6 mm, in a half model
    assert pushes[2] < 2 * 1e-3 * 6.0


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_the_force_of_contact_has_the_derivatives_of_whole_solves(
    stub: Case, friction: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-9)
    path = Path(np.array([0.0, 1.0]), np.array([0.0, TOP]), np.array([1.0]))

    def test(C10: float, radius: float) -> Case:
        ball = Round((18.0, 0.0, -5.5), radius)
        return replace(stub.with_material(C10=C10), contact=Contact("outside", ball, 5.0, friction, SPRING))

    at, typical = np.array([0.214, 5.0]), np.array([0.02, 0.1])
    found = solve(test(*at), path, count=3, variations=[
        Variation((test(*(at + h)), path), (test(*(at - h)), path), float(h.max()))
        for h in 1e-6 * np.diag(typical)
    ])  # fmt: skip
    assert found.contact_force[0, 2] > 0.05  # N
    for ours, h in zip(found.contact_variations[:, 0], 1e-3 * np.diag(typical), strict=True):
        plus, minus = (solve(test(*(at + s * h)), path, count=3).contact_force[0] for s in (1, -1))
        theirs = (plus - minus) / (2 * h.max())
        # differences over steps of 1e-3 of what is typical; with friction, points change to sliding in between
        near = 1e-4 if friction == 0 else 1e-2
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=near * np.abs(theirs).max())
