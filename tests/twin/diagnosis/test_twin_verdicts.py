"""What is concluded from all that was tried: every verdict, on models linear in their parameters."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from calibrate import Fit
from tests.messages import says
from tests.twin.diagnosis.toy import STEPS, Toy, pressure, smooth_field, targets, toy_effect
from twin.diagnosis import procedure
from twin.diagnosis.deciding import Diagnosis
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.diagnosis.grades import Grade
from twin.diagnosis.hypotheses import Hypothesis, Refit, Score
from twin.diagnosis.procedure import _astray, diagnose
from twin.diagnosis.wording import unrefitted
from twin.effects.labels import KINDS
from twin.effects.library import all_effects
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Effect, Unsolvable
from twin.files import plain
from twin.judging import judged
from twin.judging.intervals import estimates
from twin.judging.judged import Judged
from twin.targets import Array

NAMES = ("alpha", "beta", "gamma", "delta")
BASE = smooth_field(1)
FIELDS = {name: smooth_field(10 + k) for k, name in enumerate(NAMES)}
EFFECTS = tuple(toy_effect(name) for name in NAMES)


def diagnosed(
    truth: Array, *, seed: int = 0, fields: dict[str, Array] | None = None, effects: Sequence[Effect] = EFFECTS,
    beside: Sequence[Effect] = (),
) -> Diagnosis:
    model = Toy({"base": BASE, **FIELDS, **(fields or {})})
    t = targets(1.3 * BASE[0] + truth, seed=seed)
    return diagnose(model, effects, t, seed=0, start=np.array([1.0]), beside=beside, plan=False)  # type: ignore[arg-type]


def test_nothing_hidden_needs_nothing() -> None:
    found = [diagnosed(np.zeros_like(BASE[0]), seed=seed) for seed in range(20)]
    # each test at a level of 1 %: of 20 at most one by chance
    assert sum(d.verdict == "none needed" for d in found) >= 19
    assert all(d.named == () and d.kept is None for d in found if d.verdict == "none needed")


@pytest.mark.parametrize("name", NAMES)
def test_a_hidden_effect_is_named_alone(name: str) -> None:
    found = diagnosed(0.2 * FIELDS[name][0])
    assert (found.verdict, found.named, found.law, found.ties) == (name, (name,), name, ())
    assert found.kept is not None
    assert found.kept.values[f"{name}.a0"] == pytest.approx(0.2, abs=0.01)  # several sds
    data = plain(DiagnosisRecord.of(found))
    assert data["rms_after_mm"] < 1.1 * data["noise_sd_mm"] < data["rms_before_mm"]
    assert set(data) == set(DiagnosisRecord.model_fields)


@pytest.mark.parametrize(("truth", "times", "refused"), [(1.3, 1.3, True), (1.3, 1.1, False), (1.03, 1.5, False)])
def test_a_base_fit_that_misses_by_more_than_nominal_constants_is_no_model(truth: float, times: float, refused: bool) -> None:
    """The nominal constant is 1. Of the last, the fit misses by 4.4 % of the motion: below 5 % none is refused."""
    model, t = Toy({"base": BASE}), targets(truth * BASE[0], seed=0, sd=1e-6)
    theta = np.array([truth - times * (truth - 1.0)])
    fit = Fit(
        parameters=model.parameters, theta=theta, covariance=np.eye(1), chi2=1.0, degrees_of_freedom=1, seed=0,
        evaluations=1, converged=True, reason="", at_bound=(),
    )  # fmt: skip
    why = _astray(model, t, fit)  # type: ignore[arg-type]
    assert bool(why) is refused
    if refused:
        says(why, f"{times * (truth - 1) * t.rms(BASE[0]):.3g} mm", f"{(truth - 1) * t.rms(BASE[0]):.3g} mm", "--starts 10")
        found = diagnose(model, EFFECTS, t, seed=0, start=fit, beside=(), plan=False)  # type: ignore[arg-type]
        assert found.verdict == f"cannot test: {why}"


def test_a_last_step_that_cannot_be_solved_leaves_the_refit(monkeypatch: pytest.MonkeyPatch) -> None:
    starts: list[Array] = []

    def judge(*args: Any, **options: Any) -> Judged:
        starts.append(options["starts"])
        if len(starts) == 1:
            raise Unsolvable("a wall is too thin there")
        return judged.judge(*args, **options)

    monkeypatch.setattr(procedure, "judge", judge)
    found = diagnosed(0.2 * FIELDS["alpha"][0])
    assert (len(starts), found.verdict) == (2, "alpha")
    assert found.kept is not None
    assert found.kept.fit.theta == pytest.approx(starts[1], abs=0.01)


def test_an_effect_whose_fit_can_be_carried_nowhere_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a real beam with a C01 at the edge of what is stable, the diagnosis ended in an internal error."""

    def judge(*args: Any, **options: Any) -> Judged:
        raise Unsolvable("the model cannot be solved at the start")

    monkeypatch.setattr(procedure, "judge", judge)
    found = diagnosed(0.2 * FIELDS["alpha"][0])
    assert (found.verdict, found.named, found.nearest) == ("none of these", (), ("alpha",))


