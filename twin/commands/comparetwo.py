"""Two batches, or two models of one, on one page: what differs, constants, verdicts, errors, pictures."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twin import files
from twin.batches.castings import Casting, casting
from twin.batches.series import Opened
from twin.batches.side import Laid, write_side_by_side
from twin.batches.values import BatchChange, BatchValue, changes_of, values_of
from twin.bench.fits import fit_file, newest
from twin.bench.modeldifferences import other_effects, other_models, same_films
from twin.diagnosis.diagnosisrecord import NONE, DiagnosisRecord
from twin.judging.fitrecord import ComparisonRecord, FitRecord
from twin.messages import Say
from twin.numerals import interval, short
from twin.project.folder import Project
from twin.report.page import Picture, table_page

NOTHING = Casting(sentences=())
SHOWN = {"overlay.png": "the film with its markers", "deformed.png": "the model at the highest pressure"}


def run_side_by_side(two: Sequence[Path], say: Say, *, opened: Opened = Project.open) -> dict[str, Any]:
    """Lay two project folders, or run folders with a fit.json, side by side: a page and a recording in the
    present folder."""
    if len(two) != 2:
        raise ValueError(
            f"folders to compare: {len(two)}; wanted two, as in `twin compare batch-07 batch-08`"
        )
    a, b = (side_of(path, opened) for path in two)
    changes = changes_of(a.values, b.values)
    effects = other_effects(a.project, a.record, b.project, b.record)
    films = same_films((a.project, b.project)) if a.project.root != b.project.root else ()
    apart = casting(a.project, a.record, b.project, say) if a.project.root != b.project.root else NOTHING
    models = other_models(a.project, b.project)
    sentences = [*apart.sentences, *models, *films, *(c.words for c in changes), *effects]
    page = Path(f"compare-{_plain(a.name)}-{_plain(b.name)}.html")
    replaced = " in place of the former one" if page.exists() else ""
    files.write_text(page, _page(a, b, changes, sentences))
    for line in (f"{a.name} is before, {b.name} is now.", *sentences):
        say(line)
    merged = write_side_by_side(page.with_suffix(".rrd"), (a, b))
    if merged is None:
        say("No recording of both: each needs a review; `twin review` or `twin recalibrate` writes it.")
    else:
        say(f"Both in one recording: rerun {merged}")
    say(f"Wrote {page}{replaced}.")
    return {
        "stage": "compare", "before": a.name, "after": b.name, "page": str(page),
        "recording": None if merged is None else str(merged),
        "changes": [{"name": c.name, "before": c.before, "after": c.after, "low": c.low, "high": c.high,
                     "unit": c.unit, "known": c.known, "note": c.note} for c in changes],
        "differs": apart.plain,
    }  # fmt: skip


def side_of(path: Path, opened: Opened = Project.open) -> Laid:
    """The newest fit of a project, or the fit of a run folder, for the page. ValueError without one."""
    folder = path.resolve()
    if (folder / "twin.toml").is_file() and not (folder / "run.json").is_file():
        project = opened(folder)
        file = fit_file(project)
        name = folder.name
    elif (folder / "fit.json").is_file() and folder.parent.name == "runs":
        project, file = opened(folder.parent.parent), folder / "fit.json"
        name = f"{project.root.name}/{folder.name}"
    else:
        raise ValueError(f"{path}: neither a project nor a run with a fit.json; wanted for example batch-07 "
                         "or batch-07/runs/0003-calibrate")  # fmt: skip
    record, compared = files.read(FitRecord, file), file.with_name(ComparisonRecord.file)
    return Laid(
        name=name, project=project, record=record, values=values_of(record),
        comparison=files.read(ComparisonRecord, compared) if compared.is_file() else None,
        verdict=(newest(project, DiagnosisRecord) or NONE).verdict,
        run=None if name == folder.name else folder,
    )  # fmt: skip


def _page(a: Laid, b: Laid, changes: Sequence[BatchChange], sentences: Sequence[str]) -> str:
    different = [c.name for c in changes if c.known]
    verb = "differs" if len(different) == 1 else "differ"
    finding = f"{' and '.join(different)} {verb}" if different else "no difference is proven"
    headline = f"{b.name} beside {a.name}: {finding}"
    return table_page(
        f"{a.name} and {b.name}", headline=headline + ".", sentences=sentences,
        tables=[_constants(a, b, set(different)), _fits(a, b), _maps(a, b, "marker"), _maps(a, b, "branch")],
        pictures=[row for name, what in SHOWN.items() for row in _pictures(a, b, name, what)],
    )  # fmt: skip


def _constants(a: Laid, b: Laid, changed: set[str]) -> dict[str, Any]:
    """Every quantity of either, its value and interval on both sides."""
    by_name: list[dict[str, BatchValue]] = [{v.name: v for v in side.values} for side in (a, b)]
    rows = []
    for name in dict.fromkeys([*by_name[0], *by_name[1]]):
        values = [side.get(name) for side in by_name]
        unit = next(v.unit for v in values if v is not None)
        rows.append({"cells": [name, *(_cell(v) for v in values), unit], "named": name in changed})
    note = "In brackets the 95 % interval. A dash: not in this model."
    head = ["", a.name, b.name, "unit"]
    return {"title": "Constants and effects", "head": head, "rows": rows, "note": note}


def _cell(v: BatchValue | None) -> str:
    if v is None:
        return "–"
    span = "no interval" if v.span is None else interval(*v.span)
    return f"{v.value:.4g} ({span})"


def _fits(a: Laid, b: Laid) -> dict[str, Any]:
    """Table of verdict, effects and error of both models."""
    both = (a, b)
    rows: list[list[str]] = [
        ["verdict", *(s.verdict for s in both)],
        ["effects in the model", *(", ".join(s.record.effects) or "none" for s in both)],
        ["error, RMS mm", *(short(s.comparison and s.comparison.raw_rms_mm) for s in both)],
        ["expected of noise and shared errors, mm",
         *(short(s.comparison and s.comparison.expected_mm) for s in both)],
        ["error without shared errors, RMS mm", *(short(s.comparison and s.comparison.rms_mm) for s in both)],
        ["noise, mm", *(short(s.comparison and s.comparison.noise_sd_mm) for s in both)],
    ]  # fmt: skip
    cells = [{"cells": row} for row in rows]
    return {"title": "How well it fits", "head": ["", a.name, b.name], "rows": cells}


def _maps(a: Laid, b: Laid, kind: str) -> dict[str, Any]:
    """The error by marker or branch on both sides."""
    maps = [s.comparison.maps if s.comparison else {} for s in (a, b)]
    errors = [{row.name: row.rms_mm for row in every.get(kind, ())} for every in maps]
    names = list(dict.fromkeys([*errors[0], *errors[1]]))
    rows = [{"cells": [name, *(short(side.get(name)) for side in errors)]} for name in names]
    title = f"Error by {kind} without shared errors, RMS mm"
    return {"title": title, "head": ["", a.name, b.name], "rows": rows}


def _pictures(a: Laid, b: Laid, file: str, what: str) -> list[Picture]:
    """A picture of both, beside each other."""
    paths = [(s.name, s.project.newest(None, file)) for s in (a, b)]
    return [Picture(title=f"{name}:", caption=what, half=True, png=path) for name, path in paths if path]


def _plain(name: str) -> str:
    """A name as a part of a file's name."""
    return name.replace("/", "-")
