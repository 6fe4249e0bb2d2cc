"""Round obstacles and obstacles on springs: derivatives of their forces, Hertz, balance, limits of the spring."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Material, Path, Solution, Support, solve
from fe.case import Contact, Spring
from fe.element import Array
from fe.kernel.contact import ObstacleFaces
from fe.obstacles import Flat, Obstacle, Round

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


def pressed(cube: Cube, silicone: Material, obstacle: Obstacle, **more: object) -> Case:
    """A block of 10 x 10 x 5 mm, clamped below, of which a quarter is solved; an obstacle meets its top."""
    case = cube((6, 6, 4), material=silicone, supports=(
        Support("z0", (0, 1, 2)), Support("x0", (0,)), Support("y0", (1,))))  # fmt: skip
    nodes = case.nodes**[2.0, 2.0, 0.5] * [10.0, 10.0, 10.0]  # finer at the corner that is met
    return replace(case, nodes=nodes, contact=Contact("z1", obstacle, 50.0, **more))  # type: ignore[arg-type]


def at_rest(case: Case) -> Solution:
    """The solution under nothing but what the obstacle does."""
    found = solve(case, Path(np.array([0.0, 1.0]), np.zeros(2), np.array([1.0])))
    assert found.reason == "converged"
    return found
