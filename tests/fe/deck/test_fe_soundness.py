"""A deck whose mesh cannot be what was meant is refused, and reading takes no longer than the text is long."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from fe import Case
from fe.deck.keywords import MOST_FILES, read_keywords
from fe.deck.reader import read_deck
from fe.deck.soundness import check_body
from fe.mesh.convert import converted
from fe.mesh.refine import free_faces
from tests.messages import saying

Tube = Callable[..., File]
KINDS = ("C3D8H", "C3D10H", "C3D20RH")


def tube(make: Tube, folder: File, kind: str = "C3D20RH") -> Case:
    return read_deck(make(folder, kind, cells=5)).case


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_tube_passes(tube_deck: Tube, tmp_path: File, kind: str) -> None:
    check_body(tube(tube_deck, tmp_path, kind), "tube.inp")


@pytest.mark.parametrize("kind", KINDS)
def test_the_built_in_finger_passes_as_a_deck(short: Case, kind: str) -> None:
    held = short if short.clamp is None else replace(
        short, clamp=None, supports=(*short.supports, type(short.supports[0])(short.clamp.nodes, (0, 1, 2)))
    )  # fmt: skip
    check_body(converted(held, kind), "finger.inp")


def renumbered(mesh: File, of: Callable[[str, str], tuple[str, str]]) -> str:
    """Element 503 of a mesh with other first two nodes, and the first that it had."""
    head, _, row = mesh.read_text().partition("\n503, ")
    a, b, rest = row.split(", ", 2)
    mesh.write_text(f"{head}\n503, {', '.join(of(a, b))}, {rest}")
    return a


@pytest.mark.parametrize("kind", KINDS)
def test_an_element_turned_inside_out_is_named(tube_deck: Tube, tmp_path: File, kind: str) -> None:
    deck = tube_deck(tmp_path, kind, cells=4)
    renumbered(tmp_path / "mesh.inc", lambda a, b: (b, a))
    with pytest.raises(ValueError, match=r"element 503 has a Jacobian of -.* mm3: it is turned inside out, .* 1 of \d+ elements"):
        read_deck(deck)


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (0.001, r"the mesh is 0.05 mm long: wanted coordinates in mm, 5 to 2000 mm for a finger; are they in m\? Say so: .* --unit m "),
        (0.1 / 2.54, r"the mesh is 1.969 mm long: .*; are they in in\?"),
        (1000.0, r"50000\D* mm long: .*; are they in um\?|5e\+04 mm long: .*; are they in um\?"),
    ],
)
def test_another_unit_is_named(tube_deck: Tube, tmp_path: File, factor: float, told: str) -> None:
    case = tube(tube_deck, tmp_path)
    with pytest.raises(ValueError, match=told):
        check_body(replace(case, nodes=factor * case.nodes), "tube.inp")


@pytest.mark.parametrize("kind", KINDS)
def test_a_collapsed_element_is_named(tube_deck: Tube, tmp_path: File, kind: str) -> None:
    deck = tube_deck(tmp_path, kind, cells=4)
    a = renumbered(tmp_path / "mesh.inc", lambda a, _: (a, a))
    with pytest.raises(ValueError, match=rf"element 503 has node {a} more than once: it is collapsed, as are 1 of \d+ elements; wanted \d+ different nodes"):
        read_deck(deck)


def test_a_body_that_is_held_everywhere_is_refused(tube_deck: Tube, tmp_path: File) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    deck.write_text(deck.read_text().replace("Root, 1, 3\n", "Everything, 1, 3\n"))
    with pytest.raises(ValueError, match=r"all \d+ nodes are held, so nothing can move; wanted \*BOUNDARY on the nodes of the clamp alone"):
        check_body(read_deck(deck).case, "tube.inp")


@pytest.mark.parametrize("held", ["Root", "Middle plane"])
def test_pressure_on_what_is_held_is_refused(tube_deck: Tube, tmp_path: File, held: str) -> None:
    case = tube(tube_deck, tmp_path, "C3D8H")
    rows = case.node_sets[held.lower()] if held.lower() in case.node_sets else case.node_sets[held]
    on = [face for face in free_faces(case).tolist() if np.isin(case.connectivity[face[0]][case.element.faces[face[1]]], rows).all()]
    surfaces = {**case.surfaces, "chamber": np.array(on)}
    with pytest.raises(ValueError, match="the pressurised surface 'chamber' is held wherever the pressure acts on it, so nothing moves; wanted"):
        check_body(replace(case, surfaces=surfaces), "tube.inp")


def test_a_mesh_that_is_cut_is_refused(tube_deck: Tube, tmp_path: File) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    mesh = tmp_path / "mesh.inc"
    text = mesh.read_text()
    first = text.partition("elset=Body\n501, ")[2].partition("\n")[0].split(", ")
    second = text.partition("\n502, ")[2].partition("\n")[0]
    label = next(n for n in second.split(", ") if n in first)  # both elements have it
    place = next(line for line in text.splitlines() if line.startswith(f"{label:>8},")).partition(", ")[2]
    own = second.replace(label, "99999")
    mesh.write_text(text.replace(second, own).replace("*Element", f"99999, {place}\n*Element", 1))
    with pytest.raises(ValueError, match=rf"nodes {label} and 99999 lie at one place, .* the mesh is cut there"):
        check_body(read_deck(deck).case, "tube.inp")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("Root, 1, 3\n", "", "nothing holds the finger against a rigid motion (along [xz]|about y)"),
        ("Root, 1, 3\n", "Root, 1, 1\n", "nothing holds the finger against a rigid motion along z"),
    ],
)
def test_a_finger_that_is_not_held_is_refused(
    tube_deck: Tube, tmp_path: File, old: str, new: str, told: str
) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    deck.write_text(deck.read_text().replace(old, new))
    with pytest.raises(ValueError, match=told):
        check_body(read_deck(deck).case, "tube.inp")


def test_a_loose_part_is_refused(tube_deck: Tube, tmp_path: File) -> None:
    case = tube(tube_deck, tmp_path, "C3D8H")
    far, n = case.nodes + [0.0, 100.0, 0.0], len(case.nodes)
    both = replace(
        case, nodes=np.concatenate([case.nodes, far]), labels=np.concatenate([case.labels, case.labels + 10**6]),
        blocks=tuple(replace(b, connectivity=np.concatenate([b.connectivity, b.connectivity + n])) for b in case.blocks),
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"nothing holds the part of the mesh near \(.*\) mm .* or join it to the others"):
        check_body(both, "tube.inp")


@pytest.mark.parametrize("kind", KINDS)
def test_an_open_chamber_is_refused(tube_deck: Tube, tmp_path: File, kind: str) -> None:
    case = tube(tube_deck, tmp_path, kind)
    x = case.nodes[case.face_nodes("chamber")].mean(axis=1)
    inner = int(np.argmax(x[:, 1]))  # away from the plane of symmetry
    holed = {**case.surfaces, "chamber": np.delete(case.surfaces["chamber"], inner, axis=0)}
    with pytest.raises(ValueError, match=saying("'chamber'", "[34]")):
        check_body(replace(case, surfaces=holed), "tube.inp")


def test_a_face_inside_the_material_is_refused(tube_deck: Tube, tmp_path: File) -> None:
    case = tube(tube_deck, tmp_path, "C3D8H")
    wrong = case.surfaces["chamber"].copy()
    wrong[0, 1] = (wrong[0, 1] + 2) % 6
    with pytest.raises(ValueError, match=r"faces that lie inside the material|is open"):
        check_body(replace(case, surfaces={**case.surfaces, "chamber": wrong}), "tube.inp")


def test_pressure_from_outside_is_refused(short: Case) -> None:
    # all the skin but chamber and plane of symmetry, closed by that plane and the clamp
    case = converted(short, "C3D8H")
    supports = (*case.supports, type(case.supports[0])("clamp", (0, 1, 2)))
    outer = replace(case, clamp=None, supports=supports, pressurised="outside")
    with pytest.raises(ValueError, match=r"the pressure acts on the pressurised surface 'outside' from outside|is open"):
        check_body(outer, "finger.inp")


# -- the reader ----------------------------------------------------------------------------------------------


def test_a_surface_that_names_a_face_twice_has_it_once(tube_deck: Tube, tmp_path: File) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    once = read_deck(deck).case.surfaces["chamber"]
    mesh = tmp_path / "mesh.inc"
    mesh.write_text(mesh.read_text() + mesh.read_text()[mesh.read_text().index("*Surface") :])
    np.testing.assert_array_equal(read_deck(deck).case.surfaces["chamber"], once)


def test_a_quotation_mark_that_is_not_closed_takes_no_time(tmp_path: File) -> None:
    deck = tmp_path / "long.inp"
    deck.write_text("*Node\n" + "a, " * 20_000 + '"\n' + '"x, y", "' * 5_000 + "\n")
    start = time.process_time()
    words = read_keywords(deck).keywords[0].data[0][1]
    assert len(words) == 20_001
    assert words[-1] == '"'
    assert time.process_time() - start < 20.0  # 115 s where the expression tried every way to part it


def test_quotation_marks_keep_commas(tmp_path: File) -> None:
    deck = tmp_path / "quoted.inp"
    deck.write_text('*Elset, elset="All, of it"\n"a, b", c\n')
    (keyword,) = read_keywords(deck).keywords
    assert keyword.parameters == {"ELSET": '"All, of it"'}
    assert keyword.data[0][1] == ['"a, b"', "c"]


def test_includes_that_fan_out_are_stopped(tmp_path: File) -> None:
    for k in range(14):
        (tmp_path / f"f{k}.inp").write_text(2 * f"*Include, input=f{k + 1}.inp\n")
    (tmp_path / "f14.inp").write_text("*Node\n1, 0., 0., 0.\n")
    start = time.monotonic()
    with pytest.raises(ValueError, match=rf"more than {MOST_FILES} files are read in all: wanted fewer"):
        read_keywords(tmp_path / "f0.inp")
    assert time.monotonic() - start < 5.0


def test_includes_that_lie_too_deep_are_stopped(tmp_path: File) -> None:
    for k in range(30):
        (tmp_path / f"f{k}.inp").write_text(f"*Include, input=f{k + 1}.inp\n")
    with pytest.raises(ValueError, match="files that include each other 17 deep: wanted at most 16"):
        read_keywords(tmp_path / "f0.inp")


def test_a_file_outside_the_deck_folder_is_never_read(tmp_path: File) -> None:
    (tmp_path / "secret.txt").write_text("a word that nobody may see\n")
    folder = tmp_path / "deck"
    folder.mkdir()
    (folder / "link.inc").symlink_to(tmp_path / "secret.txt")
    for name in ("../secret.txt", "link.inc", str(tmp_path / "secret.txt"), "..\\secret.txt"):
        for line in (f"*Include, input={name}\n", f"*Node, input={name}\n"):
            (folder / "a.inp").write_text(line)
            with pytest.raises(ValueError, match=r"not in the folder of a\.inp: wanted a file there or below") as told:
                read_deck(folder / "a.inp")
            assert "nobody" not in str(told.value)


def test_all_files_are_known_of_a_deck_that_only_includes(tmp_path: File) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "mesh.inc").write_text("*Include, input=sub/more.inc\n")
    (tmp_path / "sub" / "more.inc").write_text("*Node\n1, 0., 0., 0.\n")
    (tmp_path / "a.inp").write_text("*Include, input=sub\\mesh.inc\n")
    names = [f.relative_to(tmp_path).as_posix() for f in read_keywords(tmp_path / "a.inp").files]
    assert names == ["a.inp", "sub/mesh.inc", "sub/more.inc"]
