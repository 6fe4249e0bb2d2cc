"""A sheet bonded to a surface: its own energy, closed forms, CalculiX, derivatives at null and beyond."""

from collections.abc import Callable
from dataclasses import replace

from benchmarks.kernel import shapes

import numpy as np
import pytest

from fe import Case, Material, Path, Support, Variation, solve
from fe.case import Layer
from fe.kernel.layer import LayerFaces
from fe.solver.newton import Problem, equilibrium

Cube = Callable[..., Case]


@pytest.mark.parametrize("wound", [False, True])
def test_forces_and_tangent_are_gradients_of_one_energy(cube: Cube, wound: bool) -> None:
    case = replace(cube((2, 1, 1), shift=0.1, seed=5), layer=Layer("z0", 0.7, poisson=0.3, wound=wound))
    faces, rng = LayerFaces(case, case.sheets[0]), np.random.default_rng(6)
    x = case.nodes + rng.uniform(-0.1, 0.1, case.nodes.shape)
    d, h = rng.normal(size=x.shape), 1e-5

    def energy(x: np.ndarray) -> float:
        a = faces._tangents(x)
        strain = 0.5 * (a @ np.swapaxes(a, 2, 3) - faces._metric)
        voigt = np.stack([strain[..., 0, 0], strain[..., 1, 1], 2 * strain[..., 0, 1]], axis=-1)
        return float((faces._area * (voigt * faces._stress(a)).sum(-1)).sum() / 2)

    slope = (energy(x + h * d) - energy(x - h * d)) / (2 * h)
    assert slope == pytest.approx(-float((faces.force(x) * d).sum()), rel=1e-7)
    dofs, K = faces.tangent(x)
    local = (K @ d.ravel()[dofs][..., None])[..., 0]
    ours = np.bincount(dofs.ravel(), weights=local.ravel(), minlength=x.size).reshape(-1, 3)
    differences = -(faces.force(x + h * d) - faces.force(x - h * d)) / (2 * h)
    np.testing.assert_allclose(ours, differences, atol=1e-7 * np.abs(ours).max())
    # turned as a whole it is as free of stress as at rest
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(faces.force(case.nodes @ turn.T), 0, atol=1e-12)


def test_wound_fibres_resist_a_stretch_around_x_alone(cube: Cube) -> None:
    case = replace(cube((2, 1, 1)), layer=Layer("z0", 2.0, wound=True))
    faces, strain = LayerFaces(case, case.sheets[0]), 1e-3
    assert np.abs(faces.force(case.nodes * [1 + strain, 1.0, 1.0])).max() < 1e-15
    pulled = faces.force(case.nodes * [1.0, 1 + strain, 1.0])
    assert np.abs(pulled[:, [0, 2]]).max() < 1e-15
    far = case.nodes[:, 1] > case.nodes[:, 1].max() - 1e-9
    # stiffness x strain x width, the stretch and Green's strain being of the second order besides
    width = float(np.ptp(case.nodes[:, 0]))
    assert -pulled[far, 1].sum() == pytest.approx(2.0 * strain * width, rel=2 * strain)


def solved(case: Case) -> np.ndarray:
    problem = Problem.of(case)
    found = equilibrium(problem, problem.start(), load=0.0)
    assert found.reason == "converged"
    return found.state.u


def test_a_bonded_sheet_in_tension_carries_its_share(cube: Cube) -> None:
    # a bar between two sheets, top and bottom would bend: one sheet on each of two opposite faces is two cases
    # of one surface each, so a single surface of both faces
    case = cube((3, 1, 1), material=Material(0.2, 0.1))
    both = np.concatenate([case.surfaces["z0"], case.surfaces["z1"]])
    mu, strain, stiffness = 0.6, 1e-4, 2.0
    pulled = Support("x1", (0,), np.tile([strain, 0, 0], (len(case.node_sets["x1"]), 1)))
    held = (Support("x0", (0,)), Support("y0", (1,)), Support("z0", (2,)), pulled)
    case = replace(case, surfaces={**case.surfaces, "both": both}, supports=held, layer=Layer("both", stiffness, poisson=0.5))
    problem = Problem.of(case)
    found = equilibrium(problem, problem.start(), load=0.0)
    assert found.reason == "converged"
    force, _ = problem.kernel.residual(found.state, problem.constants, 0.0, None, problem.geometry)
    (layer,) = problem.layers
    force -= layer.force(case.nodes + found.state.u)
    total = float(force[case.node_sets["x1"], 0].sum())
    # both incompressible with Poisson's ratio 1/2: uniaxial in either, the stiffnesses add
    assert total == pytest.approx((3 * mu + 2 * stiffness) * strain, rel=1e-3)


