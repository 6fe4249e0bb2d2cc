"""A finger of one's own: stated by dimensions, its points by positions in mm, drawn, checked and calibrated."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from rerun.chunk import RrdReader

from fe import Material, solve
from tests.messages import run, saying
from twin import virtual
from twin.bench.workbench import Workbench, places_of, structure_of
from twin.calibrated.positions import ON_FINGER_MM
from twin.csvtable import read_sheet
from twin.drawing.blueprint import cut, cut_across
from twin.drawing.fitplots import DriftCourse, drift_chart
from twin.marktables import PointTable
from twin.model.structure import BuiltIn, base_case
from twin.project.folder import Project
from twin.project.targetfiles import read_targets, write_targets
from twin.targets import PointKind

DIMENSIONS = """
[model.finger]
length_mm = 40.0
width_mm = 16.0
height_mm = 14.0
pleats = 3
pleat_depth_mm = 5.0
side_pleat_depth_mm = 1.5
"""
PLACES = {"tip": (40.3, 8.2, -0.1), "middle": (21.0, 8.6, 1.0)}  # some tenths of a mm off the surface
SILICONE = Material(0.20, 0.06)
FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 12.0), (8.0, 12.0), (8.4, 0.0), (12.0, 0.0))  # kPa


def write(folder: Path, places: dict[str, tuple[float, float, float]], dimensions: str = DIMENSIONS) -> Project:
    """A project of points at places on a finger of these dimensions."""
    folder.mkdir(parents=True, exist_ok=True)
    points = "".join(f'[[points]]\nname = "{n}"\nposition_mm = {list(x)}\n' for n, x in places.items())
    chosen = f'[calibrate]\npopulation = 8\ngenerations = 2\nobjective_points = ["{next(iter(places))}"]\n'
    (folder / "twin.toml").write_text(dimensions + points + chosen)
    return Project.open(folder)


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of the finger, its targets solved for a known silicone; its name is no mathematics, either."""
    root = tmp_path_factory.mktemp("own") / "batch"
    project = write(root, PLACES, "[project]\nname = '$\\frac{$'\n" + DIMENSIONS)
    structure = structure_of(project)
    points = np.array([p.nearest for p in places_of(project, structure).values()])
    bench = virtual.Bench(film_hz=2.0, gauge_sd_MPa=1e-5, sd=0.002)
    course = virtual.path(bench, protocol=FILM)
    response = solve(replace(structure.case, materials={"body": SILICONE}), course)
    labels = range(1, 1 + len(points))
    targets = virtual.noisy_targets(
        response.at(points), response.per_pressure(points), course,
        points=virtual.at_nodes(PLACES, labels, points), bench=bench, seed=1,
    )  # fmt: skip
    # measured elsewhere: the targets know the points' names alone, twin.toml where they are
    unknown = tuple(
        replace(p, kind=PointKind.UNKNOWN, node=None, position=None) if p.kind is PointKind.NODE else p
        for p in targets.points
    )
    write_targets(root / "targets", replace(targets, points=unknown, noise=None))
    return root


def test_the_model_has_these_dimensions(batch: Path) -> None:
    structure = structure_of(Project.open(batch))
    low, high = structure.case.nodes.min(axis=0), structure.case.nodes.max(axis=0)
    np.testing.assert_allclose([*low, *high[:2]], [0, 0, 0, 40, 8], atol=1e-9)
    assert high[2] == pytest.approx(14.0, abs=0.3)  # crests, as of the default finger
    table = Project.open(batch).config.model.finger
    assert table is not None
    own = BuiltIn.of(table.finger)
    assert structure.key != structure_of(write(batch.parent / "other", PLACES, DIMENSIONS.replace("16.0", "16.5"))).key
    np.testing.assert_array_equal(base_case(finger=own.finger, lattice=own.lattice).nodes, structure.case.nodes)


def test_points_take_the_nearest_place_on_the_surface(batch: Path) -> None:
    bench = Workbench.of(Project.open(batch))
    tip, middle, *_ = (np.array(p.position) for p in bench.targets.points)
    np.testing.assert_allclose(tip, [40.0, 8.0, 0.0], atol=1e-8)
    assert np.linalg.norm(middle - PLACES["middle"]) == pytest.approx(0.62, abs=0.05)
    assert {p.kind for p in bench.targets.points} == {PointKind.PLACE, PointKind.FIXED}  # nobody asked for a node


@pytest.mark.slow
def test_calibration_finds_the_silicone_by_positions_alone(batch: Path) -> None:
    run("calibrate", "--project", batch)
    found = Project.open(batch).newest("calibrate", "fit.json")
    assert found is not None
    values = {k: v["value"] for k, v in json.loads(found.read_text())["parameters"].items()}
    # the model is the truth's: 2 um of noise on millimetres
    assert values["C10"] + values["C01"] == pytest.approx(0.26, rel=0.01)


