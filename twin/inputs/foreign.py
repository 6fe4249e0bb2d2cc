"""Displacements in a file of another program, as [import] of twin.toml names it, as targets."""

from typing import Any

import numpy as np

from twin.formats.importtable import ImportTable
from twin.inputs.recordings import recorded
from twin.messages import Say
from twin.project.folder import Project
from twin.targets import Targets


def import_table(project: Project) -> ImportTable:
    """[import] of twin.toml."""
    assert project.config.imported is not None  # asked for where it is there
    return project.config.imported


def import_inputs(project: Project) -> dict[str, Any]:
    """What makes a run of `measure` what it is: tables and files, as `Project.new_run` takes them."""
    stated = import_table(project)
    named = {"import.file": stated.file, "import.log": stated.log}
    inputs = [path for key, told in named.items() if told for path in recorded(project, key, told)]
    return {"tables": ("import", "points"), "inputs": inputs}


def import_targets(project: Project, say: Say) -> Targets:
    """The targets of another program's file. ValueError where it is not right, or something is not stated."""
    from twin.formats.catalogue import read_recorded
    from twin.formats.conversion import targets_of

    stated = import_table(project)
    found = read_recorded(project.path(stated.file), stated.format, stated.min_likelihood)
    log = None if stated.log is None else project.path(stated.log)
    made, remarks = targets_of(found, stated, project.config.points, log=log)
    for sentence in remarks:
        say(sentence)
    return made


def said_of_targets(targets: Targets) -> str:
    """What was read, one sentence: a wrong unit or scale shows in it."""
    peak, top = np.nanmax(np.abs(targets.value)), targets.pressure.max()
    return (f"{len(targets.names)} points in {len(targets.time)} steps: displacements up to {peak:.1f} mm, "
            f"pressure up to {top:.3g} MPa.")  # fmt: skip
