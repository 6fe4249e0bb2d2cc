"""The stages with a law that is not Mooney-Rivlin: what is fitted, said and written is of that law."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fe import Path as Course
from fe import solve
from tests.twin.conftest import Lines, plain_targets
from twin.bench.workbench import Workbench
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.contract.specimen import COARSE, SMALL
from twin.laws.catalogue import LAWS
from twin.model.structure import BuiltIn, base_case
from twin.project.config import CalibrateTable, Config, ModelTable, PointTable
from twin.project.folder import Project
from twin.project.targetwriting import write_targets
from twin.project.toml import dump
from twin.targets import PointKind, TargetPoint, at_node

TRUTH = LAWS["yeoh"].of({"C10": 0.25, "C20": 0.05, "C30": 0.01})
LITTLE = BuiltIn(SMALL, COARSE)
TOP = 0.08  # MPa: one bellow is stiff
SD = 1e-4  # mm


def project_of(folder: Path, law: str) -> Project:
    """A project with targets of one bellow of Yeoh's rubber on the model's own mesh, without a noise model."""
    case = base_case(finger=LITTLE.finger, lattice=LITTLE.lattice)
    time = np.linspace(0.0, 4.0, 9)
    pressure = TOP * np.interp(time, [0.0, 0.5, 4.0], [0.0, 0.0, 1.0])
    rows = [int(case.node_sets["tip_face"][k]) for k in (0, -1)]
    points = case.nodes[rows]
    u = solve(case.with_material(**TRUTH.terms), Course(time, pressure, time)).at(points)
    u = u + np.random.default_rng(1).normal(0.0, SD, u.shape)
    u -= u[:1]
    value = np.concatenate([u, np.zeros((len(time), 1, 3))], axis=1)
    names = {"tip": int(case.labels[rows[0]]), "middle": int(case.labels[rows[1]])}
    given: dict[str, Any] = {
        "time": time, "pressure": pressure, "log_time": time, "log_pressure": pressure, "value": value,
        "block": np.zeros(len(time), np.int64), "held_out": np.zeros(len(time), bool),
        "points": (*(at_node(n, k) for n, k in names.items()),
                   TargetPoint("fixed", PointKind.FIXED, None, (20.0, 11.5, 30.0))),
        "covariance": np.tile(SD**2 * np.eye(3), (len(time), 3, 1, 1)), "valid": np.ones(value.shape, bool),
        "modes": np.zeros((0, *value.shape)), "reference": np.array([0]), "pressure_sd": np.zeros(len(time)),
    }  # fmt: skip
    config = Config(
        points=tuple(PointTable(name=n, node=k) for n, k in names.items()),
        model=ModelTable(law=law),
        calibrate=CalibrateTable(population=12, generations=3),
    )
    folder.mkdir()
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", plain_targets(**given))
    return Project.open(folder, builtin=LITTLE)


def test_a_project_of_yeohs_rubber_finds_its_constants(tmp_path: Path, one_process: None, say: Lines) -> None:
    project = project_of(tmp_path / "yeoh", "yeoh")
    found = run_calibrate(project, say)
    values = {name: row["value"] for name, row in found["fit"]["parameters"].items()}
    assert list(values) == ["C10", "C20", "C30"]
    for name, row in found["fit"]["parameters"].items():  # 4 sds: none of three is off by chance
        assert abs(row["value"] - TRUTH[name]) < 4 * row["sd"], name
    assert any("C10 = 0.2" in line for line in say.lines)
    compared = run_compare(project, say)
    assert compared["p_value"] > 1e-3
    bench = Workbench.of(project)
    assert bench.law.name == "yeoh"
    text = (project.root / "twin.toml").read_text(encoding="utf-8")
    assert 'law = "yeoh"' in text


@pytest.mark.slow
def test_a_law_of_many_numbers_is_found_by_whole_solves(tmp_path: Path, one_process: None, say: Lines) -> None:
    project = project_of(tmp_path / "ogden", "ogden2")
    found = run_calibrate(project, say)
    assert list(found["fit"]["parameters"]) == ["mu1", "alpha1", "mu2", "alpha2"]
    assert any("Least squares with whole solves finds them" in line for line in say.lines)
    compared = run_compare(project, say)
    assert compared["raw_rms_mm"] < 3 * SD  # nearly Yeoh's by another law


def test_constants_that_the_law_has_not_are_named(tmp_path: Path) -> None:
    project = project_of(tmp_path / "gent", "gent")
    for key, value in (("fixed", {"C10": 0.2}), ("bounds", {"C01": (0.0, 0.1)})):
        table = "model" if key == "fixed" else "calibrate"
        own = getattr(project.config, table).model_copy(update={key: value})
        wrong = replace(project, config=project.config.model_copy(update={table: own}))
        with pytest.raises(ValueError, match=rf"{table}.{key}.C[01]+: only mu and Jm can be held, by law = 'gent'"):
            Workbench.of(wrong)


def test_laws_are_told_apart_as_far_as_the_targets_can(tmp_path: Path, one_process: None, say: Lines) -> None:
    project = project_of(tmp_path / "laws", "mooney-rivlin")
    found = run_calibrate(project, say, laws="neo-hooke,yeoh")
    first, second = found["laws"]
    assert (first["name"], second["name"]) == ("yeoh", "neo-hooke")
    assert (first["group"], second["group"]) == (1, 2)
    assert first["adequate"]
    assert not second["adequate"]
    assert first["evidence"] == 0.0 > second["evidence"] + 6
    assert found["sentence"].startswith("yeoh fits these targets best. Less likely: neo-hooke.")
    record = json.loads((project.root / "runs" / found["run"] / "laws.json").read_text(encoding="utf-8"))
    assert record["laws"][0]["parameters"]["C20"]["value"] == pytest.approx(TRUTH["C20"], rel=0.1)
    with pytest.raises(ValueError, match="law 'hooke': wanted one of neo-hooke"):
        run_calibrate(project, say, laws="yeoh,hooke")
