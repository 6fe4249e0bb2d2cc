"""Effects of the measurement: the picture that the camera makes of all markers, and the clocks."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import scipy

from calibrate import Parameter
from twin.effects.phrases import felt, listed, number, percent, way
from twin.effects.protocol import Effect, Family, Order, Test, Theta, symmetric
from twin.effects.requirements import Requirement
from twin.targets import Array

DISTANCE = 500.0  # mm from the camera to the markers: what a tilt is stated for


class CameraScale(Effect):
    """The picture is magnified: all positions are seen (1 + scale) times as far from the origin."""

    name, order = "camera_scale", Order.CAMERA
    sentence = "the picture's scale (mm per pixel) is wrong by a constant factor"
    generic = "camera"
    # a ruler of 100 mm read to 1 mm at either end is off by 1 %, one in another plane by 3 % (judgement)
    parameters = symmetric("camera_scale.scale", most=0.2, unit="", step=0.01, likely=0.03)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        scale = theta["camera_scale.scale"]
        return u + scale * (test.points + u)

    def told(self, values: Theta) -> str:
        scale = values["camera_scale.scale"]
        off = f"{percent(scale)} too {way(scale, 'long', 'short')}"
        return f"the picture's scale is wrong: lengths look {off}"


class CameraBreathing(Family):
    """The picture of the finger is magnified by `scale` more at its farthest motion than at rest: it comes
    nearer to the camera as it bends, or the focus breathes. Fixed markers stay where they are.

    Positions P, from the markers' middle at rest, are seen at P + (scale m + square m^2) (P - c), with m
    from 0 to 1 the mean displacement of all moving markers along its largest, over that; square from two
    terms on. With three terms the place (along, 0, up) of c is free: a picture grows about the lens's axis,
    wherever that points. Else c is 0.
    """

    name, order = "camera_breathing", Order.CAMERA
    sentence = "the picture's scale grows with the finger's motion"
    generic = "camera"
    most = 3
    added: ClassVar[Theta] = dict.fromkeys(
        ("camera_breathing.square", "camera_breathing.along", "camera_breathing.up"), 0.0
    )

    def law(self, terms: int) -> tuple[Parameter, ...]:
        # 5 mm nearer at a distance of 500 mm is 1 %; a lens breathes by some percent (judgement)
        names = ("camera_breathing.scale", "camera_breathing.square")[:terms]
        scales = symmetric(*names, most=0.1, unit="", step=0.005, likely=0.02)
        about = ("camera_breathing.along", "camera_breathing.up")[: 2 * (terms - 2)]
        return scales + tuple(Parameter(name, -200.0, 200.0, "mm", typical=10.0) for name in about)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        if not test.moving.any():
            return u
        mean = u[:, test.moving].mean(axis=1)
        length = np.linalg.norm(mean, axis=1)
        share = mean @ mean[length.argmax()] / max(float(length.max()), 1e-12) ** 2
        scale = share * theta["camera_breathing.scale"]
        scale = scale + share**2 * theta.get("camera_breathing.square", 0.0)
        c = [theta.get("camera_breathing.along", 0.0), 0.0, theta.get("camera_breathing.up", 0.0)]
        seen = test.points + u - test.points[test.moving].mean(axis=0) - c
        return u + scale[:, None, None] * seen * test.moving[:, None]

    def told(self, values: Theta) -> str:
        scale = values["camera_breathing.scale"] + values.get("camera_breathing.square", 0.0)
        turn = f"{percent(scale)} too {way(scale, 'long', 'short')}"
        return f"the picture's scale changes with the motion: at its farthest, lengths look {turn}"


class CameraRotation(Effect):
    """The world frame is turned in the picture by `angle` about y: positions P are seen at R P, with

    R P = (x cos a - z sin a, y, x sin a + z cos a), exact for any angle.
    """

    name, order = "camera_rotation", Order.CAMERA
    sentence = "the picture is turned: its horizontal is not the finger's axis"
    generic = "camera"
    # a frame of markers 100 mm apart, each placed to 2 mm, is turned by up to 2 degrees (judgement)
    parameters = symmetric("camera_rotation.angle", most=0.2, unit="rad", step=0.01, likely=0.035)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        seen, a = test.points + u, theta["camera_rotation.angle"]
        return u + seen @ (turn(1, a) - np.eye(3)).T

    def told(self, values: Theta) -> str:
        angle = values["camera_rotation.angle"]
        return f"the picture is turned by {_degrees(angle)}, the tip {way(angle, 'up', 'down')}"


class CameraTilt(Effect):
    """Tilt of the picture's plane against the plane of the motion: by `up` about x and by `aside` about z.

    Positions q, from the markers' middle, are turned by both, q' = T q, and projected from a camera
    DISTANCE away: seen at q'_x k and q'_z k with k = (1 + q_y / D) / (1 + q'_y / D), exact for any angle. To
    first order x is seen at x (1 - (aside x + up z) / D) - aside y: nearer parts look larger.
    """

    name, order = "camera_tilt", Order.CAMERA
    sentence = "the camera looks at the finger obliquely, and its calibration does not know"
    generic = "camera"
    # a camera set up by eye is square to the finger to about 2 degrees (judgement)
    parameters = symmetric(
        "camera_tilt.aside", "camera_tilt.up", most=0.3, unit="rad", step=0.02, likely=0.035
    )

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        q = test.points + u - test.points.mean(axis=0)
        turned = q @ (turn(0, theta["camera_tilt.up"]) @ turn(2, theta["camera_tilt.aside"])).T
        nearer = (1 + q[..., 1] / DISTANCE) / (1 + turned[..., 1] / DISTANCE)
        seen = turned * np.stack([nearer, np.ones_like(nearer), nearer], axis=-1)
        return u + (seen - q)

    def told(self, values: Theta) -> str:
        angles = [values[f"camera_tilt.{k}"] for k in ("aside", "up")]
        tilts = [f"by {_degrees(a)} with {what} {way(a, 'too far', 'too near')}"
                for a, what in zip(angles, ("the tip", "the top"), strict=True)]  # fmt: skip
        both = listed([tilts[k] for k in felt(angles)])
        return f"the camera looks at the finger obliquely, {both or 'by 0 degrees'}"


def _degrees(angle: float) -> str:
    """The size of an angle in rad, in degrees."""
    size = number(np.degrees(angle))
    return f"{size} degree{'s' * (size != '1')}"


def turn(axis: int, angle: float) -> Array:
    """The rotation (3, 3) by an angle in rad about x, y or z (axis 0, 1, 2); about y from x towards z.

    >>> turn(1, np.pi / 2).round(6) @ [1.0, 0.0, 0.0]
    array([0., 0., 1.])
    """
    i, k = [(1, 2), (0, 2), (0, 1)][axis]
    out = np.eye(3)
    out[[i, k, i, k], [i, k, k, i]] = np.cos(angle), np.cos(angle), -np.sin(angle), np.sin(angle)
    return out


# -- clocks --------------------------------------------------------------------------------------------------

class TimeShift(Effect):
    """The film's clock is late against the pressure log's: at its time t the film shows the finger under the
    pressure that the log has at t - shift."""

    name, order, requires = "time_shift", Order.CLOCK, (Requirement.HISTORY,)
    sentence = "the film's clock and the clock of the pressure log do not agree"
    generic = "pressure course"
    # clocks set by hand or by a click agree to some frames of a film, 0.1 to 0.3 s (judgement)
    parameters = symmetric("time_shift.s", most=2.0, unit="s", step=0.05, likely=0.3)

    def before(self, test: Test, theta: Theta) -> Test:
        path, shift = test.path, theta["time_shift.s"]
        drift = None if path.stiffness is None else shifted(path.time, path.stiffness, shift)
        late = shifted(path.time, path.pressure, shift)
        return replace(test, path=replace(path, pressure=late, stiffness=drift))

    def told(self, values: Theta) -> str:
        shift = values["time_shift.s"]
        later = f"{number(shift)} s {way(shift, 'later', 'earlier')}"
        return f"the film shows everything {later} than the pressure log"


def shifted(time: Array, values: Array, shift: float) -> Array:
    """Values (t,) at `shift` s before the times (t,) s, by cubics through them (Catmull & Rom 1974), so that
    the map has one slope where a log has a corner; constant before the first time.

    >>> shifted(np.arange(4.0), np.array([0.0, 1.0, 2.0, 3.0]), 0.5)
    array([0. , 0.5, 1.5, 2.5])
    """
    if len(time) < 2:
        return values
    curve = scipy.interpolate.CubicHermiteSpline(time, values, np.gradient(values, time))
    return np.asarray(values + (curve(np.clip(time - shift, time[0], time[-1])) - curve(time)), float)
