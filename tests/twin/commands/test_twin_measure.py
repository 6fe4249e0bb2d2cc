"""camera and measure: the join of film and pressure log, the gauge noise, and targets that are never lost."""

import dataclasses
import types
from pathlib import Path

import numpy as np
import pytest

import vision
import vision.drawing.overlays
import vision.film.series
from tests.messages import Lines
from twin import files
from twin.commands.camera import run_camera
from twin.commands.check import run_check
from twin.commands.init import film_config
from twin.commands.measure import run_measure
from twin.gauge.pressurelog import Log, check_covers, gauge_noise, read_log
from twin.gauge.synchrony import Join
from twin.inputs import filmcheck
from twin.inputs.filmtargets import make_targets
from twin.project.cameratables import MeasureTable
from twin.project.folder import Project
from twin.project.toml import dump
from vision.errors.errorbudget import budget

FPS, FRAMES, STATIC = 10.0, 60, 50  # film from 100 s on, static film from 90 s on, log 50 Hz from 89 to 107 s
GAUGE = 2e-5  # MPa


def log_text(*, seed=0, start=89.0, end=107.0):
    time = np.arange(start, end, 0.02)
    pressure = 0.03 * np.clip((time - 102) / 2, 0, 1) + GAUGE * np.random.default_rng(seed).normal(
        size=len(time)
    )
    return "time_s,pressure_MPa\n" + "".join(
        f"{t:.3f},{p:.8f}\n" for t, p in zip(time, pressure, strict=True)
    )


@pytest.fixture
def project(tmp_path):
    """A project whose films and images are stand-ins: what vision makes of them is patched in `measured`."""
    config = film_config("batch")
    camera = config.cameras[0].model_copy(update={"film_start_s": 100.0, "static_start_s": 90.0})
    places = {"tip": (110.0, 12.0, 0.0), "middle": (62.0, 12.0, 0.0)}
    points = tuple(p.model_copy(update={"position_mm": places[p.name]}) for p in config.points)
    config = config.model_copy(update={"cameras": (camera,), "points": points, "measure": MeasureTable()})
    files.write_text(tmp_path / "twin.toml", dump(config))
    for name in ("film.mp4", "static.mp4", "boards/b1.png", "boards/b2.png"):
        files.write_text(tmp_path / "raw" / name, name)
    files.write_text(tmp_path / "raw" / "pressure.csv", log_text())
    return Project.open(tmp_path)


def displacements(marks, time, *, seed=0):
    """What vision.measure gives for these marks: NaN across the picture plane, tip lost in frame 7."""
    rng = np.random.default_rng(seed)
    shown = [m for m in marks if m.role != "frame"]
    s, p, n = len(time), len(shown), len(marks)
    value = rng.normal(scale=0.02, size=(s, p, 3))
    finger = np.array([m.role == "finger" for m in shown])
    value[..., 2] -= 20.0 * finger * np.clip((time[:, None] - 2.0) / 2.0, 0.0, 1.0)  # with the pressure
    value[..., 1] = np.nan
    value[7, [m.name for m in shown].index("tip")] = np.nan
    seen = np.isfinite(value)
    covariance = np.where(seen[..., :, None] & seen[..., None, :], 4e-4 * np.eye(3), np.nan)
    sd = np.full((p, 3), 0.02)
    noise = vision.NoiseModel(
        sd=sd, rho=np.zeros((p, 3)), correlation=np.eye(3 * p), frames=STATIC, codec_sd=0.1 * sd
    )
    tracks = vision.Tracks(
        time=time, names=tuple(m.name for m in marks), position=np.zeros((s, n, 2)),
        covariance=np.zeros((s, n, 2, 2)), rotation=np.zeros((s, n)), method=np.ones((s, n), dtype=np.int8),
    )  # fmt: skip
    return vision.Displacements(
        time=time, names=tuple(m.name for m in shown), roles=tuple(m.role for m in shown),
        points=np.array([m.position for m in shown]), measured=(False,) * len(shown), value=value, covariance=covariance,
        modes=0.001 * value[None], mode_names=("scale",), noise=noise, reference=np.arange(18),
        tracks=tracks, homography=np.tile(np.eye(3), (s, 1, 1)), lost=("tip is lost in 1 frame",),
        budget=budget({}, 0.001 * value[None], ("scale",), seen.any(axis=2)), remarks=(),
    )  # fmt: skip


