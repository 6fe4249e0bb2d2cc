"""A record in which something is let go and rings: pieces of a few periods, and what they say together."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from twin.ringing.dampedsine import DampedSine, damped_sine
from twin.targets import Array

PERIODS = 2.0  # of a piece
GONE = 0.02  # of a frequency: a piece whose sd is larger says nothing
FEWEST = 4.0  # frames a period, below which a faster vibration would look the same
WANTED = 10.0  # frames a period
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

    Frames with a lost point are left out. ValueError where nothing rings.
    """
    good = np.isfinite(position).all(axis=(1, 2))
    t, y = time[good], position[good].reshape(int(good.sum()), -1)
    if len(t) < 20:
        raise ValueError(f"{len(t)} frames with all points: wanted 20 or more of a free vibration")
    y = y - y[-max(len(y) // 10, 3) :].mean(axis=0)
    way = np.linalg.svd(y - y.mean(axis=0), full_matrices=False)[2]
    first = _release(t, y @ way[0])
    rate = 1 / float(np.median(np.diff(t)))
    near = _slowest(t[first:], y[first:] @ way[0])
    pieces = tuple(_pieces(t[first:], y[first:], near, periods))
    if not pieces:
        raise ValueError("no free vibration: nothing swings for two periods; wanted frames after a release")
    main = [p for p in pieces if p.largest >= MAIN * pieces[0].largest]
    size = np.array([p.largest for p in main])
    values = np.array([(p.frequency, p.damping) for p in main]).T
    sd, middle = np.array([p.sd for p in main]).T, float(size.mean())
    lines = [_line(size - middle, value, each) for value, each in zip(values, sd, strict=True)]
    return Ringing(pieces, rate, middle, *lines[0], *lines[1])


def _release(t: Array, s: Array) -> int:
    """The first frame of free motion: the first turn of a signal (t,) after its fastest change."""
    speed = np.abs(np.diff(s) / np.diff(t))
    k = int(speed.argmax()) + 1
    while k < len(s) - 2 and (s[k + 1] - s[k]) * (s[k] - s[k - 1]) > 0:
        k += 1
    return k


def _slowest(t: Array, s: Array) -> float:
    """The frequency in Hz with the largest peak in the spectrum of a signal (t,), resampled evenly."""
    even = np.linspace(t[0], t[-1], len(t))
    signal = np.interp(even, t, s)
    signal = (signal - signal.mean()) * np.hanning(2 * len(signal))[len(signal) :]
    power = np.abs(np.fft.rfft(signal, 8 * len(signal)))
    frequency = np.fft.rfftfreq(8 * len(signal), even[1] - even[0])
    low = 1.0 / (t[-1] - t[0])
    return float(frequency[frequency > low][power[frequency > low].argmax()])


def _pieces(t: Array, y: Array, near: float, periods: float) -> Iterator[DampedSine]:
    """Pieces of equal numbers of periods, until the frequency is no longer seen."""
    begin = float(t[0])
    while begin + periods / near <= t[-1]:
        rows = (t >= begin) & (t < begin + periods / near)
        begin += periods / near
        try:
            piece = damped_sine(t[rows], y[rows], near=near)
        except ValueError:
            return
        if not abs(piece.frequency / near - 1) < 0.3 or piece.sd[0] > GONE * piece.frequency:
            return
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
    more = misfit / free if free and chdtrc(free, misfit) < RARE else 1.0
    slope = float(c[1]) if len(c) > 1 else np.nan
    return float(c[0]), float(np.sqrt(covariance[0, 0] * more)), slope
