"""Effects of what loads the structure: the pressure as the chamber feels it, and weight."""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from calibrate import Parameter
from twin.effects.protocol import Effect, Order, Test, Theta
from twin.effects.requirements import Requirement
from twin.gravity import pulls_across
from twin.targets import Array


class PressureGain(Effect):
    """The gauge reads wrong by a constant factor: true pressure = (1 + gain) recorded."""

    name, order = "pressure_gain", Order.GAUGE_GAIN
    sentence = "the pressure gauge reads wrong by a constant factor"
    parameters = (Parameter("pressure_gain.gain", -0.3, 0.3, "", null=0.0, typical=0.02),)
    separations: ClassVar[Mapping[str, str]] = {
        "camera_scale": "measure the pressure gauge against a second one"
    }

    def before(self, test: Test, theta: Theta) -> Test:
        gain = 1 + theta["pressure_gain.gain"]
        return replace(test, path=replace(test.path, pressure=test.path.pressure * gain))


class PressureOffset(Effect):
    """The gauge's zero is off: true pressure = recorded + offset, after any gain."""

    name, order = "pressure_offset", Order.GAUGE_OFFSET
    sentence = "the pressure gauge does not read zero without pressure"
    parameters = (Parameter("pressure_offset.offset", -5e-3, 5e-3, "MPa", null=0.0, typical=2e-4),)

    def before(self, test: Test, theta: Theta) -> Test:
        pressure = test.path.pressure + theta["pressure_offset.offset"]
        return replace(test, path=replace(test.path, pressure=pressure))


class Gravity(Effect):
    """The silicone has a density, or more than the base model: its weight bends the finger, at rest too."""

    name, order, requires = "gravity", Order.MATERIAL, (Requirement.GRAVITY,)
    sentence = "the finger bends under its own weight"
    parameters = (
        Parameter(
            "gravity.density", 0.0, 5e-9, "tonne/mm3", null=0.0, typical=1e-9, plausible=(0.9e-9, 1.3e-9)
        ),
    )

    def before(self, test: Test, theta: Theta) -> Test:
        case, materials = test.case, dict(test.case.materials)
        for name in materials.keys() - set(case.kept):
            density = materials[name].density + theta["gravity.density"]
            materials[name] = replace(materials[name], density=density)
        return replace(test, case=replace(case, materials=materials))

    def breaks_symmetry(self, test: Test) -> bool:
        return pulls_across(test.path)


class PressureLag(Effect):
    """The chamber follows the gauge as a first-order line: tau dp/dt = recorded - p."""

    name, order, requires = "pressure_lag", Order.LINE, (Requirement.HISTORY,)
    sentence = "the pressure in the chamber lags behind the gauge (hose and orifice)"
    parameters = (Parameter("pressure_lag.tau", 0.0, 5.0, "s", null=0.0, typical=0.1),)

    def before(self, test: Test, theta: Theta) -> Test:
        path = test.path
        lagged = first_order_lag(path.time, path.pressure, theta["pressure_lag.tau"])
        return replace(test, path=replace(path, pressure=lagged))


def first_order_lag(time: Array, pressure: Array, tau: float) -> Array:
    """The response (t,) of tau dy/dt + y = p, exact for p linear between the times (t,) s, settled at the
    start.

    For tau <= 0 the linear continuation p - tau dp/dt, so that the map can be differenced at tau = 0.
    """
    slope = np.diff(pressure) / np.diff(time)
    if tau <= 0:
        return pressure - tau * np.concatenate([[0.0], slope])
    x = np.diff(time) / tau
    decay = np.exp(-np.minimum(x, 300.0))  # times a pressure this is still a normal number
    out = np.empty_like(pressure)
    out[0] = pressure[0]
    drive = pressure[1:] - decay * pressure[:-1] - tau * slope * (1 - decay)
    for n in range(len(x)):
        out[n + 1] = decay[n] * out[n] + drive[n]
    return out
