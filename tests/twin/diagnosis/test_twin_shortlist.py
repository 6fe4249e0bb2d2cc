"""What is refitted: who may be the best to first order, until no other can come within reach."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from calibrate import Parameter
from tests.twin.diagnosis.toy import Toy, _wide, smooth_field, targets, toy_effect
from twin.diagnosis import shortlist
from twin.diagnosis.hypotheses import Hypothesis, Refit, Score
from twin.diagnosis.refitting import refitted
from twin.diagnosis.screening import paired
from twin.diagnosis.shortlist import Refits, Task, _better, rivals
from twin.effects.protocol import Effect, Unsolvable
from twin.targets import Array

BASE, FIELDS = smooth_field(1), {name: smooth_field(10 + k) for k, name in enumerate(("alpha", "beta", "gamma"))}
EFFECTS = tuple(toy_effect(name) for name in FIELDS)


def searched(
    truth: Array, *, fields: dict[str, Array] | None = None, more: tuple[Effect, ...] = ()
) -> list[Hypothesis]:
    t = targets(1.3 * BASE[0] + truth, seed=0)
    model = Toy({"base": BASE, **FIELDS, **(fields or {})})
    task = Task(model, (*EFFECTS, *more), (), t, 0, lambda *a: None)  # type: ignore[arg-type]
    return task.searched(task.base(np.array([1.0])))


def test_who_cannot_come_near_is_not_refitted() -> None:
    rows = searched(0.3 * FIELDS["alpha"][0])
    assert [h.label for h in rows if h.refit is not None] == ["alpha"]
    assert {h.label for h in rows} == {"alpha", "beta", "gamma"}  # all are told


@pytest.mark.parametrize(("hidden", "tried"), [("nothing", False), ("alpha", False), ("rough", True)])
def test_what_takes_whole_solves_is_tried_where_nothing_else_fits(hidden: str, tried: bool) -> None:
    rough, field = toy_effect("rough"), smooth_field(40)
    type(rough).smooth = False
    fields = {**FIELDS, "rough": field, "nothing": 0.0 * field}
    rows = searched(0.3 * fields[hidden][0], fields={"rough": field}, more=(rough,))
    (found,) = [h for h in rows if h.label == "rough"]
    assert (found.refit is not None) is tried
    assert (found.note == shortlist.LATE) is not tried


def test_who_comes_near_is_refitted_too() -> None:
    twin = FIELDS["alpha"] + 0.02 * smooth_field(99)
    rows = searched(0.1 * FIELDS["alpha"][0], fields={"beta": twin})
    assert {h.label for h in rows if h.refit is not None} == {"alpha", "beta"}


def test_who_promises_half_as_much_is_refitted_where_no_effect_fits() -> None:
    """beta has 0.64 of what alpha promises, gamma 0.25: one of a bent size may be beta, not gamma."""
    drawn = np.array([BASE, FIELDS["alpha"], *(smooth_field(k) for k in (91, 92, 93))])
    columns, _ = np.linalg.qr(drawn.reshape(len(drawn), -1).T)
    _, alpha, beside, other, rest = columns.T.reshape(drawn.shape) * np.linalg.norm(FIELDS["alpha"])
    fields = {"alpha": alpha, "beta": 0.8 * alpha + 0.6 * beside, "gamma": 0.5 * alpha + 0.87 * other}
    inexact = searched(0.3 * alpha[0] + 0.1 * rest[0], fields=fields)
    assert {h.label for h in inexact if h.refit is not None and len(h.effects) == 1} == {"alpha", "beta"}
    assert not any(h.adequate for h in inexact if len(h.effects) == 1)
    exact = searched(0.3 * alpha[0], fields=fields)
    assert [h.label for h in exact if h.refit is not None] == ["alpha"]


def test_to_first_order_and_by_a_refit_a_linear_model_has_one_evidence() -> None:
    rows = searched(0.3 * FIELDS["alpha"][0])
    assert rows[0].evidence is not None
    assert abs(rows[0].hint - rows[0].evidence) < 3.0  # law errors cost at most 2 ln 0.4; prior's mean


def test_who_promised_as_much_as_the_best_did_is_refitted() -> None:
    """The best may have turned out better than it promised: so may others."""
    score = Score(evidence=338.0, delta_bic=341.0, size=18.0, law=0.0, p_value=1.0)
    best = Hypothesis(effects=EFFECTS[:1], hint=277.0, score=score)
    refits = Refits(None, None, best=best)  # type: ignore[arg-type]
    others = [Hypothesis(effects=EFFECTS[1:2], hint=hint) for hint in (272.0, 240.0, 230.0)]
    near = {h.hint: refits._near(h, shortlist.BENT) for h in others}
    assert near == {272.0: True, 240.0: True, 230.0: False}


def test_each_member_of_the_best_pair_is_tried_with_other_partners() -> None:
    t = targets(1.3 * BASE[0] + 0.3 * FIELDS["alpha"][0] + 0.3 * FIELDS["beta"][0], seed=0)
    task = Task(Toy({"base": BASE, **FIELDS}), EFFECTS, (), t, 0, lambda *a: None)  # type: ignore[arg-type]
    base = task.base(np.array([1.0]))
    refits, start = Refits(task, base), {"base.C": 1.3, **{p.name: 0.1 for e in EFFECTS for p in e.parameters}}
    task.signatures(base, EFFECTS)
    refits.refit(Hypothesis(effects=(EFFECTS[0], EFFECTS[2]), start=start))  # alpha and gamma, which is not there
    rows = {frozenset(h.names): h for h in task._partners(base, refits)}
    assert set(rows) == {frozenset(("alpha", "beta")), frozenset(("gamma", "beta"))}
    pair = rows[frozenset(("alpha", "beta"))]
    refits.refit(pair)
    found = refits.done[-1]
    assert found.evidence is not None
    assert pair.hint > found.evidence - 6.0  # what it may reach is not promised short
    assert refits.best is found


def test_a_pair_begins_in_the_narrowest_laws_of_its_members() -> None:
    """alpha alone ends in its wide law, as beta is missing; beside beta the narrow one fits."""
    alone = Hypothesis(effects=EFFECTS[:1], refit=cast("Refit", object()), start={"base.C": 1.2, "alpha.a0": 0.1})
    refits = Refits(cast("Task", SimpleNamespace(absent=EFFECTS)), None, done=[alone])  # type: ignore[arg-type]
    wide = toy_effect("alpha", wide=2).wide()
    assert wide is not None
    pair = Hypothesis(effects=(wide, EFFECTS[1]), start={"base.C": 1.3, "alpha.a0": 0.7, "alpha.a1": 0.8, "beta.a0": 0.2})
    tried: list[Hypothesis] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Refits, "refit", lambda self, h: tried.append(h) or h)
        refits._together(pair)
    narrow, second = tried
    assert (narrow.label, second) == ("alpha + beta", pair)
    assert narrow.start == {"base.C": 1.3, "alpha.a0": 0.1, "beta.a0": 0.2}


@dataclass(frozen=True)
class Bent(Toy):
    """A toy whose effects add less and less: the first step from far off is many times too long."""

    def predict(self, theta: Array) -> Array:
        rows = self.straight()
        return np.tensordot(np.concatenate([theta[:1], 1 - np.exp(-8 * theta[1:])]), rows, 1)

    def jacobian(self, theta: Array) -> Array:
        slope = np.concatenate([[1.0], 8 * np.exp(-8 * theta[1:])])
        return slope[:, None, None, None] * self.straight()

    def straight(self) -> Array:
        return Toy.jacobian(self, np.zeros(0))


def test_a_refit_whose_steps_are_too_long_tries_shorter_ones() -> None:
    t = targets(1.3 * BASE[0] + 0.6 * FIELDS["alpha"][0], seed=0)
    model = Bent({"base": BASE, **FIELDS})
    task = Task(model, EFFECTS, (), t, 0, lambda *a: None)  # type: ignore[arg-type]
    base = task.base(np.array([1.0]))
    (name,) = (p.name for p in EFFECTS[0].parameters)
    far = Hypothesis(effects=EFFECTS[:1], start={"base.C": 1.3, name: 0.6}, hint=1000.0)
    found, _ = refitted(far, base, t, seed=0)
    assert found.refit is not None
    assert abs(found.refit.values[name] + np.log(0.4) / 8) < 0.02


class Stopped(Toy):
    """A toy that has no equilibrium beyond a tenth of what its derivatives promise of an effect."""

    def predict(self, theta: Array) -> Array:
        if np.abs(theta[1:]).max(initial=0.0) > 0.06:
            raise Unsolvable("limit point", reached=0.0)
        return super().predict(theta)


def test_what_a_refit_s_next_step_promises_and_no_solve_gives_is_no_evidence() -> None:
    t = targets(1.3 * BASE[0] + 0.6 * FIELDS["alpha"][0], seed=0)
    (name,) = (p.name for p in EFFECTS[0].parameters)

    def found(model: Toy) -> Hypothesis:
        task = Task(model, EFFECTS, (), t, 0, lambda *a: None)  # type: ignore[arg-type]
        start = {"base.C": 1.3, name: 0.05}
        h = Hypothesis(effects=EFFECTS[:1], start=start, hint=1000.0)
        return refitted(h, task.base(np.array([1.0])), t, seed=0)[0]

    whole, stopped = found(Toy({"base": BASE, **FIELDS})), found(Stopped({"base": BASE, **FIELDS}))
    assert whole.adequate
    assert not stopped.adequate
    assert whole.score is not None
    assert stopped.score is not None
    assert stopped.score.size < 0.5 * whole.score.size  # of the fall without law errors: 0.19 of it are solved
    assert stopped.start[name] <= 0.06  # it goes on from where it was solved


def pairs_refitted(truth: Array, fields: dict[str, Array]) -> list[str]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Task, "_partners", lambda *_: [])  # which try what the best pair's members do with others
        rows = searched(FIELDS["alpha"][0] + truth, fields=fields)
    return [h.label for h in rows if h.refit is not None and len(h.effects) == 2]


def test_of_pairs_that_would_not_be_named_the_best_alone_is_refitted() -> None:
    """A second effect takes up a part of what is left, leads by less than SHARE of the evidence and leaves the
    rest; one that takes up all of it is refitted. The best of those that do not may bend into the right one."""
    other = smooth_field(77)
    half, best = other + 1.2 * smooth_field(78), other + 2.0 * smooth_field(79)
    assert pairs_refitted(0.1 * other[0], {"gamma": half, "beta": best}) == ["alpha + beta"]
    assert pairs_refitted(0.1 * other[0], {"gamma": other, "beta": best}) == ["alpha + gamma"]
    gamma, held = type(EFFECTS[2]), _wide("gamma", 1)  # fitted under a label that says where it shows most
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gamma, "at", lambda self, entry, test: held if self.label == "gamma" else self, raising=False)
        assert pairs_refitted(0.1 * other[0], {"gamma": half, "beta": best}) == ["alpha + beta"]


def test_a_pair_is_tried_that_promises_more_than_the_best_single_one_did() -> None:
    """The best may have turned out better than it promised, or be a stand-in: then the best effect has partners."""
    t = targets(1.3 * BASE[0] + 0.3 * FIELDS["alpha"][0] + 0.3 * FIELDS["beta"][0], seed=0)
    task = Task(Toy({"base": BASE, **FIELDS}), EFFECTS, (), t, 0, lambda *a: None)  # type: ignore[arg-type]
    base = task.base(np.array([1.0]))
    task.signatures(base, EFFECTS)
    better = replace(scored("gamma", 1e9), hint=10.0)
    assert ("alpha", "beta") in [h.names for h in task._several(base, Refits(task, base, best=better))]
    refits = Refits(task, base)
    alpha = refits.refit(Hypothesis(effects=EFFECTS[:1], start={"base.C": 1.3, "alpha.a0": 0.3}))
    stand_in = Hypothesis(effects=(toy_effect("push", kind="outside force"),), hint=1e9, score=better.score)
    refits.best = stand_in
    pairs = {h.names: h.hint for h in task._several(base, refits)}
    assert alpha.evidence is not None
    assert pairs["alpha", "beta"] > alpha.evidence + shortlist.PAIRED


class Late(Effect):
    """Something that is there from a time on, looked for every 8 s, then every second."""

    name, sentence = "late", "late is there"

    def __init__(self, times: tuple[float, ...] = (0.0, 8.0, 16.0, 24.0), *, fixed: bool = False) -> None:
        self.times, self.fixed = times, fixed
        amplitude = toy_effect("late").parameters
        self.parameters = amplitude if fixed else (*amplitude, Parameter("late.time", 0.0, 30.0, "s", typical=1.0))

    @property
    def label(self) -> str:
        return f"late:{self.times[0]:g}s" if self.fixed else "late"

    def tries(self, test: object) -> tuple[dict[str, float], ...]:
        return ({},) if self.fixed else tuple({"late.time": t} for t in self.times)

    def at(self, entry: Mapping[str, float], test: object) -> Effect:
        return self if self.fixed else Late((entry["late.time"],), fixed=True)

    def closer(self, entry: Mapping[str, float], test: object) -> Effect | None:
        return None if self.fixed else Late(tuple(entry["late.time"] + np.arange(-7.0, 8.0)))


@dataclass(frozen=True)
class Timed(Toy):
    """A toy that has `late`."""

    def jacobian(self, theta: Array) -> Array:
        del theta
        own = [self.from_on(e.times[0]) if isinstance(e, Late) else self.fields[e.name] for e in self.effects]
        return np.concatenate([self.fields["base"], *own])

    def tangents(self, theta: Array, effects: Sequence[Effect]) -> dict[str, list[Array]]:
        found = super().tangents(theta, [e for e in effects if not isinstance(e, Late)])
        return found | {e.label: [self.from_on(t) for t in e.times] for e in effects if isinstance(e, Late)}

    def from_on(self, time: float) -> Array:
        there = np.arange(len(BASE[0])) * 0.25 > time
        out = np.zeros_like(BASE)
        out[:, there, 1, 0] = 1.0
        return out


@pytest.mark.parametrize(("alpha", "late"), [(0.3, 1.0), (0.3, 0.06), (0.02, 1.0)])
def test_what_is_looked_for_on_a_grid_is_found_as_closely_beside_another_effect(alpha: float, late: float) -> None:
    """Whether the pair is proposed to first order, or beside the refit of the one or of the other."""
    model = Timed({"base": BASE, **FIELDS, "late": BASE})
    t = targets(1.3 * BASE[0] + alpha * FIELDS["alpha"][0] + late * model.from_on(12.3)[0], seed=0)
    task = Task(model, (*EFFECTS, Late()), (), t, 0, lambda *a: None)  # type: ignore[arg-type]
    base = task.base(np.array([1.0]))
    pair = paired(base, task.signatures(base, (*EFFECTS, Late())))[0]
    assert {e.label for e in pair.effects} == {"alpha", "late:12s"}
    rows = task.searched(base)
    best = max((h for h in rows if h.evidence is not None), key=lambda h: h.evidence or 0.0)
    assert {e.label for e in best.effects} == {"alpha", "late:12s"}


def test_of_two_laws_of_one_effect_the_one_that_fits_leads_on() -> None:
    def law(p_value: float, evidence: float) -> Hypothesis:
        score = Score(evidence=evidence, delta_bic=evidence, size=18.0, law=0.0, p_value=p_value)
        return Hypothesis(effects=EFFECTS[:1], refit=cast("Refit", SimpleNamespace(at_bound=(), values={})), score=score)

    fits, misses = law(0.1, 300.0), law(1e-9, 320.0)
    assert _better(fits, misses)
    assert not _better(misses, fits)
    assert _better(law(0.1, 310.0), fits)


def scored(name: str, evidence: float, *, near: bool = True) -> Hypothesis:
    score = Score(evidence=evidence, delta_bic=evidence, size=9.0, law=0.0, p_value=0.5, near=near)
    return Hypothesis(effects=(toy_effect(name),), score=score)


def test_what_the_response_cannot_tell_from_another_physics_is_refitted_by_whole_solves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    best, other, far = scored("alpha", 4000.0), scored("beta", 3970.0), scored("gamma", 3900.0)
    assert rivals([far, other, best]) == [best, other]
    assert rivals([best, scored("beta", 3970.0, near=False)]) == [best]
    assert rivals([best, scored("alpha", 3970.0), far]) == [best]  # of one physics
    assert rivals([scored("alpha", 4000.0, near=False), scored("alpha", 3970.0), far]) == []
    assert rivals([]) == []
    exact: list[str] = []

    def counted(h: Hypothesis, *rest: Any, **how: Any) -> Any:
        exact.extend([h.label] * how.get("exact", False))
        return refitted(h, *rest, **how)

    monkeypatch.setattr(shortlist, "refitted", counted)
    monkeypatch.setattr(shortlist, "rivals", lambda rows: rows[: 1 - len(exact)])
    rows = searched(0.3 * FIELDS["alpha"][0])
    assert exact == ["alpha"]
    assert [h.label for h in rows if h.refit is not None] == ["alpha"]
