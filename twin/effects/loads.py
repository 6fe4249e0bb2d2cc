"""Effects of what loads the structure: the pressure as the chamber feels it, and weight."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from calibrate import Parameter
from twin.effects.families import Parts, Wide, in_logs
from twin.effects.mechanism import Mechanism, Owner
from twin.effects.phrases import listed, number, percent, way
from twin.effects.protocol import Effect, Order, Test, Theta, symmetric
from twin.effects.requirements import Requirement
from twin.gravity import pulls_across
from twin.targets import Array

# MPa: a gauge that is not zeroed before the test is off by up to 1 kPa, 10 cm of water (judgement)
ZERO = 1e-3


class PressureGain(Effect):
    """The gauge reads wrong by a constant factor: true pressure = (1 + gain) recorded.

    >>> from fe import Path
    >>> clock = np.array([0.0, 1.0, 2.0])
    >>> test = Test(None, Path(clock, 0.03 * clock, clock), np.zeros((0, 3)), np.zeros(0, bool))
    >>> gauge = PressureGain()
    >>> gauge.before(test, {"pressure_gain.gain": 0.1}).path.pressure  # MPa
    array([0.   , 0.033, 0.066])
    >>> absent = gauge.before(test, {"pressure_gain.gain": 0.0})  # at null the prediction equals the base's
    >>> bool((absent.path.pressure == test.path.pressure).all())
    True
    >>> gauge.told({"pressure_gain.gain": -0.03})
    'the pressure gauge reads too much: the pressure is 3 % lower'
    """

    name, order = "pressure_gain", Order.GAUGE_GAIN
    sentence = "the pressure gauge reads wrong by a constant factor"
    generic = "pressure course"
    # cheap gauges state 1 to 2.5 % of their range, and are read at a third of it (judgement)
    parameters = symmetric("pressure_gain.gain", most=0.3, unit="", step=0.02, likely=0.1)

    def before(self, test: Test, theta: Theta) -> Test:
        gain = 1 + theta["pressure_gain.gain"]
        return replace(test, path=replace(test.path, pressure=test.path.pressure * gain))

    def told(self, values: Theta) -> str:
        gain = values["pressure_gain.gain"]
        much, higher = way(gain, "little", "much"), way(gain, "higher", "lower")
        return f"the pressure gauge reads too {much}: the pressure is {percent(gain)} {higher}"

    def wide(self) -> Effect:
        return GaugeCurve()


class GaugeCurve(Wide, of=PressureGain):
    """The gauge's calibration is a smooth curve: true = offset + p (1 + gain + bend x + turn x^2), with
    x = p / 0.1 MPa."""

    sentence = "the pressure gauge is not as straight as its calibration"
    UNIT: ClassVar[float] = 0.1  # MPa
    parameters = (
        *symmetric("pressure_gain.offset", most=5e-3, unit="MPa", step=2e-4, likely=ZERO),
        Parameter("pressure_gain.gain", -0.3, 0.3, "", null=0.0, typical=0.02, plausible=(-0.1, 0.1)),
        Parameter("pressure_gain.bend", -2.0, 2.0, "", null=0.0, typical=0.05, plausible=(-0.3, 0.3)),
        Parameter("pressure_gain.turn", -8.0, 8.0, "", null=0.0, typical=0.2, plausible=(-1.0, 1.0)),
    )

    def before(self, test: Test, theta: Theta) -> Test:
        offset, gain, bend, turn = (theta[p.name] for p in self.parameters)
        p = test.path.pressure
        x = p / self.UNIT
        true = p + (offset + p * (gain + bend * x + turn * x**2))
        return replace(test, path=replace(test.path, pressure=true))

    def told(self, values: Theta) -> str:
        offset, gain, bend, turn = (values[p.name] for p in self.parameters)
        read = np.array([0.0, 0.01, 0.03])  # MPa
        x = read / self.UNIT
        off = offset + read * (gain + bend * x + turn * x**2)
        readings = [f"{_kilopascals(o)} too {way(o, 'little', 'much')} at {1e3 * p:.0f} kPa"
                for o, p in zip(off, read, strict=True)]  # fmt: skip
        return f"the pressure gauge is not straight: it reads {listed(readings)}"


class PressureOffset(Effect):
    """The gauge's zero is off: true pressure = recorded + offset, after any gain."""

    name, order = "pressure_offset", Order.GAUGE_OFFSET
    sentence = "the pressure gauge does not read zero without pressure"
    generic = "pressure course"
    parameters = symmetric("pressure_offset.offset", most=5e-3, unit="MPa", step=2e-4, likely=ZERO)

    def before(self, test: Test, theta: Theta) -> Test:
        pressure = test.path.pressure + theta["pressure_offset.offset"]
        return replace(test, path=replace(test.path, pressure=pressure))

    def told(self, values: Theta) -> str:
        offset = values["pressure_offset.offset"]
        return f"the pressure gauge reads {_kilopascals(offset)} too {way(offset, 'little', 'much')}"

    def wide(self) -> Effect:
        return ZeroDrift()


