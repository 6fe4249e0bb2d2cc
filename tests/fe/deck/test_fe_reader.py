"""A deck that no code of the project has made: read, solved, compared with CalculiX, and refined."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from fe import Case, Support
from fe.deck.reader import read_deck
from fe.element import ELEMENTS
from fe.engines.calculix import CalculiX
from fe.engines.engine import Embedded
from fe.kernel.assembly import Kernel
from fe.kernel.pressure import PressureFaces
from fe.mesh.convert import converted
from fe.mesh.refine import enriched, free_faces, refined
from tests.messages import saying

TIP = 70001
Tube = Callable[..., File]
ABAQUS = [name for name in ELEMENTS if name != "hex27"]


def volumes(case: Case) -> tuple[float, float]:
    """Of the material and of the half chamber, mm3."""
    faces = PressureFaces(case.face_nodes(str(case.pressurised)), case.element, len(case.nodes))
    return Kernel(case).geometry.weight.sum(), float((faces.force(case.nodes) * case.nodes).sum()) / 3


@pytest.mark.parametrize("kind", ABAQUS)
def test_a_tube_of_every_element_is_read_as_it_was_meant(tube_deck: Tube, tmp_path: File, kind: str) -> None:
    deck = read_deck(tube_deck(tmp_path, kind))
    case = deck.case
    assert [f.name for f in deck.files] == ["tube.inp", "mesh.inc"]
    assert deck.pressures == (0.08,)
    assert case.element.name == kind
    x = case.nodes[case.labels == TIP][0]
    assert (x[0], x[2]) == (50, 0)
    assert Kernel(case).geometry.weight.min() > 0
    # the chamber of 41 x 3 x 2 mm in half, 9 % larger by its bulge, 1 % by the elements' straight edges
    solid, chamber = volumes(case)
    assert chamber == pytest.approx(41 * 3 * 2 * 1.08, rel=0.01)
    assert solid + chamber == pytest.approx(50 * 4 * 7 * 1.06, rel=0.01)
    np.testing.assert_array_equal(case.nodes[case.node_sets["root"], 0], 0)
    np.testing.assert_array_equal(case.nodes[case.node_sets["middle plane"], 1], 0)
    assert {(s.nodes, s.components) for s in case.supports} == {("root", (0, 1, 2)), ("middle plane", (1,))}


def test_calculix_agrees_on_a_deck_of_somebody_else(
    tube_deck: Tube, require: Callable[[str], None], tmp_path: File
) -> None:
    require("ccx")
    case = read_deck(tube_deck(tmp_path, "C3D20RH", cells=7)).case
    ours, theirs = Embedded().solve(case, 0.04), CalculiX().solve(case, 0.04)
    assert theirs.reason == ours.reason == "converged"
    assert np.abs(ours.u - theirs.u).max() < 1e-3 * np.abs(theirs.u).max()


@pytest.mark.parametrize("kind", [*ABAQUS, "hex27"])
def test_a_refined_mesh_is_the_same_structure(short: Case, kind: str) -> None:
    coarse = short if kind == "hex27" else converted(short, kind)
    fine = refined(coarse)
    assert len(fine.connectivity) == 8 * len(coarse.connectivity)
    assert len(np.unique(fine.labels)) == len(fine.labels) == len(fine.nodes)
    np.testing.assert_array_equal(fine.nodes[: len(coarse.nodes)], coarse.nodes)
    np.testing.assert_array_equal(fine.labels[: len(coarse.nodes)], coarse.labels)
    # full integration sees the same polynomials; reduced and tetrahedral rules are off by a little
    exact = kind in ("hex27", "C3D20", "C3D20H", "C3D8", "C3D8H")
    np.testing.assert_allclose(volumes(fine), volumes(coarse), rtol=1e-12 if exact else 2e-4)
    assert len(fine.surfaces["chamber"]) == 4 * len(coarse.surfaces["chamber"])
    assert len(free_faces(fine)) == 4 * len(free_faces(coarse))
    for name, axis, value in (("clamp", 0, 0.0), ("symmetry", 1, 0.0), ("tip_face", 0, short.nodes[:, 0].max())):
        on = np.flatnonzero(np.abs(fine.nodes[:, axis] - value) < 1e-9)
        np.testing.assert_array_equal(np.sort(fine.node_sets[name]), on)


def test_a_refined_mesh_keeps_sets_of_elements_and_prescribed_displacements(short: Case) -> None:
    coarse = converted(short, "C3D20")
    half = np.flatnonzero(coarse.nodes[coarse.connectivity][:, :, 0].max(axis=1) < 20)
    rest = np.setdiff1d(np.arange(len(coarse.connectivity)), half)
    soft = coarse.materials["body"]
    rows = coarse.node_sets["tip_face"]
    bend = np.stack([coarse.nodes[rows, 2] ** 2, 0 * rows, 3 * coarse.nodes[rows, 1]], axis=1)
    coarse = replace(
        coarse, element_sets={"a": half, "b": rest}, materials={"a": soft, "b": soft},
        supports=(*coarse.supports, Support("tip_face", (0, 2), bend)),
    )  # fmt: skip
    fine = refined(coarse)
    volume = [Kernel(c).geometry.weight[c.element_sets["a"]].sum() for c in (coarse, fine)]
    assert volume[0] == pytest.approx(volume[1], rel=1e-12)
    x, value = fine.nodes[fine.node_sets["tip_face"]], fine.supports[-1].value
    assert value is not None
    # the tip face is plane and its cells nearly rectangular: quadratic values pass on as they are
    np.testing.assert_allclose(value[:, 2], 3 * x[:, 1], atol=1e-9)
    assert np.abs(value[:, 0] - x[:, 2] ** 2).max() < 0.05 * bend.max()


@pytest.mark.parametrize("kind", ["C3D20R", "C3D8"])
def test_richer_elements_are_the_same_structure(short: Case, kind: str) -> None:
    coarse = converted(short, kind)
    rich = enriched(coarse)
    assert rich.element.name == "hex27"
    full = coarse if kind == "C3D8" else converted(short, "C3D20")  # the same shape, fully integrated
    np.testing.assert_allclose(volumes(rich)[0], volumes(full)[0], rtol=1e-12)
    assert len(rich.surfaces["chamber"]) == len(coarse.surfaces["chamber"])
    np.testing.assert_array_equal(rich.nodes[: len(coarse.nodes)], coarse.nodes)
    with pytest.raises(ValueError, match="elements of type C3D10: wanted hexahedra"):
        enriched(converted(short, "C3D10"))


@pytest.mark.slow
def test_a_mesh_of_halved_elements_comes_nearer_to_the_limit(tube_deck: Tube, tmp_path: File) -> None:
    case = read_deck(tube_deck(tmp_path, "C3D20RH", cells=4)).case
    rich, base, fine = (Embedded().solve(c, 0.05).at(TIP)[2] for c in (enriched(refined(case)), case, refined(case)))
    assert abs(fine - rich) < 0.5 * abs(base - rich)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("*Include, input=mesh.inc", "*Include, input=nothing.inc", r"tube.inp line {line}: \*INCLUDE, INPUT=nothing.inc: no such file"),
        ("*Include, input=mesh.inc", "*Include, input=tube.inp", "the file includes itself"),
        ("*Output, field", "*Contact pair, x", r"not supported: \*CONTACT PAIR \(line {line}\)"),
        ("*End Instance", "*End Part", r"line {line}: \*END PART within an \*INSTANCE: wanted \*END INSTANCE"),
        ("*End Instance", "*Part, name=x", r"line {line}: \*PART within an \*INSTANCE: wanted \*END INSTANCE"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_it_is_named_with_its_line(
    tube_deck: Tube, tmp_path: File, old: str, new: str, told: str
) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    text = deck.read_text()
    assert old in text
    line = text[: text.index(old)].count("\n") + 1
    deck.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=told.replace("{line}", str(line))):
        read_deck(deck)


def test_a_deck_of_nothing_says_so(tmp_path: File) -> None:
    for text in ("", "0.5\n", "** a comment\n"):
        (tmp_path / "empty.inp").write_text(text)
        with pytest.raises(ValueError, match="no keyword in it; wanted an Abaqus deck"):
            read_deck(tmp_path / "empty.inp")


def test_an_error_in_an_included_file_is_named_with_that_file(tube_deck: Tube, tmp_path: File) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    mesh = tmp_path / "mesh.inc"
    mesh.write_text(mesh.read_text().replace("*NODE, nset=Everything", "*Node, nset=Everything, system=C"))
    with pytest.raises(ValueError, match=saying("mesh.inc", "1", r"\*NODE")):
        read_deck(deck)
    mesh.write_text("*Orientation, name=a\n" + mesh.read_text())
    with pytest.raises(ValueError, match=saying(r"\*ORIENTATION", "1", "mesh.inc")):
        read_deck(deck)


def test_data_lines_come_from_another_file(tube_deck: Tube, tmp_path: File) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    expected = read_deck(deck).case.nodes
    mesh = tmp_path / "mesh.inc"
    top, _, rest = mesh.read_text().partition("*Element")
    head, _, nodes = top.partition("\n")
    (tmp_path / "nodes.txt").write_text(nodes)
    for line in ("*Node, nset=Everything, input=nodes.txt\n", f"{head}\n*include, INPUT = nodes.txt\n"):
        mesh.write_text(f"{line}*Element{rest}")
        np.testing.assert_array_equal(read_deck(deck).case.nodes, expected)


def test_a_path_may_be_text(tube_deck: Tube, tmp_path: File) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    here, there = read_deck(str(deck)), read_deck(deck)
    np.testing.assert_array_equal(here.case.nodes, there.case.nodes)
    assert here.files == there.files == (deck, tmp_path / "mesh.inc")
    deck.write_text(deck.read_text().replace("*Output, field", "*Contact pair, x"))
    with pytest.raises(ValueError, match=r"\*CONTACT PAIR \(line \d+\)"):
        read_deck(str(deck))


def test_an_instance_that_was_moved_and_turned(tube_deck: Tube, tmp_path: File) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    here = read_deck(deck).case.nodes
    place = "*Instance, name=Tube-1, part=Tube\n"
    turned = deck.read_text().replace(place, place + "1., 2., 3.\n 1., 2., 3., 1., 2., 4., 90.\n")
    deck.write_text(turned)
    x, y, z = here.T  # about a line along z through the place where the origin goes
    np.testing.assert_allclose(read_deck(deck).case.nodes, np.stack([1 - y, 2 + x, 3 + z], axis=1), atol=1e-12)
