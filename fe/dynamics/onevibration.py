"""One vibration that a pressure drives."""

import cmath

import numpy as np

from fe.element import Array
from fe.terms import machine_code

NEAR = 1e-4  # of a damping ratio of 1, within which 1 + NEAR is taken: at 1 the formula divides 0 by 0
LEAST = 0.1  # of the angular frequency is left where a course makes it slower
NOTHING = 1e-30  # of a pressure, from which a vibration of long ago is none: products of it would underflow
GONE = -300.0  # power of e, below which a free vibration is none


def driven(
    time: Array, pressure: Array, *, omega: float, damping: float, growth: float = 0.0, faster: float = 0.0
) -> Array:
    """The response (t,) of y'' + 2 damping omega y' + omega^2 (y - p) = 0 to a pressure p (t,) at times (t,)
    s, settled at the start.

    Exact for p linear between the times: beside its ramp, y is a free vibration in each (Chopra 2012,
    Dynamics of Structures, section 5.2). omega: angular frequency in 1/s without damping. damping: ratio, of
    any size above 0; from 1 on nothing overshoots. growth: of the ratio per unit of p with the amplitude of
    the vibration: what a drag with the square of the speed does in the mean of a period. faster: by which
    share omega grows per unit of y. Both are as at the start of each interval.

    >>> time = np.linspace(0.0, 10.0, 11)
    >>> step = np.where(time > 0, 1.0, 0.0)
    >>> driven(time, step, omega=50.0, damping=0.2)[[0, -1]].round(6)
    array([0., 1.])
    """
    t, p = np.asarray(time, float), np.asarray(pressure, float)
    return np.asarray(_followed(t, p, float(omega), float(damping), float(growth), float(faster)))


@machine_code
def _followed(
    time: Array, pressure: Array, slowest: float, damping: float, growth: float, faster: float
) -> Array:
    out, v = np.empty(len(time)), 0.0
    out[0] = pressure[0]
    for k in range(len(time) - 1):
        dt = time[k + 1] - time[k]
        ramp = (pressure[k + 1] - pressure[k]) / dt
        fast, omega = v - ramp, slowest * max(1 + faster * out[k], LEAST)
        ratio = damping + growth * np.hypot(out[k] - pressure[k], fast / omega)
        if abs(ratio - 1) <= NEAR:
            ratio = 1 + NEAR
        root = omega * cmath.sqrt(complex(ratio**2 - 1))
        ahead, behind = (root - ratio * omega) * dt, (-root - ratio * omega) * dt
        ahead = cmath.exp(complex(max(ahead.real, GONE), ahead.imag))
        behind = cmath.exp(complex(max(behind.real, GONE), behind.imag))
        c, s = ((ahead + behind) / 2).real, ((ahead - behind) / (2 * root)).real
        late = 2 * ratio / omega * ramp  # by so much the ramp is followed late
        off = out[k] - pressure[k] + late
        if abs(off) < NOTHING and abs(fast) < omega * NOTHING:
            off, fast = 0.0, 0.0
        out[k + 1] = pressure[k + 1] - late + off * (c + ratio * omega * s) + fast * s
        v = ramp + fast * (c - ratio * omega * s) - omega**2 * off * s
    return out
