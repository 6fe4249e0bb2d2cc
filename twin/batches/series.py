"""The projects below a folder, one a batch, in the order of their names; and the constants of a batch beside
those of earlier ones, for the report."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from twin import files
from twin.batches.former import former_of
from twin.batches.values import BatchValue, changes_of, values_of
from twin.bench.fits import fit_file
from twin.judging.fitrecord import FitRecord
from twin.numerals import interval
from twin.project.folder import Project


def batches_in(folder: Path) -> list[Path]:
    """The project folders below a folder, in the order of their names (batch-9 before batch-10)."""
    folders = [path.parent for path in folder.glob("*/twin.toml")]
    return sorted(
        (path for path in folders if not path.name.startswith(".")), key=lambda path: _natural(path.name)
    )


def holds_batches(folder: Path) -> bool:
    """True for a folder that is no project itself and has projects below it."""
    return not (folder / "twin.toml").is_file() and bool(batches_in(folder))


def _natural(name: str) -> list[tuple[int, int, str]]:
    """A key by which numbers in a name count as numbers."""
    parts = re.findall(r"\d+|\D+", name)
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


Opened = Callable[[Path], Project]


SHOWN = 6  # batches at most, the last ones: a wider table is read in `twin batches`


def earlier_facts(project: Project, record: FitRecord) -> dict[str, Any] | None:
    """Table of the constants of this batch and of earlier ones, with the changes against the last of them.

    None without an earlier batch.
    """
    batches = {path.name: values for path in _before(project) if (values := _values(path)) is not None}
    if not batches:
        return None
    present = values_of(record)
    latest = dict(list(batches.items())[-SHOWN:])
    like = _like(project)
    last = like if like in latest else list(latest)[-1]
    changes = changes_of(latest[last], present)
    columns = (*latest.values(), present)
    sides = [{v.name: v for v in values} for values in columns]
    rows = [
        {"name": name, "unit": next(s[name].unit for s in sides if name in s),
         "cells": [_cell(side.get(name)) for side in sides],
         "changed": any(c.known and c.name == name for c in changes)}
        for name in dict.fromkeys(v.name for values in columns for v in values)
    ]  # fmt: skip
    return {"batches": [*latest, project.root.name], "rows": rows, "beside": last,
            "sentences": [c.words for c in changes]}  # fmt: skip


def _before(project: Project) -> list[Path]:
    """Folders of earlier batches, the oldest first.

    They are the chain of batches under `like` in twin.toml, and neighbours with equal points whose names come
    before.
    """
    earlier: list[Path] = []
    batch = project
    while (former := _former(batch)) is not None and former.root not in [project.root, *earlier]:
        earlier.append(former.root)
        batch = former
    beside = batches_in(project.root.parent)
    for path in beside[: beside.index(project.root)] if project.root in beside else []:
        if path not in earlier and _same_points(path, project):
            earlier.append(path)
    order = {path: k for k, path in enumerate(beside)}
    return sorted(earlier, key=lambda path: order.get(path, -1))


def _former(project: Project) -> Project | None:
    try:
        return former_of(project)
    except files.UNREADABLE:  # it is gone, or its twin.toml is not right: recalibrate says so
        return None


def _like(project: Project) -> str | None:
    """The name of the batch that twin.toml names under like."""
    former = _former(project)
    return None if former is None else former.root.name


def _same_points(path: Path, project: Project) -> bool:
    try:
        points = Project.open(path).config.points
    except files.UNREADABLE:
        return False
    return {p.name for p in points} == {p.name for p in project.config.points}


def _values(path: Path) -> tuple[BatchValue, ...] | None:
    """Constants of the newest fit of a batch, None without one."""
    try:
        return values_of(files.read(FitRecord, fit_file(Project.open(path))))
    except files.UNREADABLE:
        return None


def _cell(value: BatchValue | None) -> str:
    if value is None:
        return "–"
    if value.span is None:
        return f"{value.value:.4g}"
    return f"{value.value:.4g} ({interval(*value.span)})"
