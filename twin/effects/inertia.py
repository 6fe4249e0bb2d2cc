"""The finger's inertia: after a fast change of the pressure it swings about its equilibrium."""

from dataclasses import replace

import numpy as np

from calibrate import Parameter
from fe.dynamics.onevibration import driven
from twin.effects.mechanism import Mechanism, Owner
from twin.effects.phrases import number
from twin.effects.protocol import Effect, Family, Order, Test, Theta
from twin.effects.requirements import Requirement, SLOWEST_Hz, fastest_Hz
from twin.targets import Array

RATIO = 1.12  # of two frequencies that are tried one after the other: half of what a damping of 0.1 blurs
DAMPINGS = (0.03, 0.1)
CLOSER = np.linspace(-0.8, 0.8, 9)  # of that ratio, beside the best
FINER = (0.02, 0.04, 0.08, 0.16, 0.3)


class Inertia(Family):
    """The finger follows the pressure p as one vibration q: statics place it under p + share (q - p).

    q'' + 2 damping w q' + w^2 (q - p) = 0,  w = 2 pi hz

    The recurrence is exact for p linear between the log's entries. That is the motion along the load path
    of `fe.dynamics.reduced`, with one frequency at all pressures. With two terms the frequency grows by the
    share `faster`, and the damping ratio by `drag`, as a drag with the square of the speed makes it: over the
    range of the pressure, and for a swing over that range. A lag never overshoots; a damping ratio of up to
    0.5 does, by 16 % or more.
    """

    name, order, requires = "inertia", Order.MOTION, (Requirement.HISTORY, Requirement.FAST)
    mechanism, belongs = Mechanism.LOAD, Owner.BODY
    sentence = "the finger swings about its equilibrium after a fast change of the pressure (its inertia)"

    def law(self, terms: int) -> tuple[Parameter, ...]:
        # one vibration has nearly all of the motion; 5 Hz is a sag of 10 mm under the own weight (judgement)
        every = (
            Parameter("inertia.share", 0.0, 2.0, "", null=0.0, typical=0.1, plausible=(0.5, 1.3)),
            Parameter("inertia.hz", 0.5, 60.0, "Hz", typical=0.1, plausible=(1.0, 30.0)),
            Parameter("inertia.damping", 0.002, 0.5, "", typical=0.01, plausible=(0.005, 0.3)),
            Parameter("inertia.faster", -0.5, 1.0, "", typical=0.02, plausible=(-0.3, 0.5)),
            Parameter("inertia.drag", -0.5, 2.0, "", typical=0.02, plausible=(0.0, 1.0)),
        )
        return every[: 2 * terms + 1]

    def tries(self, test: Test) -> tuple[Theta, ...]:
        if self.terms > 1:
            return ({},)
        high = max(fastest_Hz(test.path.output), SLOWEST_Hz)
        count = 1 + int(np.ceil(np.log(high / SLOWEST_Hz) / np.log(RATIO)))
        return _entries(np.geomspace(SLOWEST_Hz, high, count), DAMPINGS)

    def closer(self, entry: Theta, test: Test) -> Effect | None:
        del test
        return None if self.terms > 1 else _Closer(entry["inertia.hz"])

    def start(self, theta: Theta) -> Theta:
        if self.terms == 1:
            return theta
        return {**theta, "inertia.faster": 0.0, "inertia.drag": 0.0}

    def before(self, test: Test, theta: Theta) -> Test:
        path, share = test.path.with_outputs, theta["inertia.share"]
        p = path.pressure
        span = max(float(np.ptp(p)), 1e-12)
        q = driven(
            path.time, p, omega=2 * np.pi * theta["inertia.hz"], damping=theta["inertia.damping"],
            growth=theta.get("inertia.drag", 0.0) / span, faster=theta.get("inertia.faster", 0.0) / span,
        )  # fmt: skip
        return replace(test, path=replace(path, pressure=p + share * (q - p)))

    def told(self, values: Theta) -> str:
        hz, damping = (number(values[f"inertia.{k}"]) for k in ("hz", "damping"))
        more = number(values.get("inertia.drag", 0.0))
        drag = f" and {more} more for a swing over the whole range of the pressure" * (self.terms > 1)
        return (
            f"the finger swings at {hz} Hz after a fast change of the pressure, with a damping ratio of "
            f"{damping}{drag}"
        )


class _Closer(Inertia):
    """Inertia, looked for at frequencies about one in Hz."""

    def __init__(self, hz: float) -> None:
        super().__init__()
        self.hz = hz

    def tries(self, test: Test) -> tuple[Theta, ...]:
        return _entries(self.hz * RATIO**CLOSER, FINER)

    def at(self, entry: Theta, test: Test) -> Effect:
        return Inertia()

    def again(self, terms: int) -> Effect:
        return Inertia(terms)


def _entries(frequencies: Array, dampings: tuple[float, ...]) -> tuple[Theta, ...]:
    return tuple({"inertia.hz": float(f), "inertia.damping": x} for f in frequencies for x in dampings)
