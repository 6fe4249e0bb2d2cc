"""Turn a recorded demo into a finished project: every stage in order, each skipped if it is done."""

import shutil
import time
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from twin import files
from twin.bench.fits import fresh
from twin.chain import STAGES, Stage, When
from twin.messages import Say
from twin.project.folder import Project, dataset

FULL, QUICK = "demo", "quick"  # data sets
FOLDERS = {FULL: Path("softtwin-demo"), QUICK: Path("softtwin-quick")}


def run_demo(
    folder: Annotated[Path | None, Argument(
        default_factory=lambda: None, show_default=False,
        help="project folder to make; else softtwin-demo, or softtwin-quick with --quick")],
    say: Say,
    *,
    quick: Annotated[bool, Option(
        "--quick", help="8 s of film of a short finger, in place of the full demo")] = False,
) -> dict[str, Any]:
    """Results of all stages on a copy of a demo.

    ValueError if the folder holds something else.
    """
    start, name = time.monotonic(), QUICK if quick else FULL
    folder = folder or FOLDERS[name]
    project = copy_demo(folder, say, name=name)
    results = {}
    with project.lock("demo"):
        stages = [stage for stage in STAGES if stage.when is not When.ASKED]
        for number, stage in enumerate(stages, 1):
            say(f"[{number}/{len(stages)}] twin {stage.name}: {stage.title}")
            results[stage.name] = _once(project, stage, say)
            project = Project.open(project.root)  # add has written its effect into twin.toml
    say(f"Finished in {time.monotonic() - start:.0f} s.")
    return {"stage": "demo", "folder": str(folder), "stages": results} | _show(project, folder, say)


def copy_demo(folder: Path, say: Say, *, name: str = FULL) -> Project:
    """The demo project of a data set in a folder: a fresh copy, or the one that was begun there."""
    source = dataset(name)
    stamp = {"data": name, "files": files.digest_of([source], root=source)}
    begun = folder / "demo.json"
    if begun.is_file():
        there = files.read_json(begun)
        data = there.get("data", name)
        if data != name:
            remedy = "add" if data == QUICK else "leave out"
            raise ValueError(
                f"{folder} is begun with datasets/{data}, wanted datasets/{name}: name another folder, or "
                f"{remedy} --quick to go on there"
            )
        if there != stamp:
            raise ValueError(f"{folder} is a demo of another version of the data; name another folder")
        say(f"Going on in {folder}.")
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(
            f"{folder} is there already and is not a demo project; name a folder that does not exist"
        )
    else:
        _copy(source, folder, stamp)
        say(f"Copied the demo to {folder}.")
    return Project.open(folder)


def _copy(source: Path, folder: Path, stamp: dict[str, Any]) -> None:
    """Copy in one step: a killed copy leaves no half project."""
    with files.whole_folder(folder.resolve()) as draft:
        shutil.copytree(source, draft, dirs_exist_ok=True)
        files.write_json(draft / "demo.json", stamp)


def _once(project: Project, stage: Stage, say: Say) -> dict[str, Any]:
    """Run a stage unless it is done, which some stages find out themselves."""
    done = None if stage.skips else fresh(project, (stage.name,))
    if done is None:
        return stage.run(project, say)
    say(f"Already done in {project.shown(done.parent)}, skipped.")
    return {"stage": stage.name, "status": "skipped", "run": project.shown(done.parent)}


def _show(project: Project, folder: Path, say: Say) -> dict[str, Any]:
    """Say where the report and the recording are, and how to open them."""
    paths = {}
    for name, how in (("report.html", "open {} in a browser"), ("review.rrd", "rerun {}")):
        path = project.newest(None, name)
        if path is not None:
            paths[name] = str(folder / project.shown(path))
            say(f"{name}: {how.format(paths[name])}")
    return paths
