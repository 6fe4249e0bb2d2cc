"""Effects of the clocks: film and pressure log do not agree on the time."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from twin.effects.amounts import number, way
from twin.effects.protocol import Effect, Order, Test, Theta, symmetric
from twin.effects.requirements import Requirement
from twin.targets import Array


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
    the map has one slope where a log has a corner; before the first time it is as at the first."""
    if len(time) < 2:
        return values
    curve = CubicHermiteSpline(time, values, np.gradient(values, time))
    return np.asarray(values + (curve(np.clip(time - shift, time[0], time[-1])) - curve(time)), float)
