"""What the benchmarks of other programs and of transfer count, on numbers that are known."""

from collections.abc import Callable
from dataclasses import replace

from benchmarks import ccxfinger, transfer

import numpy as np
import pytest

from fe import Material
from twin.targets import Targets


def test_error_and_cover_are_of_the_truth_and_of_what_was_measured(make_targets: Callable[..., Targets]) -> None:
    plain = make_targets()
    true = np.arange(plain.value.size, dtype=float).reshape(plain.value.shape)
    sd = 0.1
    targets = replace(plain, value=true, valid=np.ones_like(plain.valid), covariance=np.tile(sd**2 * np.eye(3), (*true.shape[:2], 1, 1)))
    found = transfer.told(true + 0.3, np.zeros_like(true), true, targets)
    assert found["error"] == pytest.approx(0.3 / np.sqrt(np.mean(true**2)))
    assert found["cover"] == 0.0  # 3 sd off everywhere
    assert transfer.told(true + 0.3, np.full_like(true, 0.3**2), true, targets)["cover"] == 1.0  # 0.95 of 1.96 sd


def test_halves_are_counted_of_trials_that_have_both() -> None:
    def row(named: float, constants: float) -> dict[str, dict[str, float]]:
        return {"named": {"error": named, "cover": 0.9}, "constants": {"error": constants, "cover": 0.8}}

    found = transfer.rates([row(1.0, 2.0), row(1.0, 1.5), row(3.0, 2.0), row(1.0, 4.0)])
    assert (found["n"], found["constants"]["halved"], found["constants"]["named_better"]) == (4, 0.5, 0.75)
    assert "learned" not in found


def test_every_fourth_trial_is_of_every_size_and_finger_in_time() -> None:
    every, some = transfer.trials(False), transfer.trials(True)
    assert len(every) == len({seed for *_, seed in every}) == 4 * len(transfer.KINDS)
    assert set(some) <= set(every)
    assert {size for _, size, *_ in some} & {sizes[1] for sizes in transfer.KINDS.values()}


def test_a_thinner_roof_moves_the_inside_of_the_last_chamber_alone() -> None:
    case = ccxfinger.BODY.case(ccxfinger.BODY.lattice, Material(0.2, 0.1))
    change = ccxfinger.roofed(case, 0.3).nodes - case.nodes
    x, _, z = case.nodes[np.abs(change[:, 2]) > 0].T
    assert not change[:, :2].any()
    assert change[:, 2].max() == pytest.approx(0.3)
    assert x.min() > ccxfinger.BODY.base_cap_mm + ccxfinger.BODY.chamber_length_mm  # not the first chamber
    assert z.min() == pytest.approx(18.0)  # the inner face of a roof of 2 mm
    assert z.max() < 20.0  # the outer face stays
