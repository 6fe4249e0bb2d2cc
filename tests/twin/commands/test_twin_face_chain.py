"""Points of a speckled face beside two markers through calibrate, compare and review: no node, found by place."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import Case, Lattice, Material
from tests.messages import Lines as Silent
from tests.messages import saying
from tests.twin.conftest import page_text
from twin import virtual
from twin.bench.workbench import Workbench
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.commands.review import run_review
from twin.files import read_json
from twin.marktables import PointTable
from twin.model.structure import BuiltIn
from twin.project.config import CalibrateTable, Config, DiagnoseTable, ProjectTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.project.toml import dump
from twin.targets import PointKind, TargetPoint, as_position, at_node

pytestmark = pytest.mark.slow  # a quarter of a minute

FILM = ((0.0, 0.0), (2.0, 0.0), (5.0, 25.0), (6.0, 25.0))
BENCH = virtual.Bench(film_hz=2.0, gauge_sd_MPa=1e-5, ripple_MPa=0.0, sd=0.005, placement_sd_mm=0.02)
# x and z mm on the flat edge of the side face, none of them at a node, in the order of x that the noise needs
FACE = [(6.3, 0.9), (9.1, 2.1), (13.7, 0.4), (22.9, 1.7), (27.2, 0.8), (33.1, 2.2), (38.4, 1.3)]


@pytest.fixture(scope="module")
def project(
    tmp_path_factory: pytest.TempPathFactory, short_case: Case, short_builtin: BuiltIn
) -> Project:
    """Targets of another mesh: the markers tip and middle, and seven points of the face."""
    named = [("middle", 5848), ("tip", 4401)]
    spots = [TargetPoint(f"face{k + 1:03d}", PointKind.PLACE, None, (x, 11.5, z)) for k, (x, z) in enumerate(FACE)]
    marks = [at_node(n, k, as_position(short_case.position(k))) for n, k in named]
    along = sorted([*spots, *marks], key=lambda point: point.position[0])
    points = np.array([point.position for point in along])
    cells, material = Lattice(per_bellow=2, centred=False), Material(0.214, 0.083)
    truth = virtual.truth_case(short_builtin.finger, cells, material=material, element=None)
    course = virtual.path(BENCH, protocol=FILM)
    u, slope = virtual.displaced(truth, course, points)
    targets = virtual.noisy_targets(u, slope, course, points=along, bench=BENCH, seed=3)
    config = Config(
        project=ProjectTable(name="face"),
        points=tuple(PointTable(name=n, node=k) for n, k in named),
        calibrate=CalibrateTable(population=8, generations=3),
    )
    folder = tmp_path_factory.mktemp("face") / "batch"
    folder.mkdir()
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", targets)
    found = Project.open(folder, builtin=short_builtin)
    run_calibrate(found, Silent())
    return found


def test_face_points_are_calibrated_compared_and_reviewed(project: Project) -> None:
    say, path = Silent(), project.newest("calibrate", "fit.json")
    assert path is not None
    fit = read_json(path)
    total = sum(fit["parameters"][name]["value"] for name in ("C10", "C01"))
    assert fit["converged"]
    assert total == pytest.approx(0.297, rel=0.1)  # two cells a bellow: what finer meshes add to them differs by a tenth
    told = run_compare(project, say)
    assert told["adequate"], told["where"]
    rows = {row["name"]: row for row in told["maps"]["marker"]}
    assert {f"face{k + 1:03d}" for k in range(len(FACE))} | {"tip", "middle"} <= set(rows)
    # what is left at a face point is noise, as at a marker: 5 um a value, its gauge and mesh modes taken off
    left = np.array([rows[f"face{k + 1:03d}"]["rms_mm"] for k in range(len(FACE))])
    assert left.max() < 0.02
    other = project.config.model_copy(update={"diagnose": DiagnoseTable(candidates=("clamp",))})
    with replace(project, config=other).new_run("diagnose") as run:
        run.write_json("diagnosis.json", {"verdict": "adequate", "sentence": "of other candidates", "named": [], "rms_before_mm": 1.0})
    notes = run_review(project, say)["notes"]
    stale = "is stale: [diagnose] candidates of twin.toml has changed since; it is not used"
    assert [n for n in notes if "stale" in n] == [f"runs/{run.name} {stale}"]
    page = project.newest("review", "report.html")
    assert page is not None
    assert "face007" in page_text(page)
    assert "of other candidates" not in page.read_text(encoding="utf-8")


def changed(project: Project, folder: Path, rows: slice, move: tuple[float, float, float]) -> Project:
    """The project with some face points stated elsewhere, mm."""
    shutil.copytree(project.root, folder, ignore=shutil.ignore_patterns("targets"))
    targets = project.targets()
    points = list(targets.points)
    for k in np.flatnonzero(targets.of_kind(PointKind.PLACE))[rows]:
        points[k] = replace(points[k], position=as_position(np.add(points[k].position, move)))
    write_targets(folder / "targets", replace(targets, points=tuple(points)))
    return replace(project, root=folder)


def test_a_face_point_off_its_place_is_found_by_compare(project: Project, tmp_path: Path) -> None:
    moved = changed(project, tmp_path / "off", slice(5, 6), (4.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=saying(r"targets/targets\.toml", "twin calibrate")):
        run_compare(moved, Silent())
    run_calibrate(moved, Silent())
    told = run_compare(moved, Silent())
    assert not told["adequate"]
    assert max(told["maps"]["marker"], key=lambda r: float(r["rms_mm"]))["name"] == "face006"


def test_points_beside_the_surface_are_taken_on_it(project: Project, tmp_path: Path) -> None:
    """y_mm of the face is measured with a ruler: 0.3 mm too much is no reason to stop, 0.8 mm is."""
    bench = Workbench.of(changed(project, tmp_path / "near", slice(2, 5), (0.0, 0.3, 0.0)))
    now, before = (np.array([p.position for p in t.points]) for t in (bench.targets, project.targets()))
    # a hundredth of an element's side is the surfaces' own difference
    assert now == pytest.approx(before, abs=0.01)
    (said,) = bench.remarks
    assert said.startswith("3 of 7 points without a node lie up to 0.30 mm off the model (face00")
    assert Workbench.of(project).remarks == ()
    with pytest.raises(ValueError, match=saying("'face003'", r"0\.80 mm", r"0\.5 mm", "y_mm")):
        Workbench.of(changed(project, tmp_path / "far", slice(2, 3), (0.0, 0.8, 0.0)))
