"""What a fast course asks for beside statics: texts of the command line into a swing, and what to say."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import Field

from twin import files
from twin.bench.firstvibration import first_vibration
from twin.bench.workbench import Workbench
from twin.calibrated.courseinertia import Damping, Swing, WantedSwing
from twin.calibrated.naturalvibrations import check_density
from twin.calibrated.predictions import Prediction, WantedCourse
from twin.commands.ringing import RingingsRecord
from twin.effects.protocol import Unsolvable
from twin.effects.requirements import SLOWEST_Hz
from twin.judging.fitrecord import FitRecord
from twin.records import Record
from twin.ringing.quasistatic import fast_times
from twin.tablemodel import Finite
from twin.targets import Array

MORE = 200  # times that a fast course has more than a slow one
A_PERIOD = 12  # of them
AFTER = (6.0, 3.0, 1.5)  # periods after each fast change that they cover, as many as there is room for
BEFORE = 1 / 6  # of a period
LEFT_OUT = "The course is fast, and inertia is left out: {}."
SHOWN = 0.05  # mm: a smaller overshoot is not told
NEAR = 1e-6  # s, within which two times are one


class LargestMotion(Record):
    """The largest of some motions."""

    point: str
    axis: str = Field(description="U1, U2 or U3")
    time_s: Finite
    mm: Finite


class PredictedInertia(Record):
    """What inertia does along a fast course."""

    frequency_Hz: Finite = Field(description="of the slowest vibration, without damping")
    damping_ratio: Finite
    damping_source: str
    largest: LargestMotion = Field(description="off the equilibrium at that time")
    overshoot: LargestMotion = Field(description="beyond all equilibria of the course")
    error_mm: Finite = Field(description="of the reduced model, by whole time steps; within the intervals")


def check_options(*, dynamics: bool, loss: float | None, density: float | None, course: bool) -> None:
    """ValueError for options of a fast course without one, and for numbers out of range."""
    if not course and (dynamics or loss is not None or density is not None):
        raise ValueError("--dynamics, --loss, --density: wanted --course beside them, a log to follow")
    if loss is not None and not 0 <= loss < 2:
        raise ValueError(f"--loss {loss:g}: wanted a loss factor from 0 to 2 (silicone: 0.05 to 0.3)")
    if density is not None and not 100 <= density <= 10_000:
        raise ValueError(f"--density {density:g}: wanted kg/m3, such as 1070")


def swing_of_course(
    bench: Workbench, fit: FitRecord, course: WantedCourse, left_out: list[str], *, dynamics: bool,
    loss: float | None, density: float | None,
) -> tuple[WantedCourse, WantedSwing | None]:  # fmt: skip
    """The course with the times that show its swing, and the swing that is wanted, None for statics alone.

    left_out: takes a sentence where inertia counts and cannot be had. dynamics: whether it is wanted however
    slow the course is: then that is a ValueError. A model with the effect inertia swings by itself.
    """
    swings = any(effect.name == "inertia" for effect in bench.model().effects)
    if swings and (dynamics or loss is not None or density is not None):
        raise ValueError("--dynamics, --loss, --density: the model has the effect inertia, and follows the "
                         "course with the frequency and damping of the film; leave them out")  # fmt: skip

    def fast(hz: float) -> Array:
        return fast_times(bench.targets, course.time, course.pressure, hz)

    if not dynamics and not len(fast(SLOWEST_Hz)):
        return course, None
    try:
        hz, _ = first_vibration(bench.project, bench.case)
        times = fast(hz)
        if not dynamics and not len(times):
            return course, None
        if swings:
            return _with_shown(course, times, hz), None
        check_density(bench, fit, density)
        if course.loads or (course.loads is None and any(load.block == 0 for load in bench.targets.loads)):
            raise ValueError("a weight hangs on the finger, whose mass the reduced model does not have")
    except ValueError as error:
        if dynamics:
            raise
        left_out.append(LEFT_OUT.format(error))
        return course, None
    return _with_shown(course, times, hz), WantedSwing(_damping(bench, loss), density)


def or_statics(swing: WantedSwing, whys: list[str], *of_statics: Any) -> Swing | None:
    """The swing; None, and the reason as a sentence more, where the reduced model cannot follow it."""
    try:
        return swing(*of_statics)
    except (ValueError, Unsolvable) as error:
        whys.append(LEFT_OUT.format(error))
        return None


def _with_shown(course: WantedCourse, times: Array, hz: float) -> WantedCourse:
    """The course with the times that show its swing, of which none is as good as another."""
    output = np.union1d(course.output, _shown(times, course, hz))
    return replace(course, output=output[np.diff(output, prepend=-np.inf) > NEAR])


def _shown(times: Array, course: WantedCourse, hz: float) -> Array:
    """Times (k,) s of a course that show what its fast `times` set swinging."""
    if not len(times):
        return times
    groups = np.split(times, np.flatnonzero(np.diff(times) > 1 / hz) + 1)
    out = np.zeros(0)
    for after in AFTER:
        spans = [np.arange(g[0] - BEFORE / hz, g[-1] + after / hz, 1 / (A_PERIOD * hz)) for g in groups]
        out = np.unique(np.concatenate(spans))
        if len(out) <= MORE:
            break
    return out[(out >= course.time[0]) & (out <= course.time[-1])][:MORE]


def _damping(bench: Workbench, loss: float | None) -> Damping:
    """As it is typed, else as the newest `twin ringing` of the film found it, else the usual one."""
    if loss is not None:
        return Damping(loss, 0.0, "as typed, beside the creep", beside=True)
    path = bench.project.newest("ringing", RingingsRecord.file)
    rows = files.read(RingingsRecord, path).ringings if path else ()
    if not rows:
        return Damping()
    ratios = np.array([row.damping_ratio for row in rows])
    sd = np.hypot(ratios.std(), np.median([row.damping_sd for row in rows]))
    return Damping(2 * float(np.median(ratios)), 2 * float(sd), "as twin ringing found it")


def swung(prediction: Prediction, asked: WantedSwing | None) -> PredictedInertia | None:
    """What inertia does to a prediction; None where it is left out."""
    swing, statics = prediction.beside, prediction.statics
    if asked is None or statics is None or not isinstance(swing, Swing):
        return None
    u = prediction.u
    beyond = u - np.clip(u, statics.min(axis=0), statics.max(axis=0))
    off, over = (_largest(x, prediction) for x in (u - statics, beyond))
    return PredictedInertia(
        frequency_Hz=swing.frequency, damping_ratio=swing.damping, damping_source=asked.damping.source,
        largest=off, overshoot=over, error_mm=swing.error,
    )  # fmt: skip


def _largest(field: Array, prediction: Prediction) -> LargestMotion:
    step, point, axis = np.unravel_index(int(np.abs(field).argmax()), field.shape)
    return LargestMotion(point=prediction.names[point], axis=f"U{axis + 1}", time_s=prediction.time[step],
                         mm=field[step, point, axis])  # fmt: skip


def told_swing(found: PredictedInertia | None) -> Iterator[str]:
    """What inertia does to the points, in sentences."""
    if found is None:
        return
    off, over = found.largest, found.overshoot
    yield (
        f"With inertia: {off.point} is up to {abs(off.mm):.2g} mm off its equilibrium in {off.axis}, at "
        f"{off.time_s:.2f} s. The finger rings at {found.frequency_Hz:.3g} Hz; damping ratio "
        f"{found.damping_ratio:.2g} ({found.damping_source})."
    )
    if abs(over.mm) > SHOWN:
        yield (f"It overshoots: {over.point} goes {abs(over.mm):.2g} mm beyond all its equilibria in "
               f"{over.axis}, at {over.time_s:.2f} s.")  # fmt: skip
    yield (f"The reduced model of the swing errs by up to {found.error_mm:.2g} mm, as whole time steps say; "
           "the intervals include that.")  # fmt: skip
