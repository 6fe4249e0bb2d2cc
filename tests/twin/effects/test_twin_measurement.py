"""What the camera makes of positions: exact rotations, and a pinhole that looks obliquely."""

from dataclasses import replace

import numpy as np

from twin.contract.specimen import motion, small_test
from twin.effects.library import effect
from twin.effects.measurement import DISTANCE, turn
from twin.effects.protocol import Test


def spread_out() -> Test:
    """The small test with markers apart in all directions, the last on the rig."""
    points = np.array([[20.0, 11.5, 5.0], [100.0, -3.0, 40.0], [60.0, 20.0, -30.0]])
    return replace(small_test(), points=points)


def test_a_turned_picture_shows_turned_positions() -> None:
    test, a = spread_out(), 0.1
    u = motion(test)
    seen = test.points + effect("camera_rotation").after(u, test, {"camera_rotation.angle": a})
    x, y, z = np.moveaxis(test.points + u, -1, 0)
    wanted = np.stack([x * np.cos(a) - z * np.sin(a), y, x * np.sin(a) + z * np.cos(a)], axis=-1)
    np.testing.assert_allclose(seen, wanted, rtol=0, atol=1e-12)


def test_an_oblique_picture_is_that_of_a_pinhole() -> None:
    test, (aside, up) = spread_out(), (0.05, -0.03)
    u, middle = motion(test), spread_out().points.mean(axis=0)
    seen = effect("camera_tilt").after(u, test, {"camera_tilt.aside": aside, "camera_tilt.up": up})
    for s, p in np.ndindex(u.shape[:2]):
        q = test.points[p] + u[s, p] - middle
        turned = turn(0, up) @ turn(2, aside) @ q
        picture = turned[[0, 2]] / (DISTANCE + turned[1])  # a focal length of 1
        back = picture * (DISTANCE + q[1])  # placed at the depth that the calibration believes
        np.testing.assert_allclose((test.points[p] + seen[s, p] - middle)[[0, 2]], back, rtol=0, atol=1e-11)


def test_what_does_not_move_is_seen_still() -> None:
    test = spread_out()
    u = motion(test) * test.moving[:, None]
    for e in (effect(n) for n in ("camera_scale", "camera_rotation", "camera_tilt")):
        seen = e.after(u, test, {p.name: p.step for p in e.parameters})
        assert np.ptp(seen[:, ~test.moving], axis=0).max() == 0.0
        assert np.ptp(seen[:, test.moving] - u[:, test.moving], axis=0).max() > 1e-4


def test_a_picture_that_breathes_is_magnified_by_how_far_the_finger_has_moved() -> None:
    test, scale, square = spread_out(), -0.02, 0.01
    motion_of_all = np.array([0.0, 0.5, -2.0, 1.0])[:, None, None] * [[[-3.0, 0.5, -4.0]]] * test.moving[:, None]
    values = {"camera_breathing.scale": scale, "camera_breathing.square": square}
    seen = effect("camera_breathing:2").after(motion_of_all, test, values)
    share = np.array([0.0, -0.25, 1.0, -0.5])[:, None, None]  # the farthest is the third
    middle = test.points[test.moving].mean(axis=0)
    wanted = motion_of_all + (scale * share + square * share**2) * (test.points + motion_of_all - middle)
    np.testing.assert_allclose(seen[:, test.moving], wanted[:, test.moving], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(seen[:, ~test.moving], motion_of_all[:, ~test.moving])


def test_a_picture_may_breathe_about_any_place() -> None:
    test = spread_out()
    u = motion(test) * test.moving[:, None]
    values = {"camera_breathing.scale": 0.01, "camera_breathing.square": -0.004}
    place = np.array([31.0, 0.0, -12.0])
    about = dict(zip(("camera_breathing.along", "camera_breathing.up"), place[[0, 2]], strict=True))
    narrow = effect("camera_breathing:2").after(u, test, values)
    wide = effect("camera_breathing:3").after(u, test, {**values, **about})
    distance = (test.points + u)[:, test.moving] - test.points[test.moving].mean(axis=0)
    growth = (narrow - u)[:, test.moving, :1] / distance[..., :1]
    np.testing.assert_allclose(wide[:, test.moving], narrow[:, test.moving] - growth * place, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(wide[:, ~test.moving], u[:, ~test.moving])
    none = {**values, **dict.fromkeys(about, 0.0)}
    np.testing.assert_array_equal(effect("camera_breathing:3").after(u, test, none), narrow)
