"""The command predict: what the calibrated finger does under a pressure that nobody has measured."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from typer import Option

from fe.element import triangles
from twin import files
from twin.bench.engines import check_embedded
from twin.bench.fits import fit_file
from twin.bench.workbench import Workbench
from twin.calibrated.blockedforce import Blocked, blocked_force
from twin.calibrated.inverse import Inverse, Wanted, pressure_for
from twin.calibrated.objectforce import beside, rising, touched
from twin.calibrated.positions import asked
from twin.calibrated.predictions import NORMAL, Prediction, WantedCourse, predicted, pressure_of
from twin.commands.predictchambers import filling_notes, shares_of_words
from twin.commands.predictobject import (
    PredictedContact,
    contact_csv,
    contact_picture,
    contact_rows,
    pushed,
    told,
)
from twin.drawing.deformed import write_vtu_series
from twin.drawing.uncertaintyplots import draw_prediction
from twin.effects.loads import Gravity
from twin.effects.protocol import Order
from twin.gauge.pressurelog import read_log
from twin.gravity import is_heavy
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.model.objects import RigidObject
from twin.project.folder import Project, Run
from twin.records import Maybe, Record
from twin.review.finger import write_shapes
from twin.tablemodel import Finite
from twin.targets import Array

MOST = 200  # times of a course that are predicted
AXES = ("U1", "U2", "U3")
FASTER, LONGER = 1.5, 1.5  # than the film: what is told
TURNED = 0.985  # cosine of 10 degrees between two orientations
SHAPES = 50  # deformed fingers that are written
WINDOW = 0.2  # s, over which a rate of pressure is taken: a gauge's noise is small in it


class PredictedPoint(Record):
    """A point at one time, relative to the finger at rest."""

    point: str
    time_s: Finite
    pressure_MPa: Finite
    u_mm: tuple[Finite, Finite, Finite] = Field(description="U1, U2, U3")
    low_mm: tuple[Maybe, Maybe, Maybe] = Field(description="95 % interval; null where the fit has none")
    high_mm: tuple[Maybe, Maybe, Maybe]
    beyond: bool = Field(description="above the pressure that was tested")


class PredictedAngle(Record):
    """The turn of the end face about y at one time."""

    time_s: Finite
    pressure_MPa: Finite
    degrees: Finite
    low: Maybe = Field(description="95 % interval; null where the fit has none")
    high: Maybe


class PredictedPressure(Record):
    """The held pressure that gives a wanted displacement."""

    wanted: str = Field(description="as it was asked for, such as tip.U3=-40")
    pressure_MPa: Finite
    low_MPa: Maybe = Field(description="95 % interval; null where the fit has none")
    high_MPa: Maybe


class PredictedForce(Record):
    """The force upwards on the end face that keeps its middle at its height."""

    pressure_MPa: Finite
    force_N: Finite
    low_N: Maybe = Field(description="95 % interval; null where the fit has none")
    high_N: Maybe
    beyond: bool = Field(description="above the pressure that was tested")


class PredictionRecord(Record):
    """What the model predicts."""

    file: ClassVar[str] = "predicted.json"
    points: tuple[PredictedPoint, ...] = Field(description="a row a point and time")
    angles: tuple[PredictedAngle, ...] = Field(description="a row a time")
    tested_MPa: Finite = Field(description="highest pressure of the film")
    inverse: tuple[PredictedPressure, ...] = Field(default=(), description="a row a wanted displacement")
    blocked: tuple[PredictedForce, ...] = Field(default=(), description="a row a pressure")
    object: str = Field(default="", description="what the finger meets, as it was asked for")
    contact: tuple[PredictedContact, ...] = Field(default=(), description="a row a time beside the object")
    note: str = Field(default="", description="why there are no intervals, and what was not tested")


def run_predict(
    project: Project,
    say: Say,
    pressure: Annotated[Sequence[str], Option(
        help="pressure that is held, such as 20kPa; once for each")] = (),
    *,
    course: Annotated[Path | None, Option(help="pressure log to follow instead, CSV")] = None,
    inverse: Annotated[Sequence[str], Option(help="the pressure that gives a motion, tip.U3=-40 mm")] = (),
    at: Annotated[Sequence[str], Option(help="a point, x=60, or x,y,z in mm; once for each")] = (),
    ramp_s: Annotated[float, Option(help="time in which a held pressure is reached, s")] = 2.0,
    hold_s: Annotated[float, Option(help="time for which it is held, s")] = 2.0,
    gravity: Annotated[str, Option(help="its direction X,Y,Z, if other than in the film")] = "",
    shares: Annotated[Sequence[str], Option(
        help="of several chambers, what of the pressure one carries, LEFT=1.0")] = (),
    blocked: Annotated[bool, Option(
        "--blocked", help="also the force of the finger whose end is kept at its height")] = False,
    object: Annotated[str, Option(  # noqa: A002 - as it is typed
        help="also the force on a rigid object: cylinder:d=40,x=70,z=-30 (mm)")] = "",
) -> dict[str, Any]:
    """Displacements of points and the turn of the tip, each with its 95 % interval, under held pressures or
    along the course of a log; or at the pressures that give wanted displacements."""
    if object and inverse:
        raise ValueError("--object: wanted --pressure or --course beside it, not --inverse")
    asked_for = "" if inverse else object or project.config.model.object or ""
    thing = RigidObject.of(asked_for) if asked_for else None
    wanted = [Wanted.of(text) for text in inverse]
    courses = _courses(pressure, course, ramp_s, hold_s, wanted)
    if blocked and not pressure:
        raise ValueError("--blocked: wanted a pressure beside it, such as --pressure 20kPa")
    check_embedded(project, "twin predict")
    bench = Workbench.of(project)
    way = _gravity(bench, gravity)
    carried = shares_of_words(bench.targets, shares)
    courses = [replace(one, gravity=way, shares=carried) for one in courses]
    held = partial(WantedCourse.held, ramp_s=ramp_s, hold_s=hold_s, gravity=way, shares=carried)
    if thing is not None:
        beside(bench.model(), courses[0], thing)  # refuses before anything is solved
    record = files.read(FitRecord, fit_file(project))
    places = asked(bench, [*at, *(one.point for one in wanted)])
    tested = float(bench.targets.log_pressure.max())
    inputs = [project.targets_folder, *project.deck_files(), *([course] if course else [])]
    extra = {
        "pressure": list(pressure), "inverse": list(inverse), "at": list(at), "ramp_s": ramp_s,
        "hold_s": hold_s, "gravity": gravity, "blocked": blocked, "object": object, "shares": list(shares),
    }  # fmt: skip
    with project.new_run("predict", inputs=inputs, extra=extra) as run:
        say.progress("predict", 0, 1)
        inverted = [
            pressure_for(bench, record, one, places, say, held) for one in wanted
        ]
        if wanted:
            found, courses = [one.prediction for one in inverted], [one.course for one in inverted]
        else:
            found = predicted(bench, record, courses, places, say)
        forces = [blocked_force(bench, record, one, say) for one in courses] if blocked else []
        meets = [touched(bench, record, rising(one), thing, say) for one in courses] if thing else []
        made = PredictionRecord(
            points=tuple(row for one in found for row in _rows(one)),
            angles=tuple(row for one in found for row in _angles(one)),
            tested_MPa=tested,
            inverse=tuple(_pressure_row(one) for one in inverted),
            blocked=tuple(map(_force_row, forces)),
            object=asked_for,
            contact=tuple(row for one in meets for row in contact_rows(one)),
            note=" ".join(_notes(bench, courses, found)),
        )
        run.write(made)
        if thing is not None:
            run.write_text("contact.csv", contact_csv(made.contact))
            run.write_bytes("contact.png", contact_picture(bench, meets, thing))
        run.write_text("predicted.csv", _csv(made))
        run.write_bytes("predicted.png", _picture(found))
        _write_shapes(run, bench, found)
        run.summary["headline"] = _headline(made)
    for row in made.inverse:
        say(f"{row.wanted} mm at {_in_kPa(row)}.")
    for line in _table(made) if course is None else [_headline(made)]:
        say(line)
    for force in made.blocked:
        say(f"{1e3 * force.pressure_MPa:.4g} kPa: the end, kept at its height, presses with "
            f"{_in_N(force)}.")  # fmt: skip
    if thing is not None:
        for line in [*(pushed(one, thing) for one in meets), told(asked_for == project.config.model.object)]:
            say(line)
    if made.note:
        say(made.note)
    say(f"Wrote {project.shown(run.folder)}/predicted.csv, predicted.json and predicted.png; the shapes: "
        f"predicted.pvd for ParaView, and `rerun {run.path('predicted.rrd')}`")  # fmt: skip
    return {"stage": "predict", "run": run.name} | files.plain(made)


def _courses(
    pressure: Sequence[str], course: Path | None, ramp_s: float, hold_s: float, wanted: Sequence[Wanted]
) -> list[WantedCourse]:
    """What is to be predicted, but for what is wanted. ValueError where not one way of asking is taken."""
    ways = [bool(pressure), course is not None, bool(wanted)]
    if sum(ways) != 1:
        raise ValueError(
            "wanted one of --pressure, such as --pressure 20kPa, once for each, --course with a pressure "
            f"log, and --inverse, such as --inverse tip.U3=-40; {sum(ways) or 'none'} of them are given"
        )
    check_times(ramp_s, hold_s)
    if course is not None:
        log = read_log(course, time_shift_s=0.0)
        return [WantedCourse.logged(log.time, log.pressure, most=MOST)]
    return [WantedCourse.held(pressure_of(text), ramp_s=ramp_s, hold_s=hold_s) for text in pressure]


def _gravity(bench: Workbench, text: str) -> Array | None:
    """The direction (3,) of gravity that is asked for, None where none is. ValueError where it is none, or
    the model has no weight."""
    if not text:
        return None
    try:
        way = np.array([float(word) for word in text.split(",")])
    except ValueError:
        way = np.zeros(0)
    if way.shape != (3,) or not np.isfinite(way).all() or not way.any():
        raise ValueError(
            f"--gravity {text!r}: wanted its direction X,Y,Z in world axes, such as 0,0,-1 (x along the "
            "finger, z up)"
        )
    weighs = is_heavy(bench.case) or any(e.name == Gravity.name for e in bench.model().effects)
    if bench.targets.gravity is None or not weighs:
        raise ValueError(
            f"--gravity {text}: the model has no weight; give density_kg_m3 and gravity under [model] in "
            "twin.toml, and run `twin calibrate`"
        )
    return np.asarray(way / np.linalg.norm(way))


def check_times(ramp_s: float, hold_s: float) -> None:
    """ValueError where a held pressure is not reached, or not held, in some time."""
    for name, value in (("--ramp-s", ramp_s), ("--hold-s", hold_s)):
        if not 0 < value < 1e5:
            raise ValueError(f"{name} {value:g}: wanted a time in s, above 0")


def _picture(found: Sequence[Prediction]) -> bytes:
    """Over pressure where several states are held, over time where a course is followed."""
    held = all(len(one.time) == 1 for one in found)
    some = sorted(found, key=lambda one: float(one.pressure[0])) if held else found
    u, half = np.concatenate([one.u for one in some]), NORMAL * np.concatenate([one.sd for one in some])
    pressure = np.concatenate([one.pressure for one in some])
    return draw_prediction(
        1e3 * pressure if held else found[0].time, u, None if found[0].why else half, names=found[0].names,
        label="pressure, kPa" if held else "time, s", beyond=np.concatenate([one.beyond for one in some]),
    )  # fmt: skip


def _write_shapes(run: Run, bench: Workbench, found: Sequence[Prediction]) -> None:
    """The deformed finger at SHAPES of what is predicted, for ParaView and rerun."""
    u, pressure, time = (np.concatenate([getattr(one, key) for one in found])
                         for key in ("shape", "pressure", "time"))  # fmt: skip
    held = all(len(one.time) == 1 for one in found)
    rows = np.argsort(pressure, kind="stable") if held else np.arange(len(u))
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(SHAPES, len(rows))).round().astype(int))]
    nodes, own = bench.case.nodes, triangles(bench.structure.outside)
    write_vtu_series(
        run.folder, "predicted", nodes=nodes, cells=bench.case.connectivity,
        times=list(1e3 * pressure[rows] if held else time[rows]), fields={"U": u[rows]},
    )  # fmt: skip
    write_shapes(
        run.path("predicted.rrd"), nodes=nodes, triangles=own, u=u[rows], pressure=pressure[rows],
        time=time[rows], held=held,
    )  # fmt: skip


def _force_row(one: Blocked) -> PredictedForce:
    low, high = one.interval or (None, None)
    return PredictedForce(
        pressure_MPa=one.pressure, force_N=one.force, low_N=low, high_N=high, beyond=one.beyond
    )


def _in_N(row: PredictedForce) -> str:
    if row.low_N is None or row.high_N is None:
        return f"{row.force_N:.3g} N"
    return f"{row.force_N:.3g} N (95 %: {row.low_N:.3g} to {row.high_N:.3g})"


def _pressure_row(one: Inverse) -> PredictedPressure:
    low, high = one.interval or (None, None)
    return PredictedPressure(
        wanted=one.wanted.words, pressure_MPa=one.pressure, low_MPa=low, high_MPa=high
    )


def _in_kPa(row: PredictedPressure) -> str:
    told = f"{1e3 * row.pressure_MPa:.4g} kPa"
    if row.low_MPa is None or row.high_MPa is None:
        return told
    return f"{told} (95 %: {1e3 * row.low_MPa:.4g} to {1e3 * row.high_MPa:.4g})"


def _rows(one: Prediction) -> list[PredictedPoint]:
    half = NORMAL * one.sd
    return [
        PredictedPoint(
            point=name, time_s=t, pressure_MPa=p, u_mm=tuple(one.u[s, k]),
            low_mm=(None,) * 3 if one.why else tuple(one.u[s, k] - half[s, k]),
            high_mm=(None,) * 3 if one.why else tuple(one.u[s, k] + half[s, k]),
            beyond=bool(one.beyond[s]),
        )
        for s, (t, p) in enumerate(zip(one.time, one.pressure, strict=True))
        for k, name in enumerate(one.names)
    ]  # fmt: skip


def _angles(one: Prediction) -> list[PredictedAngle]:
    half = NORMAL * one.angle_sd
    return [
        PredictedAngle(
            time_s=t, pressure_MPa=p, degrees=a,
            low=None if one.why else a - h, high=None if one.why else a + h,
        )
        for t, p, a, h in zip(one.time, one.pressure, one.angle, half, strict=True)
    ]  # fmt: skip


def _notes(bench: Workbench, courses: Sequence[WantedCourse], found: Sequence[Prediction]) -> list[str]:
    """Why there are no intervals, what was not tested, and what the displacements are seen with."""
    out, t = [], bench.targets
    tested, asked_for = float(t.log_pressure.max()), max(float(one.pressure.max()) for one in courses)
    if found[0].why:
        out.append(f"No intervals: {found[0].why}.")
    if any(one.beyond.any() for one in found):
        out.append(
            f"{1e3 * asked_for:.4g} kPa is beyond the {1e3 * tested:.4g} kPa that were tested: nobody has "
            "seen the silicone's law there. The intervals there include a stiffening that the film could not "
            "show, but no contact and no buckling."
        )
    out += filling_notes(t, courses[0].shares, asked_for)
    fast, faster = _rate(t.log_time, t.log_pressure), max(_rate(one.time, one.pressure) for one in courses)
    if faster > FASTER * fast:
        out.append(
            f"The pressure changes by up to {1e3 * faster:.3g} kPa/s, in the film by {1e3 * fast:.3g} kPa/s "
            "at most: what depends on the rate was not tested there."
        )
    lasts = max(float(np.ptp(t.time[t.block == b])) for b in np.unique(t.block))
    longer = max(float(np.ptp(one.time)) for one in courses)
    if longer > LONGER * lasts:
        out.append(
            f"It lasts {longer:.3g} s, the film {lasts:.3g} s: slower creep than the film's was not tested."
        )
    way = courses[0].gravity
    if way is not None and t.gravity is not None and float((t.gravity @ way).max()) < TURNED:
        out.append("The finger was not filmed in this orientation: its density alone tells how much it sags.")
    seen = [e.label for e in bench.model().effects if e.order >= Order.GAUGE_GAIN]
    if seen:
        out.append(f"The displacements are as this rig would show them: the model has {', '.join(seen)}.")
    return out


def _rate(time: Array, pressure: Array) -> float:
    """The fastest change of pressure in MPa/s, over WINDOW s."""
    grid = np.arange(time[0], max(time[-1] - WINDOW, time[0]) + 1e-9, WINDOW / 4)
    ahead, here = (np.interp(grid + by, time, pressure) for by in (WINDOW, 0.0))
    return float(np.abs(ahead - here).max()) / WINDOW


def _headline(made: PredictionRecord) -> str:
    top = max(made.points, key=lambda row: row.pressure_MPa)
    rows = [row for row in made.points if row.pressure_MPa == top.pressure_MPa and row.time_s == top.time_s]
    told = "; ".join(f"{row.point} {_cell(row, 2)} mm in U3" for row in rows)
    return f"At {1e3 * top.pressure_MPa:.4g} kPa: {told}."


def _cell(row: PredictedPoint, axis: int) -> str:
    low, high = row.low_mm[axis], row.high_mm[axis]
    half = "" if low is None or high is None else f" +- {(high - low) / 2:.2f}"
    return f"{row.u_mm[axis] + 0.0:.2f}{half}"


def _table(made: PredictionRecord) -> list[str]:
    """A line a pressure and point, the angle of the tip at the end; +- is half of the 95 % interval."""
    wide = max(len(row.point) for row in made.points)
    heads = "".join(f"{f'{axis}, mm':>18}" for axis in AXES)
    lines = [f"{'pressure':>10}  {'':<{wide}}{heads}   (+-: 95 %)"]
    for angle in made.angles:
        rows = [r for r in made.points if (r.pressure_MPa, r.time_s) == (angle.pressure_MPa, angle.time_s)]
        for row in rows:
            cells = "".join(f"{_cell(row, axis):>18}" for axis in range(3))
            lines.append(f"{1e3 * row.pressure_MPa:>6.4g} kPa  {row.point:<{wide}}{cells}")
        half = "" if angle.low is None or angle.high is None else f" +- {(angle.high - angle.low) / 2:.1f}"
        turn = f"the tip turns by {angle.degrees:.1f}{half} degrees"
        lines.append(f"{1e3 * angle.pressure_MPa:>6.4g} kPa  {turn}")
    return list(dict.fromkeys(lines))


def _csv(made: PredictionRecord) -> str:
    heads = ",".join(f"{u}_mm,{u}_low_mm,{u}_high_mm" for u in ("u1", "u2", "u3"))
    lines = [f"time_s,pressure_MPa,point,{heads},beyond"]
    for row in made.points:
        cells = [row.u_mm, row.low_mm, row.high_mm]
        numbers = ["" if cell[k] is None else f"{cell[k]:.6g}" for k in range(3) for cell in cells]
        begin = [f"{row.time_s:.6g}", f"{row.pressure_MPa:.6g}", row.point.replace(",", " ")]
        lines.append(",".join([*begin, *numbers, str(row.beyond).lower()]))
    return "\n".join(lines) + "\n"
