"""What the card of an exported finger says of a simulator that is off by a known share."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibrate import Fit, Parameter
from twin.assets.card import AssetCard, FilmTips, carded, drawn, missing, of_film, page
from twin.assets.rod import straight
from twin.assets.sections import RodBeside
from twin.assets.simulators import SIMULATORS, RodSimulator
from twin.effects.library import effect
from twin.judging.fitrecord import FitRecord
from twin.targets import Targets

P = np.linspace(0.006, 0.03, 5)
TIP = np.stack([-0.1 * P / 0.03, 0 * P, -10 * P / 0.03], axis=1)
COVARIANCE = np.array([[4e-4, -3e-4], [-3e-4, 4e-4]])


def record(adequate: bool = True) -> FitRecord:
    parameters = (Parameter("C10", 0.0, 1.0, "MPa"), Parameter("C01", 0.0, 1.0, "MPa"))
    fit = Fit(parameters=parameters, theta=np.array([0.2, 0.1]), covariance=COVARIANCE, chi2=1.0, degrees_of_freedom=9, seed=3, evaluations=4, converged=True, reason="", at_bound=())
    return FitRecord.of(fit, adequate=adequate)


def card(tips: np.ndarray | None, simulator: RodSimulator = SIMULATORS["table"], neo_hooke: float = 0.0, **film: np.ndarray) -> AssetCard:
    rod = straight(bend=0.1, length=60.0, sections=6, top=0.03)
    lifted = np.array([0.0, 0.0, 2.0])
    followed = RodBeside(rod, "tip", P, TIP, np.full((5, 3), 0.03), P[2], 0.1, lifted, False, neo_hooke)
    seen = FilmTips(**{"pressure": P, "tip": TIP, "sd": np.full((5, 3), 0.04), **film})
    return carded(simulator, followed, seen, tips, None if tips is None else 0.9 * lifted, record=record(), effects=[effect("creep"), effect("wall_taper")], names=["rod.json"])


@pytest.mark.parametrize(("share", "words"), [(0.02, "within 3 %: 2 %"), (0.05, "not within 3 %: 5 %")])
def test_a_tip_that_is_off_says_by_how_much(share: float, words: str) -> None:
    found = card((1 + share) * TIP)
    assert found.tip_error == pytest.approx(share)
    assert found.film_error == pytest.approx(share)
    assert found.load.error == pytest.approx(0.1)
    assert words in found.sentence
    assert f"{100 * share:.2g} %" in page(found)


def test_the_cover_counts_errors_of_model_and_film_together_and_what_was_measured_alone() -> None:
    off = TIP + np.array([0.0, 0.0, 0.09])  # below 1.96 x 0.05, above 1.96 x either sd
    assert card(off).cover == 1.0
    assert card(TIP + np.array([0.0, 0.0, 0.11])).cover == pytest.approx(2 / 3)
    unseen = TIP.copy()
    unseen[:, 2] = np.nan
    assert card(TIP + np.array([0.0, 0.0, 0.11]), tip=unseen).cover == 1.0
    assert card(TIP, sd=np.full((5, 3), np.nan)).cover is None


@pytest.mark.parametrize(("share", "words"), [(0.034, "the tip is off by 3.4 % at most"), (np.nan, "does not carry these")])
def test_what_a_solid_of_one_constant_would_lose_is_told(share: float, words: str) -> None:
    assert words in page(card(TIP, neo_hooke=share))


def test_without_its_package_a_simulator_is_not_judged() -> None:
    absent = replace(SIMULATORS["mujoco"], package="no-such-simulator")
    found = card(None, absent)
    assert (absent.runs, found.tip_error, found.run_with) == (False, None, "")
    assert found.sentence.startswith("Not checked: no-such-simulator is not installed. The files were checked with its version 4.0.0")


def test_samples_go_together_as_the_fit_says_and_there_are_none_of_a_model_that_does_not_fit() -> None:
    values, where = drawn(record())
    assert {name: len(x) for name, x in values.items()} == {"C10": 20, "C01": 20}
    assert np.corrcoef(values["C10"], values["C01"])[0, 1] < -0.4
    assert np.std(values["C10"]) == pytest.approx(0.02, rel=0.4)
    assert "covariance" in where
    assert drawn(record(adequate=False))[0] == {}


def test_effects_that_no_held_pressure_shows_are_named_as_missing() -> None:
    effects = [effect(name) for name in ("creep", "wall_taper", "pressure_lag", "camera_scale", "ballooning")]
    assert list(missing(effects)) == ["creep", "pressure_lag", "camera_scale"]
    assert "no memory" in missing(effects)["creep"]
    assert "creep: the asset has no memory" in page(card(TIP))


def test_the_film_is_asked_as_its_pressure_rises(make_targets: Callable[..., Targets]) -> None:
    plain = make_targets()
    value = np.arange(8.0)[:, None, None] + np.zeros((8, 3, 3))
    valid = np.ones((8, 3, 3), bool)
    valid[3, 0, 1] = False
    modes = np.full((1, 8, 3, 3), 0.03)
    film = of_film(replace(plain, value=value, valid=valid, modes=modes, mode_names=("scale",)), "tip")
    np.testing.assert_allclose(film.tip[-1], [3.0, np.nan, 3.0])  # the first step of the hold, not the release
    assert np.isnan(film.sd[-1, 1])
    np.testing.assert_allclose(film.sd[-1, 0], np.hypot(0.01, 0.03))
    assert (film.tip[:, 0] <= 3.0).all()  # not step 6, on the way back at a fifth of the top
