"""The evidence for an effect: its numbers against plain sums, and held-out errors against known truths."""

import json
from collections.abc import Callable

import numpy as np
import pytest

from calibrate import Parameter
from fe import Case
from twin.diagnosis.explanation import ALL, EvidenceRecord, Explanation, explained, plausibility, table
from twin.effects.library import effect
from twin.files import plain
from twin.judging.heldout import cycles, folds, foretold
from twin.judging.judged import judge
from twin.model.keptmodel import base_model
from twin.targets import Targets

SD = 5e-4  # mm; the coarse finger moves by 0.4


def test_a_model_foretells_what_it_holds_and_nothing_else() -> None:
    rng = np.random.default_rng(2)
    fold, valid = np.repeat(np.arange(4), 150), np.ones(600, bool)
    base, missing = rng.standard_normal((600, 2)), np.sin(np.linspace(0, 20, 600))[:, None]
    z = base @ [3.0, -1.0] + 2.0 * missing[:, 0] + rng.standard_normal(600)
    without, with_it = foretold(z, base, fold, valid), foretold(z, np.hstack([base, missing]), fold, valid)
    assert with_it == pytest.approx(1.0, abs=0.1)  # 1 / sqrt(2 * 600) is 0.03
    assert without == pytest.approx(np.sqrt(1 + 2.0), rel=0.1)  # half of 2^2 is left as mean square
    # columns of no use fit their own part of the film better and foretell the others worse
    useless = np.hstack([base, missing, rng.standard_normal((600, 100))])
    assert foretold(z, useless, fold, valid) > 1.05 * with_it
    left = z - useless @ np.linalg.lstsq(useless, z)[0]
    assert np.sqrt((left**2).mean()) < with_it
    # what is no data does not count
    hole = valid.copy()
    hole[::3] = False
    empty = np.where(hole, z, 0.0), np.where(hole[:, None], base, 0.0)
    assert foretold(*empty, fold, hole) == pytest.approx(without, rel=0.1)


def test_cycles_begin_where_the_pressure_leaves_rest(make_targets: Callable[..., Targets]) -> None:
    pressure = np.array([0.0, 0.02, 0.3, 1.0, 0.6, 0.02, 0.08, 0.02, 0.5, 1.0, 0.0])
    assert cycles(pressure).tolist() == [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1]
    one = make_targets()
    fold, name = folds(one)
    assert (name, fold.tolist()) == ("fifth of the film", [0, 0, 1, 1, 2, 3, 3, 4])
    block = np.array([0, 0, 0, 0, 1, 1, 1, 1])
    fold, name = folds(make_targets(block=block, gravity=np.tile([0.0, 0.0, -1.0], (2, 1))))
    assert (name, fold.tolist()) == ("block", block.tolist())


def test_a_value_is_told_beside_its_plausible_range() -> None:
    p = Parameter("gravity.density", 0.0, 5.0, "t", null=0.0, plausible=(0.9, 1.3))
    assert plausibility(p, 1.1) == "plausible (0.9 to 1.3 t)"
    assert plausibility(p, 2.0) == "not plausible: expected 0.9 to 1.3 t"
    assert plausibility(Parameter("x", 0.0, 1.0), 0.5) == ""


@pytest.fixture(scope="module")
def evidence(make_targets: Callable[..., Targets], coarsest_case: Case) -> tuple[Targets, Explanation]:
    """A lagging pressure, in the model's own world, with noise."""
    blank = make_targets(covariance=np.tile(SD**2 * np.eye(3), (8, 3, 1, 1)))
    truth = base_model(blank, coarsest_case).with_effect(effect("pressure_lag"))
    noise = SD * np.random.default_rng(5).standard_normal(blank.value.shape)
    value = truth.predict(np.array([0.214, 0.083, 0.6])) + noise
    targets = make_targets(covariance=blank.covariance, value=value)
    base = base_model(targets, coarsest_case)
    before = judge(base, targets, starts=np.array([0.214, 0.083]))
    lag = effect("pressure_lag")
    after = judge(base.with_effect(lag), targets, starts=np.array([0.214, 0.083, 0.3]))
    mimics = [("creep", 0.4)]
    found = explained([lag], before=before, after=after, targets=targets, mimics=mimics)
    assert found.record.model_fields_set == set(EvidenceRecord.model_fields)
    assert found.record.gain == pytest.approx(before.deviance - after.deviance)
    return targets, found


def test_the_evidence_for_a_lag_says_what_it_explains(evidence: tuple[Targets, Explanation]) -> None:
    _, made = evidence
    found = made.record
    assert found.adequate
    assert found.held_out is not None
    assert found.rms_after_mm == pytest.approx(SD, rel=0.35)  # of 48 values
    assert found.rms_before_mm > 5 * found.rms_after_mm
    assert found.held_out.after_sd < 2.0 < found.held_out.before_sd
    assert found.parameters["pressure_lag.tau"].value == pytest.approx(0.6, abs=0.05)
    assert np.nanmax(np.abs(made.residual - made.signature - made.left)) < 1e-12
    cell = {(s.marker, s.branch): s for s in found.shares}
    whole = cell[ALL, ALL]
    assert whole.explained > 0.95
    assert whole.before_mm == pytest.approx(float(np.sqrt(np.nanmean(made.residual**2))))
    assert whole.signature_mm == pytest.approx(float(np.sqrt(np.nanmean(made.signature**2))))
    rows = [s for (marker, branch), s in cell.items() if marker != ALL and branch != ALL]
    assert sum(s.count for s in rows) == whole.count
    assert sum(s.count * s.after_mm**2 for s in rows) == pytest.approx(whole.count * whole.after_mm**2)
    assert cell["tip", "hold"].before_sd == pytest.approx(cell["tip", "hold"].before_mm / SD, rel=0.05)


def test_the_evidence_is_a_record_and_a_table(evidence: tuple[Targets, Explanation]) -> None:
    found = evidence[1].record
    data = json.loads(json.dumps(plain(found), allow_nan=False))
    assert data["class"] == [{"effect": "creep", "ceiling": 0.4}]
    assert data["held_out"]["left_out"] == "fifth of the film"
    assert data["parameters"]["pressure_lag.tau"]["low"] < 0.6 < data["parameters"]["pressure_lag.tau"]["high"]
    assert {"marker", "branch", "explained", "before_mm", "signature_mm", "after_mm"} <= set(data["shares"][0])
    lines = table(found)
    assert lines[0].startswith("pressure_lag: the pressure in the chamber lags")
    assert any("creep 40 %" in line for line in lines)
    rows = [line for line in lines if line.startswith(("tip", "middle", ALL))]
    assert len(rows) == 3
    assert len({len(line) for line in rows}) == 1  # columns stand below each other
