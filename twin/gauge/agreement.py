"""Film and log of one test: the pressure of the log must explain the motion in the film."""

from dataclasses import dataclass

import numpy as np

from twin.gauge.pressurelog import BEYOND_S, Log
from twin.gauge.synchrony import LagFit, Motion

MOVES_MM = 0.2  # of a finger under pressure, at least; and so many times its noise
MOVES = 10.0
RISES_MPA = 1e-3  # a tenth of what moves the softest finger by some mm
LEAST = 0.3  # share of the motion's variance that the pressure explains where both are of one test
AWAY_S = BEYOND_S + 1.0  # what the clocks may disagree by, and a line lag beside it
STEP_S, FINE_S, MOST_SHIFTS, MOST_STEPS = 0.25, 0.05, 1500, 200
FITS, BETTER = 0.8, 0.2  # share of the motion's variance explained at another time; by so much more
DEGREE = 3
# A film that was slowed down, speeded up or has lost frames: its time runs at another rate than the log's.
RATES = np.geomspace(1 / 12, 12.0, 121)  # 4 % apart
OTHER_RATE = 1.03
TOLD, SURE = 5.0, 20.0  # times less of the motion is unexplained at another rate or time than as stated
# Share of its variance unexplained as stated: what is told where another rate leaves far less, what is told
# where it leaves less, and what no lag in a film of one ramp leaves.
LEAST_LEFT, LITTLE, MUCH = 0.002, 0.02, 0.1
CLOCK_S = 0.4  # off, that is told
ORIGINAL = "Use the original file, or pictures with times.csv"


@dataclass(frozen=True)
class OtherRate:
    """The film's time runs at another rate than the log's."""

    sentence: str
    sure: bool  # so that nothing else explains the motion


def check_agrees(
    motion: Motion, log: Log, start_s: float, *, stated: bool, key: str = "film_start_s",
    remedy: str = ORIGINAL, moves: str = "film",
) -> tuple[str, ...]:
    """Sentences where the motion is a little early or late. Raises ValueError where the finger rests while
    the pressure rises, moves while it rests, or moves as the pressure does at another time or at another
    rate.

    start_s: time of the film's first frame on the log's clock.   stated: whether the user states it, as `key`
    of twin.toml.   remedy: of a film at another rate.   moves: what shows the motion.

    At each shift of the clocks a cubic of the pressure is fitted to the motion; only another time more than
    3.5 s away is refused, beyond what a lag of finger or clock can be, or more than 2.5 s where as stated the
    pressure says nothing of the motion.
    """
    fit = _few(motion, log)
    if fit is None:
        return ()
    time = fit.time
    moved, rise = float(np.ptp(fit.mm)), float(np.ptp(log.at(time + start_s)))
    span = f"{time[0] + start_s:.1f} to {time[-1] + start_s:.1f} s"
    least = max(MOVES_MM, MOVES * motion.noise_mm)
    if moved < least and rise > RISES_MPA:
        raise ValueError(
            f"the finger does not move: {moved:.2g} mm in the {moves}, while {log.path.name} rises by "
            f"{rise:.3g} MPa from {span}; wanted {least:.2g} mm or more; are {moves} and log of one test, "
            "are the units of pressure and lengths right, and is the valve open?"
        )
    if moved < least:
        return ()
    best, most = _best(fit)
    now = fit.explained(start_s)
    away = abs(best - start_s) if most >= FITS else 0.0
    order = "later" if best > start_s else "earlier"
    limit = AWAY_S if now >= LEAST else BEYOND_S
    rate_fault = _rate_fault(fit, log.path.name, start_s, least=1 - most, remedy=remedy)
    if rate_fault and rate_fault.sure:
        raise ValueError(rate_fault.sentence)
    remarks = (rate_fault.sentence,) if rate_fault else ()
    if stated and away > limit and most > now + BETTER:
        also = f"{remarks[0]} T" if remarks else "t"
        raise ValueError(
            f"{also}he finger moves as {log.path.name} does {away:.1f} s {order}: at {best:.1f} s its "
            f"pressure explains {100 * most:.0f} % of the motion, at {key} = {start_s:g} s "
            f"{100 * now:.0f} %; wanted {key} within {limit:g} s of it: correct {key} (time "
            "of the film's first frame on the clock of the log)"
        )
    if now < LEAST and (most < FITS or away > AWAY_S):
        raise ValueError(
            f"the finger moves by {moved:.2g} mm in the {moves}, and {log.path.name} does not say why: from "
            f"{span} its pressure changes by {rise:.2g} MPa (by {np.ptp(log.pressure):.2g} MPa in all), "
            f"which explains {100 * now:.0f} % of the motion, wanted {100 * LEAST:.0f} % or more; are "
            f"{moves} and log of one test, and is {key} right (time of the film's first frame on the "
            "clock of the log)?"
        )
    if remarks or not stated or not CLOCK_S < away <= AWAY_S or 1 - now < max(LITTLE, TOLD * (1 - most)):
        return remarks
    return (
        f"The finger moves as {log.path.name} does {away:.1f} s {order}: its pressure explains "
        f"{100 * most:.1f} % of the motion there, {100 * now:.1f} % at {key} = {start_s:g} s. Is "
        f"{key} right, or does the pressure line lag? `twin diagnose` tests both (time_shift, "
        "pressure_lag).",
    )


