"""Marks that peel off are named; marks of a finger that merely bends, creeps and lags are not."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vision import Mark, View, measure
from vision.doubts.slips import find_slips
from vision.drawing import synthetic
from vision.film.video import Video
from vision.kinds import CodedMarker

Array = NDArray[np.float64]
Lab = Any
SD = 0.004  # mm
X = np.array([20.0, 40.0, 60.0, 80.0, 95.0])
MARKS = tuple(Mark(f"m{i}", CodedMarker(i, 9.0), (float(x), 12.0, 0.0), "finger") for i, x in enumerate(X))
LOAD = np.concatenate([np.zeros(15), np.linspace(0, 1, 40), np.ones(15), np.linspace(1, 0, 40), np.zeros(15)])


def finger(load: Array, *, lag: float = 0.0, marks: int = 5) -> tuple[Array, Array]:
    """Displacements (s,p,3) mm and turns (s,p) of a bent and stretched finger, with hysteresis in its shape."""
    late = np.concatenate([load[:1], load[:-1]])
    bend = 0.015 * load + 1e-9
    uneven = lag * 1e-4 * (load - late) / max(float(np.abs(load - late).max()), 1e-12)
    along = X[:marks] * (1.0 + 0.05 * load[:, None])
    turn = -(bend[:, None] * along + uneven[:, None] * along**2)
    points = np.linspace(0.0, 1.0, 60)
    angle = -(
        bend[:, None, None] * along[..., None] * points
        + uneven[:, None, None] * (along[..., None] * points) ** 2
    )
    place = along[..., None] * np.stack([np.cos(angle).mean(axis=-1), np.sin(angle).mean(axis=-1)], -1)
    value = np.full((*place.shape[:2], 3), np.nan)
    value[..., [0, 2]] = place - place[0]
    return value, turn


def slipped(value: Array, turn: Array, p: int, frame: int, shift: tuple[float, float], rng: Any) -> Array:
    """The displacements with noise, and mark p shifted on the finger from a frame on."""
    c, s = np.cos(turn[frame:, p]), np.sin(turn[frame:, p])
    moved = value + SD * rng.standard_normal(value.shape)
    moved[frame:, p, 0] += c * shift[0] - s * shift[1]
    moved[frame:, p, 2] += s * shift[0] + c * shift[1]
    return moved


def said(value: Array, turn: Array) -> tuple[str, ...]:
    return find_slips(
        np.arange(len(value)) / 10.0, value, turn, np.full((value.shape[1], 3), SD), MARKS[: value.shape[1]]
    )


@pytest.mark.parametrize("marks", [3, 5])
@pytest.mark.parametrize("frame", [25, 48, 62, 90])
def test_the_mark_that_slips_is_named_with_time_and_size(frame: int, marks: int) -> None:
    rng = np.random.default_rng(frame)
    for draw in range(20):
        value, turn = finger(LOAD, marks=marks)
        p, angle = draw % marks, rng.uniform(0, 2 * np.pi)
        shift = (0.5 * np.cos(angle), 0.5 * np.sin(angle))
        (one,) = said(slipped(value, turn, p, frame, shift, rng), turn)
        assert f"Marker 'm{p}' jumps by 0.5" in one or f"Marker 'm{p}' jumps by 0.4" in one
        assert f"at {frame / 10:.3f} s (x " in one


def test_two_marks_that_slip_are_both_named() -> None:
    rng = np.random.default_rng(1)
    value, turn = finger(LOAD)
    both = slipped(slipped(value, turn, 1, 30, (0.4, 0.1), rng), turn, 3, 100, (-0.2, 0.5), rng)
    found = said(both, turn)
    assert sorted(sentence.split("'")[1] for sentence in found) == ["m1", "m3"]


def test_no_alarm_without_a_slip() -> None:
    """Noise, hysteresis of the shape (0.1 mm and more), a rest that is not reached, a tag that lifts and comes back."""
    rng = np.random.default_rng(2)
    jump = np.concatenate([np.zeros(20), np.ones(20), np.zeros(20)])
    for load in (LOAD, jump, LOAD[:70], np.zeros(60), LOAD + 0.03 * (np.arange(125) > 80)):
        for lag in (0.0, 1.0):
            for _ in range(10):
                value, turn = finger(load, lag=lag)
                assert said(slipped(value, turn, 0, 0, (0.0, 0.0), rng), turn) == ()
    value, turn = finger(np.repeat(LOAD, 8))
    lifted = slipped(value, turn, 2, 480, (0.0, 0.5), rng)
    lifted[-6:, 2] = value[-6:, 2]
    assert said(lifted, turn) == ()


def test_the_smallest_slip_that_is_said_follows_the_stated_sd() -> None:
    rng = np.random.default_rng(3)
    value, turn = finger(LOAD)
    for shift, alarms in ((4 * SD, 0), (20 * SD, 1)):
        moved = slipped(value, turn, 2, 62, (shift, 0.0), rng)
        assert len(said(moved, turn)) == alarms
    unsure = find_slips(np.arange(125) / 10.0, moved, turn, np.full((5, 3), 10 * SD), MARKS)
    assert unsure == ()  # the same slip is within what is stated


def test_a_tag_that_peels_off_in_a_drawn_film(lab: Lab, still: Video, tmp_path: Any) -> None:
    bend = np.concatenate(
        [np.zeros(14), np.linspace(0, 0.012, 12)[1:], np.full(4, 0.012), np.linspace(0.012, 0, 10)]
    )
    place, turn = lab.motion(bend)
    tip = lab.rows("finger")[2]
    place[22:, tip] += (
        np.stack([np.cos(turn[22:, tip]), 0 * turn[22:, tip], np.sin(turn[22:, tip])], axis=-1) * 0.6
    )
    path = tmp_path / "peeled.mkv"
    drawn = {"camera": lab.camera, "pose": lab.pose, "marks": lab.marks, "codec": "rawvideo", "seed": 4}
    synthetic.film(path, positions=place, rotations=turn, **drawn)
    result = measure([View(Video(path), still, lab.camera)], lab.marks, reference=1.15)
    (one,) = [remark for remark in result.remarks if "peels" in remark]
    assert one.startswith(f"Marker {lab.marks[tip].name!r} jumps by 0.60 mm against")
    assert "at 2.200 s (x +0.60, z" in one
    true = place[:, [*lab.rows("fixed", "finger")]]
    np.testing.assert_allclose(  # nothing is corrected
        result.value[..., [0, 2]], (true - true[0])[..., [0, 2]], atol=0.01
    )