def test_a_composite_beam_bends_about_its_common_axis(cube: Cube) -> None:
    length, depth, force = 30.0, 2.0, 1e-5
    case = cube((12, 1, 2), material=Material(0.2, 0.1))
    nodes, E, Y = case.nodes * [length, depth, depth], 3 * 0.6, 4.0
    case = replace(
        case, nodes=nodes, supports=(Support("x0", (0,)), Support("y0", (1,)), Support("edge", (2,))),
        node_sets={**case.node_sets, "edge": np.flatnonzero((nodes[:, 0] == 0) & (nodes[:, 2] == 0))},
        forces={"x1": np.array([0.0, 0.0, force])},
    )  # fmt: skip
    # bar E d^2 at height d / 2, sheet Y d at 0; free across, nu = 1/2 in both
    axis = E * depth**2 * depth / 2 / (E * depth**2 + Y * depth)
    stiffness = E * depth**4 / 12 + E * depth**2 * (depth / 2 - axis) ** 2 + Y * depth * axis**2
    tip = case.node_sets["x1"]
    bending = solved(replace(case, layer=Layer("z0", Y, poisson=0.5)))[tip, 2].mean()
    # shear adds (1 + nu) / 2 (d / l)^2 or so; the anticlastic bow of two materials is not that of one
    assert bending == pytest.approx(force * length**3 / 3 / stiffness, rel=0.02)
    bare = solved(case)[tip, 2].mean()
    assert bending < 0.55 * bare


@pytest.mark.slow
def test_a_layer_on_a_finger_under_pressure_is_calculixs_membrane(require: Callable[[str], None]) -> None:
    require("ccx")
    found = shapes.layered(2, pressure=0.005)
    assert np.abs(found.theirs).max() > 0.04  # mm
    # the membranes have nine points of quadrature a face where the kernel's element has four: 2.3 % of the
    # effect with half as many cells along the finger, 0.3 % with twice as many
    assert found.difference < 0.02


def test_a_layer_of_no_stiffness_is_none_bit_for_bit(short: Case) -> None:
    path, point = Path(np.array([0.0, 1.0]), np.array([0.0, 0.02]), np.array([1.0])), short.position(4401)[None]
    none = replace(short, layer=Layer("outside", 0.0))
    np.testing.assert_array_equal(solve(short, path).at(point), solve(none, path).at(point))


@pytest.mark.parametrize("compliance", [0.0, 1e-3])
def test_derivatives_to_its_stiffness_at_null_and_beyond(stub: Case, compliance: float) -> None:
    path, point = Path(np.array([0.0, 1.0]), np.array([0.0, 0.02]), np.array([1.0])), stub.position(4401)[None]
    assert stub.clamp
    base = replace(
        stub, clamp=replace(stub.clamp, compliance=compliance), forces={"tip_face": np.array([0.0, 0.0, -0.03])}
    )

    def case(stiffness: float) -> Case:
        return replace(base, layer=Layer("outside", stiffness))

    def u(stiffness: float) -> np.ndarray:
        found = solve(case(stiffness), path)
        assert found.converged
        return found.at(point)

    for start, at in ((base, 0.0), (case(0.3), 0.3)):
        sides = [(case(at + s * 1e-7), path) for s in (1, -1)]
        ours = solve(start, path, variations=[Variation(sides[0], sides[1], 1e-7)]).variations_at(point)[0]
        h = 2e-3  # two steps take the fourth order in
        one, two = ((u(at + k * h) - u(at - k * h)) / (2 * k * h) for k in (1, 2))
        theirs = (4 * one - two) / 3
        assert np.abs(theirs).max() > 0.02  # mm per N/mm
        np.testing.assert_allclose(ours, theirs, atol=1e-6 * np.abs(theirs).max())
