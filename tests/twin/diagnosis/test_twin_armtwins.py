"""The virtual arm of another element: what its truths and targets are, and what is told of its fits."""

from dataclasses import replace
from typing import Any

import benchmarks.diagnosis.armtwins as bench
from benchmarks.diagnosis.armtwins import FITTED, SD, SETS, Film, foretold, problem, rates
from benchmarks.diagnosis.realarm import Begun, fitted

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshes of one cell along the chambers."""
    monkeypatch.setattr(bench, "MODEL", replace(bench.MODEL, cells=(1, 1, 1)))
    monkeypatch.setattr(bench, "CELLS", (2, 1, 1))


def low(kind: str, markers: str = "bulge") -> Film:
    return Film(kind, 0, markers, top=60.0)


def test_fibres_hold_the_wall_of_the_chamber_and_bend_the_tip_more() -> None:
    plain, wound = low("nothing"), low("fibres")
    assert plain.drawn["fibres"] == 0
    assert 0.5 <= wound.drawn["fibres"] <= 2.0
    assert {k: v for k, v in plain.drawn.items() if k != "fibres"} == {
        k: v for k, v in wound.drawn.items() if k != "fibres"
    }
    tip, _, _, bulge = np.moveaxis(wound.true - plain.true, 1, 0)[..., 2]
    assert bulge.max() < -0.2
    assert tip[FITTED - 1] < 0


def test_a_taper_thickens_one_end_by_as_much_as_the_other_is_thinner() -> None:
    """Along the wall of the chamber; the skin stays."""
    straight, tapered = low("nothing").true_case(), low("wall_taper").true_case()
    inside = np.hypot(*straight.nodes[:, 1:].T) < bench.MODEL.radius - 0.1
    moved = np.linalg.norm(tapered.nodes - straight.nodes, axis=1)
    assert moved[~inside].max() < 1e-9
    assert moved[inside].max() == pytest.approx(0.4, abs=0.02)
    x = straight.nodes[:, 0]
    assert moved[np.abs(x - bench.MODEL.length / 2) < 1e-6].max() < 1e-3  # angles follow no straight line


@pytest.mark.parametrize("markers", list(SETS))
def test_targets_are_the_truth_with_noise_at_the_nominal_pressure(markers: str) -> None:
    film = low("nothing", markers)
    data = film.targets()
    rows = [list(bench.PLACES).index(p.name) for p in data.points]
    np.testing.assert_array_equal(data.pressure[1::2], film.pressure)
    assert (data.value[1::2] - film.true[:, rows]).std() == pytest.approx(SD, rel=0.4)
    assert not data.valid[::2].any()
    assert data.held_out[1::2].tolist() == [False] * FITTED + [True] * 3


def test_a_fit_of_constants_foretells_an_arm_that_hides_nothing() -> None:
    whole, _, fit = fitted(problem(low("nothing", "tip")), Begun(1.0), evaluations=2)
    told = foretold(whole, float(whole.targets.pressure[2 * FITTED - 1]), (), fit)
    assert told["between"] is not None
    assert told["between"] < 4 * SD
    assert told["beyond"] is not None


def test_rates_are_shares_of_a_kind_and_medians_of_those_that_have_them() -> None:
    def row(verdict: str, **more: Any) -> dict[str, Any]:
        named = verdict == "hoop_reinforcement"
        fit = {"between": 2.0, "beyond": None, "cover": 0.9}
        told = {"with_it": {"between": 0.2, "beyond": 0.4, "cover": 1.0}} if named else {}
        return {"kind": "fibres", "verdict": verdict, "in_set": named, "named": named, "wrong": False,
                "alone": fit, **told, **more}  # fmt: skip

    found = rates([row("hoop_reinforcement"), row("none of these")])
    assert found["in_set"] == found["refused"] == 0.5
    assert found["between"] == [2.0, 0.2]
    assert found["beyond"] == [None, 0.4]
    nothing = rates([row("none needed", kind="nothing"), row("stiffening", kind="nothing", wrong=True)])
    assert nothing["false_alarms"] == nothing["wrong"] == 0.5
