"""The command ringing: frequency and damping of what rings in films and files, beside the model's."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from typer import Argument, Option

from twin import files
from twin.formats.motionfile import read_motion
from twin.formats.takes import PRESSURE, pressure_in
from twin.messages import Say
from twin.project.folder import Project
from twin.records import Maybe, Record
from twin.ringing.exposure import Exposure, longest
from twin.ringing.freevibration import Ringing, ringings
from twin.table import DataTable
from twin.tablemodel import Finite
from twin.targets import Targets

HELD = 0.05  # of the pressure's range, by which it may change while something rings freely
SAME_MPa = 1e-4  # pressures nearer to each other have one model


class RingingRow(Record):
    """One ringing."""

    where: str = Field(description="the file, or the film")
    start_s: Finite
    pressure_MPa: Maybe = Field(description="held meanwhile; null where that is not known")
    frequency_Hz: Finite
    frequency_sd_Hz: Finite
    frequency_Hz_per_mm: Maybe = Field(description="its slope by the amplitude; null: too short")
    damping_ratio: Finite
    damping_sd: Finite
    damping_per_mm: Maybe
    amplitude_mm: Finite = Field(description="of the point that moves most; the mean, for which they hold")
    first_mm: Finite = Field(description="its largest amplitude")
    smear_mm: Maybe = Field(description="largest motion during an exposure; null: none is stated")
    shrink: Maybe = Field(description="share of the amplitude that the exposure takes")
    skew_mm: Maybe = Field(description="largest motion while the rows are read; null: no rolling shutter")
    doubt: str
    model_Hz: Maybe = Field(description="foretold by the calibrated model; null: not asked or not known")
    model_low_Hz: Maybe = Field(description="95 % interval of that by the fit")
    model_high_Hz: Maybe
    model_moves: str


class RingingsRecord(Record):
    """What rings in films or files."""

    file: ClassVar[str] = "ringing.json"
    ringings: tuple[RingingRow, ...] = Field(description="a row a ringing")
    note: str = Field(default="", description="what limits that")


@dataclass(frozen=True)
class _Found:
    """A ringing, where it is, and the pressure in MPa that is held, NaN where it is not known."""

    where: str
    ringing: Ringing
    pressure: float

    @property
    def level(self) -> int | None:
        """The pressure in steps of SAME_MPa; None where it is not known."""
        return round(self.pressure / SAME_MPa) if np.isfinite(self.pressure) else None


@dataclass(frozen=True)
class _Foretold:
    """The model's slowest vibration up and down: Hz, its 95 % interval where the fit has one, what moves."""

    frequency: float | None = None
    low: float | None = None
    high: float | None = None
    moves: str = ""


NO_MODEL = _Foretold()


def run_ringing(
    project: Project | None,
    say: Say,
    recordings: Annotated[Sequence[Path], Argument(
        metavar="[FILES]", help="csv or c3d files of markers; without them the project's film")] = (),
    *,
    fps: Annotated[float, Option(help="frames in a second, where a file has no times")] = 0.0,
    base: Annotated[str, Option(
        help="markers on the base of a file, such as m1,m2,m3; by default those that hardly move")] = "",
    exposure_ms: Annotated[float, Option(help="exposure of a frame")] = 0.0,
    readout_ms: Annotated[float, Option(help="rolling shutter: from a frame's first row to the last")] = 0.0,
    px_per_mm: Annotated[float, Option(help="pixels a mm, for files in pixels")] = 0.0,
    beside: Annotated[str, Option(
        help="project whose model foretells the frequency at the pressure in each file's name")] = "",
    density: Annotated[float, Option(help="of its silicone in kg/m3, where twin.toml has none")] = 0.0,
) -> dict[str, Any]:
    """Frequency and damping of each ringing after a release or a fast step, beside the calibrated model's.

    project: None where files are given. ValueError for files that cannot be read, and for a project without
    targets.
    """
    exposure = _exposure(exposure_ms, readout_ms, px_per_mm)
    if recordings or project is None:
        of = Project.open(Path(beside)) if beside else None
        names = [name for name in base.split(",") if name]
        found = [one for path in recordings for one in _in_file(path, fps, names, px_per_mm)]
        remarks = [] if found else ["Nothing rings: no part swings for four periods after a fast motion."]
        record = _record(found, of, exposure, density, remarks)
        _tell(record, px_per_mm, say)
        return {"stage": "ringing"} | files.plain(record)
    for option, typed in (("--fps", fps), ("--base", base), ("--beside", beside)):
        if typed:
            raise ValueError(f"{option} {typed}: is for files; name them, or leave it out")
    inputs = [project.targets_folder, *project.deck_files()]
    with project.new_run("ringing", inputs=inputs, extra={"density": density}) as run:
        found, remarks = in_targets(project.targets(), [film.name for film in project.config.films])
        record = _record(found, project, exposure, density, remarks)
        run.write(record)
        run.write_text("ringing.csv", _csv(found))
        run.summary["headline"] = _headline(record)
    _tell(record, px_per_mm, say)
    say(f"Wrote {project.shown(run.folder)}/ringing.json and ringing.csv")
    return {"stage": "ringing", "run": run.name} | files.plain(record)


