"""Parts of the targets against each other: names, the test for a conflict, and a real model's front."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibrate.genetic import Front
from fe import Case
from tests.messages import saying
from twin.calibrated import tradeoff
from twin.calibrated.tradeoff import Part, SolvedFit, TradeOff, anew, front_of, masks_of
from twin.commands.pareto import told
from twin.judging.fitting import ModelErrors
from twin.model.keptmodel import KeptModel, base_model
from twin.targets import Array, Targets


def test_parts_have_the_names_of_points_components_and_films(make_targets: Callable[..., Targets]) -> None:
    targets = make_targets(block=np.array([0, 0, 0, 0, 1, 1, 1, 1]))
    found = masks_of("tip, U3,tip.U1,upright", targets, {0: "upright"})
    assert list(found) == ["tip", "U3", "tip.U1", "upright"]
    wanted = np.zeros((8, 3, 3), bool)
    wanted[:, 0, 0] = True
    np.testing.assert_array_equal(found["tip.U1"], wanted)
    assert (found["tip"].sum(), found["U3"].sum(), found["upright"].sum()) == (8 * 3, 8 * 3, 4 * 9)
    assert "film2" in masks_of("film2,upright", targets, {0: "upright"})  # one without a name
    for text, why in (
        ("tip", "wanted 2 to 4 different ones"), ("tip,tip", "wanted 2 to 4"), ("tip,U4", r"nothing .* 'U4'; wanted some of .*U1"),
        ("tip,fixed", "nothing in the targets is called 'fixed'"), ("tip,tip.U9", "'U9'"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=why):
            masks_of(text, targets, {})


def part(name: str, count: int) -> Any:
    return SimpleNamespace(name=name, whitener=SimpleNamespace(count=count))


def of_two_means(a: Array, b: Array) -> TradeOff:
    """A model with one parameter, the mean of two samples of sd 1, and its exact fits of both and of each."""

    def at(theta: float) -> SolvedFit:
        return SolvedFit(np.array([theta]), np.array([((x - theta) ** 2).sum() for x in (a, b)]), np.ones(2))

    fits = at(a.mean()), at(b.mean())
    front = Front(np.zeros((1, 1)), np.zeros((1, 2)))
    return TradeOff((part("a", len(a)), part("b", len(b))), front, fits, 0, at(float(np.append(a, b).mean())))


def test_a_model_that_is_right_is_in_no_conflict() -> None:
    rng, alarms, draws = np.random.default_rng(7), 0, 2000
    for _ in range(draws):
        found = of_two_means(rng.normal(size=12), rng.normal(size=30))
        alarms += bool(found.conflicting)
    assert alarms / draws < 0.05  # LEVEL; the one fit is nearer to each than if it knew nothing of it
    assert alarms > 0


def test_samples_that_differ_are_in_conflict_and_it_is_said() -> None:
    rng = np.random.default_rng(8)
    a, b = rng.normal(size=40), rng.normal(2.0, size=40)
    found = of_two_means(a, b)
    assert found.conflicting == ("a", "b")
    np.testing.assert_allclose(found.excess, 40 * ((a.mean() - b.mean()) / 2) ** 2, rtol=1e-12)
    text = told(found)
    assert text.startswith("Conflict of a and b: by the one fit a is missed by 1.")
    assert "`twin diagnose` asks why" in text
    assert found.lacking == ()  # each has the spread that it should
    assert of_two_means(3 * a, b).lacking == ("a",)
    same = of_two_means(a, a[::-1])
    assert told(same) == "No conflict: within noise, the one fit is as good for a and b as a fit of each alone."
    assert told(found, known=False).startswith("Nothing is known of the noise")


@pytest.mark.slow
def test_the_front_of_a_finger_whose_markers_disagree(
    coarsest_case: Case, make_targets: Callable[..., Targets], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tip moves as with softer silicone than the middle: no constants show both, and each alone is fitted."""
    monkeypatch.setattr(tradeoff, "KEPT", 4)
    targets = make_targets()
    model = base_model(targets, coarsest_case)
    assert isinstance(model, KeptModel)
    noise = 0.01 * np.random.default_rng(3).normal(size=targets.value.shape)  # mm, as the covariance says
    value = model.predict(np.array([0.2, 0.1])) + noise
    value[:, 0] = model.predict(np.array([0.18, 0.09]))[:, 0] + noise[:, 0]
    targets = replace(targets, value=value, modes=np.zeros((0, *value.shape)))
    start = np.array([0.19, 0.095])
    nothing = ModelErrors(gauge=np.zeros_like(value), modes=np.zeros((0, *value.shape)))
    masks = masks_of("tip,middle", targets, {})
    parts = [Part.of(name, mask, targets, nothing) for name, mask in masks.items()]
    kept: dict[str, Any] = {}

    def keep(name: str, make: Callable[[], Any]) -> Any:
        if name not in kept:
            kept[name] = make()
        return kept[name]

    found = front_of(model, parts, start, seed=1, keep=keep)
    assert found.conflicting == ("tip", "middle")
    assert not found.unsettled
    best = np.sqrt(found.least / 24)  # 8 steps of 3 components, of sd 0.01 mm
    assert np.all((best > 0.6) & (best < 1.4))  # 1, of 24 values
    own = np.sqrt(found.fit.chi2 / 24)
    assert np.all(own > 1.15 * best)
    totals = [float(np.sum(f.theta)) for f in found.solved]  # the front goes from one to the other
    assert min(totals) == pytest.approx(0.27, rel=0.05)
    assert max(totals) == pytest.approx(0.30, rel=0.05)
    assert 0.27 < np.sum(found.solved[found.knee].theta) < 0.30
    assert max(f.off for f in found.solved) < 0.05 * found.values.max()  # of the response
    assert {"alone: tip", "alone: middle", "the one fit"} < set(kept)
    rms = np.sqrt(((targets.value - model.predict(start))[:, 0] ** 2).mean())
    assert found.fit.rms_mm[0] == pytest.approx(rms)
    assert anew("alone: tip", lambda: {"a": 1}) == {"a": 1}


def test_a_part_without_data_is_refused(make_targets: Callable[..., Targets]) -> None:
    targets = make_targets()
    none = ModelErrors(gauge=np.zeros_like(targets.value), modes=np.zeros((0, *targets.value.shape)))
    unseen = replace(targets, valid=targets.valid & (np.arange(3) != 1))
    with pytest.raises(ValueError, match=saying("--objectives", "U2", "0", "5")):
        Part.of("U2", masks_of("U1,U2", targets, {})["U2"], unseen, none)
    held = replace(targets, held_out=np.ones(8, bool))
    with pytest.raises(ValueError, match="--objectives tip: 0 values"):
        Part.of("tip", masks_of("tip,U2", targets, {})["tip"], held, none)
