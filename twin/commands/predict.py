"""The command predict: what the calibrated finger does under a pressure that nobody has measured."""

from collections.abc import Iterator, Sequence
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
from twin.commands.predictfast import (
    PredictedInertia,
    check_options,
    or_statics,
    swing_of_course,
    swung,
    told_swing,
)
from twin.commands.predictobject import (
    PredictedContact,
    PredictedForce,
    contact_csv,
    contact_picture,
    contact_rows,
    in_N,
    pushed,
    told,
)
from twin.commands.predictweights import loads_of_words, weight_notes
from twin.drawing.deformed import write_vtu_series
from twin.drawing.uncertaintyplots import draw_prediction
from twin.effects.loads import Gravity
from twin.effects.protocol import Order
from twin.gauge.logcolumns import LogFormat
from twin.gauge.pressurelog import read_log
from twin.gravity import is_heavy
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.model.objects import RigidObject
from twin.project.folder import Project, Run
from twin.records import Maybe, Record
from twin.review.finger import write_shapes
from twin.table import DataTable
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
    static_mm: tuple[Finite, Finite, Finite] | None = Field(
        default=None, description="without inertia; null where it is left out"
    )


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


class PredictionRecord(Record):
    """A prediction of the model."""

    file: ClassVar[str] = "predicted.json"
    points: tuple[PredictedPoint, ...] = Field(description="a row a point and time")
    angles: tuple[PredictedAngle, ...] = Field(description="a row a time")
    tested_MPa: Finite = Field(description="highest pressure of the film")
    inverse: tuple[PredictedPressure, ...] = Field(default=(), description="a row a wanted displacement")
    blocked: tuple[PredictedForce, ...] = Field(default=(), description="a row a pressure")
    object: str = Field(default="", description="what the finger meets, as it was asked for")
    contact: tuple[PredictedContact, ...] = Field(default=(), description="a row a time beside the object")
    inertia: PredictedInertia | None = Field(
        default=None, description="of a fast course; null: every state is an equilibrium"
    )
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
    ramp_s: Annotated[float, Option(help="s until a held pressure is reached")] = 2.0,
    hold_s: Annotated[float, Option(help="time for which it is held, s")] = 2.0,
    gravity: Annotated[str, Option(help="its direction X,Y,Z, if other than in the film")] = "",
    shares: Annotated[Sequence[str], Option(
        help="part of the pressure that a chamber carries, LEFT=1")] = (),
    weight: Annotated[Sequence[str], Option(help="g that hang at a point, such as tip=20")] = (),
    blocked: Annotated[bool, Option(
        "--blocked", help="also the force with the end kept at its height")] = False,
    object: Annotated[str, Option(  # noqa: A002 - as it is typed
        help="force on an object too: cylinder:d=40,x=70,z=-30 (mm)")] = "",
    dynamics: Annotated[bool, Option(
        "--dynamics", help="with inertia, however slow the course is")] = False,
    loss: Annotated[float | None, Option(help="loss factor of the silicone, beside its creep")] = None,
    density: Annotated[float | None, Option(help="of the silicone in kg/m3, if twin.toml has none")] = None,
) -> dict[str, Any]:
    """Displacements of points and the turn of the tip, each with its 95 % interval, under held pressures,
    hung weights or along the course of a log; or at the pressures that give wanted displacements. A fast
    course moves the finger with its inertia."""
    if object and inverse:
        raise ValueError("--object: wanted --pressure or --course beside it, not --inverse")
    object_text = "" if inverse else object or project.config.model.object or ""
    obstacle = RigidObject.of(object_text) if object_text else None
    motions = [Wanted.of(text) for text in inverse]
    courses = _courses(pressure, course, motions, ramp_s=ramp_s, hold_s=hold_s, hung=bool(weight))
    if blocked and not pressure:
        raise ValueError("--blocked: wanted a pressure beside it, such as --pressure 20kPa")
    check_options(dynamics=dynamics, loss=loss, density=density, course=course is not None)
    check_embedded(project, "twin predict")
    bench = Workbench.of(project)
    load: dict[str, Any] = {"gravity": _gravity(bench, gravity)}
    load["shares"] = shares_of_words(bench.targets, shares)
    load["loads"] = loads_of_words(bench.targets, weight)
    courses = [replace(each, **load) for each in courses]
    if obstacle is not None:
        beside(bench.model(), courses[0], obstacle)  # refuses before anything is solved
    fit = files.read(FitRecord, fit_file(project))
    places = asked(bench, [*at, *(motion.point for motion in motions)])
    swing, left_out = None, list[str]()
    if course:
        courses[0], swing = swing_of_course(
            bench, fit, courses[0], left_out, dynamics=dynamics, loss=loss, density=density
        )
    inputs = [project.targets_folder, *project.deck_files(), *([course] if course else [])]
    extra = {
        "pressure": list(pressure), "inverse": list(inverse), "at": list(at), "ramp_s": ramp_s,
        "hold_s": hold_s, "gravity": gravity, "blocked": blocked, "object": object, "shares": list(shares),
        "weight": list(weight), "dynamics": dynamics, "loss": loss, "density": density,
    }  # fmt: skip
    with project.new_run("predict", inputs=inputs, extra=extra) as run:
        say.progress("predict", 0, 1)
        held = partial(WantedCourse.held, ramp_s=ramp_s, hold_s=hold_s, **load)
        inverses = [pressure_for(bench, fit, motion, places, say, held) for motion in motions]
        if inverses:
            courses, predictions = [i.course for i in inverses], [i.prediction for i in inverses]
        else:
            swings = swing if dynamics or swing is None else partial(or_statics, swing, left_out)
            predictions = predicted(bench, fit, courses, places, say, beside=swings)
        forces = [blocked_force(bench, fit, each, say) for each in courses] if blocked else []
        contacts = [touched(bench, fit, rising(each), obstacle, say) for each in courses] if obstacle else []
        record = PredictionRecord(
            points=tuple(row for prediction in predictions for row in _rows(prediction)),
            angles=tuple(row for prediction in predictions for row in _angles(prediction)),
            tested_MPa=float(bench.targets.log_pressure.max()),
            inverse=tuple(map(_pressure_row, inverses)),
            blocked=tuple(map(_force_row, forces)),
            object=object_text,
            contact=tuple(row for contact in contacts for row in contact_rows(contact)),
            inertia=swung(predictions[0], swing),
            note=" ".join([*_notes(bench, courses, predictions), *left_out]),
        )
        _write(run, bench, record, predictions)
        if obstacle is not None:
            run.write_text("contact.csv", contact_csv(record.contact))
            run.write_bytes("contact.png", contact_picture(bench, contacts, obstacle))
    lines = [*_lines(record, as_table=course is None), *told_swing(record.inertia)]
    if obstacle is not None:
        lines += [pushed(contact, obstacle) for contact in contacts]
        lines.append(told(object_text == project.config.model.object))
    for line in filter(None, (*lines, record.note)):
        say(line)
    say(f"Wrote {project.shown(run.folder)}/predicted.csv, predicted.json and predicted.png; the shapes: "
        f"predicted.pvd for ParaView, and `rerun {run.path('predicted.rrd')}`")  # fmt: skip
    return {"stage": "predict", "run": run.name} | files.plain(record)


