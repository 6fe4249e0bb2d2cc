"""A recorded pressure history (`Path`); the pressure levels and times at which it is solved; the
creep-equivalent pressure."""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypedDict

import numpy as np
import scipy

from fe.element import Array, Integers
from fe.terms import machine_code

# Times at which a history is solved. On the finger, film A and three Prony terms they leave 0.3 um rms, 5 um
# at most, against times three times as dense.
FIRST = 0.45  # s, and
STEP = 0.6  # of log(1 + t / FIRST) in a hold
RAMP = 6  # steps for a ramp over the whole range of pressure, and
SOFT_RAMP = 12  # where softening or slip on a plane bends it: of softening's effect 0.1 % rms, 1 % at most
STRAIGHT = 0.02  # of the range of pressure: by so much a log may leave the line between two corners
# Of pressure: they leave 6e-5 mm of the default finger's 65 at 30 kPa, 10 would 1.3e-4, 8 3e-4. Fewer are
# felt: where a model lacks an effect, shared errors take up much of it, and its constants follow the slopes.
LEVELS = 12
GRADING = 1.5  # of a ramp's steps towards its lower pressure
LONG = 1e9  # s, in which whatever creeps comes to rest


class Outside(TypedDict, total=False):
    """Fields of a path besides its pressure history: gravity, pulls, shares of the pressure, and whether the
    structure has settled under them."""

    gravity: Array
    places: Array
    pulls: Array
    chambers: tuple[str, ...]
    shares: Array
    settled: bool


@dataclass(frozen=True)
class Path:
    """Pressure history: `time` (t,) s increasing and `pressure` (t,) MPa (dense log), output times (s,) s,
    and, where they drift, the factor `stiffness` (t,) of all moduli at `time`.

    gravity: acceleration (3,) mm/s2, or (t, 3) at every log time where the structure is turned between
    recordings. pulls: dead forces (h, 3) N, or (t, h, 3), at material points `places` (h, 3) mm: hung
    weights, measured forces. shares: share of the pressure on each surface of `chambers` (c,), (c,), or (t,
    c). All change half way between two log times, and act from the first time on.

    >>> ramp = Path(np.array([0.0, 1.0]), np.array([0.0, 0.02]), output=np.array([0.5, 1.0]))
    >>> ramp.at_output()
    array([0.01, 0.02])
    """

    time: Array
    pressure: Array
    output: Array
    stiffness: Array | None = None
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    places: Array = field(default_factory=lambda: np.zeros((0, 3)))
    pulls: Array = field(default_factory=lambda: np.zeros((0, 3)))
    chambers: tuple[str, ...] = ()
    shares: Array = field(default_factory=lambda: np.zeros(0))
    settled: bool = False

    def __post_init__(self) -> None:
        if self.pulls.shape not in (self.places.shape, (len(self.time), *self.places.shape)):
            raise ValueError(
                f"pulls of shape {self.pulls.shape}: wanted {self.places.shape}, one force in N for each "
                f"place, or so many for each of the {len(self.time)} log times"
            )
        if self.gravity.shape not in ((3,), (len(self.time), 3)):
            raise ValueError(
                f"gravity of shape {self.gravity.shape}: wanted (3,) or one row for each of the "
                f"{len(self.time)} log times, mm/s2"
            )
        if self.shares.shape not in ((c := len(self.chambers),), (len(self.time), c)):
            raise ValueError(
                f"shares of shape {self.shares.shape}: wanted ({c},), one for each chamber, or so many for "
                f"each of the {len(self.time)} log times"
            )

    @property
    def outside(self) -> Array:
        """Gravity, the pulls beside it and the shares, (t, 3 + 3 h + c), or one row where none changes."""
        h, c = self.places.size, len(self.chambers)
        if self.gravity.ndim == 1 and self.pulls.ndim == 2 and self.shares.ndim == 1:
            return np.concatenate([self.gravity, self.pulls.ravel(), self.shares])[None]
        t = len(self.time)
        pulls = np.broadcast_to(self.pulls, (t, *self.places.shape)).reshape(t, h)
        gravity, shares = np.broadcast_to(self.gravity, (t, 3)), np.broadcast_to(self.shares, (t, c))
        return np.concatenate([gravity, pulls, shares], axis=1)

    def under(self, rows: Array) -> "Outside":
        """The fields of a path that stays under one row (3 + 3 h + c,) of `outside`, or of one whose log
        times have rows (t, 3 + 3 h + c)."""
        pulls, shares = np.split(rows[..., 3:], [self.places.size], axis=-1)
        pulls = pulls.reshape(*rows.shape[:-1], *self.places.shape)
        return {"gravity": rows[..., :3], "places": self.places, "pulls": pulls,
                "chambers": self.chambers, "shares": shares, "settled": self.settled}  # fmt: skip

    @property
    def turns(self) -> Integers:
        """Log entries (k,) after which gravity, a pull or a share changes."""
        g = self.outside
        return np.flatnonzero((g[1:] != g[:-1]).any(axis=1))

    def run(self, time: Array) -> Integers:
        """Number (k,), from 0, of the stretch of constant gravity, pulls and shares at times (k,) s."""
        switch = (self.time[self.turns] + self.time[self.turns + 1]) / 2
        return np.searchsorted(switch, time, side="right")

    def outside_of(self, entries: Integers) -> Array:
        """Gravity, pulls and shares (k, 3 + 3 h + c) at log entries (k,)."""
        size = 3 + self.places.size + len(self.chambers)
        return np.broadcast_to(self.outside, (len(self.time), size))[entries]

    def outside_at(self, time: Array) -> Array:
        """Gravity in mm/s2, pulls in N and shares (k, 3 + 3 h + c) at times (k,) s."""
        return self.outside_of(np.append(0, self.turns + 1))[self.run(time)]

    def at_output(self) -> Array:
        """Pressure (s,) MPa at the output times, linear between log entries."""
        return self.pressure_at(self.output)

    @property
    def with_outputs(self) -> "Path":
        """The same path, whose log has the output times, too."""
        inside = (self.output > self.time[0]) & (self.output < self.time[-1])
        time = np.union1d(self.time, self.output[inside])
        if len(time) == len(self.time):
            return self
        drift = None if self.stiffness is None else self.stiffness_at(time)
        outside = self.under(self.outside_at(time)) if len(self.outside) > 1 else {}
        return replace(self, time=time, pressure=self.pressure_at(time), stiffness=drift, **outside)

    def pressure_at(self, time: Array) -> Array:
        """Pressure (k,) MPa at times (k,) s, linear between log entries."""
        return np.interp(time, self.time, self.pressure)

    def stiffness_at(self, time: Array) -> Array:
        """Factor (k,) of all moduli at times (k,) s, linear between log entries."""
        return np.ones(len(time)) if self.stiffness is None else np.interp(time, self.time, self.stiffness)


