"""Decks as others write them: each feature read as the plain deck of the same structure, and as CalculiX has it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

from benchmarks.kernel import decks
from benchmarks.kernel.smalldecks import SOFT, lattice, meshed, rest

import numpy as np
import pytest

from fe import Case, Path, Variation, solve
from fe.case import Equation, Layer
from fe.deck.expressions import value_of
from fe.deck.reader import Deck, read_deck
from fe.deck.soundness import check_body
from fe.engines.engine import Embedded
from fe.engines.writer import deck as written
from fe.kernel.assembly import Kernel
from fe.kernel.pressure import PressureFaces
from fe.kernel.tying import dependence
from fe.mesh.refine import refined
from tests.messages import saying

PLAIN = meshed(lattice("C3D8"))


def read(folder: File, text: str, **files: str) -> Deck:
    for name, content in {"deck.inp": text, **files}.items():
        (folder / name).write_text("".join(f"{line}\n" for line in content.splitlines() if line.strip()))
    return read_deck(folder / "deck.inp")


def moved(case: Case, pressure: float = 0.01) -> np.ndarray:
    found = Embedded().solve(case, pressure)
    assert found.converged
    return found.u


# Those that take a second or less; the whole table is the benchmark.
QUICK = ("*PARAMETER", "*NGEN, *NFILL, *ELGEN", "units m, N", "C3D4", "C3D8", "C3D6", "*MEMBRANE SECTION, M3D3",
         "*SHELL SECTION, S4R by *TIE", "*TIE, other nodes", "*MPC, TIE", "*KINEMATIC", "two pressures")  # fmt: skip


@pytest.mark.parametrize("name", QUICK)
def test_calculix_agrees_on_a_feature(require: Callable[[str], None], name: str) -> None:
    require("ccx")
    assert decks.difference(decks.examples()[name]) < 0.01


@pytest.mark.slow
def test_calculix_agrees_on_every_feature(require: Callable[[str], None]) -> None:
    require("ccx")
    assert {name: d for name, d in decks.differences().items() if not d < 0.01} == {}


# -- words -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [("2 * (1 + 3) ** 2 / 4 - 1", 7.0), ("sqrt(a) + PI - pi", None), ("-a % 3", 2.0), ("'Root'", "Root")],
)
def test_an_expression_is_arithmetic(text: str, value: float | str | None) -> None:
    if value is None:
        with pytest.raises(ValueError, match="the parameter PI is not defined above"):
            value_of(text, {"a": 4.0})
        return
    assert value_of(text, {"a": 4.0}) == value


@pytest.mark.parametrize(
    "text",
    ["__import__('os').system('true')", "a.real", "(lambda: 1)()", "[1]", "9**9**9**9", "1/0", "1 if 1 else 2",
     "open('x')", "'a' * 9", "max(1, key=abs)", "True", "1" * 600, "sqrt(-1)"],
)  # fmt: skip
def test_an_expression_that_is_more_than_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"wanted|cannot be computed|not defined"):
        value_of(text, {"a": 1.0})


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("*DSLOAD", "*DSLOAD, AMPLITUDE=NONE", "AMPLITUDE=NONE: not defined above"),
        ("CHAMBER, P, 0.03", "CHAMBER, P, <p>", "<p>: no such parameter; define it above, under"),
        ("*STATIC", "*FLUID CAVITY", r"\*FLUID CAVITY \(line \d+\); .* remove it; the pressure must act on \*SURFACE"),
        ("*BOUNDARY", "*TIE\nCHAMBER, NOWHERE\n*BOUNDARY", "set NOWHERE: not defined above"),
        ("*BOUNDARY", "*RIGID BODY, TIE NSET=ROOT, REF NODE=1\n*BOUNDARY\n1, 1, 3", "its reference node 1 may turn"),
        ("*BOUNDARY", "*EQUATION\n2\n1, 1, 1., 2, 1, 0.\n*BOUNDARY", r"\*EQUATION with the factor 0"),
        ("*BOUNDARY", "*EQUATION\n3\n1, 1, 1., 2, 1, 1.\n*BOUNDARY", "its data lines hold too little"),
        ("*BOUNDARY", "*MPC\nSLIDER, 1, 2\n*BOUNDARY", r"\*MPC SLIDER: wanted TIE, PIN or BEAM"),
        ("0.1, 3.", "0.1, 3.\n*VISCOELASTIC, TIME=PRONY\n0.7, 0., 1.\n0.4, 0., 9.", "the g add up to 1.1"),
        (SOFT, "*ELASTIC\n-5., 0.3", r"\*ELASTIC -5, 0.3: wanted a modulus above 0"),
        ("*NODE, NSET=ALL", "** units: mm, parsec\n*NODE, NSET=ALL", "units mm, parsec: wanted one length"),
        ("*NODE, NSET=ALL", "** units: m, N, MPa\n*NODE, NSET=ALL", "the force does not go with the others"),
    ],
)  # fmt: skip
def test_what_is_refused_is_named_with_its_line(tmp_path: File, old: str, new: str, told: str) -> None:
    text = PLAIN + rest()
    assert old in text
    with pytest.raises(ValueError, match=told) as error:
        read(tmp_path, text.replace(old, new, 1))
    assert "line" in str(error.value)


def test_units_reach_every_number(tmp_path: File) -> None:
    more = "*MEMBRANE SECTION, ELSET=SKIN, MATERIAL=PAPER\n0.05,\n*MATERIAL, NAME=PAPER\n*ELASTIC\n100., 0.3"
    floor = PLAIN.partition("*ELEMENT, TYPE=C3D8, ELSET=BODY\n")[2].splitlines()[0].split(",")
    sheet = f"*ELEMENT, TYPE=M3D4, ELSET=SKIN\n9000, {','.join(floor[1:5])}\n{more}\n"
    law = "*HYPERELASTIC, OGDEN, N=1\n0.4, 2.6, 0.02\n*DENSITY\n1.07e-9"
    text = PLAIN + sheet + rest(law, held=f"{floor[1]}, 1, 1, 0.5", load="*DSLOAD\nCHAMBER, P, 0.03\n*CLOAD\nALL, 2, 0.1\n*DLOAD\n, GRAV, 9810., 0., 0., -1.")
    here = read(tmp_path, text)
    there = read(tmp_path, "** Units = cm, kPa\n" + text)
    assert there.case.layers[0].stiffness == pytest.approx(here.case.layers[0].stiffness * 10 / 1000)  # type: ignore[arg-type]
    np.testing.assert_allclose(there.case.nodes, 10 * here.case.nodes)
    (one,), (other,) = (tuple(d.case.materials.values()) for d in (here, there))
    assert other.ogden == ((pytest.approx(one.ogden[0][0] / 1000), 2.6),)
    assert other.bulk == pytest.approx(one.bulk / 1000)
    assert other.density == pytest.approx(one.density * 1e-3 / 100)  # kPa s2 / cm2
    assert there.pressures[0] == pytest.approx(here.pressures[0] / 1000)
    np.testing.assert_allclose(there.gravity, 10 * here.gravity)
    np.testing.assert_allclose(there.case.forces["all"], here.case.forces["all"] * 100 / 1000)
    assert np.abs(there.case.prescribed).max() == pytest.approx(5.0)


def test_a_prony_series_is_read_with_long_term_or_instantaneous_constants(tmp_path: File) -> None:
    prony = "\n*VISCOELASTIC, TIME=PRONY\n0.2, 0., 1.5\n0.1, 0., 40.\n"
    long_term, now = (
        next(iter(read(tmp_path, PLAIN + rest(SOFT.replace("HOOKE", f"HOOKE{moduli}") + prony)).case.materials.values()))
        for moduli in ("", ", MODULI=INSTANTANEOUS")
    )
    assert now.prony == long_term.prony == ((0.2, 1.5), (0.1, 40.0))
    assert now.C10 == 0.1
    assert pytest.approx(0.1) == long_term.C10 * (1 - 0.3)  # after all relaxation
    assert long_term.bulk == pytest.approx(now.bulk) == pytest.approx(2 / 3)


def test_what_is_read_as_something_else_is_told(tmp_path: File) -> None:
    text = "*AMPLITUDE, NAME=A\n0., 0., 1., -0.5\n" + PLAIN + rest(load="*DSLOAD, AMPLITUDE=A\nCHAMBER, P, -0.06")
    deck = read(tmp_path, text.replace("C3D8", "C3D8R"))
    assert deck.pressures == (0.03,)
    assert deck.remarks == (
        "*DSLOAD follows the amplitude A: it is read at its largest value, -0.5.",
        "Elements C3D8R are read as 27-node elements on the same mesh.",
    )
    assert deck.case.element.name == "hex27"


# -- elements ----------------------------------------------------------------------------------------------


def test_mixed_shapes_are_one_body_with_its_faces_and_sets(tmp_path: File) -> None:
    plain = read(tmp_path, PLAIN + rest()).case
    mesh = lattice("C3D8", other=("C3D6", lambda cell: cell[0] > 2))
    text = meshed(mesh) + rest()
    deck = read(tmp_path, text)
    assert deck.case.element.name == "C3D10H"
    assert len(deck.elements) == len(deck.case.connectivity)
    np.testing.assert_array_equal(np.sort(deck.case.node_sets["root"]), np.flatnonzero(deck.case.nodes[:, 0] == 0))
    check_body(deck.case, "deck.inp")
    volume, area = (
        [Kernel(c).geometry.weight.sum() for c in (plain, deck.case)],
        [PressureFaces(c.face_nodes("chamber"), c.element, len(c.nodes)).force(c.nodes).sum() for c in (plain, deck.case)],
    )
    assert volume[1] == pytest.approx(volume[0], rel=1e-12)
    assert area[1] == pytest.approx(area[0], abs=1e-9)


# -- joints ------------------------------------------------------------------------------------------------


def halves(folder: File, first: int = 1) -> Case:
    """The hollow block in two meshes whose nodes differ where they are tied."""
    return read(folder, decks.examples()["*TIE, other nodes"].deck).case


def test_tied_nodes_move_with_the_faces_that_they_lie_on(tmp_path: File) -> None:
    case = halves(tmp_path)
    tied = dependence(case)
    assert tied is not None
    np.testing.assert_allclose(tied.weights.sum(axis=1), 1.0, rtol=1e-12)  # a translation passes
    turn = np.cross([0.2, -0.1, 0.3], case.nodes)
    np.testing.assert_allclose(tied.followed(turn), turn, atol=1e-9)  # and so does a rotation
    u = moved(case, 1e-4)
    np.testing.assert_allclose(tied.followed(u), u, rtol=0, atol=1e-12)
    assert len(moved(refined(case), 1e-4)) > 4 * len(u)


def test_the_tangent_of_a_tied_structure_is_that_of_its_residual(tmp_path: File) -> None:
    """Newton's method ends in few steps, and a derivative is the difference of two solves."""
    case = halves(tmp_path)
    path = Path(np.array([0.0, 1.0]), np.array([0.0, 5e-4]), np.array([1.0]))
    soft, step = next(iter(case.materials.values())), 1e-4
    sides = [case.with_material(C10=soft.C10 + s * step) for s in (1, -1)]
    found = solve(case, path, variations=[Variation((sides[0], path), (sides[1], path), step)])
    x = case.nodes[case.labels == case.labels.max()]
    ends = [solve(side, path).at(x) for side in sides]
    np.testing.assert_allclose(found.variations_at(x)[0], (ends[0] - ends[1]) / (2 * step), rtol=1e-4, atol=1e-7)


