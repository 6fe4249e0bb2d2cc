"""`solve`: failures are values, scaling and symmetry hold, points are found, the clamp and the history
behave."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Block, Case, Clamp, Finger, Lattice, Material, Path, finger_case, solve
from fe.element import Array
from fe.mesh import mirror
from fe.mesh.convert import converted
from fe.mesh.points import interpolation, nearest
from fe.path import FIRST, STEP, corners, equivalent, in_time, knots, levels
from fe.solver.newton import Problem, equilibrium

LAST = np.array([1.0])


def ramp(top: float) -> Path:
    return Path(time=np.array([0.0, 1.0]), pressure=np.array([0.0, top]), output=LAST)


def test_a_pressure_beyond_the_limit_is_a_value_with_a_reason(short: Case) -> None:
    solution = solve(short, ramp(3.0))
    assert not solution.converged
    assert "stopped at" in solution.reason
    assert "MPa of 3" in solution.reason
    assert 0 < solution.reached < 3.0
    assert len(solution.curves[0].pressure) == len(solution.curves[0].u)  # what was reached is kept


def test_a_creeping_case_beyond_the_limit_is_a_value_with_a_reason(cube: Callable[..., Case]) -> None:
    case = cube((1, 1, 1), material=Material(0.2, 0.1, prony=((0.99, 0.01),)), pressurised="x1")
    case = replace(case, clamp=Clamp("x0", (0.0, 0.5)))
    solution = solve(case, ramp(20.0))
    assert not solution.converged
    assert "stopped at" in solution.reason


def test_scaling_stiffness_and_pressure_together_changes_nothing(short: Case) -> None:
    # u depends on p / C10 and C01 / C10 alone, K / mu being fixed
    soft = solve(short, ramp(0.02))
    stiff = solve(short.with_material(C10=0.214 * 1.5, C01=0.083 * 1.5), ramp(0.03))
    np.testing.assert_allclose(stiff.fields([0]), soft.fields([0]), atol=1e-9)
    assert np.abs(soft.fields([0])).max() > 1.0


def test_a_start_nearby_saves_iterations_and_changes_nothing() -> None:
    soft = finger_case(
        Material(C10=0.214, C01=0.083), lattice=Lattice(per_bellow=2, ring=False, centred=False)
    )  # bends enough to need them
    first = solve(soft, ramp(0.02))
    near = soft.with_material(C10=0.216)
    cold, warm = solve(near, ramp(0.02)), solve(near, ramp(0.02), start=first)
    assert warm.iterations < cold.iterations
    np.testing.assert_allclose(
        warm.fields([0]), cold.fields([0]), atol=1e-7
    )  # TOLERANCE squared, times 110 mm


def test_a_start_that_leads_astray_is_left_where_it_fails(short: Case) -> None:
    path = Path(time=np.array([0.0, 1.0]), pressure=np.array([0.0, 0.02]), output=np.linspace(0.0, 1.0, 5))
    cold = solve(short, path)
    (curve,) = cold.curves
    astray = np.where(curve.pressure > 0.012, 9.0, 1.0)[:, None, None]
    bad = replace(cold, curves=(replace(curve, u=astray * curve.u, u_slope=astray * curve.u_slope),))
    again = solve(short, path, start=bad)
    assert again.converged
    assert again.iterations < 2 * cold.iterations
    np.testing.assert_allclose(again.fields([4]), cold.fields([4]), atol=1e-6)


def mirrored(case: Case) -> Case:
    """The whole body of a half model with its symmetry plane at y = 0, without that support."""
    plane = np.abs(case.nodes[:, 1]) < 1e-9
    twin = np.where(plane, np.arange(len(plane)), len(plane) + np.cumsum(~plane) - 1)
    nodes = np.concatenate([case.nodes, case.nodes[~plane] * [1, -1, 1]])
    flip = np.arange(27).reshape(3, 3, 3)[:, ::-1].ravel()  # eta runs along the section: its image runs back
    other = twin[case.connectivity][:, flip]
    face = np.array([0, 1, 3, 2, 4, 5])
    e, f = case.surfaces["chamber"].T
    chamber = np.concatenate([case.surfaces["chamber"], np.stack([e + len(other), face[f]], axis=1)])
    sets = {k: np.unique(np.concatenate([v, twin[v]])) for k, v in case.node_sets.items()}
    return replace(
        case,
        nodes=nodes,
        labels=np.arange(len(nodes)) + 1,
        node_sets=sets,
        supports=(),
        blocks=(Block("hex27", np.concatenate([case.connectivity, other])),),
        surfaces={"chamber": chamber},
        element_sets={"body": np.arange(2 * len(other))},
    )


def test_half_a_finger_bends_as_a_whole_one(short: Case) -> None:
    half, whole = short, mirrored(short)
    a, b = solve(half, ramp(0.02)).fields([0])[0], solve(whole, ramp(0.02)).fields([0])[0]
    np.testing.assert_allclose(b[: len(a)], a, atol=1e-8)
    away = np.abs(short.nodes[:, 1]) > 1e-9
    np.testing.assert_allclose(b[len(a) :], a[away] * [1, -1, 1], atol=1e-8)


@pytest.mark.parametrize("kind", ["hex27", "C3D20H", "C3D20RH", "C3D8H", "C3D10H"])  # of each kind of modes
def test_the_mirror_image_of_a_half_solution_is_the_whole_one(short: Case, kind: str) -> None:
    half = short if kind == "hex27" else converted(short, kind)
    whole, found = mirror.mirrored(half), solve(half, ramp(0.02))
    begun, cold = solve(whole, ramp(0.02), start=found), solve(whole, ramp(0.02))
    image = found.mirrored(whole).curves[0].state(0.02)
    np.testing.assert_allclose(image.u, cold.curves[0].u[-1], rtol=0, atol=1e-8)
    np.testing.assert_allclose(image.p, cold.curves[0].p[-1], rtol=0, atol=1e-7 * np.ptp(image.p))
    assert begun.iterations < 0.7 * cold.iterations  # one factorisation a level in place of two
    np.testing.assert_allclose(begun.fields([0]), cold.fields([0]), atol=1e-6)


def test_points_are_found_inside_and_on_corners(short: Case) -> None:
    rng = np.random.default_rng(20)
    rows = rng.choice(len(short.nodes), 20, replace=False)
    operator = interpolation(short, short.nodes[rows])
    np.testing.assert_allclose(operator @ short.nodes, short.nodes[rows], atol=1e-9)
    np.testing.assert_allclose(operator.sum(axis=1), 1, atol=1e-12)
    centres = short.nodes[short.connectivity].mean(axis=1)[:10]
    np.testing.assert_allclose(interpolation(short, centres) @ short.nodes, centres, atol=1e-9)


@pytest.mark.parametrize("point", [(-1.0, 0.0, 1.0), (20.0, 0.0, 5.0), (20.0, 11.5, -0.5), (500.0, 0.0, 0.0)])
def test_a_point_outside_is_refused(short: Case, point: tuple[float, float, float]) -> None:
    # before the clamp; in the cavity; below the floor; far away
    with pytest.raises(ValueError, match=r"point \(.*\) mm: not in the structure, wanted a material point"):
        interpolation(short, np.array([point]))


@pytest.mark.parametrize(
    ("place", "found"),
    [((20.0, 5.0, 1.0), (20.0, 5.0, 1.0)), ((20.0, 11.8, 1.0), (20.0, 11.5, 1.0)), ((-1.0, 12.0, -1.0), (0.0, 11.5, 0.0))],
)
def test_the_nearest_material_point(short: Case, place: tuple[float, ...], found: tuple[float, ...]) -> None:
    # inside; beside a side face; beyond a corner
    assert nearest(short, np.array(place)) == pytest.approx(found, abs=1e-6)


def test_a_clamp_turns_by_its_compliance_times_the_moment(short: Case, short_finger: Finger) -> None:
    force = np.array([0.0, 0.0, -0.05])
    soft = replace(short, forces={"tip_face": force}, clamp=replace(short.clamp, compliance=2e-3))
    problem = Problem.of(soft)
    found = equilibrium(problem, problem.start(), load=0.0, tolerance=1e-10)
    assert found.reason == "converged"
    rotation, u = found.state.rotation, found.state.u
    x = short.nodes + u
    rows, centre = short.node_sets["tip_face"], short.clamp.centre
    arm = x[rows] - np.array([centre[0], 0, centre[1]])
    # the structure's load on the clamp: moment of the dead force about the y axis through its centre
    moment = float(np.cross(arm, force / len(rows))[:, 1].sum())
    assert rotation == pytest.approx(2e-3 * moment, rel=1e-6)
    assert abs(rotation) > 1e-3
    assert (u[rows, 2] < 0).all()
    clamp = short.node_sets["clamp"]  # rigid: distances stay
    np.testing.assert_allclose(
        np.linalg.norm(x[clamp] - x[clamp[0]], axis=1),
        np.linalg.norm(short.nodes[clamp] - short.nodes[clamp[0]], axis=1),
        atol=1e-12,
    )


def test_pressure_alone_does_not_turn_the_clamp(short: Case) -> None:
    # a closed chamber's pressure is in balance with itself, so the clamp carries no moment
    soft = replace(short, clamp=replace(short.clamp, compliance=1e-2))
    problem = Problem.of(soft)
    found = equilibrium(problem, problem.start(), load=0.005, tolerance=1e-10)
    assert found.reason == "converged"
    assert abs(found.state.rotation) < 1e-12
    stiff = Problem.of(short)
    rigid = equilibrium(stiff, stiff.start(), load=0.005, tolerance=1e-10)
    np.testing.assert_allclose(found.state.u, rigid.state.u, atol=1e-9)


def test_times_of_a_history_hold_every_corner_and_every_end() -> None:
    time = np.linspace(0, 30, 601)
    pressure = np.interp(time, [0, 5, 15, 20, 30], [0, 0.03, 0.03, 0.01, 0.01])
    path = Path(time=time, pressure=pressure, output=time)
    wanted = np.array([0.0, 5, 15, 20, 30])
    np.testing.assert_allclose(corners(path), wanted, atol=1e-9)
    times = knots(path)
    assert np.isin(np.round(wanted, 9), np.round(times, 9)).all()
    assert (np.diff(times) > 0).all()
    gaps = np.diff(times[(times >= 5) & (times <= 15)])
    assert gaps[0] == pytest.approx(FIRST * np.expm1(STEP))
    assert (np.diff(gaps[:-1]) > 0).all()  # relaxation slows down


@pytest.mark.parametrize("tau", [0.5, 2.0, 10.0])
def test_what_creeps_between_a_history_s_times_is_interpolated(tau: float) -> None:
    time = np.linspace(0, 30, 3001)
    pressure = np.interp(time, [0, 5, 15, 15.2, 30], [0, 0.03, 0.03, 0.0, 0.0])
    path = Path(time=time, pressure=pressure, output=time)
    creep = equivalent(time, pressure, np.array([[0.03, tau]])) - pressure
    times = knots(path)
    weights = in_time(path, times)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-12)
    # the curve bends most within the 0.2 s of the release and just after it; a percent of what creeps there
    error = np.abs(weights @ np.interp(times, time, creep) - creep)
    assert error.max() < 0.015 * np.abs(creep).max()


def test_a_tangent_of_nearby_serves_and_changes_nothing(short: Case) -> None:
    problem = Problem.of(short)
    newton = equilibrium(problem, problem.start(), load=0.0061)
    near = equilibrium(problem, problem.start(), load=0.006)
    assert near.state is not None
    cheap = equilibrium(problem, near.state, load=0.0061, last=near.step, exact=False)
    assert (cheap.iterations, cheap.step) == (0, near.step)
    exact = equilibrium(problem, near.state, load=0.0061, last=near.step)
    assert exact.iterations == 1
    assert exact.step is not near.step
    for found in (cheap, exact):
        assert found.state is not None
        assert newton.state is not None
        np.testing.assert_allclose(found.state.u, newton.state.u, rtol=0, atol=2e-6)  # mm
        np.testing.assert_allclose(found.state.p, newton.state.p, rtol=0, atol=1e-6)  # MPa


def test_noise_in_the_log_makes_no_corners() -> None:
    rng, time = np.random.default_rng(21), np.linspace(0, 10, 501)
    clean = np.interp(time, [0, 4, 10], [0, 0.03, 0.03])
    path = Path(time=time, pressure=clean + rng.normal(scale=1e-4, size=501), output=time)
    assert len(corners(path)) <= 4
    assert np.abs(corners(path) - 4).min() < 0.2


def test_levels_run_from_rest_to_the_top() -> None:
    q = levels(0.03, count=6)
    assert (len(q), q[0], q[-1]) == (7, 0.0, 0.03)
    assert (np.diff(q, 2) > 0).all()


def test_displacement_follows_the_pressure_without_history(short: Case) -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0])
    path = Path(
        time=time, pressure=np.array([0.0, 0.02, 0.007, 0.02]), output=np.array([0.0, 1.0, 2.0, 2.5, 3.0])
    )
    point = short.position(4401)[None]
    solution = solve(short, path)
    u: Array = solution.at(point)[:, 0, 2]
    assert u[0] == 0
    np.testing.assert_array_equal(u[1], u[4])
    # between the levels the curve is a cubic with exact slopes: compare with a solve at that very pressure
    for step, pressure in ((2, 0.007), (3, 0.0135)):
        assert u[step] == pytest.approx(solve(short, ramp(pressure)).at(point)[0, 0, 2], abs=1e-4)
    slope = solution.per_pressure(point)[1, 0, 2]
    h = 1e-4
    plus, minus = (solve(short, ramp(0.02 + s * h)).at(point)[0, 0, 2] for s in (1, -1))
    assert slope == pytest.approx((plus - minus) / (2 * h), rel=1e-4)
