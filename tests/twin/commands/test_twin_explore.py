"""`twin explore` on a short finger without a film: what it answers, refuses, and does after a kill."""

import csv
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from fe import Lattice
from fe.mesh.finger import NAMED_NODES
from tests.messages import Lines, saying
from tests.twin.conftest import SHORT
from twin.bench.explorationranges import asked_ranges
from twin.calibrated import exploration
from twin.calibrated.exploration import FieldResponse, FingerAnswer, solved_row
from twin.commands import explore
from twin.commands.explore import run_explore, told
from twin.executors.local import Processes, Serial, using
from twin.experiments.designs import MainEffects, Variable
from twin.marktables import PointTable
from twin.model.structure import BuiltIn
from twin.project.config import Config, ModelTable, ProjectTable
from twin.project.folder import Project
from twin.project.toml import dump


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """A project without targets, one cell a bellow."""
    return bare(tmp_path / "bare")


def bare(folder: Path, **model: object) -> Project:
    folder.mkdir()
    points = tuple(PointTable(name=name, node=node) for name, node in NAMED_NODES.items())
    config = Config(project=ProjectTable(name="bare"), points=points, model=ModelTable(**model))  # type: ignore[arg-type]
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    return Project.open(folder, builtin=BuiltIn(SHORT, Lattice(per_bellow=1, ring=False, centred=False)))


