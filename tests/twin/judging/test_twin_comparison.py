"""The lack-of-fit test keeps its rate on noise alone, sees a smooth misfit, and says where it is."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibrate import least_squares
from calibrate.parameters import Parameter
from fe import Path
from twin import virtual
from twin.files import plain
from twin.judging.comparison import BRANCHES, Comparison, branches, compare, error_in_words, noise_in_words
from twin.judging.fitrecord import FitTest, MapRow
from twin.judging.sharederrors import in_words, subject
from twin.judging.whitening import whitener
from twin.targets import Array, Targets

BENCH = virtual.Bench(film_hz=1.0, sd=0.02, static_frames=300)  # mm: far above the solver's own error
NAMES, X = ("p1", "p2", "tip"), np.array([30.0, 70.0, 110.0])
POINTS = np.stack([X, np.full(3, 11.5), np.zeros(3)], axis=1)
SLOPE = np.stack([-1.5 * X, 0 * X, -6.0 * X], axis=1)  # (p, 3) mm per MPa


@pytest.fixture(scope="module")
def course() -> Path:
    return virtual.path(BENCH)


def linear(course: Path) -> Array:
    """Displacements (s, 3, 3) mm of a finger that moves in proportion to the pressure."""
    return course.at_output()[:, None, None] * SLOPE


def draw(course: Path, seed: int, *, misfit: Array | float = 0.0) -> Targets:
    u = linear(course) + misfit
    return virtual.noisy_targets(
        u, 0 * u + SLOPE, course, points=virtual.at_nodes(NAMES, (1, 2, 3), POINTS), bench=BENCH, seed=seed, fixed=2,
    )  # fmt: skip


def judged(t: Targets) -> Comparison:
    """The comparison after a fit of one factor on U1 and one on U3: a model that is linear and right."""
    shape = np.zeros((2, *t.value.shape))
    for row, axis in enumerate((0, 2)):
        shape[row, :, :3, axis] = (t.pressure - t.pressure[t.reference].mean())[:, None] * SLOPE[:, axis]
    gauge = np.zeros_like(t.value)
    gauge[:, :3] = SLOPE * t.pressure_sd[:, None, None]
    w = whitener(t, prediction_modes=np.zeros((0, *t.value.shape)), gauge=gauge)
    rows, measured = w.whiten(shape).T, w.whiten(t.value)
    parameters = (Parameter("a", 0.0, 3.0), Parameter("b", 0.0, 3.0))
    fit = least_squares(lambda x: measured - rows @ x, lambda _: -rows, parameters, start=np.ones(2))
    return compare(t, np.tensordot(fit.theta, shape, 1), w, jacobian=shape)


@pytest.mark.parametrize("draws", [40, pytest.param(200, marks=pytest.mark.slow)])
def test_noise_alone_is_adequate_at_the_stated_rate(course: Path, draws: int) -> None:
    found = [judged(draw(course, seed)) for seed in range(draws)]
    p = np.array([c.p_value for c in found])
    # 0.01 is 2 of 200; 8 and more have a chance of 1e-3, and the larger of two tests makes them fewer
    assert (p < 0.01).mean() < 0.04
    assert sum(c.adequate for c in found) >= 0.99 * draws
    assert p.min() < 0.3  # the test is not asleep
    # rms over noise: 1 within the spread of noise estimates and cleaned modes
    assert np.mean([c.rms_mm / c.noise_sd_mm for c in found]) == pytest.approx(1.0, abs=0.05)


def test_every_test_of_noise_alone_has_a_chi2_of_its_degrees_of_freedom(course: Path) -> None:
    found = [{t.name: t for t in judged(draw(course, seed)).tests} for seed in range(20)]
    assert all(set(tests) == {"all", "pressure", "picture", "smooth"} for tests in found)
    for tests in found:
        assert tests["pressure"].chi2 + tests["picture"].chi2 == pytest.approx(tests["all"].chi2)  # type: ignore[operator]
    for name, count in (("all", 20 * 428), ("pressure", 20 * 41), ("picture", 20 * 387), ("smooth", 20 * 58)):
        chi2 = np.array([(t[name].chi2, t[name].degrees_of_freedom) for t in found], float).sum(axis=0)
        assert chi2[1] == pytest.approx(count)
        # three sds, and 4 % for a noise from 300 frames, of which the inverse is taken to be 3 % too large
        assert chi2[0] / chi2[1] == pytest.approx(1.0, abs=3 * np.sqrt(2 / count) + 0.04), name


def row(ratio: float, count: int = 99) -> MapRow:
    return MapRow(name=f"{ratio} {count}", count=count, rms_mm=0.01 * ratio, noise_sd_mm=0.01, ratio=ratio)


EVEN = (row(2.0), row(2.5), row(9.0, count=49))  # the last one has too few values to count
SMALL, LARGE = "stated noise is too small, by a factor of 2.0", "noise of the picture is stated"


@pytest.mark.parametrize(
    ("ratio", "count", "p", "smooth", "rows", "said"),
    [
        (4.0, 100, 1e-9, 1.0, EVEN, SMALL),
        (4.0, 99, 1e-9, 1.0, EVEN, ""),  # too few values
        (4.0, 100, 2e-3, 1.0, EVEN, ""),  # adequate
        (4.0, 100, 1e-9, 7.9, EVEN, SMALL),
        (4.0, 100, 1e-9, 8.1, EVEN, ""),  # slow: a missing effect is
        (4.0, 100, 1e-9, 1.0, (row(2.0), row(2.61)), ""),  # it has a place
        (4.0, 100, 1e-9, 1.0, (row(0.9), row(1.1)), ""),  # within the noise
        (4.0, 100, 1e-9, 1.0, (row(9.0, count=49),), ""),
        (0.69, 100, 1.0, 1.0, EVEN, LARGE),
        (0.71, 100, 1.0, 1.0, EVEN, ""),
        (0.69, 99, 1.0, 1.0, EVEN, ""),
    ],
)  # fmt: skip
def test_noise_is_called_misstated_where_nothing_else_is_wrong(
    ratio: float, count: int, p: float, smooth: float, rows: tuple[MapRow, ...], said: str
) -> None:
    tests = (
        FitTest(name="picture", chi2=ratio * count, degrees_of_freedom=count, p_value=p),
        FitTest(name="smooth", chi2=smooth * 50, degrees_of_freedom=50, p_value=p),
    )
    found = noise_in_words(tests, {"marker": rows})
    assert said in found
    assert bool(found) is bool(said)


def test_a_smooth_misfit_is_seen_and_placed(course: Path) -> None:
    branch = branches(course.output, course.at_output(), course.time, course.pressure)
    misfit = np.zeros((len(course.output), 3, 3))
    # what is left after the release, where no mode that grows with the motion can take it
    misfit[:, 1, 2] = 0.2 * (branch == BRANCHES.index("rest")) * (course.output > 25)
    found = judged(draw(course, 0, misfit=misfit))
    assert not found.adequate
    assert "marker p2" in found.where
    assert "in U3" in found.where
    assert "kPa, at rest." in found.where
    assert found.p_value < 1e-6
    data = plain(found.record())
    assert set(data) == {
        "chi2", "degrees_of_freedom", "p_value", "rms_mm", "raw_rms_mm", "expected_mm", "expected_low_mm", "expected_high_mm",
        "noise_sd_mm", "tests",
        "adequate", "where", "beyond", "leans", "maps",
    }  # fmt: skip
    assert [row["name"] for row in data["maps"]["marker"]] == [*NAMES, "fixed0", "fixed1"]
    assert [row["name"] for row in data["maps"]["direction"]] == ["U1", "U3"]
    assert {row["name"] for row in data["maps"]["branch"]} == set(BRANCHES)
    bands = [row["name"].removesuffix(" kPa").split(" to ") for row in data["maps"]["pressure"]]
    assert [low for low, _ in bands[1:]] == [high for _, high in bands[:-1]]  # one begins where the other ends
    assert float(bands[-1][1]) == pytest.approx(30.0, abs=1.0)  # the top pressure; 0.3 kPa is the gauge's sd


def test_where_it_fails_is_where_the_most_is_beyond_noise(course: Path) -> None:
    misfit = np.zeros((len(course.output), 3, 3))
    misfit[:, 0, 2] = 0.06 * np.sin(np.pi * course.at_output() / 0.03) ** 2
    found = judged(draw(course, 3, misfit=misfit))
    row = {r.name: r for r in found.maps["marker"]}
    assert row["tip"].rms_mm > row["p1"].rms_mm  # the gauge's noise moves the tip most
    assert row["p1"].ratio > row["tip"].ratio
    assert f"marker p1 ({row['p1'].rms_mm:.3f} mm, {row['p1'].ratio:.1f} times its noise)" in found.where


def test_the_place_is_not_where_a_shared_error_has_moved_the_misfit(course: Path) -> None:
    # steps under pressure are many, so that an error of the reference's mean takes it up and leaves it at rest
    misfit = np.zeros((len(course.output), 3, 3))
    misfit[:, 2, 2] = 0.3 * (course.at_output() > 0.002)
    t = draw(course, 2, misfit=misfit)
    own = np.array([name.startswith("reference") for name in t.mode_names])
    t = replace(t, modes=t.modes[own], mode_names=tuple(np.array(t.mode_names)[own].tolist()))
    u, nothing = np.zeros_like(t.value), np.zeros((0, *t.value.shape))
    u[:, :3] = linear(course)
    w = whitener(t, prediction_modes=nothing, gauge=0 * u)
    found = compare(t, u, w, jacobian=nothing)
    assert not found.adequate
    moved = {row.name: row for row in found.maps["branch"]}
    assert moved["rest"].rms_mm < 0.05 < 0.08 < moved["hold"].rms_mm
    assert "marker tip" in found.where
    assert "at rest" not in found.where
    # taken off as it is asked for, 12 sd, it would hide the misfit; no more than 3 of them are
    assert w.rms(found.residual) < found.raw_rms_mm / 1.5
    assert 0.8 * found.raw_rms_mm < found.rms_mm < found.raw_rms_mm
    assert found.rms_mm == pytest.approx(np.sqrt(np.nanmean(found.cleaned**2)))
    assert found.expected_mm < 0.3 * found.raw_rms_mm
    assert f"misses the film by {found.raw_rms_mm:.3f} mm" in found.where
    assert next(name for name, _ in found.beyond) == "reference:tip:3"
    assert "even if the rest position of marker tip in U3 were off by " in found.where


def test_shared_errors_are_said_in_plain_words() -> None:
    rows = (("sync", 9.2), ("scale", -5.0), ("node:p3:x", 4.4), ("frame:2", 4.1))
    assert in_words(rows, fits=True) == (
        " It agrees only if the clock of the film were off by 9 sd, the scale of all lengths by 5 sd, the "
        "material point of marker p3 along x by 4 sd and 1 more error by more than 4 sd."
    )
    assert in_words(rows[:1], fits=False) == " It would not fit even if the clock of the film were off by 9 sd."
    assert in_words((), fits=True) == ""
    assert subject("reference:shared:1") == "the rest position of all markers in U1"
    assert subject("out_of_plane:tip") == "the motion of marker tip towards the camera"
    assert subject("of a lab:7") == "the shared error of a lab:7"
    assert subject("placement") == "the shared error placement"


def test_what_many_values_share_is_not_called_a_misfit(course: Path) -> None:
    t = draw(course, 1)
    before = judged(t)
    seen = np.isfinite(before.cleaned)
    np.testing.assert_array_equal(seen.any(axis=(0, 1)), [True, False, True])
    assert before.rms_mm == pytest.approx(np.sqrt((before.cleaned[seen] ** 2).mean()))
    for mode in t.modes:
        after = judged(replace(t, value=t.value + 2 * mode))
        change = np.abs(after.residual - before.residual)[seen].max()
        # a single tag's placement is known poorly from its own noisy values: a third of it may be left
        assert np.abs(after.cleaned - before.cleaned)[seen].max() < 0.4 * change + 1e-9


def test_a_misfit_below_the_whole_chi2_is_seen_by_its_smoothness(course: Path) -> None:
    bump = 0.1 * np.sin(np.pi * course.at_output() / 0.03) ** 2
    misfit = np.zeros((len(course.output), 3, 3))
    misfit[:, 0, 2] = bump
    found = judged(draw(course, 3, misfit=misfit))
    assert abs(found.chi2 / found.degrees_of_freedom - 1) < 0.35
    assert not found.adequate


def test_a_gauge_worse_than_stated_is_seen(course: Path) -> None:
    t = draw(course, 1)
    assert judged(t).adequate
    kick = 1.5 * t.pressure_sd * np.random.default_rng(8).standard_normal(len(t.time))
    value = t.value.copy()
    value[:, :3] += kick[:, None, None] * SLOPE
    found = judged(replace(t, value=value))
    assert found.chi2 < 1.25 * found.degrees_of_freedom  # hardly to be seen in the whole
    assert not found.adequate


def test_agreement_is_said_in_words(course: Path) -> None:
    found = judged(draw(course, 1))
    assert found.where.startswith("The model agrees with the measurement within the noise")
    assert found.degrees_of_freedom == 5 * 2 * len(course.output) - 2


def test_no_degree_of_freedom_is_said_in_words(make_targets: Callable[..., Targets]) -> None:
    t = make_targets()
    only = np.zeros_like(t.valid)
    only[5, :2, 2] = True
    t = replace(t, valid=only)
    w = whitener(t, prediction_modes=np.zeros((0, *t.value.shape)), gauge=np.zeros_like(t.value))
    found = compare(t, t.value, w, jacobian=np.ones((2, *t.value.shape)))
    assert found.degrees_of_freedom == 0
    assert np.isnan(found.p_value)
    assert not found.adequate
    assert "no more data than fitted parameters" in found.where


def test_where_nothing_was_measured_no_number_is_made_up(course: Path) -> None:
    t = draw(course, 1)
    valid = t.valid & ~((t.pressure > 0.008) & (t.pressure < 0.014))[:, None, None]
    found = judged(replace(t, valid=valid))
    empty = [row for row in found.maps["pressure"] if row.count == 0]
    assert empty == [MapRow(name=empty[0].name, count=0, rms_mm=None, noise_sd_mm=None, ratio=None)]
    assert sum(row.count for row in found.maps["pressure"]) == valid[:, :, [0, 2]].sum()
    assert "NaN" not in json.dumps(plain(found.record()))
    # the place of failure is one where something was measured
    misfit = np.zeros((len(course.output), 3, 3))
    misfit[:, 1, 2] = 0.2 * (course.at_output() > 0.014)
    bad = judged(replace(draw(course, 1, misfit=misfit), valid=valid))
    assert not bad.adequate
    assert empty[0].name not in bad.where
    assert "nan" not in bad.where


def test_an_error_larger_than_all_that_moves_is_expected_of_nobody(course: Path) -> None:
    t = draw(course, 1)
    assert judged(t).expected_mm < 0.1
    rest = np.sin(np.arange(len(t.time)))[:, None, None] * np.ones_like(t.value)  # unlike any constant's motion
    found = judged(replace(t, modes=np.concatenate([t.modes, 1e4 * rest[None]]), mode_names=(*t.mode_names, "odd")))
    assert np.isnan(found.expected_mm)
    assert "A right model" not in error_in_words(found)


def test_branches_follow_the_pressure() -> None:
    course = virtual.path(virtual.Bench(ripple_MPa=0.0))
    branch = branches(course.output, course.at_output(), course.time, course.pressure)
    at = {1.0: "rest", 3.0: "up", 8.0: "hold", 15.0: "hold", 23.0: "down", 30.0: "rest", 36.0: "hold", 40.0: "rest"}
    for time, name in at.items():
        assert BRANCHES[branch[np.argmin(np.abs(course.output - time))]] == name, time


def test_weights_without_pressure_are_compared_without_a_place_in_pressure(course: Path) -> None:
    """Of a real beam that a weight bends, a comparison broke with `max() arg is an empty sequence`."""
    t = draw(course, 3, misfit=np.linspace(0.0, 2.0, len(course.output))[:, None, None] * np.ones((3, 3)))
    t = replace(t, pressure=0 * t.pressure, log_pressure=0 * t.log_pressure)
    w = whitener(t, prediction_modes=np.zeros((0, *t.value.shape)), gauge=np.zeros_like(t.value))
    found = compare(t, np.zeros_like(t.value), w, jacobian=np.zeros((0, *t.value.shape)))
    assert not found.adequate
    assert found.maps["pressure"] == ()
    assert "It fails most at marker" in found.where
    assert "kPa" not in found.where
