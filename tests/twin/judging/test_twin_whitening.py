"""Whitened noise is white: drawn from the stated covariance, with shared modes, gauge noise, gaps and
blocks."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from twin.judging import whitening
from twin.judging.noisefilter import shrunk
from twin.judging.whitening import Whitener, _bounded, _gauge_modes, whitener
from twin.targets import Array, Noise, Targets

DRAWS = 2000
SD, RHO, COMMON = 0.02, 0.6, 0.4


@pytest.fixture
def targets(make_targets: Callable[..., Targets], make_noise: Callable[..., Noise]) -> Targets:
    """Two blocks of four steps; U2 is not seen; one mode over all steps and one on the second block."""
    plain = make_targets()
    shape = plain.value.shape
    valid = np.ones(shape, bool)
    valid[..., 1] = False
    rng = np.random.default_rng(5)
    modes = 0.1 * rng.standard_normal((2, *shape))
    modes[1, :4] = 0.0
    return replace(
        plain, valid=valid, block=np.repeat([0, 1], 4), modes=modes, mode_names=("scale", "tilt"),
        covariance=np.tile(SD**2 * np.eye(3), (*shape[:2], 1, 1)),
        noise=make_noise(3, sd=SD, rho=RHO, common=COMMON),
    )  # fmt: skip


def gauge_of(targets: Targets, size: float = 0.05) -> Array:
    """The effect of 1 sd of gauge noise on each step: the steps without pressure have none."""
    out = np.zeros_like(targets.value)
    out[2:, :2] = size * np.array([0.1, 0.0, 1.0])
    return out


def drawn(t: Targets, gauge: Array, count: int, *, seed: int) -> tuple[Array, Array]:
    """Noise (count, s, p, 3) mm as the whitener's docstring states it, drawn by definition; and
    amplitudes (count, k)."""
    rng = np.random.default_rng(seed)
    s, p, _ = t.value.shape
    axes = np.kron(np.full((p, p), COMMON) + (1 - COMMON) * np.eye(p), np.eye(3))
    e = rng.standard_normal((count, s, 3 * p)) @ np.linalg.cholesky(axes).T
    y = np.empty_like(e)
    for k in range(s):
        begins = k == 0 or t.block[k] != t.block[k - 1]
        y[:, k] = e[:, k] if begins else RHO * y[:, k - 1] + np.sqrt(1 - RHO**2) * e[:, k]
    amplitudes = rng.standard_normal((count, len(t.modes)))
    out = SD * y.reshape(count, s, p, 3) + np.tensordot(amplitudes, t.modes, 1)
    return out + gauge * rng.standard_normal((count, s))[..., None, None], amplitudes


def assert_white(z: Array) -> None:
    """Mean square 1 and no correlation, each within five sds of `DRAWS` draws."""
    second = z.T @ z / len(z)
    np.testing.assert_allclose(np.diag(second), 1.0, rtol=0, atol=5 * np.sqrt(2 / len(z)))
    assert np.abs(second - np.diag(np.diag(second))).max() < 5 / np.sqrt(len(z))


def test_noise_of_the_stated_covariance_becomes_white(targets: Targets) -> None:
    gauge = gauge_of(targets)
    w = whitener(targets, prediction_modes=np.zeros((0, *targets.value.shape)), gauge=gauge)
    noise, _ = drawn(targets, gauge, DRAWS, seed=1)
    z = w.whiten(noise)
    assert z.shape == (DRAWS, w.count) == (DRAWS, 8 * 3 * 2)
    assert_white(z)
    # leaving the modes out must show: here they are far above the noise
    bare = whitener(
        replace(targets, modes=0 * targets.modes), prediction_modes=np.zeros((0, *gauge.shape)), gauge=gauge
    )
    assert (bare.whiten(noise) ** 2).mean() > 3


@pytest.mark.parametrize("lasting", [0.0, 0.4])
def test_markers_jitter_together_in_what_is_new_in_each_frame_too(targets: Targets, lasting: float) -> None:
    """Left uncorrelated, what all markers share in one frame looks like another pressure."""
    assert targets.noise is not None
    t = replace(targets, noise=replace(targets.noise, lasting=lasting))
    none = np.zeros((0, *t.value.shape))
    w = whitener(t, prediction_modes=none, gauge=0 * gauge_of(t))
    rng, (s, p, _) = np.random.default_rng(6), t.value.shape
    axes = np.kron(np.full((p, p), COMMON) + (1 - COMMON) * np.eye(p), np.eye(3))
    fresh = rng.standard_normal((DRAWS, s, 3 * p)) @ np.linalg.cholesky(axes).T
    noise, amplitudes = drawn(t, 0 * gauge_of(t), DRAWS, seed=5)
    shared = np.tensordot(amplitudes, t.modes, 1)
    mixed = np.sqrt(lasting) * (noise - shared) + np.sqrt(1 - lasting) * SD * fresh.reshape(DRAWS, s, p, 3)
    assert_white(w.whiten(mixed + shared))


def test_what_looks_like_another_pressure_lies_along_the_gauge(targets: Targets) -> None:
    gauge = gauge_of(targets)
    w = whitener(targets, prediction_modes=np.zeros((0, *targets.value.shape)), gauge=gauge)
    rng = np.random.default_rng(6)
    noise, _ = drawn(targets, gauge, DRAWS, seed=4)
    chi2, count = zip(*(w.along_gauge(z) for z in w.whiten(noise)), strict=True)
    assert set(count) == {6}  # steps with pressure
    assert np.mean(chi2) == pytest.approx(6, abs=5 * np.sqrt(12 / DRAWS))
    z = w.whiten(gauge * rng.standard_normal(8)[:, None, None])
    assert 0.99 * (z @ z) < w.along_gauge(z)[0] < z @ z  # the rest comes later, as what lasts of the noise


def test_a_models_own_modes_are_shared_modes_too(targets: Targets) -> None:
    mode = np.zeros((1, *targets.value.shape))
    mode[0, :, 0, 2] = np.linspace(0.0, 0.3, 8)
    none = np.zeros_like(targets.value)
    w = whitener(targets, prediction_modes=mode, gauge=none)
    both = replace(targets, modes=np.concatenate([targets.modes, mode]), mode_names=("scale", "tilt", "mesh"))
    noise, amplitudes = drawn(both, none, DRAWS, seed=2)
    assert_white(w.whiten(noise))
    assert w.shared == len(w.modes) == 3
    found = np.array([w.amplitudes(row) for row in noise[:400]])
    # pulls: the most probable amplitude is drawn towards 0 by its prior, so that its error and itself have
    # variances that add to 1; the error's is the diagonal of (1 + G'G)^-1
    G = w.noise.innovations(w.modes).T
    wanted = np.diag(np.linalg.inv(np.eye(3) + G.T @ G))
    pulls = (found - amplitudes[:400]) / np.sqrt(wanted)
    np.testing.assert_allclose(pulls.std(axis=0), 1.0, atol=5 / np.sqrt(2 * 400))
    np.testing.assert_allclose(pulls.mean(axis=0), 0.0, atol=5 / np.sqrt(400))


def test_a_missing_value_counts_nothing(targets: Targets) -> None:
    valid = targets.valid.copy()
    valid[2, 1], valid[6:, 0, 2] = False, False
    holes = replace(targets, valid=valid, value=np.where(valid, 0.0, np.nan), modes=0 * targets.modes)
    none = np.zeros_like(targets.value)
    w = whitener(holes, prediction_modes=np.zeros((0, *none.shape)), gauge=none)
    noise, _ = drawn(replace(targets, modes=0 * targets.modes), none, DRAWS, seed=3)
    noise[:, ~valid] = np.nan
    z = w.whiten(noise)
    assert w.count == 8 * 6 - 4
    assert np.isfinite(z).all()
    # the mean chi2 is the number of values, within five sds of the draws
    assert (z**2).sum(axis=1).mean() == pytest.approx(w.count, abs=5 * np.sqrt(2 * w.count / DRAWS))


def test_what_is_held_out_is_not_data(targets: Targets) -> None:
    half = replace(targets, held_out=targets.block == 1)
    none = np.zeros_like(targets.value)
    w = whitener(half, prediction_modes=np.zeros((0, *none.shape)), gauge=none)
    residual = np.where(half.held_out[:, None, None], 1e3, 0.0) + 0 * none
    assert w.count == 4 * 6
    assert not w.whiten(residual).any()
    assert w.rms(residual) == 0.0


def test_noise_sd_is_its_definition(targets: Targets) -> None:
    gauge = gauge_of(targets)
    frames = 302
    assert targets.noise is not None
    known = replace(targets, noise=replace(targets.noise, frames=frames))
    w = whitener(known, prediction_modes=np.zeros((0, *gauge.shape)), gauge=gauge)
    inflation = (frames - 2) / (frames - 6 - 1)  # Hartlap et al. 2007, for 6 components
    variances = (SD**2 * inflation + gauge**2)[..., (0, 2)]
    assert w.noise_sd == pytest.approx(np.sqrt(np.mean(variances)), rel=1e-12)


def test_where_nothing_is_free_and_nothing_shared_the_expected_error_is_the_noise(targets: Targets) -> None:
    alone = replace(targets, modes=np.zeros((0, *targets.value.shape)), mode_names=(), pressure_sd=0 * targets.pressure_sd)
    none = np.zeros((0, *targets.value.shape))
    w = whitener(alone, prediction_modes=none, gauge=np.zeros(targets.value.shape))
    found = w.expected_after(none)
    assert found.rms_mm == pytest.approx(w.noise_sd, rel=1e-6)
    assert found.low_mm < found.rms_mm < found.high_mm


def test_the_expected_error_is_that_of_noise_and_shared_errors_together(targets: Targets) -> None:
    gauge = gauge_of(targets)
    w = whitener(targets, prediction_modes=np.zeros((0, *gauge.shape)), gauge=gauge)
    noise, _ = drawn(targets, gauge, DRAWS, seed=7)
    # 2000 draws tell the size of each of two modes within 2 %
    assert np.sqrt(np.mean([w.error(row) ** 2 for row in noise])) == pytest.approx(w.stated, rel=0.05)
    assert w.stated > 2 * w.noise_sd
    assert w.expected_after(np.zeros((0, *gauge.shape))).rms_mm == pytest.approx(w.stated, rel=1e-9)
    assert w.error(noise[0]) == pytest.approx(np.sqrt((noise[0][targets.valid] ** 2).mean()))


def left_by_a_fit(w: Whitener, t: Targets, gauge: Array, jacobian: Array) -> Array:
    """The errors (DRAWS,) in mm of a right model, fitted by generalised least squares to draws of noise."""
    noise, _ = drawn(t, gauge, DRAWS, seed=8)
    columns = w.whiten(jacobian)
    found = w.whiten(noise) @ columns.T @ np.linalg.inv(columns @ columns.T)
    return np.array([w.error_beside_walls(row) for row in noise - np.tensordot(found, jacobian, 1)])


@pytest.mark.parametrize("tilt", ["tilt", "wall:bottom_wall_mm"])
def test_a_right_model_misses_by_what_is_expected_after_its_fit(targets: Targets, tilt: str) -> None:
    gauge = gauge_of(targets)
    targets = replace(targets, mode_names=("scale", tilt))
    w = whitener(targets, prediction_modes=np.zeros((0, *gauge.shape)), gauge=gauge)
    jacobian = 3 * targets.modes[:1]
    found, errors = w.expected_after(jacobian), left_by_a_fit(w, targets, gauge, jacobian)
    # a mode that the fit takes is expected no more; 2000 draws tell a mean square within 3 %
    assert found.rms_mm < 0.9 * w.stated
    assert found.rms_mm == pytest.approx(np.sqrt((errors**2).mean()), rel=0.05)
    inside = (found.low_mm < errors) & (errors < found.high_mm)
    assert 0.92 <= inside.mean() <= 0.98
    assert (errors > found.high_mm).any()
    # a wall is as thick as the film has it: then its tolerance is no error of a right model
    picture = replace(w, names=("scale", "tilt")).expected_after(jacobian)
    assert (found.rms_mm < 0.9 * picture.rms_mm) == tilt.startswith("wall:")


def test_many_errors_are_weighed_a_few_at_a_time(targets: Targets, monkeypatch: pytest.MonkeyPatch) -> None:
    gauge, own = gauge_of(targets), np.random.default_rng(4).standard_normal((7, *targets.value.shape))
    w = whitener(targets, prediction_modes=0.1 * own, gauge=gauge)
    whole = w.expected_after(3 * targets.modes[:1])
    monkeypatch.setattr(whitening, "CHUNK", 2)
    few = w.expected_after(3 * targets.modes[:1])
    assert (few.rms_mm, few.low_mm, few.high_mm) == pytest.approx((whole.rms_mm, whole.low_mm, whole.high_mm), rel=1e-12)


def test_walls_never_make_the_error_larger(targets: Targets) -> None:
    """One marker, whose noise is the smallest, asks for a thicker wall, which would make all others worse."""
    precise = np.where(np.arange(3) == 0, 1.0, 1e4)[:, None, None]
    wall = replace(
        targets, modes=targets.modes[:1], mode_names=("wall:bottom_wall_mm",), covariance=targets.covariance * precise
    )
    gauge = np.zeros_like(targets.value)
    w = whitener(wall, prediction_modes=np.zeros((0, *gauge.shape)), gauge=gauge)
    against = targets.modes[0] * np.where(np.arange(3) == 0, 1.0, -1.0)[:, None]
    assert w.amplitudes(against)[0] > 0.5
    assert w.error_beside_walls(against) == w.error(against)
    assert w.error_beside_walls(targets.modes[0]) < 0.5 * w.error(targets.modes[0])


def test_of_values_that_no_fit_has_seen_more_is_expected(targets: Targets) -> None:
    """What both films share and the fit has taken into its constants is no error of its prediction."""
    gauge, none = gauge_of(targets), np.zeros((0, *targets.value.shape))
    jacobian = np.random.default_rng(9).standard_normal((1, *gauge.shape))
    halves = [replace(targets, held_out=targets.block == b) for b in (1, 0)]
    seen, unseen = (whitener(t, prediction_modes=none, gauge=gauge) for t in halves)
    found = unseen.expected_unseen(seen, jacobian)
    noise, _ = drawn(targets, gauge, DRAWS, seed=8)
    columns = seen.whiten(jacobian)
    theta = seen.whiten(noise) @ columns.T @ np.linalg.inv(columns @ columns.T)
    errors = np.array([unseen.error(row) for row in noise - np.tensordot(theta, jacobian, 1)])
    assert found.rms_mm == pytest.approx(np.sqrt((errors**2).mean()), rel=0.05)
    assert 0.92 <= ((found.low_mm < errors) & (errors < found.high_mm)).mean() <= 0.98


def test_rms_is_without_shared_modes_but_with_gauge_noise(targets: Targets) -> None:
    gauge = gauge_of(targets, size=1.0)  # far above the noise, so that amplitudes are found within 1e-3
    strong = replace(targets, modes=50 * targets.modes)
    w = whitener(strong, prediction_modes=np.zeros((0, *gauge.shape)), gauge=gauge)
    shared = 0.7 * strong.modes[0] - 1.2 * strong.modes[1]
    assert w.rms(shared) < 0.01 * np.sqrt((w.pick(shared) ** 2).mean())
    kicked = np.zeros_like(gauge)
    kicked[3] = 2 * gauge[3]  # the gauge erred by 2 sd in one step
    assert w.rms(kicked) == pytest.approx(np.sqrt((w.pick(kicked) ** 2).mean()), rel=0.1)


def test_a_gauge_error_in_the_reference_moves_every_step(targets: Targets) -> None:
    gauge = np.zeros_like(targets.value)
    gauge[:, 0, 2] = 0.05
    none = np.zeros((0, *gauge.shape))
    w = whitener(replace(targets, modes=none, mode_names=()), prediction_modes=none, gauge=gauge)
    rng = np.random.default_rng(4)
    still = replace(targets, modes=none, mode_names=())
    noise, _ = drawn(still, 0 * gauge, DRAWS, seed=6)
    kick = gauge * rng.standard_normal((DRAWS, 8))[..., None, None]
    noise += kick - kick[:, targets.reference].mean(axis=1, keepdims=True)
    assert_white(w.whiten(noise))


def test_the_gauges_errors_have_the_covariance_of_what_they_do_to_the_reference() -> None:
    gauge = np.linspace(0.5, 3.0, 7)[:, None] * np.array([1.0, -2.0])
    reference = np.array([0, 2, 3])
    gauge[reference] = gauge[2]  # one pressure, as it is for a reference
    shared, single = _gauge_modes(gauge, reference, np.zeros(7, np.int64))
    alone = np.array([np.eye(7)[k][:, None] * gauge for k in range(7) if k not in reference])  # noise of a step
    modes = np.concatenate([shared, single, alone]).reshape(-1, gauge.size)
    moved = np.eye(7)[:, :, None] * gauge  # an error of 1 sd at each step
    moved = (moved - moved[:, reference].mean(axis=1, keepdims=True)).reshape(7, gauge.size)
    np.testing.assert_allclose(modes.T @ modes, moved.T @ moved, atol=1e-14)


def test_correlation_of_few_frames_is_drawn_to_independence() -> None:
    rng = np.random.default_rng(7)
    truth = np.full((8, 8), 0.3) + 0.7 * np.eye(8)
    sample = rng.standard_normal((20, 8)) @ np.linalg.cholesky(truth).T
    measured = np.corrcoef(sample.T)
    axis = np.repeat([0, 2], 4)
    near = shrunk(measured, 20, axis)
    assert np.linalg.norm(near - truth) < np.linalg.norm(measured - truth)
    np.testing.assert_allclose(shrunk(truth, 10**9, axis), truth, atol=1e-6)
    np.testing.assert_array_equal(shrunk(np.eye(3), 20, axis[:3]), np.eye(3))


def test_jitter_that_all_markers_share_is_not_shrunk_away() -> None:
    """The mean over 12 markers with a correlation of 0.1 has twice the variance of independent ones."""
    rng, axis = np.random.default_rng(9), np.repeat([0, 2], 12)
    truth = 0.1 * (axis[:, None] == axis) + 0.9 * np.eye(24)
    mean = (axis == 0) / 12.0
    stated = []
    for _ in range(20):
        sample = rng.standard_normal((300, 24)) @ np.linalg.cholesky(truth).T
        stated.append(mean @ shrunk(np.corrcoef(sample.T), 300, axis) @ mean)
    # The variance of one mean of 300 frames is known to 8 %, the mean of 20 to 2 %.
    np.testing.assert_allclose(np.mean(stated), mean @ truth @ mean, rtol=0.06)


def test_the_determinant_is_that_of_the_stated_covariance(targets: Targets) -> None:
    valid = targets.valid.copy()
    valid[2, 1] = False
    some, gauge = replace(targets, valid=valid), gauge_of(targets)
    w = whitener(some, prediction_modes=np.zeros((0, *gauge.shape)), gauge=gauge)
    s, m = w.valid.shape
    # covariance of values (s m, s m) mm2 by definition: AR(1) within a block, white part, modes
    lag = np.abs(np.subtract.outer(np.arange(s), np.arange(s)))
    same = np.equal.outer(some.block, some.block)
    dense = np.zeros((s, m, s, m))
    for i in range(m):
        for k in range(m):
            # two components of equal rho, as here, are correlated by rho^|lag|
            dense[:, i, :, k] = w.static[i, k] * np.where(same, w.rho[i] ** lag, 0.0)
    dense = dense.reshape(s * m, s * m) + np.diag((w.sd**2 - np.diag(w.static)).ravel())
    kick = w.pick(gauge)  # of each step on its own
    dense += (np.eye(s)[:, None, :, None] * kick[:, :, None, None] * kick[None, None]).reshape(s * m, s * m)
    seen = w.valid.ravel()
    noise = dense[np.ix_(seen, seen)]
    assert w.noise.trace == pytest.approx(np.trace(noise), rel=1e-12)
    assert w.noise.trace_of_square == pytest.approx((noise**2).sum(), rel=1e-5)
    field = np.where(w.valid, np.random.default_rng(2).standard_normal((s, m)), 0.0)
    times = w.noise.covariance_times(field[None])[0]
    np.testing.assert_allclose(times.ravel()[seen], noise @ field.ravel()[seen], rtol=1e-9)
    dense += w.modes.reshape(len(w.modes), -1).T @ w.modes.reshape(len(w.modes), -1)
    known = dense[np.ix_(seen, seen)]
    assert w.log_det == pytest.approx(np.linalg.slogdet(known).logabsdet, abs=1e-8)
    r = np.where(some.valid, np.random.default_rng(3).standard_normal(some.value.shape), np.nan)
    y = w.pick(r).ravel()[seen]
    assert (w.whiten(r) ** 2).sum() == pytest.approx(y @ np.linalg.solve(known, y), rel=1e-9)


def test_a_bounded_amplitude_is_the_best_within_its_bound(targets: Targets) -> None:
    gauge = gauge_of(targets)
    w = whitener(targets, prediction_modes=np.zeros((0, *gauge.shape)), gauge=gauge)
    residual = 8 * targets.modes[0] - 2 * targets.modes[1] + 3 * gauge
    free, held = w.amplitudes(residual), w.amplitudes(residual, bound=3.0)
    assert abs(free[0]) > 5
    assert np.abs(held[: w.shared]).max() <= 3.0
    G = w.noise.innovations(w.modes).T
    z = w.innovations(residual)

    def size(a: Array) -> float:
        return float(((z - G @ a) ** 2).sum() + a @ a)

    rng = np.random.default_rng(4)
    for _ in range(50):
        other = held + 0.1 * rng.standard_normal(len(held))
        other[: w.shared] = np.clip(other[: w.shared], -3.0, 3.0)
        assert size(other) > size(held)
    np.testing.assert_array_equal(w.amplitudes(residual, bound=20.0), free)


def test_coding_errors_that_are_correlated_from_step_to_step_become_white(targets: Targets) -> None:
    """Each value has a coding error of its own size, x_t = d_t e_t with the memory 0.5 of e."""
    assert targets.noise is not None
    rng, size = np.random.default_rng(7), np.linspace(0.01, 0.05, 8 * 3 * 3).reshape(8, 3, 3)
    noise = replace(targets.noise, sd=1e-6 * targets.noise.sd, coding_rho=0.5)
    t = replace(targets, modes=targets.modes[:0], mode_names=(), noise=noise, covariance=size[..., None] ** 2 * np.eye(3))
    w = whitener(t, prediction_modes=np.zeros((0, *size.shape)), gauge=0 * size)
    e = rng.standard_normal((DRAWS, *size.shape))
    for k in (1, 2, 3, 5, 6, 7):  # two blocks of four steps
        e[:, k] = 0.5 * e[:, k - 1] + np.sqrt(0.75) * e[:, k]
    assert_white(w.whiten(size * e))


@pytest.mark.parametrize("coding", [0.0, 0.4])
def test_the_covariance_of_the_noise_is_what_the_filter_whitens(targets: Targets, coding: float) -> None:
    assert targets.noise is not None
    more = targets.covariance * np.linspace(1.0, 3.0, 8)[:, None, None, None]
    t = replace(targets, covariance=more, noise=replace(targets.noise, coding_rho=coding, lasting=0.7))
    t.valid[3, 1, 0] = False
    noise = whitener(t, prediction_modes=np.zeros((0, *t.value.shape)), gauge=0 * t.value).noise
    unit = np.eye(noise.valid.size).reshape(-1, *noise.valid.shape)[noise.valid.ravel()]
    N = noise.covariance_times(unit).reshape(len(unit), -1)[:, noise.valid.ravel()]
    F = noise.innovations(unit)[:, noise.valid.ravel()]
    np.testing.assert_allclose(F.T @ N @ F, np.eye(len(unit)), atol=1e-9)
    assert noise.trace == pytest.approx(np.trace(N))
    assert noise.trace_of_square == pytest.approx((N**2).sum())


@pytest.mark.parametrize("seed", range(3))
def test_some_bounded_and_some_free_amplitudes_are_the_best_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root, b = rng.normal(size=(8, 5)), rng.normal(size=5)
    H = root.T @ root + 0.1 * np.eye(5)
    found = _bounded(H, b, 3, 0.05)  # the last two may be as large as they like
    wide = minimize(
        lambda x: x @ H @ x - 2 * b @ x, np.zeros(5), jac=lambda x: 2 * (H @ x - b),
        bounds=[(-0.05, 0.05)] * 3 + [(None, None)] * 2, options={"ftol": 1e-15, "gtol": 1e-12},
    )  # fmt: skip
    np.testing.assert_allclose(found, wide.x, atol=1e-6)  # of a minimiser of another kind
    assert np.abs(found[3:]).max() > 0.05
