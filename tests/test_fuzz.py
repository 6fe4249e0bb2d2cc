"""Damaged files never end in an internal error or a hang: a few of them here, 10,000 in `make test-slow`."""

import time
from pathlib import Path

import pytest

from tests.strangers import fuzz


def test_some_damaged_files() -> None:
    found = fuzz.fuzz(300, first=1)
    assert found.internal == found.hang == []
    assert found.cases >= 300
    assert found.refused > 100  # else the damage does nothing
    assert found.kinds["taken"] > 10  # else it leaves nothing whole


@pytest.mark.slow
def test_many_damaged_files() -> None:
    found = fuzz.fuzz(10_000, first=2)
    assert found.internal == found.hang == []
    assert found.cases >= 10_000


@pytest.mark.parametrize("name", ["targets", "deck", "records", "cameras", "logs", "project", "formats/dice"])
def test_the_corpus_itself_is_taken(name: str) -> None:
    for file in fuzz.READERS[name].files:
        tally = fuzz.Tally()
        fuzz.tried(tally, name, file, (fuzz.CORPORA / name / file).read_bytes())
        assert tally.kinds["taken"] == 1, file


def test_an_internal_error_and_a_hang_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(folder: Path, file: Path) -> None:
        del folder, file
        raise KeyError("noise")

    def endless(folder: Path, file: Path) -> None:
        del folder, file
        time.sleep(5.0)

    def raw(folder: Path, file: Path) -> None:
        del folder, file
        raise ValueError("1 validation error ... https://errors.pydantic.dev")

    monkeypatch.setattr(fuzz, "LIMIT_S", 0.2)
    for read, internal, hang in ((broken, 1, 0), (endless, 0, 1), (raw, 1, 0)):
        monkeypatch.setitem(fuzz.READERS, "logs", fuzz.Reader(("mpa.csv",), read))
        tally = fuzz.Tally()
        fuzz.tried(tally, "logs", "mpa.csv", b"x")
        assert (len(tally.internal), len(tally.hang)) == (internal, hang)
