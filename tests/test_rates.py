"""How the diagnosis' rates are counted: what is a hit, a tie, a wrong name, and what was too faint."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.diagnosis import bank, collected, gaussianprocess, tally, truthbook
from benchmarks.diagnosis.identify import STAND_INS_OF, UNKNOWN, spread, without_stand_ins
from benchmarks.diagnosis.laterkinds import KINDS_LATER, STAND_INS_LATER
from benchmarks.diagnosis.simplerules import fingerprinted
from benchmarks.diagnosis.trialbench import Spec, left_out, rule, seen_beside

import numpy as np
import pytest

from twin.virtual.hidden import KINDS
from twin.virtual.protocols import PROTOCOLS


def row(verdict: str, *physics: str, z: float = 30.0, protocol: str = "P5", **more: Any) -> tally.Row:
    """A row of a trial: `a or b` names ties, `a + b` several together."""
    told = verdict.split(" or ") if verdict else []
    named = told[0].split(" + ") if told else []
    ties = [told] if told[1:] else []
    return {
        "verdict": verdict or more.pop("said", "none of these"), "named": named, "ties": ties,
        "names": list(dict.fromkeys([*named, *(n for tie in ties for n in tie)])), "physics": list(physics),
        "kinds": list(physics), "hidden": [{"sigmas": z, "beside": z} for _ in physics], "protocol": protocol,
    } | more  # fmt: skip


CAMERA = "an error of the camera"


@pytest.mark.parametrize(
    ("verdict", "physics", "first", "inside", "size", "wrong"),
    [
        ("creep", ("creep",), True, True, 1, False),
        ("creep:2", ("creep",), True, True, 1, False),
        ("tube or creep", ("creep",), False, True, 2, False),
        ("tube", ("creep",), False, False, 1, True),
        ("tube or clamp", ("creep",), False, False, 2, True),
        (f"tube or {CAMERA}", ("creep",), False, False, 2, False),
        (f"tube or {CAMERA}", ("camera_tilt",), False, True, 2, False),
        ("creep + tube", ("creep",), True, True, 2, True),
        ("creep + tube", ("creep", "tube"), True, True, 2, False),
        ("creep", ("creep", "tube"), True, False, 1, False),
        ("creep + clamp", ("creep", "tube"), True, False, 2, True),
        ("creep + clamp or creep + tube", ("creep", "tube"), True, True, 3, False),
        ("", ("creep",), False, False, 0, False),
        ("tube", ("",), False, False, 1, True),
    ],
)
def test_scores(verdict: str, physics: tuple[str, ...], first: bool, inside: bool, size: int, wrong: bool) -> None:
    own = row(verdict, *physics)
    found = (tally.first(own), tally.in_set(own), tally.set_size(own), tally.wrong_alone(own))
    assert found == (first, inside, size, wrong)


def test_a_tie_in_one_ramp_is_no_hit() -> None:
    tied, alone = row("creep or tube", "creep", protocol="P1"), row("creep", "creep", protocol="P1")
    found = tally.group([tied, alone])
    assert (found["top1"], found["first"], found["in_set"], found["tie"]) == (0.5, 1.0, 1.0, 0.5)
    assert tally.group([tied | {"protocol": "P5"}])["top1"] == 1.0


def test_what_is_not_seen_beside_its_partner_is_too_faint() -> None:
    one = row("creep + tube", "creep", "tube")
    hid = row("creep", "creep", "tube")
    hid["hidden"] = [{"sigmas": 30.0, "beside": 30.0}, {"sigmas": 30.0, "beside": 7.5}]
    found = tally.pairs([one, hid])
    assert (found["n"], found["exact"], found["too_faint"]) == (1, 1.0, 1)


def test_conditional_non_centrality() -> None:
    a, b = np.array([10.0, 0.0, 0.0]), np.array([8.0, 6.0, 0.0])
    np.testing.assert_allclose(seen_beside([a, b]), [6.0, 6.0])
    np.testing.assert_allclose(seen_beside([a]), [10.0])
    assert seen_beside([]) == []


def test_unknown_kinds_are_flagged_or_misnamed_or_not_seen() -> None:
    said = ["", f"tube or {CAMERA}", "tube", ""]
    rows = [row(v, "", said=w) for v, w in zip(said, ["none of these", "", "", "none needed"], strict=True)]
    rows = [r | {"kinds": ["leak"]} for r in rows] + [row("", "", kinds=["zoomed"], said="cannot test: the frame moves")]
    found = tally.unknown_table(rows)
    assert (found["n"], found["flagged"], found["misnamed"], found["none_needed"]) == (5, 0.6, 0.2, 1)
    assert found["without_zoomed"]["n"] == 4
    assert found["without_zoomed"]["flagged"] == 0.5
    assert tally.unknowns([row("tube", "", z=5.0)]) | {"by_kind": 0} == tally.unknowns([]) | {"by_kind": 0, "too_faint": 1}


def test_power_goes_by_what_is_reached() -> None:
    found = tally.power([row("creep", "creep", z=37.0, wanted=100.0), row("tube", "creep", z=5.0, wanted=100.0)])
    assert {k: v["first"] for k, v in found.items()} == {"4 to 8": 0.0, "15 to 40": 1.0}


def test_error_over_the_floor() -> None:
    rows = [row("creep", "creep", heldout=0.012, floor=0.01), row("tube", "creep", heldout=1.0, floor=0.01)]
    assert tally.over_floor(rows) == {"n": 1, "median": pytest.approx(1.2)}


def test_the_whole_table_of_no_trials_has_every_key() -> None:
    table = tally.summary([]) | collected.collected(Path("nowhere"))
    wanted = {"fresh", "kinds_after_freeze", "ccx", "left_out", "film", "full_fe", "false_alarm", "heldout_over_floor",
              "coverage", "solves", "cpu_s", "response_pull", "constants", "P5", "pairs", "unknown", "power"}  # fmt: skip
    assert wanted <= set(table)
    assert {"n", "first", "in_set", "set_size", "wrong_alone"} <= set(table["fresh"]["same"])
    assert {"n", "first", "in_set", "set_size", "wrong_alone"} <= set(table["fresh"]["pairs"])
    json.dumps(table)


def test_rows_of_another_rule_do_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(collected, "frozen_by", str)
    kept = collected.Rows("film", tmp_path)
    assert kept.every() == []
    kept.add({"key": "a", "x": 1})
    kept.add({"key": "a", "x": 2})
    assert [(r["x"], r["rule"]) for r in kept.every()] == [(2, rule())]
    kept.file.write_text(kept.file.read_text().replace(rule(), "another"))
    assert not kept.has("a")


def test_trials_without_the_stand_ins_of_a_kind() -> None:
    (spec,) = without_stand_ins([Spec("left out", "P5", ("leak",), 30.0, "white", 1, ("tube",))])
    assert left_out("pressure_by_way", "hysteresis", spec.without)
    assert left_out("anything", "pressure course", spec.without)
    assert not left_out("force_at_35", "outside force", spec.without)
    assert left_out("tube", "", spec.without)
    assert set(UNKNOWN) <= set(STAND_INS_OF)


def test_kinds_written_later_are_none_of_today() -> None:
    assert not set(KINDS_LATER) & set(KINDS)
    assert {n for n, k in KINDS_LATER.items() if k.law == "unknown"} == set(STAND_INS_LATER)


def test_kinds_from_outside_are_hidden_as_those_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    twice = replace(KINDS["pressure_gain"], name="twice")
    protocol, rows, known = PROTOCOLS["P3"], [0, 3], KINDS["pressure_gain"]
    told = truthbook.displaced(protocol, ((twice, 0.1),), rows)
    np.testing.assert_array_equal(told, truthbook.displaced(protocol, ((known, 0.1),), rows))
    solves = truthbook.book()
    kind = replace(KINDS["soft_band"], name="outside", sizes=(1.0,))
    monkeypatch.setattr(truthbook, "book", lambda: solves | {"outside@1": solves["bare"] + 0.5})
    change = truthbook.displaced(protocol, ((kind, 2.0),), rows) - truthbook.displaced(protocol, (), rows)
    np.testing.assert_allclose(change, 1.0)


def test_a_part_of_all_trials_is_a_fair_part() -> None:
    long, short = ([Spec(name, "P5", (), 0.0, "white", k) for k in range(n)] for name, n in (("a", 30), ("b", 10)))
    found = [s.group for s in spread([long, short])]
    assert found.count("b") == 10
    assert found[:20].count("b") == 5


def test_fingerprints_know_no_length() -> None:
    base, bent = np.array([1.0, 2.0, 3.0]), np.array([0.0, 1.0, 0.0])
    assert fingerprinted(2 * base, base, [("bend", bent)]) == ""
    assert fingerprinted(3 * (base + 2 * bent), base, [("bend", bent), ("other", bent[::-1] + [1, 0, 0])]) == "bend"


def test_a_process_learns_what_is_smooth_and_not_what_is_noise() -> None:
    rng, p, place = np.random.default_rng(1), np.linspace(0, 1, 30)[:, None], np.array([[10.0, 0.0], [40.0, 0.0]])
    grid, sd = gaussianprocess.Grid.of(p, place, (0.4, 30.0)), 0.01
    noise = sd * rng.standard_normal((30, 2))
    smooth = 0.1 * np.sin(3 * p) + noise
    assert grid.fitted(noise, 0.1, sd)[0] < gaussianprocess.SAID
    gain, weights = grid.fitted(smooth, 0.1, sd)
    dense = np.kron(gaussianprocess.alike(p, p, 0.4), gaussianprocess.alike(place, place, 30.0))
    covariance = 0.1**2 * dense + sd**2 * np.eye(60)
    y = smooth.ravel()
    direct = y @ y / sd**2 - y @ np.linalg.solve(covariance, y)
    direct += 60 * np.log(sd**2) - np.linalg.slogdet(covariance)[1]
    assert gain == pytest.approx(direct)
    np.testing.assert_allclose(weights.ravel(), np.linalg.solve(covariance, y), rtol=1e-6)


def test_a_truth_by_another_engine_counts_once() -> None:
    rows = [
        row("tube or creep", "creep", key="a", add="added", seconds=60.0),
        row("tube", "creep", key="b", add="twin add: no", seconds=60.0),
        row("", "", key="c", add="", seconds=60.0),
        row("tube", "creep", z=3.0, key="d", add="added", seconds=60.0),
    ]
    found = collected.engine(rows)
    assert (found["n"], found["too_faint"], found["add_refused"]) == (3, 1, ["b"])
    assert (found["in_set"], found["wrong_alone"]) == (pytest.approx(2 / 3), pytest.approx(1 / 3))


def test_whole_solves_and_tables_agree_on_all_names_or_not() -> None:
    from benchmarks.diagnosis.fullruns import agree

    assert agree(row("creep or tube", "creep"), row("tube or creep", "creep"))
    assert not agree(row("creep or tube", "creep"), row("creep", "creep"))
    assert not agree(row("", "", said="none needed"), row("", "", said="none of these"))
    assert agree(row("", "", said="cannot test: the frame"), row("", "", said="cannot test: another"))


def test_a_deck_says_the_weight_first_and_holds_no_node_twice() -> None:
    from benchmarks.diagnosis import ccxbodies as bodies

    case = bodies.bare_test().case.with_material(density=1e-9)
    text = bodies.stepwise(case, np.array([0.0, 0.0, -9810.0]))
    weight, pressed = text.split("*STEP,")[1:]
    assert ("*DLOAD" in weight, "*DSLOAD" in weight) == (True, False)
    assert ("*DLOAD" in pressed, "*DSLOAD" in pressed) == (False, True)
    assert {t.name: t for t in bodies.TRUTHS}.keys() >= {part for a in bodies.BOTH for part in a}
    assert len(bodies.TRUTHS) >= 24
    hinged = bodies.NAMED["clamp_0.0016"].case()
    assert hinged.clamp
    free = bodies.on_a_body(hinged, hinged.clamp)
    assert not set(free.node_sets["symmetry"]) & set(free.node_sets["clamp"])
    assert "CLAMP, 1, 1" not in bodies.stepwise(hinged, np.zeros(3))


def test_a_bank_made_at_other_nodes_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bank, "FILE", tmp_path / "bank.npz")
    np.savez(bank.FILE, course=np.zeros(2), nodes=bank.nodes())
    assert "course" in bank.packed()
    assert bank.complete({"slopes@a": np.zeros((2, 1))}, "slopes@a", 2)
    assert not bank.complete({"slopes@a": np.zeros((2, 1))}, "slopes@a", 3)
    monkeypatch.setattr(bank, "SHARES", bank.SHARES[:-1])
    assert bank.packed() == {}
