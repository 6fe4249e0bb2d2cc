"""The runs of a project: when each was made, how it ended, what it found, and whether it is stale."""

from collections.abc import Mapping
from typing import Any

from twin.bench.fits import stale
from twin.messages import Say
from twin.project.folder import Project
from twin.project.record import RunRecord


def run_list(project: Project, say: Say) -> dict[str, Any]:
    """Say the runs, oldest first, and return them."""
    rows = [
        {"run": run.name} | _row(project.info(run)) | {"stale": "; ".join(stale(project, run))}
        for run in project.runs()
    ]
    for row in rows:
        for line in _lines(row):
            say(line)
    if not rows:
        say("no runs yet: `twin check` names the next command")
    return {"stage": "list", "runs": rows}


def _row(info: RunRecord) -> dict[str, Any]:
    return {
        "status": info.status, "started": (info.started or ("",))[-1][:19], "seconds": info.seconds,
        "headline": info.summary.headline,
    }  # fmt: skip


def _lines(row: Mapping[str, Any]) -> list[str]:
    """A line of the run, then what it found and why it is stale, each whole on a line of its own."""
    took = "" if row["seconds"] is None else f"{row['seconds']:.1f} s"
    head = f"{row['run']:<16} {row['status']:<8} {row['started'].replace('T', ' '):<20} {took}".rstrip()
    stale_line = f"stale: {row['stale']}" if row["stale"] and row["status"] == "done" else ""
    return [head, *(f"    {line}" for line in (row["headline"], stale_line) if line)]
