"""`twin predict --course` of a fast course on a short finger: its swing, its errors, and what it refuses."""

import csv
from pathlib import Path

from benchmarks.kernel.reducedmotions import stub

import numpy as np
import pytest

from fe import Path as Course
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.reduced import ReducedModel
from fe.dynamics.timesteps import transient
from fe.dynamics.vibration import modes
from tests.messages import Lines
from tests.twin.commands.test_twin_modes import KG_M3, RHO, bench, fit, project
from tests.twin.test_twin_notebook import batch, coarsest
from twin import files
from twin.bench.workbench import Workbench
from twin.calibrated.courseinertia import Damping, WantedSwing, _as_it_vibrates, _stretched
from twin.calibrated.positions import asked
from twin.calibrated.predictions import WantedCourse, predicted
from twin.commands.predict import run_predict
from twin.commands.predictfast import _damping, _shown, swing_of_course
from twin.effects.inertia import Inertia
from twin.judging.fitrecord import FitRecord
from twin.project.folder import Project
from twin.results import rows_of

__all__ = ["batch", "bench", "coarsest", "fit", "project"]
TOP = 0.004  # MPa


def risen(rise_s: float, *, lasts_s: float, count: int) -> WantedCourse:
    time = np.cumsum([0.0, 0.02, rise_s, lasts_s])
    return WantedCourse(time, TOP * np.array([0.0, 0.0, 1.0, 1.0]), np.linspace(0.0, time[-1], count))


def test_a_fast_course_swings_as_whole_time_steps_do_and_its_band_holds_that(bench: Workbench, fit: FitRecord) -> None:
    course, places = risen(0.01, lasts_s=0.1, count=60), asked(bench, ["tip"])
    (found,) = predicted(bench, fit, [course], places, Lines(), beside=WantedSwing(Damping(0.0, 0.0), KG_M3))
    assert found.statics is not None
    model = bench.model()
    case = model.put(model.named(fit.fit.theta)).case.with_material(density=RHO)
    path = Course(course.time, course.pressure, course.output)
    whole = transient(case, path, tolerance=1e9, longest=1e-3, radius=1.0)
    tip = np.argmin(np.linalg.norm(case.nodes - places["tip"], axis=1))
    held = at_rest(case, HeldLoad(TOP)).state.u[tip]
    after = course.output > 0.03
    true, mine = whole.u[after][:, tip] - held, (found.u - found.statics)[after, 0]
    swing = np.abs(true).max()
    assert swing > 0.3 * np.abs(held).max()
    assert found.beside is not None
    sd = found.beside.factors[0, -60:][after][:, bench.targets.names.index("tip")]  # by the reduced model alone
    assert np.sqrt(np.mean(((mine - true) / sd)[:, [0, 2]] ** 2)) < 1.25
    assert np.abs(mine - true).max() < 0.2 * swing
    assert np.median(sd[:, 2]) < 0.2 * swing  # else the band would say nothing


def test_it_vibrates_as_stiff_as_creep_leaves_it_at_its_frequency_and_as_the_finest_mesh() -> None:
    case, path = stub().with_material(prony=((0.2, 1e-4), (0.1, 10.0))), Course(np.array([0.0, 1.0]), np.array([0.0, 0.01]), np.array([0.0, 1.0]))
    stiff, frequency, loss = _as_it_vibrates(case, path, 0.0)
    elastic = stub()
    (name,) = elastic.materials
    fresh = elastic.materials[name].C10
    # the fast term has crept at any frequency, the slow one never
    assert stiff.materials[name].C10 / fresh == pytest.approx(0.8, rel=0.01)
    assert not stiff.materials[name].prony
    found = modes(at_rest(stiff, HeldLoad(0.01)), count=6)
    assert frequency == pytest.approx(found.frequency[~found.sideways][0], rel=5e-3)  # that fast term lags a little
    assert 0.0 < loss < 0.05
    softer, lower, _ = _as_it_vibrates(case, path, 0.19)
    assert lower == pytest.approx(0.9 * frequency)
    ratio = softer.materials[name].C10 / stiff.materials[name].C10
    assert ratio == pytest.approx(0.81)