def no_outline(*_):
    raise ValueError("the film is a stand-in")


@pytest.fixture
def measured(monkeypatch):
    """Vision replaced by stand-ins; `calls` counts what was worked out."""
    calls = types.SimpleNamespace(camera=[], measure=[])

    def calibrate_camera(images, board, *, max_rms_px, mirrored):
        calls.camera.append((images, board, max_rms_px))
        return vision.Camera(np.eye(3), np.zeros(5), (1280, 720), 0.11, len(images))

    def video(path, *, fps, mirrored=False):
        frames = FRAMES if Path(path).name.startswith("film") else STATIC
        return types.SimpleNamespace(time=np.arange(frames) / FPS, issues=())

    def measure(views, marks, *, reference, rig, face, dictionary, stated, steps, progress, keeper):
        assert (rig, face) == (None, None)
        assert steps(["scale"], 8, 18) == 2000
        progress("track", 1, len(views[0].film.time))
        calls.measure.append((views[0].camera, marks, dictionary, stated, reference))
        return displacements(marks, views[0].film.time, seed=len(calls.measure))

    monkeypatch.setattr(vision, "calibrate_camera", calibrate_camera)
    monkeypatch.setattr(vision.film.series, "open_film", video)
    monkeypatch.setattr(vision, "measure", measure)
    monkeypatch.setattr("twin.commands.measure.seen_outline", no_outline)
    monkeypatch.setattr(vision.drawing.overlays, "overlay", lambda film, tracks: np.zeros((4, 6, 3), np.uint8))
    return calls


def edit(project, old, new):
    text = (project.root / "twin.toml").read_text()
    assert old in text
    files.write_text(project.root / "twin.toml", text.replace(old, new, 1))
    return Project.open(project.root)


def test_film_and_log_become_targets(project, measured):
    run_camera(project, Lines())
    say = Lines()
    result = run_measure(project, say)
    targets = project.targets()
    assert targets.points[targets.names.index("tip")].node == 4401
    assert targets.fixed.sum() == 4
    np.testing.assert_allclose(targets.time, 100 + np.arange(FRAMES) / FPS, rtol=0, atol=1e-12)
    # every film frame falls on a sample of the log here, so the pressure is that sample, noise and all
    log = np.genfromtxt(project.root / "raw/pressure.csv", delimiter=",", names=True)
    at = [int(np.argmin(np.abs(log["time_s"] - t))) for t in targets.time]
    np.testing.assert_allclose(targets.pressure, log["pressure_MPa"][at], rtol=0, atol=2e-9)  # 1e-9 is kept
    assert targets.reference.tolist() == list(range(18))
    assert not targets.valid[7, targets.names.index("tip")].any()
    assert not targets.valid[..., 1].any()
    assert targets.noise is not None
    # 250 samples: the sd of differences is known to about 6 %; 25 % is 4 sds
    assert targets.noise.gauge_sd_MPa == pytest.approx(GAUGE, rel=0.25)
    assert targets.noise.gauge_frames == pytest.approx(245, abs=1)  # 4.9 s of static film at 50 Hz
    np.testing.assert_allclose(targets.pressure_sd, targets.noise.gauge_sd_MPa, rtol=1e-6)
    assert "tip is lost in 1 frame" in say
    assert result["remarks"] == ["tip is lost in 1 frame"]
    (camera, marks, *settings) = measured.measure[0]
    assert (camera.rms_px, len(marks), settings) == (0.11, 12, ["DICT_4X4_50", vision.Stated(), 1.8])
    assert (project.root / "runs/0002-measure/overlay.png").read_bytes().startswith(b"\x89PNG")
    tracks = files.read_npz(project.root / "runs/0002-measure/tracks.npz")
    assert set(tracks) == {"time", "names", "position", "covariance", "rotation", "method", "methods", "homography"}
    assert tracks["methods"].tolist()[:2] == ["lost", "registered"]


