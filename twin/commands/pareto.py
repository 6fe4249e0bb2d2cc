"""The command pareto: the trade-off between fits of parts of the measurement."""

from collections.abc import Callable, Iterator
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from typer import Option

from twin import files
from twin.bench.comparison import film_names, kept_errors
from twin.bench.engines import check_embedded
from twin.bench.fits import fit_file
from twin.bench.workbench import Workbench
from twin.calibrated.tradeoff import Keep, SolvedFit, TradeOff, masks_of, misfits, trade_off
from twin.drawing.fitplots import draw_front
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.numerals import short
from twin.project.folder import Project, Run
from twin.records import Record
from twin.table import DataTable
from twin.tablemodel import Finite

OFF = 0.25  # of what noise may make of a misfit, by which a response may be off unmentioned


class ParetoObjective(Record):
    """One objective: a part of the targets."""

    name: str
    values: int = Field(description="number of values that are fitted")
    noise_mm: Finite = Field(description="rms of their noise")
    expected_mm: Finite = Field(description="rms of all their errors, shared ones too")
    best: Finite = Field(description="misfit over its errors, fitted alone")
    fit: Finite = Field(description="that of the one fit")
    excess: Finite = Field(description="chi2 of the one fit less that of the best alone")


class ParetoPoint(Record):
    """One point of the front."""

    parameters: dict[str, Finite]
    misfit: dict[str, Finite] = Field(description="over its errors, by objective; 1: a model that is right")
    rms_mm: dict[str, Finite] = Field(description="of the residual, by objective")


class ParetoRecord(Record):
    """The front of several misfits."""

    file: ClassVar[str] = "pareto.json"
    fit: str = Field(description="the run with the one fit")
    seed: int
    objectives: tuple[ParetoObjective, ...] = Field(description="a row an objective")
    threshold: Finite = Field(description="excess that noise alone goes beyond in 5 % of all tests")
    points: tuple[ParetoPoint, ...] = Field(description="a row a point of the front that was solved whole")
    knee: int = Field(description="number of the knee among them, from 0")
    conflict: bool | None = Field(
        description="whether the one fit leaves more than noise explains; null: nothing is known of the noise"
    )
    off: Finite = Field(description="by how much the response was off their misfits, at most")
    told: str = Field(description="what the front means")
    note: str = Field(default="", description="what limits that")


def run_pareto(
    project: Project,
    say: Say,
    objectives: Annotated[str, Option(
        help="what is fitted, between commas: points, U1, U3 or films, or two of them as tip.U3; by default "
        "the points of [calibrate]")] = "",
    *,
    seed: Annotated[int, Option(help="seed of the genetic algorithm")] = 1,
) -> dict[str, Any]:
    """Front of the misfits of points, components or films, by NSGA-II around the newest fit; its knee; and
    whether the one fit of all is as good as each alone.

    ValueError for objectives that there are not, and without a fit.
    """
    check_embedded(project, "twin pareto")
    file = fit_file(project)
    fit = files.read(FitRecord, file).fit
    bench = Workbench.of(project)
    text = objectives or ",".join(project.config.objective_points)
    masks = masks_of(text, bench.targets, film_names(project))
    inputs = [project.targets_folder, *project.deck_files(), *project.effect_files()]
    extra = {"objectives": list(masks), "fit": file.parent.name}
    with project.new_run("pareto", seed=seed, inputs=inputs, extra=extra) as run:
        trade = trade_off(
            bench, fit, masks, seed=seed, say=say, keep=_keeping(run),
            errors=kept_errors(file, fit, bench.targets),
        )
        has_noise = bench.targets.noise is not None
        names = [p.name for p in fit.parameters]
        record = _record(trade, file.parent.name, seed, names, has_noise)
        run.write(record)
        run.write_text("pareto.csv", _csv(trade, names))
        run.write_bytes("pareto.png", _picture(trade))
        run.summary["headline"] = record.told
    for line in _table(record, trade):
        say(line)
    say(record.told)
    if record.note:
        say(record.note)
    say(f"{len(record.points)} points of the front are whole solves of the model; the response was at most "
        f"{record.off:.2g} off their misfits.")  # fmt: skip
    say(f"Wrote {project.shown(run.folder)}/pareto.csv, pareto.json and pareto.png")
    return {"stage": "pareto", "run": run.name} | files.plain(record)


