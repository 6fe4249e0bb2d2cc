"""Logs that a gauge cannot have written are refused or told; those of real loggers pass."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying, says
from twin.gauge.pressurelog import Log, check_signal, read_log, rest_remark

TIME = np.arange(0.0, 20.0, 0.02)


def log(*, noise: float = 1e-5, scale: float = 1.0) -> Log:
    rng = np.random.default_rng(0)
    p = 0.03 * scale * np.interp(TIME, [5, 6, 10, 10.1, 15], [0, 1, 1, 0, 0])
    return Log(Path("pressure.csv"), TIME, p + noise * rng.standard_normal(len(TIME)))


def said(own: Log) -> tuple[str, ...]:
    return check_signal(own, start=2.0, end=18.0)


def kept(own: Log, keep: np.ndarray) -> Log:
    return replace(own, time=own.time[keep], pressure=own.pressure[keep])


@pytest.mark.parametrize(
    "own",
    [
        log(),
        log(noise=0.0),  # whole numbers of a coarse logger repeat themselves
        replace(log(), pressure=np.round(log().pressure, 3)),
        replace(log(), pressure=np.maximum(log().pressure, 0.0)),  # a gauge that stops at 0
        kept(log(), np.arange(len(TIME)) % 50 == 0),  # one sample a second
        kept(log(), (TIME < 7) | (TIME > 9)),  # a gap while nothing changes
        log(noise=2e-3),  # a gauge of a wide range
        log(noise=2e-3, scale=0.0),  # noise alone: told by the finger's motion
    ],
)
def test_logs_of_real_loggers_pass(own: Log) -> None:
    assert said(own) == ()


def test_a_gap_while_the_pressure_rises_is_refused() -> None:
    with pytest.raises(ValueError, match=saying(r"4\.98", r"6\.0[02]", r"0\.03 MPa")):
        said(kept(log(), (TIME < 5) | (TIME > 6)))
    before = replace(log(), time=log().time - 30.0)  # before the film
    assert check_signal(kept(before, (TIME < 5) | (TIME > 6)), start=-12.0, end=-11.0) == ()


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_dropped_samples_are_refused(value: float) -> None:
    odd = log().pressure.copy()
    odd[[400, 420]] = value
    with pytest.raises(ValueError, match=rf"2 samples lie far off .* at 8\.00 s: {value:g} MPa between 0\.03 and 0\.03 MPa"):
        said(replace(log(), pressure=odd))
    slow = kept(replace(log(), pressure=odd), np.arange(len(TIME)) % 4 == 0)  # 12 values a second: perhaps real
    assert "Are they real" in said(slow)[0]


@pytest.mark.parametrize("until", [9.0, 30.0])
def test_a_log_that_stops_is_told(until: float) -> None:
    stuck = np.where((TIME > 7) & (until > TIME), 0.025, log().pressure)
    says(said(replace(log(), pressure=stuck))[0], "0.025 MPa", "7.0")
    rest = np.where(TIME < 4.5, log().pressure.min(), log().pressure)
    assert said(replace(log(), pressure=rest)) == ()


def test_a_gauge_that_does_not_read_zero_at_rest_is_told() -> None:
    assert rest_remark(log(), start=2.0, rest_s=1.8) == ""
    off = replace(log(), pressure=log().pressure + 0.005)
    says(rest_remark(off, start=2.0, rest_s=1.8), "0.005 MPa", "(2.0 to 3.8 s)", "17 %")
    assert rest_remark(replace(log(), pressure=log().pressure + 0.001), start=2.0, rest_s=1.8) == ""


@pytest.mark.parametrize(
    ("offset", "factor", "sentence"),
    [
        (101.325, 1e3, r"p \[kPa\] never falls below 0\.1013 MPa, which is the pressure of the air"),
        (84.0, 1e3, r"absolute pressure"),  # in Mexico City or in Denver
        (0.0, -1e3, r"falls to -0\.03 MPa and rises to .* MPa only; .*turn its sign"),
    ],
)
def test_absolute_pressure_and_a_turned_sign_are_refused(tmp_path: Path, offset: float, factor: float, sentence: str) -> None:
    rows = "".join(f"{t:.2f},{offset + factor * p:.6g}\n" for t, p in zip(TIME, log().pressure, strict=True))
    (tmp_path / "p.csv").write_text("time_s,p [kPa]\n" + rows)
    with pytest.raises(ValueError, match=sentence):
        read_log(tmp_path / "p.csv", time_shift_s=0.0)


@pytest.mark.parametrize("offset", [0.0, 5.0, -3.0, 60.0, 120.0])
def test_other_offsets_are_no_air(tmp_path: Path, offset: float) -> None:
    rows = "".join(f"{t:.2f},{offset + 1e3 * p:.6g}\n" for t, p in zip(TIME, log().pressure, strict=True))
    (tmp_path / "p.csv").write_text("time_s,p [kPa]\n" + rows)
    found = read_log(tmp_path / "p.csv", time_shift_s=0.0)
    np.testing.assert_allclose(found.pressure, log().pressure + 1e-3 * offset, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("last", ["1e300", "2e8"])
def test_times_that_no_test_lasts_are_refused(tmp_path: Path, last: str) -> None:
    (tmp_path / "log.csv").write_text(f"time_s,p [kPa]\n0,0\n1,1\n{last},20\n", encoding="utf-8")
    with pytest.raises(ValueError, match=rf"log\.csv: the times cover {float(last):.3g} s; wanted 1e\+08 s at most".replace("e+", r"e\+")):
        read_log(tmp_path / "log.csv", time_shift_s=0.0)
