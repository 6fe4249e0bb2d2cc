"""Displacements that another program measured: the recordings of [[import]] -> targets, a block each."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twin.formats.basemotion import exchanged
from twin.formats.catalogue import read_recorded
from twin.formats.conversion import targets_of
from twin.formats.recorded import Recorded
from twin.formats.supplied import mm_per_unit
from twin.inputs.films import FilmTargets, joined
from twin.inputs.recordings import recorded
from twin.messages import Say
from twin.project.cameratables import RecordingTable
from twin.project.folder import Project
from twin.project.record import SourceFilm
from twin.targets import Load, Targets


def import_inputs(project: Project) -> dict[str, Any]:
    """Tables and files that a run of `measure` depends on, as `Project.new_run` takes them."""
    named = [("import.file", t.file) for t in project.config.imports]
    named += [("import.log", t.log) for t in project.config.imports if t.log]
    inputs = [path for key, pattern in named for path in recorded(project, key, pattern)]
    return {"tables": ("import", "points"), "inputs": list(dict.fromkeys(inputs))}


def import_targets(project: Project, say: Say) -> tuple[Targets, tuple[SourceFilm, ...]]:
    """The targets of the recordings, and a row a recording where there are several. ValueError where a file
    is not right, something is not stated, or the targets cannot be of the project's finger."""
    from twin.bench.workbench import check_plausible, structure_of

    tables = project.config.imports
    found = [read_recorded(project.path(t.file), t.format, t.min_likelihood) for t in tables]
    found = [_as_in(found[0], each) for each in found]
    parts: list[FilmTargets] = []
    for table, points in zip(tables, found, strict=True):
        log = None if table.log is None else project.path(table.log)
        try:
            targets, remarks = targets_of(points, table, project.config.points, log=log, parts=len(tables))
        except ValueError as error:
            raise ValueError(f"{table.name}: {error}" if len(tables) > 1 else str(error)) from None
        for sentence in remarks:
            say(f"{table.name}: {sentence}" if len(tables) > 1 else sentence)
        parts.append(_part(table, targets))
    _check_names(tables, found)
    together, rows = joined(parts)
    block = {row.name: row.block for row in rows}
    loads = [
        Load(block[t.name], load.at, load.weight_g, load.force_N) for t in tables for load in t.loads
    ]
    released = tuple(sorted(block[t.name] for t in tables if t.released))
    by_block = tuple(sorted(loads, key=lambda load: load.block))
    together = replace(together, loads=by_block, released=released)
    check_plausible(project, together, structure_of(project).case)
    return together, tuple(rows) if len(tables) > 1 else ()


def _part(table: RecordingTable, targets: Targets) -> FilmTargets:
    return FilmTargets(
        name=table.name, log=table.log or table.file, targets=targets, held_out=table.held_out,
        gravity=table.gravity, shares=table.pressure_shares,
    )  # fmt: skip


def _as_in(first: Recorded, other: Recorded) -> Recorded:
    """A recording whose points stand in the order of another one's, those that it lacks left out."""
    names = [n for n in first.names if n in other.names] + [n for n in other.names if n not in first.names]
    rows = [other.names.index(name) for name in names]
    return replace(other, names=tuple(names), position=other.position[:, rows])


def _check_names(tables: Sequence[RecordingTable], found: Sequence[Recorded]) -> None:
    """Raise ValueError where markers at rest lie where others lay in the first recording."""
    for table, each in list(zip(tables, found, strict=True))[1:]:
        alike = each.unit == found[0].unit and table.gravity == tables[0].gravity
        if not alike or table.axes != tables[0].axes or each.names != found[0].names:
            continue  # the rig was turned, or the rows are of other markers
        size = mm_per_unit(each, table)
        rests = [size * r.position[t.first_step] for t, r in ((table, each), (tables[0], found[0]))]
        seen = np.isfinite(rests[0]).any(axis=0) & np.isfinite(rests[1]).any(axis=0)
        if swapped := exchanged(*(rest[:, seen] for rest in rests)):
            a, b = (each.names[k] for k in swapped)
            raise ValueError(
                f"{table.name}: marker {a} lies at rest where {b} lies in {tables[0].name}: their names are "
                "exchanged; correct the file"
            )


def said_of_targets(targets: Targets) -> str:
    """One sentence on size and pressure of targets: a wrong unit or scale shows in it."""
    peak, top = np.nanmax(np.abs(targets.value)), targets.pressure.max()
    return (f"{len(targets.names)} points in {len(targets.time)} steps: displacements up to {peak:.1f} mm, "
            f"pressure up to {top:.3g} MPa.")  # fmt: skip
