"""Pressures and displacements that no soft finger has are refused with their likely cause; real ones pass."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fe import Case
from tests.messages import saying, says
from twin import sanity
from twin.commands.calibrate import _end
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.project.folder import Project, dataset
from twin.project.targetfiles import read_targets
from twin.sanity import (
    doubts,
    fit_fault,
    motion_fault,
    place_fault,
    pressure_fault,
    rise_fault,
    silicone_doubt,
    stability_doubt,
    top_fault,
    zero_fault,
)
from twin.targets import Load, Targets, at_node


@pytest.fixture
def moving(make_targets: Callable[..., Targets], short_case: Case) -> Targets:
    """Targets of the short finger whose tip moves as a finger of 43 mm does under 20 kPa."""
    labels = short_case.labels[np.argsort(short_case.nodes[:, 0])[[-1, len(short_case.nodes) // 2]]]
    base = make_targets()
    value = np.zeros_like(base.value)
    value[:, :2] = base.pressure[:, None, None] / 0.02 * np.array([[-1.0, 0.0, -6.0], [-0.2, 0.0, -2.0]])
    points = (at_node("tip", int(labels[0])), at_node("middle", int(labels[1])), base.points[2])
    return replace(base, value=value, points=points)


def scaled(targets: Targets, factor: float) -> Targets:
    return replace(targets, value=factor * targets.value)


@pytest.mark.parametrize("peak", [1e-4, 0.003, 0.03, 0.3, 1.0])
def test_pressures_of_fingers_pass(peak: float) -> None:
    assert pressure_fault(peak) == ""


@pytest.mark.parametrize(
    ("peak", "unit", "told"),
    [
        (30.0, "MPa", "the numbers are likely in kPa (30 kPa are 0.03 MPa) or psi (30 psi are 0.21 MPa)"),
        (300.0, "MPa", "the numbers are likely in kPa (300 kPa are 0.3 MPa) or mbar (300 mbar are 0.03 MPa)"),
        (3e4, "MPa", "the numbers are likely in Pa (3e+04 Pa are 0.03 MPa)"),
        (3.0, "kPa", "reaches 3 MPa, read in kPa; wanted 0.0001 to 1 MPa"),
        (3e-5, "kPa", "reaches 3e-05 MPa, read in kPa"),
    ],
)
def test_the_likely_unit_is_named(peak: float, unit: str, told: str) -> None:
    assert told in pressure_fault(peak, unit=unit)


def test_a_moving_finger_passes(moving: Targets, short_case: Case) -> None:
    assert motion_fault(moving, short_case, bends_down=True) == ""
    assert place_fault(moving, short_case) == ""
    assert fit_fault(moving, 0.5 * moving.value) == ""  # a poor model still explains three quarters


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1e-3, "while the pressure rises to 0.02 MPa: it seems to be at rest; .* are they in m"),
        (0.0, "it seems to be at rest"),
        (1e3, r"the largest displacement is 6e\+03 mm, and the finger is 43.3 mm long: .* are they in micrometres"),
        (-1.0, r"U3 of tip is \+6 mm at top pressure, but a pressurised finger bends to -z"),
    ],
)
def test_wrong_displacements_are_named(moving: Targets, short_case: Case, factor: float, told: str) -> None:
    import re

    assert re.search(told, motion_fault(scaled(moving, factor), short_case, bends_down=True))


def test_a_deck_may_bend_upwards(moving: Targets, short_case: Case) -> None:
    assert motion_fault(scaled(moving, -1.0), short_case, bends_down=False) == ""


def test_what_is_not_valid_or_not_on_the_finger_counts_for_nothing(moving: Targets, short_case: Case) -> None:
    value = moving.value.copy()
    value[:, 2] = 1e6  # the fixed marker
    value[0, 0] = 1e6
    valid = moving.valid.copy()
    valid[0, 0] = False
    assert motion_fault(replace(moving, value=value, valid=valid), short_case, bends_down=True) == ""


def test_a_pressure_that_never_rises_is_named(moving: Targets, short_case: Case) -> None:
    still = replace(moving, pressure=0.0 * moving.pressure)
    assert motion_fault(still, short_case, bends_down=True) == ""  # it may be filmed, and not calibrated with
    assert rise_fault(moving) == ""
    told = rise_fault(still)
    assert told.startswith("the pressure does not rise: it is 0 MPa at most")


def test_a_point_far_from_its_node_is_named(moving: Targets, short_case: Case) -> None:
    tip = moving.points[0]
    assert tip.node is not None
    place = short_case.position(tip.node) + [0.0, 0.0, 4.0]
    odd = (replace(tip, position=tuple(place.tolist())), *moving.points[1:])
    assert f"its node {tip.node} lies at" in place_fault(replace(moving, points=odd), short_case)
    assert "4.0 mm away; wanted at most 3 mm" in place_fault(replace(moving, points=odd), short_case)


def test_a_fit_that_explains_nothing_is_named(moving: Targets) -> None:
    told = fit_fault(moving, 2.0 * moving.value)  # the model moves the other way
    says(told, "U3", "-6 mm", "6 mm", "0.02 MPa")
    assert told.startswith("the best constants leave 5.9") or "of a motion of" in told
    assert fit_fault(moving, 0.8 * moving.value) != ""


def test_the_study_is_plausible() -> None:
    from twin.model.structure import base_case

    targets = Project.open(dataset("study")).targets()
    assert motion_fault(targets, base_case(), bends_down=True) == ""


def test_targets_in_kPa_are_refused_when_read(tmp_path: object) -> None:
    from pathlib import Path

    folder = Path(str(tmp_path))
    text = (dataset("study") / "targets" / "targets.csv").read_text()
    (folder / "targets.csv").write_text(text.replace("0.03,", "30.0,"))
    with pytest.raises(ValueError, match=saying("targets.csv", "pressure_MPa", "30 MPa")):
        read_targets(folder, nodes={"tip": 4401, "middle": 5848})


def test_sds_larger_than_what_they_are_of_are_refused(moving: Targets, short_case: Case) -> None:
    wide = replace(moving, covariance=1e6 * np.where(np.isnan(moving.covariance), np.nan, np.eye(3)))
    assert "their standard deviation is 1e+03 mm (median), and the largest displacement 6 mm" in motion_fault(
        wide, short_case, bends_down=True
    )


def bent(moving: Targets, u1: float) -> Targets:
    """A tip that bends down by 16 of 43 mm."""
    return replace(moving, value=moving.value * [u1, 1.0, 16.0 / 6.0])


def test_a_bent_finger_that_moves_away_from_the_clamp_is_refused(moving: Targets, short_case: Case) -> None:
    told = motion_fault(bent(moving, -4.0), short_case, bends_down=True)
    assert told.startswith("U1 of tip is +4 mm where its U3 is -16 mm")
    assert motion_fault(bent(moving, 4.0), short_case, bends_down=True) == ""
    assert motion_fault(bent(moving, -0.5), short_case, bends_down=True) == ""  # it lengthens
    assert motion_fault(bent(moving, -4.0), short_case, bends_down=False) == ""


def test_exchanged_points_are_told(moving: Targets, short_case: Case) -> None:
    assert doubts(moving, short_case) == ()
    swapped = replace(moving, value=moving.value[:, [1, 0, 2]])
    (told,) = doubts(swapped, short_case)
    assert told.startswith("Point middle at x = ")
    assert "tip at x = 43.33 mm by 2.01 mm, though it lies farther from the clamp" in told
    held = replace(moving, value=moving.value * np.array([0.5, 1.0, 1.0])[:, None])  # a tip that is hindered a little
    assert doubts(held, short_case) == ()

@pytest.mark.parametrize(("memory_GB", "told"), [(3.1, False), (2.9, True)])
def test_more_shared_errors_than_the_memory_holds_are_told_before_the_fit(
    moving: Targets, short_case: Case, monkeypatch: pytest.MonkeyPatch, memory_GB: float, told: bool
) -> None:
    """3.0 GB of the 3.2 that were measured of the film with 413 MB of shared errors (docs/records/engines.md)."""
    monkeypatch.setattr(sanity, "memory_of_computer", lambda: 1e9 * memory_GB)
    count = round(3.0e9 / (7 * 8 * int(moving.valid.sum())))
    modes = np.broadcast_to(np.zeros(()), (count, *moving.value.shape))  # takes no memory itself
    found = doubts(replace(moving, modes=modes, mode_names=("scale",) * count), short_case)
    assert len(found) == told
    if told:
        says(found[0], f"{count} errors", "3 GB", "fewer `steps` under [measure]")


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_mesh_that_the_memory_does_not_hold_is_told_before_it_is_solved(
    moving: Targets, short_case: Case, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    monkeypatch.setattr(sanity, "memory_of_computer", lambda: 32e9)
    nodes = round(share * 32e9 / sanity.NODE_BYTES)
    fine = replace(short_case, nodes=np.broadcast_to(short_case.nodes[0], (nodes, 3)))  # takes no memory itself
    found = sanity._too_fine(fine)
    assert bool(found) == (share > 1)
    if found:
        says(found, f"{nodes} nodes", "35 GB", "this computer has 32 GB", "`mesh` under [model]")
    assert not doubts(moving, short_case)


def test_the_memory_of_this_computer_is_plausible() -> None:
    assert sanity.memory_of_computer() > 5e8



def test_times_in_ms_are_told(moving: Targets, short_case: Case) -> None:
    steps = np.arange(1000).clip(0, len(moving.time) - 1)
    own = {name: getattr(moving, name)[steps] for name in ("pressure", "value", "covariance", "valid", "held_out", "pressure_sd")}
    long = replace(
        moving, **own, modes=moving.modes[:, steps], block=np.zeros(1000, np.int64), time=np.arange(1000) / 30, log_time=np.arange(1000) / 30,
        log_pressure=own["pressure"], gravity=None if moving.gravity is None else moving.gravity[:1], loads=(), noises=(),
    )  # fmt: skip
    assert doubts(long, short_case) == ()
    ms = replace(long, time=1e3 * long.time, log_time=1e3 * long.log_time)
    assert doubts(ms, short_case) == ("The steps of the targets are 33.3 s apart, 9.25 hours in all: is time_s in ms?",)


@pytest.mark.parametrize("pressure", [0.0, 0.05, 0.2])
def test_pressures_of_the_air_are_refused(pressure: float) -> None:
    course = np.array([0.0, 0.01, 0.03])
    assert zero_fault(course + pressure) == ""
    assert zero_fault(course + 0.1013).startswith("never falls below 0.1013 MPa")
    assert zero_fault(-course - 1e-3).startswith("falls to -0.031 MPa")
    assert zero_fault(course - 0.005) == ""  # a gauge that is off


@pytest.mark.parametrize(
    ("read", "top", "likely"),
    [("kPa", "mbar", "mbar"), ("kPa", "psi", "psi"), ("mbar", "kPa", "kPa"), ("psi", "kPa", "kPa"), ("bar", "kPa", "kPa"),
     ("MPa", "bar", "bar"), ("hPa", "psi", "psi")],
)  # fmt: skip
def test_a_regulator_tells_the_unit_of_the_log(read: str, top: str, likely: str) -> None:
    per_MPa = {"MPa": 1.0, "kPa": 1e3, "mbar": 1e4, "hPa": 1e4, "bar": 10.0, "psi": 145.04}
    peak = 0.03 * per_MPa[top] / per_MPa[read]  # of numbers in `top`, read as `read`
    told = top_fault(peak, unit=read, top_kPa=30.0)
    assert told.endswith(f"(top_kPa); wanted 20 to 45 kPa; the numbers are likely in {likely}")
    for near in (0.7, 1.0, 1.4):
        assert top_fault(0.03 * near, unit=read, top_kPa=30.0) == ""
    assert "calibration line right" in top_fault(peak, unit="V", top_kPa=30.0)
    assert top_fault(0.06, unit="kPa", top_kPa=30.0).endswith("no unit explains it: is top_kPa right, in kPa?")


def test_constants_of_no_silicone_are_told_with_the_unit() -> None:
    assert silicone_doubt(MOONEY_RIVLIN.usual(0.26), end=0) == silicone_doubt(MOONEY_RIVLIN.usual(0.03), end=0) == silicone_doubt(MOONEY_RIVLIN.usual(1.9), end=0) == ""
    says(silicone_doubt(MOONEY_RIVLIN.usual(2.6), end=0), "0.02", "2 MPa")
    assert "Is the pressure read too low, as kPa read as mbar" in silicone_doubt(MOONEY_RIVLIN.usual(0.015), end=0)
    assert "1 MPa: the constants end at their bounds. Is the pressure read too high" in silicone_doubt(MOONEY_RIVLIN.usual(1.0), end=1)
    assert "read too low" in silicone_doubt(MOONEY_RIVLIN.usual(0.1), end=-1)


def test_a_fit_that_stability_has_stopped_is_told() -> None:
    negative = MOONEY_RIVLIN.at(0.3, (-0.3,))  # C01 = -0.09 MPa
    assert stability_doubt(MOONEY_RIVLIN.at(0.3, (0.28,))) == stability_doubt(negative, sd=0.05) == ""
    says(stability_doubt(negative, sd=0.04), "C01/(C10 + C01) is -0.30, below zero", "tensile test")
    assert stability_doubt(negative, sd=0.05, stretch=1.7) == ""
    says(stability_doubt(negative, sd=0.05, stretch=2.6), "at the stretch of 2.6 that the model reaches", "not stable")
    assert "C01/(C10 + C01) is -0.60, and with less the rubber would not be stable" in stability_doubt(MOONEY_RIVLIN.at(0.3, (-0.598,)))


def test_an_end_is_one_where_all_constants_end_on_one_side() -> None:
    from calibrate import Parameter

    both = (Parameter("C10", 0.01, 0.5, "MPa"), Parameter("C01", 0.0, 0.5, "MPa"))
    for theta, at, wanted in (
        ((0.5, 0.5), ("C10", "C01"), 1), ((0.01, 0.0), ("C10", "C01"), -1), ((0.5, 0.0), ("C10", "C01"), 0),
        ((0.5, 0.2), ("C10",), 0), ((0.2, 0.2), (), 0),
    ):  # fmt: skip
        assert _end(SimpleNamespace(theta=np.array(theta), at_bound=at, parameters=both)) == wanted


def test_a_value_that_stands_for_no_reading_is_no_sign() -> None:
    course = np.linspace(0.0, 0.03, 50)
    gaps = np.r_[course, [-0.999] * 5]
    assert zero_fault(gaps).startswith("is exactly -0.999 MPa in 5 of 55 rows, and 0 to 0.03 MPa in all others")
    assert zero_fault(-course).startswith("falls to -0.03 MPa")


def test_targets_in_which_nothing_is_valid_are_refused(moving: Targets, short_case: Case) -> None:
    unseen = replace(moving, valid=np.zeros_like(moving.valid))
    assert motion_fault(unseen, short_case, bends_down=True).startswith("no displacement of a point on the finger is valid")


def test_loads_on_a_body_without_weight_are_told(moving: Targets, short_case: Case) -> None:
    hung = replace(moving, loads=(Load(0, "tip", weight_g=20.0),))
    (told,) = doubts(hung, short_case.with_material(density=0.0))
    says(told, "(at tip)", "no density", "density_kg_m3")
    assert doubts(hung, short_case.with_material(density=1.07e-9)) == ()
