"""The stages with a law that is not Mooney-Rivlin: what is fitted, said and written is of that law."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fe import Path as Course
from fe import solve
from tests.messages import Lines, run
from tests.twin.conftest import plain_targets
from twin.bench.workbench import Workbench
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.contract.specimen import COARSE, SMALL
from twin.laws.catalogue import LAWS
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.marktables import PointTable
from twin.model import loadpaths
from twin.model.structure import BuiltIn, base_case, of_deck
from twin.project.config import CalibrateTable, Config, ModelTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.project.toml import dump
from twin.targets import Array, PointKind, TargetPoint, Targets, at_node

TRUTH = LAWS["yeoh"].of({"C10": 0.25, "C20": 0.05, "C30": 0.01})
LITTLE = BuiltIn(SMALL, COARSE)
TOP = 0.08  # MPa: one bellow is stiff
SD = 1e-4  # mm


def targets_of(time: Array, pressure: Array, u: Array, names: dict[str, int]) -> Targets:
    """Targets of nodes that move by u (s, p, 3) mm, with errors of SD, relative to the first step."""
    u = u + np.random.default_rng(1).normal(0.0, SD, u.shape)
    value = np.concatenate([u - u[:1], np.zeros((len(time), 1, 3))], axis=1)
    given: dict[str, Any] = {
        "time": time, "pressure": pressure, "log_time": time, "log_pressure": pressure, "value": value,
        "block": np.zeros(len(time), np.int64), "held_out": np.zeros(len(time), bool),
        "points": (*(at_node(n, k) for n, k in names.items()),
                   TargetPoint("fixed", PointKind.FIXED, None, (20.0, 11.5, 30.0))),
        "covariance": np.tile(SD**2 * np.eye(3), (len(time), 3, 1, 1)), "valid": np.ones(value.shape, bool),
        "modes": np.zeros((0, *value.shape)), "reference": np.array([0]), "pressure_sd": np.zeros(len(time)),
    }  # fmt: skip
    return plain_targets(**given)


def project_of(folder: Path, law: str) -> Project:
    """A project with targets of one bellow of Yeoh's rubber on the model's own mesh, without a noise model."""
    case = base_case(finger=LITTLE.finger, lattice=LITTLE.lattice)
    time = np.linspace(0.0, 4.0, 9)
    pressure = TOP * np.interp(time, [0.0, 0.5, 4.0], [0.0, 0.0, 1.0])
    rows = [int(case.node_sets["tip_face"][k]) for k in (0, -1)]
    points = case.nodes[rows]
    u = solve(case.with_material(**TRUTH.terms), Course(time, pressure, time)).at(points)
    names = {"tip": int(case.labels[rows[0]]), "middle": int(case.labels[rows[1]])}
    config = Config(
        points=tuple(PointTable(name=n, node=k) for n, k in names.items()),
        model=ModelTable(law=law),
        calibrate=CalibrateTable(population=12, generations=3),
    )
    folder.mkdir()
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", targets_of(time, pressure, u, names))
    return Project.open(folder, builtin=LITTLE)


@pytest.fixture(autouse=True)
def few_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Load paths of few levels, which are right enough for a search that whole solves end."""
    monkeypatch.setattr(loadpaths, "LEVELS", 5)


@pytest.mark.slow
def test_a_project_of_yeohs_rubber_finds_its_constants(tmp_path: Path, say: Lines) -> None:
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
def test_a_law_of_many_numbers_is_found_by_whole_solves(tmp_path: Path, say: Lines) -> None:
    project = project_of(tmp_path / "ogden", "ogden2")
    found = run_calibrate(project, say)
    assert list(found["fit"]["parameters"]) == ["mu1", "alpha1", "mu2", "alpha2"]
    assert any("Least squares with whole solves finds them" in line for line in say.lines)
    compared = run_compare(project, say)
    assert compared["raw_rms_mm"] < 3 * SD  # nearly Yeoh's by another law


OWN, YEOHS = "*hyperelastic, mooney-rivlin\n 0.18D0, 0.06, 0.005\n", "*hyperelastic, yeoh\n0.15, 0.02, 0.001, 0.008, 0., 0.\n"


