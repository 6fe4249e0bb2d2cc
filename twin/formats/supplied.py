"""Unit, axes, times and pressure of a file, from [import] of twin.toml where the file lacks them."""

import re
from pathlib import Path

import numpy as np

from twin.formats.importtable import ImportTable
from twin.formats.recorded import PIXEL, Recorded
from twin.gauge.logcolumns import LogFormat, asked_doubt, log_sheet, pressure_column, pressures, time_column
from twin.gauge.pressurelog import read_log
from twin.targets import Array


def still_wanted(recorded: Recorded, table: ImportTable) -> dict[str, str]:
    """The keys of [import] that have to be stated and are not yet, each with what it has to say."""
    lacks = {
        "sd_mm": table.sd_mm is None and table.still_steps is None,
        "mm_per_px": recorded.unit == PIXEL and table.mm_per_px is None,
        "axes": not (table.axes or recorded.axes), "fps": recorded.time is None and table.fps is None,
        "log": recorded.pressure is None and table.log is None,
    }  # fmt: skip
    return {key: _about(key) for key, lacking in lacks.items() if lacking}


def _about(key: str) -> str:
    """The description of a key of [import]."""
    return ImportTable.model_fields[key].description or ""


def check_stated(recorded: Recorded, table: ImportTable) -> None:
    """Raise ValueError where something of the file is not stated, or is twice."""
    if missing := still_wanted(recorded, table):
        each = "; ".join(f"{key} ({what})" for key, what in missing.items())
        raise ValueError(f"[import] of twin.toml does not state all of the file; wanted {each}")
    if table.sd_mm is not None and table.still_steps is not None:
        raise ValueError(
            f"import.sd_mm = {table.sd_mm:g} and import.still_steps: both say how large the noise is; leave "
            "one of them out"
        )
    if recorded.unit != PIXEL and table.mm_per_px is not None:
        raise ValueError(
            f"import.mm_per_px = {table.mm_per_px:g}: the file is in {recorded.unit}; leave it out"
        )
    if recorded.pressure is not None and table.log is not None:
        raise ValueError(
            f"import.log = {table.log!r}: the file has a pressure of its own; leave one of them out"
        )


def mm_per_unit(recorded: Recorded, table: ImportTable) -> float:
    """Length in mm of the file's unit; ValueError where it is none of length."""
    if recorded.unit == PIXEL:
        assert table.mm_per_px is not None  # checked
        return table.mm_per_px
    import pint

    try:
        return float(pint.get_application_registry().Quantity(1.0, recorded.unit).to("mm").magnitude)
    except (pint.PintError, AttributeError):
        advice = "wanted px or a unit of length, such as mm"
        raise ValueError(f"the file is in {recorded.unit!r}: {advice}") from None


def times_of(recorded: Recorded, table: ImportTable) -> Array:
    """Times (s,) s on the clock of the log."""
    time = recorded.time
    if time is None:
        assert table.fps is not None  # checked
        time = (recorded.frame - recorded.frame[0]) / table.fps
    if np.any(np.diff(time) <= 0):
        raise ValueError(
            "the file's times do not increase from row to row; wanted one row for each frame, in order"
        )
    return time + table.start_s


JUMP = 0.25  # of the pressure's range, from row to row: what lies between is then known well enough


def pressure_of(
    recorded: Recorded, table: ImportTable, time: Array, log: Path | None
) -> tuple[Array, tuple[Array, Array] | None, str]:
    """The pressure (s,) MPa of each step, the log (t,) s, (t,) MPa between them where there is one, and a
    sentence on it."""
    if log is None:
        assert recorded.pressure is not None  # checked
        return recorded.pressure, None if recorded.time is None else _along(time, recorded.pressure), ""
    form = LogFormat(table.log_column, table.log_unit, key="log_column under [import] of twin.toml")
    sheet = log_sheet(log, form)
    if time_column(sheet) is None:
        doubt = asked_doubt(pressure_column(sheet, form), form)
        return _in_rows(pressures(sheet, form), len(time), log), None, doubt
    read = read_log(log, time_shift_s=0.0, form=form)
    if time[0] < read.time[0] or time[-1] > read.time[-1]:
        raise ValueError(
            f"{log} covers {read.time[0]:.3f} to {read.time[-1]:.3f} s, the file {time[0]:.3f} to "
            f"{time[-1]:.3f} s of the same clock: wanted a log that covers all of it; correct start_s under "
            "[import], or record the whole test"
        )
    return read.at(time), read.beside(time), read.doubt


def _along(time: Array, pressure: Array) -> tuple[Array, Array] | None:
    """The course of the pressure (s,) MPa from row to row, straight between them; None where a step is so
    large that it may be anything."""
    if np.abs(np.diff(pressure)).max(initial=0.0) > JUMP * np.ptp(pressure):
        return None
    every = np.sort(np.concatenate([time, (time[1:] + time[:-1]) / 2]))
    return every, np.interp(every, time, pressure)


def _in_rows(pressure: Array, steps: int, path: Path) -> Array:
    if len(pressure) != steps:
        raise ValueError(
            f"{path}: {len(pressure)} rows without times for {steps} steps; wanted one row for each step, or "
            "a column of times"
        )
    return pressure


def turned(position: Array, axes: str) -> Array:
    """Positions (s,p,3) along x (along the finger), y (across), z (up) of positions along a file's axes; NaN
    along an axis that was not seen.

    axes: the file's axis for each of x, y, z, with its sign, or 0. ValueError where they are no frame, or a
    mirror image of one.

    >>> turned(np.array([[[1.0, 2.0, 3.0]]]), "x,0,-y").tolist()
    [[[1.0, nan, -2.0]]]
    """
    terms, advice = [term.strip().lower() for term in axes.split(",")], f"wanted {_about('axes')}"
    if len(terms) != 3 or not all(re.fullmatch(r"0|[+-]?[xyz]", term) for term in terms):
        raise ValueError(f"import.axes = {axes!r}: {advice}")
    seen = [term[-1] for term in terms if term != "0"]
    if len(set(seen)) != len(seen) or not seen:
        raise ValueError(f"import.axes = {axes!r}: an axis stands twice, or none does; {advice}")
    rows = np.array([_row(term) for term in terms])
    if "0" not in terms and np.linalg.det(rows) < 0:
        raise ValueError(
            f"import.axes = {axes!r} is a mirror image: wanted right-handed axes; turn one sign around"
        )
    world = np.full_like(position, np.nan)
    for axis, row in enumerate(rows):
        if row.any():
            source = int(np.argmax(np.abs(row)))
            world[..., axis] = row[source] * position[..., source]
    return world


def _row(term: str) -> Array:
    """The row (3,) of the rotation of one term."""
    row = np.zeros(3)
    if term != "0":
        row["xyz".index(term[-1])] = -1.0 if term.startswith("-") else 1.0
    return row
