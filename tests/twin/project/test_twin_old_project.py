"""A finished project of a former release (tests/data/old_project, on the raw files of the quick data set) is
opened with other versions of its libraries: nothing is stale, nothing is done again, the camera that its film needs is there."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.messages import saying
from tests.strangers.older import NEWER, opened
from twin.bench.fits import newest_fit, stale
from twin.commands.camera import run_camera
from twin.commands.measure import run_measure
from twin.inputs.cameras import camera_path
from twin.project import record
from twin.project.folder import Project


@pytest.fixture
def old(tmp_path: Path) -> Iterator[Project]:
    with opened(tmp_path) as project:
        yield project


def test_nothing_is_stale_and_nothing_is_done_again(old: Project, say) -> None:
    assert {run.name: stale(old, run) for run in old.runs()} == {
        "0001-camera": [], "0002-measure": [], "0003-calibrate": []
    }  # fmt: skip
    assert camera_path(old) == old.root / "runs" / "0001-camera" / "camera.json"
    assert newest_fit(old).theta.shape == (2,)
    assert run_camera(old, say)["status"] == "skipped"
    assert run_measure(old, say, budget=True)["status"] == "skipped"
    assert len(old.runs()) == 3
    told = " ".join(say.lines)
    assert all(f"(here {version})" in told for version in NEWER.values())
    assert "`twin measure --again` measures anew" in told


def test_the_very_thing_that_has_changed_is_named(old: Project, monkeypatch: pytest.MonkeyPatch, say) -> None:
    board = sorted((old.root / "raw" / "boards").iterdir())[1]
    kept = board.read_bytes()
    board.write_bytes(kept + b" ")
    with pytest.raises(ValueError, match=saying("runs/0001-camera", f"raw/boards/{board.name} has changed", "twin camera")):
        camera_path(old)
    board.write_bytes(kept)
    text = (old.root / "twin.toml").read_text()
    (old.root / "twin.toml").write_text(text.replace("square_mm = 8.0", "square_mm = 8.1"))
    with pytest.raises(ValueError, match=saying("board.square_mm was 8.0 and is 8.1")):
        camera_path(Project.open(old.root))
    (old.root / "twin.toml").write_text(text.replace("steps = 2000", "steps = 1000"))
    with pytest.raises(ValueError, match=saying("0002-measure", "measure", "steps", "--replace")):
        run_measure(Project.open(old.root), say)
    (old.root / "twin.toml").write_text(text)
    monkeypatch.setitem(record.FORMATS, "camera", 2)
    with pytest.raises(ValueError, match=saying("its figures are of format 1, those of now of 2")):
        camera_path(old)
