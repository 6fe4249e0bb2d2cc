"""What is tried, in order: what is kept on the way belongs to the model that it was made for."""

from dataclasses import replace

import numpy as np

from tests.twin.diagnosis.toy import Toy, smooth_field, targets, toy_effect
from twin.diagnosis.searchorder import Search
from twin.judging.judged import judge

BASE, FIELDS = smooth_field(1), {name: smooth_field(10 + k) for k, name in enumerate(("alpha", "beta"))}


def test_signatures_are_those_of_the_model_that_is_asked() -> None:
    effects, t = tuple(toy_effect(name) for name in FIELDS), targets(1.3 * BASE[0], seed=0)
    base = Toy({"base": BASE, **FIELDS})
    task = Search(base, effects, (), t, 0, 1, lambda stage, done, total: None)  # type: ignore[arg-type]
    fits = [judge(base.with_effect(e), t, starts=np.array([1.0, 0.1])) for e in effects]  # type: ignore[arg-type]
    for k in range(40):  # each record dies as soon as it was asked for: the next may take its address
        record = replace(fits[k % 2])
        assert list(task.signatures_at(record)) == [effects[1 - k % 2].label], k
        del record


def test_signatures_of_one_fit_are_made_once() -> None:
    effects, t = tuple(toy_effect(name) for name in FIELDS), targets(1.3 * BASE[0], seed=0)
    task = Search(Toy({"base": BASE, **FIELDS}), effects, (), t, 0, 1, lambda *a: None)  # type: ignore[arg-type]
    first, again = (task.base(np.array([1.0])) for _ in range(2))
    assert task.signatures_at(first) is task.signatures_at(again)
