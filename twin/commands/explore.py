"""The command explore: which constant, effect or dimension bends the finger more, and at what stretch."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from typer import Option

from twin import files
from twin.bench.engines import check_embedded
from twin.bench.explorationranges import asked_ranges
from twin.calibrated.exploration import FieldResponse, FingerAnswer, VariedFinger, farthest, tasks_of
from twin.calibrated.predictions import pressure_of
from twin.commands.exploredesign import export_design
from twin.drawing.fitplots import EffectPanel, draw_effects
from twin.executors.local import current
from twin.experiments.designs import MainEffects, Variable, levels_of, main_effects, sobol_design
from twin.messages import Say
from twin.numerals import short
from twin.project.folder import Project, Run
from twin.records import Maybe, Record
from twin.table import DataTable
from twin.tablemodel import Finite
from twin.targets import Array

CHECKED = 4  # runs of a response that are solved whole, too
ROUGH = 0.1  # of an answer's sd over the design, by which a response may be off
PLANE = 0.8  # of an answer's variance that its plane should explain
SURE = 2.0  # standard errors
ANSWERS = {
    "u1_mm": "U1, mm", "u3_mm": "U3, mm", "angle_deg": "bending, degrees", "stretch": "highest stretch",
}  # fmt: skip
BENDING, STRETCHED = "angle_deg", "stretch"


class ExploredVariable(Record):
    """A variable of the design."""

    name: str
    low: Finite
    high: Finite
    unit: str


class ExploredRow(Record):
    """One run of the design."""

    values: dict[str, Finite] = Field(description="by the variable's name")
    u1_mm: Maybe = Field(description="of the lowest place of the end face, against rest; null: no answer")
    u3_mm: Maybe
    angle_deg: Maybe = Field(description="turn of the end face about y, positive downwards")
    stretch: Maybe = Field(description="highest principal stretch in the walls")
    nodes: int = Field(default=0, description="of the mesh")
    why: str = Field(default="", description="why there is no answer")


class ExploredEffect(Record):
    """Main effect of a variable on an answer, the others averaged."""

    variable: str
    answer: str
    change: Finite = Field(description="from the lowest to the highest value of the variable")
    sd: Finite = Field(description="its standard error: bend and interaction")
    standardised: Finite = Field(description="standardised regression coefficient")
    explained: Finite = Field(description="share of the answer's variance that all variables explain")


class ExploredRecord(Record):
    """A design of experiments on the finger."""

    file: ClassVar[str] = "explore.json"
    seed: int
    pressure_MPa: Finite
    held: dict[str, Finite] = Field(description="parameters that are not varied")
    variables: tuple[ExploredVariable, ...] = Field(description="a row a variable")
    rows: tuple[ExploredRow, ...] = Field(description="a row a run, in the order of the design")
    effects: tuple[ExploredEffect, ...] = Field(description="a row a variable and answer")
    off: dict[str, Finite] = Field(default={}, description="what the response is off from whole solves")
    told: str = Field(description="what bends the finger most, and what at less stretch")
    note: str = Field(default="", description="what limits that")


def run_explore(
    project: Project,
    say: Say,
    over: Annotated[Sequence[str], Option(
        help="what is varied, NAME=LOW:HIGH: a constant in MPa, a parameter of an effect, or a dimension "
        "such as top_wall_mm=1.6:2.4; once for each")] = (),
    *,
    runs: Annotated[int, Option(help="number of runs")] = 32,
    seed: Annotated[int, Option(help="seed of the design")] = 1,
    pressure: Annotated[str, Option(help="such as 30kPa; by default the highest of the film")] = "",
    whole: Annotated[bool, Option("--whole", help="solve every run, in place of a response")] = False,
    export: Annotated[str, Option(metavar="FILE", help="write the design for a program of your own, and "
        "solve nothing")] = "",
) -> dict[str, Any]:
    """Bending, displacement of the tip and highest stretch of the finger over ranges of constants, amplitudes
    of effects and dimensions; and which of them bends it most.

    export: a file for the design alone, whose names are those of somebody's program. ValueError for a
    variable that there is not, a range that is none, and where no run has an answer.
    """
    if export:
        return export_design(over, Path(export), say, runs=runs, seed=seed)
    check_embedded(project, "twin explore")
    top = _pressure(project, pressure)
    finger, variables, remarks = asked_ranges(project, over, top)
    x = sobol_design(variables, runs=runs, seed=seed)
    response = not whole and not any(finger.remeshes(v.name) for v in variables)
    extra = {"over": list(over), "runs": runs, "pressure": top, "whole": not response,
             "held": dict(finger.values)}  # fmt: skip
    with project.new_run("explore", seed=seed, extra=extra) as run:
        rows = [dict(zip((v.name for v in variables), map(float, row), strict=True)) for row in x]
        answers, off = _answered(finger, variables, rows, response, run, say)
        good = np.array([isinstance(answer, FingerAnswer) for answer in answers])
        if not good.any():
            raise ValueError(f"explore: none of {len(rows)} runs has an answer; the first: {answers[0]}; "
                             "wanted ranges in which the finger can be meshed and solved")  # fmt: skip
        answered = [answer for answer in answers if isinstance(answer, FingerAnswer)]
        y = {name: np.array([getattr(answer, name) for answer in answered]) for name in ANSWERS}
        record = _record(seed, top, finger, variables, rows, answers, x[good], y, off, remarks)
        run.write(record)
        run.write_text("explore.csv", _csv(record))
        run.write_bytes("explore-effects.png", _picture(variables, x[good], y))
        run.summary["headline"] = record.told
    for line in _table(record):
        say(line)
    say(record.told)
    if record.note:
        say(record.note)
    say(f"Wrote {project.shown(run.folder)}/explore.csv, explore.json and explore-effects.png")
    return {"stage": "explore", "run": run.name} | files.plain(record)


# -- what is asked for ---------------------------------------------------------------------------------------


def _pressure(project: Project, text: str) -> float:
    if text:
        return pressure_of(text)
    if not (project.targets_folder / "targets.csv").is_file():
        raise ValueError("--pressure: this project has no film whose highest pressure could be taken; wanted "
                         "one, such as --pressure 30kPa")  # fmt: skip
    return float(project.targets().log_pressure.max())


# -- what is answered ----------------------------------------------------------------------------------------


def _answered(
    finger: VariedFinger, variables: Sequence[Variable], rows: Sequence[dict[str, float]], response: bool,
    run: Run, say: Say,
) -> tuple[list[FingerAnswer | str], dict[str, float]]:  # fmt: skip
    """Answer to each row, and the largest error of the response; solves of a killed run come from its log."""
    checked = list(range(len(rows)))
    if response:  # rows spread over the design check it
        checked = sorted({int(k) for k in np.linspace(0, len(rows) - 1, min(CHECKED, len(rows)))})
    solved: dict[int, FingerAnswer | str] = {
        line["row"]: FingerAnswer(**line["shown"]) if line["shown"] else line["why"]
        for line in run.log() if "row" in line
    }  # fmt: skip
    unsolved = [k for k in checked if k not in solved]
    say.progress("explore", len(checked) - len(unsolved), len(checked))
    tasks = tasks_of(finger, [rows[k] for k in unsolved])
    for done, (n, answer) in enumerate(current().ended(tasks), start=len(checked) - len(unsolved) + 1):
        why, values = (answer, None) if isinstance(answer, str) else ("", asdict(answer))
        run.append({"row": unsolved[n], "shown": values, "why": why})
        solved[unsolved[n]] = answer
        say.progress("explore", done, len(checked))
    if not response:
        return [solved[k] for k in checked], {}
    try:
        answering = FieldResponse.of(finger, variables)
    except ValueError as why:
        raise ValueError(f"{why}; or solve every run with --whole") from None
    answers = [answering.row(row) for row in rows]
    pairs = [(a, b) for k in checked for a, b in [(answers[k], solved[k])]
             if isinstance(a, FingerAnswer) and isinstance(b, FingerAnswer)]  # fmt: skip
    for k in checked:  # what cannot be solved has no answer
        answers[k] = solved[k]
    return answers, {n: getattr(farthest(pairs), n) for n in ANSWERS} if pairs else {}


def _record(
    seed: int, top: float, finger: VariedFinger, variables: Sequence[Variable],
    rows: Sequence[dict[str, float]], answers: Sequence[FingerAnswer | str], x: Array, y: Mapping[str, Array],
    off: Mapping[str, float], remarks: Sequence[str],
) -> ExploredRecord:  # fmt: skip
    low, high = np.array([[v.low, v.high] for v in variables]).T
    plane = {name: main_effects(x, values, low, high) for name, values in y.items()}
    notes = [*remarks, *_notes(answers, y, plane, off)]
    return ExploredRecord(
        seed=seed, pressure_MPa=top,
        held={k: v for k, v in finger.values.items() if k not in {v.name for v in variables}},
        variables=tuple(
            ExploredVariable(name=v.name, low=v.low, high=v.high, unit=v.unit) for v in variables
        ),
        rows=tuple(_row(values, answer) for values, answer in zip(rows, answers, strict=True)),
        effects=tuple(_effect_rows(variables, plane)), off=dict(off),
        told=told(variables, plane[BENDING], plane[STRETCHED]), note=" ".join(notes),
    )  # fmt: skip


def _row(values: dict[str, float], answer: FingerAnswer | str) -> ExploredRow:
    if isinstance(answer, str):
        return ExploredRow(values=values, u1_mm=None, u3_mm=None, angle_deg=None, stretch=None, why=answer)
    return ExploredRow(values=values, **asdict(answer), why="")


def _effect_rows(
    variables: Sequence[Variable], plane: Mapping[str, MainEffects | None]
) -> Iterator[ExploredEffect]:
    for answer, e in plane.items():
        if e is None:
            continue
        for k, v in enumerate(variables):
            yield ExploredEffect(
                variable=v.name, answer=answer, change=float(e.change[k]), sd=float(e.sd[k]),
                standardised=float(e.standardised[k]), explained=e.explained,
            )  # fmt: skip


# -- in words ------------------------------------------------------------------------------------------------


def told(variables: Sequence[Variable], bends: MainEffects | None, strains: MainEffects | None) -> str:
    """Sentences on the variable that bends the finger most, and on more bending at less stretch."""
    if bends is None or strains is None:
        return "Too few runs have an answer to say what each variable does: ask for more --runs."
    clear = np.abs(bends.change) > SURE * bends.sd
    if not clear.any():
        return "No variable has a clear effect on the bending: curvature and interactions hide it."
    strongest, *others = np.argsort(-np.abs(bends.change))
    v, change, sd = variables[strongest], bends.change[strongest], bends.sd[strongest]
    most = (f"{v.name} moves the bending most: by {change:+.3g} degrees (sd {sd:.2g}) from {short(v.low)} to "
            f"{short(v.high)} {v.unit}".rstrip() + ".")  # fmt: skip
    if others:
        near = abs(change) - abs(bends.change[others[0]])
        if near < SURE * math.hypot(sd, bends.sd[others[0]]):
            most += f" {variables[others[0]].name} may move it as much."
    return f"{most} {_at_less_stretch(variables, bends, strains)}"


def _at_less_stretch(variables: Sequence[Variable], bends: MainEffects, strains: MainEffects) -> str:
    """A sentence on variables that give more bending at less stretch, else on the cheapest one."""
    clear = np.abs(bends.change) > SURE * bends.sd
    sure = clear & (np.abs(strains.change) > SURE * strains.sd)
    costs = [k for k in range(len(variables)) if sure[k]]
    both = [k for k in costs if bends.change[k] * strains.change[k] < 0]
    if both:
        every = " and ".join(
            f"{'larger' if bends.change[k] > 0 else 'smaller'} {variables[k].name}"
            for k in sorted(both, key=lambda k: -abs(bends.change[k]))
        )
        return f"More bending at less stretch, under the same pressure: {every}."
    if not costs:
        return "No variable is seen to give more bending at less stretch."
    k = min(costs, key=lambda k: abs(strains.change[k] / bends.change[k]))
    return (f"No variable is seen to give more bending at less stretch; {variables[k].name} costs least, "
            f"{abs(strains.change[k] / bends.change[k]):.2g} of stretch a degree.")  # fmt: skip


def _notes(
    answers: Sequence[FingerAnswer | str], y: Mapping[str, Array], plane: Mapping[str, MainEffects | None],
    off: Mapping[str, float],
) -> Iterator[str]:  # fmt: skip
    why = [answer for answer in answers if isinstance(answer, str)]
    if why:
        yield (f"{len(why)} of {len(answers)} runs have no answer, and what is said holds for the others "
               f"alone. The first: {why[0]}.")  # fmt: skip
    for name in (BENDING, STRETCHED):
        e = plane[name]
        if e is not None and e.explained < PLANE:
            yield (f"Straight lines explain {100 * e.explained:.0f} % of {ANSWERS[name].partition(',')[0]}: "
                   "variables act together, or bend it; see explore-effects.png, "
                   "or narrow the ranges.")  # fmt: skip
    for name, size in off.items():
        if size > ROUGH * float(y[name].std()) > 0:
            yield (f"The response is up to {size:.2g} off whole solves in {ANSWERS[name]}: use --whole, or "
                   "narrow the ranges.")  # fmt: skip
    if len({answer.nodes for answer in answers if isinstance(answer, FingerAnswer)}) > 1:
        yield ("The mesh has not the same number of nodes in all runs: differences of the size of its error "
               "say nothing.")  # fmt: skip


def _table(record: ExploredRecord) -> list[str]:
    """A line a variable: its range, and what it does to each answer with the standard error."""
    columns, cells = ("", "range", *ANSWERS.values()), []
    for v in record.variables:
        effects = {e.answer: e for e in record.effects if e.variable == v.name}
        texts = (f"{effects[n].change:+.3g} ({effects[n].sd:.1g})" if n in effects else "–" for n in ANSWERS)
        name = f"{v.name}, {v.unit}" if v.unit and not v.name.endswith("_mm") else v.name
        cells.append((name, f"{short(v.low)} to {short(v.high)}", *texts))
    kPa = 1e3 * record.pressure_MPa
    head = [f"Change from the lowest to the highest value, with its sd, at {kPa:.4g} kPa:"]
    off = ", ".join(f"{record.off[n]:.1g} in {ANSWERS[n]}" for n in record.off)
    tail = [f"The response differs from whole solves by at most {off}."] if off else []
    return [*head, *DataTable(columns, cells).lines(), *tail]


# -- files ---------------------------------------------------------------------------------------------------


def _csv(record: ExploredRecord) -> str:
    """A line a run: its values, its answers, and why there are none."""
    names = [v.name for v in record.variables]
    units = [v.unit.replace("/", "_per_") for v in record.variables]
    heads = [n if n.endswith("_mm") or not u else f"{n}_{u}" for n, u in zip(names, units, strict=True)]
    rows = [
        [k, *(row.values[n] for n in names), *(getattr(row, n) for n in ANSWERS), row.nodes or None, row.why]
        for k, row in enumerate(record.rows, start=1)
    ]
    return DataTable(["run", *heads, *ANSWERS, "nodes", "why"], rows).csv(digits=8)


def _picture(variables: Sequence[Variable], x: Array, y: Mapping[str, Array]) -> bytes:
    panels = [
        [
            EffectPanel(x[:, k], values, levels_of(x[:, k], values, v.low, v.high))
            for k, v in enumerate(variables)
        ]
        for values in y.values()
    ]
    return draw_effects(panels, variables=[v.title for v in variables], answers=list(ANSWERS.values()))
