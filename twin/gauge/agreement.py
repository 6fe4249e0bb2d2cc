"""Whether film and pressure log can be of one test: what moves in the one is driven by the other."""

import numpy as np

from twin.gauge.pressurelog import BEYOND_S, Log
from twin.gauge.synchrony import Motion
from twin.targets import Array

MOVES_MM = 0.2  # of a finger under pressure, at least; and so many times its noise
MOVES = 10.0
RISES_MPA = 1e-3  # a tenth of what moves the softest finger by some mm
LEAST = 0.3  # share of the motion's variance that the pressure explains where both are of one test
AWAY_S = BEYOND_S + 1.0  # what the clocks may disagree by, and a line lag beside it
STEP_S, MOST_SHIFTS, MOST_STEPS = 0.25, 1500, 200
FITS, BETTER = 0.8, 0.2  # share of the motion's variance explained at another time; by so much more
DEGREE = 3


def check_agrees(motion: Motion, log: Log, start_s: float, *, stated: bool) -> None:
    """Raises ValueError where the finger rests while the pressure rises, moves while it rests, or moves as
    the pressure does at another time.

    start_s: time of the film's first frame on the log's clock.   stated: whether the user states it.

    At each shift of the clocks a cubic of the pressure is fitted to the motion; only another time more than
    3.5 s away counts, beyond what a lag of finger or clock can be.
    """
    seen = np.isfinite(motion.mm)
    time, mm = motion.time[seen], motion.mm[seen]
    if len(time) < 2 * (DEGREE + 1):
        return
    few = np.linspace(0, len(time) - 1, min(len(time), MOST_STEPS)).round().astype(int)
    time, mm = time[few], mm[few]
    moved, pressure = float(np.ptp(mm)), log.at(time + start_s)
    rise, whole = float(np.ptp(pressure)), float(np.ptp(log.pressure))
    span = f"{time[0] + start_s:.1f} to {time[-1] + start_s:.1f} s"
    least = max(MOVES_MM, MOVES * motion.noise_mm)
    if moved < least and rise > RISES_MPA:
        raise ValueError(
            f"the finger does not move: {moved:.2g} mm in the film, while {log.path.name} rises by "
            f"{rise:.3g} MPa from {span}; wanted {least:.2g} mm or more; are film and log of one test, is "
            "the unit of the pressure right, and is the valve open?"
        )
    if moved < least:
        return
    best, most = _best(time, mm, log)
    now = _explained(mm, pressure)
    away = abs(best - start_s) if most >= FITS else 0.0
    order = "later" if best > start_s else "earlier"
    if stated and away > AWAY_S and most > now + BETTER:
        raise ValueError(
            f"the finger moves as {log.path.name} does {away:.1f} s {order}: at {best:.1f} s its "
            f"pressure explains {100 * most:.0f} % of the motion, at film_start_s = {start_s:g} s "
            f"{100 * now:.0f} %; wanted film_start_s within {AWAY_S:g} s of it: correct film_start_s (time "
            "of the film's first frame on the clock of the log)"
        )
    if now < LEAST and (most < FITS or away > AWAY_S):
        raise ValueError(
            f"the finger moves by {moved:.2g} mm in the film, and {log.path.name} does not say why: from "
            f"{span} its pressure changes by {rise:.2g} MPa (by {whole:.2g} MPa in all), which explains "
            f"{100 * now:.0f} % of the motion, wanted {100 * LEAST:.0f} % or more; are film and log of one "
            "test, and is film_start_s right (time of the film's first frame on the clock of the log)?"
        )


def _best(time: Array, mm: Array, log: Log) -> tuple[float, float]:
    """The start of the film on the log's clock at which the pressure explains most of the motion, and how
    much; 0 and 0 where the log is too short to shift."""
    first, last = float(log.time[0] - time[0]), float(log.time[-1] - time[-1])
    if last <= first:
        return 0.0, 0.0
    shifts = np.arange(first, last, max(STEP_S, (last - first) / MOST_SHIFTS))
    explained = [_explained(mm, log.at(time + s)) for s in shifts]
    best = int(np.argmax(explained))
    return float(shifts[best]), float(explained[best])


def _explained(mm: Array, pressure: Array) -> float:
    """Share of the motion's variance that a cubic of the pressure explains."""
    p = (pressure - pressure.mean()) / max(float(np.abs(pressure).max()), 1e-12)
    left = mm - (columns := p[:, None] ** np.arange(DEGREE + 1)) @ np.linalg.lstsq(columns, mm, rcond=None)[0]
    return max(1.0 - float(left @ left) / max(float(np.sum((mm - mm.mean()) ** 2)), 1e-30), 0.0)
