"""Eigenstrain that varies over the height: closed forms, derivatives, and CalculiX's thermal strain."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from fe import Case, Path, Support, Variation, solve
from fe.kernel.assembly import ElementConstants, Geometry, Kernel
from fe.solver.newton import Problem, equilibrium

LENGTH, DEPTH = 40.0, 2.0  # mm


def bar(cube: Callable[..., Case], precurvature: float) -> Case:
    """A bar held so that it is free to bend: its end plane stays a plane x = 0, rigid motions are stopped."""
    case = cube((10, 1, 2))
    nodes = case.nodes * [LENGTH, DEPTH, DEPTH] - [0, DEPTH / 2, DEPTH / 2]
    on_axis = np.flatnonzero((np.abs(nodes) < 1e-9).all(axis=1))
    below = np.flatnonzero((np.abs(nodes - [0, 0, -DEPTH / 2]) < 1e-9).all(axis=1))
    sets = {**case.node_sets, "axis": on_axis, "below": below}
    held = Support("x0", (0,)), Support("axis", (1, 2)), Support("below", (1,))
    return replace(case, nodes=nodes, node_sets=sets, supports=held, precurvature=precurvature)


@pytest.mark.parametrize("curvature", [1e-4, 0.01, -0.005])
def test_a_free_bar_bends_to_the_arc_without_stress(cube: Callable[..., Case], curvature: float) -> None:
    case = bar(cube, curvature)
    problem = Problem.of(case)
    found = equilibrium(problem, problem.start(), load=0.0)
    assert found.reason == "converged"
    middle = np.flatnonzero((np.abs(case.nodes[:, 1:]) < 1e-9).all(axis=1))
    x, u = case.nodes[middle, 0], found.state.u[middle]
    # fibres at a height h are 1 + curvature h long: an arc of that curvature, which ends up below. Lengths
    # across are isochoric, which is compatible with bending to the order (curvature depth)^2.
    arc = np.stack([np.sin(curvature * x) / curvature - x, 0 * x, (np.cos(curvature * x) - 1) / curvature], axis=1)
    assert np.abs(u - arc).max() < 1e-3 * np.abs(arc).max()
    rows = problem.kernel.isochoric(found.state.u, problem.constants, problem.geometry)
    # what two curved elements cannot follow, of the stress that the held bar would have
    assert np.abs(rows).max() < 0.05 * 4 * problem.shear * abs(curvature) * DEPTH / 2


def test_a_held_bar_carries_the_moment_of_what_it_is_held_from(cube: Callable[..., Case]) -> None:
    curvature = 1e-4
    case = bar(cube, curvature)
    # straight and free across: sigma = -E curvature z, with E = 3 mu, for the incompressible bar
    held = replace(case, supports=(*case.supports, Support("x1", (0,)), Support("z0", (2,))))
    problem = Problem.of(held)
    found = equilibrium(problem, problem.start(), load=0.0)
    force, _ = problem.kernel.residual(found.state, problem.constants, 0.0, None, problem.geometry)
    end = case.node_sets["x1"]
    moment = float((force[end, 0] * case.nodes[end, 2]).sum())
    # the bottom held flat stops part of the anticlastic curvature: 3 mu to 4 mu
    expected = -problem.shear * curvature * DEPTH**4 / 12
    assert 3.0 * abs(expected) * 0.99 < abs(moment) < 4.0 * abs(expected)
    assert np.sign(moment) == np.sign(expected)


def test_the_tangent_with_eigenstrain_is_the_forces_gradient(cube: Callable[..., Case]) -> None:
    case = replace(cube((2, 1, 1), shift=0.1, seed=3), precurvature=0.3)
    kernel, c = Kernel(case), ElementConstants.of(case)
    rng = np.random.default_rng(4)
    state = Problem.of(case).start()
    state = replace(state, u=rng.uniform(-0.03, 0.03, case.nodes.shape), p=rng.normal(0, 0.1, state.p.shape))
    d, h = rng.normal(size=case.nodes.shape), 1e-6
    ahead, behind = (
        kernel.residual(replace(state, u=state.u + s * h * d), c, 0.0, None, kernel.geometry) for s in (1, -1)
    )
    system = kernel.linearise(state, c, 0.0, None, np.zeros((0, 3)))
    upper = sp.csr_matrix((system.data, kernel._pattern.indices, kernel._pattern.indptr))
    full = upper + sp.triu(upper, 1).T
    gap = (ahead[1] - behind[1]) / (2 * h)
    condensed = (ahead[0] - behind[0]) / (2 * h) + kernel.gather(
        (system.coupling @ (system.compliance @ gap[..., None])).reshape(*kernel.connectivity.shape, 3)
    )
    ours = full @ d.ravel()
    assert np.abs(ours - condensed.ravel()).max() < 1e-6 * np.abs(ours).max()


def test_without_precurvature_nothing_changes(short: Case) -> None:
    plain, none = (Geometry(short.nodes, short.connectivity, short.element, k) for k in (0.0, 1e-12))
    assert plain.rest.size == 0
    np.testing.assert_allclose(none.G, plain.G, rtol=1e-9)


def test_derivatives_to_the_precurvature_at_null_and_beyond(stub: Case) -> None:
    path = Path(np.array([0.0, 1.0]), np.array([0.0, 0.02]), np.array([1.0]))
    points = stub.position(4401)[None]

    def u(value: float, **more: object) -> np.ndarray:
        found = solve(replace(stub, precurvature=value), path, count=3, **more)  # type: ignore[arg-type]
        assert found.converged
        return found.variations_at(points)[0] if more else found.at(points)

    for at in (0.0, 1e-3):
        sides = [(replace(stub, precurvature=at + s * 1e-9), path) for s in (1, -1)]
        ours = u(at, variations=[Variation(sides[0], sides[1], 1e-9)])
        h = 1e-4  # two steps take the fourth order in
        one, two = ((u(at + k * h) - u(at - k * h)) / (2 * k * h) for k in (1, 2))
        theirs = (4 * one - two) / 3
        assert np.abs(theirs).max() > 10  # mm per 1/mm
        np.testing.assert_allclose(ours, theirs, atol=1e-6 * np.abs(theirs).max())