@pytest.mark.parametrize("stated", [False, True])
def test_steps_that_memory_leaves_are_told_and_stated_ones_are_taken(project, measured, monkeypatch, stated):
    asked, drawn = [], vision.measure

    def measure(views, marks, *, steps, **how):
        asked.append(steps)
        moved = drawn(views, marks, steps=lambda names, values, rest: 2000, **how)
        return dataclasses.replace(moved, most_steps=FRAMES - 1)

    monkeypatch.setattr(vision, "measure", measure)
    if stated:
        project = edit(project, "[measure]", "[measure]\nsteps = 59")
    run_camera(project, Lines())
    say = Lines()
    run_measure(project, say)
    assert [line for line in say.lines if "leave room for no more" in line] == ([] if stated else [say.lines[-2]])
    assert asked == [59] if stated else asked[0]([f"codec:{k}" for k in range(2000)], 200, 40) < 200


def test_a_rolling_shutter_is_stated_as_an_error_and_not_corrected(project, measured, monkeypatch):
    """28 ms over 720 rows: a tip at row 630 is read 10.5 ms late, at 10 mm/s 0.105 mm; none in the middle."""
    inner = vision.measure

    def measure(*args, **how):
        found = inner(*args, **how)
        place = np.full(found.tracks.position.shape, 360.0)
        place[:, found.tracks.names.index("tip"), 1] = 630.0
        return dataclasses.replace(found, tracks=dataclasses.replace(found.tracks, position=place))

    def video(path, *, fps, mirrored=False):
        count = FRAMES if Path(path).name.startswith("film") else STATIC
        return types.SimpleNamespace(time=np.arange(count) / FPS, issues=(), turns=0, height=720, width=1280)

    monkeypatch.setattr("vision.measure", measure)
    monkeypatch.setattr("twin.commands.measure.seen_outline", no_outline)
    monkeypatch.setattr("vision.film.series.open_film", video)
    plain = project
    project = edit(plain, "# readout_ms = ...", "readout_ms = 28.0")
    run_camera(project, Lines())
    result = run_measure(project, Lines())
    targets = project.targets()
    assert targets.mode_names == ("scale", "sync", "readout")
    clock, mode = targets.modes[1:]
    tip = targets.names.index("tip")
    np.testing.assert_allclose(mode[:, tip] * 0.002, clock[:, tip] * 0.0105, atol=1e-12)
    assert -mode[25:35, tip, 2].mean() == pytest.approx(0.105, rel=0.3)  # places have a noise of 0.02 mm
    assert not np.delete(mode, tip, axis=1).any()
    budget = (project.root / "runs/0002-measure/budget.csv").read_text()
    assert float(next(line for line in budget.splitlines() if line.startswith("tip,readout")).split(",")[4]) > 0.04
    assert any("in 28 ms (readout_ms). Markers that move far" in said for said in result["remarks"])


def test_nothing_is_measured_twice(project, measured):
    for _ in range(2):
        say = Lines()
        run_camera(project, say)
        result = run_measure(project, say)
    assert (len(measured.camera), len(measured.measure)) == (1, 1)
    assert result["status"] == "skipped"
    assert all("skipped" in line for line in say)
    assert (
        run_measure(project.set_effects(["creep"]), Lines())["status"] == "skipped"
    )  # the model changes no film


def test_targets_of_other_inputs_are_kept(project, measured):
    run_camera(project, Lines())
    run_measure(project, Lines())
    old = (project.root / "targets/targets.csv").read_bytes()
    files.write_text(project.root / "raw/pressure.csv", log_text(seed=1))
    with pytest.raises(
        ValueError, match=r"never overwritten; `twin measure --replace` keeps them as targets-0001"
    ):
        run_measure(project, Lines())
    assert (project.root / "targets/targets.csv").read_bytes() == old
    assert len(project.runs()) == 2  # the refusal left no run behind
    say = Lines()
    run_measure(project, say, replace=True)
    assert (project.root / "targets-0001/targets.csv").read_bytes() == old
    assert (project.root / "targets/targets.csv").read_bytes() != old
    assert any("kept as targets-0001" in line for line in say)


def test_a_kill_between_targets_and_done_is_mended(project, measured, monkeypatch):
    run_camera(project, Lines())
    run_measure(project, Lines())
    info = project.info(project.root / "runs/0002-measure")
    files.write_json(project.root / "runs/0002-measure/run.json", info.model_copy(update={"status": "running"}))
    assert run_measure(project, Lines())["run"] == "runs/0002-measure"
    assert project.newest("measure", "tracks.npz") is not None


