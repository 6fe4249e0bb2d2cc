"""The committed demo: small enough, complete, and readable (that it runs to its end is `make demo`)."""

import sys
from pathlib import Path

import pytest

from twin import cli
from twin.project.folder import Project

DEMO = Path(__file__).resolve().parents[1] / "datasets" / "demo"
LIMIT_MB = 12.0


@pytest.fixture
def demo() -> Path:
    if not (DEMO / "raw" / "film.mp4").is_file():
        pytest.skip("datasets/demo has no film; python benchmarks/make_demo.py makes it")
    return DEMO


def test_the_demo_is_small(demo: Path) -> None:
    total = sum(p.stat().st_size for p in demo.rglob("*") if p.is_file()) / 1e6
    assert 1.0 < total <= LIMIT_MB  # MB


def test_twin_check_finds_nothing_missing(
    demo: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(p.name for p in demo.rglob("*"))
    monkeypatch.setattr(sys, "argv", ["twin", "check", "-p", str(demo)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    out, err = capsys.readouterr()
    assert (ended.value.code, err) == (0, "")
    assert "Next: `twin camera`." in out
    assert sorted(p.name for p in demo.rglob("*")) == before  # checking writes nothing


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