def test_equations_in_a_circle_are_refused(tmp_path: File) -> None:
    case = read(tmp_path, PLAIN + rest()).case
    a, b = (int(n) for n in case.labels[np.argsort(-case.nodes[:, 0])[:2]])
    circle = (Equation(((a, 0, 1.0), (b, 0, -2.0))), Equation(((b, 0, 1.0), (a, 0, -2.0))))
    with pytest.raises(ValueError, match="follow each other in a circle"):
        dependence(replace(case, equations=circle))


def test_several_layers_add_up_and_are_written(tmp_path: File) -> None:
    case = read(tmp_path, PLAIN + rest()).case
    case = replace(case, surfaces=case.surfaces | {"floor": np.array([[e, 0] for e in range(3)])})
    one = replace(case, layer=Layer("floor", 5.0))
    two = replace(case, layers=(Layer("floor", 2.0), Layer("floor", 3.0)))
    np.testing.assert_allclose(moved(two), moved(one), rtol=1e-9, atol=1e-12)
    text = written(replace(two, clamp=None), 0.01)
    assert text.count("*MEMBRANE SECTION") == 2
    assert len({line for line in text.splitlines() if line.startswith("*ELEMENT, TYPE=M3D4")}) == 2


def test_a_sheet_that_bonds_to_nothing_is_refused(tmp_path: File) -> None:
    text = decks.examples()["*SHELL SECTION, S4R by *TIE"].deck
    assert read(tmp_path, text).case.layers[0].stiffness == pytest.approx(5.0)  # 0.05 mm x 100 MPa
    with pytest.raises(ValueError, match=saying("5001", r"\*TIE")):
        read(tmp_path, text.replace("*TIE, NAME=GLUE\nSHEET, FLOOR\n", ""))