def _write(run: Run, bench: Workbench, record: PredictionRecord, predictions: Sequence[Prediction]) -> None:
    """Write record, table, picture and shapes into a run."""
    run.write(record)
    run.write_text("predicted.csv", _csv(record))
    run.write_bytes("predicted.png", _picture(predictions))
    _write_shapes(run, bench, predictions)
    run.summary["headline"] = _headline(record)


def _lines(record: PredictionRecord, *, as_table: bool) -> Iterator[str]:
    """Lines for the user: pressures that were sought, displacements, blocked forces."""
    for row in record.inverse:
        yield f"{row.wanted} mm at {_in_kPa(row)}."
    yield from _table(record) if as_table else [_headline(record)]
    for force in record.blocked:
        pressure = f"{1e3 * force.pressure_MPa:.4g} kPa"
        yield f"{pressure}: the end, kept at its height, presses with {in_N(force)}."


def _courses(
    pressure: Sequence[str], course: Path | None, motions: Sequence[Wanted], *, ramp_s: float, hold_s: float,
    hung: bool = False,
) -> list[WantedCourse]:  # fmt: skip
    """Courses of the pressure that are asked for; none for --inverse, one without pressure where something is
    hung. ValueError unless exactly one of --pressure, --course and --inverse is given, or none beside a
    weight."""
    options = [bool(pressure), course is not None, bool(motions)]
    if hung and not any(options):
        return [WantedCourse.held(0.0, ramp_s=ramp_s, hold_s=hold_s)]
    if sum(options) != 1:
        raise ValueError(
            "wanted one of --pressure, such as --pressure 20kPa, once for each, --course with a pressure "
            "log, --inverse, such as --inverse tip.U3=-40, and --weight, such as --weight tip=20, which also "
            f"goes with the others; {sum(options) or 'none'} of them are given"
        )
    check_times(ramp_s, hold_s)
    if course is not None:
        alone = LogFormat(key="a file of the time and that column alone", unit_key="")
        log = read_log(course, time_shift_s=0.0, form=alone)
        return [WantedCourse.logged(log.time, log.pressure, most=MOST)]
    return [WantedCourse.held(pressure_of(text), ramp_s=ramp_s, hold_s=hold_s) for text in pressure]


