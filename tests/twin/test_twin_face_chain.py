"""Points of a speckled face beside two markers through calibrate, compare and review: no node, found by place."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material
from twin import virtual, workbench
from twin.config import CalibrateTable, Config, PointTable, ProjectTable
from twin.configfile import dump
from twin.project import Project
from twin.stages import run_calibrate, run_compare, run_review
from twin.targetfiles import write_targets
from twin.targets import MATERIAL

FILM = ((0.0, 0.0), (2.0, 0.0), (6.0, 25.0), (8.0, 25.0))
BENCH = virtual.Bench(film_hz=2.0, gauge_sd_MPa=1e-5, ripple_MPa=0.0, sd=0.005, placement_sd_mm=0.02)
# x and z mm on the flat edge of the side face, none of them at a node, in the order of x that the noise needs
FACE = [(6.3, 0.9), (9.1, 0.3), (13.7, 0.4), (22.9, 1.2), (27.2, 0.8), (33.1, 1.1), (38.4, 0.6)]


class Silent:
    """A `say` that keeps the lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __call__(self, text: str, /) -> None:
        self.lines.append(text)

    def progress(self, stage: str, done: int, total: int, /) -> None:
        pass


@pytest.fixture(scope="module", autouse=True)
def small(short: Finger) -> Iterator[None]:
    """The project of this file has the short finger on the coarse mesh."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(virtual, "PROTOCOL", FILM)
        patch.setattr(workbench, "Finger", lambda: short)
        patch.setattr(workbench, "Lattice", lambda refine: Lattice(per_bellow=2, ring=False, centred=False, refine=refine))
        yield


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory, short_case: Case, short: Finger) -> Project:
    """Targets of another mesh: the markers tip and middle, and seven points of the face."""
    named = [("middle", 5848), ("tip", 4401)]
    spots = [(f"face{k + 1:03d}", MATERIAL, np.array([x, 11.5, z])) for k, (x, z) in enumerate(FACE)]
    rows = sorted([*spots, *((n, k, short_case.position(k)) for n, k in named)], key=lambda row: float(row[2][0]))
    names, nodes, points = (tuple(r[0] for r in rows), np.array([r[1] for r in rows]), np.array([r[2] for r in rows]))
    truth = virtual.Truth(Material(0.214, 0.083), lattice=Lattice(per_bellow=2, centred=False), finger=short)
    course = virtual.path(BENCH)
    u, slope = virtual.displacements(truth, course, points)
    targets = virtual.targets(u, slope, course, names=names, nodes=nodes, points=points, bench=BENCH, seed=3)
    config = Config(
        project=ProjectTable(name="face"),
        points=tuple(PointTable(name=n, node=k) for n, k in named),
        calibrate=CalibrateTable(population=8, generations=3),
    )
    folder = tmp_path_factory.mktemp("face") / "batch"
    folder.mkdir()
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", targets)
    return Project.open(folder)


def test_face_points_are_calibrated_compared_and_reviewed(project: Project) -> None:
    say = Silent()
    fit = run_calibrate(project, say)["fit"]
    total = sum(fit["parameters"][name]["value"] for name in ("C10", "C01"))
    assert fit["converged"]
    assert total == pytest.approx(0.297, rel=0.02)  # the scale is known to 0.1 %, the meshes differ by more
    told = run_compare(project, say)
    assert told["adequate"], told["where"]
    rows = {row["name"]: row for row in told["maps"]["marker"]}
    assert {f"face{k + 1:03d}" for k in range(len(FACE))} | {"tip", "middle"} <= set(rows)
    # what is left at a face point is noise, as at a marker: 5 um a value, its gauge and mesh modes taken off
    left = np.array([rows[f"face{k + 1:03d}"]["rms_mm"] for k in range(len(FACE))])
    assert left.max() < 0.02
    run_review(project, say)
    page = project.newest("review", "report.html")
    assert page is not None
    assert "face007" in page.read_text(encoding="utf-8")


def test_a_face_point_off_its_place_is_found_by_compare(project: Project, tmp_path: Path) -> None:
    """The same chain with one point stated 4 mm farther along: it stands out."""
    import shutil

    from twin.targetfiles import read_targets

    folder = tmp_path / "off"
    shutil.copytree(project.root, folder)
    shutil.rmtree(folder / "targets")
    targets = read_targets(project.targets_folder, nodes={"middle": 5848, "tip": 4401})
    row = targets.names.index("face006")
    targets.points[row, 0] += 4.0
    write_targets(folder / "targets", targets)
    told = run_compare(Project.open(folder), Silent())
    assert not told["adequate"]
    assert max(told["maps"]["marker"], key=lambda r: float(r["rms_mm"]))["name"] == "face006"
    json.dumps(told["where"])
