"""A record in which something is let go and rings: pieces of a few periods, and what they say together."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from twin.ringing.dampedsine import DampedSine, damped_sine
from twin.targets import Array

PERIODS = 2.0  # of a piece
GONE = 0.02  # of a frequency: a piece whose sd is larger says nothing
FEWEST = 4.0  # frames a period, below which a faster vibration would look the same
WANTED = 10.0  # frames a period
FRAMES = 20  # of a record, at least
FEW = 3  # frames that have no spectrum
OFTEN = 0.9  # of the frames, in which a component is seen that counts
LEAST = 2  # pieces of one ringing of several in a record: one alone may be a chance
LATE = 2.5  # pieces, after which a vibration that is not seen yet is none of this release
FAST = 0.15  # of the fastest motion that a ringing follows, which another one follows
TRIES = 40  # of a record: fast motions after which a ringing is looked for
MAIN = 0.1  # of the first amplitude
RARE = 0.05  # probability of a scatter that makes an sd grow


@dataclass(frozen=True)
class Ringing:
    """A free vibration: its pieces in time, and frames a second of the record.

    frequency in Hz and damping ratio with sd, at the mean `amplitude` in mm of the point that moves most, and
    their slopes per mm of it: straight lines through the pieces until MAIN of the first one's amplitude is
    left, weighted by their sd, which grows by what they scatter; slopes are NaN from fewer than three. What
    is smaller is often another motion: a thread that swings, a clamp.
    """

    pieces: tuple[DampedSine, ...]
    rate: float
    amplitude: float
    frequency: float
    frequency_sd: float
    frequency_slope: float
    damping: float
    damping_sd: float
    damping_slope: float

    @property
    def start(self) -> float:
        """The middle in s of the first piece."""
        return self.pieces[0].time

    @property
    def end(self) -> float:
        """The end in s of the last piece."""
        return self.pieces[-1].time + PERIODS / 2 / self.frequency

    @property
    def first(self) -> float:
        """Amplitude in mm in the first piece, of the point that moves most."""
        return self.pieces[0].largest

    @property
    def doubt(self) -> str:
        """A sentence where the frames are too few to tell a faster vibration; "" else."""
        frames = self.rate / self.frequency
        if frames >= FEWEST:
            return ""
        return (
            f"{frames:.2g} frames a period at {self.rate:.4g} frames a second: a vibration of "
            f"{self.rate - self.frequency:.4g} Hz would look the same; film with "
            f"{WANTED * (self.rate - self.frequency):.3g} frames a second to tell"
        )


def ringing(time: Array, position: Array, *, periods: float = PERIODS) -> Ringing:
    """The free vibration of points (t, p, 3) mm at times (t,) s, after the fastest motion of the record.

    Frames with a lost point, and components that are seldom seen, are left out. ValueError where nothing
    rings.
    """
    return _Record.of(time, position).ringing(periods)


def ringings(time: Array, position: Array, *, periods: float = PERIODS) -> tuple[Ringing, ...]:
    """All free vibrations of a record, as `ringing` has one, in the order of time; () where nothing rings.

    Each follows a motion that is at least FAST of the fastest after which something rings.
    """
    record = _Record.of(time, position)
    speed = np.abs(np.diff(record.main) / np.diff(record.time))
    parts, out, least = [(0, len(record.time))], list[Ringing](), 0.0
    for _ in range(TRIES):
        parts = [p for p in parts if p[1] - p[0] >= FRAMES and speed[p[0] : p[1] - 1].max() > least]
        if not parts:
            break
        first, last = parts.pop(int(np.argmax([speed[a : b - 1].max() for a, b in parts])))
        fastest = first + int(speed[first : last - 1].argmax())
        end = fastest + 1
        try:
            one = record.part(first, last).ringing(periods)
        except ValueError:  # a jump, or too short before the next
            pass
        else:
            if len(one.pieces) >= LEAST:
                out.append(one)
                end = int(np.searchsorted(record.time, one.end))
                least = max(least, FAST * speed[fastest])
        parts += [(first, fastest), (end, last)]
    return tuple(sorted(out, key=lambda one: one.start))


@dataclass(frozen=True)
class _Record:
    """The frames of a record with all points that are often seen: time (t,) s, signals (t, c) mm, their
    columns (c,) of the size 3 p of all, and their main direction (c,)."""

    time: Array
    signals: Array
    columns: NDArray[np.int64]
    size: int
    way: Array

    @staticmethod
    def of(time: Array, position: Array) -> "_Record":
        """The record of points (t, p, 3); a component that is seldom seen is left out."""
        every = position.reshape(len(position), -1)
        columns = np.flatnonzero(np.isfinite(every).mean(axis=0) > OFTEN)
        good = np.isfinite(every[:, columns]).all(axis=1)
        t, y = time[good], every[np.ix_(good, columns)]
        if len(t) < FRAMES or not len(columns):
            raise ValueError(
                f"{len(t) if len(columns) else 0} frames with all points: wanted {FRAMES} or more of a "
                "free vibration"
            )
        y = y - y[-max(len(y) // 10, 3) :].mean(axis=0)
        way = np.linalg.svd(y - y.mean(axis=0), full_matrices=False)[2][0]
        return _Record(t, y, columns, every.shape[1], way)

    @property
    def main(self) -> Array:
        """The motion (t,) mm along the main direction."""
        return np.asarray(self.signals @ self.way)

    def part(self, first: int, last: int) -> "_Record":
        """The frames from one to before another."""
        return replace(self, time=self.time[first:last], signals=self.signals[first:last])

    def ringing(self, periods: float) -> Ringing:
        """The free vibration after the fastest motion. ValueError where nothing rings."""
        first = _release(self.time, self.main)
        late = self.part(first, len(self.time))
        near = _swinging(late.time, late.main) if len(late.time) > FEW else 0.0
        pieces = tuple(map(self._whole, _pieces(late.time, late.signals, near, periods) if near else ()))
        if not pieces:
            raise ValueError(
                "no free vibration: nothing swings for two periods; wanted frames after a release"
            )
        main = [p for p in pieces if p.largest >= MAIN * pieces[0].largest]
        size = np.array([p.largest for p in main])
        values = np.array([(p.frequency, p.damping) for p in main]).T
        sd, middle = np.array([p.sd for p in main]).T, float(size.mean())
        lines = [_line(size - middle, value, each) for value, each in zip(values, sd, strict=True)]
        rate = 1 / float(np.median(np.diff(self.time)))
        return Ringing(pieces, rate, middle, *lines[0], *lines[1])

    def _whole(self, piece: DampedSine) -> DampedSine:
        """A piece with the amplitude (3 p,) of every component, 0 where it is seldom seen."""
        amplitude = np.zeros(self.size)
        amplitude[self.columns] = piece.amplitude
        return replace(piece, amplitude=amplitude)


def _release(t: Array, s: Array) -> int:
    """The first frame of free motion: the first turn of a signal (t,) after its fastest change."""
    speed = np.abs(np.diff(s) / np.diff(t))
    k = int(speed.argmax()) + 1
    while k < len(s) - 2 and (s[k + 1] - s[k]) * (s[k] - s[k - 1]) > 0:
        k += 1
    return k


def _swinging(t: Array, s: Array) -> float:
    """The frequency in Hz of the most prominent peak in the spectrum of a signal's speed, of s (t,) resampled
    evenly; 0.0 where there is none. What fills or creeps is fastest at 0 Hz, and has no peak."""
    even = np.linspace(t[0], t[-1], len(t))
    speed = np.diff(np.interp(even, t, s))
    speed = speed * np.hanning(2 * len(speed))[len(speed) :]
    power = np.abs(np.fft.rfft(speed, 8 * len(speed)))
    frequency = np.fft.rfftfreq(8 * len(speed), even[1] - even[0])
    peaks, shape = scipy.signal.find_peaks(power, prominence=0.0)
    return float(frequency[peaks[shape["prominences"].argmax()]]) if len(peaks) else 0.0


def _pieces(t: Array, y: Array, near: float, periods: float) -> Iterator[DampedSine]:
    """Pieces of equal numbers of periods, from one of the first few on in which the frequency is seen, until
    it is not; the first may still fill or fall."""
    begin, seen = float(t[0]), False
    while begin + periods / near <= t[-1]:
        rows = (t >= begin) & (t < begin + periods / near)
        begin += periods / near
        try:
            piece = damped_sine(t[rows], y[rows], near=near)
        except ValueError:
            return
        if not abs(piece.frequency / near - 1) < 0.3 or piece.sd[0] > GONE * piece.frequency:
            if seen or begin > t[0] + LATE * periods / near:
                return
            continue
        seen = True
        yield piece


def _line(x: Array, value: Array, sd: Array) -> tuple[float, float, float]:
    """Value at x = 0 with its sd, and slope, of a straight line through values (k,) with sd (k,).

    The sd grows where they scatter by more. Fewer than three give their mean.
    """
    A = np.ones((len(x), 1)) if len(x) < 3 else np.column_stack([np.ones(len(x)), x])
    weight = A / sd[:, None]
    covariance = np.linalg.inv(weight.T @ weight)
    c = covariance @ weight.T @ (value / sd)
    free = len(x) - A.shape[1]
    misfit = float((((value - A @ c) / sd) ** 2).sum())
    more = misfit / free if free and scipy.special.chdtrc(free, misfit) < RARE else 1.0
    slope = float(c[1]) if len(c) > 1 else np.nan
    return float(c[0]), float(np.sqrt(covariance[0, 0] * more)), slope