def _interrupted(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def test_dimensions_and_constants_are_solved_and_what_cannot_be_meshed_is_a_row(
    project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    say, over = Lines(), ["top_wall_mm=1.8:2.4", "C10=0.2:0.3", "pleats=3:9"]
    corners = np.array([[wall, c, n] for wall in (1.8, 2.4) for c in (0.2, 0.3) for n in (3, 9)])
    monkeypatch.setattr(explore, "sobol_design", lambda *_, **__: corners)
    asked: dict[str, object] = {"over": over, "runs": 8, "pressure": "15kPa"}
    with monkeypatch.context() as patch:
        patch.setattr(explore, "draw_effects", _interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_explore(project, say, **asked)  # type: ignore[arg-type]
    with monkeypatch.context() as patch:  # what was solved before the interrupt is kept
        patch.setattr(exploration.Model, "solved", _interrupted)
        found = run_explore(project, say, **asked)  # type: ignore[arg-type]
    rows = found["rows"]
    assert [list(row["values"].values()) for row in rows] == corners.tolist()
    for row in rows:
        if row["values"]["pleats"] == 9:  # of 3.7 mm on a finger of 43 mm
            assert row["angle_deg"] is None
            assert row["why"].startswith(("model.finger.pleats = 9", "model.finger.pleat_depth_mm = 7.6"))
        else:
            assert row["why"] == ""
            assert (row["angle_deg"] > 1, row["u3_mm"] < 0, 1 < row["stretch"] < 2) == (True, True, True)
    good = [row for row in rows if not row["why"]]
    angle = np.array([row["angle_deg"] for row in good]).reshape(2, 2)  # wall, C10
    assert (np.diff(angle, axis=0) < 0).all()
    assert (np.diff(angle, axis=1) < 0).all()
    assert "4 of 8 runs have no answer" in found["note"]
    assert "nominal, not fitted" in found["note"]
    assert "pleats" not in {row["variable"] for row in found["effects"]}  # those that were solved have 3 alone
    folder = project.root / "runs" / found["run"]
    with (folder / "explore.csv").open(encoding="utf-8", newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [row["run"] for row in table] == [str(n) for n in range(1, 9)]
    assert float(table[0]["C10_MPa"]) == 0.2
    assert float(table[0]["angle_deg"]) == pytest.approx(rows[0]["angle_deg"], rel=1e-7)
    assert (folder / "explore-effects.png").stat().st_size


def test_a_response_answers_as_whole_solves_do(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    """The field of all nodes, so that the highest stretch is as exact as the tip."""
    monkeypatch.setattr(exploration, "SOLVES", 3)
    finger, variables, _ = asked_ranges(project, ["C10=0.2:0.3", "C01=0.05:0.1"], 0.015)
    response = FieldResponse.of(finger, variables)
    row = {"C10": 0.23, "C01": 0.08}
    a, b = response.row(row), solved_row(finger, row)
    assert isinstance(a, FingerAnswer)
    assert isinstance(b, FingerAnswer)
    for name, size in (("u1_mm", 1e-3), ("u3_mm", 1e-3), ("angle_deg", 0.01), ("stretch", 1e-3)):
        assert getattr(a, name) == pytest.approx(getattr(b, name), abs=size), name
    # of rubber, u depends on pressure / (C10 + C01) and on the share alone
    doubled, _, _ = asked_ranges(project, ["C10=0.2:0.5"], 0.03)
    twice = solved_row(doubled, {"C10": 0.46, "C01": 0.16})
    assert isinstance(twice, FingerAnswer)
    np.testing.assert_allclose(list(asdict(twice).values()), list(asdict(b).values()), rtol=1e-6)


def test_the_stretch_of_a_finger_is_that_of_its_field(project: Project) -> None:
    """A field that stretches x by 1.2 and turns its end by 0.1: both are known."""
    finger, _, _ = asked_ranges(project, ["C10=0.2:0.3"], 0.015)
    nodes = finger.case.nodes
    u = np.zeros_like(nodes)
    u[:, 0] = 0.2 * nodes[:, 0]
    found = exploration._shown(exploration.Problem.of(finger.case), u)
    assert found.stretch == pytest.approx(1.2, rel=1e-9)
    assert (found.u1_mm, found.u3_mm, found.angle_deg) == pytest.approx((0.2 * SHORT.length, 0.0, 0.0), abs=1e-9)
    face = nodes[:, 0] > nodes[:, 0].max() - 1e-6
    u[face, 0] += 0.1 * nodes[face, 2]  # the upper edge goes ahead: it bends down
    assert exploration._shown(exploration.Problem.of(finger.case), u).angle_deg == pytest.approx(np.degrees(np.arctan(0.1)))


WRONG = [
    ({"over": []}, r"--over: wanted what is varied"),
    ({"over": ["C10=0.3:0.2"]}, r"--over 'C10=0.3:0.2': wanted NAME=LOW:HIGH, the lower first"),
    ({"over": ["C10=0.2MPa:0.3"]}, r"wanted NAME=LOW:HIGH"),
    ({"over": ["C10=0.2:0.3", "C10=0.2:0.4"]}, r"each once"),
    ({"over": ["wall_mm=1:2"]}, r"--over wall_mm: nothing of the finger .* a dimension: length_mm, .*top_wall_mm"),
    ({"over": ["C10=0.2:9"]}, r"--over C10=0.2:9: wanted 0.01 to .* MPa"),
    ({"over": ["pleats=3.5:5"]}, r"wanted whole numbers"),
    ({"over": ["camera_scale.scale=-0.1:0.1"]}, r"--over camera_scale: this effect does not move the finger"),
    ({"over": ["wind.x=0:1"]}, r"effect 'wind' is not in the library"),
    ({"over": ["creep.what=0:1"]}, r"nothing of the finger has this name; wanted a parameter \(C10, C01, creep.g1"),
    ({"over": ["C10=0.2:0.3"], "runs": 1}, r"--runs 1: wanted 2 to"),
    ({"over": ["C10=0.2:0.3"], "pressure": ""}, r"--pressure: this project has no film"),
    ({"over": ["C10=0.2:0.3"], "pressure": "20"}, r"wanted a number with its unit"),
    ({"over": ["side_wall_mm=20:30"]}, r"none of 32 runs has an answer; the first: .*model.finger.width_mm"),
]


@pytest.mark.parametrize(("asked", "why"), WRONG, ids=[why[:24] for _, why in WRONG])
def test_what_is_wrong_is_said(project: Project, asked: dict[str, object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        run_explore(project, Lines(), **{"pressure": "15kPa", **asked})  # type: ignore[arg-type]


A, B = Variable("wall_mm", 1.0, 2.0, "mm"), Variable("pleats", 3, 5, whole=True)


def effects(change: list[float], sd: list[float]) -> MainEffects:
    return MainEffects(np.array(change), np.array(sd), np.array(change), 1.0)


def test_what_bends_most_and_what_at_less_stretch_is_told() -> None:
    both = told((A, B), effects([-6.0, 3.0], [0.1, 0.1]), effects([-0.1, -0.05], [0.01, 0.01]))
    assert re.search(r"wall_mm .* -6 degrees .*sd 0\.1.* 1 to 2 mm.* less stretch.*larger pleats", both)
    none = told((A, B), effects([-6.0, 3.0], [0.1, 0.1]), effects([-0.1, 0.02], [0.01, 0.001]))
    assert re.search(r"No variable .* less stretch; pleats .* 0\.0067 of stretch a degree", none)
    unsure = told((A, B), effects([-6.0, 5.8], [0.5, 0.5]), effects([0.1, -0.05], [0.2, 0.2]))
    assert "pleats may move it as much." in unsure
    assert re.search(r"No variable [^;]* less stretch\.$", unsure)
    smaller = told((A,), effects([-6.0], [0.1]), effects([0.1], [0.01]))
    assert smaller.endswith("under the same pressure: smaller wall_mm.")
    assert re.search("No variable .* effect on the bending", told((A,), effects([0.1], [0.1]), effects([0.1], [0.01])))
    assert told((A,), None, None).startswith("Too few runs")


@pytest.mark.slow
def test_one_worker_or_two_give_the_same_bits(tmp_path: Path) -> None:
    tables = []
    for executor in (Serial(), Processes()):
        project = bare(tmp_path / type(executor).__name__, effects=("creep",))
        over = ["top_wall_mm=1.8:2.4", "creep.g1=0:0.1"]
        with using(executor):
            found = run_explore(project, Lines(), over=over, runs=6, seed=2, pressure="15kPa")
        tables.append(found["rows"])
    assert tables[0] == tables[1]
    assert all(not row["why"] for row in tables[0])


def of_body(folder: Path, **model: object) -> Project:
    """A project of another body, in the state in which `bare` leaves one."""
    return Project.open(bare(folder, **model).root)


@pytest.mark.slow
def test_dimensions_of_other_bodies_are_varied_beside_their_object(tmp_path: Path) -> None:
    tube = {"length_mm": 24.0, "offset_mm": 1.8, "fibre_N_per_mm": 5.0}
    plain = of_body(tmp_path / "tube", body="tube", tube=tube)
    asked: dict[str, object] = {"runs": 2, "pressure": "10kPa"}
    found = run_explore(plain, Lines(), over=["offset_mm=0.9:1.8"], **asked)  # type: ignore[arg-type]
    lower, higher = (row["u3_mm"] for row in sorted(found["rows"], key=lambda row: row["values"]["offset_mm"]))
    assert higher < 1.1 * lower < 0  # a chamber farther off the axis bends the tube more
    fibre = run_explore(plain, Lines(), over=["fibre_N_per_mm=2:8"], **asked)  # type: ignore[arg-type]
    assert fibre["variables"][0]["unit"] == "N/mm"
    held = of_body(tmp_path / "held", body="tube", tube=tube, object="plane:nx=0,ny=0,nz=1,distance=-0.01")
    found = run_explore(held, Lines(), over=["offset_mm=0.9:1.8"], **asked)  # type: ignore[arg-type]
    assert abs(found["rows"][1]["u3_mm"]) < 0.8 * abs(higher)  # the plane holds the tip
    with pytest.raises(ValueError, match=saying("--over", "top_wall_mm", "offset_mm")):
        run_explore(plain, Lines(), over=["top_wall_mm=1:2"], **asked)  # type: ignore[arg-type]
