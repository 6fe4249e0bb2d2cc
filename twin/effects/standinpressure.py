"""Stand-ins for the pressure: another course of it than the recorded one."""

from dataclasses import replace
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.polynomial.polynomial import polyval

from twin.effects.protocol import Order, Test, Theta
from twin.effects.standin import Span, StandIn
from twin.targets import Array

WIDTHS = (0.05, 0.15, 0.4)  # of the top pressure: how far it must turn back until what has play follows
NARROW = 0.1  # where there is one of them alone


def stop(share: Array, half: float, kept: Array | None = None) -> Array:
    """The stop operator (t,) of pressures (t,) over the top one, over its half width: as it goes on from 0,
    held between -1 and 1 (Krasnoselskii & Pokrovskii 1989, doi 10.1007/978-3-642-61302-9). kept (t - 1,): the
    share that is kept of it from each to the next, by default all.

    >>> stop(np.array([0.0, 0.1, 0.4, 0.3, 0.0]), 0.2)
    array([ 0. ,  0.5,  1. ,  0.5, -1. ])
    """
    out, x = [0.0], (share / half).tolist()
    for (before, now), left in zip(pairwise(x), np.ones(len(x) - 1) if kept is None else kept, strict=True):
        out.append(min(max(left * out[-1] + now - before, -1.0), 1.0))
    return np.array(out)


class OtherPressure(StandIn):
    """Another pressure than the recorded one, by some terms, the first of number `first`."""

    order, kind, sentence = Order.LINE, "pressure course", "the pressure is not the recorded one"
    by: ClassVar[tuple[str, int, int]]  # of what, and the first and the last term

    def __init__(self, span: Span) -> None:
        self.span, (by, lowest, highest) = span, self.by
        names = (f"c{k}" for k in range(lowest, highest + 1))
        super().__init__(f"pressure_by_{by}", names, "", most=0.5, step=0.01, likely=0.1)

    def wrong(self, x: Array, theta: Theta) -> Array:
        """Excess pressure (t,) along the course x (t,) of the recorded one, both over the top pressure."""
        raise NotImplementedError

    def before(self, test: Test, theta: Theta) -> Test:
        p, top = test.path.pressure, self.span.top
        return replace(test, path=replace(test.path, pressure=p + top * self.wrong(p / top, theta)))


class PressureCurve(OtherPressure):
    """Another pressure, by a polynomial of the recorded one: top (c0 + c1 x + c2 x^2 + ..), x = p / top."""

    by = "pressure", 0, 3

    def wrong(self, x: Array, theta: Theta) -> Array:
        return np.asarray(polyval(x, self.numbers(theta)), float)

    def resembles(self, theta: Theta) -> str:
        x = np.linspace(0.0, 1.0, 21)
        off = self.wrong(x, theta)
        k = int(np.abs(off).argmax())
        much, pressure = abs(off[k]) * self.span.top * 1e3, x[k] * self.span.top * 1e3
        side = "higher" if off[k] > 0 else "lower"
        return f"a pressure {much:.2g} kPa {side} than recorded at {pressure:.2g} kPa"


class PressureCourse(OtherPressure):
    """Another pressure, by a polynomial of time: p (1 + c1 P1 + .. + c4 P4), Legendre's, over the film."""

    by = "time", 1, 4

    def wrong(self, time: Array, theta: Theta) -> Array:
        """Relative excess (k,) of the pressure at times (k,) s."""
        return np.asarray(legval(self.span.across(time), [0.0, *self.numbers(theta)]))

    def before(self, test: Test, theta: Theta) -> Test:
        p = test.path.pressure
        return replace(test, path=replace(test.path, pressure=p + p * self.wrong(test.path.time, theta)))

    def resembles(self, theta: Theta) -> str:
        time = np.linspace(self.span.begin, self.span.end, 41)
        off = self.wrong(time, theta)
        low, high = int(off.argmin()), int(off.argmax())
        start, end = sorted((low, high))
        trend = "falling" if start == high else "rising"
        span = f"from {time[start]:.3g} s to {time[end]:.3g} s"
        return f"a pressure {trend} by {100 * float(np.ptp(off)):.2g} % against the recorded one, {span}"


class PressureWay(OtherPressure):
    """Another pressure, by the way on which it was reached: top (c1 s1 + c2 s2 + c3 s3) more, s the `stop` of
    each of WIDTHS. A gauge with play, a valve, a chamber that holds something back look so."""

    by = "way", 1, len(WIDTHS)

    def wrong(self, x: Array, theta: Theta) -> Array:
        return np.asarray(sum(c * stop(x, half) for c, half in zip(self.numbers(theta), WIDTHS, strict=True)))

    def resembles(self, theta: Theta) -> str:
        x = np.linspace(0.0, 1.0, 41)
        both = self.wrong(np.concatenate([x, x[::-1]]), theta)
        apart = both[:41] - both[:40:-1]
        k = int(np.abs(apart).argmax())
        much, pressure = abs(apart[k]) * self.span.top * 1e3, x[k] * self.span.top * 1e3
        return (
            f"a pressure {much:.2g} kPa {'higher' if apart[k] > 0 else 'lower'} while it rises than while it "
            f"falls, at {pressure:.2g} kPa"
        )