def test_an_effect_with_which_the_model_misses_more_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a real arm stiffening was named, with which the model missed by 5.7 mm, without it by 2.5."""
    hidden = 0.2 * FIELDS["alpha"][0]
    assert diagnosed(hidden).named == ("alpha",)

    def judge(*args: Any, **options: Any) -> Judged:
        found = judged.judge(*args, **options)
        return replace(found, compared=[replace(found.comparison, raw_rms_mm=1e3)])

    monkeypatch.setattr(procedure, "judge", judge)
    found = diagnosed(hidden)
    assert (found.verdict, found.named, found.nearest) == ("none of these", (), ("alpha",))
    assert "with alpha" not in found.sentence.lower()
    assert found.sure.startswith("like: nothing that was tried fits")


@pytest.mark.parametrize("one_sided", [False, True])
def test_a_verdict_does_not_depend_on_where_null_is(one_sided: bool) -> None:
    zero, other = (
        diagnosed(0.2 * FIELDS["alpha"][0], effects=(toy_effect("alpha", one_sided=one_sided, null=null),))
        for null in (0.0, 3.0)
    )
    assert zero.named == other.named == ("alpha",)
    assert zero.kept is not None
    assert other.kept is not None
    assert zero.kept.values["alpha.a0"] == pytest.approx(0.2, abs=0.01)
    assert other.kept.values["alpha.a0"] == pytest.approx(3.0 + zero.kept.values["alpha.a0"], abs=1e-6)
    assert [h.evidence for h in other.ranking] == pytest.approx([h.evidence for h in zero.ranking], abs=1e-3)
    assert other.ranking[0].hint == pytest.approx(zero.ranking[0].hint, abs=1e-3)


def test_an_effect_that_would_have_to_be_negative_is_not_refitted() -> None:
    found = diagnosed(-0.3 * FIELDS["alpha"][0], effects=(toy_effect("alpha", one_sided=True),))
    assert found.verdict == "none of these"
    assert [c.refit for c in found.ranking] == [None]


def test_the_sizes_told_are_those_of_the_fits_of_all_that_is_tied() -> None:
    def sized(name: str) -> Effect:
        found = toy_effect(name)
        type(found).told = lambda self, values: f"{name} is {values[f'{name}.a0']:.6f} mm"  # type: ignore[method-assign]
        return found

    twin, effects = FIELDS["alpha"] + 0.004 * smooth_field(99), tuple(map(sized, NAMES))
    found = diagnosed(0.1 * FIELDS["alpha"][0], fields={"beta": twin}, effects=effects)
    assert found.kept is not None
    first, second = found.tied
    values = {first.label: found.kept.values, second.label: second.refit.values}  # type: ignore[union-attr]
    says(found.sentence, *(f"{n}: {n} is {v[f'{n}.a0']:.6f} mm" for n, v in values.items()))
    spans = [estimates(fit.fit, fit.comparison)["base.C"] for fit in (found.kept, second.refit)]  # type: ignore[union-attr]
    shared = found.shared["base.C"]
    assert (shared.low, shared.high) == (min(e.low for e in spans), max(e.high for e in spans))
    says(found.sentence, f"Whichever it is, base.C is {shared.low:.4f} to {shared.high:.4f} MPa (95 %)")
    alone = diagnosed(0.3 * FIELDS["alpha"][0], effects=effects)
    assert alone.shared == {}
    assert alone.kept is not None
    says(alone.sentence, f"Alpha is {alone.kept.values['alpha.a0']:.6f} mm.")


def test_two_effects_alike_are_one_answer() -> None:
    twin = FIELDS["alpha"] + 0.004 * smooth_field(99)
    found = diagnosed(0.1 * FIELDS["alpha"][0], fields={"beta": twin})
    assert set(found.ties[0]) == {"alpha", "beta"}
    assert found.verdict == " or ".join(found.ties[0])
    assert found.named[0] in ("alpha", "beta")
    assert {m for c in found.classes if c.effect == "alpha" for m in c.members} == {"beta"}


def test_a_stand_in_that_mimics_is_named_beside() -> None:
    force = toy_effect("pull", kind="outside force")
    twin = FIELDS["alpha"] + 0.004 * smooth_field(99)
    found = diagnosed(0.1 * FIELDS["alpha"][0], fields={"pull": twin}, beside=(force,))
    assert found.named == ("alpha",)
    assert found.verdict == "alpha or an outside force"
    assert "of pull" in found.sentence
    assert found.grade is Grade.LIKE
    assert "cannot tell it from others" in found.sure


def test_what_only_a_stand_in_explains_is_none_of_these_and_told() -> None:
    force, fields = toy_effect("pull", kind="outside force"), {"pull": smooth_field(50)}
    found = diagnosed(0.2 * fields["pull"][0], fields=fields, beside=(force,))
    assert (found.verdict, found.named, found.kept) == ("none of these", (), None)
    assert found.mechanisms == (Mechanism.LOAD,)
    assert "looks like 0.20 of pull" in found.sentence
    assert plain(DiagnosisRecord.of(found))["resembles"][0]["kind"] == "outside force"


def test_the_mechanism_is_that_of_a_stand_in_which_is_ahead_of_every_effect() -> None:
    course, pull = toy_effect("course", kind="pressure course"), smooth_field(50)
    type(course).mechanism = Mechanism.COURSE
    fields = {"course": pull, "alpha": pull + 0.5 * smooth_field(88)}
    found = diagnosed(0.2 * pull[0], fields=fields, beside=(course,))
    assert (found.verdict, found.nearest) == ("none of these", ("alpha",))
    assert (found.tied[0].effect.mechanism, found.mechanisms) == (Mechanism.LOAD, (Mechanism.COURSE,))


@pytest.mark.parametrize(("effect", "stand_in", "told"), [
    ((607.0, 246.0), (598.0, 569.0), Mechanism.COURSE),  # as much by law errors, far more without
    ((9937.0, 8785.0), (9350.0, 9074.0), Mechanism.LOAD),  # far more by law errors, little less without
])  # fmt: skip
def test_the_mechanism_is_of_what_explains_most_by_law_errors_and_without(
    effect: tuple[float, float], stand_in: tuple[float, float], told: Mechanism
) -> None:
    course = toy_effect("course", kind="pressure course")
    type(course).mechanism = Mechanism.COURSE
    near, like = (
        Hypothesis(effects=(e,), score=Score(evidence=ev, delta_bic=ev, size=fall**0.5, law=0.3, p_value=0.0))
        for e, (ev, fall) in ((toy_effect("alpha"), effect), (course, stand_in))
    )
    assert Diagnosis(verdict="none of these", sentence="", tied=(near,), resembles=(like,)).mechanisms == (told,)


def test_what_nothing_explains_is_none_of_these() -> None:
    found = diagnosed(0.2 * smooth_field(77)[0])
    assert (found.verdict, found.named) == ("none of these", ())
    assert (found.grade, len(found.nearest)) == (Grade.LIKE, 1)
    says(found.sentence, f"The nearest effects: {found.nearest[0]} (load and supports) leaves")
    assert "nothing that was tried fits" in found.sure


def test_another_law_of_the_same_physics_is_named_with_how_far_it_is_off() -> None:
    # half as much in one direction, which no size of alpha is
    other = FIELDS["alpha"][0] * (1.0, 1.0, 0.8)
    found = diagnosed(0.3 * other)
    assert (found.verdict, found.named) == ("alpha", ("alpha",))
    assert found.law_left is not None
    assert 0.02 < found.law_left.share < 0.2
    assert f"all but {100 * found.law_left.share:.2g} % of the motion that alpha adds" in found.sentence
    assert found.grade is Grade.LIKE
    assert found.sentence.startswith("Something like alpha is missing (load and supports).")
    assert "its law is another than those tried" in found.sure
    exact = diagnosed(0.3 * FIELDS["alpha"][0])
    assert exact.grade is Grade.LIKELY
    assert exact.sentence.startswith("Probably alpha is missing.")
    says(exact.sure, "no film is held out", "film the finger again with a weight at the tip")
    assert exact.law_left is None
    assert "describes all but" not in exact.sentence


def test_a_family_of_the_same_physics_is_named_by_its_effect() -> None:
    wide = np.concatenate([FIELDS["alpha"], smooth_field(60, 2)])
    truth = 0.3 * wide[0] + 0.08 * wide[1] - 0.06 * wide[2]
    effects = (toy_effect("alpha", wide=3), *EFFECTS[1:])
    found = diagnosed(truth, fields={"alpha": wide}, effects=effects)
    assert (found.verdict, found.named) == ("alpha", ("alpha",))
    # without a declared family the same data are called unknown
    assert diagnosed(truth, fields={"alpha": wide}).verdict == "none of these"


def test_two_effects_together_are_both_named() -> None:
    found = diagnosed(0.2 * FIELDS["alpha"][0] + 0.15 * FIELDS["gamma"][0])
    assert set(found.named) == {"alpha", "gamma"}
    assert found.verdict in ("alpha + gamma", "gamma + alpha")
    assert found.groups[0].score is not None
    assert min(found.groups[0].score.held_out.values()) > 0


def test_a_trace_is_weak_and_not_named() -> None:
    size = 3.9 * 0.01 / np.sqrt((FIELDS["alpha"][0] ** 2).sum())  # some sds of its amplitude
    verdicts = {diagnosed(size * FIELDS["alpha"][0], seed=seed).verdict for seed in range(8)}
    assert verdicts <= {"weak: alpha", "none needed", "alpha"}
    assert "weak: alpha" in verdicts


def test_an_effect_that_the_constants_imitate_is_not_visible() -> None:
    found = diagnosed(np.zeros_like(BASE[0]), fields={"alpha": 0.5 * BASE}, effects=EFFECTS[:1])
    assert found.ranking[0].note.startswith("cannot be seen apart")


@pytest.mark.parametrize(
    ("course", "words"),
    [
        (pressure() / 0.03, "the pressure itself"),
        (np.linspace(0, 1, STEPS), "time, whatever the pressure"),
        (np.linspace(0, 1, STEPS) * pressure() / 0.03, "time and pressure together"),
    ],
)
def test_an_unknown_misfit_is_told_by_what_it_goes_with(course: Array, words: str) -> None:
    hidden = np.zeros_like(BASE[0])
    hidden[:, 1, 2] = 0.3 * (course - course[:5].mean())
    found = diagnosed(hidden, effects=())
    assert found.verdict == "none of these"
    # the constant takes a part of it, which goes another way
    assert words in list(found.scaling)[:2]
    assert words in found.sentence


def test_three_effects_are_found_one_after_the_other() -> None:
    found = diagnosed(sum(x * FIELDS[name][0] for x, name in zip((0.2, 0.15, 0.1), NAMES)))
    assert set(found.named) == set(NAMES[:3])


def test_a_stand_in_that_says_an_own_effect_in_general_is_no_other_explanation() -> None:
    force, twin = toy_effect("pull", kind="outside force"), FIELDS["alpha"] + 0.004 * smooth_field(99)
    cable = toy_effect("alpha")
    type(cable).generic = "outside force"
    found = diagnosed(0.1 * FIELDS["alpha"][0], fields={"pull": twin}, effects=(cable, *EFFECTS[1:]), beside=(force,))
    assert (found.verdict, found.ties) == ("alpha", ())


def test_an_effect_names_kinds_that_exist() -> None:
    for e in all_effects():
        for law in (e, e.wide() or e):
            assert {law.generic} <= {*KINDS, ""}
            assert law.generic == e.generic  # of every law of the same physics
    with pytest.raises(ValueError, match="effect 'rope': 'a force' is no kind of stand-in, wanted one of 'outside force'"):
        type("Rope", (Effect,), {"name": "rope", "generic": "a force"})


def test_where_no_law_is_exact_what_was_not_refitted_is_told() -> None:
    # a nonlinear base: to first order the true effect promises 0.6 of what a wrong law of another explains
    rows = (
        Hypothesis(effects=(EFFECTS[0],), hint=100.0, refit=cast("Refit", object()), score=score(120.0)),
        Hypothesis(effects=(EFFECTS[1],), hint=70.0),
        Hypothesis(effects=(EFFECTS[2],), hint=59.0),
        Hypothesis(effects=(toy_effect("pull", kind="outside force"),), hint=90.0),
    )
    told = unrefitted(Diagnosis(verdict="alpha", sentence="", effects=EFFECTS[:1], ranking=rows))
    assert "explain less of it: beta. One" in told
    assert "in the place of alpha" in told
    assert unrefitted(Diagnosis(verdict="alpha", sentence="", ranking=rows[:1])) == ""


def score(evidence: float) -> Score:
    return Score(evidence=evidence, delta_bic=evidence, size=10.0, law=0.1, p_value=0.5)
