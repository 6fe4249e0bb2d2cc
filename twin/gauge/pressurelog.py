"""Turn a pressure log into the pressure at each film frame, with the noise of the gauge."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.gauge.logcolumns import LogFormat, asked_doubt, columns_of, gauge_pressure, log_sheet
from twin.gauge.pressureunits import in_seconds
from twin.targets import Array, check_duration

BEYOND_S = 2.5  # more than the clocks of film and log may disagree (time_shift)
MIN_SAMPLES = 30  # the sd of 30 white samples is known to 13 %
STILL = 0.005  # of a log's range, within which it rests
SLOW_S = 1.0  # between samples; loggers of pressure take ten or more a second


@dataclass(frozen=True)
class Log:
    """A pressure log on its own clock, `time_shift_s` already added."""

    path: Path
    time: Array  # (t,) s, increasing
    pressure: Array  # (t,) MPa
    lamp: Array | None = None  # (t,) column flash: 0, and 1 from when a lamp in the film went on
    source: str = ""  # which column it is and in which unit it stands there, for messages
    doubt: str = ""  # a sentence on that column

    def at(self, time: Array) -> Array:
        """The pressure (s,) MPa at times (s,) s within the log, linear between its samples."""
        return np.interp(time, self.time, self.pressure)

    def beside(self, time: Array) -> tuple[Array, Array]:
        """The log's times (t,) s and pressures (t,) MPa that a test of these times (s,) s may depend on.

        All before it, which it may remember, and BEYOND_S after it; what a longer log holds later would only
        have to be solved, up to pressures that the test never reached.
        """
        keep = self.time <= time[-1] + BEYOND_S
        return self.time[keep], self.pressure[keep]

    def gain(self, time: Array) -> Array:
        """Sd of the interpolated pressure over sd of one sample (s,): 1 at a sample, 0.71 midway."""
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        weight = (time - self.time[after - 1]) / (self.time[after] - self.time[after - 1])
        return np.hypot(weight, 1 - weight)

    def flash(self) -> tuple[float, float]:
        """When the lamp went on, and its sd, in s: between two samples. ValueError if it did not."""
        on = np.flatnonzero(self.lamp > 0.5) if self.lamp is not None else np.empty(0, dtype=np.intp)
        if not len(on) or on[0] == 0:
            raise ValueError(
                f"{self.path.name}: column flash is missing or does not go from 0 to 1; add it, or set "
                "[pressure] flash_time_s in twin.toml"
            )
        before, after = self.time[on[0] - 1], self.time[on[0]]
        return float(0.5 * (before + after)), float((after - before) / np.sqrt(12.0))


@dataclass(frozen=True)
class GaugeNoise:
    """White noise of one sample of a log, in MPa, and what to say about it ("" if nothing)."""

    sd_MPa: float
    samples: int
    remark: str


def read_log(path: Path, *, time_shift_s: float, form: LogFormat | None = None) -> Log:
    """The log in a CSV with a time, a gauge pressure in any unit and, where there is one, a column flash.

    Headings are such as time_s, t [ms]; pressure_MPa, p [bar], Pressure (psi). ValueError names line, column
    and value, and what is unclear: two pressures, no unit, one that contradicts twin.toml, absolute pressure.
    """
    form = form or LogFormat()
    sheet = log_sheet(path, form)
    clock, p = columns_of(sheet, form)
    table = sheet.table((clock.name, p.name), also=("flash",))
    ticks = table.numbers(clock.name, unit=clock.unit)
    _check_columns(path, ticks, table.numbers(p.name, unit=p.unit), clock.name, p.name)
    table.increasing(clock.name, ticks, unit=clock.unit)
    time = in_seconds(ticks, clock.unit)
    if len(time) < 2:
        raise ValueError(f"{path}: {len(time)} sample; wanted two or more")
    check_duration(time, what=str(path))
    pressure, unit = gauge_pressure(table, p, form)
    lamp = table.numbers("flash", unit="1") if "flash" in table.cells else None
    return Log(
        path, time + time_shift_s, pressure, lamp, f"column {p.name!r}, in {unit}", asked_doubt(p, form)
    )


def _check_columns(path: Path, time: Array, pressure: Array, *names: str) -> None:
    """Raise ValueError where the numbers under pressure grow as times do, and those under time do not."""
    step = np.diff(time)
    if np.any(step < 0) and np.any(step > 0) and np.all(np.diff(pressure) > 0):
        raise ValueError(
            f"{path}: columns {names[0]} and {names[1]} seem to be exchanged: the first rises and falls, the "
            "second grows from row to row as times do; exchange their headings"
        )


def check_covers(log: Log, time: Array, *, what: str, key: str) -> None:
    """Raise ValueError unless the log covers the times (s,) s of `what`, which starts where `key` says."""
    if time[0] < log.time[0] or time[-1] > log.time[-1]:
        raise ValueError(
            f"{log.path.name} covers {log.time[0]:.3f} to {log.time[-1]:.3f} s, the {what} "
            f"{time[0]:.3f} to {time[-1]:.3f} s of the same clock: wanted a log that covers all of it; "
            f"correct [pressure] time_shift_s or {key} in twin.toml, or record the whole test"
            + _in_minutes(log, time[-1] - time[0])
        )


def check_lasts(log: Log, film_s: float) -> None:
    """Raise ValueError where a log is shorter than the film (s), wherever the film began."""
    if (lasts := log.time[-1] - log.time[0]) < film_s:
        raise ValueError(
            f"{log.path.name} covers {lasts:.3f} s, the film {film_s:.3f} s: wanted a log that covers all of "
            "it; record the whole test, or cut the film" + _in_minutes(log, film_s)
        )


def _in_minutes(log: Log, film_s: float) -> str:
    """A hint where a log is shorter than a film (s), but long enough if its times are minutes."""
    lasts = float(log.time[-1] - log.time[0])
    if not lasts < film_s <= 60.0 * lasts:
        return ""
    return f"; its time may be in min, as {lasts:.3g} min are {60.0 * lasts:.3g} s: then write it in s"


def all_rest(log: Log, start: float, end: float) -> tuple[float, float]:
    """The times (s) between which the gauge rests: those given, or, where too few samples lie there, all rest
    before and behind them, up to the onset of the pressure.

    >>> time = np.arange(0, 20, 0.1)
    >>> log = Log(Path("p.csv"), time, 0.03 * np.clip(time - 16, 0, 1) + 1e-5 * np.sin(7 * time))
    >>> [round(x, 1) for x in all_rest(log, 14.0, 15.8)]
    [0.0, 16.0]
    """
    inside = (log.time >= start) & (log.time <= end)
    if inside.sum() >= MIN_SAMPLES or not inside.any():
        return start, end
    level = log.pressure[inside]
    far = np.abs(log.pressure - np.median(level)) > max(
        STILL * float(np.ptp(log.pressure)), 4 * float(level.std())
    )
    first, last = np.flatnonzero(inside)[[0, -1]]
    before, behind = np.flatnonzero(far[:first]), np.flatnonzero(far[last:])
    begin = int(before[-1]) + 1 if len(before) else 0
    stop = int(last + behind[0]) - 1 if len(behind) else len(far) - 1
    return float(log.time[begin]), float(log.time[stop])


def gauge_noise(log: Log, *, start: float, end: float) -> GaugeNoise:
    """The white noise of the gauge from the log between two times (s) at which nothing moves.

    sd = sd of first differences / sqrt 2, which a slow drift hardly touches. Differences of white noise have
    lag-1 correlation -1/2; where it is larger by more than 4 of its sds the log is filtered or the pressure
    ripples, differences understate the noise, and the sd about a straight line is taken instead.
    Raises ValueError below 30 samples.
    """
    inside = (log.time >= start) & (log.time <= end)
    samples = log.pressure[inside]
    if len(samples) < MIN_SAMPLES:
        step = float(np.median(np.diff(log.time)))
        likely = "log faster, or let the log run longer at rest before the film"
        if step > SLOW_S and (end - start) / step * 1e3 > MIN_SAMPLES:
            likely = f"its samples are {step:g} s apart, so its time is likely in ms: write it in s"
        raise ValueError(
            f"{log.path.name}: {len(samples)} samples between {start:.3f} and {end:.3f} s, where the gauge "
            f"noise is read; wanted {MIN_SAMPLES} or more: {likely}"
        )
    steps = np.diff(samples)
    sd = float(np.std(steps) / np.sqrt(2))
    if sd == 0:
        return GaugeNoise(0.0, len(samples), f"{log.path.name} shows no noise at rest: its steps are too "
                          "coarse. The gauge noise is taken as 0: record the pressure with "
                          "more digits.")  # fmt: skip
    if _lag_one(steps) <= -0.5 + 4 / np.sqrt(len(steps)):
        return GaugeNoise(sd, len(samples), "")
    line = np.polynomial.Polynomial.fit(log.time[inside], samples, 1)
    about = float(np.std(samples - line(log.time[inside]), ddof=2))
    return GaugeNoise(about, len(samples), f"The noise of {log.path.name} at rest is not white: the log "
                      f"is filtered, or the pressure ripples. Its scatter about a straight line is used, "
                      f"{about:.2g} MPa (1 sd).")  # fmt: skip


def _lag_one(x: Array) -> float:
    """The lag-1 correlation of a series."""
    centred = x - x.mean()
    return float(centred[1:] @ centred[:-1] / (centred @ centred))


GAP, GAP_S = 10.0, 0.25  # times the usual spacing, and s, from which samples are missing
CHANGES = 0.1  # share of the log's range by which the pressure may change in a gap
ALONE = 0.2  # share of it by which one sample may lie off both its neighbours
NOISES = 20.0  # times what samples usually lie off both neighbours: 12 sds of white noise
FAST_S = 0.05  # between samples: no chamber fills and empties within two of them
STUCK, STUCK_S = 20, 0.5  # equal samples, and s
NOISY = 0.3  # share of the steps of a log that turn back: two thirds of white noise, hardly one without noise
RESTS = 0.05  # share of the range that a gauge may read while the finger rests


def check_signal(log: Log, *, start: float, end: float) -> tuple[str, ...]:
    """Sentences on a log between the times (s) at which the film starts and ends; ValueError where its
    pressures are wrong."""
    inside = (log.time >= start) & (log.time <= end)
    if inside.sum() < 3 or not np.ptp(log.pressure):
        return ()
    _check_gaps(log, inside)
    return (*_alone(log, inside), *_stuck(log, inside))


def rest_remark(log: Log, *, start: float, rest_s: float) -> str:
    """A sentence where the gauge does not read zero while the finger rests, "" where it does."""
    inside = (log.time >= start) & (log.time <= start + rest_s)
    if not inside.any():
        return ""
    mean, log_range = float(log.pressure[inside].mean()), float(np.ptp(log.pressure))
    if abs(mean) <= RESTS * log_range:
        return ""
    return (
        f"{log.path.name} reads {mean:.2g} MPa while the finger rests ({start:.1f} to {start + rest_s:.1f} "
        f"s), {100 * abs(mean) / log_range:.0f} % of its range; wanted 0, vented. If the gauge's zero "
        "is off, subtract it from the log; if the film starts later than film_start_s says, correct that."
    )


def _check_gaps(log: Log, inside: NDArray[np.bool_]) -> None:
    """Raise ValueError where samples are missing while the pressure changes."""
    step, rise = np.diff(log.time), np.abs(np.diff(log.pressure))
    missing = step > max(GAP * float(np.median(step)), GAP_S)
    bad = np.flatnonzero(missing & (rise > CHANGES * np.ptp(log.pressure)) & (inside[1:] | inside[:-1]))
    if len(bad):
        k = int(bad[0])
        raise ValueError(
            f"{log.path.name} has no sample between {log.time[k]:.2f} and {log.time[k + 1]:.2f} s, while the "
            f"pressure goes from {log.pressure[k]:.3g} to {log.pressure[k + 1]:.3g} MPa; wanted a log "
            "without gaps: restore the missing rows, or record the test again"
        )


def _alone(log: Log, inside: NDArray[np.bool_]) -> tuple[str, ...]:
    """A sentence on samples far off both neighbours; ValueError where samples are so dense that no pressure
    does so."""
    before, after = log.pressure[1:-1] - log.pressure[:-2], log.pressure[1:-1] - log.pressure[2:]
    least = np.minimum(np.abs(before), np.abs(after))
    far = max(ALONE * float(np.ptp(log.pressure)), NOISES * float(np.median(least)))
    off = (before * after > 0) & (least > far) & (np.abs(before - after) < least / 2)
    rows = 1 + np.flatnonzero(off & inside[1:-1])
    if not len(rows):
        return ()
    k = int(rows[0])
    what = (
        f"{log.path.name}: {len(rows)} samples lie far off their neighbours, the first at {log.time[k]:.2f} "
        f"s: {log.pressure[k]:.3g} MPa between {log.pressure[k - 1]:.3g} and {log.pressure[k + 1]:.3g} MPa"
    )
    if float(np.median(np.diff(log.time))) > FAST_S:
        return (f"{what}. Are they real, or has the logger dropped some?",)
    raise ValueError(
        f"{what}; no finger is filled and vented so fast: remove the rows that the logger has dropped"
    )


def _stuck(log: Log, inside: NDArray[np.bool_]) -> tuple[str, ...]:
    """A sentence where a log with noise repeats one value, above its lowest, for long."""
    same, above = np.diff(log.pressure) == 0, log.pressure[1:] > log.pressure.min()
    begin, end = _longest(same & above)
    long = end - begin >= STUCK and log.time[end] - log.time[begin] >= STUCK_S
    if not long or not inside[begin : end + 1].any():
        return ()
    steps = np.delete(np.diff(log.pressure), np.arange(begin, end))[np.delete(above, np.arange(begin, end))]
    if not len(steps) > STUCK or (steps[1:] * steps[:-1] < 0).mean() < NOISY:
        return ()
    return (
        f"{log.path.name} repeats {log.pressure[begin]:.6g} MPa from {log.time[begin]:.2f} to "
        f"{log.time[end]:.2f} s, while its last digits change elsewhere. Has the logger stopped, or has "
        "the gauge reached the end of its range?",
    )


def _longest(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """First and one past the last index of the longest run of flags, (0, 0) without one."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(np.int8), 0]))
    if not len(edges):
        return 0, 0
    runs = edges.reshape(-1, 2)
    begin, end = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    return int(begin), int(end)
