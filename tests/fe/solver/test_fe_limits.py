"""What a state says about how far a model reaches: stretch, surfaces that cross, limit points."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from fe import Case, Material, Path, solve
from fe.element import Array
from fe.solver.limits import crossing, largest_stretch
from fe.solver.newton import Problem
from tests.fe.test_fe_closed_forms import sphere

ALONE = np.array([1.0])


def ramp(top: float) -> Path:
    return Path(np.array([0.0, 1.0]), np.array([0.0, top]), ALONE)


def test_the_largest_stretch_is_that_of_a_homogeneous_state(cube: Callable[..., Case]) -> None:
    case = cube((2, 1, 1), shift=0.1)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    F = turn @ np.diag([3.2, 3.2**-0.5, 3.2**-0.5])
    stretch, _ = largest_stretch(Problem.of(case), case.nodes @ F.T - case.nodes)
    assert stretch == pytest.approx(3.2, rel=1e-12)


def rolled(case: Case, height: float) -> Array:
    """Displacements (n, 3) mm of a finger rolled up about an axis `height` mm above its bottom."""
    x, y, z = case.nodes.T
    arm, angle = height - z, x / height
    return np.stack([arm * np.sin(angle) - x, 0 * y, height - arm * np.cos(angle) - z], axis=1)


@pytest.mark.parametrize(("height", "crosses"), [(-60.0, False), (60.0, False), (10.0, True)])
def test_walls_cross_where_the_axis_runs_through_them(short: Case, height: float, crosses: bool) -> None:
    assert (crossing(short, rolled(short, height)) is not None) == crosses


def test_a_finger_at_rest_touches_nothing(short: Case) -> None:
    assert crossing(short, np.zeros_like(short.nodes)) is None


def test_a_balloon_stops_at_its_limit_point() -> None:
    # Neo-Hookean hollow sphere: int 4 C10 (l^-2 + l^-5) dl from the outer to the inner hoop stretch (Ogden
    # 1984, section 5.3) has a maximum. 5 %: two cells through the wall, and steps near the top.
    case = sphere(2)
    inner, outer = np.sort(np.linalg.norm(case.nodes, axis=1))[[0, -1]]

    def pressure(stretch: float) -> float:
        least = (1 + (stretch**3 - 1) * (inner / outer) ** 3) ** (1 / 3)
        return float(quad(lambda x: 4 * 0.2 * (x**-2 + x**-5), least, stretch)[0])

    top = -minimize_scalar(lambda s: -pressure(s), bounds=(1.05, 4.0), method="bounded").fun
    soft = replace(case, materials={"body": Material(C10=0.2, C01=0.0)})
    found = solve(soft, ramp(1.5 * top))
    assert not found.converged
    assert "limit point" in found.reason
    assert found.reached == pytest.approx(top, rel=0.05)
    assert solve(soft, ramp(0.9 * top)).converged


def test_a_finger_far_beyond_its_range_says_why(short: Case) -> None:
    found = solve(short, ramp(0.3))  # p / (C10 + C01) = 1
    assert not found.converged
    assert 0 < found.reached < 0.3
    assert "mm (material laws hold to 3)" in found.reason
    assert "self-contact: walls pass through each other at x" in found.reason


def test_a_converged_finger_says_whether_its_walls_crossed(short: Case) -> None:
    assert solve(short, ramp(0.03)).crossed == ""
    beyond = solve(short, ramp(0.16))
    assert beyond.converged
    assert beyond.crossed.startswith("self-contact: at 0.16 MPa walls pass through each other at x ")
