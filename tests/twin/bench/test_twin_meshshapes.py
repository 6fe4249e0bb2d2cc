"""Which node a marker is on, and what is said of a deck's elements."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.messages import run, saying, says
from twin.bench.meshshapes import nearest_node, places_asked, poor_shapes, shape_csv, shape_table
from twin.calibrated.positions import check_points
from twin.marktables import PointTable
from twin.model.structure import of_deck

Tube = Callable[..., Path]


def test_the_nearest_surface_node_and_how_far_it_is(tube_deck: Tube, tmp_path: Path) -> None:
    structure = of_deck(tube_deck(tmp_path, "C3D20RH", cells=5))
    place = structure.case.position(70001) + np.array([0.3, 0.4, 0.0])
    label, told = nearest_node(structure, place)
    assert label == 70001
    says(told, "70001", "(50, 4, 0) mm", "0.50 mm", "node = 70001")
    inside = nearest_node(structure, np.array([25.0, 1.5, 1.0]))[0]  # in the chamber: the skin is the nearest
    assert inside in structure.case.labels[np.unique(structure.outside)]


@pytest.mark.parametrize("text", ["1,2", "a,b,c", "1,2,nan", "", "1;2;3"])
def test_a_place_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"wanted x,y,z in mm from the clamp, such as 110,11.5,0"):
        places_asked([text])


def test_the_elements_are_named_by_their_own_numbers(tube_deck: Tube, tmp_path: Path) -> None:
    structure = of_deck(tube_deck(tmp_path, "C3D20RH", cells=5))
    head, *rows = shape_table(structure)
    assert head.split()[:4] == ["shape", "of", "the", "elements"]
    assert len(rows) == 4
    numbers = structure.elements.tolist()
    assert numbers[0] == 501
    assert all(any(cell.isdigit() and int(cell) in numbers for cell in row.split()) for row in rows)
    assert "longest over shortest edge of " in poor_shapes(structure)
    assert shape_csv(structure).splitlines()[1].startswith("501,")
    assert len(shape_csv(structure).splitlines()) == 1 + len(structure.case.connectivity)


def test_points_at_nodes_are_checked(tube_deck: Tube, tmp_path: Path) -> None:
    structure = of_deck(tube_deck(tmp_path, "C3D8H", cells=5))
    chamber = int(structure.case.labels[structure.case.face_nodes("chamber")[0, 0]])
    outer = set(structure.case.labels[np.unique(structure.outside)].tolist())
    assert chamber not in outer
    check_points([PointTable(name="tip", node=70001, position_mm=(50.0, 4.0, 1.0))], structure)
    with pytest.raises(ValueError, match=saying("points.tip.node", "--at")):
        check_points([PointTable(name="tip", node=chamber)], structure)
    with pytest.raises(ValueError, match=saying("points.tip", "70001", r"\[50, 4, 0\]", "10.0 mm", "position_mm")):
        check_points([PointTable(name="tip", node=70001, position_mm=(40.0, 4.0, 0.0))], structure)
    with pytest.raises(ValueError, match="node 4401: not in the model"):
        check_points([PointTable(name="tip", node=4401)], structure)


def test_look_draws_labels_and_shapes(
    tube_deck: Tube, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    run("init", tmp_path / "batch", "--deck", deck, "--node", "tip=70001")
    run("look", "-p", tmp_path / "batch", "--at", "50,4,0", "--json")
    assert '"nodes": [70001]' in capsys.readouterr().out
    folder = tmp_path / "batch" / "runs" / "0001-look"
    assert {p.name for p in folder.iterdir()} >= {"finger.png", "nodes.png", "quality.png", "quality.csv"}


def test_init_knows_the_nodes_of_the_built_in_finger(tmp_path: Path) -> None:
    rows = "0,0,0.0,0.0,tip,0.0,,0.0,0.1,,0.1,0\n0,1,1.0,0.03,tip,-20.0,,-58.0,0.1,,0.1,1\n"
    (tmp_path / "targets").mkdir()
    head = "block,step,time_s,pressure_MPa,point,u1_mm,u2_mm,u3_mm,sd1_mm,sd2_mm,sd3_mm,valid\n"
    (tmp_path / "targets" / "targets.csv").write_text(head + rows)
    with pytest.raises(ValueError, match="node 9999999: not in the model"):
        run("init", tmp_path / "a", "--targets", tmp_path / "targets", "--node", "tip=9999999")
    assert not (tmp_path / "a").exists()
    run("init", tmp_path / "a", "--targets", tmp_path / "targets", "--node", "tip=2934")