def test_a_mark_is_measured_where_it_is_stated(tmp_path: Path) -> None:
    from twin.inputs.recordings import marks_of

    project = write(tmp_path / "film", PLACES)
    sized = tuple(p.model_copy(update={"size_mm": 5.0}) for p in project.config.points)
    both = (*sized, PointTable(name="node", node=4401, position_mm=(1.0, 2.0, 3.0), size_mm=5.0))
    project = replace(project, config=project.config.model_copy(update={"points": both}))
    tip, _, stated = (np.array(mark.position) for mark in marks_of(project))
    assert tip.tolist() == list(PLACES["tip"])  # not at the nearest place of the model, (40, 8, 0)
    assert stated.tolist() == [1.0, 2.0, 3.0]
    off = sized[0].model_copy(update={"position_mm": (40.0, 8.0, -3.5)})
    with pytest.raises(ValueError, match="not on the finger"):
        marks_of(replace(project, config=project.config.model_copy(update={"points": (off,)})))


@pytest.mark.parametrize("y", [8.0, -8.0])
def test_a_mark_at_a_node_lies_on_the_side_that_the_camera_sees(y: float, tmp_path: Path) -> None:
    from tests.strangers.studio import config_of
    from twin.calibrated.positions import check_points
    from twin.inputs.recordings import marks_of
    from twin.sanity import place_fault
    from twin.targets import as_position, at_node

    project, studio = write(tmp_path / "side", PLACES), config_of()
    structure = structure_of(project)
    rows = structure.case.nodes[:, 1] == structure.case.nodes[:, 1].max()
    label = int(structure.case.labels[np.flatnonzero(rows)[0]])
    x, _, z = structure.case.position(label)
    points = (
        PointTable(name="bare", node=label, size_mm=5.0),
        PointTable(name="both", node=label, position_mm=(x, y, z), size_mm=5.0),
    )
    rig = tuple(m.model_copy(update={"position_mm": (m.position_mm[0], y, 0.0)}) for m in studio.frame.markers)
    update = {"points": points, "cameras": studio.cameras, "frame": studio.frame.model_copy(update={"markers": rig})}
    project = replace(project, config=project.config.model_copy(update=update))
    places = [mark.position for mark in marks_of(project) if mark.role == "finger"]
    assert places == [pytest.approx((x, y, z))] * 2
    check_points(points, structure, mirrored=True)
    glued = tuple(at_node(p.name, label, as_position(np.array(place))) for p, place in zip(points, places, strict=True))
    targets = SimpleNamespace(points=glued)  # place_fault looks at points alone
    assert place_fault(targets, structure.case, mirrored=True) == ""
    if y < 0.0:  # several cameras see y themselves
        with pytest.raises(ValueError, match=saying("points.both", "16.0 mm", "position_mm")):
            check_points(points, structure)
        assert "16.0 mm away" in place_fault(targets, structure.case)


def test_a_position_off_the_finger_is_refused(tmp_path: Path) -> None:
    project = write(tmp_path / "off", {"tip": (40.0, 8.0, -ON_FINGER_MM - 0.5)})
    sentence = r"points.tip.position_mm = \[40, 8, -3.5\]: not on the finger; .* \[40, 8, 0\], is 3.5 mm away; wanted at most 3 mm"
    with pytest.raises(ValueError, match=sentence):
        places_of(project, structure_of(project))
    near = write(tmp_path / "near", {"tip": (40.0, 8.0, -ON_FINGER_MM + 0.01)})
    assert places_of(near, structure_of(near))["tip"].away == pytest.approx(ON_FINGER_MM - 0.01)


def test_targets_that_have_the_point_elsewhere_are_refused(batch: Path, tmp_path: Path) -> None:
    project = write(tmp_path / "twice", PLACES)
    targets = read_targets(batch / "targets", nodes={"tip": 4401})
    write_targets(project.targets_folder, targets)
    with pytest.raises(ValueError, match=saying("points.tip.position_mm", "twin.toml", "'tip'", "4401")):
        Workbench.of(project)


