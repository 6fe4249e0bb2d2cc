"""A fit made from other targets, another mesh, other settings or other effects is named and not used."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrate import Parameter, least_squares
from tests.messages import Lines, saying
from twin import files
from twin.bench.effectlaws import laws_of
from twin.bench.fits import fresh, named_effects, newest_fit, stale, stale_sentences
from twin.bench.waterfall import in_words, stairs
from twin.commands.add import run_add
from twin.judging.fitrecord import FitRecord
from twin.project import folder, record
from twin.project.folder import Project, dataset

FIT = least_squares(
    lambda x: x - 0.2, lambda x: np.eye(1), (Parameter("C10", 0.1, 0.3, "MPa", typical=0.01, start=0.2),), start=np.array([0.15])
)
TOML = """\
[model]
{model}
[[points]]
name = "tip"
node = 4401
[[points]]
name = "middle"
node = 5848
[calibrate]
population = 8
[diagnose]
candidates = ["creep"]
"""


@pytest.fixture
def root(tmp_path: Path, tube_deck: Callable[..., Path]) -> Path:
    """A project with a deck, targets and effects = ["creep"], fitted without and with them."""
    (tmp_path / "targets").mkdir()
    (tmp_path / "raw").mkdir()
    (tmp_path / "targets" / "targets.csv").write_bytes((dataset("study") / "targets" / "targets.csv").read_bytes())
    tube_deck(tmp_path / "raw", "C3D10H", cells=3)
    files.write_text(tmp_path / "twin.toml", TOML.format(model='deck = "raw/tube.inp"'))
    fitted(tmp_path, "calibrate", [])
    edit(tmp_path, "[model]\n", '[model]\neffects = ["creep"]\n')
    return tmp_path


def fitted(root: Path, kind: str, effects: list[str]) -> None:
    with Project.open(root).new_run(kind) as run:
        run.write(FitRecord.of(FIT, effects=effects))


def edit(root: Path, old: str, new: str, name: str = "twin.toml") -> None:
    text = (root / name).read_text()
    assert old in text
    (root / name).write_text(text.replace(old, new, 1))


def test_the_newest_fit_with_the_same_effects_is_used(root: Path) -> None:
    with pytest.raises(ValueError, match=saying(r"\['creep'\]", "twin calibrate")):
        newest_fit(Project.open(root))
    fitted(root, "add", ["creep"])
    assert newest_fit(Project.open(root)).theta == pytest.approx(FIT.theta)
    assert not stale(Project.open(root), root / "runs" / "0001-calibrate")  # effects that came since do not matter


@pytest.mark.parametrize(
    ("name", "old", "new", "sentence"),
    [
        ("targets/targets.csv", "-58.0", "-57.0", "targets/targets.csv has changed since"),
        ("raw/tube.inp", "0.18D0", "0.19D0", "raw/tube.inp has changed since"),
        ("raw/mesh.inc", "*NODE", "**\n*NODE", "raw/mesh.inc has changed since"),
        ("twin.toml", "[model]\n", "[model]\nmesh = 2\n", "[model] mesh of twin.toml has changed since"),
        (
            "twin.toml", "[model]\n", "[model]\ndensity_kg_m3 = 1070.0\ngravity = [0.0, 0.0, -1.0]\n",
            "[model] density_kg_m3 of twin.toml has changed since",
        ),
        ("twin.toml", "[calibrate]\n", "[calibrate]\nseed = 5\n", "[calibrate] seed of twin.toml has changed since"),
        ("twin.toml", "node = 5848", "node = 5849", "[[points]] of twin.toml has changed since"),
    ],
)  # fmt: skip
def test_what_has_changed_since_is_named_and_the_fit_not_used(
    root: Path, name: str, old: str, new: str, sentence: str
) -> None:
    fitted(root, "add", ["creep"])
    edit(root, old, new, name)
    with pytest.raises(ValueError) as error:
        newest_fit(Project.open(root))
    assert str(error.value) == f"fit of runs/0002-add is stale: {sentence}; run twin calibrate"


def test_a_model_with_other_effects_than_twin_toml_is_not_shown(root: Path) -> None:
    fitted(root, "add", ["creep"])
    assert stale(Project.open(root), root / "runs" / "0002-add") == []
    edit(root, 'effects = ["creep"]', "effects = []")
    assert stale(Project.open(root), root / "runs" / "0002-add") == ["its effects are creep, those of twin.toml none"]
    assert fresh(Project.open(root), ("add", "drop"), "fit.json") is None


def compared(root: Path, kind: str, effects: list[str], rms: float, **beside: object) -> None:
    """A run with a fit and its comparison."""
    with Project.open(root).new_run(kind) as run:
        run.write(FitRecord.of(FIT, effects=effects, **beside))
        found = {"rms_mm": rms, "raw_rms_mm": 2 * rms, "expected_mm": 0.5, "expected_low_mm": 0.4, "expected_high_mm": 0.6, "noise_sd_mm": 0.02, "adequate": rms < 0.021}
        run.write_json("comparison.json", found)


def test_the_error_falls_from_nominal_constants_over_every_effect(root: Path) -> None:
    compared(root, "calibrate", [], 0.9)  # an older one: the newest counts
    assert [row.done for row in stairs(Project.open(root))] == ["calibrated"]
    compared(root, "calibrate", [], 0.3, initial={"rms_mm": 5.0, "raw_rms_mm": 6.0, "values": {}})
    compared(root, "add", ["creep"], 0.1)
    compared(root, "add", ["creep:2"], 0.09)
    compared(root, "add", ["creep:2"], 0.08)  # again: the newest stands for both
    compared(root, "add", ["creep:2", "clamp"], 0.02)
    compared(root, "drop", ["clamp"], 0.2)
    rows = stairs(Project.open(root))
    assert [(row.done, row.rms_mm) for row in rows] == [
        ("nominal constants", 5.0), ("calibrated", 0.3), ("+ creep", 0.1), ("+ creep:2", 0.08), ("+ clamp", 0.02),
        ("- creep:2", 0.2),
    ]  # fmt: skip
    assert [row.adequate for row in rows] == [False, False, False, False, True, False]
    assert rows[0].run == ""
    assert rows[-1].run.endswith("-drop")
    text = in_words(rows[:3])
    assert text == (
        "Error, mm rms: nominal constants 6.000 -> calibrated 0.600 -> + creep 0.200; a right model: 0.400 to "
        "0.600 (95 %)."
    )
    old = rows[1].model_copy(update={"raw_rms_mm": None, "expected_mm": None})  # as an older version wrote it
    assert (old.error_mm, old.foot_mm) == (0.3, 0.02)
    assert in_words(rows[:1]) == ""
    edit(root, "-58.0", "-57.0", "targets/targets.csv")  # all of them are of other targets now
    assert stairs(Project.open(root)) == ()


def test_new_and_lost_files_of_the_targets_count(root: Path) -> None:
    edit(root, 'effects = ["creep"]', "effects = []")
    (root / "targets" / "pressure.csv").write_text("block,time_s,pressure_MPa\n0,0,0\n0,1,0.03\n")
    with pytest.raises(ValueError, match=saying("runs/0001-calibrate", "targets/pressure.csv", "twin calibrate")):
        newest_fit(Project.open(root))
    (root / "targets" / "pressure.csv").unlink()
    assert newest_fit(Project.open(root)).theta == pytest.approx(FIT.theta)
    (root / "raw" / "mesh.inc").rename(root / "raw" / "other.inc")
    edit(root, "mesh.inc", "other.inc", "raw/tube.inp")
    assert stale(Project.open(root), root / "runs" / "0001-calibrate") == [
        "raw/tube.inp has changed since", "raw/mesh.inc is gone", "raw/other.inc is new"
    ]  # fmt: skip


def test_a_run_depends_on_what_it_has_recorded(root: Path) -> None:
    board = root / "raw" / "board.png"
    board.write_bytes(b"1")
    with Project.open(root).new_run("camera", tables=(), inputs=[board]) as run:
        run.write_json("camera.json", {})
    assert stale(Project.open(root), run.folder) == []
    board.write_bytes(b"2")
    assert stale(Project.open(root), run.folder) == ["raw/board.png has changed since"]


def test_the_format_of_the_figures_counts_and_no_version_does(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    edit(root, 'effects = ["creep"]', "effects = []")
    newer = {**folder.versions(), "softtwin": "9.9", "pydantic": "9.9"}
    monkeypatch.setattr(folder, "versions", lambda: newer)
    project = Project.open(root)
    assert newest_fit(project).theta == pytest.approx(FIT.theta)
    told = project.other_versions(root / "runs" / "0001-calibrate")
    assert all(part in told for part in ("softtwin ", "pydantic ", "(here 9.9)", "holds"))
    monkeypatch.setitem(record.FORMATS, "calibrate", 3)
    with pytest.raises(ValueError, match=saying("its figures are of format 2, those of now of 3", "twin calibrate")):
        newest_fit(project)


def test_which_run_measured_the_targets_is_no_bit_of_them(root: Path) -> None:
    edit(root, 'effects = ["creep"]', "effects = []")
    with Project.open(root).new_run("calibrate") as run:
        (root / "targets" / "source.json").write_text('{"run": "0007-measure"}')
    assert stale(Project.open(root), run.folder) == []
    assert Project.open(root).done("calibrate") == run.folder


def test_settings_of_another_stage_and_an_older_fit_that_holds_do_not_matter(root: Path) -> None:
    edit(root, 'effects = ["creep"]', "effects = []")
    edit(root, '["creep"]', '["clamp"]')
    assert newest_fit(Project.open(root)).theta == pytest.approx(FIT.theta)
    edit(root, "-58.0", "-57.0", "targets/targets.csv")
    fitted(root, "calibrate", [])
    edit(root, "-57.0", "-58.0", "targets/targets.csv")
    project = Project.open(root)
    assert fresh(project, ("calibrate",), "fit.json") == project.root / "runs" / "0001-calibrate" / "fit.json"
    assert stale_sentences(project, ("calibrate",), "fit.json") == [
        "runs/0002-calibrate is stale: targets/targets.csv has changed since; it is not used"
    ]


def test_what_a_diagnosis_names_is_an_effect(root: Path) -> None:
    project = Project.open(root)
    with project.new_run("diagnose") as run:
        run.write_json("diagnosis.json", {"verdict": "creep", "named": ["; ls"]})
    with pytest.raises(ValueError, match=saying("diagnosis.json", r"named = \['", "ls'")):
        named_effects(project)


def test_nothing_is_added_where_the_diagnosis_names_no_effect(root: Path) -> None:
    project, say = Project.open(root), Lines()
    with pytest.raises(ValueError, match="no diagnosis yet; run twin diagnose, or name the effect"):
        named_effects(project)
    with project.new_run("diagnose") as run:
        run.write_json("diagnosis.json", {"verdict": "adequate", "named": []})
    assert run_add(project, say)["status"] == "skipped"
    assert say == ["The diagnosis names no effect: nothing is added."]
    with project.new_run("diagnose") as run:
        tie = {"verdict": "creep or mullins", "sentence": "These data cannot tell creep from mullins.", "named": ["creep"], "ties": [["creep", "mullins"]]}
        run.write_json("diagnosis.json", tie)
    assert named_effects(project) == []  # of recalibrate and check
    assert run_add(project, say)["status"] == "skipped"
    assert say[1] == "These data cannot tell creep from mullins. Nothing is added: name one, as in `twin add creep`."
    edit(root, 'candidates = ["creep"]', 'candidates = ["clamp"]')
    with pytest.raises(ValueError, match=saying(r"\[diagnose\]", "twin.toml")):
        named_effects(Project.open(root))


def test_an_effect_that_no_verdict_names_starts_from_its_refit(root: Path) -> None:
    project, say = Project.open(root), Lines()
    with project.new_run("diagnose") as run:
        best = {"effect": "creep", "law": "creep:2", "parameters": {"C10": {"value": 0.2}, "creep.g1": {"value": 0.04}}}
        narrow = {"effect": "creep", "law": "creep", "parameters": {"C10": {"value": 0.3}}}
        never = {"effect": "tube", "law": "tube"}
        run.write_json(
            "diagnosis.json",
            {"verdict": "none of these", "named": [], "ranking": [best, narrow, never], "nearest": ["creep"]},
        )
    assert run_add(project, say)["status"] == "skipped"
    assert say == ["The diagnosis names no effect: nothing is added. `twin add creep` adds what comes nearest."]

    def taken(name: str) -> tuple[str, dict[str, float]]:
        (chosen,), start = laws_of(project, name, say)
        return chosen.label, start

    assert taken("creep") == ("creep:2", {"C10": 0.2, "creep.g1": 0.04})
    assert taken("creep:2") == taken("creep")
    assert taken("tube") == ("tube", {})
