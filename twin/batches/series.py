"""The constants of a batch beside those of the batches before it: what the report says of the series."""

from pathlib import Path
from typing import Any

from twin import files
from twin.batches.former import former_of
from twin.batches.order import batches_in
from twin.batches.values import BatchValue, changes_of, values_of
from twin.bench.fits import fit_file
from twin.judging.fitrecord import FitRecord
from twin.numerals import interval
from twin.project.folder import Project

SHOWN = 6  # batches at most, the last ones: a wider table is read in `twin batches`


def earlier_facts(project: Project, record: FitRecord) -> dict[str, Any] | None:
    """A table of the constants of this batch's fit and of the earlier ones, and what has changed against the
    last of them; None without one."""
    found = {path.name: values for path in _before(project) if (values := _values(path)) is not None}
    if not found:
        return None
    own = values_of(record)
    shown = dict(list(found.items())[-SHOWN:])
    like = _like(project)
    last = like if like in shown else list(shown)[-1]
    changes = changes_of(shown[last], own)
    sides = [{v.name: v for v in values} for values in (*shown.values(), own)]
    rows = [
        {"name": name, "unit": next(s[name].unit for s in sides if name in s),
         "cells": [_cell(side.get(name)) for side in sides],
         "changed": any(c.known and c.name == name for c in changes)}
        for name in dict.fromkeys(v.name for values in (*shown.values(), own) for v in values)
    ]  # fmt: skip
    return {"batches": [*shown, project.root.name], "rows": rows, "beside": last,
            "sentences": [c.words for c in changes]}  # fmt: skip


def _before(project: Project) -> list[Path]:
    """The folders of earlier batches, the oldest first: those that twin.toml and its former ones name under
    like, and neighbours of the same points whose names come before."""
    found: list[Path] = []
    one = project
    while (former := _former(one)) is not None and former.root not in [project.root, *found]:
        found.append(former.root)
        one = former
    beside = batches_in(project.root.parent)
    for path in beside[: beside.index(project.root)] if project.root in beside else []:
        if path not in found and _same_points(path, project):
            found.append(path)
    order = {path: k for k, path in enumerate(beside)}
    return sorted(found, key=lambda path: order.get(path, -1))


def _former(project: Project) -> Project | None:
    try:
        return former_of(project)
    except ValueError:  # it is gone, or its twin.toml is not right: recalibrate says so
        return None


def _like(project: Project) -> str | None:
    """The name of the batch that twin.toml names under like."""
    former = _former(project)
    return None if former is None else former.root.name


def _same_points(path: Path, project: Project) -> bool:
    try:
        points = Project.open(path).config.points
    except ValueError:
        return False
    return {p.name for p in points} == {p.name for p in project.config.points}


def _values(path: Path) -> tuple[BatchValue, ...] | None:
    """What the newest fit of a batch found, None where it has none that holds."""
    try:
        return values_of(files.read(FitRecord, fit_file(Project.open(path))))
    except ValueError:
        return None


def _cell(value: BatchValue | None) -> str:
    if value is None:
        return "–"
    if value.span is None:
        return f"{value.value:.4g}"
    return f"{value.value:.4g} ({interval(*value.span)})"