class ZeroDrift(Wide, of=PressureOffset):
    """The gauge's zero drifts: true = p + offset + slope x + bend x (1 - x), x in minutes on the clock of the
    pressure log."""

    sentence = "the zero of the pressure gauge drifts"
    MINUTE: ClassVar[float] = 60.0  # s
    parameters = symmetric(
        *(f"pressure_offset.{k}" for k in ("offset", "slope", "bend")),
        most=5e-3,
        unit="MPa",
        step=2e-4,
        likely=ZERO,
    )

    def before(self, test: Test, theta: Theta) -> Test:
        offset, slope, bend = (theta[p.name] for p in self.parameters)
        x = test.path.time / self.MINUTE
        pressure = test.path.pressure + offset + slope * x + bend * x * (1 - x)
        return replace(test, path=replace(test.path, pressure=pressure))

    def told(self, values: Theta) -> str:
        offset, slope, _ = (values[p.name] for p in self.parameters)
        begin, later = (f"{_kilopascals(o)} too {way(o, 'little', 'much')}" for o in (offset, offset + slope))
        return f"the zero of the pressure gauge drifts: it reads {begin} at first, {later} a minute later"


class Gravity(Effect):
    """The silicone has a density, or more than the base model: its weight bends the finger, at rest too."""

    name, order, requires = "gravity", Order.MATERIAL, (Requirement.GRAVITY,)
    mechanism = Mechanism.LOAD
    belongs = Owner.SILICONE  # its density
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

    def told(self, values: Theta) -> str:
        more = 1e9 * values["gravity.density"]
        return f"the finger bends under its own weight, of {more:.3g} g/cm3 more than in the model"

    def breaks_symmetry(self, test: Test) -> bool:
        return pulls_across(test.path)

    def wide(self) -> Effect:
        return Parts(self)


class PressureLag(Effect):
    """The chamber follows the gauge as a first-order line: tau dp/dt = recorded - p."""

    name, order, requires = "pressure_lag", Order.LINE, (Requirement.HISTORY,)
    sentence = "the pressure in the chamber lags behind the gauge (hose and orifice)"
    generic = "pressure course"
    # 2 m of hose of 4 mm fill 20 ml in 0.05 to 0.5 s (judgement)
    parameters = (Parameter("pressure_lag.tau", 0.0, 5.0, "s", null=0.0, typical=0.1, plausible=(0.0, 1.0)),)

    def before(self, test: Test, theta: Theta) -> Test:
        path = test.path
        lagged = first_order_lag(path.time, path.pressure, theta["pressure_lag.tau"])
        return replace(test, path=replace(path, pressure=lagged))

    def told(self, values: Theta) -> str:
        late = number(values["pressure_lag.tau"])
        return f"the pressure in the chamber lags {late} s behind the gauge (hose and orifice)"

    def wide(self) -> Effect:
        return DistributedLag()


class DistributedLag(Wide, of=PressureLag):
    """The chamber follows the gauge by a kernel: p + sum w (p behind a first-order line of tau - p), on fixed
    TAUS. With weights of both signs it comes near to a line of second order, or with dead time."""

    TAUS: ClassVar[tuple[float, ...]] = (0.05, 0.15, 0.4, 1.2, 4.0)  # s
    parameters = tuple(
        Parameter(f"pressure_lag.w{k}", -2.0, 3.0, "", null=0.0, typical=0.1, plausible=(-0.5, 1.0))
        for k in range(1, len(TAUS) + 1)
    )

    def before(self, test: Test, theta: Theta) -> Test:
        t, p = test.path.time, test.path.pressure
        late = sum(
            theta[w.name] * (first_order_lag(t, p, tau) - p)
            for w, tau in zip(self.parameters, self.TAUS, strict=True)
        )
        return replace(test, path=replace(test.path, pressure=p + late))

    def told(self, values: Theta) -> str:
        late = sum(values[w.name] * tau for w, tau in zip(self.parameters, self.TAUS, strict=True))
        side = way(late, "behind", "ahead of")
        return f"the pressure in the chamber is {number(late)} s {side} the gauge, by more than one delay"

    def amounts(self, theta: Theta) -> dict[str, float]:
        """Weights of a single delay tau, shared by the two nearest of TAUS; a tau below the least has a
        smaller one."""
        tau = theta.get("pressure_lag.tau", 0.0)
        term = (min(tau / self.TAUS[0], 1.0), max(tau, self.TAUS[0]))
        return self.bounded(in_logs([term], self.TAUS))


def _kilopascals(pressure: float) -> str:
    """The size of a pressure in MPa, in kPa."""
    return f"{number(1e3 * pressure)} kPa"


def first_order_lag(time: Array, pressure: Array, tau: float) -> Array:
    """The response (t,) of tau dy/dt + y = p, exact for p linear between the times (t,) s, settled at the
    start.

    For tau <= 0 the linear continuation p - tau dp/dt, so that the map can be differenced at tau = 0.

    >>> time = np.linspace(0.0, 3.0, 4)
    >>> first_order_lag(time, time, 1.0).round(3)  # a ramp t is followed by t - tau (1 - exp(-t / tau))
    array([0.   , 0.368, 1.135, 2.05 ])
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
        previous = out[n] if abs(out[n]) > 1e-150 else 0.0  # of long ago; its decay would underflow
        out[n + 1] = decay[n] * previous + drive[n]
    return out
