"""What counts the reading of files outside a folder sees it where it happens; one place is tried with all stages."""

from pathlib import Path

import pytest

from tests.strangers import received
from twin.project import trust


def test_nothing_is_read_outside(studio_project: Path, tmp_path: Path) -> None:
    assert received.unasked(tmp_path / "keys")[1] == 0
    for name in ("raw/pressure.csv", "raw/lens.yml"):
        assert not received.is_read(studio_project, name, tmp_path)


def test_a_link_that_is_followed_is_seen(studio_project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trust, "links", lambda root, config: [])
    assert received.is_read(studio_project, "raw/pressure.csv", tmp_path, ["check"])
    assert received.unasked(tmp_path / "keys")[1] >= 16


@pytest.mark.slow
@pytest.mark.parametrize("name", received.PLACES)
def test_no_place_is_read_outside(name: str, studio_project: Path, tmp_path: Path) -> None:
    assert not received.is_read(studio_project, name, tmp_path)
