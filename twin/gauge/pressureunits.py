"""Turn the heading of a column of a pressure log, or a key of twin.toml, into what its numbers mean.

The only place that knows other units than MPa and s: behind it there are no others.
"""

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import NoReturn

import numpy as np

from twin.targets import Array

PRESSURE = ("pressure", "press", "p", "druck")  # first word of a heading that speaks of the pressure
VOLTAGE = ("voltage", "volt", "volts", "u", "signal")  # only where a calibration line is given
# Words of what was asked of a regulator, not measured.
ASKED = (
    "set", "setpoint", "setpt", "sp", "target", "command", "commanded", "cmd", "ref", "reference", "soll",
    "sollwert", "solldruck", "desired", "demand", "goal", "theoretical", "requested", "nominal",
)  # fmt: skip
TIME = ("time", "t", "timestamp", "elapsed", "zeit", "x_value")
CLOCKS = {"millis": "ms", "micros": "us"}  # Arduino's
TIMES = ("s", "ms", "us", "min")
KNOWN = ("Pa", "hPa", "kPa", "MPa", "mbar", "bar", "psi", "V", "mV", *TIMES)
GAUGE = {"psig": "psi", "barg": "bar", "bar(g)": "bar", "kpag": "kPa"}  # gauge pressure, as wanted
ABSOLUTE = ("psia", "bara", "bar(a)", "kpaa", "mbara", "kpa(a)")
SLOPPY = {
    "sec": "s", "seconds": "s", "second": "s", "msec": "ms", "milliseconds": "ms", "usec": "us",
    "\u00b5s": "us", "\u03bcs": "us", "microseconds": "us", "minutes": "min", "volt": "V", "volts": "V",
}  # fmt: skip
UNITS = "MPa, kPa, Pa, hPa, bar, mbar, psi, or V with a calibration line"


@dataclass(frozen=True)
class Line:
    """The calibration line of a gauge with a voltage output: pressure = MPa_per_V (V - volt_zero)."""

    volt_zero: float  # V at no gauge pressure
    MPa_per_V: float


@dataclass(frozen=True)
class Heading:
    """A heading's parts: the quantity's first word in small letters, and its unit as written."""

    word: str
    unit: str  # "" where it says none


@lru_cache  # the cells of a log are asked one by one for a header
def heading(text: str) -> Heading:
    """The word and the unit of a heading: pressure_kPa, p [bar], Pressure (psi), Druck/bar, time_s, t.

    >>> heading("Pressure (psi)"), heading("p [bar]").unit, heading("t")
    (Heading(word='pressure', unit='psi'), 'bar', Heading(word='t', unit=''))
    """
    bare = text.strip().strip('"')
    for pattern in (r"(.*?)\s*\[(.*)\]", r"(.*?)\s*\((.*)\)", r"(.*?)\s*/\s*(\S+)", r"(.*?)\s+in\s+(\S+)",
                    r"(.*)_(\w+(?:\(\w\))?)"):  # fmt: skip
        match = re.fullmatch(pattern, bare)
        if match and match[1]:
            return Heading(_word(match[1]), match[2].strip())
    return Heading(_word(bare), "")


def _word(text: str) -> str:
    return re.split(r"[\s_.]+", text.strip().lower())[0]


def unit_of(text: str, *, what: str) -> str:
    """The unit in this program's spelling; ValueError where it is unclear or of absolute pressure.

    what: the place it was read from, for the error.

    >>> unit_of("barg", what="log.csv"), unit_of("kpa", what="log.csv")
    ('bar', 'kPa')
    >>> unit_of("N/mm2", what="log.csv")
    'N/mm^2'
    >>> unit_of("bar abs", what="log.csv")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ValueError: log.csv is absolute pressure (bar abs): wanted gauge pressure, ...
    """
    plain = text.strip()
    if plain.lower() in ABSOLUTE or speaks_of_absolute(plain):
        refuse_absolute(plain, what=what)
    plain = GAUGE.get(plain.lower(), SLOPPY.get(plain.lower(), plain))
    plain = re.sub(r"(?<=/)([a-z]+)(?:2|\u00b2)$", r"\1^2", plain)  # N/mm2, kgf/cm2
    for unit in KNOWN:
        # m and M are a factor of 1e9 apart, so their case must be right; that of the others says nothing
        if plain.lower() == unit.lower() and (plain[0] == unit[0] or plain[0] not in "mM"):
            return unit
    if plain.lower() in (unit.lower() for unit in KNOWN):
        raise ValueError(f"{what} has the unit {text!r}, which may be milli or mega: wanted one of {UNITS}")
    if not _is_pressure(plain):
        raise ValueError(f"{what} has the unit {text!r}, which is none of pressure: wanted one of {UNITS}")
    return plain


