"""The stages on targets alone, in a folder of their own: calibrate, compare, diagnose, add, review, and their errors."""

import html
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from calibrate.posteriors import Chain
from fe import Case, Lattice, Material
from fe import Path as Course
from tests.messages import Lines as Silent
from tests.messages import saying
from tests.twin.conftest import page_text
from twin import files, virtual
from twin.batches.side import entity
from twin.bench.fits import fit_file
from twin.bench.workbench import Workbench
from twin.calibrated import posterior, tradeoff
from twin.chain import stage_of
from twin.commands import pareto, profile
from twin.commands.add import run_add
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.commands.comparetwo import run_side_by_side
from twin.commands.confirm import run_confirm
from twin.commands.diagnose import run_diagnose
from twin.commands.drop import run_drop
from twin.commands.explain import run_explain
from twin.commands.explore import run_explore
from twin.commands.export import run_export
from twin.commands.pareto import run_pareto
from twin.commands.posterior import RunKeeping, run_posterior
from twin.commands.predict import run_predict
from twin.commands.profile import run_profile
from twin.commands.review import run_review
from twin.effects.library import effect
from twin.effects.protocol import Test
from twin.effects.standinforces import OutsideForce
from twin.judging.fitrecord import Estimate, FitRecord
from twin.laws.mooneyrivlin import NOMINAL
from twin.marktables import PointTable
from twin.model import prediction
from twin.model.structure import BuiltIn
from twin.numerals import in_words, interval, value
from twin.project.config import CalibrateTable, Config, DiagnoseTable, ProjectTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.project.toml import dump
from twin.results import rows_of
from twin.review.states import Fields, Generations

FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 30.0), (12.0, 30.0), (12.4, 0.0), (22.0, 0.0))
BENCH = virtual.Bench(film_hz=3.5, gauge_sd_MPa=3e-4, sd=0.005)
NAMES, X = ("p1", "p2", "middle", "p4", "tip"), np.array([9.556, 15.111, 4 + 50 / 3, 31.778, 10 + 100 / 3])
GENERATIONS = 4


def project_at(folder: Path, case: Case, short: BuiltIn) -> Project:
    """A project with targets of a creeping finger and nothing else."""
    edge = np.stack([X, np.full_like(X, 11.5), np.zeros_like(X)], axis=1)
    rows = np.linalg.norm(case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    points, course = case.nodes[rows], virtual.path(BENCH, protocol=FILM)
    material = Material(0.214, 0.083, prony=((0.075, 1.2), (0.055, 3.5), (0.02, 15.0)))
    truth = virtual.truth_case(short.finger, Lattice(per_bellow=2, centred=False), material=material, element=None)
    u, slope = virtual.displaced(truth, course, points)
    targets = virtual.noisy_targets(
        u, slope, course, points=virtual.at_nodes(NAMES, case.labels[rows], points), bench=BENCH, seed=1
    )
    config = Config(
        project=ProjectTable(name="short"),
        points=tuple(PointTable(name=n, node=int(k)) for n, k in zip(NAMES, case.labels[rows])),
        calibrate=CalibrateTable(population=8, generations=GENERATIONS),
        diagnose=DiagnoseTable(candidates=("creep", "camera_scale")),
    )
    folder.mkdir()
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", targets)
    return Project.open(folder, builtin=short)


def _no_solve(*_: object, **__: object) -> None:
    raise AssertionError("a solve")


@pytest.fixture(scope="module")
def chain(
    tmp_path_factory: pytest.TempPathFactory, short_case: Case, short_builtin: BuiltIn
) -> tuple[Project, Silent]:
    """The project after calibrate, compare, diagnose, add and review."""
    say = Silent()
    project = project_at(tmp_path_factory.mktemp("chain") / "batch", short_case, short_builtin)
    with pytest.raises(ValueError, match=r"no fit in this project; run twin calibrate"):
        run_diagnose(project, say)
    with pytest.raises(ValueError, match=r"no fit in this project; run twin calibrate"):
        run_profile(project, say)
    with pytest.raises(ValueError, match=r"nothing to review: .*run twin calibrate"):
        run_review(project, say)
    run_calibrate(project, say)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prediction, "solve", _no_solve)  # calibrate has solved all that compare needs
        run_compare(project, say)
    run_diagnose(project, say)
    with pytest.raises(ValueError, match=r"model.effects of twin.toml is empty: nothing is to be confirmed"):
        run_confirm(project, say, "0")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prediction, "solve", _no_solve)  # and diagnose all that add needs
        run_add(project, say, names=["creep"])
    project = Project.open(project.root, builtin=project.builtin)
    run_review(project, say)
    return project, say


