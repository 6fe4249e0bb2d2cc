"""Friction along paths that rise and fall: closed forms of a held bar, steps, derivatives, gravity that turns."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import fe.path
from fe import Case, Path, Solution, Support, Variation, solve
from fe.case import Contact
from fe.kernel.contact import ObstacleFaces
from fe.obstacles import Flat
from fe.solver.newton import equilibrium
from tests.fe.conftest import SILICONE

Cube = Callable[..., Case]
UP = (0.0, 0.0, 1.0)
TIME = np.arange(5.0)
CYCLES = np.array([0.0, 0.04, 0.0, 0.04, 0.0])  # MPa


def solved(case: Case, path: Path, variations: tuple[Variation, ...] = ()) -> Solution:
    found = solve(case, path, variations=variations)
    assert found.reason == "converged"
    return found


def shoe(cube: Cube, friction: float) -> Case:
    """A bar of 12 x 1 x 1 mm, its top guided, pushed at x1; its last 2 mm are pressed on a plane."""
    case = cube((6, 1, 1), supports=(Support("x0", (0,)), Support("y0", (1,))), pressurised="x1")
    nodes = case.nodes * [12.0, 1.0, 1.0]
    down = np.zeros((len(case.node_sets["z1"]), 3))
    down[:, 2] = -0.01 * nodes[case.node_sets["z1"], 0]
    return replace(
        case,
        nodes=nodes,
        surfaces={**case.surfaces, "sole": case.surfaces["z0"][-1:]},
        supports=(*case.supports, Support("z1", (2,), down)),
        contact=Contact("sole", Flat(UP, -0.01), 0.2, friction),
    )


def shift(x: float, force: float, *, share: float = 1.0) -> float:
    """Closed form: what a force N in its axis adds to the displacement x mm of a place 8 mm along the bar,
    of 1 mm2 and incompressible, `share` of its moduli left."""

    def stress(stretch: float) -> float:
        return share * 2 * (stretch - stretch**-2) * (SILICONE.C10 + SILICONE.C01 / stretch)

    start = 1 + x / 8
    return 8 * (brentq(lambda s: stress(s) - stress(start) - force, 0.5, 1.5) - start)


def test_a_shoe_is_held_by_mu_n_both_ways_and_a_cycle_dissipates(cube: Cube) -> None:
    mu, stiffness, area = 0.2, 0.2, 2.0
    case, path = shoe(cube, mu), Path(TIME, CYCLES, np.linspace(2.0, 4.0, 101))
    none = replace(case, contact=Contact("sole", Flat(UP, -0.01), stiffness))
    found, free, plane = solved(case, path), solved(none, path), ObstacleFaces(case)
    pressure, u, rest = path.at_output(), found.fields(range(101)), free.fields(range(101))
    before = np.linalg.norm(case.nodes - [8.0, 0.5, 0.5], axis=1).argmin()  # the sole begins at 10 mm
    x, x_free, end = u[:, before, 0], rest[:, before, 0], u[:, case.node_sets["x1"], 0].mean(axis=1)
    R = mu * np.array([plane.force(case.nodes + v)[:, 2].sum() for v in u])  # N
    K = -0.04 / (x_free[50] - x_free[0])  # N/mm, the end face being of 1 mm2
    # what has slid moves as if pushed by R less, or by R more on its way back; 3 %: friction acts at its edge
    for k, way in [(30, 1), (40, 1), (50, 1), (80, -1), (90, -1), (100, -1)]:
        assert x[k] - x_free[k] == pytest.approx(shift(x_free[k], way * R[k]), rel=0.03)
    # the middle of the sole is at 11 mm, where R, spread over 2 mm, does 10.75 / 11 of what it would at once
    far = 11 / 8 * (0.04 - 10.75 / 11 * (R[0] + R[50])) / K
    slid = far - 2 * R.mean() / (stiffness * area)  # less what is elastic slip
    work = -np.sum((pressure[1:] + pressure[:-1]) / 2 * np.diff(end))  # N mm, from trough to trough
    assert work == pytest.approx(2 * R.mean() * slid, rel=0.03)
    assert np.abs(u[100] - u[0]).max() < 1e-4  # mm: the loop is closed


def bar(cube: Cube, friction: float) -> Case:
    """A bar of 12 x 3 x 3 mm, clamped at x0, pressed on a plane by the pressure on its top: it widens."""
    case = cube((4, 2, 2), supports=(Support("x0", (0, 1, 2)),), pressurised="z1")
    nodes = case.nodes * [12.0, 3.0, 3.0]
    return replace(case, nodes=nodes, contact=Contact("z0", Flat(UP, -0.004), 1.0, friction))


PRESSED = Path(TIME, np.array([0.0, 0.02, 0.008, 0.02, 0.0]), np.linspace(0.25, 4.0, 16))


@pytest.mark.slow
def test_half_the_steps_leave_a_quarter_of_the_error(cube: Cube, monkeypatch: pytest.MonkeyPatch) -> None:
    fields, path = [], Path(TIME, CYCLES, np.linspace(0.1, 4.0, 40))
    for steps in (6, 12, 24, 48):
        monkeypatch.setattr(fe.path, "SOFT_RAMP", steps)
        fields.append(solved(shoe(cube, 0.2), path).fields(range(40)))
    far = [float(np.sqrt(np.mean((f - fields[-1]) ** 2))) for f in fields[:-1]]
    assert far[2] < 0.4 * far[1] < 0.16 * far[0]
    assert far[1] < 2e-4  # mm rms, of 0.16 mm


@pytest.mark.slow
def test_a_pressed_bar_comes_back(cube: Cube) -> None:
    rise = solved(bar(cube, 0.4), Path(np.array([0.0, 1.0]), np.array([0.0, 0.02]), np.array([0.5, 1.0])))
    effect = np.abs(solved(bar(cube, 0.0), PRESSED).fields([3]) - rise.fields([1])).max()
    assert effect > 0.03  # mm
    cycled = solved(bar(cube, 0.4), PRESSED).fields(range(16))
    # as a path that only rises, where slip takes other steps
    np.testing.assert_allclose(cycled[[1, 3]], rise.fields([0, 1]), rtol=0, atol=2e-3 * effect)
    case = bar(cube, 0.4)
    above = replace(case, contact=replace(case.contact, obstacle=Flat(UP, -0.01)))
    assert np.abs(solved(above, PRESSED).fields([15])).max() < 1e-7  # off the plane nothing is left of it


@pytest.mark.parametrize(("pull", "slides"), [(1000.0, False), (60_000.0, True)])
def test_gravity_that_turns_leaves_what_has_slid(cube: Cube, pull: float, slides: bool) -> None:
    case = shoe(cube, 0.2).with_material(density=1e-7)  # pulled by 0.0012 and 0.072 N
    gravity = np.array([[0.0, 0.0, 0.0], [pull, 0.0, 0.0], [0.0, 0.0, 0.0]])
    path = Path(np.arange(3.0), np.zeros(3), np.arange(3.0), gravity=gravity)
    u = solved(case, path).fields(range(3))
    before = np.linalg.norm(case.nodes - [8.0, 0.5, 0.5], axis=1).argmin()
    left, far = u[2, before, 0] - u[0, before, 0], u[1, before, 0] - u[0, before, 0]
    if not slides:
        assert far > 1e-3
        assert abs(left) < 1e-6
        return
    free = solved(replace(case, contact=Contact("sole", Flat(UP, -0.01), 0.2)), path).fields([2])[0]
    R = 0.2 * ObstacleFaces(case).force(case.nodes + u[2])[:, 2].sum()  # N
    # it is drawn back until friction holds what is left
    assert u[2, before, 0] - free[before, 0] == pytest.approx(shift(free[before, 0], R), rel=0.01)


def test_without_friction_nothing_changes_but_its_derivative_is_there(cube: Cube) -> None:
    path, h, point = Path(TIME, CYCLES, np.linspace(0.5, 4.0, 8)), 1e-6, np.array([[11.0, 0.5, 0.5]])

    def test(friction: float) -> tuple[Case, Path]:
        return shoe(cube, friction), path

    alone = solved(*test(0.0))
    found = solved(*test(0.0), variations=(Variation(test(h), test(-h), h),))
    np.testing.assert_array_equal(found.fields(range(8)), alone.fields(range(8)))
    slope = (solved(*test(1e-3)).at(point) - alone.at(point)) / 1e-3
    ours = found.variations_at(point)[0]
    assert slope[1, 0, 0] > 0.2 > -0.2 > slope[3, 0, 0]  # held back both ways
    # where the path turns it sticks for a moment, the shorter the less friction: at its corners only
    np.testing.assert_allclose(ours[1::2], slope[1::2], rtol=0, atol=0.01 * np.abs(slope).max())


@pytest.mark.slow
def test_derivatives_along_a_path_are_those_of_whole_solves(
    stub: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-9)
    monkeypatch.setattr(fe.path, "SOFT_RAMP", 4)
    points = np.array([stub.position(n) for n in (4401, 5848)])
    path = Path(np.arange(3.0), np.array([0.0, 0.03, 0.02]), np.array([1.0, 2.0]))

    def test(friction: float, C10: float) -> tuple[Case, Path]:
        plane = Contact("outside", Flat((0.1, 0.0, 1.0), 1.0), 0.3, friction)
        return replace(stub.with_material(C10=C10), contact=plane), path

    at, directions = np.array([0.4, 0.214]), np.eye(2)
    found = solved(*test(*at), variations=tuple(
        Variation(test(*(at + 1e-6 * d)), test(*(at - 1e-6 * d)), 1e-6) for d in directions
    ))  # fmt: skip
    for ours, d in zip(found.variations_at(points), directions, strict=True):
        plus, minus = (solved(*test(*(at + h * d))).at(points) for h in (3e-5, -3e-5))
        theirs = (plus - minus) / 6e-5
        assert np.abs(theirs).max() > 0.01  # mm per unit: it is felt
        # whole solves within 1e-9 of 21 mm over steps of 6e-5; no point begins to slide in between
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=5e-6 * np.abs(theirs).max())


def test_friction_and_creep_are_followed_together(cube: Cube) -> None:
    """A held push of a creeping bar goes on as its law does, less what friction holds."""
    path = Path(np.array([0.0, 1.0, 60.0]), np.array([0.0, 0.04, 0.04]), np.array([1.0, 60.0]))
    creeping, plain = (c.with_material(prony=((0.2, 5.0),)) for c in (shoe(cube, 0.2), shoe(cube, 0.0)))
    u, free = (solved(c, path).fields(range(2)) for c in (creeping, plain))
    before = np.linalg.norm(creeping.nodes - [8.0, 0.5, 0.5], axis=1).argmin()
    R = 0.2 * ObstacleFaces(creeping).force(creeping.nodes + u[1])[:, 2].sum()
    assert u[1, before, 0] < u[0, before, 0] - 0.02  # mm: it creeps, and slides on
    wanted = shift(free[1, before, 0], R, share=0.8)
    assert (u - free)[1, before, 0] == pytest.approx(wanted, rel=0.03)
