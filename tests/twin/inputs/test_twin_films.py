"""Several films of one batch: a block, a clock, a rest and a noise model of its own for each; what is held
out enters no fit."""

from dataclasses import replace

import numpy as np
import pytest

import vision
import vision.film.series
from fe import Finger, Lattice, Material, finger_case
from fe.mesh.points import nearest
from tests.messages import saying
from tests.twin.commands.test_twin_measure import FPS, Lines, displacements, edit, log_text, measured, project  # noqa: F401
from twin import files
from twin.commands.camera import run_camera
from twin.commands.check import run_check
from twin.commands.measure import run_measure
from twin.diagnosis.diagnosisrecord import ForetoldFilm
from twin.effects.material import Elasticity
from twin.inputs import filmcheck
from twin.inputs.films import BETWEEN_S, FilmTargets, films_of, joined
from twin.judging.fitrecord import UnseenFilm
from twin.judging.heldout import unseen
from twin.judging.judged import judge
from twin.judging.whitening import whitener
from twin.model.keptmodel import base_model
from twin.project.folder import Project
from twin.project.targetfiles import read_targets, write_targets
from twin.report.page import render
from twin.targets import Noise, PointKind, TargetPoint, Targets, relative

FILMS = """
[[films]]
name = "slow"
file = "raw/film.mp4"
film_start_s = 100.0
static_start_s = 90.0
{first}
[[films]]
name = "fast"
file = "raw/film-2.mp4"
static = "raw/static-2.mp4"
pressure = "raw/pressure-2.csv"
film_start_s = 50.0
{second}
"""


def with_films(project, *, first="", second="held_out = true"):  # noqa: F811
    """The project with two films; the second has a static film and a log of its own, on another clock."""
    text = (project.root / "twin.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith(("film = ", "film_start_s", "static_start_s"))]
    new = "\n".join(lines) + "\n" + FILMS.format(first=first, second=second)
    for name in ("film-2.mp4", "static-2.mp4"):
        files.write_text(project.root / "raw" / name, name)
    rows = [row.split(",") for row in log_text(seed=5).splitlines()[1:]]
    shifted = [f"{float(t) - 50:.3f},{p}" for t, p in rows]
    files.write_text(project.root / "raw/pressure-2.csv", "\n".join(["time_s,pressure_MPa", *shifted]) + "\n")
    files.write_text(project.root / "twin.toml", new)
    return Project.open(project.root)


def test_what_the_regulator_was_set_to_is_said_of_its_own_log_alone(project):  # noqa: F811
    edit(project, "# top_kPa = ...", "top_kPa = 30.0")
    first, second = films_of(with_films(project))
    assert [film.project.config.pressure.top_kPa for film in (first, second)] == [30.0, None]


def test_every_film_is_measured_on_its_own_clock_with_its_own_noise(project, measured, monkeypatch):  # noqa: F811
    calls = []

    def measure(views, marks, **settings):
        calls.append(views[0])
        made = displacements(marks, views[0].film.time, seed=len(calls))
        sd = made.noise.sd * len(calls)
        return replace(made, noise=replace(made.noise, sd=sd))

    monkeypatch.setattr(vision, "measure", measure)
    both = with_films(project)
    run_camera(both, Lines())
    result = run_measure(both, Lines())
    t = both.targets()
    assert t.block.tolist() == [0] * 60 + [1] * 60
    assert t.held_out.tolist() == [False] * 60 + [True] * 60
    np.testing.assert_allclose(t.time[:60], 100 + np.arange(60) / FPS, rtol=0, atol=1e-9)
    first, second = result["films"]
    # log 2 covers 39 s on; it begins BETWEEN_S after the last sample that film 1 needs
    np.testing.assert_allclose(t.time[60:], 50 + second["shift_s"] + np.arange(60) / FPS, rtol=0, atol=1e-6)
    assert first["shift_s"] == 0.0
    assert second["shift_s"] == pytest.approx(106.98 + BETWEEN_S - 39.0, abs=0.03)
    # the pressure of each film is its own log's at its own time
    np.testing.assert_allclose(t.pressure[60:], t.pressure[:60], rtol=0, atol=6e-4 * 0.03 + 10 * 2e-5)
    assert [float(n.sd[0, 0]) for n in t.noises] == [0.02, 0.04]
    assert t.noise is not None
    assert t.reference.tolist() == [*range(18), *range(60, 78)]
    assert t.mode_names == ("scale", "sync@slow", "sync@fast")  # the scale is the rig's: the same in both
    assert np.isfinite(t.modes[0][t.valid]).all()
    assert not t.modes[1, 60:].any()
    say = Lines()
    run_measure(both, say)
    assert len(calls) == 2
    changed = edit(both, "film_start_s = 50.0", "film_start_s = 50.5")
    run_measure(changed, say, replace=True)
    assert len(calls) == 3  # the first film, which has not changed, is not measured again
    assert any("slow: already measured" in line for line in say)
    assert changed.targets().time[60] - t.time[60] == pytest.approx(0.5, abs=1e-6)
    run_measure(edit(changed, "held_out = true", "held_out = false"), Lines(), replace=True)
    assert len(calls) == 3
    assert not changed.targets().held_out.any()
    run_measure(Project.open(both.root), Lines(), replace=True)
    assert len(calls) == 5  # nothing has changed: all is measured again


def test_check_says_what_it_sees_of_each_film(project, measured, monkeypatch):  # noqa: F811
    monkeypatch.setattr(filmcheck, "check_films", lambda *_, **__: None)  # the films of this project are stand-ins
    say, both = Lines(), with_films(project)
    run_check(both, say)
    assert any("Film slow: pressure.csv" in line and "lasts 5.9 s" in line for line in say)
    assert any("Film fast: pressure-2.csv" in line and "held out" in line for line in say)
    (both.root / "raw/pressure-2.csv").unlink()
    with pytest.raises(ValueError, match=r"raw/pressure-2.csv \(films.fast.pressure\)"):
        run_check(both, say)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"raw/film-2.mp4"', '"raw/film.mp4"', "films.file = 'raw/film.mp4' stands twice"),
        ('name = "fast"', 'name = "slow"', "films.name = 'slow' stands twice"),
        ('static_start_s = 90.0\n', "held_out = true\n", "all 2 have held_out = true, so nothing is left to fit"),
        ("film_start_s = 50.0", "gravity = [0.0, 0.0, 1.0]", "gravity stands in fast and not in the others"),
        ("film_start_s = 50.0", "gravity = [0.0, 0.0, 0.0]", "wanted a direction"),
        ("film_start_s = 50.0", "pressure_shares = {left = 1.0}", "pressure_shares names left, that of films: slow none"),
        ("[[cameras]]\n", '[[cameras]]\nfilm = "raw/other.mp4"\n', "cameras.film = 'raw/other.mp4' beside"),
    ],
)
def test_films_that_do_not_go_together_are_refused(project, old, new, sentence):  # noqa: F811
    both = with_films(project)
    with pytest.raises(ValueError, match=sentence):
        edit(both, old, new)


