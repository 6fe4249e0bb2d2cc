"""A recorded pressure -> the loads that a solve needs: levels, times, and the creep-equivalent pressure."""

from dataclasses import dataclass

import numpy as np

from fe.element import Array


@dataclass(frozen=True)
class Path:
    """A pressure history: `time` (t,) s increasing and `pressure` (t,) MPa (dense log), and output times (s,)
    s."""

    time: Array
    pressure: Array
    output: Array

    def at_output(self) -> Array:
        """Pressure (s,) MPa at the output times, linear between log entries."""
        return np.interp(self.output, self.time, self.pressure)


def levels(top: float, *, count: int = 12) -> Array:
    """Pressures (count + 1,) MPa from 0 to `top`, denser near 0 where the response bends most."""
    return top * np.linspace(0, 1, count + 1) ** 1.3


def corners(path: Path, *, fraction: float = 0.02) -> Array:
    """Log times (k,) s that carry the path as a polygon to within `fraction` of its range (Douglas & Peucker
    1973, doi 10.3138/FM57-6770-U75U-7727)."""
    t, p = path.time, path.pressure
    tolerance = fraction * float(np.ptp(p)) + 1e-15
    keep, stack = {0, len(t) - 1}, [(0, len(t) - 1)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        line = p[a] + (p[b] - p[a]) * (t[a + 1 : b] - t[a]) / (t[b] - t[a])
        k = int(np.argmax(np.abs(p[a + 1 : b] - line))) + a + 1
        if abs(p[k] - line[k - a - 1]) > tolerance:
            keep.add(k)
            stack += [(a, k), (k, b)]
    return t[sorted(keep)]


def knots(path: Path) -> Array:
    """Times (k,) s at which a history is solved: the corners, ramps in quarters of the range, holds
    geometrically.

    After a corner the spacing starts at 0.35 s and grows by 2.2, as relaxation slows down. On the finger,
    film A and
    three Prony terms that leaves 0.5 um rms against three times as many times (18 um at most, on the fast
    step).
    """
    t = corners(path)
    p = np.interp(t, path.time, path.pressure)
    out = [t[:1]]
    for a, b, dp in zip(t[:-1], t[1:], np.abs(np.diff(p)), strict=True):
        ramp = np.linspace(a, b, max(int(np.ceil(4 * dp / max(np.ptp(p), 1e-15))), 1) + 1)[1:]
        hold = a + np.cumsum(0.35 * 2.2 ** np.arange(12))
        inside = hold[hold < a + 0.8 * (b - a)] if dp < 0.1 * np.ptp(p) else ramp[:0]
        out.append(np.union1d(ramp, inside))
    return np.concatenate(out)


def equivalent(time: Array, pressure: Array, prony: Array) -> Array:
    """The pressure (t,) MPa that an elastic body would need to show the linear creep of a Prony body.

    prony (m, 2) holds g and tau s. Solves p(t) = int [1 - sum g (1 - exp(-(t-s)/tau))] dq(s) for q, with q
    linear between the times (t,) s; the structure is unloaded before the first time.
    """
    out = np.empty_like(pressure)
    g, tau = prony[:, 0], prony[:, 1]
    queue = g * pressure[0]  # a first value other than 0 is put on instantly
    out[0] = pressure[0]
    for n in range(1, len(time)):
        x = (time[n] - time[n - 1]) / tau
        decay, ramp = np.exp(-x), -np.expm1(-x) / x
        rest = (decay * queue).sum() - (g * ramp).sum() * out[n - 1]
        out[n] = (pressure[n] - rest) / (1 - g.sum() + (g * ramp).sum())
        queue = decay * queue + g * ramp * (out[n] - out[n - 1])
    return out
