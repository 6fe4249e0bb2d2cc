"""Abaqus decks out and in: a round trip, other people's ways to write one, CalculiX on the same deck, errors."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path as File
from typing import Any

import numpy as np
import pytest

from fe import Case, Lattice, Material, Path, Support, finger_case, solve
from fe.case import Block, Clamp, Contact, Equation, Layer, SelfContact, Tie
from fe.deck.reader import read_deck
from fe.element import ELEMENTS, Array, barycentric
from fe.engines.calculix import CalculiX, without_hybrid
from fe.engines.writer import deck
from fe.mesh.convert import converted
from fe.obstacles import Flat
from fe.solver.newton import Problem, equilibrium

Cube = Callable[..., Case]
PRESSURE = 0.02  # MPa
ABAQUS = [name for name in ELEMENTS if name != "hex27"]


def at_pressure(case: Case, pressure: float = PRESSURE) -> Array:
    """Displacements (n, 3) mm of all nodes."""
    solution = solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, pressure]), np.array([1.0])))
    assert solution.reason == "converged"
    return solution.fields([0])[0]


@pytest.mark.parametrize("kind", ABAQUS)
def test_patches_of_every_element_carry_a_constant_strain(cube: Cube, kind: str) -> None:
    case = converted(cube((2, 2, 2), shift=0.08, seed=1), kind)
    F = np.eye(3) + np.array([[0.1, 0.05, 0.0], [0.02, -0.06, 0.04], [0.0, 0.03, 0.02]])
    F *= np.linalg.det(F) ** (-1 / 3) * 1.001 ** (1 / 3)
    straight = _straightened(case)
    u = straight.nodes @ (F - np.eye(3)).T
    rows = straight.node_sets["boundary"]
    held = Support("boundary", (0, 1, 2), u[rows])
    problem = Problem.of(replace(straight, supports=(held,)))
    found = equilibrium(problem, problem.start(), load=0.0)
    assert found.reason == "converged"
    np.testing.assert_allclose(found.state.u, u, atol=1e-9)


def _straightened(case: Case) -> Case:
    """The case with middle nodes in the middle of their edges, where polynomials of degree 2 are kept."""
    nodes, kind = case.nodes.copy(), case.element
    corners = 4 if kind.simplex else 8
    X = case.nodes[case.connectivity]
    linear = ELEMENTS["C3D8"].shape(kind.local)[0] if corners == 8 else barycentric(kind.local)
    nodes[case.connectivity] = np.einsum("ab,ebi->eai", linear, X[:, :corners])
    return replace(case, nodes=nodes)


@pytest.mark.parametrize("kind", ABAQUS)
def test_a_deck_that_was_written_reads_as_it_was(short: Case, tmp_path: File, kind: str) -> None:
    case = converted(short, kind)
    file = tmp_path / "finger.inp"
    file.write_text(deck(short, PRESSURE, kind=kind))
    found = read_deck(file)
    assert found.pressures == (PRESSURE,)
    order = np.argsort(case.labels)
    np.testing.assert_array_equal(found.case.labels, case.labels[order])
    np.testing.assert_allclose(found.case.nodes, case.nodes[order], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(order[found.case.connectivity], case.connectivity)
    np.testing.assert_array_equal(found.case.surfaces["chamber"], case.surfaces["chamber"])
    assert found.case.materials["body"].bulk_ratio == pytest.approx(1000.0)
    np.testing.assert_allclose(at_pressure(found.case), at_pressure(case)[order], atol=1e-6)


@pytest.mark.parametrize(
    "law",
    [
        Material(0.2, 0.1),
        Material(0.2, 0.1, C20=0.05),
        Material(C10=0.2, C20=-0.01, C30=0.003, bulk_ratio=500),
        Material(ogden=((0.3, 1.8), (0.02, 6.0), (-0.05, -2.0))),
        Material(chains=(0.4, 3.0)),
        Material(0.2, 0.1, mullins=(0.4, 0.003, 0.2)),
    ],
)
def test_every_law_survives_the_round_trip(short: Case, tmp_path: File, law: Material) -> None:
    file = tmp_path / "finger.inp"
    file.write_text(deck(replace(short, materials={"body": law}), PRESSURE))
    found = read_deck(file).case.materials["body"]
    np.testing.assert_allclose(found.constants, law.constants)
    assert found.bulk == pytest.approx(law.bulk)
    assert found.mullins == (pytest.approx(law.mullins) if law.mullins else None)


def test_calculix_agrees_on_the_very_deck(stub: Case, require: Callable[[str], None], tmp_path: File) -> None:
    require("ccx")
    text = deck(replace(stub, forces={"tip_face": np.array([0.0, 0.0, -0.01])}), PRESSURE, kind="C3D20RH")
    theirs = CalculiX().run(text)
    assert theirs.reason == "converged"
    file = tmp_path / "finger.inp"
    file.write_text(text)
    case = read_deck(file).case
    ours = at_pressure(case)
    # 0.1 %: both interpolate alike; the pressure at its 8 Gauss points stands for a bulk modulus there
    assert np.abs(ours - theirs.u).max() < 1e-3 * np.abs(theirs.u).max()
    np.testing.assert_array_equal(theirs.labels, case.labels)


def test_calculix_agrees_on_a_deck_of_two_materials(
    stub: Case, require: Callable[[str], None], tmp_path: File
) -> None:
    require("ccx")
    under = stub.nodes[stub.connectivity].mean(axis=1)[:, 2] < 10.0  # mm, half the height
    sets = {"wall": np.flatnonzero(~under), "sole": np.flatnonzero(under)}
    soft = Material(0.2, 0.1)
    ours, theirs = [], []
    for sole in (soft, Material(0.5, 0.15, bulk_ratio=500)):
        text = deck(replace(stub, element_sets=sets, materials={"wall": soft, "sole": sole}), PRESSURE)
        file = tmp_path / "two.inp"
        file.write_text(text)
        case, found = read_deck(file).case, CalculiX().run(text)
        assert (case.materials["sole"].C10, case.materials["sole"].C01) == (sole.C10, sole.C01)
        np.testing.assert_array_equal(case.element_sets["sole"], sets["sole"])
        assert found.reason == "converged"
        tip = int(np.flatnonzero(case.labels == 4401)[0])
        ours.append(at_pressure(case)[tip])
        theirs.append(found.at(4401))
    for mine, other in zip(ours, theirs, strict=True):  # 0.1 %: as on a deck of one material
        assert np.linalg.norm(mine - other) < 1e-3 * np.linalg.norm(other)
    change = theirs[1] - theirs[0]
    assert np.linalg.norm(change) > 0.1 * np.linalg.norm(theirs[0])
    assert np.linalg.norm(ours[1] - ours[0] - change) < 0.02 * np.linalg.norm(change)


def test_calculix_that_is_absent_or_fails_says_so(short: Case, require: Callable[[str], None]) -> None:
    with pytest.raises(FileNotFoundError, match="calculix-ccx"):
        CalculiX(executable="no-such-ccx").run("")
    require("ccx")
    found = CalculiX().run("*STEP\n*STATIC\n*END STEP\n")
    assert not found.converged
    assert found.reason


def test_only_the_h_of_the_element_type_is_dropped(short: Case) -> None:
    text = deck(short, PRESSURE)
    changed = [(a, b) for a, b in zip(text.splitlines(), without_hybrid(text).splitlines(), strict=True) if a != b]
    assert changed == [
        ("*ELEMENT, TYPE=C3D20RH, ELSET=ALL_ELEMENTS", "*ELEMENT, TYPE=C3D20R, ELSET=ALL_ELEMENTS")
    ]


def test_tetrahedra_bend_without_locking(cube: Cube) -> None:
    def tip(kind: str, ratio: float) -> float:
        case = cube((6, 1, 1), material=Material(0.2, 0.1, bulk_ratio=ratio))
        nodes = case.nodes * [10.0, 1.0, 1.0]
        beam = replace(case, nodes=nodes, supports=(Support("x0", (0, 1, 2)),), forces={"x1": np.array([0, 0, -5e-5])})
        beam = converted(beam, kind) if kind != "hex27" else beam
        problem = Problem.of(beam)
        found = equilibrium(problem, problem.start(), load=0.0)
        assert found.reason == "converged"
        return float(found.state.u[beam.node_sets["x1"], 2].mean())

    # a locked mesh stiffens without bound as K / mu grows
    assert tip("C3D10", 1e5) == pytest.approx(tip("C3D10", 1e2), rel=0.02)
    # one cell through the depth: the tetrahedra's own error is 7 %
    assert tip("C3D10", 1e5) == pytest.approx(tip("hex27", 1e5), rel=0.1)


CAE = """\
*Heading
** written as Abaqus/CAE does
*Part, name=Bar
*Node
      1, 0., 0., 0.
      2, 2., 0., 0.
      3, 2., 1., 0.
      4, 0., 1., 0.
      5, 0., 0., 1.
      6, 2., 0., 1.
      7, 2., 1., 1.
      8, 0., 1., 1.
    900, 5., 5., 5.