def test_a_pressure_of_two_surfaces_keeps_their_ratio(tmp_path: File) -> None:
    deck = read(tmp_path, decks.examples()["two pressures"].deck)
    assert deck.pressures == (0.06,)
    assert dict(deck.case.shares) == {"chamber": 1.0, "second": 0.5}
    check_body(deck.case, "deck.inp")
    again = read(tmp_path, written(replace(deck.case, clamp=None), 0.06))
    assert dict(again.case.shares) == {"chamber": 1.0, "second": 0.5}
    same = replace(deck.case, shares={})
    assert np.abs(moved(same, 0.01) - moved(deck.case, 0.01)).max() > 1e-3


CHAMBERS = "*DSLOAD\nCHAMBER, P, 0.06\nSECOND, P, 0.03"


@pytest.mark.parametrize(("second", "told"), [("0., 0., 1., 0.5", False), ("0., 0., 1., 0., 2., 1.", True)])
def test_pressures_that_do_not_rise_together_are_told(tmp_path: File, second: str, told: bool) -> None:
    text = decks.examples()["two pressures"].deck
    ramps = f"*AMPLITUDE, NAME=ONE\n0., 0., 1., 1.\n*AMPLITUDE, NAME=TWO\n{second}\n"
    load = "*DSLOAD, AMPLITUDE=ONE\nCHAMBER, P, 0.06\n*DSLOAD, AMPLITUDE=TWO\nSECOND, P, 0.03"
    deck = read(tmp_path, ramps + text.replace(CHAMBERS, load))
    assert dict(deck.case.shares) == {"chamber": 1.0, "second": 0.25 if "0.5" in second else 0.5}
    assert any("state pressure_shares in each" in remark for remark in deck.remarks) == told


