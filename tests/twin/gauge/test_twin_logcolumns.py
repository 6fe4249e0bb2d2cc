"""Pressure logs as people have them: units, headings, volts, decimal commas, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying
from twin.gauge.logcolumns import LogFormat
from twin.gauge.pressurelog import Log, all_rest, check_lasts, gauge_noise, read_log
from twin.gauge.pressureunits import Line, heading, unit_of
from twin.project.toml import parse

MPA = np.array([0.0, 0.015, 0.03])
PER_MPA = {  # by their definitions: BIPM, NIST SP 811
    "pressure_MPa": 1.0, "pressure_kPa": 1e3, "p_Pa": 1e6, "p [bar]": 10.0, "Pressure (psi)": 145.03773773,
    "Pressure 1 [mbar]": 1e4, "p in hPa": 1e4, "p/bar": 10.0, "PRESSURE (KPA)": 1e3, "p [psig]": 145.03773773,
    "Pressure (mmHg)": 7500.6157584566, "p [N/mm^2]": 1.0,
}  # fmt: skip


def log_at(folder: Path, text: str, form: LogFormat | None = None) -> Log:
    (folder / "p.csv").write_text(text, encoding="utf-8")
    return read_log(folder / "p.csv", time_shift_s=0.0, form=form)


def rows(values: np.ndarray, *, separator: str = ",", comma: bool = False) -> str:
    lines = [f"{0.02 * k:.3f}{separator}{float(v)!r}\n" for k, v in enumerate(values)]
    return "".join(line.replace(".", ",") if comma else line for line in lines)


@pytest.mark.parametrize("name", PER_MPA)
def test_a_heading_tells_the_unit(tmp_path: Path, name: str) -> None:
    log = log_at(tmp_path, f"time_s,{name}\n{rows(MPA * PER_MPA[name])}")
    np.testing.assert_allclose(log.pressure, MPA, rtol=1e-9, atol=1e-15)  # psi and mmHg are known to 1e-10
    assert log.source.startswith(f"column {name!r}, in ")


def test_rounded_times_are_told_from_rows_that_repeat(tmp_path: Path) -> None:
    pressure = np.linspace(0.0, 0.03, 50)
    text = "time_s,pressure_MPa\n" + "".join(f"{0.02 * k:.1f},{p}\n" for k, p in enumerate(pressure))
    with pytest.raises(ValueError, match=r"line 3, .* 39 of 50 rows repeat .* rounded to 0\.1 s: write it with more digits"):
        log_at(tmp_path, text)
    twice = rows(pressure).splitlines()
    for lines, way in (([*twice[:5], *twice[4:]], "remove repeated rows"), ([*twice[:20], *twice[:30]], r"the clock jumped back by 0\.38 s at line 22: it wrapped, or the logger restarted")):
        with pytest.raises(ValueError, match=way):
            log_at(tmp_path, "time_s,pressure_MPa\n" + "\n".join(lines) + "\n")


def test_a_key_tells_the_unit_where_the_heading_does_not(tmp_path: Path) -> None:
    log = log_at(tmp_path, f"time_s,ai0,ai1\n{rows(1e3 * MPA).replace(chr(10), ',7' + chr(10))}", LogFormat("ai0", "kPa"))
    np.testing.assert_allclose(log.pressure, MPA, rtol=1e-12)


@pytest.mark.parametrize(("name", "scale"), [("Voltage (V)", 1.0), ("u [mV]", 1e3), ("p [V]", 1.0)])
def test_volts_become_pressure_by_the_calibration_line(tmp_path: Path, name: str, scale: float) -> None:
    volts = scale * (0.5 + MPA / 0.025)
    log = log_at(tmp_path, f"t [ms],{name}\n{rows(volts)}", LogFormat(line=Line(0.5, 0.025)))
    np.testing.assert_allclose(log.pressure, MPA, rtol=0, atol=1e-12)
    np.testing.assert_allclose(log.time, [0, 2e-5, 4e-5], rtol=1e-12)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_are_read_between_semicolons_and_tabs(tmp_path: Path, separator: str) -> None:
    log = log_at(tmp_path, f"time_s{separator}p [kPa]\n{rows(1e3 * MPA, separator=separator, comma=True)}")
    np.testing.assert_allclose(log.pressure, MPA, rtol=1e-12)
    np.testing.assert_allclose(log.time, [0, 0.02, 0.04])
    same = log_at(tmp_path, f"time_s{separator}p [kPa]\n{rows(1e3 * MPA, separator=separator)}")
    np.testing.assert_array_equal(same.pressure, log.pressure)


@pytest.mark.parametrize(
    ("text", "form", "sentence"),
    [
        ("time_s,p\n0,0\n1,30\n", None, "column 'p' has no unit: wanted MPa, kPa,.*set unit under"),
        ("time_s,pressure_kPa\n0,0\n1,30\n", LogFormat(unit="bar"), "'pressure_kPa' says kPa, .* says bar; wanted one unit"),
        ("time_s,pressure_mpa\n0,0\n1,0.03\n", None, "the unit 'mpa', which may be milli or mega"),
        ("time_s,p [psia]\n0,14.7\n1,19\n", None, "absolute pressure .*subtract the reading at rest"),
        ("time_s,p [bar abs]\n0,1\n1,1.3\n", None, "absolute pressure"),
        ("time_s,pressure_abs_kPa\n0,101\n1,130\n", None, "'pressure_abs_kPa' is absolute pressure"),
        ("time_s,p [furlong]\n0,1\n1,1.3\n", None, "the unit 'furlong', which is none of pressure"),
        ("time_s,p [%]\n0,1\n1,1.3\n", None, "the unit '%', which is none of pressure"),
        ("time_s,p1_kPa,p_kPa,pressure_bar\n0,1,1,1\n", None, "columns 'p1_kPa' and 'p_kPa' and 'pressure_bar' are all of pressure"),
        ("time_s,p_V\n0,0.5\n1,1.7\n", None, "is in V: wanted the calibration line .*volt_zero"),
        ("time_s,p_kPa\n0,0\n1,30\n", LogFormat(line=Line(0.5, 0.025)), "in kPa, but .* a calibration line for volts"),
        ("time_s,ai0\n0,0\n1,30\n", LogFormat("ai1", "kPa"), "column = 'ai1' is not in the header time_s,ai0"),
        ("time_s,p_kPa\n0,0\n1,30000\n", None, "p_kPa reaches 30 MPa, read in kPa; wanted 0.0001 to 1 MPa"),
        ("time_s,p_kPa\n0,0\n1,0.03\n", None, "p_kPa reaches 3e-05 MPa, read in kPa; wanted 0.0001 to 1 MPa"),
        ("time_s,p_kPa\n0,0\n1,300\n", LogFormat(top_kPa=30.0), "p_kPa reaches 300 kPa, .* set to 30 kPa .* likely in mbar; correct the unit"),
        ("t,p_kPa\n0,0\n1,30\n", None, "column 't' has no unit: wanted s, ms, us or min"),
        ("p_kPa,x\n0,0\n1,30\n", None, "column time_s is missing"),
        ("time_s,p_kPa\n0,0,0,0\n0,5,30,1\n", None, "line 2: 4 cells; wanted 2, .*decimal commas.*semicolons"),
        ('time_s,p_kPa\n"0,0","0,0"\n"0,5","30,1"\n', None, "line 2, column time_s: '0,0': .*write a decimal point"),
        ("time_s;p_kPa\n0,0;0.0\n0,5;30.1\n", None, "'0,0': it has a comma, '0.0' in line 2 a point; wanted one decimal"),
        ("time_s;p_kPa\n0,0;0,0\n0,5;1.030,1\n", None, "'1.030,1': .*no mark between thousands"),
    ],
)  # fmt: skip
def test_what_is_unclear_is_refused_in_one_sentence(tmp_path: Path, text: str, form: LogFormat | None, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence) as error:
        log_at(tmp_path, text, form)
    assert "\n" not in str(error.value)


def test_the_documented_heading_is_read_beside_others(tmp_path: Path) -> None:
    log = log_at(tmp_path, "time_s,pressure_raw,pressure_MPa\n0,900,0\n1,1800,0.03\n")
    assert log.pressure.tolist() == [0, 0.03]


def test_a_log_shorter_than_the_film_is_named_and_a_longer_one_is_not(tmp_path: Path) -> None:
    log = log_at(tmp_path, f"time_s,p_kPa\n{rows(1e3 * MPA)}")
    check_lasts(log, 0.04)
    check_lasts(log, 0.01)
    with pytest.raises(ValueError, match=saying("p.csv", "0.040 s", "0.050 s")):
        check_lasts(log, 0.05)


def test_what_a_longer_log_holds_after_the_test_is_left_out() -> None:
    log = Log(Path("p.csv"), np.arange(0.0, 100.0, 0.5), np.arange(0.0, 100.0, 0.5) / 1e3)
    time, pressure = log.beside(np.array([10.0, 20.0]))
    assert (time[0], time[-1]) == (0.0, 22.5)  # what came before may be remembered
    assert pressure.max() == 0.0225


def test_headings_and_units_by_themselves() -> None:
    assert (heading("Pressure (psi)").word, heading("Pressure (psi)").unit) == ("pressure", "psi")
    assert (heading("time_s").word, heading("time_s").unit) == ("time", "s")
    assert heading("p1_kPa").word == "p1"
    assert unit_of("KPA", what="x") == "kPa"
    assert unit_of("PSIG", what="x") == "psi"
    with pytest.raises(ValueError, match="milli or mega"):
        unit_of("Mbar", what="x")


def test_half_a_calibration_line_is_refused() -> None:
    text = '[[points]]\nname = "tip"\nnode = 4401\n[pressure]\nunit = "V"\nvolt_zero = 0.5\n'
    with pytest.raises(ValueError, match=saying("volt_zero", "MPa_per_V")):
        parse(text.encode(), name="twin.toml")


@pytest.mark.parametrize("unit", ["bar**9**9**9", "'", "((((", "bar*bar", "1/0", "bar" * 50])
def test_a_unit_that_is_a_formula_is_never_worked_out(unit: str) -> None:
    with pytest.raises(ValueError, match="which is none of pressure: wanted one of MPa"):
        unit_of(unit, what="column p")


@pytest.mark.parametrize("unit", ["mmHg", "inH2O", "N/mm^2", "kgf/cm**2", "torr"])
def test_other_units_of_pressure_are_known(unit: str) -> None:
    assert unit_of(unit, what="column p") == unit


def test_exchanged_columns_are_told(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).normal(0.01, 1e-3, 50)
    rows = "".join(f"{p},{0.02 * k}\n" for k, p in enumerate(noise))
    (tmp_path / "p.csv").write_text("time_s,pressure_MPa\n" + rows)
    with pytest.raises(ValueError, match=saying("time_s", "pressure_MPa")):
        read_log(tmp_path / "p.csv", time_shift_s=0.0)
    backwards = "".join(f"{1.0 - 0.02 * k},{1e-4 * k}\n" for k in range(50))  # a ramp: not exchanged
    (tmp_path / "p.csv").write_text("time_s,pressure_MPa\n" + backwards)
    with pytest.raises(ValueError, match="newest first; turn their order round"):
        read_log(tmp_path / "p.csv", time_shift_s=0.0)


@pytest.mark.parametrize(("film_s", "told"), [(20.0, True), (40.0, False)])
def test_times_that_may_be_minutes_are_told(film_s: float, told: bool) -> None:
    log = Log(Path("p.csv"), np.linspace(0.0, 0.5, 100), np.zeros(100))
    with pytest.raises(ValueError, match=r"covers 0\.500 s, the film") as error:
        check_lasts(log, film_s)
    assert ("its time may be in min, as 0.5 min are 30 s" in str(error.value)) == told


STAMP = "12:31:22.{:03d} -> "
ABOVE: dict[str, str] = {
    "comments": "# logger v2, channel 1\n# 2026-01-02\ntime_s,pressure_kPa\n{rows}",
    "a header that is a comment": "# time_s,pressure_kPa\n{rows}",
    "LabVIEW": "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\t\nY_Unit_Label\tkPa\t\nX_Dimension\tTime\n***End_of_Header***\t\t\nX_Value\tPressure\tComment\n{tabs}",
    "Arduino's monitor": "12:31:22.001 -> time_s,pressure_kPa\n{stamped}",
    "words above": "Test,finger 3\nTime,12:00\n\nt [s];p [kPa]\n{semicolons}",
    "units below": "Time,Pressure\n(s),(kPa)\n{rows}",
    "elapsed": "Elapsed (s),Pressure (kPa)\n{rows}",
    "another clock beside it": "Timestamp,Elapsed time (s),Pressure (kPa)\n{dated}",
    "quoted headings": '"time_s", "pressure_kPa"\n{rows}',
    "spaces": "# time_s pressure_kPa\n{spaces}",
    "Windows-1252": "Pr\u00fcfstand;1\nZeit [s];Druck [kPa]\n{semicolons}",
}  # fmt: skip


@pytest.mark.parametrize("form", ABOVE)
def test_lines_above_and_beside_the_columns_are_passed_over(tmp_path: Path, form: str) -> None:
    plain = rows(1e3 * MPA)
    text = ABOVE[form].format(
        rows=plain, tabs=rows(1e3 * MPA, separator="\t").replace("\n", "\t\n"), semicolons=rows(1e3 * MPA, separator=";"),
        spaces=rows(1e3 * MPA, separator=" "), stamped="".join(STAMP.format(k) + row + "\n" for k, row in enumerate(plain.split())),
        dated="".join(f"2026-01-02 12:00:0{k},{row}\n" for k, row in enumerate(plain.split())),
    )  # fmt: skip
    (tmp_path / "p.csv").write_bytes(text.encode("cp1252"))
    log = read_log(tmp_path / "p.csv", time_shift_s=0.0)
    np.testing.assert_allclose(log.pressure, MPA, rtol=1e-12)
    np.testing.assert_allclose(log.time, [0, 0.02, 0.04])


@pytest.mark.parametrize(
    ("head", "tick", "unit"), [("time_us", 1e6, "kPa"), ("millis", 1e3, "kPa"), ("micros", 1e6, "N/mm2"), ("t [ms]", 1e3, "kgf/cm2"), ("Time (\u00b5s)", 1e6, "N/mm\u00b2")]
)
def test_units_of_small_loggers(tmp_path: Path, head: str, tick: float, unit: str) -> None:
    per_MPa = {"kPa": 1e3, "N/mm2": 1.0, "N/mm\u00b2": 1.0, "kgf/cm2": 10.197162129779}[unit]
    log = log_at(tmp_path, f"{head},p ({unit})\n" + "".join(f"{0.02 * k * tick:.0f},{float(p)!r}\n" for k, p in enumerate(MPA * per_MPa)))
    np.testing.assert_allclose(log.pressure, MPA, rtol=1e-9)
    np.testing.assert_allclose(log.time, [0, 0.02, 0.04])


@pytest.mark.parametrize(
    ("head", "ticks", "way"),
    [
        ("time_ms", [32500, 32750, -32536, -32286], r"jumped back by 65286 ms at line 4: it wrapped after 2\^16 ms; add 65536 ms"),
        ("time_ms", [32500, 32750, -32286, -32036], r"jumped back by 65036 ms at line 4: it wrapped after 2\^16 ms; add 65536 ms"),
        ("time_ms", [4294717, 4294955, 237.704, 487.704], r"jumped back by 4294717\.296 ms at line 4: it wrapped after 2\^32 us; add 4294967\.296 ms"),
        ("micros", [4294500000, 4294750000, 32704, 282704], r"wrapped after 2\^32 us; add 4294967296 us"),
        ("time_s", [0.0, 0.25, 0.0, 0.25], r"jumped back by 0\.25 s at line 4: it wrapped, or the logger restarted"),
    ],
)  # fmt: skip
def test_a_clock_that_jumps_back_is_never_sorted(tmp_path: Path, head: str, ticks: list[float], way: str) -> None:
    with pytest.raises(ValueError, match=way) as error:
        log_at(tmp_path, f"{head},p_kPa\n" + "".join(f"{t},{k}\n" for k, t in enumerate(ticks)).replace(",3\n", ",0\n"))
    assert "sort" not in str(error.value)


@pytest.mark.parametrize("head", ["pressure_setpoint_kPa,measured_kPa", "Pressure command [kPa],Sensor [kPa]", "p_ref [kPa],y [kPa]", "theoreticalPSI (psi),actualPSI (psi)", "p_soll [kPa],p_ist [kPa]", "desired (bar),pressure (bar)"])
def test_two_columns_that_may_be_the_pressure_are_asked_for(tmp_path: Path, head: str) -> None:
    names = head.split(",")
    text = f"time_s,{head}\n0,0,0\n1,2,1\n"
    with pytest.raises(ValueError, match=saying(*map(re.escape, names), "both of pressure", "column under")):
        log_at(tmp_path, text)
    assert names[1] in log_at(tmp_path, text, LogFormat(names[1])).source


@pytest.mark.parametrize(("name", "asked"), [("pressure_setpoint_kPa", True), ("p_soll [kPa]", True), ("Pressure target (kPa)", True), ("pressure_kPa", False), ("p reset (kPa)", False)])
def test_a_setpoint_alone_is_told(tmp_path: Path, name: str, asked: bool) -> None:
    text = f"time_s,{name}\n{rows(1e3 * MPA)}"
    assert ("asked for, not what a gauge measured" in log_at(tmp_path, text).doubt) == asked
    assert log_at(tmp_path, text, LogFormat(name)).doubt == ""  # the user has said so


def test_all_faults_of_a_header_are_said_at_once(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=saying("'time_d' has the unit 'd'", "'p' has no unit")) as error:
        log_at(tmp_path, "time_d,p\n0,0\n1,30\n")
    assert str(error.value).count(str(tmp_path)) == 1
    with pytest.raises(ValueError, match=saying("column time_s is missing", "column pressure_MPa is missing")):
        log_at(tmp_path, "a,b\n0,0\n1,30\n")


@pytest.mark.parametrize(
    ("text", "way"),
    [
        ("0.0,-8e-06\n1.5,30\n2,30\n", "no line has headings of time_s,pressure_MPa, and line 1 has numbers already: write a line"),
        ("0,0\n1,30\n2,30\n", "no line has headings of time_s,pressure_MPa, and line 1 has numbers already: write a line"),
        ("time_s,p_kPa\n0,0\n1,30\ntime_s,p_kPa\n0,0\n1,30\n", "the header stands in the lines 1, 4: the logger was started again"),
        ("time_s;p_Pa\n0;0\n1;990\n2;1,320\n3;2,640\n", "'1,320': beside whole numbers such as 990: ',' seems to stand between thousands"),
    ],
)  # fmt: skip
def test_other_forms_of_logs_are_refused(tmp_path: Path, text: str, way: str) -> None:
    with pytest.raises(ValueError, match=way):
        log_at(tmp_path, text)


def test_a_slow_log_has_a_noise_from_all_rest_before_the_onset() -> None:
    rng, time = np.random.default_rng(1), np.arange(0.0, 40.0, 0.1)
    log = Log(Path("p.csv"), time, 0.03 * np.interp(time, [2, 3, 5, 6, 25, 26], [0, 1, 1, 0, 0, 1]) + 2e-5 * rng.standard_normal(len(time)))
    start, end = all_rest(log, 20.0, 21.8)
    assert (start, end) == (pytest.approx(6.0, abs=0.2), pytest.approx(25.0, abs=0.2))
    noise = gauge_noise(log, start=start, end=end)
    assert noise.sd_MPa == pytest.approx(2e-5, rel=0.15)  # 190 samples: 5 %
    assert noise.samples >= 180
    assert all_rest(log, 8.0, 24.0) == (8.0, 24.0)  # enough: as stated


SPELLED = {
    "t [s]": 1.0, "t (sec)": 1.0, "Elapsed (seconds)": 1.0, "time_ms": 1e-3, "millis": 1e-3, "t [msec]": 1e-3,
    "t [milliseconds]": 1e-3, "time_us": 1e-6, "micros": 1e-6, "t [usec]": 1e-6, "t [\u00b5s]": 1e-6, "t [\u03bcs]": 1e-6,
    "t (microseconds)": 1e-6, "t [min]": 60.0, "t (minutes)": 60.0,
}  # fmt: skip
PRESSURES = {"p [psig]": 0.00689476, "p [barg]": 0.1, "p [kPag]": 1e-3, "p [kgf/cm2]": 0.0980665, "p [N/mm2]": 1.0}


@pytest.mark.parametrize("head", SPELLED)
def test_a_unit_of_time_has_many_spellings(tmp_path: Path, head: str) -> None:
    (tmp_path / "log.csv").write_text(f"{head},p [kPa]\n0,0\n7,20\n", encoding="utf-8")
    assert read_log(tmp_path / "log.csv", time_shift_s=0.0).time[-1] == pytest.approx(7.0 * SPELLED[head])


@pytest.mark.parametrize("head", PRESSURES)
def test_a_unit_of_pressure_has_many_spellings(tmp_path: Path, head: str) -> None:
    (tmp_path / "log.csv").write_text(f"time_s,{head}\n0,0\n7,0.3\n", encoding="utf-8")
    assert read_log(tmp_path / "log.csv", time_shift_s=0.0).pressure[-1] == pytest.approx(0.3 * PRESSURES[head], rel=1e-5)
