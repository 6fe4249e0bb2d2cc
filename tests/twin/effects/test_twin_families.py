"""Widest families: each holds the narrow law, and courses that no narrow law has."""

import numpy as np
import pytest
from numpy.polynomial.legendre import legvander
from scipy.optimize import lsq_linear, nnls

from twin.contract.specimen import Specimen, felt_values
from twin.effects.library import all_effects, effect
from twin.effects.loads import DistributedLag, first_order_lag
from twin.effects.material import CreepSpectrum
from twin.effects.protocol import Effect
from twin.effects.shape import ThinBands

WIDE = [(e, wide) for e in all_effects() if (wide := e.wide()) is not None and wide.label.endswith(":wide")]


def test_every_amplitude_has_a_plausible_range_around_its_null() -> None:
    for e in all_effects():
        for law in (*e.laws(), *([wide] if (wide := e.wide()) is not None else [])):
            for p in law.amplitudes:
                low, high = p.plausible or (np.nan, np.nan)
                assert p.low <= low < high <= p.high, p.name
                assert high > (p.null or 0.0), p.name


@pytest.mark.parametrize("tau", [0.5, 2.0, 7.0, 25.0, 60.0])
def test_the_spectrum_holds_any_single_relaxation(tau: float) -> None:
    t = np.linspace(0.1, 60.0, 600)
    a = np.stack([1 - np.exp(-t / k) for k in CreepSpectrum.TAUS], axis=1)
    low, high = (getattr(CreepSpectrum.parameters[0], k) for k in ("low", "high"))
    wanted = 0.05 * (1 - np.exp(-t / tau))
    left = a @ lsq_linear(a, wanted, (low, high)).x - wanted
    assert np.abs(left).max() < 0.007 * 0.05
    assert np.abs(a @ nnls(a, wanted)[0] - wanted).max() < 0.025 * 0.05  # not below 0 anywhere


def test_the_distributed_lag_holds_a_line_of_second_order_with_dead_time() -> None:
    t = np.linspace(0.0, 20.0, 401)
    p = np.interp(t, [0.0, 1.0, 3.0, 8.0, 9.0, 20.0], [0.0, 0.0, 1.0, 1.0, 0.2, 0.2])
    late = np.interp(t - 0.1, t, first_order_lag(t, first_order_lag(t, p, 0.2), 0.1))
    a = np.stack([first_order_lag(t, p, k) - p for k in DistributedLag.TAUS], axis=1)
    bounds = [getattr(DistributedLag.parameters[0], k) for k in ("low", "high")]
    left = a @ lsq_linear(a, late - p, bounds).x - (late - p)
    one = min(np.abs(first_order_lag(t, p, tau) - late).max() for tau in np.linspace(0.2, 0.6, 41))
    assert np.abs(left).max() < 0.35 * one
    assert np.abs(left).max() < 0.015  # of the top pressure


def test_the_course_of_walls_holds_a_step_as_far_as_six_terms_do() -> None:
    x = np.linspace(-1, 1, 401)
    step = np.where(x > 0.2, 1.0, 0.0)
    a = legvander(x, len(effect("wall_taper:wide").parameters) - 1)
    left = step - a @ np.linalg.lstsq(a, step, rcond=None)[0]
    straight = step - a[:, :2] @ np.linalg.lstsq(a[:, :2], step, rcond=None)[0]
    assert np.sqrt((left**2).mean()) < 0.18  # of the step; what is left goes to and fro over a bellow
    assert np.sqrt((left**2).mean()) < 0.75 * np.sqrt((straight**2).mean())


def test_bands_begin_with_as_much_material_as_the_thin_place_lacks() -> None:
    x = np.linspace(0.0, 100.0, 401)  # mm along the built-in finger's chamber
    for place, width in ((0.42, 8.0), (0.7, 15.0)):
        narrow = 0.3 * np.exp(-0.5 * ((x - 100 * place) / width) ** 2)
        start = effect("ballooning:wide").start(
            {"ballooning.depth": 0.3, "ballooning.place": place, "ballooning.width": width}
        )
        bells = np.exp(-0.5 * ((x[:, None] / 100.0 - ThinBands.PLACES) / ThinBands.WIDTH) ** 2)
        wide = bells @ [start[p.name] for p in ThinBands.parameters]
        assert wide.sum() == pytest.approx(narrow.sum(), rel=0.05)
        assert x @ wide / wide.sum() == pytest.approx(100 * place, abs=2.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("narrow", "wide"), [pair for pair in WIDE if pair[0].name != "ballooning"], ids=lambda e: e.label
)  # the bands of so short a chamber are narrower than any thin place
def test_a_widest_family_begins_near_the_narrow_law(narrow: Effect, wide: Effect) -> None:
    specimen, family = Specimen(narrow, {}), Specimen(wide, {})
    start = {**specimen.felt, **wide.start(felt_values(narrow))}
    change = specimen.present - specimen.absent
    begun = family.solved({**family.null, **{k: start[k] for k in family.null}}) - family.absent
    # a band, or a force, between two places is shared by both
    assert np.abs(begun - change).max() < 0.5 * np.abs(change).max()
