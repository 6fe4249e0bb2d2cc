"""Trials of the published tables, run again: the verdicts are those of today's code."""

import json
from typing import Any

from benchmarks import ROOT
from benchmarks.diagnosis.tally import VERDICT, covered_by, sample, strangers
from benchmarks.diagnosis.trialbench import Spec, attempted
from benchmarks.docs import rates

import pytest

RESULTS = ROOT / "benchmarks" / "results"
Row = dict[str, Any]


def sampled() -> list[Row]:
    """The trials of the table that say what their verdict was, and the commit of the rule that said it."""
    rows: list[Row] = json.loads((RESULTS / "identify.json").read_text(encoding="utf-8"))["sample"]
    return rows


def differing(rows: list[Row]) -> list[str]:
    """Of trials that are run again, those whose verdicts differ, in words."""
    out = []
    for row in rows:
        found = attempted(Spec.of_key(row["key"], row["without"]))
        out += [
            f"{row['key']}: {name} {row[name]!r} at commit {row['commit']}, {found.get(name)!r} today"
            for name in VERDICT if found.get(name) != row[name]
        ]  # fmt: skip
    return out


def test_trials_of_the_tables_have_today_the_verdict_that_is_published() -> None:
    rows = sampled()
    assert len(rows) > 2
    assert differing(rows[:: len(rows) // 2]) == []


def test_docs_tell_the_rates_of_the_table() -> None:
    table = json.loads((RESULTS / "identify.json").read_text(encoding="utf-8"))
    assert rates.differing(table) == []
    table["strangers"]["known"]["named"] += 0.5
    assert len(rates.differing(table)) == 1
    with pytest.raises(ValueError, match=r"README.md has no sentence 'How sure"):
        rates.renewed("nothing", next(t for t in rates.TOLD if t.file == "README.md"), table)


@pytest.mark.slow
def test_forty_trials_of_the_tables_have_today_the_verdict_that_is_published() -> None:
    rows = sampled()
    assert differing(rows[:: max(len(rows) // 40, 1)][:40]) == []


def test_a_verdict_that_differs_is_told_with_the_commit_of_its_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "attempted", lambda spec: trial(key=spec.key, verdict="magic"))
    (told,) = differing([trial()])
    assert told == "later/P5/creep/10/white/1: verdict 'creep' at commit 1234abcd, 'magic' today"


def test_a_trial_is_rebuilt_from_its_key() -> None:
    for spec in (
        Spec("later", "P5", ("rubbing",), 30.0, "white", 1050004, ("friction",)), Spec("white", "P5", (), 0.0, "white", 3),
        Spec("pairs", "P3", ("creep", "tube"), 100.0, "ar1", 7),
    ):  # fmt: skip
        assert Spec.of_key(spec.key, spec.without) == spec


def trial(**others: Any) -> Row:
    """A clear trial of creep, which was found."""
    return {
        "key": "later/P5/creep/10/white/1", "without": [], "group": "later", "physics": ["creep"], "names": ["creep"],
        "hidden": [{"sigmas": 30.0}], "verdict": "creep", "named": ["creep"], "ties": [], "nearest": ["creep"],
        "grade": "named", "commit": "1234abcd", "mechanisms": ["history of the silicone"], "hidden_mechanisms": ["history of the silicone"],
        "adequate": True, "inside": {"sum": True, "share": False, "size": True},
    } | others  # fmt: skip


def test_a_table_has_the_shares_of_strangers_kinds_and_of_intervals() -> None:
    wrong = trial(names=["tube"], named=["tube"], nearest=["tube"], grade="likely")
    lost = trial(physics=[""], grade="likely", mechanisms=["load and supports"], nearest=["tube"])
    faint = trial(hidden=[{"sigmas": 3.0}], nearest=[])
    found = strangers([trial(), wrong, lost, faint])
    known, unknown = found["known"], found["unknown"]
    assert (known["n"], known["in_nearest"], known["wrong_alone"], known["named"]) == (2, 0.5, 0.5, 0.5)
    assert (unknown["n"], unknown["named"], unknown["likely"], unknown["mechanism"]) == (1, 0.0, 1.0, 0.0)
    inside = covered_by([trial(), trial(inside={"sum": False}), faint])
    assert (inside["sum"], inside["share"], inside["size"]) == (0.5, 0.0, 1.0)
    assert inside["n"] == {"sum": 2, "share": 1, "size": 1}


def test_the_sample_of_a_table_is_spread_evenly_over_its_trials() -> None:
    rows = [trial(key=f"later/P5/creep/10/white/{k}") for k in range(9)] + [trial(failed=True)]
    assert [row["key"][-1] for row in sample(rows, 3)] == ["0", "4", "8"]
    assert set(sample(rows, 1)[0]) == {"key", "without", "commit", *VERDICT}