def test_a_log_that_is_missing_is_named(project, measured):  # noqa: F811
    both = with_films(project)
    run_camera(both, Lines())
    (both.root / "raw/pressure-2.csv").unlink()
    with pytest.raises(ValueError, match=r"pressure.file = 'raw/pressure-2.csv': no such file"):
        run_measure(both, Lines())
    assert not (both.root / "targets").exists()


# -- targets of two films ------------------------------------------------------------------------------------

CASE = finger_case(
    Material(0.214, 0.083), finger=Finger(length=50, bellows=2), lattice=Lattice(per_bellow=4, wall=1)
)
PLACES = tuple(tuple(map(float, nearest(CASE, np.array([x, 11.5, 0.0])))) for x in (50.0, 30.0))


def film(name, *, sd, start=0.0, top=0.01, value=None, **stated):
    """Targets of a film of 12 steps: a rest of three, then a ramp; value (12, 2, 3) mm."""
    time = start + np.arange(12.0)
    pressure = np.concatenate([np.zeros(3), np.linspace(0, top, 9)])
    points = tuple(TargetPoint(f"m{k}", PointKind.PLACE, None, p) for k, p in enumerate(PLACES))
    noise = Noise(
        sd=np.full((2, 3), sd), rho=np.zeros((2, 3)), correlation=np.eye(6), frames=400,
        codec_sd=np.zeros((2, 3)), gauge_sd_MPa=1e-5, gauge_frames=200,
    )  # fmt: skip
    made = Targets(
        time=time, pressure=pressure, block=np.zeros(12, np.int64), points=points,
        value=np.zeros((12, 2, 3)) if value is None else value,
        covariance=np.tile(sd**2 * np.eye(3), (12, 2, 1, 1)), valid=np.ones((12, 2, 3), bool),
        held_out=np.zeros(12, bool), modes=np.zeros((1, 12, 2, 3)), mode_names=("sync",), noise=noise,
        log_time=time, log_pressure=pressure, reference=np.arange(3), gravity=None,
        pressure_sd=np.full(12, 1e-5),
    )  # fmt: skip
    return FilmTargets(name=name, log=f"{name}.csv", targets=made, **stated)


def both_films(seed=1, **stated):
    """Two films with noise of their own: the second ten times as noisy."""
    rng = np.random.default_rng(seed)
    one, two = (film(n, sd=sd, value=sd * rng.standard_normal((12, 2, 3))) for n, sd in (("a", 0.01), ("b", 0.1)))
    return joined([one, replace(two, **stated)])[0]