def test_a_slow_course_is_statics(bench: Workbench, fit: FitRecord) -> None:
    course, places = risen(2.0, lasts_s=0.5, count=30), asked(bench, ["tip"])
    (found,) = predicted(bench, fit, [course], places, Lines(), beside=WantedSwing(Damping(), KG_M3))
    (still,) = predicted(bench, fit, [course], places, Lines())
    np.testing.assert_allclose(found.statics, still.u, atol=1e-9)
    assert np.abs(found.u - still.u).max() < 0.01 * np.abs(still.u).max()
    assert (np.abs(found.u - still.u) <= 3 * found.sd + 1e-3).all()
    assert (found.sd >= still.sd - 1e-9).all()


def test_a_finger_of_higher_frequencies_is_the_same_in_a_stretched_time() -> None:
    case, levels = stub(), np.linspace(-0.01, 0.03, 7).tolist()
    model = ReducedModel.of(case, levels, count=2)
    lighter = ReducedModel.of(case.with_material(density=RHO / 1.1**2), levels, count=2)
    period = float(2 * np.pi / np.sqrt(model.square[3, 0]))
    path = Course(period * np.array([0.0, 0.5, 5.0]), np.array([0.0, 0.015, 0.015]), period * np.linspace(0.0, 3.0, 40))
    assert next(iter(case.materials.values())).density == pytest.approx(RHO)
    a, b = lighter.follow(path, loss=0.1).u, model.follow(_stretched(path, 1.1), loss=0.1).u
    np.testing.assert_allclose(a, b, atol=2e-4 * np.abs(a).max())