def time_unit(text: str, *, what: str) -> str:
    """The unit of a time: s, ms, us or min. ValueError for another or none.

    >>> time_unit("msec", what="log.csv"), time_unit("us", what="log.csv")
    ('ms', 'us')
    """
    unit = SLOPPY.get(text.strip().lower(), text.strip())
    if unit.lower() not in TIMES:
        has = f"the unit {unit!r}" if unit else "no unit"
        raise ValueError(f"{what} has {has}: wanted s, ms, us or min, as in time_s or t [ms]")
    return unit.lower()


def is_pressure(unit: str) -> bool:
    """True for a unit of pressure, absolute or gauge, clear or not.

    >>> is_pressure("kPa"), is_pressure("N")
    (True, False)
    """
    try:
        return bool(unit) and unit_of(unit, what="") not in ("V", "mV", *TIMES)
    except ValueError as error:
        return "none of pressure" not in str(error)


def words_of(text: str) -> list[str]:
    """The words of a heading in small letters; those that are written together, too, are parted.

    >>> words_of("pressureSetpoint_kPa")
    ['pressure', 'setpoint', 'kpa']
    """
    parted = re.sub(r"(?<=[a-z]{2})(?=[A-Z][a-z])", " ", text)
    return re.findall(r"[^\W\d_]+", parted.lower())


def speaks_of_absolute(text: str) -> bool:
    """True for a heading or a unit of absolute pressure: bar abs, pressure_abs_kPa."""
    return re.search(r"(?<![a-z])abs", text.lower()) is not None


def refuse_absolute(text: str, *, what: str) -> NoReturn:
    """Raise the ValueError that explains how to make gauge pressure of absolute pressure."""
    raise ValueError(
        f"{what} is absolute pressure ({text}): wanted gauge pressure, which is 0 when the finger is vented; "
        "subtract the reading at rest and name the column after the result"
    )


def _is_pressure(unit: str) -> bool:
    import pint

    # a unit with at most one power: the evaluator takes any formula, such as bar**9**9**9
    if not re.fullmatch(r"[A-Za-z\u00b5_/ ]{1,16}((\^|\*\*)?[23][A-Za-z]?)?", unit):
        return False
    try:
        return bool(pint.get_application_registry()(unit).check("[pressure]"))
    except Exception:  # its evaluator raises many kinds, AssertionError and TokenError among them
        return False


def in_MPa(values: Array, unit: str, *, line: Line | None) -> Array:
    """Gauge pressure (t,) MPa from readings (t,) in a unit of `unit_of`; volts by the calibration line.

    >>> in_MPa(np.array([0.0, 50.0]), "kPa", line=None).round(6).tolist()
    [0.0, 0.05]
    >>> in_MPa(np.array([0.5, 2.5]), "V", line=Line(volt_zero=0.5, MPa_per_V=0.1)).tolist()
    [0.0, 0.2]
    """
    if unit == "MPa":
        return values  # bit for bit
    if unit in ("V", "mV"):
        assert line is not None  # the reader refuses volts without it
        return np.asarray(line.MPa_per_V * (_converted(values, unit, "V") - line.volt_zero))
    return _converted(values, unit, "MPa")


def in_seconds(values: Array, unit: str) -> Array:
    """Times (t,) s from times (t,) in s, ms, us or min.

    >>> in_seconds(np.array([0.0, 250.0]), "ms").tolist()
    [0.0, 0.25]
    """
    return values if unit == "s" else _converted(values, unit, "s")


def _converted(values: Array, unit: str, target: str) -> Array:
    if unit == target:
        return values
    import pint

    registry = pint.get_application_registry()
    return np.asarray(registry.Quantity(values, unit).to(target).magnitude, dtype=np.float64)
