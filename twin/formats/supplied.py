"""Unit, axes, times and pressure of a file, from [import] of twin.toml where the file lacks them."""

import re
from decimal import Decimal
from pathlib import Path

import numpy as np

from twin.formats.importtable import ImportTable
from twin.formats.recorded import PIXEL, Recorded
from twin.gauge.logcolumns import LogFormat, asked_doubt, log_sheet, pressure_column, pressures, time_column
from twin.gauge.pressurelog import Log, read_log
from twin.sanity import MOST_MPA
from twin.targets import Array


def still_wanted(recorded: Recorded, table: ImportTable) -> dict[str, str]:
    """The keys of [import] that have to be stated and are not yet, each with what it has to say."""
    known = table.top_kPa is not None or recorded.pressure is not None
    lacks = {
        "sd_mm": table.sd_mm is None and table.still_steps is None,
        "mm_per_px": recorded.unit == PIXEL and table.mm_per_px is None,
        "unit": not (recorded.unit or table.unit),
        "axes": not (table.axes or recorded.axes),
        "fps": recorded.time is None and not known and table.fps is None,
        "log": not known and table.log is None,
    }  # fmt: skip
    return {key: _about(key) for key, lacking in lacks.items() if lacking}


def _about(key: str) -> str:
    """The description of a key of [import]."""
    return ImportTable.model_fields[key].description or ""


def check_stated(recorded: Recorded, table: ImportTable, log: Path | None) -> None:
    """Raise ValueError where something of the file is not stated, or is twice. log: path of the log."""
    missing = still_wanted(recorded, table)
    if "fps" in missing and log is not None and not _has_times(log, table):
        del missing["fps"]  # single steps, a row of the log each
    if missing:
        each = "; ".join(f"{key} ({what})" for key, what in missing.items())
        raise ValueError(f"[import]: the file does not say all that is needed; wanted {each}")
    if table.sd_mm is not None and table.still_steps is not None:
        raise ValueError(
            f"import.sd_mm = {table.sd_mm:g} and import.still_steps: both say how large the noise is; leave "
            "one of them out"
        )
    if recorded.unit != PIXEL and table.mm_per_px is not None:
        raise ValueError(
            f"import.mm_per_px = {table.mm_per_px:g}: the file is in {recorded.unit}; leave it out"
        )
    if table.hold_sd_mm and not table.released:
        raise ValueError(
            f"import.hold_sd_mm = {table.hold_sd_mm:g} without released = true: where no hand holds the body "
            "in its rest, leave it out"
        )
    check_unit(recorded, table)
    _check_step(recorded, table)


def check_unit(recorded: Recorded, table: ImportTable) -> None:
    """Raise ValueError where the unit of the lengths is not stated, or is stated as another one."""
    if not (recorded.unit or table.unit):
        raise ValueError(f"{table.file}: states no unit of length; wanted unit ({_about('unit')}), or --unit")
    if table.unit and recorded.unit and table.unit != recorded.unit:
        raise ValueError(
            f"unit = {table.unit!r}: {table.file} says {recorded.unit}; leave it out, or correct the file"
        )


def _check_step(recorded: Recorded, table: ImportTable) -> None:
    """Raise ValueError where a step's top pressure stands beside another pressure, or is none of silicone."""
    if table.top_kPa is None:
        if table.top_sd_kPa is not None:
            raise ValueError(f"import.top_sd_kPa = {table.top_sd_kPa:g} without top_kPa: state both, or none")
        return
    text = f"import.top_kPa = {table.top_kPa:g}"
    if table.log is not None or recorded.pressure is not None:
        other = "log" if table.log is not None else "the file's own pressure"
        raise ValueError(f"{text} beside {other}: both say what the pressure is; leave top_kPa out")
    if table.still_steps == "holds":
        raise ValueError(f'{text} with still_steps = "holds": no pressure tells holds; state rows, or sd_mm')
    if table.top_kPa > 1e3 * MOST_MPA:
        raise ValueError(f"{text}: wanted kPa, at most {1e3 * MOST_MPA:g}; is it in Pa or mbar?")


def _form(table: ImportTable) -> LogFormat:
    column, unit = (f"{key} under [import] of twin.toml" for key in ("log_column", "log_unit"))
    return LogFormat(table.log_column, table.log_unit, key=column, unit_key=unit)


def _has_times(log: Path, table: ImportTable) -> bool:
    return time_column(log_sheet(log, _form(table))) is not None


def mm_per_unit(recorded: Recorded, table: ImportTable) -> float:
    """Length in mm of the file's unit; ValueError where it is none of length."""
    unit = recorded.unit or table.unit or ""
    if unit == PIXEL:
        assert table.mm_per_px is not None  # checked
        return table.mm_per_px
    import pint

    try:
        if not unit.isalpha():  # pint would calculate, or fail
            raise ValueError(unit)
        return float(pint.get_application_registry().Quantity(1.0, unit).to("mm").magnitude)
    except (pint.PintError, AttributeError, ValueError):
        advice = "wanted px or a unit of length, such as mm"
        raise ValueError(f"the file is in {unit!r}: {advice}") from None