def _gravity(bench: Workbench, text: str) -> Array | None:
    """The direction (3,) of gravity that is asked for, None where none is. ValueError where it is none, or
    the model has no weight."""
    if not text:
        return None
    try:
        direction = np.array([float(word) for word in text.split(",")])
    except ValueError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
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
    return np.asarray(direction / np.linalg.norm(direction))


def check_times(ramp_s: float, hold_s: float) -> None:
    """ValueError where a held pressure is not reached, or not held, in some time."""
    for name, value in (("--ramp-s", ramp_s), ("--hold-s", hold_s)):
        if not 0 < value < 1e5:
            raise ValueError(f"{name} {value:g}: wanted a time in s, above 0")


def _picture(predictions: Sequence[Prediction]) -> bytes:
    """Over pressure where several states are held, over time where a course is followed."""
    held = all(len(prediction.time) == 1 for prediction in predictions)
    ordered = sorted(predictions, key=lambda one: float(one.pressure[0])) if held else predictions
    u, half = (
        np.concatenate([prediction.u for prediction in ordered]),
        NORMAL * np.concatenate([prediction.sd for prediction in ordered]),
    )
    pressure = np.concatenate([prediction.pressure for prediction in ordered])
    return draw_prediction(
        1e3 * pressure if held else ordered[0].time, u, None if ordered[0].why else half,
        names=ordered[0].names, label="pressure, kPa" if held else "time, s",
        beyond=np.concatenate([prediction.beyond for prediction in ordered]), statics=ordered[0].statics,
    )  # fmt: skip


def _write_shapes(run: Run, bench: Workbench, predictions: Sequence[Prediction]) -> None:
    """The deformed finger at SHAPES of what is predicted, for ParaView and rerun."""
    u, pressure, time = (np.concatenate([getattr(prediction, key) for prediction in predictions])
                         for key in ("shape", "pressure", "time"))  # fmt: skip
    held = all(len(prediction.time) == 1 for prediction in predictions)
    rows = np.argsort(pressure, kind="stable") if held else np.arange(len(u))
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(SHAPES, len(rows))).round().astype(int))]
    nodes, surface = bench.case.nodes, triangles(bench.structure.outside)
    write_vtu_series(
        run.folder, "predicted", nodes=nodes, cells=bench.case.connectivity,
        times=list(1e3 * pressure[rows] if held else time[rows]), fields={"U": u[rows]},
    )  # fmt: skip
    write_shapes(
        run.path("predicted.rrd"), nodes=nodes, triangles=surface, u=u[rows], pressure=pressure[rows],
        time=time[rows], held=held,
    )  # fmt: skip


def _force_row(blocked: Blocked) -> PredictedForce:
    low, high = blocked.interval or (None, None)
    return PredictedForce(
        pressure_MPa=blocked.pressure, force_N=blocked.force, low_N=low, high_N=high, beyond=blocked.beyond
    )


def _pressure_row(inverse: Inverse) -> PredictedPressure:
    low, high = inverse.interval or (None, None)
    return PredictedPressure(
        wanted=inverse.wanted.words, pressure_MPa=inverse.pressure, low_MPa=low, high_MPa=high
    )


def _in_kPa(row: PredictedPressure) -> str:
    text = f"{1e3 * row.pressure_MPa:.4g} kPa"
    if row.low_MPa is None or row.high_MPa is None:
        return text
    return f"{text} (95 %: {1e3 * row.low_MPa:.4g} to {1e3 * row.high_MPa:.4g})"


def _rows(prediction: Prediction) -> list[PredictedPoint]:
    half = NORMAL * prediction.sd
    return [
        PredictedPoint(
            point=name, time_s=t, pressure_MPa=p, u_mm=tuple(prediction.u[s, k]),
            low_mm=(None,) * 3 if prediction.why else tuple(prediction.u[s, k] - half[s, k]),
            high_mm=(None,) * 3 if prediction.why else tuple(prediction.u[s, k] + half[s, k]),
            beyond=bool(prediction.beyond[s]),
            static_mm=None if prediction.statics is None else tuple(prediction.statics[s, k]),
        )
        for s, (t, p) in enumerate(zip(prediction.time, prediction.pressure, strict=True))
        for k, name in enumerate(prediction.names)
    ]  # fmt: skip


