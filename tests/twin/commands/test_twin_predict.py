"""The command predict: what it is asked for, and how it refuses what it cannot answer."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying, says
from tests.twin.diagnosis.toy import Toy, smooth_field, targets
from twin.bench.workbench import Workbench
from twin.calibrated import inverse
from twin.calibrated.blockedforce import _kept
from twin.calibrated.inverse import Wanted, first_crossing
from twin.calibrated.positions import asked
from twin.calibrated.predictionerrors import Uncertain, told_by_film
from twin.calibrated.predictions import GAP, HIGH, LOW, Prediction, WantedCourse, after, pressure_of, turned
from twin.commands.predict import (
    PredictedAngle,
    PredictedPoint,
    PredictionRecord,
    _gravity,
    _notes,
    _table,
    run_predict,
)
from twin.effects.protocol import Unsolvable
from twin.project.folder import Project, dataset


@pytest.fixture(scope="module")
def bench() -> Workbench:
    return Workbench.of(Project.open(dataset("study")))


@pytest.mark.parametrize(("text", "wanted"), [("20kPa", 0.02), ("0.2 bar", 0.02), ("0.02MPa", 0.02), ("2.9psi", 0.019995)])
def test_a_pressure_has_a_unit(text: str, wanted: float) -> None:
    assert pressure_of(text) == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("20", "a number with its unit"),
        ("20mm", "none of pressure"),
        ("2V", "a number with its unit"),
        ("20bara", "absolute pressure"),
        ("-5kPa", "above 0"),
        ("20bar", "below 1 MPa"),
        ("1e-400kPa", "above 0"),
        ("...kPa", "a number with its unit"),
    ],
)
def test_what_is_no_pressure_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        pressure_of(text)


def test_places_are_points_of_the_project_of_their_line_or_of_the_surface(bench: Workbench) -> None:
    every = asked(bench, [])
    assert set(every) == set(bench.targets.names)
    found = asked(bench, ["tip", "x=60", "60,11.5,0"])
    assert np.allclose(found["tip"], every["tip"])
    assert np.allclose(found["x=60"], found["60,11.5,0"], atol=0.01)
    for text, words in (("tipp", "wanted a point of the project"), ("60,11.5", "x=60"), ("60,40,0", "off the finger")):
        with pytest.raises(ValueError, match=words):
            asked(bench, [text])


def test_wanted_films_follow_the_film_as_blocks_of_their_own(bench: Workbench) -> None:
    held = WantedCourse.held(0.02, ramp_s=1.0, hold_s=3.0)
    logged = WantedCourse.logged(np.array([5.0, 6.0, 8.0]), np.array([0.0, 0.01, 0.005]), most=2)
    t, s = bench.targets, len(bench.targets.time)
    found = after(t, [held, logged], {"here": np.array([60.0, 11.5, 0.0])})
    assert found.names == (*t.names, "here")
    assert found.block[s:].tolist() == [t.block[-1] + 1] * 2 + [t.block[-1] + 2] * 3
    assert np.allclose(found.pressure[s:], [0, 0.02, 0, 0, 0.005])
    assert found.time[s + 1] == pytest.approx(t.log_time[-1] + GAP + 4.0)
    assert not found.valid.any()
    assert np.array_equal(found.value[:s, : len(t.names)], t.value, equal_nan=True)


def test_the_turn_of_the_end_face_and_its_error() -> None:
    ends, angle = np.array([[100.0, 0, -10], [100.0, 0, 10]]), np.radians(30.0)

    def moved(by: float) -> np.ndarray:
        c, s = np.cos(by), np.sin(by)
        return ends @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) - ends

    factor = (moved(angle + 1e-6) - moved(angle)) / 1e-6 * np.radians(0.5)
    degrees, errors = turned((LOW, HIGH), moved(angle)[None], factor[None, None], ends)
    assert degrees == pytest.approx([30.0])
    assert np.abs(errors) == pytest.approx(np.array([[0.5]]), rel=1e-5)


def test_the_turn_of_the_tip_stands_in_the_table() -> None:
    at = {"time_s": 1.0, "pressure_MPa": 0.02}
    points = [PredictedPoint(point=p, u_mm=(-1.0, 0.0, -9.0), low_mm=(None,) * 3, high_mm=(None,) * 3, beyond=False, **at) for p in ("tip", "middle")]
    angle = PredictedAngle(degrees=30.0, low=29.0, high=31.0, **at)
    assert _table(PredictionRecord(points=tuple(points), angles=(angle,), tested_MPa=0.03)) == [
        "pressure          U1, mm  U2, mm  U3, mm  tip turns, degrees",
        "  20 kPa  tip      -1.00    0.00   -9.00         30.0 +- 1.0",
        "  20 kPa  middle   -1.00    0.00   -9.00",
    ]


def test_one_of_pressure_and_course_is_wanted(tmp_path: Path) -> None:
    project = Project.open(dataset("study"))
    with pytest.raises(ValueError, match="none of them are given"):
        run_predict(project, lambda text: None)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="2 of them are given"):
        run_predict(project, lambda text: None, pressure=("20kPa",), course=tmp_path)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="--hold-s -1"):
        run_predict(project, lambda text: None, pressure=("20kPa",), hold_s=-1.0)  # type: ignore[arg-type]


def test_what_was_not_tested_is_told(bench: Workbench, monkeypatch: pytest.MonkeyPatch) -> None:
    t = replace(bench.targets, time=np.array([0.0, 10.0]), log_time=np.array([-60.0, 0.0, 10.0]), log_pressure=np.array([0.0, 0.0, 0.03]))
    bench, nothing = replace(bench, targets=t), np.zeros((1, 1, 3))

    def told(course: WantedCourse) -> str:
        beyond = np.array([course.pressure.max() > 0.03])
        one = Prediction(
            time=course.output, pressure=course.pressure[-1:], names=("tip",), u=nothing, factors=nothing[None],
            beyond=beyond, angle=np.zeros(1), angle_sd=np.zeros(1), shape=nothing,
        )  # fmt: skip
        return " ".join(_notes(bench, [course], [one]))

    assert told(WantedCourse.held(0.02, ramp_s=8.0, hold_s=2.0)) == ""
    says(told(WantedCourse.held(0.04, ramp_s=12.0, hold_s=2.0)), "40 kPa", "30 kPa")
    says(told(WantedCourse.held(0.02, ramp_s=1.0, hold_s=2.0)), "20", "kPa/s", "3")
    assert "It lasts 68 s, the film 10 s" in told(WantedCourse.held(0.02, ramp_s=8.0, hold_s=60.0))
    seen = bench.model(["camera_scale"])
    monkeypatch.setattr(Workbench, "model", lambda self: seen)
    assert "the model has camera_scale" in told(WantedCourse.held(0.02, ramp_s=8.0, hold_s=2.0))


def test_what_the_film_says_has_pulls_of_one() -> None:
    base, mode = smooth_field(1), smooth_field(2)
    columns, toy, theta = np.concatenate([base, mode]), Toy({"base": base}), np.array([1.2])
    truth, pulls = 1.3 * base[0] + 0.5 * mode[0], []
    for seed in range(80):
        some = Uncertain(columns, np.array([0.0, 1.0]))
        change, factors = told_by_film(targets(truth, seed=seed, sd=0.5), toy, theta, some)  # type: ignore[arg-type]
        off = toy.predict(theta) + change - truth
        at = [40, 70], [0, 2], 2  # step, point, axis
        pulls.append(off[at] / np.sqrt((factors**2).sum(axis=0))[at])
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.25  # of 160 draws: 1 +- 0.06


def test_a_prior_that_the_film_says_nothing_of_stays() -> None:
    base, seen = smooth_field(1), smooth_field(2)
    seen[:] = 0.0
    t = targets(1.3 * base[0], seed=1)
    columns = np.concatenate([np.pad(x, ((0, 0), (0, 0), (0, 1), (0, 0))) for x in (base, seen)])
    columns[1, :, -1, 2] = 2.0  # mm, at a place without a marker
    some = Uncertain(columns, np.array([0.0, 0.25]))
    _, factors = told_by_film(t, Toy({"base": base}), np.array([1.2]), some)  # type: ignore[arg-type]
    assert np.sqrt((factors**2).sum(axis=0))[50, -1, 2] == pytest.approx(4.0)


def test_a_stated_prior_counts_as_one_value_of_the_film() -> None:
    base, mode = smooth_field(1), smooth_field(2)
    columns, theta = np.concatenate([base, mode]), np.array([1.2])
    t, toy = targets(1.2 * base[0], seed=1), Toy({"base": base})
    free = Uncertain(columns, np.array([0.0, 1.0]))
    found, left = told_by_film(t, toy, theta, free)  # type: ignore[arg-type]
    sd = np.sqrt((left**2).sum(axis=0))[50, 0, 2] / abs(base[0, 50, 0, 2])  # of the parameter, but for the mode
    tight = replace(free, stated=(np.array([-3.0]), np.array([[1.0 / (0.01 * sd), 0.0]])))  # 1.2 + 0.03 sd
    moved, known = told_by_film(t, toy, theta, tight)  # type: ignore[arg-type]
    alone = np.array([0.0, 1.0])
    only = told_by_film(t, Toy({"base": base}), theta, replace(free, columns=columns[1:], prior=alone[1:]))[1]  # type: ignore[arg-type]
    assert np.linalg.norm(known) == pytest.approx(np.linalg.norm(only), rel=0.02)  # the parameter is held
    assert not np.allclose(moved, found)


@pytest.mark.parametrize(("text", "wanted"), [
    ("tip.U3=-40", Wanted("tip", 2, -40.0)),
    ("x=60.u1 = 2.5 mm", Wanted("x=60", 0, 2.5)),
    ("60,11.5,0.U2=1e-1", Wanted("60,11.5,0", 1, 0.1)),
])  # fmt: skip
def test_a_wanted_displacement_names_point_and_axis(text: str, wanted: Wanted) -> None:
    assert Wanted.of(text) == wanted
    assert Wanted.of(wanted.words) == wanted


@pytest.mark.parametrize("text", ["tip", "tip=-40", "tip.U4=1", "tip.U3=deep", "tip.U3=1.2.3", ".U3=4"])
def test_what_is_no_wanted_displacement_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"such as tip\.U3=-40"):
        Wanted.of(text)


def test_the_lowest_pressure_that_gives_a_value_is_taken() -> None:
    pressure = np.linspace(0.0, 0.03, 16)
    u = -2e3 * pressure + 4e4 * pressure**2  # back from its turn at 25 kPa
    found = first_crossing(pressure, u, -20.0)
    assert found is not None
    exact = (2e3 - np.sqrt(4e6 - 16e4 * 20)) / 8e4
    assert found == pytest.approx((exact, -2e3 + 8e4 * exact), rel=5e-3)
    assert first_crossing(pressure, u, -26.0) is None
    assert first_crossing(pressure, u, 1.0) is None


def test_the_pressure_for_a_displacement_gives_it(bench: Workbench, monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(p: np.ndarray) -> np.ndarray:
        return -1.5e3 * p - 2e4 * p**2

    def told(bench, record, courses, places, say):  # type: ignore[no-untyped-def]
        (one,) = courses
        u, factors = np.zeros((1, 1, 3)), np.zeros((1, 1, 1, 3))
        u[..., 2], factors[..., 2] = moved(one.pressure[-1]) + 0.3, 0.2  # the film knows more than the constants
        return [Prediction(
            time=one.output, pressure=one.pressure[-1:], names=("tip",), u=u, factors=factors,
            beyond=np.zeros(1, bool), angle=np.zeros(1), angle_sd=np.zeros(1), shape=u,
        )]  # fmt: skip

    tried: list[float] = []

    def reached(bench, record, wanted, places, courses, say):  # type: ignore[no-untyped-def]
        tried.extend(float(c.pressure[-1]) for c in courses)
        return np.array([moved(c.pressure[-1]) for c in courses])

    monkeypatch.setattr(inverse, "predicted", told)
    monkeypatch.setattr(inverse, "_reached", reached)
    top, places = float(bench.targets.log_pressure.max()), {"tip": np.zeros(3)}

    held = partial(WantedCourse.held, ramp_s=2.0, hold_s=2.0)

    def at(value: float) -> inverse.Inverse:
        wanted = Wanted("tip", 2, value)
        return inverse.pressure_for(bench, None, wanted, places, lambda text: None, held)  # type: ignore[arg-type]

    found = at(moved(np.array(0.6 * top)) + 0.3)
    assert found.pressure == pytest.approx(0.6 * top, rel=1e-3)
    assert max(tried) == pytest.approx(top)  # no more than was tested
    low, high = found.interval or (0.0, 0.0)
    assert (high - low) / 2 == pytest.approx(1.96 * 0.2 / (1.5e3 + 4e4 * 0.6 * top), rel=0.02)
    assert at(moved(np.array(1.3 * top))).pressure > 1.2 * top
    with pytest.raises(ValueError, match=rf"tip moves by .* to 0 mm in U3 up to {1.5e3 * top:.4g} kPa"):
        at(moved(np.array(1.6 * top)))


# -- another orientation, and the blocked force --------------------------------------------------------------


def test_gravity_is_asked_for_by_its_direction_of_a_finger_with_weight(bench: Workbench) -> None:
    heavy = replace(bench, targets=replace(bench.targets, gravity=np.array([[0.0, 0.0, -1.0]])),
                    structure=replace(bench.structure, case=bench.case.with_material(density=1.07e-9)))  # fmt: skip
    assert _gravity(bench, "") is None
    assert _gravity(heavy, "2,0,0") == pytest.approx([1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="the model has no weight; give density_kg_m3"):
        _gravity(bench, "1,0,0")
    for text in ("0,0,0", "1,0", "down", "1,nan,0", "1,inf,0"):
        with pytest.raises(ValueError, match="wanted its direction X,Y,Z"):
            _gravity(heavy, text)
    own, hangs = WantedCourse.held(0.02, ramp_s=1.0, hold_s=3.0), np.array([1.0, 0.0, 0.0])
    found = after(heavy.targets, [own, replace(own, gravity=hangs)], {})
    assert found.gravity is not None
    assert found.gravity[-2:].tolist() == [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
    assert found.gravity.shape == (found.block[-1] + 1, 3)


def test_a_block_that_no_force_keeps_is_refused() -> None:
    assert _kept(lambda f: (f**2 + 2 * f - 3, 2 * f + 2), 0.02)[0] == pytest.approx(1.0, abs=1e-3)

    def folds(f: float) -> tuple[float, float]:
        if f > 1.0:
            raise Unsolvable("it folds")
        return f - 3.0, 1.0

    with pytest.raises(ValueError, match=saying("20 kPa", r"0\.0\d+", r"-2\.\d+")):
        _kept(folds, 0.02)


def test_a_blocked_force_wants_a_pressure() -> None:
    with pytest.raises(ValueError, match="--blocked: wanted a pressure beside it"):
        run_predict(Project.open(dataset("study")), lambda text: None, inverse=("tip.U3=-4",), blocked=True)  # type: ignore[arg-type]
