"""The study stage: what a calibration by two points has found, as the reference study published its own.

Its seven figures, its table, the ridge along which C10 and C01 trade off, and the readings that would tell
them apart. Without a calibration that still holds it calibrates first, and it ends with the report.
"""

from typing import Any

from twin import files
from twin.bench.engines import check_embedded
from twin.bench.fits import fresh
from twin.bench.workbench import law_of_project
from twin.commands.calibrate import run_calibrate
from twin.commands.review import run_review
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.messages import Say
from twin.project.folder import Project
from twin.study.figures import FIGURES, drawn, file_of
from twin.study.numbers import Inquiry


def run_study(project: Project, say: Say) -> dict[str, Any]:
    """study.json and the study's seven figures; ValueError where the project has no such study."""
    check_embedded(project, "twin study")
    _check(project)
    if fresh(project, ("calibrate",), "candidates.npz") is None:
        run_calibrate(project, say)
    maker = Inquiry.of(project, say)
    with project.new_run("study") as run:
        found = maker.study().told([file_of(name) for name in FIGURES])
        run.write(found)
        for name, text in drawn(maker.generations, maker.candidates, found).items():
            run.write_text(file_of(name), text + "\n")
        run.summary["headline"] = found.headline
    say(found.headline)
    for sentence in found.sentences:
        say(sentence)
    names = ", ".join(FIGURES)
    say(f"Wrote {project.shown(run.folder)}/{found.file} and figures {names} (figure-5a.svg ..).")
    run_review(project, say)
    return {"stage": "study", "run": run.name} | files.plain(found)


def _check(project: Project) -> None:
    """Raise ValueError where the seven figures cannot be made of a project."""
    config = project.config
    if (law := law_of_project(project)) != MOONEY_RIVLIN:
        raise ValueError(
            f'model.law = "{law.name}": twin study shows how the constants of {MOONEY_RIVLIN.title} rubber '
            f'trade off; set law = "{MOONEY_RIVLIN.name}" in twin.toml'
        )
    if config.model.fixed:
        raise ValueError(
            f"model.fixed holds {', '.join(config.model.fixed)}: twin study shows how C10 and C01 trade "
            "off, so both must be free; set fixed = {} in twin.toml"
        )
    points = config.calibrate.objective_points
    if len(points) != 2:
        raise ValueError(
            f"calibrate.objective_points = {list(points)}: figures 6a and 6b are of two points; name two "
            "in twin.toml"
        )
