"""Intervals: cut at bounds, none where the model does not fit, the same in every file and in every sentence."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibrate import Fit, Parameter
from twin import files
from twin.judging.comparison import Comparison
from twin.judging.fitrecord import FitRecord
from twin.judging.intervals import estimates, fit_record
from twin.numerals import in_words

PARAMETERS = (Parameter("C10", 0.01, 0.5, "MPa"), Parameter("C01", 0.0, 0.5, "MPa"), Parameter("creep.g1", 0.0, 0.5))


def fit_with(theta: tuple[float, ...], variance: tuple[float, ...], at_bound: tuple[str, ...] = ()) -> Fit:
    return Fit(
        parameters=PARAMETERS, theta=np.array(theta), covariance=np.diag(variance), chi2=1.0,
        degrees_of_freedom=9, seed=0, evaluations=1, converged=True, reason="", at_bound=at_bound,
    )  # fmt: skip


def compared(p_value: float) -> Comparison:
    nothing = np.zeros(0)
    return Comparison(
        residual=nothing, cleaned=nothing, whitened=nothing, chi2=0.0, degrees_of_freedom=1, excess=0.0,
        p_value=p_value, rms_mm=0.1, noise_sd_mm=0.05, where="", maps={},
    )  # fmt: skip


FIT = fit_with((0.2, 0.09, 0.01), (0.01**2, 0.05**2, 0.02**2))


def test_an_interval_is_of_95_percent_and_ends_at_the_bounds() -> None:
    c10, c01, g1 = estimates(FIT, compared(0.5)).values()
    assert (c10.low, c10.high) == pytest.approx((0.2 - 0.0196, 0.2 + 0.0196), abs=1e-5)
    assert (c01.low, c01.high) == pytest.approx((0.0, 0.09 + 0.098), abs=1e-4)  # 0.09 - 0.098 is below its bound
    assert (g1.low, g1.note) == (0.0, "")


def test_a_model_that_does_not_fit_has_no_interval() -> None:
    for p_value, why in ((1e-4, "the model does not fit yet"), (np.nan, "there are no more data than fitted parameters")):
        found = estimates(FIT, compared(p_value)).values()
        assert [e.value for e in found] == FIT.theta.tolist()
        assert {(e.low, e.high, e.note) for e in found} == {(None, None, f"no interval: {why}")}


def test_a_parameter_at_its_bound_or_unknown_to_the_data_has_no_interval() -> None:
    stuck, known, lost = estimates(fit_with((0.5, 0.1, 0.1), (0.0, 1e-6, np.inf), ("C10",)), compared(0.5)).values()
    assert (stuck.low, stuck.high, stuck.note) == (None, None, "ends at its bound of 0.5 MPa")
    assert (lost.low, lost.high, lost.note) == (None, None, "the data leave it undetermined")
    assert known.high is not None
    doubted = estimates(fit_with((0.5, 0.1, 0.1), (0.0, 1e-6, 1e-6), ("C10",)), compared(0.0))
    assert doubted["C10"].note == "ends at its bound of 0.5 MPa; no interval: the model does not fit yet"


@pytest.mark.parametrize("p_value", [0.5, 1e-9])
def test_a_stored_fit_gives_the_same_intervals(p_value: float) -> None:
    record = fit_record(FIT, compared(p_value))
    assert record.estimates == estimates(FIT, compared(p_value))
    assert record.adequate is (p_value > 1e-3)
    assert record.fit.theta.tolist() == FIT.theta.tolist()


def test_a_fit_of_an_older_version_has_no_interval() -> None:
    (c10, *_) = FitRecord.of(FIT).estimates.values()
    assert (c10.value, c10.low, c10.high) == (0.2, None, None)
    assert "older version" in c10.note


def test_the_words_have_the_intervals_and_say_once_why_there_are_none() -> None:
    words = in_words(estimates(FIT, compared(0.5)))
    assert words == "C10 = 0.200 MPa (95 %: 0.180 to 0.220), C01 = 0.09 MPa (95 %: 0.00 to 0.19), creep.g1 = 0.010 (95 %: 0.000 to 0.049)"
    words = in_words(estimates(FIT, compared(1e-9)))
    assert words == "C10 = 0.2 MPa, C01 = 0.09 MPa, creep.g1 = 0.01; no interval: the model does not fit yet"
    words = in_words(estimates(fit_with((0.5, 0.1, 0.1), (0.0, 1e-6, 1e-6), ("C10",)), compared(0.5)))
    assert words.startswith("C10 = 0.5 MPa (ends at its bound of 0.5 MPa), C01 = 0.1000 MPa (95 %: 0.0980 to 0.1020)")


@pytest.mark.parametrize("bound", [False, True])
def test_a_fit_survives_its_file(tmp_path: Path, bound: bool) -> None:
    own = {"null": 0.0, "plausible": (0.1, 0.2), "start": 0.1} if bound else {}
    fit = replace(fit_with((0.5, 0.1, 0.1), (0.0, 1e-6, 1e-6), ("C10",) * bound), reason="done")
    fit = replace(fit, parameters=(*PARAMETERS[:2], Parameter("creep.g1", 0.0, 0.5, **own)))
    files.write_json(tmp_path / "fit.json", FitRecord.of(fit))
    back = files.read(FitRecord, tmp_path / "fit.json").fit
    for name in ("parameters", "chi2", "degrees_of_freedom", "seed", "evaluations", "converged", "at_bound", "reason"):
        assert getattr(back, name) == getattr(fit, name)
    assert np.array_equal(back.theta, fit.theta)
    assert np.array_equal(back.covariance, fit.covariance)
    first = json.loads((tmp_path / "fit.json").read_text())["parameters"]["C01"]
    assert first == {"value": 0.1, "sd": fit.sd[1], "low": 0.0, "high": 0.5, "unit": "MPa"}


def test_an_undetermined_fit_survives_its_file(tmp_path: Path) -> None:
    lost = replace(fit_with((0.5, 0.1, 0.1), (np.inf, 1.0, 1.0)), chi2=np.inf)
    covariance = lost.covariance.copy()
    covariance[0, 1:] = covariance[1:, 0] = np.nan
    fit = replace(lost, covariance=covariance)
    files.write_json(tmp_path / "fit.json", FitRecord.of(fit))
    back = files.read(FitRecord, tmp_path / "fit.json").fit
    assert np.array_equal(back.covariance, fit.covariance, equal_nan=True)
    assert back.chi2 == np.inf
    files.write_json(tmp_path / "fit.json", files.plain(FitRecord.of(fit)) | {"converged": None})
    with pytest.raises(ValueError, match="converged"):
        files.read(FitRecord, tmp_path / "fit.json")