def test_targets_of_films_survive_the_files(tmp_path):
    made = both_films(held_out=True)
    write_targets(tmp_path / "targets", made)
    again = read_targets(tmp_path / "targets")
    assert [n.sd[0, 0] for n in again.noises] == [0.01, 0.1]
    np.testing.assert_array_equal(again.reference, made.reference)
    np.testing.assert_array_equal(again.value, made.value)
    np.testing.assert_array_equal(again.held_out, made.held_out)
    assert again.mode_names == made.mode_names == ("sync@a", "sync@b")


def test_each_film_is_whitened_by_its_own_noise():
    t = both_films()
    zero = np.zeros((0, *t.value.shape))
    w = whitener(t, prediction_modes=zero, gauge=np.zeros_like(t.value))
    z = w.whiten(t.value).reshape(24, 6)
    # 72 values of variance 1: 1 +- 0.17 (1 sd); the other film's noise would give 100 or 0.01
    assert 0.5 < float((z[:12] ** 2).mean()) < 1.5
    assert 0.5 < float((z[12:] ** 2).mean()) < 1.5


def test_each_film_is_relative_to_its_own_rest():
    t = both_films()
    field = np.arange(24.0)[:, None] + np.zeros((24, 2))
    left = relative(field, t.reference, t.rests)
    np.testing.assert_allclose(left[:, 0], np.tile(np.arange(12.0) - 1.0, 2), atol=1e-12)


def test_films_of_one_log_must_not_overlap():
    a, b = film("a", sd=0.01), film("b", sd=0.01, start=5.0)
    with pytest.raises(ValueError, match=saying("'a'", "'b'", r"a\.csv")):
        joined([a, replace(b, log="a.csv")])
    t, rows = joined([a, replace(film("b", sd=0.01, start=50.0), log="a.csv")])
    assert [row.shift_s for row in rows] == [0.0, 0.0]
    assert t.time[12] == 50.0


def test_the_orientation_of_each_film_becomes_that_of_its_block():
    a, b = film("a", sd=0.01, gravity=(0.0, 0.0, -2.0)), film("b", sd=0.01, gravity=(1.0, 0.0, 0.0))
    t, _ = joined([a, b])
    assert t.gravity is not None
    np.testing.assert_allclose(t.gravity, [[0, 0, -1], [1, 0, 0]], atol=1e-15)
    assert not t.shares


def test_the_chambers_of_each_film_become_those_of_its_block():
    a, b = (film(name, sd=0.01, shares={"left": x, "right": 1 - x}) for name, x in (("a", 1.0), ("b", 0.0)))
    t, _ = joined([a, b])
    assert {name: shares.tolist() for name, shares in t.shares.items()} == {"left": [1.0, 0.0], "right": [0.0, 1.0]}


def test_a_held_out_film_does_not_enter_the_fit_and_is_judged():
    t = both_films(held_out=True)
    model = base_model(t, CASE, elasticity=Elasticity(fixed={"C01": 0.083}))
    truth = model.predict(np.array([0.2]))
    t = replace(t, value=t.value + truth)
    start = np.array([0.214])
    fit = judge(base_model(t, CASE, elasticity=Elasticity(fixed={"C01": 0.083})), t, starts=start)
    moved = t.value.copy()
    moved[12:] += 5.0 * np.sin(np.arange(12))[:, None, None]
    other = replace(t, value=moved)
    again = judge(base_model(other, CASE, elasticity=Elasticity(fixed={"C01": 0.083})), other, starts=start)
    assert np.array_equal(fit.theta, again.theta)
    assert fit.comparison.p_value == again.comparison.p_value
    assert fit.deviance == again.deviance
    (found,), (off,) = unseen(fit.errors, fit.predicted, fit.jacobian, t, {}), unseen(again.errors, again.predicted, again.jacobian, other, {})
    assert (found.block, found.values) == (1, 72)
    assert found.rms_mm == pytest.approx(0.1, rel=0.35)  # its noise; 72 values: 8 %, 4 sds
    assert off.raw_rms_mm > 2.0
    seen = replace(other, held_out=np.zeros(24, bool))  # the mutant: fitted, it moves the constants
    free = judge(base_model(seen, CASE, elasticity=Elasticity(fixed={"C01": 0.083})), seen, starts=start)
    assert not np.array_equal(free.theta, fit.theta)


def test_the_report_shows_a_held_out_film():
    before = UnseenFilm(film="steps", block=1, rms_mm=0.5, raw_rms_mm=0.6, noise_sd_mm=0.1, values=72)
    row = ForetoldFilm.of(before, before.model_copy(update={"rms_mm": 0.25}))
    assert row.ratio == 2.0
    text = render(title="t", facts={"held_out": [row]})
    assert "Films that no fit has seen" in text
    assert "<td>steps</td>" in text
    assert "Films that no fit has seen" not in render(title="t", facts={"held_out": []})
