"""Turn the recorded demo into a finished project: every stage in order, each skipped if it is done."""

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from twin.project import files
from twin.project.folder import Project, Say, dataset, kind_of

Stage = Callable[[Project, Say], dict[str, Any]]

TITLES = {
    "camera": "camera from images of a ChArUco board",
    "measure": "film, static film and pressure log into displacements",
    "calibrate": "genetic algorithm, then least squares",
    "compare": "where model and measurement differ",
    "diagnose": "which effect is missing",
    "add": "the named effect joins the model",
    "review": "film beside simulation, and the report",
}


def run_demo(folder: Path, say: Say) -> dict[str, Any]:
    """Copy the demo into a folder and run all stages; ValueError if the folder holds something else."""
    start = time.monotonic()
    project = copy_demo(folder, say)
    results = {}
    with project.lock("demo"):
        for number, (name, stage) in enumerate(_stages().items(), 1):
            say(f"[{number}/{len(TITLES)}] {name}: {TITLES[name]}")
            began = time.monotonic()
            results[name] = _once(project, name, stage, say)
            project = Project.open(project.root)  # add has written its effect into twin.toml
            say(f"      {time.monotonic() - began:.1f} s")
    say(f"demo: finished in {time.monotonic() - start:.0f} s")
    return {"stage": "demo", "folder": str(folder), "stages": results} | _show(project, folder, say)


def copy_demo(folder: Path, say: Say) -> Project:
    """Return the demo project in a folder: a fresh copy, or the one that was begun there."""
    source = dataset("demo")
    stamp = files.digest_of([source], root=source)
    begun = folder / "demo.json"
    if begun.is_file():
        if files.read_json(begun) != stamp:
            raise ValueError(f"{folder} is a demo of another version of the data; name another folder")
        say(f"demo: resumed in {folder}")
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(
            f"{folder} is there already and is not a demo project; name a folder that does not exist"
        )
    else:
        _copy(source, folder, stamp)
        say(f"demo: copied to {folder}")
    return Project.open(folder)


def _copy(source: Path, folder: Path, stamp: dict[str, str]) -> None:
    """Copy in one step: a killed copy leaves no half project."""
    target = folder.resolve()
    draft = target.with_name(f".{target.name}.partial")
    shutil.rmtree(draft, ignore_errors=True)
    shutil.copytree(source, draft)
    files.write_json(draft / "demo.json", stamp)
    if target.is_dir():
        target.rmdir()  # empty, as checked
    os.rename(draft, target)


def _stages() -> dict[str, Stage]:
    from twin.stages import cameras, chain, measuring

    return {
        "camera": cameras.run_camera, "measure": measuring.run_measure,
        "calibrate": chain.run_calibrate, "compare": chain.run_compare, "diagnose": chain.run_diagnose,
        "add": _add, "review": chain.run_review,
    }  # fmt: skip


def _once(project: Project, name: str, stage: Stage, say: Say) -> dict[str, Any]:
    """Run a stage unless a run of it is done; camera and measure look at their inputs themselves."""
    kind = [run for run in project.runs() if kind_of(run) == name and name not in ("camera", "measure")]
    done = [run for run in kind if project.info(run)["status"] == "done"]
    if done:
        say(f"{name}: already done in {project.shown(done[-1])}, skipped")
        return {"stage": name, "status": "skipped", "run": project.shown(done[-1])}
    return stage(project, say)


def _add(project: Project, say: Say) -> dict[str, Any]:
    """Add what the newest diagnosis named, if it is one effect."""
    from twin.stages.chain import run_add

    path = project.newest("diagnose", "diagnosis.json")
    named = files.read_json(path)["named"] if path else []
    if len(named) != 1:
        say(f"add: the diagnosis names {' or '.join(named) or 'nothing'}, so nothing is added")
        return {"stage": "add", "status": "skipped", "named": named}
    return run_add(project, named[0], say)


def _show(project: Project, folder: Path, say: Say) -> dict[str, Any]:
    """Say where the report and the recording are, and how to open them."""
    shown = {}
    for name, how in (("report.html", "open it in a browser"), ("review.rrd", "open it with: rerun {}")):
        path = project.newest(None, name)
        if path is not None:
            shown[name] = str(folder / project.shown(path))
            say(f"{name}: {shown[name]}  ({how.format(shown[name])})")
    return shown
