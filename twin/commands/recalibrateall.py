"""The command `twin recalibrate`: a project, or all batches of a folder one after the other."""

from pathlib import Path
from typing import Any

from twin.batches.order import Opened, batches_in, holds_batches
from twin.commands import recalibrate
from twin.project.folder import Project, Say
from twin.project.locks import lock


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
        for number, batch in enumerate(batches, 1):
            say(f"[{number}/{len(batches)}] {batch.name}")
            rows.append({"batch": batch.name} | _one(batch, say, opened))
    failed = [row["batch"] for row in rows if row["status"] != "done"]
    for line in _table(rows):
        say(line)
    if failed:
        say(f"{len(failed)} of {len(rows)} batches failed: {', '.join(failed)}.")
    return {"stage": "recalibrate", "folder": str(folder), "batches": rows, "failed": failed}


def _one(batch: Path, say: Say, opened: Opened) -> dict[str, Any]:
    """What came of a batch; a failure is a row of the table, not the end."""
    try:
        return {"status": "done"} | _recalibrated(opened(batch), say)
    except Exception as error:
        known = isinstance(error, ValueError | OSError)
        sentence = str(error) if known else f"internal error: {type(error).__name__}: {error}"
        say(f"failed: {sentence}")
        return {"status": "failed", "error": sentence}


def _recalibrated(project: Project, say: Say) -> dict[str, Any]:
    """What came of a project, which no other command may write to meanwhile."""
    for sentence in project.remarks:
        say(sentence)
    with project.lock("recalibrate"):
        return recalibrate.run_recalibrate(project, say)


def _table(rows: list[dict[str, Any]]) -> list[str]:
    """A line a batch: its name, what ran, and the verdict, or why it failed."""
    width = max(len(row["batch"]) for row in rows)
    return [f"{row['batch']:<{width}}  {_state(row):<13}  {row.get('verdict') or row.get('error')}"
            for row in rows]  # fmt: skip


def _state(row: dict[str, Any]) -> str:
    if row["status"] != "done":
        return "failed"
    ran = "done" in row["stages"].values()
    return "recalibrated" if ran else "fresh"
