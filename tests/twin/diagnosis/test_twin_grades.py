"""How sure a verdict is, and whether a film that no fit has seen is foretold."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from benchmarks import ROOT
from benchmarks.diagnosis.laterkinds import FOLDER, KINDS_LATER, read
from benchmarks.diagnosis.tally import in_nearest, mechanism_right, name_right

import numpy as np
import pytest

from tests.twin.diagnosis.test_twin_verdicts import FIELDS, diagnosed
from tests.twin.diagnosis.toy import STEPS, Toy, smooth_field, targets, toy_effect
from twin.diagnosis import procedure
from twin.diagnosis.diagnosisrecord import DiagnosisRecord, RankingRow
from twin.diagnosis.grades import FORETOLD, PLAIN, RIGHT, Grade, grade_of
from twin.diagnosis.hypotheses import Hypothesis, Score
from twin.effects.library import all_effects
from twin.effects.mechanism import Mechanism
from twin.effects.standins import stand_ins
from twin.experiments.choice import Experiment
from twin.judging.heldout import forecasts
from twin.judging.judged import judge
from twin.targets import Array

BODY = {"wall_taper", "eccentric_core", "eccentric_core_y", "ballooning", "precurvature", "strain_limiting_layer", "hoop_reinforcement"}
CLASSES = {
    Mechanism.HISTORY: {"creep", "mullins", "thermal"},
    Mechanism.LAW: {"stiffening", "compressibility"},
    Mechanism.BODY: BODY,
    Mechanism.LOAD: {"clamp", "gravity", "contact", "tube", "inertia"},
    Mechanism.COURSE: {"pressure_gain", "pressure_offset", "pressure_lag", "time_shift"},
    Mechanism.PICTURE: {"camera_scale", "camera_rotation", "camera_tilt", "camera_breathing", "marker_slip", "marker_standoff"},
}


def test_every_effect_and_stand_in_is_of_one_mechanism() -> None:
    told = {(m, e.name) for e in all_effects() for m in {e.mechanism, (e.wide() or e).mechanism}}
    assert told == {(m, name) for m, names in CLASSES.items() for name in names}
    model: Any = SimpleNamespace(path=SimpleNamespace(time=np.arange(9.0), pressure=np.ones(9), output=np.arange(9.0)))
    model.moving, model.markers = np.ones(2, bool), ("p1", "tip")
    kinds = {(e.kind, e.mechanism) for e in stand_ins(model)}
    assert len({kind for kind, _ in kinds}) == len(kinds)
    assert dict(kinds) == {
        "outside force": Mechanism.LOAD, "friction": Mechanism.LOAD, "twist": Mechanism.LOAD,
        "drift": Mechanism.LOAD, "play": Mechanism.LOAD, "soft spot": Mechanism.BODY, "fold": Mechanism.BODY,
        "pressure course": Mechanism.COURSE, "camera": Mechanism.PICTURE, "slip": Mechanism.PICTURE,
    }  # fmt: skip


def test_a_verdict_is_told_by_name_mechanism_and_how_sure_it_is() -> None:
    found = DiagnosisRecord(verdict="creep", named=("creep",), mechanisms=(Mechanism.HISTORY,), sure="likely: x.", sentence="y.")
    assert found.lines == ("Verdict: creep", "Mechanism: history of the silicone", "How sure: likely: x.", "y.")
    rows = tuple(RankingRow(effect=name, evidence=x) for name, x in (("creep", 90.0), ("tube", 75.0), ("clamp", None)))
    ranked = found.model_copy(update={"ranking": rows})
    assert [ranked.behind(r) for r in rows] == [0.0, 15.0, None]


def best(*, p: float = 0.5, exact: float = 0.5, size: float = 30.0) -> Hypothesis:
    score = Score(evidence=100.0, delta_bic=100.0, size=size, law=0.0, p_value=p, p_exact=exact)
    return Hypothesis(effects=(toy_effect("creep"),), score=score)


@pytest.mark.parametrize(
    ("found", "alone", "films", "grade"),
    [
        (best(), True, [0.5], Grade.NAMED),
        (best(), True, [], Grade.LIKELY),
        (best(size=PLAIN - 1), True, [0.5], Grade.LIKELY),
        (best(), True, [0.5, FORETOLD / 2], Grade.LIKE),
        (best(exact=1e-4), True, [0.5], Grade.LIKE),
        (best(p=1e-9, exact=0.0), True, [0.5], Grade.LIKE),
        (best(), False, [0.5], Grade.LIKE),
    ],
)
def test_a_name_is_as_sure_as_what_confirms_it(found: Hypothesis, alone: bool, films: list[float], grade: Grade) -> None:
    assert grade_of(found, alone=alone, forecasts=films) is grade


def foretold(*, hidden: float, later: float, seed: int) -> float:
    """The probability of the second half of a film by a model with alpha that is fitted to the first: of
    alpha `hidden` mm in both, and of what the model lacks `later` mm in the second half."""
    base, alpha, other = smooth_field(1), smooth_field(10), smooth_field(20)
    half = np.arange(STEPS) >= STEPS // 2
    t = targets(1.3 * base[0] + hidden * alpha[0] + later * half[:, None, None] * other[0], seed=seed)
    t = replace(t, block=half.astype(int), held_out=half, noises=())
    model: Any = Toy({"base": base, "alpha": alpha}, effects=(toy_effect("alpha"),))
    (p,) = forecasts(judge(model, t, starts=np.array([1.0, 0.1])), t).values()
    return p


def test_a_right_model_foretells_a_film_that_it_has_not_seen() -> None:
    found: Array = np.array([foretold(hidden=0.2, later=0.0, seed=seed) for seed in range(40)])
    # of 40 at a level of 1 % at most two by chance (p = 0.007); the probabilities are spread
    assert (found <= FORETOLD).sum() <= 2
    assert 0.2 < np.median(found) <= 1.0


def test_what_appears_later_refutes_it() -> None:
    assert foretold(hidden=0.2, later=0.05, seed=0) < 1e-6


def test_the_next_test_of_a_name_that_is_not_sure_is_the_one_that_would_refute_it_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def tests(members: Any, *others: Any) -> tuple[Experiment, ...]:
        asked.append([m.model.effects[-1].name for m in members])
        return tuple(Experiment(experiment=name, sigmas=s, minutes=5.0) for name, s in (("film A", 6.0), ("film B", 9.0)))

    monkeypatch.setattr(procedure, "next_experiments", tests)
    fields = {"base": smooth_field(1), "alpha": smooth_field(10)}
    fields["near"] = fields["alpha"] + 0.3 * smooth_field(11)
    t = targets(1.3 * fields["base"][0] + 0.2 * fields["alpha"][0], seed=0)
    effects = [toy_effect("alpha"), toy_effect("near")]
    model: Any = Toy(fields)
    found = procedure.diagnose(model, effects, t, seed=0, start=np.array([1.0]), beside=())
    assert (found.verdict, found.grade) == ("alpha", Grade.LIKELY)
    assert asked == [["alpha", "near"]]
    assert [e.experiment for e in found.next_tests] == ["film B", "film A"]
    assert found.next_test.startswith("to confirm or refute alpha, next to it near: film B (5 minutes): 9.0 sigma")


def test_how_often_a_grade_was_right_is_as_the_table_of_trials_has_it() -> None:
    table = json.loads((ROOT / "benchmarks" / "results" / "identify.json").read_text(encoding="utf-8"))
    assert sum(table["commits"].values()) == table["trials"]  # each states the commit of its rule
    assert "" not in table["commits"]
    for grade, rate in RIGHT.items():
        said = table["said"][grade]
        assert {row["n"] for row in said.values()} == {rate.n}
        assert {key: round(row["rate"] * row["n"]) for key, row in said.items()} == {"name": rate.name, "mechanism": rate.mechanism}
    assert RIGHT[Grade.LIKELY].words in diagnosed(0.3 * FIELDS["alpha"][0]).sure


def test_kinds_are_read_from_a_folder(tmp_path: Path) -> None:
    text = (FOLDER / "settling.py").read_text(encoding="utf-8")
    (tmp_path / "sinking.py").write_text(text.replace("settling", "sinking"), encoding="utf-8")
    (file,) = read(tmp_path)
    assert (file.KIND.name, file.KIND.mechanism, file.STAND_INS) == ("sinking", Mechanism.LOAD, ("drift", "play"))
    assert "settling" in KINDS_LATER
    (tmp_path / "other.py").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"other.py: wanted KIND = Kind\(name='other', ...\)"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("physics", "near", "told", "right"),
    [
        (["creep"], ["creep", "tube"], ["history of the silicone"], (True, True, True)),
        (["creep"], ["tube", "creep"], ["load and supports"], (True, False, False)),
        (["creep"], ["creep + tube"], ["history of the silicone"], (True, False, True)),
        ([""], ["creep"], ["history of the silicone"], (False, False, True)),
        ([""], [], [], (False, False, False)),
    ],
)
def test_a_trial_is_right_by_name_or_by_mechanism(
    physics: list[str], near: list[str], told: list[str], right: tuple[bool, bool, bool]
) -> None:
    row = {"physics": physics, "nearest": near, "mechanisms": told, "hidden_mechanisms": ["history of the silicone"]}
    assert (in_nearest(row), name_right(row), mechanism_right(row)) == right
