"""Friction on a plane: the law's derivative, closed forms of a block, CalculiX, derivatives. Paths: test_fe_friction_path.py."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Path, Solution, Support, Variation, solve
from fe.case import Contact
from fe.engines.calculix import CalculiX
from fe.kernel.contact import ObstacleFaces
from fe.mesh.convert import converted
from fe.obstacles import Flat
from fe.solver.newton import Problem, equilibrium

Cube = Callable[..., Case]
UP = (0.0, 0.0, 1.0)
MU = 0.4


def rising(top: float) -> Path:
    """Pressure rises to `top` MPa, four outputs."""
    return Path(np.array([0.0, 1.0]), np.array([0.0, top]), np.linspace(0.25, 1.0, 4))


PUSH = rising(0.02)


@pytest.mark.parametrize("slide", [0.005, 0.2])  # all sticks; all slides
def test_tangent_and_coupling_are_the_derivative_of_the_force(cube: Cube, slide: float) -> None:
    case = cube((2, 2, 1), shift=0.05)
    case = replace(case, contact=Contact("z0", Flat((0.1, -0.2, 1.0), 0.3), 0.7, 0.5))
    rng = np.random.default_rng(5)
    plane = ObstacleFaces(case)
    before = case.nodes + rng.uniform(-0.001, 0.001, case.nodes.shape)
    plane = plane.after(before)
    x = before + [slide, 0.3 * slide, 0.0] + rng.uniform(-0.001, 0.001, case.nodes.shape)
    d, h = rng.normal(size=x.shape), 1e-6
    ours = np.zeros(x.size)
    pairs = [plane.tangent(x), *plane.coupling(x)]
    assert (len(pairs) == 1) == (slide < 0.01)
    np.testing.assert_allclose(pairs[0][1], np.swapaxes(pairs[0][1], 1, 2), atol=1e-15)
    for pair in pairs:
        ours += np.bincount(pair[0].ravel(), (pair[1] @ d.ravel()[pair[0]][..., None]).ravel(), x.size)
    force = -(plane.force(x + h * d) - plane.force(x - h * d)).ravel() / (2 * h)
    np.testing.assert_allclose(ours, force, rtol=0, atol=1e-6 * np.abs(force).max())


def test_what_has_slid_comes_back_elastically(cube: Cube) -> None:
    case = replace(cube((2, 2, 1)), contact=Contact("z0", Flat(UP, 0.05), 0.7, MU))
    rest, there, back = (case.nodes + [x, 0.0, 0.0] for x in (0.0, 0.2, 0.199))
    plane = ObstacleFaces(case)
    normal = 0.7 * 0.05  # N on 1 mm2
    assert not plane.force(rest)[:, :2].any()
    slid = plane.after(there)
    np.testing.assert_allclose(slid.force(there), plane.force(there), atol=1e-14)
    np.testing.assert_allclose(slid.force(there).sum(axis=0), [-MU * normal, 0.0, normal], atol=1e-12)
    assert slid.force(back)[:, 0].sum() == pytest.approx(-MU * normal + 0.7 * 0.001)
    lifted = slid.after(there + [0.0, 0.0, 1.0])  # off the plane it forgets
    assert lifted.force(there)[:, 0].sum() == pytest.approx(0.0, abs=1e-12)


def block(cube: Cube, *, friction: float, stiffness: float = 2.0) -> Case:
    """A block of 1 x 1 x 1 mm, its lid pressed down by 0.05 mm and free to go along x, pushed at x0."""
    case = cube((2, 2, 2), supports=(Support("y0", (1,)), Support("y1", (1,))), pressurised="x0")
    lid = np.tile([0.0, 0.0, -0.05], (len(case.node_sets["z1"]), 1))
    contact = Contact("z0", Flat(UP, 0.02), stiffness, friction)
    return replace(case, supports=(*case.supports, Support("z1", (2,), lid)), contact=contact)


def test_a_pushed_block_sticks_below_mu_n_and_slides_at_it(cube: Cube) -> None:
    case = block(cube, friction=MU)
    found = solve(case, rising(0.2))
    assert not found.converged  # nothing but friction holds it
    curve, problem = found.curves[0], Problem.of(case)
    for q, u in zip(curve.pressure, curve.u, strict=True):
        assert problem.plane is not None
        force = problem.plane.force(case.nodes + u).sum(axis=0)
        push = q * problem.kernel.pressure.force(case.nodes + u)[:, 0].sum()
        problem = problem.after(u)
        assert force[0] == pytest.approx(-push, abs=1e-6)  # N: what sticks balances the push
    limit = MU * force[2]
    # the last push is below mu N, and as near to it as the least step of pressure, 1/64 of 0.2 MPa on 1 mm2
    assert limit - 0.2 / 64 < push <= limit * (1 + 1e-6)
    assert abs(u[case.node_sets["z0"], 0]).max() < 0.03  # mm: an elastic slip


@pytest.mark.parametrize("friction", [0.1, MU])
def test_a_dragged_block_slides_at_mu_n(cube: Cube, friction: float) -> None:
    case = block(cube, friction=friction)
    lid = np.tile([0.3, 0.0, -0.05], (len(case.node_sets["z1"]), 1))
    case = replace(case, supports=(*case.supports[:2], Support("z1", (0, 2), lid[:, :])))
    u = solve(case, Path(np.array([0.0, 1.0]), np.zeros(2), np.array([1.0]))).fields([0])[0]
    force = ObstacleFaces(case).force(case.nodes + u).sum(axis=0)
    assert force[2] > 0.05  # N
    assert force[0] == pytest.approx(-friction * force[2], rel=1e-9)


def bar(cube: Cube, friction: float, *, n: int = 2) -> Case:
    """A bar of 12 x 3 x 3 mm, clamped at x0, pressed on a plane by the pressure on its top: it widens."""
    case = cube((2 * n, n, n), supports=(Support("x0", (0, 1, 2)),), pressurised="z1")
    return replace(case, nodes=case.nodes * [12.0, 3.0, 3.0], contact=Contact("z0", Flat(UP, -0.01), 1.0, friction))


def solved(case: Case, path: Path = PUSH, count: int = 12) -> Solution:
    found = solve(case, path, count=count)
    assert found.reason == "converged"
    return found


@pytest.mark.slow
def test_the_answer_converges_with_mesh_and_levels(cube: Cube) -> None:
    end = np.array([[12.0, 1.5, 1.5]])
    ends = [solved(bar(cube, MU, n=n)).at(end)[-1, 0] for n in (2, 3, 4)]
    effect = np.linalg.norm(solved(bar(cube, 0.0, n=3)).at(end)[-1, 0] - ends[1])
    assert effect > 0.03  # mm
    change = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    assert change[1] < min(0.5 * change[0], 0.01 * effect)
    fine = solved(bar(cube, MU), count=48).fields([-1])[0]
    assert np.abs(fine - solved(bar(cube, MU)).fields([-1])[0]).max() < 0.01 * effect


def test_friction_goes_to_nothing_in_proportion(cube: Cube) -> None:
    none, little, less = (solved(bar(cube, mu)).fields([-1])[0] for mu in (0.0, 2e-4, 1e-4))
    far = np.abs(little - none).max()
    assert 1e-5 < far < 1e-3  # mm
    np.testing.assert_allclose(2 * (less - none), little - none, rtol=0, atol=0.05 * far)


def test_newton_converges_quadratically_where_it_slides(cube: Cube) -> None:
    case = bar(cube, MU)
    curve, problem = solved(case).curves[0], Problem.of(case)
    for u in curve.u:
        problem = problem.after(u)
    assert problem.plane is not None
    assert problem.plane.coupling(case.nodes + 1.01 * curve.u[-1])
    found = equilibrium(problem, curve.state(0.02), load=0.0202)
    assert found.reason == "converged"
    assert found.iterations <= 5


@pytest.mark.slow
def test_derivatives_are_those_of_whole_solves(stub: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-9)
    points, path = np.array([stub.position(n) for n in (4401, 5848)]), rising(0.03)

    def test(friction: float, stiffness: float, C10: float) -> Case:
        plane = Contact("outside", Flat((0.1, 0.0, 1.0), 1.0), stiffness, friction)
        return replace(stub.with_material(C10=C10), contact=plane)

    at, typical = np.array([MU, 0.3, 0.214]), np.array([0.3, 0.3, 0.1])
    found = solve(test(*at), path, variations=[
        Variation((test(*(at + h)), path), (test(*(at - h)), path), float(h.max()))
        for h in 1e-6 * np.diag(typical)
    ], count=6)  # fmt: skip
    assert found.converged
    for ours, h in zip(found.variations_at(points)[:, -1], np.diag(typical), strict=True):
        plus, minus = (solved(test(*(at + sign * 1e-4 * h)), path, count=6).at(points)[-1] for sign in (1, -1))
        theirs = (plus - minus) / (2e-4 * h.max())
        assert np.abs(theirs).max() * h.max() > 1e-3  # mm: it is felt
        # whole solves within 1e-9 of 21 mm, over steps of 1e-4; which points slide does not change in between
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-5 * np.abs(theirs).max())


def test_a_plane_that_is_not_touched_needs_no_path(cube: Cube) -> None:
    falls = Path(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.005, 0.0025]), np.array([1.0, 2.0]))
    away = solved(replace(bar(cube, MU), contact=Contact("z0", Flat(UP, -9.0), 1.0, MU)), falls)
    assert away.history is None
    assert solved(bar(cube, MU), falls).history is not None
    assert solved(bar(cube, MU), replace(falls, output=np.array([0.5, 1.0]))).history is None  # before it falls


@pytest.mark.parametrize("friction", [-0.1, float("nan")])
def test_friction_that_is_none_is_refused(cube: Cube, friction: float) -> None:
    with pytest.raises(ValueError, match=f"friction {friction}: wanted a coefficient of 0 or more"):
        solve(bar(cube, friction), PUSH)


def test_friction_agrees_with_calculix(cube: Cube, require: Callable[[str], None]) -> None:
    require("ccx")
    case = bar(cube, MU)
    contact, case = case.contact, converted(replace(case, contact=None), "C3D20R")
    assert contact is not None
    free, ours = (
        solved(replace(case, contact=replace(contact, friction=mu))).fields([-1])[0] for mu in (0.0, MU)
    )
    effect = np.abs(free - ours).max()
    assert effect > 0.05  # mm, what friction does, of 0.06
    found = CalculiX().solve(replace(case, contact=contact), 0.02)
    assert found.reason == "converged"
    theirs = np.array([found.at(n) for n in case.labels])
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=0.02 * effect)