def test_new_board_images_ask_for_a_new_camera(project, measured):
    with pytest.raises(ValueError, match=r"no camera.json yet; run `twin camera` first"):
        run_measure(project, Lines())
    run_camera(project, Lines())
    files.write_text(project.root / "raw/boards/b3.png", "another")
    with pytest.raises(ValueError, match=r"raw/boards/b3\.png.*run `twin camera` first"):
        run_measure(project, Lines())


@pytest.mark.parametrize(
    ("missing", "sentence"),
    [
        ("film.mp4", r"cameras.film = 'raw/film.mp4': no such file"),
        ("static.mp4", "cameras.static = 'raw/static.mp4'"),
        ("pressure.csv", "pressure.file = 'raw/pressure.csv'"),
    ],
)
def test_a_missing_file_is_named(project, measured, missing, sentence):
    run_camera(project, Lines())
    (project.root / "raw" / missing).unlink()
    with pytest.raises(ValueError, match=sentence):
        run_measure(project, Lines())
    assert measured.measure == []


def test_the_times_beside_a_pattern_of_pictures_are_read_again(project, measured):
    for name in ("film", "static"):
        files.write_text(project.root / f"raw/{name}-1.png", name)
        project = edit(project, f"raw/{name}.mp4", f"raw/{name}-*.png")
    files.write_text(project.root / "raw/times.csv", "file,time_s")
    run_camera(project, Lines())
    run_measure(project, Lines())
    run_measure(project, Lines())
    assert len(measured.measure) == 1
    files.write_text(project.root / "raw/times.csv", "file,time_s\n")
    run_measure(project, Lines(), replace=True)
    assert len(measured.measure) == 2


def test_missing_boards_are_named(project, measured):
    with pytest.raises(ValueError, match=r"cameras.boards = 'raw/none/\*.png': no file matches"):
        run_camera(edit(project, "raw/boards/*.png", "raw/none/*.png"), Lines())


@pytest.mark.parametrize(
    ("log", "sentence"),
    [
        (
            log_text(start=101.0),
            r"pressure.csv covers 101.000 to 106.980 s, the film 100.000 to 105.900 s of",
        ),
        (log_text(start=101.0), "time_shift_s or film_start_s"),
        (log_text(end=105.0), "the film 100.000 to 105.900 s"),
        (log_text(start=91.0), "the static film 90.000 to 94.900 s.*static_start_s"),
        (
            log_text().replace("89.040,", "89.020,"),
            "line 4, column time_s: '89.020': wanted more than the 89",
        ),
        (log_text().replace("89.040,", "89.04O,"), "line 4, column time_s: '89.04O': wanted a finite number"),
        (log_text().replace("pressure_MPa", "flow"), "column pressure_MPa is missing.*time_s,flow"),
        (log_text().replace("pressure_MPa", "pressure_kPa"), "pressure_kPa reaches .* MPa, read in kPa; wanted 0.0001 to 1"),
        ("time_s,pressure_MPa\n80,0\n120,30\n", "reaches 30 MPa, .* the numbers are likely in kPa"),
    ],
)
def test_a_log_that_does_not_fit_is_refused_before_the_film_is_read(project, measured, log, sentence):
    run_camera(project, Lines())
    files.write_text(project.root / "raw/pressure.csv", log)
    with pytest.raises(ValueError, match=sentence):
        run_measure(project, Lines())
    assert measured.measure == []
    assert not (project.root / "targets").exists()


def test_check_reads_the_log_before_anything_is_measured(project, measured, monkeypatch):
    monkeypatch.setattr(filmcheck, "check_films", lambda *_, **__: None)  # the films are stand-ins
    say, kilo = Lines(), log_text().replace("pressure_MPa", "pressure_kPa").splitlines()
    rows = [row.split(",") for row in kilo[1:]]
    files.write_text(project.root / "raw/pressure.csv", "\n".join([kilo[0], *(f"{t},{1e3 * float(p)!r}" for t, p in rows)]))
    run_check(project, say)
    assert any("column 'pressure_kPa', in kPa" in line and "The film lasts 5.9 s" in line for line in say)
    files.write_text(project.root / "raw/pressure.csv", log_text(end=105.0))
    with pytest.raises(ValueError, match=r"covers 89.000 to 10.* s, the film 100.000 to 105.900 s of the same clock"):
        run_check(project, say)
    project = edit(project, 'join = "stamps"', 'join = "onset"')
    files.write_text(project.root / "raw/pressure.csv", log_text(start=100.0, end=105.0))
    with pytest.raises(ValueError, match=r"the film 5.900 s: wanted a log that covers all of it; record"):
        run_check(project, say)


