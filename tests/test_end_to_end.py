"""The committed demos: small enough, complete, and readable (that they run to their ends is `.ci/run`)."""

import shutil
import sys
from pathlib import Path

from benchmarks.batches.review import overlay_px  # the figure of docs/records
from benchmarks.films.demochecks import hidden, wrong

import pytest

from twin import cli
from twin.chain import stage_of
from twin.console import Console
from twin.effects.library import all_effects
from twin.project.folder import Project

DEMO = Path(__file__).resolve().parents[1] / "datasets" / "demo"
LIMIT_MB = 12.0


@pytest.fixture
def demo() -> Path:
    if not (DEMO / "raw" / "film.mp4").is_file():
        pytest.skip("datasets/demo has no film; python benchmarks/films/make_demo.py makes it")
    return DEMO


def test_the_quick_demo_is_small_and_complete() -> None:
    quick = DEMO.with_name("quick")
    assert sum(p.stat().st_size for p in quick.rglob("*") if p.is_file()) <= 2e6
    config = Project.open(quick).config
    (camera,) = config.cameras
    assert (quick / camera.film).is_file()
    assert config.diagnose.candidates == ()  # the whole library
    assert config.model.effects == ()  # nothing is given away
    assert hidden("quick") in {e.name for e in all_effects()}


def test_the_demo_is_small(demo: Path) -> None:
    total = sum(p.stat().st_size for p in demo.rglob("*") if p.is_file()) / 1e6
    assert 1.0 < total <= LIMIT_MB  # MB


def test_twin_check_finds_nothing_missing(
    demo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = Path(shutil.copytree(demo, tmp_path / "demo"))
    before = sorted(p.name for p in copy.rglob("*"))
    monkeypatch.setattr(sys, "argv", ["twin", "check", "-p", str(copy)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    out, err = capsys.readouterr()
    assert (ended.value.code, err) == (0, "")
    assert "Next: `twin camera`." in out
    assert "every marker circled, 21 of 21 found" in out
    # checking writes its picture and nothing else
    assert sorted(p.name for p in copy.rglob("*")) == sorted([*before, "check.png"])


@pytest.mark.slow
def test_the_model_is_drawn_where_the_film_shows_the_finger(demo: Path, tmp_path: Path) -> None:
    """After calibration and with creep; the genetic algorithm is short, the least squares are the demo's."""
    shutil.copytree(demo, tmp_path / "demo")
    text = (tmp_path / "demo" / "twin.toml").read_text(encoding="utf-8")
    text = text.replace("population = 30", "population = 8").replace("generations = 20", "generations = 3")
    (tmp_path / "demo" / "twin.toml").write_text(text, encoding="utf-8")
    say = Console(as_json=False)
    for stage, options in (("camera", {}), ("measure", {}), ("calibrate", {}), ("add", {"name": "creep"})):
        stage_of(stage).run(Project.open(tmp_path / "demo"), say, **options)
    off = overlay_px(tmp_path / "demo")
    # 2 px are 0.3 mm, as exactly as the tags are placed
    assert off["marker_rms_px"] < off["marker_95_px"] < 2.0
    assert off["edge_rms_px"] < off["edge_95_px"] < 2.0
    assert off["edge_places"] > 5000


def test_the_demo_states_what_it_films(demo: Path) -> None:
    config = Project.open(demo).config
    (camera,) = config.cameras
    assert camera.static
    assert config.frame is not None
    roles = [m.role for m in config.frame.markers]
    assert roles.count("frame") >= 6
    assert roles.count("fixed") >= 4
    nodes = {p.name: p.node for p in config.points}
    assert {nodes["tip"], nodes["middle"]} == {4401, 5848}
    assert len(nodes) >= 7
    assert config.model.effects == ()  # nothing is given away


def test_what_is_wrong_with_a_demo_is_said() -> None:
    good = {"named": ["wall_taper"], "verdict": "wall_taper", "rms_before_mm": 0.06, "rms_after_mm": 0.02,
            "noise_sd_mm": 0.019}  # fmt: skip
    assert wrong(good, "quick") == []
    assert wrong({**good, "rms_after_mm": 0.03}, "quick") == ["rms_after_mm is above 1.1 noise sds"]
    nothing = {"named": [], "verdict": "none needed", "rms_before_mm": 0.02, "rms_after_mm": None, "noise_sd_mm": None}
    assert len(wrong(nothing, "quick")) == 4
