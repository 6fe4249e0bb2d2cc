"""Weight against closed forms, CalculiX and itself; the whole finger beside its half."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import fe.path
from fe import Case, Finger, Lattice, Material, Path, Solution, Support, Variation, finger_case, solve
from fe.deck.reader import read_deck
from fe.element import ELEMENTS, Array
from fe.engines.calculix import CalculiX
from fe.engines.writer import deck
from fe.mesh.convert import converted
from fe.mesh.mirror import mirrored, symmetry_support
from fe.solver.newton import Problem, equilibrium

Cube = Callable[..., Case]
DENSITY, G = 1.07e-9, 9810.0  # tonne/mm3, mm/s2
COARSE = Lattice(per_bellow=2, ring=False, centred=False)
DOWN = np.array([0.0, 0.0, -G])
TIME, TOP = np.array([0.0, 1.0]), 0.02  # s, MPa


def under(gravity: Array, *, top: float = TOP) -> Path:
    return Path(TIME, np.array([0.0, top]), np.array([0.0, 0.6, 1.0]), gravity=gravity)


def solved(case: Case, path: Path) -> Solution:
    solution = solve(case, path, count=4)
    assert solution.reason == "converged"
    return solution


def column(cube: Cube, length: float, held: tuple[Support, ...], material: Material) -> Case:
    """A column of 1 mm2 along x, of 12 cells."""
    case = cube((12, 1, 1), material=material, supports=held)
    return replace(case, nodes=case.nodes * [length, 1.0, 1.0])


def test_a_hanging_column_lengthens_as_its_sections_do(cube: Cube) -> None:
    length, soft = 30.0, Material(0.01, 0.005, bulk_ratio=1e5, density=3e-7)
    held = (Support("x0", (0,)), Support("y0", (1,)), Support("z0", (2,)))
    case = column(cube, length, held, soft)
    u = solved(case, under(np.array([G, 0.0, 0.0]), top=0.0)).fields([0])[0]

    def stretch(x: float) -> float:
        """Of an incompressible bar (Mooney-Rivlin) that carries the weight below x."""
        nominal = 3e-7 * G * (length - x)
        return float(brentq(lambda s: 2 * (s - s**-2) * (0.01 + 0.005 / s) - nominal, 0.5, 5.0))

    wanted = quad(lambda x: stretch(x) - 1, 0, length)[0]
    assert wanted > 0.3 * length
    # sections do not stay quite plane where the stretch changes: some (1 / 30)^2 of it
    np.testing.assert_allclose(u[case.node_sets["x1"], 0].mean(), wanted, rtol=1e-3)


def test_a_beam_sags_as_timoshenko_says(cube: Cube, silicone: Material) -> None:
    length = 20.0
    case = column(cube, length, (Support("x0", (0, 1, 2)),), replace(silicone, density=1e-11))
    u = solved(case, under(DOWN, top=0.0)).fields([0])[0]
    load, E = 1e-11 * G, 3 * silicone.shear
    wanted = load * (length**4 * 12 / (8 * E) + length**2 / (2 * 5 / 6 * silicone.shear))
    # the clamp also holds the section's width: felt over one of twenty widths, and only by Poisson's ratio
    np.testing.assert_allclose(-u[case.node_sets["x1"], 2].mean(), wanted, rtol=0.02)


@pytest.mark.parametrize("kind", ["hex27", "C3D20R", "C3D10"])
def test_all_of_the_weight_is_there(short: Case, kind: str) -> None:
    case = (converted(short, kind) if kind != "hex27" else short).with_material(density=DENSITY)
    problem = Problem.of(case).under(DOWN)
    np.testing.assert_allclose(
        problem.dead.sum(axis=0), [0, 0, -DENSITY * G * problem.geometry.weight.sum()], atol=1e-15
    )
    assert Problem.of(case).under(np.zeros(3)).dead.any() == np.False_


def test_gravity_agrees_with_calculix(short: Case, require: Callable[[str], None]) -> None:
    require("ccx")
    gravity = G * np.array([0.36, 0.0, -0.8])
    case = converted(short, "C3D20R").with_material(density=8 * DENSITY)  # as much as the long finger sags
    found = CalculiX(kind="C3D20R").solve(case, 0.25 * TOP, gravity=gravity)
    assert found.reason == "converged"
    for label in (4401, 5848):
        at = case.position(label)[None]
        ours, bare = (solved(case, under(g, top=0.25 * TOP)).at(at)[-1, 0] for g in (gravity, 0 * gravity))
        own = np.abs(ours - bare).max()
        assert own > 0.3  # mm, what gravity does
        np.testing.assert_allclose(ours, found.at(label), rtol=0, atol=0.005 * own)


def test_a_soft_finger_takes_its_weight_in_steps(short: Case) -> None:
    case = short.with_material(C10=0.008, C01=0.003, density=DENSITY)
    solution = solved(case, under(-DOWN, top=0.001))
    tip = solution.at(case.position(4401)[None])[:, 0, 2]
    assert tip[0] > 9.0  # mm upwards, of a length of 43
    heavier = solve(case.with_material(density=200 * DENSITY), under(-DOWN, top=0.001))
    assert not heavier.converged
    assert heavier.reached == 0.0
    assert "of its weight and dead forces, without pressure" in heavier.reason


def test_turned_between_recordings_is_each_by_itself(stub: Case) -> None:
    case, at = stub.with_material(density=DENSITY), stub.position(4401)[None]
    ways = G * np.array([[0.0, 0.0, -1.0], [0.6, 0.0, 0.8], [0.0, 0.0, -1.0]])
    time = np.array([0.0, 1.0, 10.0, 11.0, 20.0, 21.0])
    pressure, output = np.tile([0.0, TOP], 3), np.array([0.0, 0.7, 10.7, 11.0, 20.7])
    both = solved(case, Path(time, pressure, output, gravity=np.repeat(ways, 2, axis=0)))
    assert len(both.curves) == 2
    assert both.number.tolist() == [both.number[0]] * 2 + [1 - both.number[0]] * 2 + [both.number[0]]
    for k, way in enumerate(ways):
        own = np.flatnonzero(output // 10 == k)
        alone = solved(case, Path(TIME, pressure[:2], output[own] % 10, gravity=way)).at(at)
        np.testing.assert_allclose(both.at(at)[own], alone, atol=1e-6)  # mm: what Newton leaves
    bare = Path(time, pressure, output, gravity=np.repeat(ways, 2, axis=0))
    np.testing.assert_array_equal(  # without a density gravity costs and changes nothing
        solved(stub, bare).at(at), solved(stub, replace(bare, gravity=np.zeros(3))).at(at)
    )


def test_the_shape_of_gravity_is_checked() -> None:
    with pytest.raises(
        ValueError, match=r"gravity of shape \(2,\): wanted \(3,\) or one row for each of the 2"
    ):
        Path(TIME, np.zeros(2), TIME, gravity=np.zeros(2))


def test_a_deck_holds_gravity(short: Case, tmp_path: File) -> None:
    case, gravity = short.with_material(density=DENSITY), G * np.array([0.36, 0.48, -0.8])
    file = tmp_path / "heavy.inp"
    file.write_text(deck(case, TOP, gravity=gravity))
    found = read_deck(file)
    np.testing.assert_allclose(found.gravity, gravity, rtol=1e-9)
    assert found.case.materials["body"].density == DENSITY
    assert found.pressures == (TOP,)
    text = file.read_text()
    file.write_text(text.replace("ALL_ELEMENTS, GRAV", ", GRAV"))  # Abaqus: everything
    np.testing.assert_allclose(read_deck(file).gravity, gravity, rtol=1e-9)
    file.write_text(text.replace("ALL_ELEMENTS, GRAV", "1, GRAV"))
    with pytest.raises(ValueError, match="GRAV on 1, a part of the elements: wanted all of them"):
        read_deck(file)
    file.write_text(text[: text.index("*DLOAD")] + "*END STEP\n")
    assert not read_deck(file).gravity.any()


# --- the whole finger


def test_the_whole_finger_moves_as_its_half(stub: Case, short_finger: Finger) -> None:
    material = replace(stub.materials["body"], density=DENSITY)
    half, whole = (
        finger_case(material, finger=short_finger, lattice=COARSE, full=full) for full in (False, True)
    )
    force = np.array([0.0, 0.0, -0.01])
    half = replace(half, forces={"tip_face": force}, clamp=replace(half.clamp, compliance=1e-3))
    whole = mirrored(half)
    assert symmetry_support(whole) is None
    np.testing.assert_array_equal(whole.position(4401), half.position(4401))
    np.testing.assert_array_equal(whole.position(5848), half.position(5848))
    assert len(np.unique(whole.labels)) == len(whole.nodes)
    points = np.array([half.position(n) for n in (4401, 5848)])
    ours = [solved(c, under(0.8 * DOWN + [2000.0, 0, 0])).at(points) for c in (half, whole)]
    # mm: what Newton's last correction leaves; of 3 mm that is 1e-8
    np.testing.assert_allclose(ours[1], ours[0], rtol=0, atol=1e-7)
    other = points * [1, -1, 1]
    np.testing.assert_allclose(
        solved(whole, under(DOWN)).at(other), solved(half, under(DOWN)).at(points) * [1, -1, 1], atol=1e-7
    )


@pytest.mark.parametrize("kind", [k for k in ELEMENTS if k not in ("C3D20RH", "C3D20H", "C3D8H", "C3D10H")])
def test_every_element_is_mirrored_right_side_out(short: Case, kind: str) -> None:
    half = converted(short, kind) if kind != "hex27" else short
    whole = mirrored(half)
    volumes = [Problem.of(c).geometry.weight for c in (half, whole)]
    assert volumes[1].min() > 0
    assert volumes[1].sum() == pytest.approx(2 * volumes[0].sum())
    found = [Problem.of(c) for c in (half, whole)]
    push = [q.kernel.pressure.force(q.case.nodes).sum(axis=0) for q in found]
    # out of the same faces: twice the push, but none across; the closed chamber pushes nowhere at all
    np.testing.assert_allclose(push[1], 2 * push[0] * [1, 0, 1], atol=1e-9)
    u = [equilibrium(q, q.start(), load=0.002).state for q in found]
    assert u[0] is not None
    assert u[1] is not None
    np.testing.assert_allclose(u[1].u[: len(half.nodes)], u[0].u, atol=1e-7)


def test_prescribed_displacements_are_mirrored(cube: Cube) -> None:
    value = np.random.default_rng(2).uniform(-0.05, 0.05, (9, 3))
    half = cube((1, 1, 1), supports=(Support("y0", (1,)), Support("x0", (0, 1, 2)), Support("x1", (0, 2))))
    value = np.random.default_rng(2).uniform(-0.05, 0.05, (len(half.node_sets["x1"]), 3))
    moved = Support("x1", (0, 1, 2), value * (half.nodes[half.node_sets["x1"]][:, 1:2] > 0))
    half = replace(half, supports=(half.supports[0], half.supports[1], moved))
    u = []
    for case in (half, mirrored(half)):
        problem = Problem.of(case)
        found = equilibrium(problem, problem.start(), load=0.0)
        assert found.state is not None
        u.append(found.state.u)
    np.testing.assert_allclose(u[1][: len(half.nodes)], u[0], atol=1e-9)
    assert np.abs(u[0]).max() > 0.03


def test_what_is_no_half_cannot_be_mirrored(short: Case) -> None:
    with pytest.raises(
        ValueError, match="half model without a plane of symmetry across y: wanted a support of U2"
    ):
        mirrored(mirrored(short))
    partly = {**short.node_sets, "symmetry": short.node_sets["symmetry"][1:]}
    assert symmetry_support(replace(short, node_sets=partly)) is None


# --- derivatives


def four_point(u: Callable[[float], Array], at: float, h: float) -> Array:
    """A central difference to h^4."""
    return (8 * (u(at + h) - u(at - h)) - (u(at + 2 * h) - u(at - 2 * h))) / (12 * h)


LOG = np.linspace(0, 4, 81)
TURNING = np.where(LOG[:, None] < 2.02, DOWN, G * np.array([0.6, 0.0, 0.8]))
HISTORY = np.interp(LOG, [0, 1, 2, 2.05, 3, 4], [0, TOP, TOP, 0.0, TOP, TOP])


SLOW = [pytest.param(False, DENSITY, marks=pytest.mark.slow), pytest.param(True, 0.0, marks=pytest.mark.slow)]


@pytest.mark.parametrize(("creeping", "density"), [(False, 0.0), (True, DENSITY), *SLOW])
def test_derivatives_to_density(
    stub: Case, monkeypatch: pytest.MonkeyPatch, density: float, *, creeping: bool
) -> None:
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-9)
    monkeypatch.setattr(fe.path, "RAMP", 3)
    # output at knots: solved there, so that no interpolation is differenced
    path = Path(LOG, HISTORY, np.array([0.0, 1.0, 2.0, 3.0, 4.0]) if creeping else np.array([2.0]), gravity=TURNING)
    points = np.array([stub.position(n) for n in (4401, 5848)])

    def case(x: float) -> Case:
        return stub.with_material(density=x, prony=((0.2, 1.5),) if creeping else ())

    def u(x: float) -> Array:
        return solve(case(x), path, count=4).at(points)

    h = 1e-6 * DENSITY
    variation = Variation((case(density + h), path), (case(density - h), path), h)
    ours = solve(case(density), path, variations=[variation], count=4).variations_at(points)[0]
    theirs = four_point(u, density, 0.05 * DENSITY)
    assert np.abs(theirs).min(axis=(1, 2)).max() * DENSITY > 1e-4  # mm
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6 * np.abs(theirs).max())
