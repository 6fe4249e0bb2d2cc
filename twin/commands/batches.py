"""The batches of a folder beside each other: a table, a chart, and whether the newest differs."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument

from calibrate.randomeffects import LEAST, Newcomer, newcomer
from calibrate.statistics import holm
from twin import files
from twin.batches.castings import Casting, casting
from twin.batches.series import Opened, batches_in
from twin.batches.values import BatchValue, values_of
from twin.bench.fits import fit_file, newest
from twin.bench.modeldifferences import other_models, same_films
from twin.csvtable import as_text
from twin.diagnosis.diagnosisrecord import NONE, DiagnosisRecord
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.numerals import interval, short
from twin.project.folder import Project
from twin.table import DataTable

if TYPE_CHECKING:
    from twin.drawing.fitplots import DriftCourse

LEVEL = 0.05  # share of series without a change in which any parameter is called changed, at most
PAGE, TABLE = "batches.html", "batches.csv"


@dataclass(frozen=True, kw_only=True)
class Batch:
    """A batch with its fit; `problem` says why it has none."""

    name: str
    verdict: str
    effects: tuple[str, ...]
    values: tuple[BatchValue, ...]
    problem: str = ""

    def value(self, name: str) -> BatchValue | None:
        """Its quantity of a name."""
        return next((v for v in self.values if v.name == name), None)


@dataclass(frozen=True, kw_only=True)
class Drift:
    """One quantity of the newest batch against the former ones; p_value adjusted for all that were tested."""

    name: str
    unit: str
    found: Newcomer
    p_value: float

    @property
    def differs(self) -> bool:
        """True if the newest batch differs in this quantity."""
        return self.p_value < LEVEL

    @property
    def words(self) -> str:
        """The test in a sentence."""
        f, unit = self.found, f" {self.unit}".rstrip()
        span = f"{f.low:.4g} to {f.high:.4g}{unit}"
        verdict = "differs" if self.differs else "is like the former ones"
        return (f"{self.name} = {f.value:.4g}{unit} {verdict}: by the {f.former.groups} former batches, "
                f"{span} was expected (95 %), p = {self.p_value:.2g}. The sd between batches is "
                f"{f.former.between_sd:.2g}{unit}.")  # fmt: skip


def run_batches(
    folder: Annotated[Path, Argument(
        default_factory=Path, show_default="this folder",
        help="folder whose subfolders are projects, one a batch")],
    say: Say,
    *,
    opened: Opened = Project.open,
) -> dict[str, Any]:
    """The batches below a folder as a table and a chart in batches.html and batches.csv of that folder, and
    the test of the newest one. Both files are made anew each time."""
    paths = batches_in(folder)
    batches = [batch_of(path, opened) for path in paths]
    if not batches:
        raise ValueError(
            f"{folder}: no project below it; wanted a folder whose subfolders have a twin.toml"
        )
    tested, untested = drifts(batches)
    fitted = [path for path, batch in zip(paths, batches, strict=True) if not batch.problem]
    apart = other_models(*map(opened, fitted[-2:])) if len(fitted) > 1 else ()
    cause = Casting(sentences=())
    if len(fitted) > 1 and not batches[-1].problem and any(d.differs for d in tested):
        former, newest_of = map(opened, fitted[-2:])
        cause = casting(former, files.read(FitRecord, fit_file(former)), newest_of, say)
    lines = [*sentences(batches, tested), *cause.sentences, *apart, *same_films(map(opened, fitted))]
    lines += untested
    if len(fitted) == 2:
        lines.append(f"`twin compare {' '.join(map(files.typed, fitted))}` lays the two side by side.")
    files.write_text(folder / TABLE, _csv(batches))
    files.write_text(folder / PAGE, _page(folder.resolve().name, batches, tested, lines))
    for row in batches:
        say(f"{row.name}: {row.problem or _row(row)}")
    for line in lines:
        say(line)
    say(f"Wrote {folder / PAGE} and {folder / TABLE}, made anew from the fits that hold now.")
    return {
        "stage": "batches", "folder": str(folder), "batches": [b.name for b in batches],
        "newest": batches[-1].name, "differs": [d.name for d in tested if d.differs],
        "tests": [{"name": d.name, "p_value": d.p_value, "value": d.found.value, "expected": d.found.expected,
                   "low": d.found.low, "high": d.found.high, "between_sd": d.found.former.between_sd}
                  for d in tested],
        "untested": untested, "cause": cause.plain,
    }  # fmt: skip


def batch_of(folder: Path, opened: Opened = Project.open) -> Batch:
    """The newest fit and verdict of a project; `problem` where it has no fit that holds."""
    try:
        project = opened(folder)
        record = files.read(FitRecord, fit_file(project))
        values = values_of(record)
        verdict = (newest(project, DiagnosisRecord) or NONE).verdict
    except files.UNREADABLE as error:
        problem = str(error) or f"{folder}: the memory of this computer does not suffice"
        return Batch(name=folder.name, verdict="", effects=(), values=(), problem=problem)
    return Batch(name=folder.name, verdict=verdict, effects=record.effects, values=values)


def drifts(batches: list[Batch]) -> tuple[list[Drift], list[str]]:
    """Each quantity of the newest batch (the last) against the former ones, and what could not be tested.

    p-values are adjusted by Holm for the number of quantities. Batches of which a quantity has no sd do not
    count in it, and neither do those whose model has other effects: their constants are another quantity.
    """
    newest, former = batches[-1], [b for b in batches[:-1] if b.effects == batches[-1].effects]
    raw: list[tuple[BatchValue, Newcomer]] = []
    untested = []
    for v in newest.values:
        rows = [w for w in (b.value(v.name) for b in former) if w is not None and w.sd]
        if not v.sd:
            untested.append(f"{v.name} of {newest.name} is not tested: {v.note or 'its sd is not known'}.")
        elif len(rows) < LEAST:
            untested.append(f"{v.name} is not tested: {len(rows)} former batches have it with an interval "
                            f"and the same effects in the model, wanted {LEAST} or more.")  # fmt: skip
        else:
            sds = [w.sd for w in rows if w.sd]
            raw.append((v, newcomer([w.value for w in rows], sds, value=v.value, sd=v.sd)))
    adjusted: list[float] = holm([n.p_value for _, n in raw]).tolist()
    tested = [
        Drift(name=v.name, unit=v.unit, found=n, p_value=p) for (v, n), p in zip(raw, adjusted)
    ]
    return tested, untested


def sentences(batches: list[Batch], tested: list[Drift]) -> list[str]:
    """Sentences on the newest batch: its tests against the former ones."""
    newest = batches[-1]
    if newest.problem:
        return [f"{newest.name}, the newest by name, has no fit that holds: {newest.problem}."]
    changed = [d.name for d in tested if d.differs]
    head = [f"{newest.name}, the newest by name, differs from the former batches in {' and '.join(changed)}."]
    if not changed:
        head = [f"{newest.name}, the newest by name, is like the former batches."] if tested else []
    return [*head, *(d.words for d in tested)]


def _row(batch: Batch) -> str:
    cells = [f"{v.name} = {v.value:.4g}{_span(v)} {v.unit}".rstrip() for v in batch.values]
    return f"{', '.join(cells)}; {batch.verdict}"


def _span(v: BatchValue) -> str:
    return "" if v.span is None else f" (95 %: {v.span[0]:.4g} to {v.span[1]:.4g})"


def _csv(batches: list[Batch]) -> str:
    """One row a batch and quantity, the ends of its 95 % interval empty where there is none."""
    columns = ("batch", "verdict", "effects", "quantity", "value", "low", "high", "unit", "note")
    rows: list[list[Any]] = []
    for b in batches:
        if b.problem:
            rows.append([as_text(b.name), *[None] * 7, as_text(b.problem)])
        for v in b.values:
            texts = map(as_text, (b.name, b.verdict, " ".join(b.effects), v.name))
            rows.append([*texts, v.value, *(v.span or (None, None)), as_text(v.unit), as_text(v.note)])
    return DataTable(columns, rows).csv(digits=None)


# -- the page ------------------------------------------------------------------------------------------------


def _page(title: str, batches: list[Batch], tested: list[Drift], lines: list[str]) -> str:
    """batches.html: what the tests say, the chart, the table."""
    from twin.drawing.fitplots import drift_chart  # loads matplotlib
    from twin.report.page import Picture, table_page

    courses = _courses(batches, tested)
    chart = drift_chart([b.name for b in batches], courses) if courses else ""
    title_of = "Constants and effects over the batches,"
    charts = [Picture(title=title_of, caption=CAPTION, svg=chart)] if chart else []
    headline, *others = lines or [f"{len(batches)} batches."]
    return table_page(
        title, headline=headline, sentences=others, pictures=charts,
        tables=[
            {"title": "The batches", "head": HEAD,
             "rows": [row for b in batches for row in _cells(b, tested, newest=b is batches[-1])],
             "note": "No interval stands where the model does not fit, or where the data leave a value open."}
        ],
    )  # fmt: skip


HEAD = ["batch", "quantity", "value", "95 % interval", "unit", "verdict"]
CAPTION = (
    "with 95 % intervals (hollow: no interval). Grey: the 95 % range that the former batches predict."
)


def _courses(batches: list[Batch], tested: list[Drift]) -> list["DriftCourse"]:
    from twin.drawing.fitplots import DriftCourse

    names = list(dict.fromkeys(v.name for b in batches for v in b.values))
    test = {d.name: d for d in tested}
    courses = []
    for name in names:
        values = [b.value(name) for b in batches]
        spans = [(v.span if v is not None else None) or (math.nan, math.nan) for v in values]
        d = test.get(name)
        courses.append(
            DriftCourse(
                name=name, unit=next(v.unit for v in values if v is not None),
                values=np.array([math.nan if v is None else v.value for v in values]),
                low=np.array([s[0] for s in spans]), high=np.array([s[1] for s in spans]),
                expected=None if d is None else (d.found.low, d.found.high), differs=bool(d and d.differs),
            )
        )  # fmt: skip
    return courses


def _cells(batch: Batch, tested: list[Drift], *, newest: bool) -> list[dict[str, Any]]:
    """The rows of a batch; those in which the newest differs stand out."""
    changed = {d.name for d in tested if d.differs} if newest else set()
    if batch.problem:
        return [{"cells": [batch.name, "", "", "", "", batch.problem]}]
    spans = ["–" if v.span is None else interval(*v.span) for v in batch.values]
    return [
        {
            "cells": [batch.name, v.name, short(v.value), span, v.unit, batch.verdict],
            "named": v.name in changed,
        }
        for v, span in zip(batch.values, spans, strict=True)
    ]
