"""The command `twin recalibrate`: a project, or all batches of a folder.

Batches come one after the other, as their reports read the earlier ones. On a cluster those that wait for no
other are worked on at a time, up to the report; then they come one after the other all the same.
"""

import platform
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from twin import files
from twin.batches.series import Opened, batches_in, holds_batches
from twin.commands import recalibrate
from twin.executors.local import Processes, Serial, current
from twin.files import lock
from twin.messages import Lines, Say
from twin.project.folder import Project
from twin.table import DataTable


def run_recalibrate(folder: Path, say: Say) -> dict[str, Any]:
    """Recalibrate the project in a folder, or every batch where its subfolders are projects."""
    return recalibrate_all(folder, say) if holds_batches(folder) else _recalibrated(Project.open(folder), say)


def recalibrate_all(folder: Path, say: Say, *, opened: Opened = Project.open) -> dict[str, Any]:
    """Recalibrate every batch of a folder, go on after one that fails, and say a table of all at the end.

    opened: turns a project folder into its project.
    """
    rows = []
    with lock(folder / ".lock", "recalibrate"):
        batches = batches_in(folder)
        if not isinstance(current(), Processes | Serial):  # here, solves have all processors as it is
            _together(batches, say, opened)
        for number, batch in enumerate(batches, 1):
            say(f"[{number}/{len(batches)}] {batch.name}")
            rows.append({"batch": batch.name} | _one(batch, say, opened))
    failed = [row["batch"] for row in rows if row["status"] != "done"]
    for line in _table(rows):
        say(line)
    if failed:
        say(f"{len(failed)} of {len(rows)} batches failed: {', '.join(failed)}.")
    return {"stage": "recalibrate", "folder": str(folder), "batches": rows, "failed": failed}


def _together(batches: list[Path], say: Say, opened: Opened) -> None:
    """Run all but the reports, several batches at a time, on the workers of the executor in use."""
    done = 0
    for group in _groups(batches, opened):
        for k, lines in current().ended([partial(_elsewhere, batch.resolve(), opened) for batch in group]):
            done += 1
            for line in lines:
                say(f"{group[k].name}: {line}")
            say.progress("batches", done, len(batches))


def _groups(batches: list[Path], opened: Opened) -> Iterator[list[Path]]:
    """Batches that can be worked on at a time: first those made like none of the others, then those made like
    these, and so on. What cannot be opened is left out: its turn tells why."""
    like: dict[Path, Path | None] = {}
    for batch in batches:
        try:
            project = opened(batch)
        except files.UNREADABLE:
            continue
        former = project.config.project.like
        like[batch] = project.path(former).resolve() if former else None
    waiting = list(like)
    while waiting:
        waited = {batch.resolve() for batch in waiting}
        group = [batch for batch in waiting if like[batch] not in waited] or waiting  # in a circle: all
        yield group
        waiting = [batch for batch in waiting if batch not in group]


def _elsewhere(batch: Path, opened: Opened) -> list[str]:
    """On a worker: what the stages of a batch say. What fails is told, and once more in the batch's turn."""
    say = Lines()
    if not (batch / "twin.toml").is_file():
        return [f"not on a disk that worker {platform.node()} sees, so it is worked on here in its turn"]
    try:
        project = opened(batch)
        with project.lock("recalibrate"):
            recalibrate.run_stages(project, say, recalibrate.ALONE)
    except Exception as error:
        return [*say.lines, f"stopped: {error}"]
    return say.lines


def _one(batch: Path, say: Say, opened: Opened) -> dict[str, Any]:
    """Result of a batch; a failure is a row of the table, not the end."""
    try:
        return {"status": "done"} | _recalibrated(opened(batch), say)
    except Exception as error:
        foreseen = isinstance(error, ValueError | OSError)
        sentence = str(error) if foreseen else f"internal error: {type(error).__name__}: {error}"
        say(f"failed: {sentence}")
        return {"status": "failed", "error": sentence}


def _recalibrated(project: Project, say: Say) -> dict[str, Any]:
    """Result of a project, locked meanwhile."""
    for sentence in project.remarks:
        say(sentence)
    with project.lock("recalibrate"):
        return recalibrate.run_recalibrate(project, say)


def _table(rows: list[dict[str, Any]]) -> list[str]:
    """A line a batch: its name, what ran, and the verdict, or why it failed."""
    cells = [(row["batch"], _state(row), row.get("verdict") or row.get("error")) for row in rows]
    return DataTable(("batch", "", "verdict"), cells).lines()


def _state(row: dict[str, Any]) -> str:
    if row["status"] != "done":
        return "failed"
    ran = "done" in row["stages"].values()
    return "recalibrated" if ran else "fresh"