def times_of(recorded: Recorded, table: ImportTable) -> Array:
    """Times (s,) s on the clock of the log."""
    time = recorded.time
    if time is None:
        time = (recorded.frame - recorded.frame[0]) / (table.fps or 1.0)
        if table.fps is not None and np.any(np.diff(recorded.frame) != 1.0) and len(time) > 1:
            from vision.film.numbering import times_of_numbers

            numbers = [Decimal(repr(float(n))) for n in recorded.frame]
            time = times_of_numbers(numbers, table.fps, where=Path(table.file))
    if np.any(np.diff(time) <= 0):
        raise ValueError(
            "the file's times do not increase from row to row; wanted one row for each frame, in order"
        )
    return time + table.start_s


FEW = 0.05  # share of the rows, beside steps, in which two records of one pressure may differ
VALVE_S = 0.25  # from row to row, within which a step of a valve is known well enough
ACROSS_MM, UP = 2.0, 0.05  # motion across that is asked about, and of it up
JUMP = 0.25  # of the pressure's range, from row to row: what lies between is then known well enough


def pressure_of(
    recorded: Recorded, table: ImportTable, time: Array, log: Path | None
) -> tuple[Array, tuple[Array, Array] | None, str]:
    """The pressure (s,) MPa of each step, the log (t,) s, (t,) MPa between them where there is one, and a
    sentence on it."""
    if table.top_kPa is not None:
        return np.zeros(len(time)), None, ""  # that of the hold is stated
    if log is None:
        assert recorded.pressure is not None  # checked
        return recorded.pressure, None if recorded.time is None else _along(time, recorded.pressure), ""
    form = _form(table)
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


def read_course(recorded: Recorded, table: ImportTable, time: Array, log: Path | None) -> Log | None:
    """The log over time by which motion is judged; None where the rows themselves have the pressure.
    ValueError where the file's own pressure is another one than the log's."""
    if log is None or not _has_times(log, table):
        return None
    read = read_log(log, time_shift_s=0.0, form=_form(table))
    if recorded.pressure is not None:
        off = np.abs(recorded.pressure - read.at(time))
        if np.mean(off > JUMP * np.ptp(read.pressure)) > FEW:
            raise ValueError(
                f"import.log = {table.log!r}: the file has a pressure of its own, which differs from the "
                f"log's by up to {off.max():.2g} MPa; wanted one course: correct start_s, or leave log out"
            )
    return read


def _along(time: Array, pressure: Array) -> tuple[Array, Array] | None:
    """The course of the pressure (s,) MPa from row to row, straight between them; None where a step is so
    large that it may be anything: another one follows, or it takes longer than a valve."""
    jumps = np.abs(np.diff(pressure)) > JUMP * np.ptp(pressure)
    if (jumps[1:] & jumps[:-1]).any() or np.diff(time)[jumps].max(initial=0.0) > VALVE_S:
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


def across_doubt(moved: Array, axes: str) -> str:
    """The sentence where the points' motion (s,p,3) mm is across and nothing is up, with the axes to write
    instead: a picture's y is the height, as a rule; "" for another motion.

    >>> moved = np.array([[[0.0, 0.0, 0.0]], [[-5.0, -20.0, 0.0]]])
    >>> across_doubt(moved, "x,y,z").rpartition(": ")[2]
    'write axes = "x,-z,y" under [import]'
    """
    largest = np.nan_to_num(np.abs(np.where(np.isfinite(moved), moved, 0.0))).max(axis=(0, 1), initial=0.0)
    if largest[1] < ACROSS_MM or largest[2] > UP * largest[1]:
        return ""
    along, across, up = (term.strip().lower() for term in axes.split(","))
    y = moved[..., 1].ravel()
    falls = y[np.nanargmax(np.abs(y))] < 0.0
    turn = {"0": "0", across: _opposite(across), up: _opposite(up)}
    written = f"{along},{turn[up] if falls else up},{across if falls else turn[across]}"
    return (
        f"The points move by up to {largest[1]:.3g} mm across (y) and {largest[2]:.2g} mm up (z). If the "
        f'file\'s {across[-1]} is the height in the picture: write axes = "{written}" under [import]'
    )


def _opposite(term: str) -> str:
    return "0" if term == "0" else term[1:] if term.startswith("-") else f"-{term.lstrip('+')}"


def _row(term: str) -> Array:
    """The row (3,) of the rotation of one term."""
    row = np.zeros(3)
    if term != "0":
        row["xyz".index(term[-1])] = -1.0 if term.startswith("-") else 1.0
    return row
