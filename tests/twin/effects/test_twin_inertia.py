"""Inertia as an effect: what it makes of a course, which films are asked for it, and what is named."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas
import pytest

import twin
from fe import Case, Path
from tests.twin.foreign.arcs import BEND, PLACES, STIFF, TRUE, arcs
from twin.effects.inertia import Inertia
from twin.effects.library import effect
from twin.effects.protocol import Effect, Test
from twin.effects.requirements import lacking
from twin.foreign.courseeffects import candidates
from twin.foreign.foreignmodel import ForeignModel
from twin.model.keptmodel import base_model
from twin.targets import Array, Targets
from twin.virtual.draws import Setup, at_nodes, measured
from twin.virtual.protocols import PROTOCOLS

HZ, DAMPING, SD = 5.7, 0.06, 0.05
TIME, LOG = np.arange(0.0, 7.0, 1 / 40), np.arange(0.0, 6.99, 0.01)
FINE = np.arange(0.0, 7.0, 2e-4)
VALUES = {"inertia.share": 1.0, "inertia.hz": HZ, "inertia.damping": DAMPING}


def course(t: Array, *, rise: float = 0.08) -> Array:
    """A slow rise, then a step up and one down within `rise` s each, MPa."""
    corners = [0, 0.4, 2, 2.5, 2.5 + rise, 4.7, 4.7 + rise, 7]
    return np.interp(t, corners, 1e-3 * np.array([0, 0, 6, 6, 13, 13, 5, 5]))


def swinging(p: Array, *, drag: float = 0.0, faster: float = 0.0) -> Array:
    """A mass on a spring behind a pressure p (t,) at FINE, by small steps (symplectic Euler)."""
    out, y, v, w, h, span = np.empty(len(p)), p[0], 0.0, 2 * np.pi * HZ, FINE[1], np.ptp(p)
    for k, load in enumerate(p):
        here = w * (1 + faster * y / span)
        v += h * (here**2 * (load - y) - 2 * here * DAMPING * v - 3 * np.pi / 4 * drag / span * abs(v) * v)
        y += h * v
        out[k] = y
    return out


def late(p: Array, tau: float) -> Array:
    out = p.copy()
    for k in range(1, len(p)):
        out[k] = out[k - 1] + FINE[1] / tau * (p[k - 1] - out[k - 1])
    return out


def data_of(true: Array, *, rise: float = 0.08, seed: int = 0) -> Targets:
    """What is measured of a rod of arcs whose pressure is `true` (t,) at FINE."""
    u = arcs(TRUE, np.interp(TIME, FINE, true))
    seen = u - u[0] + SD * np.random.default_rng(seed).standard_normal(u.shape)
    rows = {"time_s": TIME, "pressure_kPa": 1e3 * course(TIME, rise=rise)}
    rows |= {f"{n}_{a}_mm": seen[:, k, i] for k, n in enumerate(PLACES) for i, a in ((0, "x"), (2, "z"))}
    log = pandas.DataFrame({"time_s": LOG, "pressure_kPa": 1e3 * course(LOG, rise=rise)})
    return twin.read_table(pandas.DataFrame(rows), points=PLACES, sd_mm=SD, log=log)


def path_of(pressure: Array = course(LOG)) -> Test:  # noqa: B008
    return Test(None, Path(LOG, pressure, TIME[:-1]), np.zeros((0, 3)), np.zeros(0, bool))  # type: ignore[arg-type]


@pytest.mark.parametrize(("drag", "faster"), [(0.0, 0.0), (0.2, 0.0), (0.0, 0.2)])
def test_it_is_a_mass_on_a_spring_behind_the_pressure(drag: float, faster: float) -> None:
    values = {**VALUES, "inertia.drag": drag, "inertia.faster": faster}
    made = Inertia(2).before(path_of(), values).path
    true = np.interp(made.output, FINE, swinging(course(FINE), drag=drag, faster=faster))
    # of the step: small steps err by 0.2 %, a log every 0.01 s by 1 %; a drag is averaged over a period
    np.testing.assert_allclose(made.at_output(), true, rtol=0, atol=7e-3 * (0.015 if not (drag or faster) else 0.06))


def test_without_a_share_nothing_changes_and_what_a_path_holds_beside_stays() -> None:
    test = path_of()
    turned = np.where(LOG[:, None] > 3.0, [0.0, 0.0, 9810.0], [0.0, 0.0, -9810.0])
    path = replace(test.path, stiffness=1 + 0.01 * LOG, gravity=turned)
    made = effect("inertia").before(replace(test, path=path), {**VALUES, "inertia.share": 0.0}).path
    np.testing.assert_array_equal(made.at_output(), path.at_output())
    np.testing.assert_allclose(made.stiffness_at(path.output), path.stiffness_at(path.output), rtol=1e-12)
    np.testing.assert_array_equal(made.outside_at(path.output), path.outside_at(path.output))


def test_a_film_of_a_finger_with_weight_is_asked_for_it(short_case: Case) -> None:
    """Its log has gravity at every time, and is coarser than its frames."""
    course, points = PROTOCOLS["fast"].course, at_nodes(("tip",), (4401,), short_case.position(4401)[None])
    u = np.zeros((len(course.output), 1, 3))
    log = replace(course, time=course.time[::7], pressure=course.pressure[::7], gravity=course.gravity[::7])
    film = measured(PROTOCOLS["fast"], u, u, points=points, setup=Setup(), seed=1)
    film = replace(film, log_time=log.time, log_pressure=log.pressure)
    model, inertia = base_model(film, short_case.with_material(density=1.07e-9)), Inertia()
    theta, entry = np.array([0.214, 0.083]), {"inertia.hz": 5.0, "inertia.damping": 0.1}
    assert np.isin(film.time[film.time < log.time[-1]], model.test.path.time).all()
    tried = [k for k, e in enumerate(inertia.tries(model.test)) if e["inertia.damping"] == entry["inertia.damping"]]
    near = min(tried, key=lambda k: abs(inertia.tries(model.test)[k]["inertia.hz"] - entry["inertia.hz"]))
    found = model.tangents(theta, [inertia])[inertia.label][near][0]
    values = [inertia.tries(model.test)[near][name] for name in ("inertia.hz", "inertia.damping")]
    whole = model.with_effect(inertia).predict(np.array([*theta, 0.01, *values])) - model.predict(theta)
    np.testing.assert_allclose(0.01 * found, whole, atol=0.02 * np.abs(whole).max())


def test_it_is_asked_of_a_fast_course_and_of_frames_that_can_show_it_alone() -> None:
    needs, film = effect("inertia").requires, data_of(course(FINE))
    assert lacking(needs, film) == ""
    slow = data_of(course(FINE), rise=2.0)  # 7 kPa in 2 s move a finger of 2 Hz by 0.3 kPa, 2.1 % of the range
    slower = replace(slow, log_pressure=np.interp(slow.log_time, [0, 7], [0.0, 0.013]))
    assert "fast change" in lacking(needs, slower)
    assert lacking(needs, slow) == ""
    rare = np.arange(len(film.time)) % 3 == 0  # 13 frames a second
    kept = replace(film, valid=film.valid & rare[:, None, None])
    assert lacking(needs, kept) != ""
    still = replace(film, valid=film.valid & (film.time < 0.4)[:, None, None])
    assert "fast change" in lacking(needs, still)


def test_frequencies_are_tried_as_far_as_frames_tell_them_apart() -> None:
    tried = {round(entry["inertia.hz"], 2) for entry in effect("inertia").tries(path_of())}
    assert (min(tried), max(tried)) == (2.0, 10.0)  # 4 of 40 frames a second


FILMS = [(swinging, "inertia"), (lambda p: swinging(p, drag=0.3), "inertia:2"), (lambda p: late(p, 0.1), "pressure_lag")]


@pytest.mark.parametrize(("true", "name"), FILMS)
def test_a_swing_is_named_with_the_law_of_its_damping_and_a_lag_stays_one(
    true: Callable[[Array], Array], name: str
) -> None:
    data = data_of(true(course(FINE)))
    rod = twin.simulator(arcs, [STIFF, BEND])
    base = ForeignModel.of(rod, data)
    names = ("inertia", "pressure_lag", "creep", "time_shift")
    sought: list[Effect] = [e for e in candidates(base.test) if e.name in names]
    with np.errstate(under="ignore"):  # over 280 steps a noise filter's memory dies away to nothing
        found = twin.diagnose(rod, data, effects=sought)
    assert found.diagnosis.law == name
    if name != "pressure_lag":
        values = found.diagnosis.kept.values  # type: ignore[union-attr]
        assert values["inertia.hz"] == pytest.approx(HZ, rel=0.01)
        assert values["inertia.damping"] == pytest.approx(DAMPING, rel=0.1)
        assert values.get("inertia.drag", 0.0) == pytest.approx(0.3 * (name == "inertia:2"), abs=0.05)