@pytest.fixture
def fitted(fit: FitRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files.write_json(tmp_path / "fit.json", files.plain(fit))
    monkeypatch.setattr("twin.commands.predict.fit_file", lambda _: tmp_path / "fit.json")


def log(folder: Path, rise_s: float) -> Path:
    course = folder / f"course-{rise_s:g}.csv"
    times = [0.0, 0.02, 0.02 + rise_s, 0.15 + rise_s]
    course.write_text("time_s,pressure_kPa\n" + "".join(f"{t},{p}\n" for t, p in zip(times, (0, 0, 4, 4), strict=True)), encoding="utf-8")
    return course


def test_a_model_with_inertia_swings_by_itself(
    bench: Workbench, fit: FitRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = bench.model().with_effect(Inertia())
    monkeypatch.setattr(Workbench, "model", lambda _: model)
    course = WantedCourse(np.array([0.0, 0.02, 0.025, 0.15]), 1e-3 * np.array([0, 0, 4, 4.0]), np.array([0.1]))
    found, swing = swing_of_course(bench, fit, course, [], dynamics=False, loss=None, density=None)
    assert swing is None
    assert len(found.output) > 20
    assert np.diff(found.output).min() > 1e-6
    with pytest.raises(ValueError, match="the model has the effect inertia"):
        swing_of_course(bench, fit, course, [], dynamics=True, loss=None, density=None)


@pytest.mark.usefixtures("fitted")
def test_the_command_follows_a_fast_course_and_says_what_swings(project: Project, tmp_path: Path) -> None:
    say = Lines()
    found = run_predict(project, say, course=log(tmp_path, 0.005), at=["tip"], density=KG_M3, loss=0.1)
    folder, inertia = project.root / "runs" / found["run"], found["inertia"]
    assert inertia["damping_ratio"] == pytest.approx(0.05)
    assert inertia["overshoot"]["axis"] == "U3"
    assert inertia["overshoot"]["mm"] < 0.0  # downwards, beyond the deepest equilibrium
    assert "It overshoots: tip goes" in "\n".join(say)
    assert "as typed" in "\n".join(say)
    with (folder / "predicted.csv").open(encoding="utf-8", newline="") as stream:
        table = list(csv.DictReader(stream))
    u, still = ([float(row[key]) for row in table] for key in ("u3_mm", "u3_static_mm"))
    assert min(u) == pytest.approx(min(still) + inertia["overshoot"]["mm"], abs=1e-3)
    assert (folder / "predicted.png").stat().st_size
    assert len(rows_of("predict", folder, found)) == len(table)


@pytest.mark.usefixtures("fitted")
def test_without_a_density_inertia_is_left_out_and_said_or_refused_where_it_is_asked_for(project: Project, tmp_path: Path) -> None:
    fast = log(tmp_path, 0.005)
    said = run_predict(project, Lines(), course=fast, at=["tip"])
    assert said["inertia"] is None
    assert "The course is fast, and inertia is left out: density of the silicone" in said["note"]
    assert run_predict(project, Lines(), course=log(tmp_path, 5.0), at=["tip"])["inertia"] is None
    before = len(project.runs())
    for how, words in (
        ({"course": fast, "dynamics": True}, "--density 1070"),
        ({"course": fast, "density": 1.07}, "--density 1.07: wanted kg/m3"),
        ({"course": fast, "loss": -1.0}, "loss factor from 0 to 2"),
        ({"pressure": ["4kPa"], "dynamics": True}, "wanted --course beside them"),
    ):
        with pytest.raises(ValueError, match=words):
            run_predict(project, Lines(), **how)  # type: ignore[arg-type]
    assert len(project.runs()) == before


@pytest.mark.usefixtures("fitted")
def test_a_swing_to_where_there_is_no_equilibrium_is_left_out_and_said(
    project: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of(*_: object, **__: object) -> ReducedModel:
        raise ValueError("no equilibrium at -20 kPa: a fold")

    monkeypatch.setattr(ReducedModel, "of", of)
    how = {"course": log(tmp_path, 0.005), "at": ["tip"], "density": KG_M3}
    said = run_predict(project, Lines(), **how)  # type: ignore[arg-type]
    assert said["inertia"] is None
    assert "inertia is left out: inertia of this course: no equilibrium at -20 kPa" in said["note"]
    with pytest.raises(ValueError, match="change the pressure more slowly"):
        run_predict(project, Lines(), dynamics=True, **how)  # type: ignore[arg-type]


def test_the_times_that_show_a_swing_are_near_what_sets_it_off() -> None:
    course = risen(0.1, lasts_s=5.0, count=5)
    times = _shown(np.array([0.2, 0.3]), course, 5.0)
    assert np.allclose(np.diff(times), 1 / 60)
    assert times[0] == pytest.approx(0.2 - 1 / 30)
    assert times[-1] == pytest.approx(0.3 + 6 / 5, abs=0.02)
    many = _shown(np.arange(0.2, 5.0, 0.4), course, 20.0)
    assert len(many) <= 200
    assert len(_shown(np.zeros(0), course, 5.0)) == 0


def test_damping_comes_from_the_ringing_of_the_film_where_there_is_one(bench: Workbench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert _damping(bench, None) == Damping()
    assert _damping(bench, 0.1) == Damping(0.1, 0.0, "as typed, beside the creep", beside=True)
    assert Damping(0.1, beside=True).with_creep(0.05) == pytest.approx(0.15)
    assert Damping(0.1).with_creep(0.05) == 0.1
    row = dict.fromkeys(("pressure_MPa", "frequency_Hz_per_mm", "damping_per_mm", "smear_mm", "shrink", "skew_mm", "model_Hz", "model_low_Hz", "model_high_Hz"))
    row |= {"where": "film", "start_s": 1.0, "frequency_Hz": 8.0, "frequency_sd_Hz": 0.1, "damping_ratio": 0.07,
            "damping_sd": 0.01, "amplitude_mm": 1.0, "first_mm": 2.0, "doubt": "", "model_moves": ""}  # fmt: skip
    files.write_json(tmp_path / "ringing.json", {"ringings": [row], "note": ""})
    monkeypatch.setattr(Project, "newest", lambda self, kind, file: tmp_path / file)
    assert _damping(bench, None) == Damping(0.14, 0.02, "as twin ringing found it")
