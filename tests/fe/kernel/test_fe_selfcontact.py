"""Walls that touch each other: tangent, patch test, scaling, derivatives, decks, and CalculiX."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from fe import Block, Case, Path, Support, Variation, solve
from fe.case import SelfContact
from fe.element import Array
from fe.engines.writer import deck
from fe.kernel.contact import SMOOTH
from fe.kernel.selfcontact import SelfFaces
from fe.mesh.convert import converted
from fe.mesh.inner import SKIN, closing
from fe.solver.newton import Problem, equilibrium
from tests.fe.touchingchambers import against_ccx, paired, row

Cube = Callable[..., Case]
ALONE = np.array([1.0])


def ramp(top: float) -> Path:
    return Path(np.array([0.0, 1.0]), np.array([0.0, top]), ALONE)


def stacked(cube: Cube, lower: tuple[int, int, int], upper: tuple[int, int, int], gap: float) -> Case:
    """Two unit cubes on each other whose meshes do not fit, `gap` mm apart; names with `low` and `high`."""
    a, b = cube(lower), cube(upper)
    more, rows = len(a.nodes), len(a.connectivity)
    b_sets = {f"high_{k}": v + more for k, v in b.node_sets.items()}
    b_faces = {f"high_{k}": v + [rows, 0] for k, v in b.surfaces.items()}
    sets = {f"low_{k}": v for k, v in a.node_sets.items()} | b_sets
    sides = {k: np.concatenate([sets[f"low_{k}"], sets[f"high_{k}"]]) for k in ("x0", "y0")}
    nodes = np.concatenate([a.nodes, b.nodes + [0.0, 0.0, 1.0 + gap]])
    connectivity = np.concatenate([a.connectivity, b.connectivity + more])
    return replace(
        a, nodes=nodes, labels=np.arange(1, len(nodes) + 1), blocks=(Block("hex27", connectivity),),
        node_sets={**sets, **sides}, element_sets={"body": np.arange(len(connectivity))},
        surfaces={f"low_{k}": v for k, v in a.surfaces.items()} | b_faces,
        self_contact=(SelfContact("low_z1", "high_z0"),),
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["hex27", "C3D20R", "C3D10"])
def test_the_tangent_is_the_derivative_of_the_force(cube: Cube, kind: str) -> None:
    case = stacked(cube, (1, 1, 1), (2, 1, 1), 0.05)
    case, rng = (converted(case, kind) if kind != "hex27" else case), np.random.default_rng(3)
    x = case.nodes + rng.uniform(-0.03, 0.03, case.nodes.shape)
    x[case.nodes[:, 2] > 1.01, 2] -= 0.1
    walls, d, h = SelfFaces(case), rng.normal(size=x.shape), 1e-6
    dofs, K = walls.tangent(x)
    force = -(walls.force(x + h * d) - walls.force(x - h * d)).ravel() / (2 * h)
    ours = np.bincount(dofs.ravel(), (K @ d.ravel()[dofs][..., None]).ravel(), x.size)
    assert np.abs(force).max() > 0.5
    # piecewise quadratic or linear: but for points that pass from one to the other within h
    np.testing.assert_allclose(ours, force, rtol=0, atol=1e-4 * np.abs(force).max())
    np.testing.assert_allclose(K, np.swapaxes(K, 1, 2), atol=1e-12 * np.abs(K).max())


def test_forces_between_walls_are_in_balance(cube: Cube) -> None:
    case = stacked(cube, (1, 1, 1), (2, 1, 1), 0.0)
    x = case.nodes + 0.02 * case.nodes[:, [1, 2, 0]] ** 2
    x[len(cube((1, 1, 1)).nodes) :, 2] -= 0.1
    force = SelfFaces(case).force(x)
    size = np.abs(force).sum()
    assert size > 0.1
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * size
    assert np.abs(np.cross(x, force).sum(axis=0)).max() < 1e-11 * size  # normal to the face


def test_a_uniform_pressure_passes_through_meshes_that_do_not_fit(cube: Cube) -> None:
    gap, down = 0.02, 0.05
    case = stacked(cube, (1, 1, 1), (2, 2, 1), gap)
    lid = np.tile([0.0, 0.0, -down], (len(case.node_sets["high_z1"]), 1))
    held = Support("x0", (0,)), Support("y0", (1,)), Support("low_z0", (2,)), Support("high_z1", (2,), lid)
    case = replace(case, supports=held)
    solution, m = solve(case, ramp(0.0)), case.materials["body"]
    assert solution.converged
    u, k = solution.fields([0])[0], case.self_contact[0].stiffness * m.shear

    def out_of_balance(depth: float) -> float:
        """Of two incompressible blocks under uniaxial compression, per area at rest."""
        s = 1 - (down - gap - depth) / 2
        push = k * (depth if depth > SMOOTH / 2 else (depth + SMOOTH / 2) ** 2 / (2 * SMOOTH))
        return push + 2 * (s - s**-2) * (m.C10 + m.C01 / s)

    wanted = (down - gap - brentq(out_of_balance, -SMOOTH / 2, down)) / 2
    below = u[case.node_sets["low_z1"], 2]
    # K = 1000 mu: 1e-3; and the kinks of the other mesh within a face, which the quadrature passes over
    np.testing.assert_allclose(below, -wanted, rtol=0, atol=0.01 * wanted)
    problem = Problem.of(case)
    stress = problem.kernel.isochoric(u, problem.constants, problem.geometry)[..., 2, 2]
    assert stress.std() < 0.01 * abs(stress.mean())


def test_walls_that_do_not_meet_change_nothing(stub: Case) -> None:
    free, closed = (solve(c, ramp(0.02)).fields([0]) for c in (stub, closing(stub)))
    np.testing.assert_allclose(closed, free, rtol=0, atol=1e-10)


@pytest.fixture(scope="module")
def chambers() -> Case:
    """Two chambers in a row, coarse."""
    return row(2, fine=1)


def test_chambers_that_touch_are_followed_and_scale(chambers: Case) -> None:
    # displacements are those of pressure over the moduli: dU / d ln(moduli) = -p dU/dp
    top, h, case = 0.02, 1e-6, closing(chambers)
    path, m = ramp(top), case.materials["body"]

    def stiffer(factor: float) -> tuple[Case, Path]:
        return case.with_material(C10=factor * m.C10, C01=factor * m.C01), path

    found = solve(case, path, variations=[Variation(stiffer(1 + h), stiffer(1 - h), h)])
    assert found.converged
    assert found.crossed == ""
    assert solve(chambers, path).crossed.startswith("self-contact: at 0.02 MPa")
    u, walls = found.fields([0])[0], Problem.of(case).walls
    assert walls is not None
    assert 0 < walls.deepest(case.nodes + u) < 0.02  # mm
    points = case.nodes[case.node_sets["symmetry"][::7]]
    slope = -top * found.per_pressure(points)
    # TOLERANCE leaves a tangent 1e-6 wrong
    np.testing.assert_allclose(found.variations_at(points)[0], slope, rtol=0, atol=1e-5 * np.abs(slope).max())


@pytest.mark.slow
def test_derivatives_of_chambers_that_touch(chambers: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-9)
    path, rows = ramp(0.02), chambers.node_sets["symmetry"][::7]

    def taller(more: float, stiffness: float) -> tuple[Case, Path]:
        pairs = (SelfContact("outside", "outside", stiffness),)
        return replace(chambers, nodes=chambers.nodes * [1.0, 1.0, 1.0 + more], self_contact=pairs), path

    def fields(*at: float) -> Array:
        solution = solve(taller(*at)[0], path, start=found)
        assert solution.converged
        return solution.fields([0])[0][rows]

    steps = np.diag([0.05, 5.0])
    found = solve(taller(0.0, 20.0)[0], path, variations=[
        Variation(taller(0.0 + 1e-6 * d, 20.0 + 1e-6 * k), taller(-1e-6 * d, 20.0 - 1e-6 * k), 1e-6 * (d + k))
        for d, k in steps
    ])  # fmt: skip
    for ours, (d, k) in zip(found.variations_at(chambers.nodes[rows]), 1e-3 * steps, strict=True):
        wide = fields(2 * d, 20 + 2 * k) - fields(-2 * d, 20 - 2 * k)
        theirs = (8 * (fields(d, 20 + k) - fields(-d, 20 - k)) - wide) / (12 * (d + k))
        np.testing.assert_allclose(ours[0], theirs, rtol=0, atol=1e-6 * np.abs(theirs).max())


def test_the_skin_is_what_may_touch_itself(chambers: Case) -> None:
    case = closing(chambers)
    names = [(c.first, c.second) for c in case.self_contact]
    assert names == [(SKIN, SKIN), ("chamber", "chamber")]
    assert {tuple(f) for f in case.surfaces[SKIN]} == {tuple(f) for f in chambers.surfaces["outside"]}


@pytest.mark.parametrize(
    ("pair", "said"),
    [
        (SelfContact("left0", "right9"), r"surface 'right9': not in the model, wanted one of .*left0"),
        (SelfContact("left0", "right0", 0.0), r"left0 and right0: stiffness 0 1/mm, wanted more than 0"),
    ],
)
def test_a_pair_that_cannot_be_is_named(chambers: Case, pair: SelfContact, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        SelfFaces(replace(chambers, self_contact=(pair,)))


def test_a_deck_holds_pairs_of_surfaces(chambers: Case) -> None:
    text = deck(paired(chambers), 0.02)
    assert "*CONTACT PAIR, INTERACTION=WALLS0, TYPE=SURFACE TO SURFACE\nLEFT0, RIGHT0\n" in text
    assert "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n11.88,\n" in text
    with pytest.raises(ValueError, match=r"surface 'skin' that may touch itself: .* pairs of two surfaces"):
        deck(closing(chambers), 0.02)


@pytest.mark.slow
def test_two_chambers_against_calculix(require: Callable[[str], None]) -> None:
    require("ccx")
    found = against_ccx()
    # of the largest displacement; quadrature and contact points are not ccx's, and the mesh is coarse
    assert found["self_contact_ccx"] < 0.01
    assert found["self_contact_effect"] < 0.05
