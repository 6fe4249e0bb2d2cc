"""Noise that is stated and not measured: the film itself tells its sd and its correlation from step to step."""

from dataclasses import replace
from pathlib import Path

from benchmarks.diagnosis.basefits import MISSTATED, table, told

import numpy as np
import pytest

from tests.twin.diagnosis.toy import POINTS, SD, STEPS, Toy, pressure, targets, toy_effect
from twin.diagnosis.procedure import diagnose
from twin.judging.lawerrors import memory
from twin.judging.scatter import own_scatter, with_own_coding, with_own_noise
from twin.judging.whitening import whitener
from twin.project.targetfiles import read_targets, write_targets
from twin.targets import Array, Targets

TIME = np.arange(STEPS) * 0.25  # s
X = pressure() / 0.03


def field(seed: int, *shapes: Array) -> Array:
    """A field (1, s, p, 3) mm of courses (s,), in x and z, other in each marker; the last marker is fixed."""
    rng, out = np.random.default_rng(seed), np.zeros((1, STEPS, POINTS + 1, 3))
    out[0, :, :POINTS, ::2] = np.einsum("pif,fs->spi", rng.standard_normal((POINTS, 2, len(shapes))), shapes)
    return out - out[:, :5].mean(axis=1, keepdims=True)


BASE = 10 * field(1, X, X**2)
FIELD = field(10, memory(TIME, X, tau=3.0))  # creep, of another time than the courses know
OTHERS = {"beta": field(11, X**3), "gamma": field(12, X * (TIME > 15))}


def film(seed: int, *, rho: float = 0.0, effect: float = 0.0, stated: float = SD) -> Targets:
    """A table of 120 steps whose noise of 0.01 mm is correlated by rho, and stated as white, of an sd in mm."""
    t = targets(1.3 * BASE[0] + effect * FIELD[0], seed=seed)
    new = t.value - 1.3 * BASE[0] - effect * FIELD[0]
    noise = new.copy()
    for k in range(1, STEPS):
        noise[k] = rho * noise[k - 1] + np.sqrt(1 - rho**2) * new[k]
    return table(replace(t, value=t.value - new + noise), stated)


def said(t: Targets) -> list[str]:
    """The effects that a diagnosis names of three, of which one may be hidden."""
    fields = {"base": BASE, "alpha": FIELD, **OTHERS}
    effects = tuple(toy_effect(name) for name in ("alpha", "beta", "gamma"))
    found = diagnose(Toy(fields), effects, t, seed=0, start=np.array([1.0]), beside=(), plan=False)  # type: ignore[arg-type]
    return list(found.named)


@pytest.mark.parametrize(("factor", "rho"), MISSTATED.values(), ids=MISSTATED)
def test_a_film_tells_the_noise_that_is_misstated(factor: float, rho: float) -> None:
    films = [with_own_noise(film(seed, rho=rho, stated=factor * SD)) for seed in range(5)]
    for t in films:
        assert t.noise is not None
        # 8 components of 120 steps: 3 sds of an sd are 8 %, of a rho 0.08
        assert np.nanmean(t.noise.sd) == pytest.approx(SD, rel=0.2)
        assert np.nanmean(t.noise.rho) == pytest.approx(rho, abs=0.12)
        assert np.isnan(t.noise.sd[:, 1]).all()
        sds = np.sqrt(np.diagonal(t.covariance, axis1=2, axis2=3))
        np.testing.assert_allclose(sds[..., 0], np.nanmean(t.noise.sd))
        assert f"stated as an sd of {factor * SD:.3g} mm, each value by itself." in t.noise.basis
        assert f"{np.nanmean(t.noise.sd) / (factor * SD):.2g} times as much" in t.noise.basis
    assert [said(t) for t in films[:2]] == [[], []]
    assert said(with_own_noise(film(0, rho=rho, effect=0.3, stated=factor * SD))) == ["alpha"]


def test_an_honest_table_keeps_its_stated_noise() -> None:
    kept = [with_own_noise(t) is t for t in (film(seed) for seed in range(20))]
    assert sum(kept) >= 19  # chance of a contradiction: 0.003


def test_a_motion_that_no_course_follows_is_no_noise() -> None:
    t = film(0)
    jump = np.zeros_like(t.value)
    jump[40:80:7, 1, 2] = 0.5  # mm
    assert own_scatter(t) is not None
    assert own_scatter(replace(t, value=t.value + jump)) is None
    assert own_scatter(replace(t, held_out=np.ones(STEPS, bool))) is None


def test_smoothed_values_keep_the_noise_that_is_stated() -> None:
    t = with_own_noise(film(0, stated=10 * SD))
    assert t.noise is not None
    assert np.nanmean(t.noise.sd) == pytest.approx(10 * SD)
    assert t.noise.basis.endswith("From step to step the film scatters by 0.01 mm only, as smoothed values do.")


def test_what_the_film_told_stays_in_its_files(tmp_path: Path) -> None:
    t = with_own_noise(film(0, stated=2 * SD))
    write_targets(tmp_path / "targets", t)
    again = read_targets(tmp_path / "targets")
    assert again.noise is not None
    assert t.noise is not None
    assert (again.noise.freedom, again.noise.basis) == (t.noise.freedom, t.noise.basis)
    np.testing.assert_array_equal(again.noise.sd, t.noise.sd)


def coded(seed: int, *, rho: float, stated: float) -> Targets:
    """A film whose coding errors have an sd of 0.01 mm and a memory, and are stated as white, of an sd in mm."""
    t = film(seed, rho=rho)
    assert t.noise is not None
    noise = replace(t.noise, sd=np.where(np.isfinite(t.noise.sd), 0.0005, np.nan), frames=320)
    return replace(t, noise=noise, covariance=t.covariance * (stated / SD) ** 2)


@pytest.mark.parametrize("rho", [0.0, 0.4])
def test_coding_errors_that_are_stated_twice_are_counted_once(rho: float) -> None:
    before, after, lags = [], [], []
    for seed in range(6):
        t = coded(seed, rho=rho, stated=2 * SD)
        found, sentence = with_own_coding(t)
        assert sentence.startswith("Compression errors scatter 0.")
        before.append(_chi2(t))
        after.append(_chi2(found))
        assert found.noise is not None
        lags.append(found.noise.coding_rho)
        assert found.noise.freedom < 500
    assert np.mean(before) == pytest.approx(0.25, abs=0.05)
    assert np.mean(after) == pytest.approx(1.0, abs=0.1)
    assert np.mean(lags) == pytest.approx(rho, abs=0.15)


def _chi2(t: Targets) -> float:
    """The chi2 per value of a right model."""
    w = whitener(t, prediction_modes=np.zeros((0, *t.value.shape)), gauge=0 * BASE[0], points=~t.fixed)
    z = w.whiten(t.value - 1.3 * BASE[0] + 1.3 * BASE[0][t.reference].mean(axis=0))
    return float(z @ z / w.count)


def test_a_film_with_honest_coding_errors_keeps_them() -> None:
    kept = [with_own_coding(t)[0] is t for t in (coded(seed, rho=0.0, stated=SD) for seed in range(12))]
    assert sum(kept) >= 11


def test_correlated_noise_of_the_short_finger_is_told_and_names_nothing() -> None:
    row = told(0, "ar1")
    assert (row["right"], row["named"]) == (True, [])
