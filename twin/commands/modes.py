"""The command modes: at which frequencies the calibrated finger vibrates, how fast that dies, what moves."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from typer import Option

from fe.element import Integers, triangles
from fe.mesh.mirror import AXIS, middle_plane, symmetry_support
from fe.mesh.points import interpolation
from twin import files
from twin.bench.engines import check_embedded
from twin.bench.fits import fit_file
from twin.bench.workbench import Workbench
from twin.calibrated.naturalvibrations import Vibrating, WantedVibrations, check_density, vibrations
from twin.calibrated.positions import asked
from twin.calibrated.predictions import NORMAL, pressure_of, why_none
from twin.drawing.vibrationplot import SWING, ShapePanel, draw_vibrations
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.project.folder import Project
from twin.records import Maybe, Record
from twin.review.finger import Swinging, write_swinging
from twin.table import DataTable
from twin.tablemodel import Finite
from twin.targets import Array

MOST = 20  # vibrations at one pressure
FASTER = 3.0  # than the fastest term of creep: beyond that its damping says little
SEEN = {"sways aside": (0, 1), "twists": (1, 2)}  # from above, and from the end; else from the side


class VibrationRow(Record):
    """One natural vibration about a held pressure."""

    pressure_MPa: Finite
    number: int = Field(description="from 1, the slowest first")
    frequency_Hz: Finite
    low_Hz: Maybe = Field(description="95 % interval by the fit; null where it has none")
    high_Hz: Maybe
    damping_ratio: Maybe = Field(description="of critical damping; null where nothing states a loss")
    moves: str = Field(description="what it moves")
    points: dict[str, tuple[Finite, Finite, Finite]] = Field(
        description="motion of each point along x, y, z, the finger's largest being 1"
    )


class VibrationsRecord(Record):
    """Natural vibrations of the calibrated finger."""

    file: ClassVar[str] = "vibrations.json"
    vibrations: tuple[VibrationRow, ...] = Field(description="a row a pressure and vibration")
    loss_factor: Finite = Field(description="of the silicone beside its creep, as it was stated")
    density_kg_m3: Maybe = Field(description="as it was typed; null: that of the model")
    attached_g: dict[str, Finite] = Field(default={}, description="masses by place")
    note: str = Field(default="", description="what limits that")


def run_modes(
    project: Project,
    say: Say,
    pressure: Annotated[Sequence[str], Option(
        help="held pressure, such as 20kPa; once for each; by default 0 and the film's highest")] = (),
    *,
    count: Annotated[int, Option(help="number of vibrations at each pressure")] = 4,
    loss: Annotated[float, Option(help="loss factor of the silicone, beside its creep")] = 0.0,
    density: Annotated[float, Option(help="of the silicone in kg/m3, where twin.toml has none")] = 0.0,
    attach: Annotated[Sequence[str], Option(
        help="mass in g at a point, such as tip=0.5 or 110,11.5,0=2; once for each")] = (),
) -> dict[str, Any]:
    """Frequencies, damping ratios and shapes of the finger's natural vibrations about held pressures.

    ValueError where nothing states the density of the silicone, and for masses and pressures that are none.
    """
    check_embedded(project, "twin modes")
    _check(count, loss, density)
    bench = Workbench.of(project)
    record = files.read(FitRecord, fit_file(project))
    top = float(bench.targets.log_pressure.max())
    levels = tuple(pressure_of(text) for text in pressure) or (0.0, top)
    check_density(bench, record, density or None)
    masses = _masses(bench, attach)
    what = WantedVibrations(levels, count, loss, density or None, masses)
    extra = {"pressures": list(levels), "count": count, "loss": loss, "density": density,
             "attach": list(attach)}  # fmt: skip
    with project.new_run("modes", inputs=[project.targets_folder, *project.deck_files()], extra=extra) as run:
        found = vibrations(bench, record, what)
        rows = tuple(row for one in found for row in _rows(one, bench, loss))
        note = " ".join(_notes(bench, record, found, what, top))
        told = VibrationsRecord(
            vibrations=rows, loss_factor=loss, density_kg_m3=density or None,
            attached_g={name: grams for name, (_, grams) in masses.items()}, note=note,
        )  # fmt: skip
        run.write(told)
        run.write_text("vibrations.csv", _csv(told))
        panels = [_panels(one, bench) for one in found]
        run.write_bytes("vibrations.png", draw_vibrations(panels))
        write_swinging(run.path("vibrations.rrd"), [x for one, row in zip(found, panels, strict=True)
                                                    for x in _swinging(one, row, bench)])  # fmt: skip
        run.summary["headline"] = f"{rows[0].frequency_Hz:.3g} Hz at {1e3 * levels[0]:.4g} kPa"
    for line in (*_table(told), *([note] if note else [])):
        say(line)
    say(f"Wrote {project.shown(run.folder)}/vibrations.csv, vibrations.json and vibrations.png; "
        f"moving: `rerun {run.path('vibrations.rrd')}`")
    return {"stage": "modes", "run": run.name} | files.plain(told)


def _check(count: int, loss: float, density: float) -> None:
    """ValueError for options out of range."""
    if not 1 <= count <= MOST:
        raise ValueError(f"--count {count}: wanted 1 to {MOST} vibrations")
    if not 0 <= loss < 2:
        raise ValueError(f"--loss {loss:g}: wanted a loss factor from 0 to 2 (silicone: 0.05 to 0.3)")
    if density and not 100 <= density <= 10_000:
        raise ValueError(f"--density {density:g}: wanted kg/m3, such as 1070")


def _masses(bench: Workbench, attach: Sequence[str]) -> dict[str, tuple[Array, float]]:
    """Places (3,) mm and grams of attached masses, by place as it was typed."""
    out = {}
    for text in attach:
        where, _, grams = text.rpartition("=")
        try:
            mass = float(grams)
        except ValueError:
            mass = 0.0
        if not where or not 0 < mass < 1e4:
            raise ValueError(f"--attach {text!r}: wanted PLACE=GRAMS, such as tip=0.5 or 110,11.5,0=2")
        out[where] = asked(bench, [where], argument="--attach")[where], mass
    return out


def _rows(one: Vibrating, bench: Workbench, loss: float) -> Iterator[VibrationRow]:
    found, places = one.found, asked(bench, [])
    lossy = loss > 0 or any(m.prony for m in one.case.materials.values())
    at = found.at(_on_model(one, np.array(list(places.values()))))
    for k, moves in enumerate(one.moves):
        f, half = float(found.frequency[k]), None if one.sd is None else NORMAL * float(one.sd[k])
        yield VibrationRow(
            pressure_MPa=one.pressure, number=k + 1, frequency_Hz=f,
            low_Hz=None if half is None else max(f - half, 0.0), high_Hz=None if half is None else f + half,
            damping_ratio=float(found.damping[k]) if lossy else None, moves=moves,
            points={n: (float(x), float(y), float(z)) for n, (x, y, z) in zip(places, at[k], strict=True)},
        )  # fmt: skip


def _on_model(one: Vibrating, points: Array) -> Array:
    """Points (p, 3) mm, those beside a half model at their mirror images on it."""
    if symmetry_support(one.case) is None:
        return points
    plane, out = middle_plane(one.case), points.copy()
    side = np.sign(one.case.nodes[:, AXIS].mean() - plane)
    out[:, AXIS] = plane + side * np.abs(points[:, AXIS] - plane)
    return out


def _notes(
    bench: Workbench, record: FitRecord, found: Sequence[Vibrating], what: WantedVibrations, top: float
) -> Iterator[str]:
    """What limits the result, in sentences."""
    prony = [tau for m in found[0].case.materials.values() for g, tau in m.prony if g]
    if not prony and not what.loss:
        yield "No damping: the model has no creep; state the silicone's loss factor with --loss."
    fastest = 2 * np.pi * max(float(one.found.frequency[0]) for one in found)
    if prony and fastest * min(prony) > FASTER:
        yield (f"The damping is too small, and the frequencies are too low: the fastest creep of the model, "
               f"of {min(prony):.2g} s, is slow beside a vibration, of {2 * np.pi / fastest:.2g} s. The film "
               "does not show what creeps so soon.")  # fmt: skip
    if any(not one.found.stable for one in found):
        yield "A frequency of 0: that motion has no restoring force, the finger would snap."
    if max(what.pressures) > 1.001 * top:
        yield f"Above {1e3 * top:.4g} kPa nothing was tested."
    if what.kg_m3 is not None and bench.targets.gravity is None:
        yield "The weight is left out, as in the fitted model."
    if why := why_none(record):
        yield f"No intervals: {why}."


def _panels(one: Vibrating, bench: Workbench) -> list[ShapePanel]:
    places, half = one.case.nodes + one.u, symmetry_support(one.case) is not None
    whole = "outside" in one.case.surfaces  # of both halves, where they were put together
    surface = triangles(one.case.face_nodes("outside") if whole else bench.structure.outside)
    out = []
    for k, moves in enumerate(one.moves):
        shape, seen = one.found.shape[k], SEEN.get(moves, (0, 2))
        title = f"{1e3 * one.pressure:.4g} kPa: {one.found.frequency[k]:.3g} Hz, {moves}"
        if half:
            every, motion, skin = _both(one, places, shape, surface, bool(one.found.sideways[k]))
        else:
            every, motion, skin = places, shape, surface
        out.append(ShapePanel(every, motion, skin, seen, title))
    return out


def _swinging(one: Vibrating, panels: Sequence[ShapePanel], bench: Workbench) -> Iterator[Swinging]:
    """The vibrations at one pressure as they are drawn, with the points that the project names."""
    at = _on_model(one, np.array(list(asked(bench, []).values())))
    rest = at + interpolation(one.case, at) @ one.u
    for panel, shape in zip(panels, one.found.at(at), strict=True):
        swing = SWING * float(np.ptp(panel.places[:, 0]))
        yield Swinging(panel.title, panel.places, swing * panel.shape, panel.triangles, rest, swing * shape)


def _both(
    one: Vibrating, places: Array, shape: Array, surface: Integers, sideways: bool
) -> tuple[Array, Array, Integers]:
    """Places (2 n, 3), motion and triangles of both halves."""
    flip = np.ones(3)
    flip[AXIS] = -1.0
    images = places * flip
    images[:, AXIS] += 2 * middle_plane(one.case)
    motion = shape * flip * (-1.0 if sideways else 1.0)
    return (np.concatenate([places, images]), np.concatenate([shape, motion]),
            np.concatenate([surface, surface + len(places)]))  # fmt: skip


def _table(record: VibrationsRecord) -> list[str]:
    """A line a vibration."""
    rows = [
        (f"{1e3 * row.pressure_MPa:.4g}", f"{row.frequency_Hz:.4g}", _interval(row),
         "–" if row.damping_ratio is None else f"{row.damping_ratio:.2g}", row.moves)
        for row in record.vibrations
    ]  # fmt: skip
    return DataTable(("kPa", "Hz", "95 %", "damping ratio", "moves"), rows).lines(">>>><")


def _interval(row: VibrationRow) -> str:
    return "–" if row.low_Hz is None or row.high_Hz is None else f"{row.low_Hz:.3g} to {row.high_Hz:.3g}"


def _csv(record: VibrationsRecord) -> str:
    columns = ["pressure_MPa", "number", "frequency_Hz", "low_Hz", "high_Hz", "damping_ratio", "moves"]
    names = list(record.vibrations[0].points)
    columns += [f"{name.replace(',', ' ')} {axis}" for name in names for axis in ("x", "y", "z")]
    rows = [
        [row.pressure_MPa, row.number, row.frequency_Hz, row.low_Hz, row.high_Hz, row.damping_ratio,
         row.moves, *(x for name in names for x in row.points[name])]
        for row in record.vibrations
    ]  # fmt: skip
    return DataTable(columns, rows).csv(digits=6)
