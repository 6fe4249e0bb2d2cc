"""Damaged files never end in an internal error or a hang: a few of them here, 10,000 in `make test-slow`."""

import importlib
import time
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def strangers() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).resolve().parents[1] / "benchmarks"))
        return importlib.import_module("strangers_fuzz")


def test_some_damaged_files(strangers: ModuleType) -> None:
    found = strangers.fuzz(300, first=1)
    assert found.internal == found.hang == []
    assert found.cases >= 300
    assert found.refused > 100  # else the damage does nothing
    assert found.kinds["taken"] > 10  # else it leaves nothing whole


@pytest.mark.slow
def test_many_damaged_files(strangers: ModuleType) -> None:
    found = strangers.fuzz(10_000, first=2)
    assert found.internal == found.hang == []
    assert found.cases >= 10_000


@pytest.mark.parametrize("name", ["targets", "deck", "records", "cameras", "logs", "project", "formats/dice"])
def test_the_corpus_itself_is_taken(strangers: ModuleType, name: str) -> None:
    for file in strangers.READERS[name].files:
        tally = strangers.Tally()
        strangers.tried(tally, name, file, (strangers.CORPORA / name / file).read_bytes())
        assert tally.kinds["taken"] == 1, file


def test_an_internal_error_and_a_hang_are_seen(strangers: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(folder: Path, file: Path) -> None:
        del folder, file
        raise KeyError("noise")

    def endless(folder: Path, file: Path) -> None:
        del folder, file
        time.sleep(5.0)

    def raw(folder: Path, file: Path) -> None:
        del folder, file
        raise ValueError("1 validation error ... https://errors.pydantic.dev")

    monkeypatch.setattr(strangers, "LIMIT_S", 0.2)
    for read, internal, hang in ((broken, 1, 0), (endless, 0, 1), (raw, 1, 0)):
        monkeypatch.setitem(strangers.READERS, "logs", strangers.Reader(("mpa.csv",), read))
        tally = strangers.Tally()
        strangers.tried(tally, "logs", "mpa.csv", b"x")
        assert (len(tally.internal), len(tally.hang)) == (internal, hang)