def test_two_models_of_one_batch_lie_in_one_recording(
    chain: tuple[Project, Silent], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project, say = chain
    runs = [project.newest("calibrate", "fit.json"), project.newest("add", "fit.json")]
    folders = [path.parent for path in runs if path is not None]
    monkeypatch.chdir(tmp_path)
    result = run_side_by_side(folders, say, opened=lambda folder: Project.open(folder, builtin=project.builtin))
    names = [entity(f"{project.root.name}/{folder.name}", "model/mesh") for folder in folders]
    tables = [c.to_record_batch() for c in RrdReader(result["recording"]).stream().filter(content=names)]
    along = [t for t in tables if "film_time" in t.schema.names and "Mesh3D:vertex_positions" in t.schema.names]
    # the calibrated model at top pressure alone, the other at every state of fields.npz
    assert sum(t.num_rows for t in along) == 1 + len(Fields.load(folders[1] / "fields.npz").time_s)


def read(project: Project, kind: str, name: str) -> dict[str, object]:
    path = project.newest(kind, name)
    assert path is not None, f"{kind} wrote no {name}"
    data = json.loads(path.read_text(encoding="utf-8"))
    assert isinstance(data, dict)
    return data


def estimates_of(fit: dict[str, object]) -> dict[str, Estimate]:
    return FitRecord.model_validate(fit).estimates


def test_calibrate_leaves_its_fit_and_history(chain: tuple[Project, Silent]) -> None:
    project, say = chain
    fit = read(project, "calibrate", "fit.json")
    keys = {"parameters", "covariance", "chi2", "degrees_of_freedom", "seed", "evaluations", "converged", "reason"}
    assert keys <= set(fit)
    assert set(fit["parameters"]) == {"C10", "C01"}
    assert {"value", "sd", "low", "high", "unit"} <= set(fit["parameters"]["C10"])
    assert fit["effects"] == []
    found = project.newest("calibrate", "generations.npz")
    assert found is not None
    history = Generations.load(found)
    assert history.generation.tolist() == list(range(1, GENERATIONS + 1))
    assert np.all(np.diff(history.rms_mm) <= 0)
    assert history.film_time_s == pytest.approx(4.0, abs=0.3)  # the top of the ramp
    log = [json.loads(x) for x in (found.parent / "log.jsonl").read_text().splitlines()]
    assert [r["number"] for r in log if r.get("event") == "generation"] == list(range(1, GENERATIONS + 1))
    # the best by the table is the best by full finite elements: the marks' rms over U3 of tip and middle
    rows = [history.point_names.index(n) for n in project.config.calibrate.objective_points]
    error = history.u_points[-1, rows, 2] - history.u_measured[rows, 2]
    # mm: reference steps carry a little ripple and noise; the table is good to 0.01
    assert np.sqrt((error**2).mean()) == pytest.approx(history.rms_mm[-1], abs=0.01)
    assert any("Genetic algorithm" in line for line in say.lines)


def test_compare_says_what_the_model_misses(chain: tuple[Project, Silent]) -> None:
    found = read(chain[0], "compare", "comparison.json")
    keys = {"rms_mm", "noise_sd_mm", "chi2", "degrees_of_freedom", "p_value", "adequate", "where", "maps"}
    assert keys <= set(found)
    assert found["adequate"] is False
    assert found == read(chain[0], "calibrate", "comparison.json")
    assert found["where"] in chain[1].lines
    rows = [r for kind in found["maps"].values() for r in kind]
    assert all(r["count"] > 0 for r in rows if np.isfinite(r["rms_mm"]))
    # the tables ask nothing of the user: they stand in the log
    path = chain[0].newest("compare", "log.jsonl")
    assert path is not None
    assert "rms in mm by marker: p1 0." in path.read_text(encoding="utf-8")


def test_diagnose_names_creep(chain: tuple[Project, Silent]) -> None:
    found = read(chain[0], "diagnose", "diagnosis.json")
    keys = {"verdict", "named", "ties", "ranking", "next_test", "rms_before_mm", "rms_after_mm", "noise_sd_mm"}
    assert keys | {"adequate"} <= set(found)
    assert found["named"] == ["creep"]
    row = found["ranking"][0]
    assert {"effect", "z", "p_value", "delta_bic", "parameters"} <= set(row)
    assert {r["effect"] for r in found["ranking"]} == {"creep", "camera_scale"}  # those of twin.toml
    assert {row["effect"] for row in found["detectable"]} == {"creep", "camera_scale"}


def test_diagnose_shows_what_speaks_for_what_it_names(chain: tuple[Project, Silent]) -> None:
    found, own = read(chain[0], "diagnose", "diagnosis.json"), read(chain[0], "diagnose", "evidence.json")
    evidence = found["evidence"]
    assert evidence == own
    assert evidence["effect"] == found["law"]
    assert evidence["rms_before_mm"] == found["rms_before_mm"]
    assert evidence["rms_after_mm"] == found["rms_after_mm"]
    assert evidence["evidence"] == found["ranking"][0]["evidence"]
    path = chain[0].newest("diagnose", "evidence.npz")
    assert path is not None
    maps = np.load(path)
    assert maps["residual"].shape == chain[0].targets().value.shape
    assert np.sqrt(np.nanmean(maps["left"] ** 2)) == pytest.approx(found["rms_after_mm"], rel=1e-6)
    whole = next(row for row in evidence["shares"] if (row["marker"], row["branch"]) == ("all", "all"))
    assert whole["explained"] > 0.8


def test_add_writes_the_law_refits_and_lowers_the_error(chain: tuple[Project, Silent]) -> None:
    project, say = chain
    diagnosis, compared = read(project, "diagnose", "diagnosis.json"), read(project, "add", "comparison.json")
    assert project.config.model.effects == (diagnosis["law"],)
    fit = read(project, "add", "fit.json")
    assert fit["effects"] == [diagnosis["law"]]
    assert fit["parameters"]["creep.g1"]["value"] > 0.02
    assert compared["rms_mm"] <= 1.1 * compared["noise_sd_mm"] < diagnosis["rms_before_mm"] / 2
    assert compared["rms_mm"] == pytest.approx(diagnosis["rms_after_mm"], rel=0.05)
    # one fit, the same numbers wherever they are shown: both begin at one place, on models without a memory
    kept, own = (estimates_of(one) for one in (read(project, "diagnose", "kept.json"), fit))
    assert kept == own
    rows = diagnosis["ranking"][0]["parameters"]
    assert files.plain(kept) == rows
    assert f"{in_words(own)}." in say.lines
    assert compared["rms_mm"] == diagnosis["rms_after_mm"]
    assert compared["p_value"] == diagnosis["p_value_after"]
    assert compared["adequate"] is diagnosis["adequate"] is fit["adequate"]
    runs = [p.name for p in project.runs()]
    assert [n[5:] for n in runs if "failed" not in project.info(project.root / "runs" / n).status] == [
        "calibrate", "compare", "diagnose", "add", "review",
    ]  # fmt: skip
    folder = next(p for p in project.runs() if p.name.endswith("-add"))
    assert not (folder / "diagnosis.json").exists()
    shown = Fields.load(folder / "fields.npz")
    assert shown.time_s[0] == 0.0
    assert np.isfinite(shown.u).all()


def test_review_holds_every_generation_and_the_numbers(chain: tuple[Project, Silent]) -> None:
    project, _ = chain
    path = project.newest("review", "review.rrd")
    assert path is not None
    generations: set[int] = set()
    for chunk in RrdReader(str(path)).stream().filter(content="/model/mesh"):
        table = chunk.to_record_batch()
        if {"generation", "Mesh3D:vertex_positions"} <= set(table.schema.names):
            generations |= set(table.column("generation").cast("int64").to_pylist())
    assert generations == set(range(1, GENERATIONS + 1))
    report = page_text(path.with_name("report.html"))
    diagnosis, compared = read(project, "diagnose", "diagnosis.json"), read(project, "add", "comparison.json")
    assert isinstance(diagnosis["rms_before_mm"], float)
    assert isinstance(compared["rms_mm"], float)
    for number in (diagnosis["raw_rms_before_mm"], diagnosis["rms_before_mm"], compared["raw_rms_mm"], compared["rms_mm"]):
        # in the report's own unit and digits: mm or um
        shown = {f"{number:.3f}", f"{number:.4f}", f"{1e3 * number:.1f}", f"{1e3 * number:.0f}", f"{number:.2g}", f"{number:.3g}"}
        assert any(text in report for text in shown), number
    for row in estimates_of(read(project, "add", "fit.json")).values():
        assert value(row.value, row.low, row.high) in report
        assert (row.note or interval(row.low, row.high)) in report
    assert list(path.parent.glob("deformed*.vtu"))
    fit, first = read(project, "add", "fit.json"), read(project, "calibrate", "fit.json")
    for text in (f"What speaks for {fit['effects'][0]}", "How the error fell", "nominal constants", f"+ {fit['effects'][0]}"):
        assert text in report
    assert first["initial"]["values"] == NOMINAL.named
    assert first["initial"]["rms_mm"] > 0
    steps = [line for line in chain[1].lines if line.startswith("Error, mm rms: nominal constants ")]
    assert len(steps) == 1
    assert f"-> + {fit['effects'][0]} {compared['raw_rms_mm']:.3f}; a right model: " in steps[0]
    assert f"{compared['expected_low_mm']:.3f} to {compared['expected_high_mm']:.3f} (95 %)." in steps[0]
    opening = re.search(r'<p class="summary">(.*?)</p>', report)
    assert opening is not None
    assert opening[1].startswith(
        f"The model misses the film by {diagnosis['raw_rms_before_mm']:.3f} mm. A right model would miss it by "
        f"{diagnosis['expected_low_mm']:.3f} to {diagnosis['expected_high_mm']:.3f} mm (95 %). With "
        f"{fit['effects'][0]} it misses it by {compared['raw_rms_mm']:.3f} mm. "
    )
    assert len(re.findall(r"\.(?: |$)", opening[1])) == 4  # sentences, below that of the headline
    where = read(project, "compare", "comparison.json")["where"]
    assert isinstance(where, str)
    assert html.escape(where) in report
    info = json.loads((path.parent.parent / path.parent.name / "run.json").read_text(encoding="utf-8"))
    digest = read(project, "add", "run.json")["inputs"]["targets/targets.csv"]  # type: ignore[index]
    assert info["status"] == "done"
    assert f"SHA-256 {digest[:16]}" in report
    pictures = {str(c.entity_path) for c in RrdReader(str(path)).stream().filter(content="/pictures/**")}
    assert pictures == {"/pictures/0", "/pictures/1", "/pictures/2"}


@pytest.mark.slow
def test_explain_shows_what_speaks_for_an_effect(chain: tuple[Project, Silent], tmp_path: Path) -> None:
    shutil.copytree(chain[0].root, tmp_path / "copy")
    project, say = Project.open(tmp_path / "copy", builtin=chain[0].builtin), Silent()
    result = run_explain(project, say, name="creep")  # in the model: taken out
    compared, before = read(project, "add", "comparison.json"), read(project, "compare", "comparison.json")
    assert result["rms_after_mm"] == pytest.approx(compared["rms_mm"], rel=1e-3)
    # fitted anew from elsewhere; where a model misses, its errors leave a flat valley
    assert result["rms_before_mm"] == pytest.approx(before["rms_mm"], rel=0.05)
    assert result["held_out"]["after_sd"] < 1.2 < result["held_out"]["before_sd"]
    assert result["effect"] == project.config.model.effects[0]
    assert result["parameters"]["creep.g1"]["plausible"].startswith("plausible (0.003 to 0.2)")
    assert any(line.startswith("tip ") for line in say.lines)
    assert read(project, "explain", "evidence.json")["effect"] == result["effect"]
    assert Project.open(project.root).config.model.effects == project.config.model.effects  # nothing is changed
    with pytest.raises(ValueError, match="'wind' is not in the library"):
        run_explain(project, say, name="wind")


@pytest.mark.slow
def test_explain_shows_what_does_not_speak_for_an_effect(chain: tuple[Project, Silent], tmp_path: Path) -> None:
    shutil.copytree(chain[0].root, tmp_path / "copy")
    project = Project.open(tmp_path / "copy", builtin=chain[0].builtin)
    found = run_explain(project, Silent(), name="camera_scale")  # not in the model, and not missing
    assert found["effect"] == "camera_scale"
    assert abs(found["gain"]) < 10.0
    assert max(abs(row["explained"]) for row in found["shares"] if row["marker"] == "all") < 0.1


@pytest.mark.slow
def test_calibrate_fits_the_effects_of_twin_toml_again(chain: tuple[Project, Silent], tmp_path: Path) -> None:
    shutil.copytree(chain[0].root, tmp_path / "copy")
    project = Project.open(tmp_path / "copy", builtin=chain[0].builtin)
    then, say = estimates_of(read(project, "add", "fit.json")), Silent()
    result = run_calibrate(project, say)
    assert result["with_effects"]["effects"] == list(project.config.model.effects)
    now = estimates_of(read(project, "add", "fit.json"))
    for name, one in now.items():  # errors rebuilt at another start may move it by a share of its interval
        half = (then[name].high - then[name].low) / 2
        assert abs(one.value - then[name].value) < 0.1 * half
    assert not any("do not ask for" in line for line in say.lines)


def test_dropping_an_effect_leads_back_to_the_fit_before_it(chain: tuple[Project, Silent], tmp_path: Path) -> None:
    shutil.copytree(chain[0].root, tmp_path / "copy")
    project = Project.open(tmp_path / "copy", builtin=chain[0].builtin)
    run_drop(project, Silent(), names=["creep"])
    assert read(project, "drop", "fit.json")["parameters"] == read(project, "calibrate", "fit.json")["parameters"]
    assert read(project, "drop", "comparison.json")["rms_mm"] == pytest.approx(read(project, "compare", "comparison.json")["rms_mm"], rel=1e-6)


def test_errors_are_one_sentence(chain: tuple[Project, Silent]) -> None:
    project, say = chain
    with pytest.raises(ValueError, match="'wind' is not in the library"):
        run_add(project, say, names=["wind"])
    with pytest.raises(ValueError, match="'stiffening' is not in the model"):
        run_drop(project, say, names=["stiffening"])
    model = project.config.model
    strange = replace(project, config=project.config.model_copy(update={"model": model.model_copy(
        update={"fixed": {"bulk": 300.0}})}))  # fmt: skip
    with pytest.raises(ValueError, match=saying(r"model\.fixed\.bulk", "C10", "C01")):
        run_compare(strange, say)
    points = (*project.config.points[:-1], PointTable(name="tip", node=987654))
    lost = replace(project, config=project.config.model_copy(update={"points": points}))
    with pytest.raises(ValueError, match=saying("4401", r"twin\.toml", "987654")):
        run_compare(lost, say)


def test_an_unknown_node_or_an_unseen_point_stops_calibrate(tmp_path: Path, short_case: Case, short_builtin: BuiltIn) -> None:
    project = project_at(tmp_path / "batch", short_case, short_builtin)
    t = project.targets()
    moved = tuple(replace(p, node=987654) if p.node == 4401 else p for p in t.points)
    write_targets(tmp_path / "other", replace(t, points=moved))
    points = tuple(p.model_copy(update={"node": 987654}) if p.name == "tip" else p for p in project.config.points)
    for name in ("targets.csv", "targets.npz", "targets.toml"):
        (project.targets_folder / name).write_bytes((tmp_path / "other" / name).read_bytes())
    other = replace(project, config=project.config.model_copy(update={"points": points}))
    with pytest.raises(ValueError, match="node 987654: not in the model"):
        run_calibrate(other, Silent())
    value, valid = t.value.copy(), t.valid.copy()
    value[:, 4], valid[:, 4] = np.nan, False
    write_targets(tmp_path / "lost", replace(t, value=value, valid=valid))
    for name in ("targets.csv", "targets.npz", "targets.toml"):
        (project.targets_folder / name).write_bytes((tmp_path / "lost" / name).read_bytes())
    with pytest.raises(ValueError, match="point 'tip' has no U3 at step"):
        run_calibrate(project, Silent())
    info = project.info(project.runs()[-1])
    assert info.status.startswith("failed: point 'tip'")


def test_the_calibrated_finger_goes_to_other_programs(chain: tuple[Project, Silent]) -> None:
    project, _ = chain
    say = Silent()
    folder = project.root / "runs"
    found = run_export(project, say, form="abaqus", pressure="20kPa", ramp_s=1.0, hold_s=4.0)
    text = (folder / found["run"] / "finger.inp").read_text()
    assert "MODULI=INSTANTANEOUS" in text
    series = re.search(r"\*VISCOELASTIC, TIME=PRONY\n(.*)", text)
    fit = files.read(FitRecord, fit_file(project)).parameters
    assert series is not None
    wanted = (fit["creep.g1"].value, 0.0, fit["creep.tau1"].value)
    assert tuple(map(float, series[1].split(","))) == pytest.approx(wanted, rel=1e-6)
    assert re.findall(r"\*VISCO, CETOL=0.001\n[^,]*, ([^,]*)", text) == ["1", "4"]
    assert ", P, 0.02" in text
    with pytest.raises(ValueError, match="Prony series: CalculiX knows none; drop it, or export for abaqus"):
        run_export(project, say, form="calculix")
    with pytest.raises(ValueError, match="--at tip: of a table"):
        run_export(project, say, form="abaqus", at=["tip"])
    for form, told in (("step", "wanted one of abaqus"), ("csv", "--pressure 20kPa: of a deck")):
        with pytest.raises(ValueError, match=told):
            run_export(project, say, form=form, pressure="20kPa")


@pytest.mark.slow
def test_the_response_of_the_calibrated_finger_is_a_table(chain: tuple[Project, Silent]) -> None:
    project, _ = chain
    say, folder = Silent(), project.root / "runs"
    found = run_export(project, say, form="json", at=["tip"])
    made = json.loads((folder / found["run"] / "model.json").read_text())
    rows = made["response"]
    p = np.array([row["pressure_MPa"] for row in rows])
    assert len(p) == 16
    assert p[-1] == pytest.approx(made["tested_MPa"])
    u, slope = (np.array([row[key] for row in rows]) for key in ("u_mm", "slope_mm_per_MPa"))
    np.testing.assert_allclose(np.gradient(u[:, 2], p)[1:-1], slope[1:-1, 2], rtol=0.02)
    said = run_predict(project, say, pressure=(f"{1e3 * p[8]:.6f}kPa",), at=("tip",))["points"][0]
    np.testing.assert_allclose(u[8], said["u_mm"], atol=5e-3)  # what has crept before is not quite forgotten


@pytest.mark.slow
def test_what_was_not_filmed_is_predicted_with_an_interval_that_holds_the_truth(
    chain: tuple[Project, Silent], short_case: Case, short_builtin: BuiltIn
) -> None:
    project, _ = chain
    say = Silent()
    asked = {"at": ("tip", "p2"), "ramp_s": 1.0, "hold_s": 4.0}
    found = run_predict(project, say, pressure=("36kPa", "0.2bar"), **asked)
    material = Material(0.214, 0.083, prony=((0.075, 1.2), (0.055, 3.5), (0.02, 15.0)))
    truth = virtual.truth_case(short_builtin.finger, Lattice(per_bellow=2, centred=False), material=material, element=None)
    edge = np.array([(x, 11.5, 0.0) for x in (X[-1], X[1])])
    points = short_case.nodes[np.linalg.norm(short_case.nodes[:, None] - edge, axis=2).argmin(axis=0)]
    wide = {}
    for p in (0.036, 0.02):
        course = Course(np.array([0.0, 1.0, 5.0]), np.array([0.0, p, p]), np.array([5.0]))
        u = virtual.displaced(truth, course, points)[0][0]
        rows = [row for row in found["points"] if np.isclose(row["pressure_MPa"], p)]
        assert [row["point"] for row in rows] == ["tip", "p2"]
        assert all(row["beyond"] == (p > 0.03) for row in rows)
        for row, true in zip(rows, u, strict=True):
            for k in (0, 2):
                low, high = row["low_mm"][k], row["high_mm"][k]
                assert abs(true[k] - row["u_mm"][k]) < 0.75 * (high - low), (p, row["point"], k)  # of 8, at 2.9 sd
        wide[p] = [row["high_mm"][2] - row["low_mm"][2] for row in rows]
    assert all(a > b for a, b in zip(wide[0.036], wide[0.02], strict=True))
    assert any("beyond the 30" in line for line in say.lines)
    folder = project.root / "runs" / found["run"]
    table = rows_of("predict", folder, found)
    assert [row["u3_mm"] for row in table] == pytest.approx([row["u_mm"][2] for row in found["points"]], rel=1e-5)
    assert all((folder / f"predicted.{end}").stat().st_size for end in ("csv", "json", "png", "pvd", "rrd"))
    (force,) = run_predict(project, say, pressure=("20kPa",), blocked=True, **asked)["blocked"]
    true = _blocked(truth, 0.02)
    assert abs(force["force_N"] - true) < 0.75 * (force["high_N"] - force["low_N"])  # at 2.9 sd
    assert force["force_N"] == pytest.approx(true, rel=0.1)  # so coarse a mesh alone may be off by a third


@pytest.mark.slow
def test_a_profile_says_how_well_each_parameter_is_known(
    chain: tuple[Project, Silent], monkeypatch: pytest.MonkeyPatch
) -> None:
    project, _ = chain
    say, asked = Silent(), ["creep.g1"]
    with monkeypatch.context() as patch:
        patch.setattr(profile, "draw_profiles", _interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_profile(project, say, names=asked)
    with monkeypatch.context() as patch:
        patch.setattr(prediction, "solve", _no_solve)  # what was finished before the interrupt is kept
        found = run_profile(project, say, names=asked)
    fit = files.read(FitRecord, fit_file(project))
    folder = project.root / "runs" / found["run"]
    assert [row["name"] for row in found["profiles"]] == asked
    for row in found["profiles"]:
        assert row["known"] == "identified"
        assert row["low_95"] < row["low_68"] < row["value"] < row["high_68"] < row["high_95"]
        deviance = {point["value"]: point["deviance"] for point in row["points"]}
        for key, level in (("low_68", 1.0), ("high_68", 1.0), ("low_95", 3.84), ("high_95", 3.84)):
            assert deviance[row[key]] == pytest.approx(level, abs=0.02)
        wide = row["high_covariance"] - row["low_covariance"]
        assert row["high_95"] - row["low_95"] == pytest.approx(wide, rel=0.15)  # an amplitude, which no error of the mesh takes up
        assert 5 <= row["solves"] < 40
    g1 = fit.estimates["creep.g1"]
    assert found["profiles"][0]["low_covariance"] == pytest.approx(g1.low, rel=1e-3)
    lines = (folder / "profile.csv").read_text().splitlines()
    assert lines[0] == "name,unit,value,deviance," + ",".join(fit.parameters)
    assert len(lines) == 1 + sum(len(row["points"]) for row in found["profiles"])
    assert (folder / "profile.png").stat().st_size
    assert [row["name"] for row in rows_of("profile", folder, found)] == asked
    assert any("whole solves of the model" in line for line in say.lines)
    with pytest.raises(ValueError, match=r"profile 'C20': not in the newest fit; wanted some of C10, .*C10\+C01, share"):
        run_profile(project, say, names=["C20"])
    bare = project.config.model.model_copy(update={"effects": ()})
    without = replace(project, config=project.config.model_copy(update={"model": bare}))
    with pytest.raises(ValueError, match="no profiles: the model does not fit yet"):
        run_profile(without, say)


@pytest.mark.slow
def test_a_front_says_whether_points_contradict_each_other(
    chain: tuple[Project, Silent], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the model without creep, which costs less to solve."""
    full, _ = chain
    model = full.config.model.model_copy(update={"effects": ()})
    project = replace(full, config=full.config.model_copy(update={"model": model}))
    for name, size in (("KEPT", 3), ("SOLVES", 2), ("GENERATIONS", 6)):
        monkeypatch.setattr(tradeoff, name, size)
    say = Silent()
    with monkeypatch.context() as patch:
        patch.setattr(pareto, "draw_front", _interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_pareto(project, say, objectives="tip,middle.U3")
    with monkeypatch.context() as patch:  # fits and points that were solved before the interrupt are kept
        patch.setattr(tradeoff, "_alone", _no_solve)
        patch.setattr(tradeoff, "_solved", _no_solve)
        found = run_pareto(project, say, objectives="tip,middle.U3")
    objectives = found["objectives"]
    assert [row["name"] for row in objectives] == ["tip", "middle.U3"]
    assert objectives[0]["values"] == 2 * objectives[1]["values"]  # U1 and U3
    for row in objectives:
        assert 0 < row["best"] <= row["fit"]
        assert row["excess"] == pytest.approx(row["values"] * (row["fit"] ** 2 - row["best"] ** 2), abs=1e-6)
        assert BENCH.sd < row["noise_mm"] < row["expected_mm"]  # with what the gauge's noise moves
    assert found["conflict"] == any(row["excess"] > found["threshold"] for row in objectives)
    assert found["told"].startswith("Conflict of" if found["conflict"] else "No conflict")
    assert len(found["points"]) == 3
    assert min(row["best"] for row in objectives) < min(m for p in found["points"] for m in p["misfit"].values()) + 1e-9
    folder = project.root / "runs" / found["run"]
    lines = (folder / "pareto.csv").read_text().splitlines()
    assert lines[0] == "point,C10,C01,misfit tip,misfit middle.U3,rms_mm tip,rms_mm middle.U3"
    assert sum(line.startswith("knee,") for line in lines) == 1
    own = dict(zip(lines[0].split(","), lines[1].split(",")))
    assert own["point"] == "one fit"
    targets, u = project.targets(), np.load(fit_file(project).with_name("prediction.npz"))["u"]
    tip = (targets.value - u)[:, targets.names.index("tip")]
    rms = np.sqrt(np.nanmean(np.where(targets.valid[:, targets.names.index("tip")], tip, np.nan) ** 2))
    assert float(own["rms_mm tip"]) == pytest.approx(rms, rel=1e-3)  # solved once more, from another start
    assert (folder / "pareto.png").stat().st_size
    assert len(rows_of("pareto", folder, found)) == 3
    with pytest.raises(ValueError, match=saying("--objectives", "'tap'")):
        run_pareto(project, say, objectives="tip,tap")


def test_a_design_starts_from_what_was_fitted(chain: tuple[Project, Silent]) -> None:
    project, _ = chain
    found = run_explore(project, Silent(), over=["creep.g1=0:0.1"], runs=2, whole=True)
    assert found["pressure_MPa"] == project.targets().log_pressure.max()
    fit = files.read(FitRecord, fit_file(project))
    assert found["held"] == pytest.approx({n: row.value for n, row in fit.parameters.items() if n != "creep.g1"})
    still, creeping = sorted(found["rows"], key=lambda row: row["values"]["creep.g1"])
    assert creeping["angle_deg"] > still["angle_deg"] > 5  # softer while the pressure is held
    assert creeping["stretch"] > still["stretch"] > 1
    assert found["told"].startswith("Too few runs")
    assert "nominal" not in found["note"]


@pytest.mark.slow
def test_a_sum_that_the_error_of_the_mesh_hides_is_as_wide_by_its_profile(chain: tuple[Project, Silent]) -> None:
    """Under errors held as at the fit the profile was two thirds as wide, and had no lower end near 0.22 MPa:
    the mesh's error hides the sum at the fit, but not beside it."""
    project, _ = chain
    (row,) = run_profile(project, Silent(), names=["C10+C01"])["profiles"]
    assert row["known"] == "identified"
    assert row["low_95"] < 0.297 < row["high_95"]  # 0.214 and 0.083 MPa
    wide = row["high_covariance"] - row["low_covariance"]
    assert row["high_95"] - row["low_95"] == pytest.approx(wide, rel=0.25)


def test_a_posterior_wants_a_model_that_fits(chain: tuple[Project, Silent]) -> None:
    project, say = chain
    bare = project.config.model.model_copy(update={"effects": ()})
    without = replace(project, config=project.config.model_copy(update={"model": bare}))
    with pytest.raises(ValueError, match=r"no posterior: the model does not fit yet.*twin diagnose"):
        run_posterior(without, say)
    outside = project.config.model.model_copy(update={"engine": "calculix"})
    with pytest.raises(ValueError, match=saying(r"model\.engine = 'calculix'", "twin posterior")):
        run_posterior(replace(project, config=project.config.model_copy(update={"model": outside})), say)


@pytest.mark.slow
def test_a_posterior_says_how_likely_all_parameters_are(
    chain: tuple[Project, Silent], monkeypatch: pytest.MonkeyPatch
) -> None:
    project, _ = chain
    say, number = Silent(), len(project.runs())
    with monkeypatch.context() as patch:
        patch.setattr(RunKeeping, "set_points", _interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_posterior(project, say)
    with monkeypatch.context() as patch:
        patch.setattr(posterior, "sampled", _going_on(posterior.sampled))
        found = run_posterior(project, say)
    assert len(project.runs()) == number + 1
    assert found["trusted"]
    assert found["off"] < 0.1
    rows = {row["name"]: row for row in found["rows"]}
    assert list(rows) == ["C10", "C01", "creep.g1", "creep.tau1", "C10+C01", "share"]
    for row in rows.values():
        assert row["low_95"] < row["mean"] < row["high_95"]
        wide = row["high_covariance"] - row["low_covariance"]
        assert row["high_95"] - row["low_95"] == pytest.approx(wide, rel=0.25)  # so coarse a mesh is known to 19 % only
    assert rows["C10"]["low_95"] < 0.214 < rows["C10"]["high_95"]
    assert rows["C01"]["low_95"] < 0.083 < rows["C01"]["high_95"]
    assert rows["C10+C01"]["low_95"] < 0.297 < rows["C10+C01"]["high_95"]
    assert found["inside"] > 0.9
    folder = project.root / "runs" / found["run"]
    for file in stage_of("posterior").writes:
        assert (folder / file).stat().st_size, file
    assert [row["name"] for row in rows_of("posterior", folder, found)] == list(rows)
    assert any("whole solves in all" in line for line in say.lines)


def _going_on(whole: Callable[..., Chain]) -> Callable[..., Chain]:
    """A sampler that goes on with the first chain, and makes others anew."""
    numbers = iter(range(9))

    def going_on(*args: Any, chain: Chain | None, **how: Any) -> Chain:
        assert (chain is not None) == (next(numbers) == 0)
        return whole(*args, chain=chain, **how)

    return going_on


def _interrupted(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.slow
def test_a_blocked_force_is_that_of_the_finest_mesh(chain: tuple[Project, Silent]) -> None:
    """With the same constants and creep. The correction is 3 %, of which this coarse mesh asks for a half."""
    project, say = chain
    (found,) = run_predict(project, say, pressure=("20kPa",), blocked=True, ramp_s=1.0, hold_s=4.0)["blocked"]
    bench, fit = Workbench.of(project), files.read(FitRecord, fit_file(project))
    values = {name: row.value for name, row in fit.parameters.items()}
    finest = list(bench.structure.finer.values())[-1].build()
    finest = finest.with_material(C10=values["C10"], C01=values["C01"])
    path = Course(np.zeros(1), np.zeros(1), np.zeros(1))
    crept = effect(fit.effects[0], users=()).before(Test(finest, path, np.zeros((0, 3)), np.zeros(0, bool)), values)
    assert found["force_N"] == pytest.approx(_blocked(crept.case, 0.02), rel=0.025)


def _blocked(truth: Case, pressure: float) -> float:
    """The force in N that keeps the end of a finger of another mesh at its height, by a secant."""
    face = truth.nodes[truth.nodes[:, 0] > truth.nodes[:, 0].max() - 1e-6]
    ends = np.array([face[face[:, 2].argmin()], face[face[:, 2].argmax()]])
    course = Course(np.array([0.0, 1.0, 5.0]), np.array([0.0, pressure, pressure]), np.array([5.0]))
    push = OutsideForce(1.0, ("up",), growing=True)

    def height(rate: float) -> float:
        test = push.before(Test(truth, course, ends, np.ones(2, bool)), {push.parameters[0].name: rate})
        return float(virtual.displaced(test.case, course, ends)[0][0, :, 2].mean())

    a, b = 0.0, 3.0
    ua, ub = height(a), height(b)
    for _ in range(3):
        a, b, ua = b, b - ub * (b - a) / (ub - ua), ub
        ub = height(b)
    assert abs(ub) < 1e-3
    return pressure * b