def yeoh_deck(tube_deck: Callable[..., Path], folder: Path) -> Path:
    """A deck of a tube of Yeoh's rubber."""
    deck = tube_deck(folder, "C3D20RH", cells=4)
    text = deck.read_text(encoding="utf-8")
    assert text.count(OWN) == 1
    deck.write_text(text.replace(OWN, YEOHS), encoding="utf-8")
    return deck


def test_a_deck_keeps_its_law_and_begins_at_its_own_constants(tube_deck: Callable[..., Path], tmp_path: Path) -> None:
    deck = yeoh_deck(tube_deck, tmp_path)
    found = of_deck(deck)
    assert found.nominal == LAWS["yeoh"].of({"C10": 0.15, "C20": 0.02, "C30": 0.001})
    own = next(iter(found.case.materials.values()))
    assert (own.C10, own.C20, own.C30) == (0.15, 0.02, 0.001)
    assert own.bulk == pytest.approx(2 / 0.008)
    told = "Yeoh with fitted C10, C20 and C30, which begin at the deck's C10 = 0.15, C20 = 0.02, C30 = 0.001 MPa, is"
    assert any(told in remark for remark in found.remarks)
    other = of_deck(deck, law=LAWS["gent"])
    assert other.nominal == LAWS["gent"].nominal
    assert any("Gent with fitted mu and Jm replaces" in remark for remark in other.remarks)
    plain = of_deck(tube_deck(tmp_path, "C3D20RH", cells=4))
    assert plain.nominal == MOONEY_RIVLIN.nominal


def test_the_command_line_calibrates_a_deck_of_yeohs_rubber(
    tube_deck: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    deck, nodes = yeoh_deck(tube_deck, tmp_path), {"tip": 70001, "middle": 70002}
    case = of_deck(deck).case
    truth = LAWS["yeoh"].of({"C10": 0.18, "C20": 0.03, "C30": 0.0})
    time = np.linspace(0.0, 4.0, 6)
    pressure = 0.02 * np.interp(time, [0.0, 0.5, 4.0], [0.0, 0.0, 1.0])
    points = np.array([case.position(n) for n in nodes.values()])
    u = solve(case.with_material(**truth.terms), Course(time, pressure, time)).at(points)
    write_targets(tmp_path / "targets", targets_of(time, pressure, u, nodes))
    named = [a for name, label in nodes.items() for a in ("--node", f"{name}={label}")]
    run("init", tmp_path / "batch", "--targets", tmp_path / "targets", "--deck", deck, *named)
    toml = tmp_path / "batch" / "twin.toml"
    text = toml.read_text(encoding="utf-8")
    toml.write_text(text.replace("population = 30", "population = 8").replace("generations = 20", "generations = 2"))
    run("calibrate", "--project", tmp_path / "batch")
    run("compare", "--project", tmp_path / "batch")
    told = capsys.readouterr().out
    assert "C20 = 0.0" in told
    fit = Project.open(tmp_path / "batch").newest("calibrate", "fit.json")
    assert fit is not None
    values = json.loads(fit.read_text(encoding="utf-8"))["parameters"]
    assert values["C10"]["value"] == pytest.approx(truth["C10"], abs=5 * values["C10"]["sd"])


def test_constants_that_the_law_has_not_are_named(tmp_path: Path) -> None:
    project = project_of(tmp_path / "gent", "gent")
    for key, value in (("fixed", {"C10": 0.2}), ("bounds", {"C01": (0.0, 0.1)})):
        table = "model" if key == "fixed" else "calibrate"
        own = getattr(project.config, table).model_copy(update={key: value})
        wrong = replace(project, config=project.config.model_copy(update={table: own}))
        with pytest.raises(ValueError, match=rf"{table}.{key}.C[01]+: only mu and Jm can be held, by law = 'gent'"):
            Workbench.of(wrong)


def test_laws_are_told_apart_as_far_as_the_targets_can(tmp_path: Path, say: Lines) -> None:
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