def levels(top: float, *, count: int = LEVELS) -> Array:
    """Pressures (count + 1,) MPa from 0 to `top`, denser near 0 where the response bends most.

    >>> levels(0.03, count=2).round(4)
    array([0.    , 0.0122, 0.03  ])
    """
    return top * np.linspace(0, 1, count + 1) ** 1.3


def corners(path: Path) -> Array:
    """Log times (k,) s that approximate the path by a polygon to within STRAIGHT of its range (Douglas &
    Peucker 1973, doi 10.3138/FM57-6770-U75U-7727).

    >>> t = np.linspace(0.0, 2.0, 21)
    >>> corners(Path(t, 0.01 * np.minimum(t, 1.0), output=t))
    array([0., 1., 2.])
    """
    t, p = path.time, path.pressure
    tolerance = STRAIGHT * float(np.ptp(p)) + 1e-15
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


def rejoins(path: Path) -> Array:
    """Times (k,) s inside a rise at which the pressure returns to its largest so far, where Mullins softening
    ends and new slip begins; at least STRAIGHT of the range away from a corner."""
    t = corners(path)
    p, out, top = path.pressure_at(t), [], -np.inf
    near = STRAIGHT * float(np.ptp(path.pressure))
    for (a, b), (low, high) in zip(pairwise(t), pairwise(p), strict=True):
        top = max(top, low)
        if low < top - near and high > top + near:
            out.append(a + (b - a) * (top - low) / (high - low))
    return np.array(out)


def knots(path: Path, *, softening: bool = False, creeping: bool = True) -> Array:
    """Times (k,) s at which a history is solved: the corners, with `softening` the `rejoins`, and between
    them even steps of `_Span.even`, in holds only with `creeping`; before them, of a settled structure that
    creeps, the time at which it was loaded."""
    spans = _spans(path, softening, creeping)
    begin = spans[0].begin
    first = [begin - LONG, begin] if path.settled and creeping else [begin]
    return np.concatenate([first, *(span.inside() for span in spans)])


