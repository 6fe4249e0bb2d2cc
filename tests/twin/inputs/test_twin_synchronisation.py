"""Film and pressure log on one clock: by a flash and by the onset of motion, with the sd that is stated."""

from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest

from tests.messages import saying
from twin.commands.init import film_config
from twin.commands.measure import _even
from twin.gauge.onset import ByOnset, onset_join, whole_film
from twin.gauge.pressurelog import Log, read_log
from twin.gauge.pressuretable import PressureTable
from twin.gauge.synchrony import Join, Motion
from twin.inputs.synchronisation import WAYS, ByLamp, ByStamps, joining_of, lamp_join
from twin.project.toml import dump, parse
from vision import Video
from vision.film.flash import flash_onset
from vision.film.video import Writer
from vision.placing.views import even_steps

HZ, FPS = 200.0, 20.0


def make_log(*, rises=(8.0,), seed=0, noise=2e-5):
    """A log of 30 s: rest, then a rise over 1.5 s at every time given, held for 3 s."""
    time = np.arange(0.0, 30.0, 1 / HZ)
    pressure = np.zeros_like(time)
    for at in rises:
        pressure += 0.03 * np.interp(time, [at, at + 1.5, at + 4.5, at + 5.0], [0.0, 1.0, 1.0, 0.0])
    return Log(Path("pressure.csv"), time, pressure + noise * np.random.default_rng(seed).normal(size=len(time)))


def motion(log, start, *, seed, noise=0.01, late=0.0):
    """A finger (time, motion mm) that bends with 40 p + 500 p2 mm, filmed from `start` s of the log."""
    time = np.arange(0, 14 * FPS) / FPS
    clean = make_log(noise=0.0)
    p = np.interp(time + start - late, clean.time, clean.pressure)
    return time, 400 * p + 12000 * p**2 + noise * np.random.default_rng([seed, 7]).normal(size=len(time))


def test_pulls_of_the_join_by_onset():
    pulls = []
    for seed in range(30):
        start = 4.0 + 2.0 * np.random.default_rng([seed, 3]).random()
        log = make_log(seed=seed)
        join = onset_join(Motion(*motion(log, start, seed=seed), 0.01), log)
        assert join.sd_s < 0.01
        pulls.append((join.start_s - start) / join.sd_s)
    # 30 draws: the rms of the pulls is known to 13 %
    assert 0.65 < np.sqrt(np.mean(np.square(pulls))) < 1.4


def test_a_lag_of_the_finger_is_said_and_taken_for_the_clocks():
    log = make_log()
    join = onset_join(Motion(*motion(log, 5.0, seed=1, late=0.1), 0.01), log)
    assert join.start_s == pytest.approx(4.9, abs=0.01)
    assert "A lag of the finger itself cannot be told from one of the clock." in join.remark


def test_steps_of_a_long_film_are_joined_without_the_density_of_its_reference():
    pulls = []
    for seed in range(30):
        start = 4.0 + 2.0 * np.random.default_rng([seed, 3]).random()
        log = make_log(seed=seed)
        time, moved = motion(log, start, seed=seed)
        steps = np.union1d(np.arange(40), even_steps(len(time), 140))  # 2 s at rest are whole
        film = SimpleNamespace(time=time[steps], tracks=SimpleNamespace(time=time), most_steps=140)
        even = _even(film)
        assert np.diff(time[steps][even]).min() > 1.5 / FPS
        join = onset_join(Motion(time[steps][even], moved[steps][even], 0.01), log)
        pulls.append((join.start_s - start) / join.sd_s)
    assert 0.65 < np.sqrt(np.mean(np.square(pulls))) < 1.27  # with the scatter over rest and rise alike it is 1.35
    assert _even(SimpleNamespace(time=time, tracks=SimpleNamespace(time=time), most_steps=280)).all()


def test_a_rise_of_few_steps_is_refused():
    log = make_log()
    time, moved = motion(log, 5.0, seed=1)
    with pytest.raises(ValueError, match=saying("[3-6]", "8", r"\[measure\]")):
        onset_join(Motion(time[::4], moved[::4], 0.01), log)


def test_two_rises_in_the_log_are_not_guessed_at():
    log = make_log(rises=(6.0, 15.0))
    time, moved = motion(log, 5.0, seed=1)
    with pytest.raises(ValueError, match=r"fits pressure.csv at \d+\.\d+ s and at \d+\.\d+ s; cut the log"):
        onset_join(Motion(time[: int(6 * FPS)], moved[: int(6 * FPS)], 0.01), log)


def test_a_film_of_two_rises_fits_the_log_once():
    at = (6.0, 13.0)  # s of the log; the film holds both rises, and the second of them fits the first, too
    for seed in range(8):
        log, clean = make_log(rises=at, seed=seed), make_log(rises=at, noise=0.0)
        start = 3.0 + np.random.default_rng([seed, 3]).random()
        time = np.arange(0, 16 * FPS) / FPS
        p = np.interp(time + start, clean.time, clean.pressure)
        crept = 0.02 * np.cumsum(p) / FPS  # a tenth of the motion
        moved = 400 * (p + crept) + 12000 * p**2 + 0.01 * np.random.default_rng([seed, 7]).normal(size=len(time))
        join = onset_join(Motion(time, moved, 0.01), log)
        assert abs(join.start_s - start) < max(4 * join.sd_s, 0.01)
        assert whole_film(Motion(time[::8], moved[::8], 0.01), log) == pytest.approx(start, abs=0.5)