def test_a_chamber_that_is_filled_in_a_later_step_is_told(tmp_path: File) -> None:
    text = decks.examples()["two pressures"].deck
    first, end = "*DSLOAD\nCHAMBER, P, 0.06", text.partition(CHAMBERS)[2]
    later = text.replace(CHAMBERS, f"{first}{end}*STEP, NLGEOM\n*STATIC\n*DSLOAD\nSECOND, P, 0.06")
    deck = read(tmp_path, later)
    assert deck.pressures == (0.06, 0.06)
    assert any("chamber and second are not filled at one time" in remark for remark in deck.remarks)
    assert dict(read(tmp_path, later.replace("SECOND, P, 0.06", "SECOND, P, 0.12")).case.shares)["chamber"] == 0.5
    with pytest.raises(ValueError, match="in another ratio than in the step before"):
        read(tmp_path, text + "*STEP, NLGEOM\n*STATIC\n*DSLOAD\nSECOND, P, 0.06\n*END STEP\n")


def test_instances_keep_their_own_sets(tmp_path: File) -> None:
    deck = read(tmp_path, decks.examples()["*PART, *INSTANCE"].deck)
    names = set(deck.case.node_sets)
    assert {"block-1.set-1", "slab-1.set-1", "root"} <= names
    assert set(deck.case.materials) == {"block-1.body", "slab-1.body"}
    assert deck.case.ties == ()  # all nodes coincide: they became one
    assert any("added to their labels" in remark for remark in deck.remarks)
    check_body(deck.case, "deck.inp")


@pytest.mark.parametrize("name", ["*TIE, other nodes", "*EQUATION", "*PART, *INSTANCE"])
def test_joints_are_written_as_they_were_read(tmp_path: File, name: str) -> None:
    case = read(tmp_path, decks.examples()[name].deck).case
    again = read(tmp_path, written(case, 1e-3)).case
    assert (len(again.ties), len(again.equations)) == (len(case.ties), len(case.equations))
    np.testing.assert_array_equal(again.labels, case.labels)
    np.testing.assert_allclose(again.nodes, case.nodes, atol=1e-8)
    one, other = dependence(case), dependence(again)
    assert (one is None) == (other is None)
    if one is not None and other is not None:
        np.testing.assert_allclose(other.weights.toarray(), one.weights.toarray(), atol=1e-6)


def test_a_set_of_the_assembly_is_another_than_that_of_the_part(tmp_path: File) -> None:
    text = PLAIN.replace("*NSET, NSET=ROOT", "*NSET, NSET=SET-1\n1,\n*NSET, NSET=ROOT")
    body = "*PART, NAME=P\n" + text + "*SOLID SECTION, ELSET=BODY, MATERIAL=RUBBER\n*END PART\n"
    place = "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n*END INSTANCE\n*NSET, NSET=SET-1, INSTANCE=P-1\n3,\n*END ASSEMBLY\n"
    case = read(tmp_path, body + place + rest().replace("*SOLID SECTION, ELSET=BODY, MATERIAL=RUBBER\n", "")).case
    assert [int(n) for n in case.labels[case.node_sets["set-1"]]] == [3]
    assert [int(n) for n in case.labels[case.node_sets["p-1.set-1"]]] == [1]


