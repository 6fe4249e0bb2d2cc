"""What is concluded from a ranking: every verdict, from comparisons that are given."""

import numpy as np
import pytest

from calibrate import Fit
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.comparison import Comparison
from twin.diagnosis.verdicts import Diagnosis, concluded
from twin.effects.library import effect

BASE_EXCESS = 1000.0
FIT = Fit.__new__(Fit)  # is handed on only


def compared(excess: float, p_value: float) -> Comparison:
    nothing = np.zeros(0)
    return Comparison(
        residual=nothing, cleaned=nothing, whitened=nothing, chi2=0.0, degrees_of_freedom=1, excess=excess,
        p_value=p_value, rms_mm=0.1, noise_sd_mm=0.05, where="", maps={},
    )  # fmt: skip


def tried(name: str, gain: float, excess: float, p_value: float) -> Candidate:
    return Candidate(
        effect=effect(name), z=5.0, p_value=1e-6, fit=FIT, comparison=compared(excess, p_value), delta_bic=gain
    )


def verdict_on(*rows: Candidate, p_value: float = 1e-9) -> Diagnosis:
    return concluded(rows, compared(BASE_EXCESS, p_value), FIT, 0.001)


def test_a_best_effect_that_explains_all_is_named() -> None:
    found = verdict_on(tried("creep", 900.0, 0.0, 0.4), tried("pressure_lag", 100.0, 800.0, 1e-9))
    assert (found.verdict, found.named, found.law, found.ties) == ("creep", ("creep",), "creep", ())
    assert found.explained == pytest.approx(1.0)
    assert found.kept is found.ranking[0]
    assert (found.base_fit, found.remainder_mm) == (FIT, 0.001)


def test_effects_within_six_of_bic_are_tied_and_the_next_test_is_told() -> None:
    tie = tried("pressure_lag", 895.0, 0.0, 0.3)
    found = verdict_on(tried("creep", 900.0, 0.0, 0.4), tie, tried("stiffening", 893.0, 0.0, 0.3))
    assert found.ties == (("creep", "pressure_lag"),)  # 7 is apart
    assert found.next_test.startswith("hold the top pressure")
    assert found.verdict == f"creep or pressure_lag: run test {found.next_test}"
    assert found.named == ("creep",)


def test_two_laws_of_one_effect_are_no_tie() -> None:
    found = verdict_on(tried("creep:2", 900.0, 0.0, 0.4), tried("creep", 897.0, 0.0, 0.3))
    assert (found.verdict, found.law, found.ties) == ("creep", "creep:2", ())


@pytest.mark.parametrize(
    ("left", "verdict", "named"),
    [(190.0, "right physics, wrong law", ("creep",)), (210.0, "none of these", ())],
)
def test_an_inadequate_law_needs_four_fifths_of_the_misfit(
    left: float, verdict: str, named: tuple[str, ...]
) -> None:
    found = verdict_on(tried("creep", 900.0, left, 1e-9))
    assert (found.verdict, found.named) == (verdict, named)
    assert (found.kept is not None) == bool(named)
    assert found.explained == pytest.approx(1 - left / BASE_EXCESS)


@pytest.mark.parametrize(("p_value", "verdict"), [(0.2, "none needed"), (1e-9, "none of these")])
def test_an_effect_that_gains_too_little_is_not_named(p_value: float, verdict: str) -> None:
    found = verdict_on(tried("creep", 5.9, 0.0, 0.4), p_value=p_value)
    assert (found.verdict, found.named, found.kept, found.explained) == (verdict, (), None, None)


def test_what_the_data_cannot_tell_is_said() -> None:
    blind = Candidate(effect=effect("clamp"), z=0.0, p_value=1.0, note="cannot be seen")
    assert "Not visible in these data: clamp." in verdict_on(tried("creep", 900.0, 0.0, 0.4), blind).sentence
