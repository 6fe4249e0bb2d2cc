"""The study stage: seven figures, table, ridge and further readings of a calibration by two points.

Without a calibration that still holds it calibrates first, and it ends with the report.
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
from twin.study.reference import FIGURES, Reference, file_of


def run_study(project: Project, say: Say) -> dict[str, Any]:
    """study.json and the study's seven figures; ValueError where the project has no such study."""
    check_embedded(project, "twin study")
    _check(project)
    if fresh(project, ("calibrate",), "candidates.npz") is None:
        run_calibrate(project, say)
    reference = Reference.of(project, say)
    study = reference.study()
    with project.new_run("study") as run:
        run.write(study)
        for name, text in reference.figures(study).items():
            run.write_text(file_of(name), text + "\n")
        run.summary["headline"] = study.headline
    for sentence in (study.headline, *study.sentences):
        say(sentence)
    names = ", ".join(FIGURES)
    say(f"Wrote {project.shown(run.folder)}/{study.file} and figures {names} (figure-5a.svg ..).")
    run_review(project, say)
    return {"stage": "study", "run": run.name} | files.plain(study)


def _check(project: Project) -> None:
    """Raise ValueError where a project cannot give the seven figures."""
    config, points = project.config, list(project.config.objective_points)
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
    if len(points) != 2:
        raise ValueError(
            f"calibrate.objective_points = {points}: figures 6a and 6b are of two points; "
            "name two in twin.toml"
        )
