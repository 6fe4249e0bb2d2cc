"""The kernel: patch test, rigid bodies, tangents against central differences, Newton's order."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

import fe.kernel.matrix
import fe.solver.newton
from fe import Case, Material, Support
from fe.element import Array
from fe.kernel.assembly import ElementConstants, Kernel, Memory, Softening, State
from fe.kernel.matrix import Symmetric
from fe.kernel.pressure import PressureFaces
from fe.kernel.systems import Wider
from fe.mesh.convert import converted
from fe.solver.newton import Problem, Residual, Step, equilibrium
from tests.fe.lawpoints import stress

Cube = Callable[..., Case]


def rotation(angle: float, axis: tuple[float, float, float]) -> Array:
    """Rotation matrix (3, 3) about an axis (Rodrigues)."""
    n = np.array(axis) / np.linalg.norm(axis)
    W = np.cross(np.eye(3), -n)
    return np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W


def settled(kernel: Kernel, u: Array, c: ElementConstants) -> State:
    """The state at u whose pressure modes close the volume gaps: what condensation stands for."""
    none = np.zeros((len(kernel.connectivity), 4))
    _, gap = kernel.residual(State(u, none), c, 0.0, None, kernel.geometry)
    return State(u, (np.linalg.inv(kernel.geometry.mass / c.bulk[:, None, None]) @ gap[..., None])[..., 0])


def full(kernel: Kernel, data: Array) -> sp.csr_matrix:
    """The whole matrix of the free degrees of freedom from its upper triangle."""
    indptr, indices = kernel._pattern.indptr, kernel._pattern.indices
    upper = sp.csr_matrix((data, indices, indptr), shape=(len(kernel.free),) * 2)
    return upper + sp.triu(upper, 1).T


def linearised(
    kernel: Kernel, state: State, c: ElementConstants, load: float, memory: Memory | None = None
) -> sp.csr_matrix:
    turn = np.zeros((len(kernel.clamped), 3))
    return full(kernel, kernel.linearise(state, c, load, memory, turn).data)


def test_a_patch_of_curved_cells_carries_a_constant_state(cube: Cube) -> None:
    F = np.eye(3) + np.array([[0.06, 0.04, -0.03], [0.02, -0.03, 0.05], [0.03, -0.02, 0.0]])
    F *= (1.001 / np.linalg.det(F)) ** (1 / 3)
    case = cube((2, 2, 2), shift=0.06, seed=3)
    u = case.nodes @ (F - np.eye(3)).T
    held = Support("boundary", (0, 1, 2), u[case.node_sets["boundary"]])
    problem = Problem.of(replace(case, supports=(held,)))
    found = equilibrium(problem, problem.start(), load=0.0)
    assert found.reason == "converged"
    material = case.materials["body"]
    K = material.bulk
    np.testing.assert_allclose(found.state.u, u, atol=1e-9)
    # the pressure is K (J - 1): rounding of J times K = 594 MPa
    np.testing.assert_allclose(found.state.p[:, 0], K * 0.001, atol=1e-9)
    np.testing.assert_allclose(found.state.p[:, 1:], 0, atol=1e-9)
    G = problem.geometry.G
    everywhere = np.einsum("eqIa,eai->eqiI", G, found.state.u[case.connectivity]) + np.eye(3)
    np.testing.assert_allclose(everywhere, np.broadcast_to(F, everywhere.shape), atol=1e-9)
    # virtual work: the boundary's reactions carry P0, whatever the cells inside look like
    P, a, J = stress(F, material)
    P = P + K * 0.001 * J * a
    force, _ = problem.kernel.residual(found.state, problem.constants, 0.0, None, problem.geometry)
    volume = problem.geometry.weight.sum()
    np.testing.assert_allclose(force.T @ case.nodes / volume, P, atol=1e-9)


def test_a_rigid_body_feels_nothing(cube: Cube) -> None:
    case = cube((2, 1, 1), shift=0.1, seed=1)
    kernel, c = Kernel(case), ElementConstants.of(case)
    u = case.nodes @ (rotation(2.0, (1, -2, 3)) - np.eye(3)).T + np.array([5.0, -3, 1])
    state = State(u, np.zeros((2, 4)))
    force, gap = kernel.residual(state, c, 0.0, None, kernel.geometry)
    np.testing.assert_allclose(force, 0, atol=1e-13)
    np.testing.assert_allclose(gap, 0, atol=1e-14)
    K = linearised(kernel, state, c, 0.0)
    x = case.nodes + u
    modes = [np.tile(e, len(x)) for e in np.eye(3)] + [np.cross(e, x).ravel() for e in np.eye(3)]
    # K is of the size of the bulk modulus, 594 MPa mm: zero to rounding
    for mode in modes:
        np.testing.assert_allclose(K @ mode, 0, atol=1e-9)
    stiff = np.linalg.eigvalsh(K.toarray())
    assert (np.abs(stiff) < 1e-9).sum() == 6  # and nothing else moves freely: no hourglass mode
    assert stiff[6] > 1e-4


def test_a_loaded_body_turns_with_its_forces(cube: Cube) -> None:
    # f(Q x) = Q f(x), pressure included, so K (w x x) = w x f at any state, with the pressure's update.
    case = cube((1, 2, 1), shift=0.1, seed=2, pressurised="skin")
    kernel, c = Kernel(case), ElementConstants.of(case)
    rng = np.random.default_rng(5)
    state = settled(kernel, rng.uniform(-0.05, 0.05, case.nodes.shape), c)
    load, none = 0.2, np.zeros((0, 3))
    system = kernel.linearise(state, c, load, None, none)
    K, x = full(kernel, system.data), case.nodes + state.u
    for e in np.eye(3):
        mode = np.cross(e, x)
        np.testing.assert_allclose((K @ mode.ravel()).reshape(-1, 3), np.cross(e, system.force), atol=1e-9)
        np.testing.assert_allclose(K @ np.tile(e, len(x)), 0, atol=1e-9)
        turned = np.swapaxes(system.coupling, 1, 2) @ mode[case.connectivity].reshape(-1, 81, 1)
        np.testing.assert_allclose(turned, 0, atol=1e-12)  # no volume change, so no change of pressure


def test_the_pressure_is_the_gradient_of_the_enclosed_volume(cube: Cube) -> None:
    case = cube((2, 1, 1), shift=0.1, seed=7)
    faces = PressureFaces(case.face_nodes("skin"), case.element, len(case.nodes))
    x = case.nodes + np.random.default_rng(8).uniform(-0.05, 0.05, case.nodes.shape)

    def volume(x: Array) -> float:
        return -float((faces.force(x) * x).sum()) / 3

    direction = np.random.default_rng(9).normal(size=x.shape)
    h = 1e-4
    slope = (volume(x + h * direction) - volume(x - h * direction)) / (2 * h)
    # a cubic: the central difference is off by h^2 times the direction's own volume
    assert slope == pytest.approx(-float((faces.force(x) * direction).sum()), rel=1e-6)
    assert volume(case.nodes) == pytest.approx(Kernel(case).geometry.weight.sum(), rel=1e-12)


def test_the_pressure_tangent_is_its_gradient_on_a_closed_surface(cube: Cube) -> None:
    case = cube((2, 1, 1), shift=0.1, seed=7)
    faces = PressureFaces(case.face_nodes("skin"), case.element, len(case.nodes))
    rng = np.random.default_rng(8)
    x = case.nodes + rng.uniform(-0.05, 0.05, case.nodes.shape)
    d, h = rng.normal(size=x.shape), 1e-4
    local = faces.tangent(x) @ d.ravel()[faces.dofs][..., None]
    ours = np.bincount(faces.dofs.ravel(), weights=local.ravel(), minlength=x.size).reshape(-1, 3)
    # quadratic in x: the central difference is exact up to rounding / h
    np.testing.assert_allclose((faces.force(x + h * d) - faces.force(x - h * d)) / (2 * h), ours, atol=1e-10)


@pytest.mark.parametrize("kind", ["hex27", "C3D8", "C3D10"])
def test_the_pressure_tangent_on_an_open_surface(cube: Cube, kind: str) -> None:
    case = cube((1, 2, 2), shift=0.1, seed=7)
    case = case if kind == "hex27" else converted(case, kind)
    faces = PressureFaces(case.face_nodes("x1"), case.element, len(case.nodes))
    rng = np.random.default_rng(8)
    x = case.nodes + rng.uniform(-0.05, 0.05, case.nodes.shape)
    d, h, ours = rng.normal(size=x.shape), 1e-4, np.zeros(x.size)
    edges = faces.open_edges(case.nodes, np.ones(x.size, bool))
    assert len(edges) == 8  # round two by two cells
    for dofs, K in ((faces.dofs, faces.tangent(x)), faces.antisymmetric(x, edges)):
        np.add.at(ours, dofs, (K @ d.ravel()[dofs][..., None])[..., 0])
    theirs = (faces.force(x + h * d) - faces.force(x - h * d)).ravel() / (2 * h)
    np.testing.assert_allclose(theirs, ours, atol=1e-10)


@pytest.mark.parametrize("kind", ["hex27", "C3D10H"])
def test_superlu_takes_the_place_of_pardiso(short: Case, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = short if kind == "hex27" else converted(short, kind)
    found = []
    for _ in range(2):
        problem = Problem.of(case)
        found.append(equilibrium(problem, problem.start(), load=0.01))
        assert found[-1].reason == "converged"
        monkeypatch.setattr(fe.kernel.matrix, "PyPardisoSolver", None)
    assert found[1].step is not None
    assert found[1].step.problem.kernel.matrix.negative is None  # PARDISO tells them, SuperLU does not
    np.testing.assert_allclose(found[1].state.u, found[0].state.u, atol=1e-9)


def test_planes_of_symmetry_close_a_surface(short: Case) -> None:
    rough = short.nodes + np.random.default_rng(4).uniform(-1e-8, 1e-8, short.nodes.shape)
    assert len(Kernel(short)._open) == len(Kernel(replace(short, nodes=rough))._open) == 0
    assert len(Kernel(replace(short, supports=()))._open) > 0


@pytest.mark.parametrize(("creeping", "softened"), [(False, False), (True, False), (True, True)])
def test_the_condensed_tangent_of_a_finger_at_a_random_state(
    short: Case, *, creeping: bool, softened: bool
) -> None:
    kernel, c = Kernel(short), ElementConstants.of(short.with_material(C20=0.05, ogden=((0.1, 3.0),)))
    rng = np.random.default_rng(10)
    u = np.zeros_like(short.nodes)
    u.ravel()[kernel.free] = rng.uniform(-0.02, 0.02, len(kernel.free))
    d = np.zeros_like(u)
    d.ravel()[kernel.free] = rng.normal(size=len(kernel.free))
    load, h, size = 0.05, 1e-5, len(short.connectivity)
    memory = None
    if creeping:
        history_stress = rng.normal(scale=0.05, size=(size, 27, 3, 3))
        memory = Memory(rng.uniform(0.5, 1, size), history_stress + np.swapaxes(history_stress, 2, 3))
    if softened:  # half of the points below their largest energy by far, the others above it
        peak = kernel.energies(u, c, kernel.geometry) * rng.choice([0.2, 3.0], (size, 27))
        memory = replace(memory, softening=Softening(np.tile([0.4, 2e-3, 0.3], (size, 1)), peak, None))

    def force(u: Array) -> Array:
        state = settled(kernel, u, c)
        return kernel.residual(state, c, load, memory, kernel.geometry)[0].ravel()[kernel.free]

    state = settled(kernel, u, c)
    K = linearised(kernel, state, c, load, memory)
    ours, differences = K @ d.ravel()[kernel.free], (force(u + h * d) - force(u - h * d)) / (2 * h)
    # the chamber is closed by the symmetry plane and so the pressure's symmetric tangent is all of it
    assert np.abs(ours - differences).max() < 1e-6 * np.abs(differences).max()


def test_the_tangent_times_the_clamps_rotation(short: Case) -> None:
    problem = Problem.of(short)
    kernel, c = problem.kernel, problem.constants
    rng, angle, h = np.random.default_rng(11), 0.1, 1e-5
    shape = rng.uniform(-0.02, 0.02, short.nodes.shape)

    def state(angle: float) -> State:
        u = shape.copy()
        u[kernel.clamped] = problem.clamp_motion(angle)[0]
        return settled(kernel, u, c)

    def force(angle: float) -> Array:
        return kernel.residual(state(angle), c, 0.0, None, kernel.geometry)[0]

    turning = kernel.linearise(state(angle), c, 0.0, None, problem.clamp_motion(angle)[1]).lever
    differences = (force(angle + h) - force(angle - h)) / (2 * h)
    assert np.abs(turning - differences).max() < 1e-6 * np.abs(differences).max()


@pytest.mark.parametrize("compliance", [0.0, 1e-4])
def test_newton_converges_quadratically(
    short: Case, monkeypatch: pytest.MonkeyPatch, compliance: float
) -> None:
    lengths: list[float] = []

    class Recorded(Step):
        def solve(self, residuals: Sequence[Residual]) -> list[State]:
            changes = super().solve(residuals)
            lengths.append(float(np.abs(changes[0].u).max()))
            return changes

    monkeypatch.setattr(fe.solver.newton, "Step", Recorded)
    monkeypatch.setattr(fe.solver.newton, "NEARBY", 0.0)  # no correction with a tangent of nearby
    clamp = replace(short.clamp, compliance=compliance)
    problem = Problem.of(replace(short, clamp=clamp, forces={"tip_face": np.array([0.0, 0.0, -0.01])}))
    near = equilibrium(problem, problem.start(), load=0.003)
    lengths.clear()
    found = equilibrium(problem, near.state, load=0.006, tolerance=1e-11)
    assert found.reason == "converged"
    # e_new <= c e^2 with one c (0.3 per mm here) down to rounding; a wrong term leaves a constant ratio
    # instead
    e = np.array(lengths)
    assert len(e) >= 4
    assert (e[1:] <= 1.0 * e[:-1] ** 2 + 1e-12).all()


def test_a_held_node_set_keeps_its_values(cube: Cube, silicone: Material) -> None:
    case = cube((1, 1, 1), shift=0.05, material=silicone)
    value = np.random.default_rng(12).uniform(-0.02, 0.02, (len(case.node_sets["x0"]), 3))
    rows = case.node_sets["x1"]
    supports = (Support("x0", (0, 1, 2), value), Support("x1", (2,)))
    problem = Problem.of(replace(case, supports=supports, forces={"x1": np.array([0.03, 0.02, 0.0])}))
    found = equilibrium(problem, problem.start(), load=0.0)
    assert found.reason == "converged"
    np.testing.assert_array_equal(found.state.u[case.node_sets["x0"]], value)
    np.testing.assert_array_equal(found.state.u[rows, 2], 0)
    force, _ = problem.kernel.residual(found.state, problem.constants, 0.0, None, problem.geometry)
    # equilibrium: free nodes carry exactly the dead force, spread evenly
    np.testing.assert_allclose(force[rows, 0], 0.03 / len(rows), atol=1e-9)
    np.testing.assert_allclose(force[rows, 1], 0.02 / len(rows), atol=1e-9)


def test_a_solve_begins_anew_with_every_solver_of_its_kernel(cube: Cube, monkeypatch: pytest.MonkeyPatch) -> None:
    kernel, begun = Kernel(cube((1, 1, 1), pressurised="z1")), list[Symmetric]()
    shared = kernel.with_shares(np.full(len(kernel.pressure.faces), 0.5))
    for one in (kernel, shared):  # as where faces touch
        one._widened = "", Wider.of(one._pattern, one._number[:6][None], one._solver)
    monkeypatch.setattr(Symmetric, "begin", lambda self: begun.append(self))
    kernel.begin()
    wider = [one._widened[1].matrix for one in (kernel, shared) if one._widened]
    assert [id(matrix) for matrix in begun] == [id(matrix) for matrix in (kernel.matrix, *wider)]