def other_rate(motion: Motion, log: Log, start_s: float) -> OtherRate | None:
    """The fault of a film whose time runs at another rate than the log's, None without one."""
    fit = _few(motion, log)
    if fit is None or np.ptp(fit.mm) < max(MOVES_MM, MOVES * motion.noise_mm):
        return None
    return _rate_fault(fit, log.path.name, start_s, least=1 - _best(fit)[1])


def _few(motion: Motion, log: Log) -> LagFit | None:
    """The motion at a few steps in which the finger is seen, beside the log; None for too few."""
    seen = np.flatnonzero(np.isfinite(motion.mm))
    few = seen[np.linspace(0, len(seen) - 1, min(len(seen), MOST_STEPS)).round().astype(int)]
    enough = len(few) >= 2 * (DEGREE + 1)
    return LagFit.of(motion.time[few], motion.mm[few], log) if enough else None


def _rate_fault(
    fit: LagFit, name: str, start_s: float, *, least: float, remedy: str = ORIGINAL
) -> OtherRate | None:
    """The fault of a film whose finger moves as the log (name) does at another rate, None without one.

    least: share of the motion that the pressure leaves unexplained at any time, at the film's own rate.
    """

    def left(rate: float, step: float) -> float:
        return 1 - _at_rate(fit, start_s, rate, step=step)

    coarse = min(RATES, key=lambda rate: left(rate, STEP_S))
    rate = float(min(coarse * np.linspace(0.97, 1.03, 13), key=lambda rate: left(rate, FINE_S)))
    best, now = left(rate, FINE_S), min(left(1.0, FINE_S), least)
    clear = now > max(LITTLE, TOLD * best) or now > max(LEAST_LEFT, SURE * best)
    if max(rate, 1 / rate) < OTHER_RATE or not clear:
        return None
    what = (
        f"the film seems to run {1 / rate:.2f} times as long as the test: with its times multiplied by "
        f"{rate:.2f} the pressure of {name} explains {100 * (1 - best):.1f} % of the motion, as "
        f"they are {100 * (1 - now):.1f} %"
    )
    question = "was it filmed in slow motion, has it lost frames, or was its frame rate changed?"
    if now > max(MUCH, SURE * best):
        return OtherRate(
            f"{what}; wanted a film whose time stamps are those of the camera: "
            f"{question} {remedy}",
            sure=True,
        )
    alike = "A pressure line that lags by seconds looks alike in a short film."
    return OtherRate(f"{what[0].upper()}{what[1:]}: {question} {alike}", sure=False)


def _at_rate(fit: LagFit, start_s: float, rate: float, *, step: float) -> float:
    """Largest share of the motion that the pressure explains with the film's times multiplied by a rate, and
    its start moved by up to 3.5 s; 0 where the log is too short."""
    earliest, latest = fit.log_time[0] - fit.time[0] * rate, fit.log_time[-1] - fit.time[-1] * rate
    starts = start_s + np.arange(-AWAY_S, AWAY_S + step / 2, step)
    return max((fit.explained(s, rate) for s in starts if earliest <= s <= latest), default=0.0)


def _best(fit: LagFit) -> tuple[float, float]:
    """The start of the film on the log's clock at which the pressure explains most of the motion, and how
    much; 0 and 0 where the log is too short to shift."""
    earliest, latest = float(fit.log_time[0] - fit.time[0]), float(fit.log_time[-1] - fit.time[-1])
    if latest <= earliest:
        return 0.0, 0.0
    shifts = np.arange(earliest, latest, max(STEP_S, (latest - earliest) / MOST_SHIFTS))
    explained = [fit.explained(shift) for shift in shifts]
    best = int(np.argmax(explained))
    return float(shifts[best]), float(explained[best])
