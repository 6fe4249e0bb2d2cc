"""How long noise lasts, and what key frames change: fixed marks must show no displacement, within what is
stated of means over many frames, and one that really moves must show it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from tests.pulls import band
from vision import Camera, Displacements, Stated, View, measure
from vision.errors.codingdrift import rare, stretches
from vision.errors.codingvariance import Codec
from vision.errors.staticnoise import of_mean, persistence_of
from vision.following.tracks import Followed, Method
from vision.kinds import CodedMarker
from vision.marks import Mark
from vision.measuring.displacements import displacements_of
from vision.placing.views import Seen

Array = NDArray[np.float64]
LENS = Camera(np.array([[2400.0, 0, 640.0], [0, 2400.0, 360.0], [0, 0, 1.0]]), np.zeros(5), (1280, 720))
TINY = Stated(
    placement_mm=1e-6, scale=1e-9, frame_mm=1e-6, node_mm=1e-6, height_mm=1e-6, out_of_plane_mm=1e-6
)
SPOTS = {
    "frame": [(-35, 30), (45, 34), (125, 30), (-35, -20), (125, -18), (-35, -70), (45, -72), (125, -70)],
    "fixed": [(5, 32), (85, 32), (-34, 0), (123, 5), (20, -50)],
    "finger": [(30, 0), (60, 0), (90, 0)],
}
MARKS = tuple(
    Mark(f"{role}{k}", CodedMarker(10 * n + k, 9.0), (float(x), 12.0, float(z)), role)
    for n, (role, spots) in enumerate(SPOTS.items())
    for k, (x, z) in enumerate(spots)
)
NOISE_PX, SHARE, RHO, KEY_PX = 0.0015, 0.75, 0.96, 0.0012  # as H.264 with crf 18 leaves them
FILM, STILL, REST, KEY = 300, 320, 18, 200
PX_PER_MM = 6.0


def lasting(rng: np.random.Generator, frames: int, count: int, share: float, rho: float) -> Array:
    """Noise (t,n) of variance 1: white, and a share of it that lasts."""
    white, shock = rng.standard_normal((2, frames, count))
    slow = np.empty_like(shock)
    slow[0] = shock[0]
    for t in range(1, frames):
        slow[t] = rho * slow[t - 1] + np.sqrt(1.0 - rho**2) * shock[t]
    return np.sqrt(1.0 - share) * white + np.sqrt(share) * slow


@pytest.mark.parametrize(("share", "rho"), [(0.0, 0.0), (1.0, 0.4), (0.75, 0.96), (0.5, 0.9)])
def test_memory_of_noise_is_found(share: float, rho: float) -> None:
    error = 1e-3 * lasting(np.random.default_rng(1), 320, 48, share, rho)
    error[40:60, 3] = np.nan  # a mark that was hidden
    found = persistence_of(error - np.nanmean(error, axis=0))
    for count in (1, 10, 100):
        true = of_mean(np.array(share), np.array(rho), count)
        # 48 marks in 320 frames, of which 12 are independent where 0.75 lasts with 0.96: 2 / (48 * 12) of a
        # variance, squared; the mean of each mark is taken off, which costs a tenth of what lasts.
        assert found.of_mean(count) / true == pytest.approx(1.0, abs=0.25)
    assert found.lasting == pytest.approx(share, abs=0.1)
    assert found.rho == pytest.approx(rho, abs=0.06)


def test_mean_of_noise_that_lasts_scatters_as_told() -> None:
    mean = lasting(np.random.default_rng(2), 18, 20000, SHARE, RHO).mean(axis=0)
    # 20000 means tell a variance to 1 %
    assert mean.var() == pytest.approx(of_mean(np.array(SHARE), np.array(RHO), 18), rel=0.04)


def filmed(rng: np.random.Generator, frames: int, move: Array, key: int, share: float) -> Followed:
    """Marks as a compressed film shows them; move: (t,m,2) mm."""
    nominal = np.array([m.position for m in MARKS])[:, [0, 2]] + move
    ideal = np.array([1.0, -1.0]) * PX_PER_MM * (nominal - (45.0, -20.0)) + (640.0, 360.0)
    noise = NOISE_PX * lasting(rng, frames, 2 * len(MARKS), share, RHO if share else 0.0)
    if key:
        noise += np.where(
            np.arange(frames)[:, None] < key, *(KEY_PX * rng.standard_normal((2, 1, noise.shape[1])))
        )
    warp = np.tile(np.diag([27.0, -27.0, 1.0]), (frames, len(MARKS), 1, 1))
    ideal = ideal + noise.reshape(ideal.shape)
    warp[..., :2, 2] = ideal
    covariance = np.tile(NOISE_PX**2 * np.eye(2), (frames, len(MARKS), 1, 1))
    method = np.full((frames, len(MARKS)), Method.REGISTERED, np.int8)
    return Followed(
        time=np.arange(frames) / 10.0, warp=warp, ideal=ideal, covariance=covariance, method=method,
        growth=np.ones(method.shape), reference=np.arange(REST),
    )  # fmt: skip


def measured_draw(
    seed: int, moves: Array | None = None, *, key: bool = True, share: float = SHARE
) -> Displacements:
    """A film whose finger rises and falls, measured; moves: (t,m,2) mm of marks besides."""
    rng = np.random.default_rng(seed)
    move = np.zeros((FILM, len(MARKS), 2))
    if moves is not None:
        move += moves
    finger = [m.role == "finger" for m in MARKS]
    move[:, finger, 1] -= (20.0 * course())[:, None]
    film = filmed(rng, FILM, move, KEY if key else 0, share)
    still = filmed(rng, STILL, np.zeros((STILL, len(MARKS), 2)), 250 if key else 0, share)
    keys, still_keys = (np.array([0, k]) if key else np.arange(FILM) for k in (KEY, 250))
    codec = Codec(*np.full((4, 3), 1e-3)) if key else Codec(*np.zeros((4, 3)))
    seen = Seen(camera=LENS, film=film, still=still, codec=codec, keys=keys, still_keys=still_keys)
    return displacements_of([seen], MARKS, stated=TINY)


def course() -> Array:
    """Pressure (t,) from 0 up to 1 and down again."""
    return np.interp(np.arange(FILM), [0, 20, 60, 150, 180, FILM], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])


def smooth_chi2(found: Displacements, key: int = KEY) -> tuple[float, int]:
    """Chi2 of the fixed marks along four smooth functions of time, and its number, by the whole covariance."""
    fixed = [p for p, role in enumerate(found.roles) if role == "fixed"]
    steps = np.arange(len(found.time))
    x = course()[: len(steps)]
    shapes = np.stack([x, x**2, steps >= key, steps / FILM], axis=1).astype(float)
    shapes -= shapes[found.reference].mean(axis=0)
    weight = np.linalg.pinv(shapes)  # amplitudes of a field's course
    memory, total, count = found.noise.persistence, 0.0, 0
    lag = np.abs(np.subtract.outer(steps, steps))
    time = memory.lasting * memory.rho**lag + (1.0 - memory.lasting) * np.eye(len(steps))
    for axis in (0, 2):
        value = found.value[:, fixed, axis]
        sd = np.sqrt(np.diagonal(found.covariance, axis1=2, axis2=3)[:, fixed, axis].mean(axis=0))
        rows = 3 * np.array(fixed) + axis
        spread = found.noise.correlation[np.ix_(rows, rows)] * np.outer(sd, sd)
        amplitude = (weight @ value).ravel()
        modes = np.einsum("as,ksp->kap", weight, found.modes[:, :, fixed, axis]).reshape(len(found.modes), -1)
        covariance = np.kron(weight @ time @ weight.T, spread) + modes.T @ modes
        total += float(amplitude @ np.linalg.solve(covariance, amplitude))
        count += len(amplitude)
    return total, count


@pytest.mark.parametrize(("key", "share"), [(True, SHARE), (False, 0.0)], ids=["compressed", "lossless"])
@pytest.mark.parametrize("draws", [6, pytest.param(40, marks=pytest.mark.slow)])
def test_fixed_marks_keep_their_noise_in_slow_courses(key: bool, share: float, draws: int) -> None:
    found = np.array([smooth_chi2(measured_draw(seed, key=key, share=share)) for seed in range(draws)])
    ratio = found[:, 0].sum() / found[:, 1].sum()
    # 40 amplitudes a film share the noise's own estimate: over 40 films they scatter as 34 do. With the lag-1
    # correlation alone it is 3, without key frames 1.6. Coding is told to leave more here than is drawn: 0.72 in
    # docs/records/film-accuracy.md.
    low, high = band(34 * draws)
    assert low < np.sqrt(ratio / (0.72 if key else 1.0)) < high


def test_a_frame_that_really_moves_is_seen() -> None:
    moves = np.zeros((FILM, len(MARKS), 2))
    moves[:, 8] = 0.003 * course()[:, None]  # mm, a fixed mark goes with the finger
    total, count = smooth_chi2(measured_draw(0, moves))
    assert chi2.sf(total, count) < 1e-6
    moves[:, 8], moves[:, 2] = 0.0, 0.01 * course()[:, None]  # a frame mark, which takes all others with it
    total, count = smooth_chi2(measured_draw(0, moves))
    assert chi2.sf(total, count) < 1e-6


def test_stretches_between_key_frames() -> None:
    assert stretches(np.array([0, 250]), 424) == [slice(0, 250), slice(250, 424)]
    assert stretches(np.array([], dtype=int), 10) == [slice(0, 10)]
    assert rare(stretches(np.array([0, 250]), 260))
    assert rare(stretches(np.array([0]), 320))  # one key frame: what moves still stirs the rest
    assert not rare(stretches(np.arange(0, 320, 30), 320))  # the static film's own persistence holds these


def test_a_restless_mark_keeps_its_own_noise() -> None:
    """One of the marks scatters three times as much, slowly: it is not told the others' sd."""
    rng = np.random.default_rng(5)
    quiet = filmed(rng, STILL, np.zeros((STILL, len(MARKS), 2)), 0, SHARE)
    loose = replace(quiet, ideal=quiet.ideal.copy())
    loose.ideal[:, -1] += 0.01 * np.sin(np.arange(STILL) / 30.0)[:, None]
    seen = Seen(camera=LENS, film=loose, still=loose, codec=Codec(*np.zeros((4, 3))))
    sd = displacements_of([seen], MARKS, stated=TINY).noise.sd
    assert sd[-1, 0] > 2.0 * np.median(sd[:-1, 0])


@pytest.mark.slow
def test_fixed_marks_of_a_film_that_h264_coded(lab: Any, tmp_path: Path) -> None:
    """A finger that bends beside four fixed marks, 300 frames with a key frame at 250, and as many of rest."""
    ratio = []
    for seed in (11, 21):
        still = lab.film(tmp_path / f"still{seed}.mp4", np.zeros(STILL), codec="libx264", seed=seed)
        film = lab.film(tmp_path / f"film{seed}.mp4", 0.012 * course(), codec="libx264", seed=seed + 1)
        assert film.keys().tolist() == [0, 250]
        found = measure([View(film, still, lab.camera)], lab.marks, reference=1.8)
        assert any(name.endswith("key1") for name in found.mode_names)
        total, count = smooth_chi2(found, 250)
        ratio.append(total / count)
    # 64 amplitudes of two films count as 54, as above: chance leaves 0.80 to 1.20. The films have 1.27, as the sd
    # of markers at rest is off by up to 1.42 for a single setting of the coder (docs/records/film-accuracy.md).
    # With the lag-1 correlation alone it is 1.7.
    low, _ = band(2 * 54)
    assert low < np.sqrt(np.mean(ratio)) < 1.42