def _angles(prediction: Prediction) -> list[PredictedAngle]:
    half = NORMAL * prediction.angle_sd
    return [
        PredictedAngle(
            time_s=t, pressure_MPa=p, degrees=a,
            low=None if prediction.why else a - h, high=None if prediction.why else a + h,
        )
        for t, p, a, h in zip(prediction.time, prediction.pressure, prediction.angle, half, strict=True)
    ]  # fmt: skip


def _notes(bench: Workbench, courses: Sequence[WantedCourse], predictions: Sequence[Prediction]) -> list[str]:
    """Sentences: missing intervals, untested pressures, rates and durations, and effects of the rig."""
    out, t = [], bench.targets
    tested, asked_for = float(t.log_pressure.max()), max(float(course.pressure.max()) for course in courses)
    if predictions[0].why:
        out.append(f"No intervals: {predictions[0].why}.")
    if any(course.beyond.any() for course in predictions):
        out.append(
            f"{1e3 * asked_for:.4g} kPa is beyond the {1e3 * tested:.4g} kPa that were tested: nobody has "
            "seen the silicone's law there. The intervals there include a stiffening that the film could not "
            "show, but no contact and no buckling."
        )
    out += [*filling_notes(t, courses[0].shares, asked_for), *weight_notes(t, courses[0])]
    fast, faster = (
        _rate(t.log_time, t.log_pressure),
        max(_rate(course.time, course.pressure) for course in courses),
    )
    if faster > FASTER * fast:
        out.append(
            f"The pressure changes by up to {1e3 * faster:.3g} kPa/s, in the film by {1e3 * fast:.3g} kPa/s "
            "at most: what depends on the rate was not tested there."
        )
    lasts = max(float(np.ptp(t.time[t.block == b])) for b in np.unique(t.block))
    longer = max(float(np.ptp(course.time)) for course in courses)
    if longer > LONGER * lasts:
        out.append(
            f"It lasts {longer:.3g} s, the film {lasts:.3g} s: slower creep than the film's was not tested."
        )
    direction = courses[0].gravity
    if direction is not None and t.gravity is not None and float((t.gravity @ direction).max()) < TURNED:
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


def _headline(record: PredictionRecord) -> str:
    top = max(record.points, key=lambda row: row.pressure_MPa)
    rows = [row for row in record.points if row.pressure_MPa == top.pressure_MPa and row.time_s == top.time_s]
    motions = "; ".join(f"{row.point} {_cell(row, 2)} mm in U3" for row in rows)
    return f"At {1e3 * top.pressure_MPa:.4g} kPa: {motions}."


def _cell(row: PredictedPoint, axis: int) -> str:
    low, high = row.low_mm[axis], row.high_mm[axis]
    half = "" if low is None or high is None else f" +- {(high - low) / 2:.2f}"
    return f"{row.u_mm[axis] + 0.0:.2f}{half}"


def _table(record: PredictionRecord) -> list[str]:
    """A line a pressure and point, with the turn of the tip in its first; +- is half of the 95 % interval."""
    rows = []
    for angle in record.angles:
        pressure = f"{1e3 * angle.pressure_MPa:.4g} kPa"
        at_once = [
            r for r in record.points if (r.pressure_MPa, r.time_s) == (angle.pressure_MPa, angle.time_s)
        ]
        half = "" if angle.low is None or angle.high is None else f" +- {(angle.high - angle.low) / 2:.1f}"
        turns = [f"{angle.degrees:.1f}{half}", *[""] * len(at_once)]
        rows += [(pressure, row.point, *(_cell(row, axis) for axis in range(3)), turn)
                 for row, turn in zip(at_once, turns)]  # fmt: skip
    head = ("pressure", "", *(f"{axis}, mm" for axis in AXES), "tip turns, degrees")
    return DataTable(head, list(dict.fromkeys(rows))).lines("><>")


def _csv(record: PredictionRecord) -> str:
    columns = [f"{u}_{end}" for u in ("u1", "u2", "u3") for end in ("mm", "low_mm", "high_mm")]
    statics = [f"{u}_static_mm" for u in ("u1", "u2", "u3")] if record.inertia else []
    rows = [
        [row.time_s, row.pressure_MPa, row.point.replace(",", " "),
         *(ends[k] for k in range(3) for ends in (row.u_mm, row.low_mm, row.high_mm)), row.beyond,
         *(row.static_mm or ())]
        for row in record.points
    ]  # fmt: skip
    return DataTable(["time_s", "pressure_MPa", "point", *columns, "beyond", *statics], rows).csv(digits=6)