*Element, type=C3D8H
7, 1, 2, 3, 4,
 5, 6, 7, 8
*Nset, nset=Base
 1, 4, 5, 8
*Elset, elset=All, generate
 7, 7, 1
*Solid Section, elset=All, material=Silicone
,
*End Part
*Assembly, name=Assembly
*Instance, name=Bar-1, part=Bar
*End Instance
*Elset, elset=_Press_S4, internal, instance=Bar-1
 7,
*Surface, type=ELEMENT, name=Press
_Press_S4, S4
*End Assembly
*Material, name=Silicone
*Density
1.1e-9,
*Hyperelastic, neo hooke
0.2, 0.005
*Boundary
Base, ENCASTRE
*Step, name=Step-1, nlgeom=YES
*Static
0.1, 1., 1e-05, 1.
*Dsload
Press, P, 0.01
*Output, field, variable=PRESELECT
*End Step
"""


def test_a_deck_of_abaqus_cae(tmp_path: File) -> None:
    file = tmp_path / "cae.inp"
    file.write_text(CAE)
    found = read_deck(file)
    assert found.pressures == (0.01,)
    assert found.case.element.name == "C3D8H"
    assert list(found.case.labels) == [1, 2, 3, 4, 5, 6, 7, 8]  # 900 belongs to no element
    assert found.case.materials["all"] == Material(0.2, bulk_ratio=2 / 0.005 / 0.4, density=1.1e-9)
    u = at_pressure(found.case, 0.01)
    # a pressure on the end face: shortened by about p L / (3 mu), less for the clamped base
    assert -0.01 * 2 / 1.2 < u[1, 0] < -0.6 * 0.01 * 2 / 1.2


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("*Density", "*Viscoelastic, time=PRONY", r"line 33: \*VISCOELASTIC before or without \*HYPERELASTIC"),
        ("*Density", "*Plastic", r"not supported: \*PLASTIC \(line 33\)"),
        ("type=C3D8H", "type=CGAX4", "line 14: element type CGAX4: wanted one of C3D20R"),
        (" 5, 6, 7, 8\n", " 5, 6, 7\n", "line 14: element 7 has 7 nodes; C3D8H wants 8"),
        ("7, 1, 2, 3, 4,", "7, 1, 2, 3, 44,", "node 44 is used but not defined"),
        ("5., 5., 5.", "5., x, 5.", "line 13: 900, 5., x, 5.: wanted finite numbers"),
        ("nlgeom=YES", "nlgeom=NO", r"line 39: \*STEP without NLGEOM"),
        ("Base, ENCASTRE", "Bass, ENCASTRE", "line 38: set Bass: not defined above; wanted one of base"),
        ("      1, 0., 0., 0.\n", " 1, nan, 0., 0.\n", "wanted finite numbers"),
        ("      1, 0., 0., 0.\n", " 1, 1e308, 0., 0.\n", "node 1 lies farther than 100000 from the origin: wanted mm"),
        ("      1, 0., 0., 0.\n", " 50.5, 0., 0., 0.\n", "50.5: wanted a whole number, 1 to 1000000000"),
        ("      1, 0., 0., 0.\n", " 1, 0., 0., 0.\n 1, 0., 0., 1.\n", "node 1 is defined twice, at different places"),
        ("      1, 0., 0., 0.\n", " 12345678901234567890, 0., 0., 0.\n", "wanted a whole number, 1 to 1000000000"),
        ("Base, ENCASTRE", "Base, 9", "line 38: 9: wanted a whole number, 1 to 6"),
        ("Base, ENCASTRE", "Base, 1, 1000000000000", "wanted a whole number, 1 to 6"),
        ("_Press_S4, S4", "_Press_S4, S9", "face S9: wanted S1, S2 .. S6"),
        ("1.1e-9,", "1100.,", r"\*DENSITY 1100: wanted tonne/mm3, such as 1.07e-09 for 1070 kg/m3"),
        ("0.2, 0.005", "0., 0.005", "with a shear modulus of 0 MPa and D1 = 0.005: wanted a shear modulus above 0"),
        ("0.2, 0.005", "0.2, -0.005", "D1 0 or more"),
        ("*Boundary", "*Nset, nset=n, generate\n1, 1000000000, 1\n*Boundary", "wanted first <= last and at most 10000000 members"),
        ("*Boundary", "*Nset, nset=n, generate\n1, 1e12\n*Boundary", "1e12: wanted a whole number"),
        ("Press, P, 0.01", "Pres, P, 0.01", "surface Pres: not defined; wanted one of press"),
        ("Press, P, 0.01", "Press, HP, 0.01", r"\*DSLOAD HP: wanted P"),
        ("*Dsload", "*Dsload, amplitude=A", r"\*DSLOAD, AMPLITUDE=A: not defined above"),
        ("_Press_S4, S4", "_Press_S4, SPOS", "face SPOS or SNEG of element 7, but C3D8H has the faces S1 to S6"),
        ("neo hooke", "van der waals", r"\*HYPERELASTIC VAN DER WAALS: wanted Mooney-Rivlin"),
        ("neo hooke", "test data input", "from test data: wanted constants"),
        ("*Boundary", "*Mullins Effect\n0.9, 0.01, 0.1\n*Boundary", "line 38: .*r 0.9, m 0.01, beta 0.1: wanted r > 1"),
        ("*Hyperelastic, neo hooke\n0.2, 0.005\n", "*Hyperelastic, neo hooke\n", "line 35: .HYPERELASTIC: its data lines hold too little"),
        ("*Boundary", "*Mullins Effect\n*Boundary", "line 37: .MULLINS EFFECT: its data lines hold too little"),
        ("*Density", "*Mullins Effect\n2., 0.01, 0.1\n*Density", "before .HYPERELASTIC: wanted it below"),
        ("*Hyperelastic, neo hooke\n0.2, 0.005\n", "", r"material 'silicone' has no \*HYPERELASTIC"),
        ("*Solid Section, elset=All, material=Silicone\n,\n", "", r"element 7 has 0 \*SOLID SECTIONs"),
    ],
)  # fmt: skip
def test_what_a_deck_lacks_is_named_with_its_line(tmp_path: File, old: str, new: str, told: str) -> None:
    assert old in CAE
    file = tmp_path / "bad.inp"
    file.write_text(CAE.replace(old, new))
    with pytest.raises(ValueError, match=told):
        read_deck(file)


def test_two_types_on_the_same_nodes_are_two_meshes(short: Case) -> None:
    reduced, full = (at_pressure(converted(short, kind)) for kind in ("C3D20R", "C3D20"))
    assert np.abs(reduced - full).max() > 0.05 * np.abs(full).max()


def test_tetrahedra_that_do_not_fit_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit each other"):
        converted(finger_case(Material(0.2, 0.1), lattice=Lattice(per_bellow=2, centred=False)), "C3D10")


def test_a_plane_stands_under_the_structure_with_all_it_does(short: Case) -> None:
    tilted = Contact("outside", Flat((0.3, 0.0, 2.0), -5.0), 0.7, 0.4)
    lines = deck(replace(short, contact=tilted), PRESSURE).splitlines()
    at = lines.index("*NODE, NSET=OBSTACLE_NODES")
    rows = np.array([[float(w) for w in line.split(",")] for line in lines[at + 1 : at + 9]])
    brick = [int(w) for w in lines[at + 10].split(",")[1:]]
    x = rows[np.searchsorted(rows[:, 0], brick), 1:]
    n = np.array([0.3, 0.0, 2.0]) / np.hypot(0.3, 2.0)
    np.testing.assert_allclose(x[4:] @ n, -5.0, atol=1e-8)  # S2, the upper face of C3D8, is on the plane
    assert (x[:4] @ n < -6.0).all()
    assert np.cross(x[5] - x[4], x[7] - x[4]) @ n > 0  # its numbering is right-handed
    pair = lines.index("*SURFACE INTERACTION, NAME=TOUCH")
    assert lines[pair + 1 : pair + 7] == [
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", "0.7,", "*FRICTION", "0.4, 0.7",
        "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE", "TOUCHING, OBSTACLE_SKIN",
    ]  # fmt: skip
    assert short.clamp is not None
    held = set(short.labels[short.node_sets[short.clamp.nodes]])
    first = lines.index("*SURFACE, NAME=TOUCHING, TYPE=ELEMENT")
    faces = lines[first + 1 : lines.index("*SURFACE INTERACTION, NAME=TOUCH")]
    element, side = np.array([[int(w.strip(" S")) for w in line.split(",")] for line in faces]).T
    case = converted(short, "C3D20RH")
    rows = np.take_along_axis(case.connectivity[element - 1], case.element.faces[side - 1], axis=1)
    assert len(rows) > 50
    assert not held & set(case.labels[rows].ravel())  # as in the kernel


def test_calculix_agrees_on_a_sheet(cube: Cube, require: Callable[[str], None]) -> None:
    require("ccx")
    case = cube((4, 2, 2), supports=(Support("x0", (0, 1, 2)),), pressurised="z1")
    case = converted(replace(case, nodes=case.nodes * [6.0, 1.0, 1.0]), "C3D20R")
    ours, theirs = [], []
    for layer in (None, Layer("z0", 1.0)):
        bonded = replace(case, layer=layer)
        found = CalculiX().solve(bonded, 1e-3)
        assert found.reason == "converged"
        ours.append(at_pressure(bonded, 1e-3))
        theirs.append(np.array([found.at(n) for n in case.labels]))
    effect = ours[1] - ours[0]
    assert np.abs(effect).max() > 0.4  # mm, of 1
    np.testing.assert_allclose(effect, theirs[1] - theirs[0], rtol=0, atol=0.02 * np.abs(effect).max())


def test_calculix_refuses_what_it_does_not_know(short: Case) -> None:
    with pytest.raises(ValueError, match="Mullins softening: CalculiX knows none"):
        CalculiX().solve(short.with_material(mullins=(0.4, 0.003, 0.2)), PRESSURE)


@pytest.mark.parametrize(
    "law",
    [
        {"C10": 0.15, "C01": 0.1, "C20": 0.05},
        {"ogden": ((0.3, 2.0), (0.1, 5.0), (0.1, -2.0))},
        {"chains": (0.4, 1.6)},
    ],
    ids=["polynomial of second order", "Ogden's three terms", "Arruda-Boyce"],
)
def test_calculix_takes_every_term_of_a_law(stub: Case, require: Callable[[str], None], law: dict[str, Any]) -> None:
    require("ccx")
    case = converted(stub.with_material(**{"C10": 0.0, "C01": 0.0, **law}), "C3D20R")
    found = CalculiX().solve(case, PRESSURE)
    assert found.reason == "converged"
    ours = at_pressure(case, PRESSURE)
    theirs = np.array([found.at(n) for n in case.labels])
    # six digits of a result, and its rubber's volume by another function
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-3 * np.abs(ours).max())


def test_calculix_stiffens_by_C20_as_much(stub: Case, require: Callable[[str], None]) -> None:
    require("ccx")
    tip = []
    for C20 in (0.0, 0.2):
        case = converted(stub.with_material(C01=0.0, C20=C20), "C3D20R")
        found = CalculiX().solve(case, PRESSURE)
        assert found.reason == "converged"
        k = np.abs(at_pressure(case)).max(axis=1).argmax()
        tip.append((np.linalg.norm(at_pressure(case)[k]), np.linalg.norm(found.at(case.labels[k]))))
    (soft, softly), (stiff, stiffly) = tip
    assert stiff < 0.99 * soft
    assert stiffly - softly == pytest.approx(stiff - soft, rel=0.05)  # C3D20R of one mesh in both engines


WRITTEN, NOT_OF_A_DECK = "", "-"
# What is told where a field of a case or a material has an unusual value, and that value.
FIELDS: dict[str, tuple[Callable[[Case], object], str]] = {
    "nodes": (lambda c: 1.1 * c.nodes, WRITTEN),
    "labels": (lambda c: c.labels + 10_000, WRITTEN),
    "blocks": (lambda c: (Block("C3D8", c.connectivity[:, :8]), *c.blocks), "elements of the types C3D8, hex27"),
    "node_sets": (lambda c: {**c.node_sets, "own": np.arange(3)}, WRITTEN),
    "element_sets": (lambda c: {**c.element_sets, "own": np.arange(3)}, WRITTEN),
    "surfaces": (lambda c: {**c.surfaces, "own": c.surfaces["chamber"][:3]}, WRITTEN),
    "materials": (lambda c: {"body": Material(0.3)}, WRITTEN),
    "supports": (lambda c: (), WRITTEN),
    "clamp": (lambda c: Clamp("base", (0.0, 10.0), 1e-3), "a deck holds a rigid clamp only"),
    "pressurised": (lambda c: None, WRITTEN),
    "forces": (lambda c: {"tip_face": np.array([0.0, 0.0, -0.01])}, WRITTEN),
    "growing": (lambda c: {"tip_face": np.array([0.0, 0.0, 0.5])}, WRITTEN),
    "kept": (lambda c: ("body",), NOT_OF_A_DECK),  # it is of the fit alone
    "precurvature": (lambda c: 1e-3, "without stress at rest"),
    "layer": (lambda c: Layer("outside", 1.0), WRITTEN),
    "layers": (lambda c: (Layer("outside", 1.0), Layer("chamber", 2.0)), WRITTEN),
    "self_contact": (lambda c: (SelfContact("outside", "chamber"),), WRITTEN),
    "shares": (lambda c: {"chamber": 0.5}, WRITTEN),
    "ties": (lambda c: (Tie("outside", "chamber", 0.1),), WRITTEN),
    "equations": (lambda c: (Equation(((4401, 0, 1.0), (5848, 0, -1.0))),), WRITTEN),
    "contact": (lambda c: Contact("outside", Flat((0.0, 0.0, 1.0), -5.0), 1.0), WRITTEN),
    "C10": (lambda c: 0.3, WRITTEN),
    "C01": (lambda c: 0.2, WRITTEN),
    "C20": (lambda c: 0.1, WRITTEN),
    "C30": (lambda c: 0.1, "C10, C01, C30: no law of a deck"),
    "bulk_ratio": (lambda c: 500.0, WRITTEN),
    "prony": (lambda c: ((0.1, 2.0),), "has a Prony series"),
    "gent": (lambda c: (0.3, 50.0), "has a term of Gent"),
    "ogden": (lambda c: ((0.1, 3.0),), "C10, C01, ogden: no law of a deck"),
    "chains": (lambda c: (0.1, 3.0), "C10, C01, chains: no law of a deck"),
    "mullins": (lambda c: (0.5, 0.01, 0.1), WRITTEN),
    "density": (lambda c: 1.1e-9, WRITTEN),
}


def test_shares_that_leave_faces_out_are_refused(short: Case) -> None:
    part = replace(short, surfaces={**short.surfaces, "part": short.surfaces["chamber"][1:]}, shares={"part": 0.5})
    with pytest.raises(ValueError, match="a share for each of its faces; name them all"):
        deck(part, PRESSURE)


@pytest.mark.parametrize("name", [f.name for kind in (Case, Material) for f in fields(kind)])
def test_every_field_is_written_or_refused_by_name(short: Case, name: str) -> None:
    value, told = FIELDS[name]
    if name in {f.name for f in fields(Material)}:
        changed = short.with_material(**{name: value(short)})
    else:
        changed = replace(short, **{name: value(short)})  # type: ignore[arg-type]
    if told in (WRITTEN, NOT_OF_A_DECK):
        assert (deck(changed, PRESSURE) == deck(short, PRESSURE)) == (told == NOT_OF_A_DECK)
    else:
        with pytest.raises(ValueError, match=told):
            deck(changed, PRESSURE)