def test_a_time_shift_moves_the_log(tmp_path):
    files.write_text(tmp_path / "p.csv", log_text(start=0.0, end=2.0))
    assert read_log(tmp_path / "p.csv", time_shift_s=100.0).time[0] == 100.0


def test_a_repeated_time_stamp_keeps_the_first_frame(project):
    from vision import Mark
    from vision.kinds import CodedMarker

    marks = [Mark("tip", CodedMarker(0, 6.0), (100.0, 12.0, 0.0), "finger"),
             Mark("F", CodedMarker(1, 6.0), (0.0, 12.0, 9.0), "fixed")]
    time = np.arange(30) / FPS
    time[5] = time[4]
    moved = displacements(marks, time)
    log = Log(Path("p.csv"), np.linspace(-1, 5, 600), np.zeros(600))
    gauge = gauge_noise(Log(log.path, log.time, np.random.default_rng(0).normal(size=600)), start=0, end=3)
    targets = make_targets(moved, log, join=Join(0.0, 0.01, ""), gauge=gauge, nodes={"tip": 4401})
    assert len(targets.time) == 29
    assert targets.reference.tolist() == list(range(17))  # 18 frames, one of them a repeat
    np.testing.assert_allclose(targets.value[5], moved.value[6], atol=1e-6)  # rounded to a nanometre


def make_log(pressure):
    return Log(Path("pressure.csv"), np.arange(len(pressure)) / 50, np.asarray(pressure, dtype=float))


@pytest.mark.parametrize("seed", range(5))
def test_gauge_noise_ignores_drift(seed):
    noise = np.random.default_rng(seed).normal(size=1000)
    found = gauge_noise(make_log(GAUGE * (noise + np.linspace(0, 20, 1000))), start=0, end=100)
    # sd of the sd from 1000 differences: 2.7 %; 12 % is more than 4 of them. With the drift it would be 590 %
    assert found.sd_MPa == pytest.approx(GAUGE, rel=0.12)
    assert found.remark == ""


def test_filtered_gauge_noise_is_not_understated():
    white = np.random.default_rng(0).normal(size=3000)
    smooth = GAUGE * np.convolve(white, np.ones(9) / 3, mode="valid")  # sd GAUGE, correlated over 9 samples
    found = gauge_noise(make_log(smooth), start=0, end=100)
    assert "not white" in found.remark
    # 2992 samples, about 330 independent: sd of the sd 4 %; differences alone say a third of it
    assert found.sd_MPa == pytest.approx(GAUGE, rel=0.15)


def test_a_log_without_noise_says_so():
    found = gauge_noise(make_log(np.zeros(100)), start=0, end=100)
    assert (found.sd_MPa, found.samples) == (0.0, 100)
    assert "too coarse" in found.remark


def test_too_short_a_rest_is_refused():
    with pytest.raises(
        ValueError, match=r"pressure.csv: 26 samples between 0.000 and 0.500 s.*wanted 30 or more"
    ):
        gauge_noise(make_log(np.arange(100.0)), start=0, end=0.5)


def test_interpolation_halves_the_variance_midway():
    log = make_log(np.zeros(10))
    np.testing.assert_allclose(
        log.gain(np.array([0.0, 0.01, 0.02, 0.18])), [1, np.sqrt(0.5), 1, 1], rtol=1e-12
    )
    rng = np.random.default_rng(3)
    seen = [make_log(rng.normal(size=10)).at(np.array([0.005]))[0] for _ in range(4000)]
    # 4000 draws: the sd is known to 1.1 %
    assert np.std(seen) == pytest.approx(log.gain(np.array([0.005]))[0], rel=0.05)


def test_a_log_that_covers_exactly_is_enough():
    check_covers(make_log(np.zeros(51)), np.array([0.0, 1.0]), what="film", key="film_start_s")