def test_check_says_how_far_the_surface_is(batch: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("check", "--project", batch)
    said = capsys.readouterr().out
    assert "Point tip: the film is measured at its position_mm." in said.replace("\n", " ")
    assert "The model takes the nearest place on its surface, [40, 8, 0] mm, 0.37 mm away." in said.replace("\n", " ")
    assert "Next: `twin" in said


def test_check_refuses_a_position_before_all_files_are_there(tmp_path: Path) -> None:
    project = write(tmp_path / "off", {"tip": (80.0, 8.0, 0.0)})
    with pytest.raises(ValueError, match="not on the finger"):
        run("check", "--project", project.root)


def test_dimensions_that_fold_the_mesh_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twin.bodies.finger.STEEPEST", 50.0)
    project = write(tmp_path / "steep", PLACES, DIMENSIONS.replace("= 14.0", "= 40.0").replace("= 5.0", "= 30.0"))
    with pytest.raises(ValueError, match=r"model.finger: with these dimensions the mesh folds near x = .* mm; wanted"):
        structure_of(project)


def test_look_draws_the_finger(batch: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("look", "--project", batch)
    first = Project.open(batch).newest("look", "finger.png")
    assert first is not None
    assert f"runs/{first.parent.name}/finger.png" in capsys.readouterr().out
    picture = cv2.imread(str(first))
    assert picture is not None
    assert picture.shape[1] == 2200
    assert (picture < 250).any(axis=2).mean() > 0.05  # not an empty page
    run("look", "--project", batch)
    assert "Already done" in capsys.readouterr().out
    assert Project.open(batch).newest("look", "finger.png") == first


def test_a_name_with_dollars_is_no_mathematics() -> None:
    one = np.ones(1)
    course = DriftCourse(name="C10", unit="MPa", values=one, low=one, high=one, expected=None, differs=False)
    assert "$\\frac{$</text>" in drift_chart(["$\\frac{$"], [course])


def test_check_says_of_a_folder_that_it_is_no_file(tmp_path: Path) -> None:
    (tmp_path / "batch" / "raw").mkdir(parents=True)
    write(tmp_path / "batch", PLACES, '[model]\ndeck = "raw"\n')
    with pytest.raises(ValueError, match=r"missing in .*: raw \(model.deck: it is a folder, wanted a file\)"):
        run("check", "--project", tmp_path / "batch")
    with pytest.raises(ValueError, match=r"raw: a folder; wanted a CSV file with a header line marker,does"):
        read_sheet(tmp_path / "batch" / "raw", wanted="marker,does")


def test_look_shows_nodes_points_and_dimensions_in_rerun(batch: Path) -> None:
    run("look", "--project", batch)
    project = Project.open(batch)
    path, case = project.newest("look", "look.rrd"), structure_of(project).case
    assert path is not None
    found: dict[str, Any] = {}
    for chunk in RrdReader(str(path)).stream():
        table = chunk.to_record_batch()
        found |= {f"{chunk.entity_path} {n}": table.column(n).to_pylist()[-1] for n in table.schema.names}
    np.testing.assert_allclose(found["/finger/nodes Points3D:positions"], case.nodes, atol=1e-5)
    assert found["/finger/nodes Points3D:labels"] == [str(n) for n in case.labels]
    assert found["/finger/points Points3D:labels"] == ["tip", "middle"]
    np.testing.assert_allclose(found["/finger/points Points3D:positions"][0], [40, 8, 0], atol=1e-5)
    lengths = {
        text: np.linalg.norm(np.subtract(*ends))
        for text, ends in zip(found["/finger/dimensions LineStrips3D:labels"],
                              found["/finger/dimensions LineStrips3D:strips"])
    }  # fmt: skip
    assert lengths["length 40 mm"] == pytest.approx(40.0, abs=1e-4)
    assert lengths["width 16 mm"] == pytest.approx(16.0, abs=1e-4)
    assert lengths["height 14 mm"] == pytest.approx(14.0, abs=1e-4)
    assert lengths["3 pleats of 10 mm"] == pytest.approx(30.0, abs=1e-4)


def test_a_cut_has_the_area_of_the_walls() -> None:
    own = BuiltIn.of(replace(BuiltIn().finger, pleat=0.0, side_pleat=0.0, radius=1e-3))
    case, g = base_case(finger=own.finger, lattice=own.lattice), own.finger
    half = g.width / 2 * g.height - (g.width / 2 - g.side) * (g.height - g.top - g.bottom)
    assert area(cut(case, axis=0, place=50.0)) == pytest.approx(half, rel=1e-3)
    chamber = (g.length - g.base_cap - g.tip_cap) * (g.height - g.top - g.bottom)
    assert area(cut(case, axis=1, place=0.0)) == pytest.approx(g.length * g.height - chamber, rel=1e-3)


def test_half_a_body_alone_is_mirrored_in_the_cut_across() -> None:
    half = base_case()
    whole = replace(half, supports=())  # the same walls, which nothing holds on a plane of symmetry
    one, both = (cut(half, axis=0, place=40.0), cut_across(half, 40.0))
    assert len(both) == 2 * len(one)
    assert min(shape[:, 0].min() for shape in both) == -max(shape[:, 0].max() for shape in one)
    assert len(cut_across(whole, 40.0)) == len(one)


def area(shapes: list[np.ndarray]) -> float:
    """The area of polygons, by the shoelace formula."""
    return sum(abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2 for x, y in (s.T for s in shapes))


def test_init_takes_positions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("init", tmp_path / "a", "--node", "tip=110,11.5,0", "--node", "middle=5848", "--node", "top=60,3,20")
    points = {p.name: (p.node, p.position_mm) for p in Project.open(tmp_path / "a").config.points}
    assert points == {"tip": (None, (110.0, 11.5, 0.0)), "middle": (5848, None), "top": (None, (60.0, 3.0, 20.0))}
    for wrong in ("tip=1,2", "tip=a,b,c", "=4401", "tip", "tip=nan,0,0"):
        with pytest.raises(ValueError, match=saying("NAME=LABEL", "tip=4401", "NAME=X,Y,Z")):
            run("init", tmp_path / "b", "--node", wrong)
