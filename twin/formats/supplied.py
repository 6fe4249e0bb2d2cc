"""What the user states of a file: unit, axes, times and pressure, where the file does not say them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.formats.recorded import LIKELY, PIXEL, Doubt, Recorded
from twin.formats.worldaxes import WANTED
from twin.gauge.logcolumns import LogFormat, pressures, time_column
from twin.gauge.pressurelog import read_log
from twin.project.csvtable import read_sheet
from twin.targets import Array


@dataclass(frozen=True, kw_only=True)
class Supplied:
    """What the file does not say."""

    sd_mm: float  # of one position
    mm_per_px: float | None = None
    scale_sd: float = 0.001  # of mm_per_px, relative
    axes: str | None = None
    fps: float | None = None
    rest_steps: int = 1  # the first of them, with no pressure: displacements are relative to their mean
    min_likelihood: float = LIKELY
    log: Path | None = None
    log_unit: str | None = None
    start_s: float = 0.0  # of the first frame, on the clock of the log
    fixed: tuple[str, ...] = ()  # markers on the rig
    origin_mm: tuple[float, float, float] | None = None  # of the file's zero, in world axes

    def __post_init__(self) -> None:
        wanted = {"--sd-mm": self.sd_mm, "--mm-per-px": self.mm_per_px, "--scale-sd": self.scale_sd,
                  "--fps": self.fps}  # fmt: skip
        _ = self.doubt  # refuses what is no likelihood
        if self.rest_steps < 1:
            raise ValueError(f"--rest-steps {self.rest_steps}: wanted 1 or more")
        for name, value in wanted.items():
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} {value:g}: wanted a number above 0")

    @property
    def doubt(self) -> Doubt:
        """From when on a position is too doubtful to count."""
        return Doubt(self.min_likelihood)


def position_of(text: str) -> tuple[float, float, float]:
    """The position (3,) mm in the text of --origin-mm; ValueError where it is none."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"--origin-mm {text!r}: wanted x,y,z in mm, such as -12,11.5,40") from None
    return x, y, z


def mm_per_unit(found: Recorded, stated: Supplied) -> float:
    """Length in mm of the file's unit; ValueError where it is a pixel whose size nobody states."""
    if found.unit == PIXEL:
        if stated.mm_per_px is None:
            raise ValueError(
                "the file is in pixels: wanted --mm-per-px, the size of a pixel in the plane of the markers "
                "in mm, from a length that is known in the picture"
            )
        return stated.mm_per_px
    if stated.mm_per_px is not None:
        raise ValueError(f"--mm-per-px {stated.mm_per_px:g}: the file is in {found.unit}; leave it out")
    import pint

    try:
        return float(pint.get_application_registry().Quantity(1.0, found.unit).to("mm").magnitude)
    except (pint.PintError, AttributeError):
        wanted = "wanted px or a unit of length, such as mm"
        raise ValueError(f"the file is in {found.unit!r}: {wanted}") from None


def axes_of(found: Recorded, stated: Supplied) -> str:
    """The file's axes that are the world's, as `turned` takes them; ValueError where nobody says."""
    if stated.axes is None and not found.axes:
        raise ValueError(f"the file does not say how its axes lie: {WANTED}, as --axes")
    return stated.axes or found.axes


def times_of(found: Recorded, stated: Supplied) -> Array:
    """Times (s,) s on the clock of the log."""
    if found.time is not None:
        time = found.time
    elif stated.fps is None:
        raise ValueError(
            "the file counts frames: wanted --fps, the frames in a second (1 for pictures of "
            "single load steps)"
        )
    else:
        time = (found.frame - found.frame[0]) / stated.fps
    if np.any(np.diff(time) <= 0):
        raise ValueError(
            "the file's times do not increase from row to row; wanted one row for each frame, in order"
        )
    return time + stated.start_s


def pressure_of(found: Recorded, stated: Supplied, time: Array) -> tuple[Array, tuple[Array, Array] | None]:
    """The pressure (s,) MPa of each step, and the log (t,) s, (t,) MPa between them where there is one."""
    if stated.log is None:
        if found.pressure is None:
            raise ValueError("no pressure is known: wanted --log, a CSV with the times and the pressure")
        return found.pressure, None
    if found.pressure is not None:
        raise ValueError(f"--log {stated.log}: the file has a pressure of its own; leave one of them out")
    form, sheet = LogFormat(unit=stated.log_unit), read_sheet(stated.log, wanted="time_s,pressure_MPa")
    if time_column(sheet) is None:
        return _in_rows(pressures(sheet, form), len(time), stated.log), None
    log = read_log(stated.log, time_shift_s=0.0, form=form)
    if time[0] < log.time[0] or time[-1] > log.time[-1]:
        raise ValueError(
            f"{stated.log} covers {log.time[0]:.3f} to {log.time[-1]:.3f} s, the file {time[0]:.3f} to "
            f"{time[-1]:.3f} s of the same clock: wanted a log that covers all of it; correct --start-s, or "
            "record the whole test"
        )
    return log.at(time), log.beside(time)


def _in_rows(pressure: Array, steps: int, path: Path) -> Array:
    if len(pressure) != steps:
        raise ValueError(
            f"{path}: {len(pressure)} rows without times for {steps} steps; wanted one row for each step, or "
            "a column of times"
        )
    return pressure
