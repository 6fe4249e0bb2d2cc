"""The command export: the calibrated finger for other programs, as a deck, a table, or for a simulator."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
import scipy
from pydantic import Field
from typer import Argument, Option

from fe.engines.calculix import CalculiX, check, without_hybrid
from fe.engines.writer import deck
from twin import files
from twin.assets.simulators import SIMULATORS
from twin.bench.engines import check_embedded
from twin.bench.fits import fit_file
from twin.bench.workbench import Workbench
from twin.calibrated.positions import asked
from twin.calibrated.predictions import Prediction, WantedCourse, predicted, pressure_of
from twin.commands.exportasset import export_asset
from twin.commands.predict import check_times
from twin.effects.protocol import Effect, Order, Test
from twin.gravity import of_targets
from twin.judging.fitrecord import Estimate, FitRecord
from twin.messages import Say
from twin.project.folder import Project, Run
from twin.records import Maybe, Record
from twin.table import DataTable
from twin.tablemodel import Finite
from twin.targets import Array

Form = Literal["abaqus", "calculix", "json", "csv"]
FORMS = (*get_args(Form), *SIMULATORS)
LEVELS = 16  # pressures of the table of the response, up to the tested one
VERSION = 1  # of what is written as JSON


class ResponseRow(Record):
    """A point under one held pressure, relative to the finger at rest."""

    point: str
    pressure_MPa: Finite
    u_mm: tuple[Finite, Finite, Finite] = Field(description="U1, U2, U3")
    slope_mm_per_MPa: tuple[Finite, Finite, Finite] = Field(description="its derivative by the pressure")
    sd_mm: tuple[Maybe, Maybe, Maybe] = Field(description="1 sd of U1, U2, U3; null where the fit has none")


class ModelRecord(Record):
    """The calibrated finger and its response, for a program that does not know this one."""

    file: ClassVar[str] = "model.json"
    version: int = Field(description="of this form")
    law: str = Field(description="of the silicone")
    effects: tuple[str, ...] = Field(description="names of what was added to the model")
    parameters: dict[str, Estimate] = Field(description="constants by name")
    adequate: bool = Field(description="whether the model fits its film, so that the sds may be used")
    ramp_s: Finite = Field(description="time in which each pressure is reached")
    hold_s: Finite = Field(description="time for which it is then held")
    tested_MPa: Finite = Field(description="highest pressure of the film: the table ends there")
    positions_mm: dict[str, tuple[Finite, Finite, Finite]] = Field(description="places of the points at rest")
    response: tuple[ResponseRow, ...] = Field(description="a row a pressure and point")


def run_export(
    project: Project,
    say: Say,
    form: Annotated[str, Argument(
        metavar="FORM", help="abaqus or calculix: a deck; json or csv: a table of the response; table, "
        "mujoco, newton or pyelastica: a rod of sections, with a card that says how well it follows")],
    *,
    pressure: Annotated[str, Option(
        help="of a deck, such as 20kPa; by default the highest of the film")] = "",
    at: Annotated[Sequence[str], Option(
        help="of a table: a point, x=60, or x,y,z in mm; once for each")] = (),
    ramp_s: Annotated[float, Option(help="time in which the pressure is reached, s")] = 2.0,
    hold_s: Annotated[float, Option(help="time for which it is held, s")] = 2.0,
) -> dict[str, Any]:
    """The calibrated finger as a deck under a held pressure, the table of its response, or a simulator's."""
    if form not in FORMS:
        raise ValueError(f"export {form!r}: wanted one of {', '.join(FORMS)}")
    check_times(ramp_s, hold_s)
    if form in SIMULATORS:
        if pressure or at:
            raise ValueError(
                f"export {form}: it has all pressures up to the tested one, along the points; wanted "
                "neither --pressure nor --at"
            )
        return export_asset(project, say, form, ramp_s=ramp_s, hold_s=hold_s)
    table = form in ("json", "csv")
    if table and pressure:
        raise ValueError(f"--pressure {pressure}: of a deck; a table has all pressures up to the tested one")
    if not table and at:
        raise ValueError(f"--at {at[0]}: of a table; a deck has all nodes")
    if table:
        check_embedded(project, f"twin export {form}")
    bench = Workbench.of(project)
    record = files.read(FitRecord, fit_file(project))
    inputs = [project.targets_folder, *project.deck_files()]
    extra = {"form": form, "pressure": pressure, "at": list(at), "ramp_s": ramp_s, "hold_s": hold_s}
    with project.new_run("export", inputs=inputs, extra=extra) as run:
        if table:
            places = asked(bench, at)
            model_record = _response(bench, record, places, say, ramp_s=ramp_s, hold_s=hold_s)
            name = _written(model_record, form, run)
            notes = [] if record.adequate else ["No sds: the model does not fit its film."]
        else:
            deck_pressure = pressure_of(pressure) if pressure else float(bench.targets.log_pressure.max())
            text, notes = _deck(bench, record, deck_pressure, form, (ramp_s, hold_s))
            name = "finger.inp"
            run.write_text(name, text)
        if bench.targets.shares:
            notes.append("Its chambers carry the pressure as in the first film.")
        run.summary["headline"] = f"The calibrated finger as {name}."
    for line in notes:
        say(line)
    say(f"Wrote {project.shown(run.folder)}/{name}")
    return {"stage": "export", "run": run.name, "form": form, "file": name, "notes": notes}


