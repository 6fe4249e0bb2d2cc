"""Fields and loads of a deck: texts that mean the same are read as the same, and CalculiX solves them alike."""

from collections.abc import Callable
from pathlib import Path as File

import numpy as np
import pytest

from fe.deck.reader import Deck, read_deck
from fe.engines.calculix import CalculiX
from tests.messages import saying

CUBE = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
*ELEMENT, TYPE=C3D8, ELSET=E
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=BASE
1, 2, 3, 4
*NSET, NSET=TOP
5, 6, 7, 8
*SURFACE, NAME=LID, TYPE=ELEMENT
1, S2
*SURFACE, NAME=SIDE, TYPE=ELEMENT
1, S4
*SOLID SECTION, ELSET=E, MATERIAL=M
,
*MATERIAL, NAME=M
{material}
*DENSITY
1e-9
{amplitude}
*BOUNDARY
BASE, 1, 3
"""
LAW = "*HYPERELASTIC, MOONEY-RIVLIN\n0.03, 0.015, 0.3"
PRESS = "*DSLOAD\nLID, P, 0.01"
RAMP = "*AMPLITUDE, NAME=A\n0., 0., 1., 2."


def text(*steps: str, material: str = LAW, amplitude: str = "") -> str:
    """A deck of a cube (1 mm) with these steps."""
    loaded = "".join(f"*STEP, NLGEOM\n*STATIC\n0.25, 1.\n{s}\n*NODE FILE\nU\n*END STEP\n" for s in steps)
    whole = CUBE.format(material=material, amplitude=amplitude) + loaded
    return "".join(f"{line}\n" for line in whole.splitlines() if line)


def read(folder: File, deck: str) -> Deck:
    (folder / "cube.inp").write_text(deck)
    return read_deck(folder / "cube.inp")


def law(constants: str) -> str:
    return f"*HYPERELASTIC, {constants}"


def grav(size: float, *way: float, keyword: str = "*DLOAD") -> str:
    return f"{keyword}\nE, GRAV, {size}, " + ", ".join(map(str, way))


# By name: the text as others write it, and its plain form.
SAME_LAW = {
    "C01 empty": (law("MOONEY-RIVLIN\n0.045, , 0.3"), law("MOONEY-RIVLIN\n0.045, 0., 0.3")),
    "C20 empty": (law("YEOH\n0.05, , 0.002, 0.3"), law("YEOH\n0.05, 0., 0.002, 0.3, 0., 0.")),
    "second order empty": (law("POLYNOMIAL, N=2\n0.03,0.01,0.001,,,0.3,"), law("POLYNOMIAL, N=2\n0.03,0.01,0.001,0,0,0.3,0")),
    "alpha of 8 to a line": (law("OGDEN, N=3\n0.03,2.,0.02,3.,0.01,-1.,0.3,\n0."), law("OGDEN, N=3\n0.03,2.,0.02,3.,0.01,-1.,0.3,0.\n0.")),
    "two temperatures": (law("MOONEY-RIVLIN\n0.045, , 0.3, 20.\n0.09, 0.1, 0.3, 60."), law("MOONEY-RIVLIN\n0.045, 0., 0.3")),
    "comma at the end": (law("NEO HOOKE\n0.045, 0.3,"), law("NEO HOOKE\n0.045, 0.3")),
}  # fmt: skip
SAME_LOADS = {
    "two GRAV": ([grav(9810, 0, 0, -1) + "\nE, GRAV, 19620, 0, 1, 0"], [grav(float(np.hypot(9810, 19620)), 0, 2, -1)]),
    "GRAV twice": ([grav(9810, 0, 0, -1) + "\nE, GRAV, 9810, 0, 0, -1"], [grav(19620, 0, 0, -1)]),
    "two keywords": ([grav(9810, 0, 0, -1) + "\n" + grav(19620, 0, 1, 0)], [grav(float(np.hypot(9810, 19620)), 0, 2, -1)]),
    "GRAV that grows": ([grav(9810, 0, 0, -1), grav(19620, 0, 0, -1)], [grav(19620, 0, 0, -1)]),
    "GRAV anew": ([grav(9810, 0, 0, -1), grav(9810, 0, 1, 0, keyword="*DLOAD, OP=NEW")], [grav(9810, 0, 1, 0)]),
    "GRAV by an amplitude": ([grav(9810, 0, 0, -1, keyword="*DLOAD, AMPLITUDE=A")], [grav(19620, 0, 0, -1)]),
    "direction cut short": (["*DLOAD\nE, GRAV, 9810, , 1."], [grav(9810, 0, 1, 0)]),
    "faces again": (["*DLOAD\nE, P2, 0.004", "*DLOAD\nE, P2, 0.006"], ["*DSLOAD\nLID, P, 0.006"]),
    "faces anew": (["*DLOAD\nE, P2, 0.004", "*DLOAD, OP=NEW\nE, P2, 0.006"], ["*DSLOAD\nLID, P, 0.006"]),
    "surface again": ([PRESS, "*DSLOAD\nLID, P, 0.02"], ["*DSLOAD\nLID, P, 0.02"]),
    "other surface anew": ([PRESS, "*DSLOAD, OP=NEW\nSIDE, P, 0.01"], None),
    "surface twice": ([PRESS + "\nLID, P, 0.01"], ["*DSLOAD\nLID, P, 0.02"]),
    "face and surface": (["*DLOAD\nE, P2, 0.01\n" + PRESS], ["*DSLOAD\nLID, P, 0.02"]),
    "weight off": ([PRESS + "\n" + grav(9810, 0, 0, -1), "*DLOAD, OP=NEW\nE, P2, 0.01"], [PRESS]),
    "force twice": (["*CLOAD\nTOP, 3, 0.001\nTOP, 3, 0.001"], ["*CLOAD\nTOP, 3, 0.002"]),
    "force and node": (["*CLOAD\nTOP, 3, 0.001\n5, 3, 0.001"], ["*CLOAD\n6, 3, 0.001\n7, 3, 0.001\n8, 3, 0.001\n5, 3, 0.002"]),
    "force again": (["*CLOAD\nTOP, 3, 0.001", "*CLOAD\nTOP, 3, 0.002"], ["*CLOAD\nTOP, 3, 0.002"]),
    "node, then its set": (["*CLOAD\n5, 3, 0.001", "*CLOAD\nTOP, 3, 0.002"], ["*CLOAD\nTOP, 3, 0.002"]),
    "force anew": (["*CLOAD\nTOP, 3, 0.001", "*CLOAD, OP=NEW\nTOP, 1, 0.002"], ["*CLOAD\nTOP, 1, 0.002"]),
    "force stays": (["*CLOAD\nTOP, 3, 0.001", "*CLOAD\nTOP, 1, 0.002"], ["*CLOAD\nTOP, 3, 0.001\nTOP, 1, 0.002"]),
    "moved again": (["*BOUNDARY\nTOP, 3, 3, 0.1", "*BOUNDARY\nTOP, 3, , 0.2"], ["*BOUNDARY\nTOP, 3, 3, 0.2"]),
    "sets, then all": (["*CLOAD\n5, 3, 0.001\nTOP, 1, 0.001", "*CLOAD\nTOP, 3, 0.002"], ["*CLOAD\nTOP, 3, 0.002\nTOP, 1, 0.001"]),
    "anew in one step": (["*CLOAD\nTOP, 2, 0.001", "*CLOAD, OP=NEW\nTOP, 3, 0.001\n*CLOAD, OP=NEW\nTOP, 1, 0.002"], ["*CLOAD\nTOP, 3, 0.001\nTOP, 1, 0.002"]),
    "anew in two steps": (["*CLOAD\nTOP, 2, 0.001", "*CLOAD, OP=NEW\nTOP, 3, 0.001", "*CLOAD, OP=NEW\nTOP, 1, 0.002"], ["*CLOAD\nTOP, 1, 0.002"]),
    "weight off by a surface": ([PRESS + "\n" + grav(9810, 0, 0, -1), PRESS.replace("AD", "AD, OP=NEW")], [PRESS]),
    "faces and surface anew": ([PRESS, "*DLOAD, OP=NEW\nE, P2, 0.006\n*DSLOAD, OP=NEW\nLID, P, 0.01"], ["*DSLOAD\nLID, P, 0.016"]),
    "one component": (["*BOUNDARY\nTOP, 1, , 0.1"], ["*BOUNDARY\nTOP, 1, 1, 0.1"]),
    "held again": (["*BOUNDARY\nTOP, 1, 1, 0.1", "*BOUNDARY\nTOP, 1"], ["*BOUNDARY\nTOP, 1, 1, 0."]),
    "moved anew": (["*BOUNDARY\nTOP, 3, 3, 0.1", "*BOUNDARY, OP=NEW\nBASE, 1, 3\nTOP, 1, 1, 0.2"], ["*BOUNDARY\nTOP, 1, 1, 0.2"]),
}  # fmt: skip
AMPLITUDES = {
    "comma at the end of the first line": "0., 0., 0.5, 0.5,\n1., 1.,",
    "a value left out": "0., , 0.5, 0.5\n1., 1.",
    "a pair left out": "0., 0., 0.5, 0.5, , , \n1., 1.",
}


def state(deck: Deck) -> list[object]:
    """All that a deck says of forces: of each node, face and direction."""
    case = deck.case
    forces, held = np.zeros_like(case.nodes), np.full_like(case.nodes, np.nan)
    for name, f in case.forces.items():
        forces[case.node_sets[name]] += f / len(case.node_sets[name])
    for s in case.supports:
        for d in s.components:
            held[case.node_sets[s.nodes], d] = 0 if s.value is None else s.value[:, d]
    faces = [] if case.pressurised is None else case.surfaces[case.pressurised].tolist()
    return [deck.gravity, forces, held, sorted(faces), deck.pressures[-1:]]


@pytest.mark.parametrize("name", SAME_LAW)
def test_an_empty_field_is_its_default(tmp_path: File, require: Callable[[str], None], name: str) -> None:
    decks = [text(PRESS, material=m) for m in SAME_LAW[name]]
    found, plain = (read(tmp_path, deck).case.materials["e"] for deck in decks)
    assert found == plain
    require("ccx")
    np.testing.assert_allclose(*(CalculiX().run(deck).u for deck in decks), rtol=1e-4)


@pytest.mark.parametrize("name", [n for n, (_, plain) in SAME_LOADS.items() if plain])
def test_loads_add_up_in_a_step_and_replace_those_of_earlier_ones(
    tmp_path: File, require: Callable[[str], None], name: str
) -> None:
    decks = [text(*steps, amplitude=RAMP) for steps in SAME_LOADS[name]]
    for one, other in zip(*(state(read(tmp_path, deck)) for deck in decks), strict=True):
        np.testing.assert_allclose(one, other)
    require("ccx")
    np.testing.assert_allclose(*(CalculiX().run(deck).course[-1] for deck in decks), rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("name", AMPLITUDES)
def test_an_amplitude_has_its_pairs_line_by_line(tmp_path: File, require: Callable[[str], None], name: str) -> None:
    load = PRESS.replace("*DSLOAD", "*DSLOAD, AMPLITUDE=A")
    deck = text(load, amplitude=f"*AMPLITUDE, NAME=A\n{AMPLITUDES[name]}")
    found = read(tmp_path, deck)
    assert found.pressures == (0.01,)
    assert any("at its largest value, 1." in remark for remark in found.remarks)
    require("ccx")
    np.testing.assert_allclose(CalculiX().run(deck).u, CalculiX().run(text(PRESS)).u, rtol=1e-4)


def test_what_two_surfaces_carry_is_told(tmp_path: File) -> None:
    both = "*DSLOAD, AMPLITUDE=A\nLID, P, 0.01\n*DSLOAD, AMPLITUDE=B\nSIDE, P, 0.01"
    tables = "*AMPLITUDE, NAME=A\n0., , 1., 1.\n*AMPLITUDE, NAME=B\n{}., 0., 1., 1."
    for begin, apart in ((0, False), (-1, True)):  # a value left out is 0; other tables are other courses
        told = read(tmp_path, text(both, amplitude=tables.format(begin))).remarks
        assert any("not filled at one time" in remark for remark in told) == apart
    again = read(tmp_path, text("*DSLOAD\nLID, P, 0.01\nSIDE, P, 0.01", PRESS))  # filled in the first step
    assert again.pressures == (0.01, 0.01)
    assert not again.remarks
    twice = read(tmp_path, text("*DLOAD\nE, P2, 0.01\n" + PRESS)).remarks
    assert twice == ("Pressures of dload_0.01 and lid add up where they act on one face.",)
    assert not read(tmp_path, text("*DLOAD\nE, P2, 0.01", PRESS)).remarks  # replaced


def test_new_loads_take_off_pressures_and_turns(tmp_path: File) -> None:
    off = read(tmp_path, text("*DLOAD\nE, P2, 0.01", grav(9810, 0, 0, -1, keyword="*DLOAD, OP=NEW")))
    assert off.pressures == (0.01, 0.0)
    joint = "*RIGID BODY, PIN NSET=TOP, REF NODE=5\n*BOUNDARY\n5, 4, 6"
    held = text(PRESS, "*BOUNDARY, OP=NEW\nBASE, 1, 3\n5, 4, 6", amplitude=joint)
    assert read(tmp_path, held).case.equations
    with pytest.raises(ValueError, match="its reference node 5 may turn"):
        read(tmp_path, held.replace("BASE, 1, 3\n5, 4, 6\n*NODE", "BASE, 1, 3\n*NODE"))


@pytest.mark.parametrize("parameters", ["N=1", "MODULI=LONG TERM", "DEPENDENCIES=1", "N=1, POLYNOMIAL"])
def test_a_law_without_its_name_is_the_polynomial(tmp_path: File, parameters: str) -> None:
    found = read(tmp_path, text(PRESS, material=law(f"{parameters}\n0.03, 0.015, 0.3"))).case.materials["e"]
    assert (found.C10, found.C01, found.bulk) == (0.03, 0.015, pytest.approx(2 / 0.3))
    second = read(tmp_path, text(PRESS, material=law("N=2\n0.03, 0.015, 0.001, , , 0.3"))).case.materials["e"]
    assert (second.C10, second.C01, second.C20, second.bulk) == (0.03, 0.015, 0.001, pytest.approx(2 / 0.3))


def test_empty_fields_of_other_keywords_are_their_defaults(tmp_path: File) -> None:
    softened = read(tmp_path, text(PRESS, material=f"{LAW}\n*MULLINS EFFECT\n1.1, , 0.5")).case.materials["e"]
    assert softened.mullins == pytest.approx((1 / 1.1, 0.0, 0.5))
    creeping = read(tmp_path, text(PRESS, material=f"{LAW}\n*VISCOELASTIC, TIME=PRONY\n0.2, , 3.,")).case
    assert creeping.materials["e"].prony == ((0.2, 3.0),)
    placed = text(PRESS).replace("2, 1, 0, 0\n", "2, 1, ,\n").replace("5, 0, 0, 1\n", "5, , , 1.\n")
    np.testing.assert_array_equal(read(tmp_path, placed).case.nodes, read(tmp_path, text(PRESS)).case.nodes)


def test_a_chamber_that_is_emptied_while_another_is_filled_is_refused(tmp_path: File) -> None:
    with pytest.raises(ValueError, match="in another ratio than in the step before"):
        read(tmp_path, text(*SAME_LOADS["other surface anew"][0]))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("1, 1, 2, 3, 4,", "1, 1, 2, , 4,", saying("line 11", "an empty field", "wanted a whole number")),
        ("0.01", "1_0", saying("1_0", "wanted finite numbers")),
        (LAW, law("OGDEN, N=3\n0.03,2.,0.02,3.,0.01,-1.,0.3,\nO."), saying("line 25", "O.", "wanted finite numbers")),
        ("1e-9", "1e-9\n*AMPLITUDE, NAME=B\n0., 0., 1., 1.\n2., O.", saying("line 29", "O.", "wanted finite numbers")),
        ("0.01", "1.0-3", saying("1.0-3", "wanted finite numbers, such as")),
        ("*DSLOAD", "*DSLOAD, OP=OLD", saying("OP=OLD", "wanted OP=NEW")),
        ("1e-9", "1e-9\n*AMPLITUDE, NAME=B\n0., 0., 2., 1.\n1., 1.", "times that do not increase"),
        ("1e-9", "1e-9\n*AMPLITUDE, NAME=B\n0., 0., 1., 1.\n1., 2.", "times that do not increase"),
        ("0.03, 0.015, 0.3", "0.03, 0.015, 0.3, 0, 0, 0, 0, 0, 7.", saying("9 constants on a line", "at most 8")),
        ("1, 2, 3, 4\n*NSET, NSET=TOP\n", "1, 2, 3, 4\n*NSET, NSET=TOP, GENERATE\n1, , 1\n", "an empty field"),
    ],
)  # fmt: skip
def test_a_field_that_is_no_number_is_named(tmp_path: File, old: str, new: str, told: str) -> None:
    assert old in text(PRESS)
    with pytest.raises(ValueError, match=told):
        read(tmp_path, text(PRESS).replace(old, new))


def test_a_force_on_a_part_of_an_earlier_one_is_refused(tmp_path: File) -> None:
    with pytest.raises(ValueError, match=saying(r"\*CLOAD", "part of top", "OP=NEW")):
        read(tmp_path, text("*CLOAD\nTOP, 3, 0.001", "*CLOAD\n5, 3, 0.002"))


SKIN = "*ELEMENT, TYPE=CPS4, ELSET=LIDSKIN\n2, 5, 6, 7, 8\n*ELEMENT, TYPE=T3D2\n3, 1, 2\n*NSET, NSET=TOP\n"


def test_elements_of_planes_and_lines_are_left_out_and_told(tmp_path: File) -> None:
    deck = text(PRESS).replace("*NSET, NSET=TOP\n5, 6, 7, 8\n", f"{SKIN}5\n*NSET, NSET=TOP, ELSET=LIDSKIN\n")
    found = read(tmp_path, deck)
    assert len(found.case.connectivity) == 1
    assert len(found.case.node_sets["top"]) == 4
    assert [r.partition(",")[0] for r in found.remarks] == ["Elements CPS4", "Elements T3D2"]
    with pytest.raises(ValueError, match=saying("lidskin", "wanted solids")):
        read(tmp_path, deck.replace("*MATERIAL", "*SOLID SECTION, ELSET=LIDSKIN, MATERIAL=M\n*MATERIAL"))
    with pytest.raises(ValueError, match=saying("only CPS4", "wanted")):
        read(tmp_path, text(PRESS).replace("TYPE=C3D8, ELSET=E\n1, 1, 2, 3, 4, 5, 6, 7, 8", "TYPE=CPS4, ELSET=E\n1, 1, 2, 3, 4"))
