"""The one decision, on hypotheses with stated scores."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from tests.twin.diagnosis.toy import toy_effect
from twin.diagnosis.deciding import SECOND, TIE, Decision, decided, reliable
from twin.diagnosis.hypotheses import Hypothesis, Score

WRONG: Any = SimpleNamespace(comparison=SimpleNamespace(adequate=False))
RIGHT: Any = SimpleNamespace(comparison=SimpleNamespace(adequate=True))


def row(
    *names: str, evidence: float, bic: float | None = None, p: float = 0.5, kind: str = "", law: str = "",
    generic: str = "", held_out: float = 5.0, chance: float = 1e-9, size: float = 30.0,
) -> Hypothesis:
    effects = tuple(toy_effect(name, kind=kind) for name in names)
    for e in effects:
        type(e).generic = generic
        if law:
            type(e).label = property(lambda self: f"{self.name}:{law}")  # type: ignore[assignment]
    gains = dict.fromkeys(names, held_out) if names[1:] else {}
    score = Score(
        evidence=evidence, delta_bic=evidence if bic is None else bic, size=size, law=0.0, p_value=p, held_out=gains
    )
    return Hypothesis(effects=effects, score=score, p_value=chance, hint=evidence)


def named(*rows: Hypothesis, base: Any = WRONG) -> list[str]:
    return [h.physics for h in decided(base, rows).named]


def test_the_best_is_named_alone_where_all_others_are_behind_on_both_scales() -> None:
    best = row("creep", evidence=100.0)
    assert named(best, row("tube", evidence=100 - TIE - 0.1)) == ["creep"]
    for evidence, bic in ((100 - TIE + 0.1, 0.0), (0.1, 100 - TIE + 0.1), (0.1, 200.0)):
        assert named(best, row("tube", evidence=evidence, bic=bic)) == ["creep", "tube"]


def test_a_tied_name_need_not_be_adequate_but_one_must() -> None:
    rows = [row("creep", evidence=100.0, p=1e-9), row("tube", evidence=98.0, p=0.3)]
    assert not decided(WRONG, rows).unknown
    assert [h.physics for h in decided(WRONG, rows).named] == ["tube", "creep"]
    alone = [rows[0], replace(rows[1], score=replace(rows[1].score, p_value=1e-9))]  # type: ignore[type-var]
    assert decided(WRONG, alone).unknown


def fitted(h: Hypothesis, *, at: float, bound: bool = False, numbers: int = 1) -> Hypothesis:
    """The hypothesis with a refit at a value of each of its numbers; they are plausible from -1 to 1."""
    effects = tuple(toy_effect(e.name, amplitudes=numbers) for e in h.effects)
    names = [p.name for e in effects for p in e.parameters]
    refit: Any = SimpleNamespace(values=dict.fromkeys(names, at), at_bound=tuple(names) if bound else ())
    return replace(h, effects=effects, refit=refit)


def test_of_what_cannot_be_told_apart_the_likeliest_comes_first() -> None:
    rows = [
        fitted(row("inexact", evidence=100.0, p=1e-9), at=0.5),
        fitted(row("stretched", evidence=99.9), at=1.0, bound=True),
        fitted(row("implausible", evidence=99.0), at=2.0),
        fitted(row("richer", evidence=98.0), at=0.5, numbers=3),
        fitted(row("simple", evidence=96.0), at=0.5),
        fitted(row("behind", evidence=80.0), at=0.5),
    ]
    assert named(*rows) == ["simple", "richer", "implausible", "inexact", "stretched"]


def test_a_stand_in_of_another_kind_vetoes_on_both_scales_and_is_tied_on_one() -> None:
    best = row("creep", evidence=100.0)
    far = row("force", evidence=107.0, kind="outside force")
    assert decided(WRONG, [best, far]).unknown
    near = row("force", evidence=107.0, bic=99.0, kind="outside force")
    found = decided(WRONG, [best, near])
    assert not found.unknown
    assert [h.kind for h in found.named] == ["", "outside force"]
    doubtful = row("force", evidence=99.0, kind="outside force", p=1e-9)  # it fits nothing: no explanation
    assert [h.kind for h in decided(WRONG, [best, doubtful]).named] == [""]


def test_a_stand_in_of_its_own_kind_says_the_same_in_general() -> None:
    tube = row("tube", evidence=100.0, generic="outside force")
    assert decided(WRONG, [tube, row("force", evidence=200.0, kind="outside force")]).named == (tube,)
    both = row("tube", "creep", evidence=200.0, generic="outside force")
    assert not decided(WRONG, [tube, both, row("force", evidence=300.0, kind="outside force")]).unknown


def test_an_adequate_law_stands_for_its_physics_with_the_best_evidence_of_it() -> None:
    laws = [row("creep", evidence=100.0, p=1e-9, law="wide"), row("creep", evidence=80.0, law="2")]
    rival = row("tube", evidence=90.0)
    found = decided(WRONG, [*laws, rival])
    assert [h.label for h in found.named] == ["creep:2"]
    assert not found.unknown


@pytest.mark.parametrize(
    ("lead", "bic", "held_out", "together"),
    [(SECOND + 1, SECOND + 1, 5.0, True), (SECOND - 1, 99.0, 5.0, False), (99.0, SECOND - 1, 5.0, False), (99.0, 99.0, 0.0, False)],
)
def test_several_are_named_far_ahead_on_both_scales_if_each_foretells(
    lead: float, bic: float, held_out: float, together: bool
) -> None:
    single = row("creep", evidence=100.0)
    both = row("creep", "tube", evidence=100 + lead, bic=100 + bic, held_out=held_out)
    assert named(single, both) == (["creep + tube"] if together else ["creep"])


@pytest.mark.parametrize(("lead", "exact", "together"), [(200.0, 0.0, False), (200.0, 0.5, True), (1501.0, 0.0, True)])
def test_several_whose_laws_err_must_lead_by_a_share_of_the_best_single_one(lead: float, exact: float, together: bool) -> None:
    """What a law leaves grows with its effect, and a second one takes it up."""
    both = row("creep", "tube", evidence=10_000 + lead)
    both = replace(both, score=replace(both.score, p_exact=exact))  # type: ignore[type-var]
    assert named(row("creep", evidence=10_000.0), both) == (["creep + tube"] if together else ["creep"])


def test_a_member_that_another_does_as_well_is_tied() -> None:
    pairs = [row("creep", name, evidence=200.0 - k) for k, name in enumerate(("gravity", "tube"))]
    assert named(row("creep", evidence=100.0), *pairs) == ["creep + gravity", "creep + tube"]


def test_where_the_model_agrees_only_what_was_detected_counts() -> None:
    chance = row("creep", evidence=20.0, chance=0.02)
    assert decided(RIGHT, [chance]) == Decision(needed=False, least=reliable(1))
    found = decided(RIGHT, [replace(chance, p_value=0.001)])
    assert found.needed
    assert not found.weak


@pytest.mark.parametrize(("size", "evidence", "weak"), [(30.0, 20.0, False), (1.0, 20.0, True), (30.0, 5.0, True)])
def test_too_small_a_trace_is_weak(size: float, evidence: float, weak: bool) -> None:
    assert decided(WRONG, [row("creep", evidence=evidence, size=size)]).weak is weak


def test_without_any_effect_nothing_of_the_library_explains_it() -> None:
    assert decided(WRONG, [row("force", evidence=50.0, kind="outside force")]).unknown
    assert not decided(RIGHT, []).needed
