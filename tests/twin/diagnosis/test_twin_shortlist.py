"""What is refitted: who may be the best to first order, until no other can come within reach."""

import numpy as np

from tests.twin.diagnosis.toy import Toy, smooth_field, targets, toy_effect
from twin.diagnosis.hypotheses import Hypothesis
from twin.diagnosis.shortlist import Task
from twin.targets import Array

BASE, FIELDS = smooth_field(1), {name: smooth_field(10 + k) for k, name in enumerate(("alpha", "beta", "gamma"))}
EFFECTS = tuple(toy_effect(name) for name in FIELDS)


def searched(truth: Array, *, fields: dict[str, Array] | None = None) -> list[Hypothesis]:
    t = targets(1.3 * BASE[0] + truth, seed=0)
    task = Task(Toy({"base": BASE, **FIELDS, **(fields or {})}), EFFECTS, (), t, 0, lambda *a: None)  # type: ignore[arg-type]
    return task.searched(task.base(np.array([1.0])))


def test_who_cannot_come_near_is_not_refitted() -> None:
    rows = searched(0.3 * FIELDS["alpha"][0])
    assert [h.label for h in rows if h.refit is not None] == ["alpha"]
    assert {h.label for h in rows} == {"alpha", "beta", "gamma"}  # all are told


def test_who_comes_near_is_refitted_too() -> None:
    twin = FIELDS["alpha"] + 0.02 * smooth_field(99)
    rows = searched(0.1 * FIELDS["alpha"][0], fields={"beta": twin})
    assert {h.label for h in rows if h.refit is not None} == {"alpha", "beta"}


def test_to_first_order_and_by_a_refit_a_linear_model_has_one_evidence() -> None:
    rows = searched(0.3 * FIELDS["alpha"][0])
    assert rows[0].evidence is not None
    assert abs(rows[0].hint - rows[0].evidence) < 3.0  # law errors cost at most 2 ln 0.4; prior's mean
