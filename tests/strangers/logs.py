"""Mistakes of strangers in the pressure log, and in the time of film and log: more for `mistakes`.

`MISTAKES` must be refused; `DOUBTFUL` pass, with a sentence that names the doubt.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.strangers.planting import Plant, bad_log, camera_with, filmed, log, regulated
from tests.strangers.recordings import picked, pumped, rows
from tests.strangers.studio import FILM_START, log_text, motion
from twin import files


def lines(change: Callable[[list[str]], list[str]]) -> Plant:
    """The log's lines changed, its heading among them."""
    return lambda root: files.write_text(
        root / "raw" / "pressure.csv", "\n".join(change(log_text().splitlines())) + "\n"
    )


def swapped(text: list[str]) -> list[str]:
    """The columns exchanged under the same heading."""
    return [text[0], *(",".join(reversed(row.split(","))) for row in text[1:])]


def wrapped(row: str, most: int) -> str:
    """A row whose time, in ms since 20 s before, is a signed number below `most`."""
    time, pressure = row.split(",")
    return f"{(round(1e3 * float(time)) + 20_000 + most) % (2 * most) - most},{pressure}"


def odd_word(text: list[str]) -> list[str]:
    return [*text[:400], text[400].split(",")[0] + ",OVL", *text[401:]]


def rows_in_min(root: Path) -> None:
    """The log's time in minutes, under a heading in s."""
    pairs = [line.split(",") for line in log_text().splitlines()[1:]]
    text = "time_s,pressure_MPa\n" + "".join(f"{float(t) / 60:.6f},{p}\n" for t, p in pairs)
    files.write_text(root / "raw" / "pressure.csv", text)


def empty(name: str) -> Plant:
    return lambda root: (root / "raw" / name).write_bytes(b"")


MISTAKES: dict[str, tuple[Plant, str]] = {
    "Pa under MPa": (log(factor=1e6), r"wanted 0\.0001 to 1 MPa"),
    "psi under kPa, with the regulator's pressure": (
        regulated(30.0, head="time_s,pressure_kPa", factor=145.04), r"psi"
    ),
    "kPa under mbar, with the regulator's pressure": (
        regulated(30.0, head="time_s,p [mbar]", factor=30.0 / 0.03), r"kPa"
    ),
    "bar under kPa, with the regulator's pressure": (
        regulated(30.0, head="time_s,pressure_kPa", factor=10.0), r"likely in bar"
    ),
    "an empty log": (empty("pressure.csv"), r"no rows"),
    "a log of its heading alone": (bad_log("time_s,pressure_MPa\n"), r"no rows"),
    "a word in the log": (lines(odd_word), r"line 401, column pressure_MPa: 'OVL'"),
    "columns exchanged": (lines(swapped), r"columns .* exchanged"),
    "times that run backwards": (rows(lambda log: log[::-1]), r"newest first; turn their order round"),
    "a clock that restarts": (rows(lambda log: [*log[:700], *log[:500]]), r"jumped back by \d+\.\d+ s at line 702: it wrapped, or the logger restarted"),
    "a clock of 16 bits": (
        lines(lambda text: ["time_ms,pressure_MPa", *(wrapped(row, 2**15) for row in text[1:])]),
        r"it wrapped after 2\^16 ms; add 65536 ms to the times from that line on",
    ),
    "a setpoint beside the gauge": (
        lines(lambda text: ["time_s,p_set [MPa],p [MPa]", *(f"{row},{row.split(',')[1]}" for row in text[1:])]),
        r"'p_set \[MPa\]' \(asked of the regulator\) and 'p \[MPa\]' are both of pressure",
    ),
    "no headings": (lines(lambda text: text[1:]), r"line 1 has numbers already: write a line of headings above it"),
    "a log of two runs": (lines(lambda text: [*text, *text]), r"header stands in the lines 1, \d+: the logger was started again"),
    "two faults of a header": (log(head="time_d,pressure"), r"has the unit 'd': wanted s.*; and .*has no unit"),
    "no time in the log": (log(head="sample,pressure_MPa"), r"column time_s is missing: the header is sample,pressure_MPa"),
    "time in min": (rows_in_min, r"its time may be in min, as 0\.433 min are 26 s"),
    "a log from the middle of the ramp on": (rows(lambda log: [r for r in log if r[0] > 16.5]), r"covers 16\.5\d* to 25\.98\d* s, the film 14\.000"),
    "nan in the log": (rows(lambda log: [(t, np.nan if k == 800 else p) for k, (t, p) in enumerate(log)]), r"line 802, column pressure_MPa: 'nan'"),
    "30 frames/s stamped as 25": (pumped(1.2), r"the film seems to run 1\.[12]\d* times as long"),
    "25 frames/s stamped as 30": (pumped(0.833), r"the film seems to run 0\.8\d* times as long"),
    "stamps 5 % slow": (pumped(1.05), r"0\.1\d s after the pressure at 2\.6 s of the film, 1\.0\d s after it"),
    "a clock that is off by 0.15 s": (
        camera_with(film_start_s=FILM_START - 0.15), r"moves 0\.1\d s before the pressure .* correct film_start_s"
    ),
    "a film backwards": (picked(lambda n: list(range(n))[::-1]), r"not at rest between"),
    "half a second of film": (picked(lambda n: list(range(5))), r"film\.mkv has 5 frames in its first 1\.8 s, wanted 10"),
    "an empty film": (empty("film.mkv"), r"cannot be read as a video"),
    "a static film of one second": (picked(lambda n: list(range(10)), "static.mkv"), r"wanted at least 120"),
    "a finger that goes the other way": (
        filmed(lambda marks, time: motion(marks, 0 * time) * 2 - motion(marks, time)), r"U3 of tip is \+20 mm at top pressure.*turn the sign"
    ),
}  # fmt: skip

DOUBTFUL: dict[str, tuple[Plant, str]] = {
    "a setpoint alone": (log(head="time_s,pressure_setpoint_MPa"), r"asked for, not what a gauge measured"),
    "a clock that is late by 0.15 s": (
        camera_with(film_start_s=FILM_START + 0.15), r"moves 0\.1\d s later than the pressure .* film_start_s too late"
    ),
    "frames lost in the ramp, twice": (
        picked(lambda n: [k for k in range(n) if not (22 <= k < 25 or 28 <= k < 31)]), r"seems to run 0\.4\d times as long as the test.*has it lost frames"
    ),
}  # fmt: skip

RIGHT: dict[str, Plant] = {
    "comments above the log": lines(lambda text: ["# logger v2", "# channel 1", *text]),
    "a log of LabVIEW": lines(
        lambda text: ["LabVIEW Measurement", "Y_Unit_Label,MPa", "***End_of_Header***", "X_Value,Pressure,Comment",
                      *(f"{row}," for row in text[1:])]
    ),
    "the stamps of Arduino's monitor": lines(lambda text: [f"12:31:22.101 -> {row}" for row in text]),
    "time in us": lines(
        lambda text: ["time_us,pressure_MPa", *(f"{1e6 * float(row.split(',')[0]):.0f},{row.split(',')[1]}" for row in text[1:])]
    ),
    "N/mm2": log(head="Elapsed (s),pressure (N/mm2)"),
    "blanks between quoted headings": log(head='"time_s", "pressure_MPa"'),
}  # fmt: skip
