"""Mistakes of strangers in the pressure log, and in the time of film and log: more for `mistakes`."""

from collections.abc import Callable

import numpy as np

from tests.strangers.planting import Plant, bad_log, filmed, log, regulated
from tests.strangers.recordings import picked, pumped, rows
from tests.strangers.studio import LOG_END, log_text, motion
from twin.project import files


def lines(change: Callable[[list[str]], list[str]]) -> Plant:
    """The log's lines changed, its heading among them."""
    return lambda root: files.write_text(
        root / "raw" / "pressure.csv", "\n".join(change(log_text().splitlines())) + "\n"
    )


def swapped(text: list[str]) -> list[str]:
    """The columns exchanged under the same heading."""
    return [text[0], *(",".join(reversed(row.split(","))) for row in text[1:])]


def odd_word(text: list[str]) -> list[str]:
    return [*text[:400], text[400].split(",")[0] + ",OVL", *text[401:]]


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
    "bar under kPa": (log(head="time_s,pressure_kPa", factor=10.0), r"wanted 0\.0001 to 1 MPa"),
    "an empty log": (empty("pressure.csv"), r"."),
    "a log of its heading alone": (bad_log("time_s,pressure_MPa\n"), r"."),
    "a word in the log": (lines(odd_word), r"OVL"),
    "columns exchanged": (lines(swapped), r"."),
    "times that run backwards": (rows(lambda log: log[::-1]), r"."),
    "no time in the log": (log(head="sample,pressure_MPa"), r"."),
    "time in min": (log(time=np.arange(0.0, LOG_END / 60, 0.01)), r"."),
    "a log from the middle of the ramp on": (rows(lambda log: [r for r in log if r[0] > 16.5]), r"."),
    "nan in the log": (rows(lambda log: [(t, np.nan if k == 800 else p) for k, (t, p) in enumerate(log)]), r"."),
    "30 frames/s stamped as 25": (pumped(1.2), r"the film seems to run 1\.[12]\d* times as long"),
    "25 frames/s stamped as 30": (pumped(0.833), r"the film seems to run 0\.8\d* times as long"),
    "a film backwards": (picked(lambda n: list(range(n))[::-1]), r"not at rest between"),
    "half a second of film": (picked(lambda n: list(range(5))), r"."),
    "an empty film": (empty("film.mkv"), r"cannot be read as a video"),
    "a static film of one second": (picked(lambda n: list(range(10)), "static.mkv"), r"wanted at least 120"),
    "frames lost in the ramp, twice": (
        picked(lambda n: [k for k in range(n) if not (22 <= k < 25 or 28 <= k < 31)]), r"."
    ),
    "a finger that goes the other way": (
        filmed(lambda marks, time: motion(marks, 0 * time) * 2 - motion(marks, time)), r"."
    ),
}  # fmt: skip