def test_no_motion_and_a_short_log_are_refused():
    log = make_log()
    time = np.arange(0, 5, 1 / FPS)
    with pytest.raises(ValueError, match=r"moves by 0.0\d+ mm in the film, wanted 30 times the noise of 0.0100"):
        onset_join(Motion(time, np.abs(0.01 * np.random.default_rng(0).normal(size=len(time))), 0.01), log)
    with pytest.raises(ValueError, match=r"covers 29.995 s, the film 40.000 s"):
        onset_join(Motion(np.linspace(0, 40, 400), np.linspace(0, 10, 400), 0.01), log)


def lamp_film(path, onset, *, exposure, seed):
    """A film of 20 frames/s with a lamp at (30, 20) that goes on at `onset` s, exposed for a share of the frame."""
    rng = np.random.default_rng([seed, 5])
    with Writer(path, (64, 48), fps=FPS, codec="ffv1", crf=0) as writer:
        for k in range(40):
            middle, length = k / FPS, exposure / FPS
            share = np.clip((middle + length / 2 - onset) / length, 0.0, 1.0)
            grey = np.full((48, 64), 60.0)
            grey[20:30, 30:40] += 120 * share
            writer.add(np.clip(np.rint(grey + rng.normal(size=grey.shape)), 0, 255).astype(np.uint8))
    return Video(path)


# 60 draws: the rms of the pulls is known to 9 %. A short exposure is what the sd is for; a long one, which
# the film does not tell, places the onset better.
@pytest.mark.parametrize(("exposure", "low", "high"), [((0.01, 0.1), 0.75, 1.25), ((0.1, 1.0), 0.4, 1.1)])
def test_pulls_of_the_join_by_flash(tmp_path, exposure, low, high):
    pulls = []
    for seed in range(60):
        rng = np.random.default_rng([seed, 9])
        onset = 1.0 + rng.random() / FPS
        film = lamp_film(tmp_path / f"{seed}.mkv", onset, exposure=rng.uniform(*exposure), seed=seed)
        found, sd = flash_onset(film, (28, 18, 14, 14))
        assert sd < 0.6 / FPS
        pulls.append((found - onset) / sd)
    assert low < np.sqrt(np.mean(np.square(pulls))) < high


def test_flash_and_log_make_a_join(tmp_path):
    lines = [f"{t:.3f},0.0,{int(t >= 3.0)}" for t in np.arange(0, 6, 0.01)]
    (tmp_path / "p.csv").write_text("time_s,pressure_MPa,flash\n" + "\n".join(lines) + "\n")
    log = read_log(tmp_path / "p.csv", time_shift_s=100.0)
    join = lamp_join(1.25, 0.004, log, on_s=None)
    assert join.start_s == pytest.approx(103.0 - 0.005 - 1.25, abs=1e-9)
    assert join.sd_s == pytest.approx(np.hypot(0.004, 0.01 / np.sqrt(12)), rel=1e-6)
    assert lamp_join(1.25, 0.004, log, on_s=50.0).start_s == 48.75
    with pytest.raises(ValueError, match="column flash is missing or does not go from 0 to 1"):
        lamp_join(1.25, 0.004, make_log(), on_s=None)


def test_a_region_without_a_lamp_is_refused(tmp_path):
    film = lamp_film(tmp_path / "lamp.mkv", 1.0, exposure=0.5, seed=0)
    with pytest.raises(ValueError, match="shows no lamp going on in the flash region"):
        flash_onset(film, (0, 0, 10, 10))
    with pytest.raises(ValueError, match=r"flash region \[60, 0, 10, 10\] leaves the picture of 64 x 48 px"):
        flash_onset(film, (60, 0, 10, 10))


def test_a_flash_needs_its_region():
    text = dump(film_config("batch")).replace('join = "stamps"', 'join = "flash"')
    with pytest.raises(ValueError, match=r'join = "flash" needs flash_region'):
        parse(text.encode(), name="twin.toml")


def test_each_join_of_twin_toml_is_one_way():
    assert get_args(PressureTable.model_fields["join"].annotation) == tuple(WAYS)
    config = film_config("batch")
    camera = config.cameras[0].model_copy(update={"film_start_s": 3.0})
    table = PressureTable(join="flash", flash_region=(1, 2, 3, 4), flash_time_s=9.0, sync_sd_s=0.01)
    assert joining_of(table, camera) == ByLamp((1, 2, 3, 4), 9.0)
    assert joining_of(table.model_copy(update={"join": "stamps"}), camera) == ByStamps(3.0, 0.01)
    assert joining_of(table.model_copy(update={"join": "onset"}), camera) == ByOnset()


def test_only_the_onset_asks_for_the_displacements(tmp_path):
    film, log = lamp_film(tmp_path / "lamp.mkv", 1.0, exposure=0.5, seed=0), make_log()
    seen, asked = Motion(*motion(log, 5.0, seed=1), 0.01), []

    def measured():
        asked.append(1)
        return seen

    assert ByStamps(5.0, 0.01).join(film, log, measured) == Join(5.0, 0.01, "")
    assert ByLamp((28, 18, 14, 14), 20.0).join(film, log, measured).start_s == pytest.approx(19.0, abs=0.05)
    assert asked == []
    assert ByOnset().join(film, log, measured) == onset_join(seen, log)
    assert asked == [1]