# -- a deck --------------------------------------------------------------------------------------------------


def _deck(
    bench: Workbench, record: FitRecord, pressure: float, form: str, times: tuple[float, float]
) -> tuple[str, list[str]]:
    """The text of a deck, and what it leaves out. ValueError for what no deck holds."""
    model = bench.model()
    test = model.put(model.named(record.fit.theta))
    notes = _left_out(model.effects, test)
    if form == "calculix":
        try:
            check(test.case)
        except ValueError as error:
            raise ValueError(f"export calculix: {error}, or export for abaqus") from None
        if why := CalculiX().unfit(test.case):
            notes.append(f"CalculiX has no elements for this deck: {why}.")
    creeps = any(m.prony for m in test.case.materials.values())
    weight = of_targets(bench.targets).reshape(-1, 3)[0]
    if bench.targets.shares:
        first_shares = {name: float(shares[0]) for name, shares in bench.targets.shares.items()}
        test = replace(test, case=replace(test.case, shares={**test.case.shares, **first_shares}))
    text = deck(test.case, pressure, gravity=weight, times=times if creeps else None)
    return (without_hybrid(text) if form == "calculix" else text), notes


def _left_out(effects: Sequence[Effect], test: Test) -> list[str]:
    """Remarks on effects of the rig, which a deck leaves out. ValueError for an effect that no deck holds."""
    if test.perturbations:
        raise ValueError(
            "the model has an effect that is known to first order alone, which no deck holds; drop it "
            "(twin drop) and export what is left"
        )
    rig = [e.label for e in effects if e.order >= Order.GAUGE_GAIN]
    if not rig:
        return []
    return [
        f"The deck is of the finger alone, without what the rig adds: {', '.join(rig)}. Its pressure is "
        "that in the chamber."
    ]


# -- a table -------------------------------------------------------------------------------------------------


def _response(
    bench: Workbench, record: FitRecord, places: dict[str, Array], say: Say, *, ramp_s: float, hold_s: float
) -> ModelRecord:
    """Predicted response at LEVELS pressures."""
    tested = float(bench.targets.log_pressure.max())
    levels = tested * np.linspace(0, 1, LEVELS + 1)[1:]
    courses = [WantedCourse.held(float(p), ramp_s=ramp_s, hold_s=hold_s) for p in levels]
    predictions = predicted(bench, record, courses, places, say)
    u = np.array([prediction.u[0] for prediction in predictions])  # (k, p, 3)
    from_rest = np.concatenate([np.zeros((1, *u.shape[1:])), u])
    slope = scipy.interpolate.CubicSpline(np.append(0.0, levels), from_rest, axis=0)(levels, 1)
    rows = [
        ResponseRow(
            point=name, pressure_MPa=float(p), u_mm=tuple(u[k, j]), slope_mm_per_MPa=tuple(slope[k, j]),
            sd_mm=_sds(predictions[k], j),
        )
        for k, p in enumerate(levels)
        for j, name in enumerate(predictions[k].names)
    ]  # fmt: skip
    return ModelRecord(
        version=VERSION,
        law=f"{bench.law.title}: {bench.law.formula}",
        effects=bench.project.config.model.effects,
        parameters=record.estimates,
        adequate=record.adequate,
        ramp_s=ramp_s,
        hold_s=hold_s,
        tested_MPa=tested,
        positions_mm={name: (float(x), float(y), float(z)) for name, (x, y, z) in places.items()},
        response=tuple(rows),
    )


def _sds(prediction: Prediction, point: int) -> tuple[float | None, float | None, float | None]:
    if prediction.why:
        return None, None, None
    a, b, c = prediction.sd[0, point]
    return float(a), float(b), float(c)


def _written(record: ModelRecord, form: str, run: Run) -> str:
    """The name of the file that was written."""
    if form == "json":
        run.write(record)
        return record.file
    ends = ("mm", "slope_mm_per_MPa", "sd_mm")
    columns = ["pressure_MPa", "point", *(f"u{k}_{end}" for k in (1, 2, 3) for end in ends)]
    rows = [
        [row.pressure_MPa, row.point.replace(",", " "),
         *(x for cell in zip(row.u_mm, row.slope_mm_per_MPa, row.sd_mm, strict=True) for x in cell)]
        for row in record.response
    ]  # fmt: skip
    run.write_text("response.csv", DataTable(columns, rows).csv(digits=6))
    return "response.csv"