def _exposure(exposure_ms: float, readout_ms: float, px_per_mm: float) -> Exposure:
    """The exposure. ValueError for what is none."""
    for option, typed, most in (("--exposure-ms", exposure_ms, 1000), ("--readout-ms", readout_ms, 1000),
                                ("--px-per-mm", px_per_mm, 1e4)):  # fmt: skip
        if not 0 <= typed <= most:
            raise ValueError(f"{option} {typed:g}: wanted a number from 0 to {most:g}")
    return Exposure(1e-3 * exposure_ms, 1e-3 * readout_ms)


def _in_file(path: Path, fps: float, base: Sequence[str], px_per_mm: float) -> Iterator[_Found]:
    """The ringings of a file, the pressure that its name states or that it has."""
    moved = read_motion(path, fps=fps, base=base, scale=1 / px_per_mm if px_per_mm else 0.0)
    named = pressure_in(path.name) if len(PRESSURE.findall(path.stem)) == 1 else np.nan
    for one in ringings(moved.time, moved.position):
        pressure = named
        if moved.pressure is not None:
            pressure = float(np.median(moved.pressure[(one.start <= moved.time) & (moved.time <= one.end)]))
        yield _Found(moved.file, one, pressure)


def in_targets(targets: Targets, films: Sequence[str]) -> tuple[list[_Found], list[str]]:
    """The ringings of the finger's points while the pressure is held, film by film, and remarks."""
    out, driven, short = [], 0, 0
    fingers = ~targets.fixed
    for block in range(int(targets.block[-1]) + 1):
        rows = targets.block == block
        value = np.where(targets.valid, targets.value, np.nan)[rows][:, fingers]
        try:
            found = ringings(targets.time[rows], value)
        except ValueError:
            short += 1
            continue
        for one in found:
            inside = (targets.log_time >= one.start) & (targets.log_time <= one.end)
            ends = np.interp([one.start, one.end], targets.log_time, targets.log_pressure)
            held = np.append(targets.log_pressure[inside], ends)
            if np.ptp(held) > HELD * np.ptp(targets.log_pressure):
                driven += 1
                continue
            name = films[block] if block < len(films) else f"film {block + 1}"
            out.append(_Found(name, one, float(np.median(held))))
    remarks = []
    if not out:
        remarks.append("Nothing rings: nothing swings for four periods while the pressure is held.")
    if driven:
        remarks.append(f"{driven} swings are left out, as the pressure moves with them.")
    if short:
        remarks.append(f"{short} recordings are too short to ring.")
    return out, remarks


def _record(
    found: Sequence[_Found], project: Project | None, exposure: Exposure, density: float,
    remarks: Sequence[str],
) -> RingingsRecord:  # fmt: skip
    """The record, with what the project's calibrated model foretells where there is one."""
    beside: Mapping[int, _Foretold] = {}
    notes = list(remarks)
    if found and project is not None:
        try:
            beside = _foretold(project, sorted({f.level for f in found if f.level is not None}), density)
        except ValueError as error:
            notes.append(f"No model beside it: {error}.")
    return RingingsRecord(ringings=tuple(_row(f, exposure, beside) for f in found), note=" ".join(notes))


def _foretold(project: Project, levels: Sequence[int], density: float) -> dict[int, _Foretold]:
    """What the calibrated model foretells, by pressure in steps of SAME_MPa."""
    from twin.bench.engines import check_embedded
    from twin.bench.fits import fit_file
    from twin.bench.workbench import Workbench
    from twin.calibrated.naturalvibrations import UP, WantedVibrations, check_density, vibrations
    from twin.calibrated.predictions import NORMAL
    from twin.judging.fitrecord import FitRecord

    if not levels:
        raise ValueError("the pressure is not known: wanted it in the files' names, such as arm_200mbar.csv")
    check_embedded(project, "twin ringing beside the model")
    file, bench = fit_file(project), Workbench.of(project)
    fit = files.read(FitRecord, file)
    check_density(bench, fit, density or None)
    asked = WantedVibrations(tuple(SAME_MPa * k for k in levels), 2, 0.0, density or None)
    out = {}
    for level, one in zip(levels, vibrations(bench, fit, asked), strict=True):
        k = one.moves.index(UP) if UP in one.moves else 0
        f, half = float(one.found.frequency[k]), None if one.sd is None else NORMAL * float(one.sd[k])
        low, high = (None, None) if half is None else (max(f - half, 0.0), f + half)
        out[level] = _Foretold(f, low, high, one.moves[k])
    return out