def _keeping(run: Run) -> Keep:
    """A store of solved fits in the log of a run: a killed run goes on where it was."""
    done = {line["name"]: line["made"] for line in run.log() if "made" in line}

    def keep(name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        if name not in done:
            done[name] = make()
            run.append({"name": name, "made": done[name]})
        return done[name]

    return keep


def _record(trade: TradeOff, fit: str, seed: int, names: list[str], has_noise: bool) -> ParetoRecord:
    best, fitted = (misfits(trade.parts, x[None])[0] for x in (trade.least, trade.fit.chi2))
    return ParetoRecord(
        fit=fit, seed=seed,
        objectives=tuple(
            ParetoObjective(
                name=p.name, values=p.whitener.count, noise_mm=p.whitener.noise_sd,
                expected_mm=p.whitener.stated, best=float(best[k]), fit=float(fitted[k]),
                excess=float(trade.excess[k]),
            )
            for k, p in enumerate(trade.parts)
        ),
        threshold=trade.threshold,
        points=tuple(_point(trade, solved, names) for solved in trade.solved),
        knee=trade.knee, conflict=bool(trade.conflicting) if has_noise else None,
        off=max(solved.off for solved in trade.solved), told=told(trade, known=has_noise),
        note=" ".join(_notes(trade)),
    )  # fmt: skip


def _point(trade: TradeOff, solved: SolvedFit, names: list[str]) -> ParetoPoint:
    values = misfits(trade.parts, solved.chi2[None])[0]
    return ParetoPoint(
        parameters={n: float(x) for n, x in zip(names, solved.theta, strict=True)},
        misfit={p.name: float(x) for p, x in zip(trade.parts, values, strict=True)},
        rms_mm={p.name: float(x) for p, x in zip(trade.parts, solved.rms_mm, strict=True)},
    )


# -- in words ------------------------------------------------------------------------------------------------


def told(trade: TradeOff, *, known: bool = True) -> str:
    """A sentence on the front: no conflict where the one fit is as good as each part alone, within noise."""
    if not known:
        return ("Nothing is known of the noise, so that it cannot be said whether these objectives "
                "contradict each other.")  # fmt: skip
    every = ", ".join(p.name for p in trade.parts[:-1]) + f" and {trade.parts[-1].name}"
    if not trade.conflicting:
        return f"No conflict: within noise, the one fit is as good for {every} as a fit of each alone."
    best, fitted = (misfits(trade.parts, x[None])[0] for x in (trade.least, trade.fit.chi2))
    missed = ", ".join(
        f"{p.name} is missed by {fitted[k]:.3g} times its errors, fitted alone by {best[k]:.3g}"
        for k, p in enumerate(trade.parts)
        if p.name in trade.conflicting
    )
    return (f"Conflict of {every}: by the one fit {missed}. No constants fit all of them: model and data "
            "contradict each other there, and `twin diagnose` asks why.")  # fmt: skip


def _notes(trade: TradeOff) -> Iterator[str]:
    if trade.unsettled:
        yield (f"The fit of {' and '.join(trade.unsettled)} alone has not converged: "
               "it may be better than shown.")  # fmt: skip
    least = misfits(trade.parts, trade.least[None])[0]
    if trade.lacking:
        yield (f"Even fitted alone, {' and '.join(trade.lacking)} {'are' if trade.lacking[1:] else 'is'} not "
               "fitted: the model lacks something, and `twin diagnose` asks what.")  # fmt: skip
    room = min(_noise(trade) - least)
    if (off := max(solved.off for solved in trade.solved)) > OFF * room:
        yield (f"The response was up to {off:.2g} off: what is said rests on the whole solves, and a better "
               "point may lie between them.")  # fmt: skip


def _noise(trade: TradeOff) -> Any:
    """Misfits (m,) up to which noise alone leads from the best of each part."""
    return misfits(trade.parts, (trade.least + trade.threshold)[None])[0]


def _table(record: ParetoRecord, trade: TradeOff) -> list[str]:
    """A line an objective: its errors, and its misfit alone, at the knee, by the one fit."""
    knee, noise = record.points[record.knee], map(float, _noise(trade))
    head = ("misfit over its errors", "expected, mm", "alone", "at the knee", "one fit", "within noise to")
    cells = [
        (o.name, *map(short, (o.expected_mm, o.best, knee.misfit[o.name], o.fit, x)))
        for o, x in zip(record.objectives, noise, strict=True)
    ]
    constants = ", ".join(f"{name} = {short(x)}" for name, x in knee.parameters.items())
    return [*DataTable(head, cells).lines(), f"Knee: {constants}."]


# -- files ---------------------------------------------------------------------------------------------------


def _csv(trade: TradeOff, names: list[str]) -> str:
    """A line a point of the front: its parameters and misfits; those that were solved whole with their rms in
    mm."""
    parts = [p.name for p in trade.parts]
    columns = ["point", *names, *(f"misfit {n}" for n in parts), *(f"rms_mm {n}" for n in parts)]
    solved = [("one fit", trade.fit)]
    solved += [("knee" if k == trade.knee else "solved", fit) for k, fit in enumerate(trade.solved)]
    rows: list[list[Any]] = [
        [kind, *map(float, (*fit.theta, *misfits(trade.parts, fit.chi2[None])[0], *fit.rms_mm))]
        for kind, fit in solved
    ]
    for theta, values in zip(trade.front.theta, trade.front.values, strict=True):
        rows.append(["response", *map(float, (*theta, *values)), *(None for _ in parts)])
    return DataTable(columns, rows).csv(digits=8)


def _picture(trade: TradeOff) -> bytes:
    return draw_front(
        [p.name for p in trade.parts], front=trade.front.values, solved=trade.values, knee=trade.knee,
        fit=np.asarray(misfits(trade.parts, trade.fit.chi2[None])[0]), noise=_noise(trade),
    )  # fmt: skip