def in_time(path: Path, time: Array, *, softening: bool = False, creeping: bool = True) -> Array:
    """Interpolation weights (s, k) from the `knots`, `time` (k,) s, to the output times.

    Between corners of the pressure a cubic spline over `_Span.even`; at the corners the slope may jump. It is
    linear in the values: the derivative of the interpolant interpolates the derivatives.
    """
    columns = np.clip(path.output, path.time[0], time[-1])
    weights, unit = np.zeros((len(columns), len(time))), np.eye(len(time))
    for span in _spans(path, softening, creeping):
        rows = np.flatnonzero((time >= span.begin) & (time <= span.end))
        inside = (columns >= span.begin) & (columns <= span.end)
        spline = scipy.interpolate.CubicSpline(span.even(time[rows]), unit[rows])
        weights[inside] = spline(span.even(columns[inside]))
    return weights


@dataclass(frozen=True)
class _Span:
    """The path between two corners: `begin` and `end` in s, the pressure's change over its range, the steps
    of a ramp over the whole range, and whether one step is enough, as gravity turns or nothing creeps."""

    begin: float
    end: float
    change: float
    ramp: int
    turns: bool = False
    creeping: bool = True

    @property
    def _holds(self) -> bool:
        return abs(self.change) < 0.1

    def even(self, t: Array) -> Array:
        """Increasing coordinate in which a history is smooth, so that even steps suffice: in a hold log(1 + t
        / FIRST), as relaxation slows down; in a ramp the time, denser towards the lower pressure, where the
        remaining creep shows."""
        if self._holds:
            return np.log1p((t - self.begin) / FIRST)
        x = (t - self.begin) / (self.end - self.begin)
        return x ** (1 / GRADING) if self.change > 0 else 1 - (1 - x) ** (1 / GRADING)

    def inside(self) -> Array:
        """The knots after the beginning, with the end."""
        if self.turns or (self._holds and not self.creeping):
            return np.array([self.end])
        if self._holds:
            t = self.begin + FIRST * np.expm1(STEP * np.arange(1, 20))
            return np.append(t[t < self.end - 0.2 * (self.end - self.begin)], self.end)
        x = np.linspace(0, 1, int(np.ceil(self.ramp * abs(self.change))) + 1)[1:]
        part = x**GRADING if self.change > 0 else 1 - (1 - x) ** GRADING
        return np.append(self.begin + (self.end - self.begin) * part[:-1], self.end)


def _spans(path: Path, softening: bool, creeping: bool) -> list[_Span]:
    turning = path.time[path.turns]
    t = np.unique(np.concatenate([corners(path), turning, path.time[path.turns + 1]]))
    if softening:
        t = np.union1d(t, rejoins(path))
    change = np.diff(path.pressure_at(t)) / max(float(np.ptp(path.pressure)), 1e-15)
    ramp = SOFT_RAMP if softening else RAMP
    return [
        _Span(float(a), float(b), float(d), ramp, bool(np.isin(a, turning)), creeping)
        for (a, b), d in zip(pairwise(t), change, strict=True)
    ]


def equivalent(time: Array, pressure: Array, prony: Array, *, settled: bool = False) -> Array:
    """Pressure (t,) MPa under which an elastic body would show the linear creep of a Prony body.

    prony (m, 2) holds g and tau s. Solves p(t) = int [1 - sum g (1 - exp(-(t-s)/tau))] dq(s) for q, with q
    linear between the times (t,) s; the structure is unloaded before the first time, or `settled`.

    >>> hold = equivalent(np.array([0.0, 50.0, 100.0]), np.ones(3), np.array([[0.2, 5.0]]))
    >>> hold[[0, -1]].round(3)  # 1 / (1 - g) in the end
    array([1.  , 1.25])
    """
    if settled:
        return equivalent(np.append(time[0] - LONG, time), np.append(pressure[0], pressure), prony)[1:]
    out, g, x = np.empty(len(pressure)), prony[:, 0].copy(), np.diff(time)[:, None] / prony[:, 1]
    decay, share = np.exp(-np.minimum(x, 300.0)), g * -np.expm1(-x) / x
    _equivalent(np.asarray(pressure, float), g, decay, share, out)
    return out


@machine_code
def _equivalent(pressure: Array, g: Array, decay: Array, share: Array, out: Array) -> None:
    """Fills out (t,) by the pressure (t,), and g (m,), decay and share (t - 1, m) of the terms."""
    queue, total = np.empty(len(g)), 0.0
    for k in range(len(g)):
        queue[k] = g[k] * pressure[0]  # a first value other than 0 is put on instantly
        total += g[k]
    out[0] = pressure[0]
    for n in range(1, len(pressure)):
        rest, ramp = 0.0, 0.0
        for k in range(len(g)):
            queue[k] *= decay[n - 1, k]
            rest += queue[k]
            ramp += share[n - 1, k]
        out[n] = (pressure[n] - rest + ramp * out[n - 1]) / (1.0 - total + ramp)
        for k in range(len(g)):
            queue[k] += share[n - 1, k] * (out[n] - out[n - 1])