def _row(found: _Found, exposure: Exposure, beside: Mapping[int, _Foretold]) -> RingingRow:
    one, hz = found.ringing, found.ringing.frequency
    model = NO_MODEL if found.level is None else beside.get(found.level, NO_MODEL)
    return RingingRow(
        where=found.where, start_s=one.start, pressure_MPa=found.pressure,
        frequency_Hz=hz, frequency_sd_Hz=one.frequency_sd, frequency_Hz_per_mm=one.frequency_slope,
        damping_ratio=one.damping, damping_sd=one.damping_sd, damping_per_mm=one.damping_slope,
        amplitude_mm=one.amplitude, first_mm=one.first,
        smear_mm=exposure.smear(hz, one.first) if exposure.seconds else None,
        shrink=exposure.shrink(hz) if exposure.seconds else None,
        skew_mm=exposure.skew(hz, one.first) if exposure.readout else None, doubt=one.doubt,
        model_Hz=model.frequency, model_low_Hz=model.low, model_high_Hz=model.high, model_moves=model.moves,
    )  # fmt: skip


def _csv(found: Sequence[_Found]) -> str:
    """A row for each piece of two periods of each ringing."""
    columns = ("where", "start_s", "pressure_MPa", "time_s", "amplitude_mm", "frequency_Hz",
               "frequency_sd_Hz", "damping_ratio", "damping_sd", "rest_mm")  # fmt: skip
    rows = [(f.where, f.ringing.start, f.pressure, p.time, p.largest, p.frequency, p.sd[0], p.damping,
             p.sd[1], p.rms) for f in found for p in f.ringing.pieces]  # fmt: skip
    return DataTable(columns, rows).csv(digits=6)


def _headline(record: RingingsRecord) -> str:
    """The first ringing in one line, and how many there are."""
    if not record.ringings:
        return "nothing rings"
    first, more = record.ringings[0], len(record.ringings) - 1
    others = f"; {more} more" if more else ""
    return f"{first.frequency_Hz:.3g} Hz, damping ratio {first.damping_ratio:.2g}{others}"


def _tell(record: RingingsRecord, px_per_mm: float, say: Say) -> None:
    """Say the table, then what the frames take from it, what is doubtful, and how the model compares."""
    rows = record.ringings
    if rows:
        for line in DataTable(HEADINGS, [_cells(row) for row in rows]).lines("<>"):
            say(line)
    for sentence in (*_sentences(rows, px_per_mm), *filter(None, [record.note])):
        say(sentence)


HEADINGS = ("", "from s", "kPa", "Hz", "sd", "damping", "sd", "at mm", "Hz a mm", "model Hz", "95 %")


def _cells(row: RingingRow) -> tuple[str, ...]:
    def text(value: float | None, form: str) -> str:
        return "–" if value is None else f"{value:{form}}"

    low, high = row.model_low_Hz, row.model_high_Hz
    kPa = None if row.pressure_MPa is None else 1e3 * row.pressure_MPa
    return (
        row.where, f"{row.start_s:.2f}", text(kPa, ".4g"), f"{row.frequency_Hz:.3f}",
        f"{row.frequency_sd_Hz:.3f}", f"{row.damping_ratio:.3f}", f"{row.damping_sd:.3f}",
        f"{row.amplitude_mm:.2f}", text(row.frequency_Hz_per_mm, "+.2f"), text(row.model_Hz, ".3g"),
        "–" if low is None or high is None else f"{low:.3g} to {high:.3g}",
    )  # fmt: skip


def _sentences(rows: Sequence[RingingRow], px_per_mm: float) -> Iterator[str]:
    if not rows:
        return
    fastest = max(row.frequency_Hz for row in rows)
    smears = [row.smear_mm for row in rows if row.smear_mm is not None]
    if smears:
        shrink = max(row.shrink for row in rows if row.shrink is not None)
        most = _length(max(smears), px_per_mm)
        yield (f"During an exposure a marker moves by up to {most}; amplitudes are {100 * shrink:.2g} % too "
               "small at most, frequency and damping as they were.")  # fmt: skip
    else:
        yield (f"An exposure of up to {1e3 * longest(fastest):.2g} ms takes 1 % of the amplitudes at most; "
               "--exposure-ms says what yours takes.")  # fmt: skip
    if skews := [row.skew_mm for row in rows if row.skew_mm is not None]:
        yield (f"While the rows are read a marker moves by up to {_length(max(skews), px_per_mm)}; "
               "readout_ms under [[cameras]] lets twin measure take that into account.")  # fmt: skip
    yield from dict.fromkeys(f"{row.where}: {row.doubt}." for row in rows if row.doubt)
    told = [row for row in rows if row.model_Hz is not None]
    if told:
        apart = [100 * (row.model_Hz / row.frequency_Hz * (1 - row.damping_ratio**2) ** 0.5 - 1)
                 for row in told if row.model_Hz is not None]  # fmt: skip
        spans = [(row.model_low_Hz, row.frequency_Hz, row.model_high_Hz) for row in told]
        inside = [low <= f <= high for low, f, high in spans if low is not None and high is not None]
        held = f"; {sum(inside)} of {len(inside)} lie in its intervals" if inside else ""
        yield f"The model's frequencies lie {min(apart):+.1f} to {max(apart):+.1f} % off the measured{held}."


def _length(mm: float, px_per_mm: float) -> str:
    return f"{mm:.2g} mm" + (f", {mm * px_per_mm:.2g} px" if px_per_mm else "")
