"""The study stage: what a calibration by two points has found, as the reference study published its own.

Its seven figures, its table, the ridge along which C10 and C01 trade off, and the readings that would tell
them apart. Without a calibration that still holds it calibrates first, and it ends with the report.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin.bench.fits import fresh
from twin.commands.calibrate import run_calibrate
from twin.commands.review import run_review
from twin.drawing import studyplots
from twin.project.folder import Project, Run, Say
from twin.report.figures import FIGURES
from twin.report.found import STUDY
from twin.review.states import Generations
from twin.study.numbers import Inquiry
from twin.study.record import Study
from twin.targets import Array


def file_of(figure: str) -> str:
    """The file of a figure in its run."""
    return f"figure-{figure}.svg"


def run_study(project: Project, say: Say) -> dict[str, Any]:
    """study.json and the study's seven figures; ValueError where the project has no such study."""
    _check(project)
    if fresh(project, ("calibrate",), "candidates.npz") is None:
        run_calibrate(project, say)
    maker = Inquiry.of(project, say)
    with project.new_run("study") as run:
        found = maker.study()
        record = found.to_dict() | {"figures": [file_of(name) for name in FIGURES]}
        run.write_json(STUDY, record)
        _draw(run, maker.generations, maker.candidates, found)
        run.summary["headline"] = found.headline
    say(found.headline)
    for sentence in found.sentences:
        say(sentence)
    say(f"Wrote {project.shown(run.folder)}/{STUDY} and figures {', '.join(FIGURES)} (figure-5a.svg ..).")
    run_review(project, say)
    return {"stage": "study", "run": run.name} | record


def _check(project: Project) -> None:
    """Raise ValueError where the seven figures cannot be made of a project."""
    config = project.config
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


def _draw(run: Run, g: Generations, candidates: Mapping[str, Array], found: Study) -> None:
    """Write the seven figures."""
    for name, text in drawn(g, candidates, found).items():
        run.write_text(file_of(name), text + "\n")


def drawn(g: Generations, candidates: Mapping[str, Array], found: Study) -> dict[str, str]:
    """The seven figures by name, each an SVG text."""
    u, marks = f"U{found.component + 1}", {"genetic algorithm": found.final, "least squares": found.least}
    others = {"published": found.published, "initial": found.initial}
    models = marks | {name: side for name, side in others.items() if side}
    places = {name: np.array([[side.constants.C10], [side.constants.C01]]) for name, side in models.items()}
    labels = [c.name if c.node is None else f"{c.name} (node {c.node})" for c in found.curves]
    over_pressure = [
        studyplots.against_pressure(
            found.pressure, initial_mm=c.initial, final_mm=c.final, read_at=c.read_at, read_mm=c.read,
            read_sd_mm=c.read_sd, title=label, component=u,
        )
        for c, label in zip(found.curves, labels, strict=True)
    ]  # fmt: skip
    errors = [np.abs(side.u_mm - found.measured) for side in (found.initial, found.final)]
    texts = [
        studyplots.best_error(g.generation, rms_mm=g.rms_mm, initial_mm=found.initial.rms_mm),
        studyplots.best_constants(g.generation, best=g.best, names=g.names),
        studyplots.valley(candidates["x"], rms_mm=candidates["rms_mm"], ridge=found.ridge.constants,
                          marks=places, names=g.names),
        *over_pressure,
        studyplots.end_values(labels, measured=found.measured, initial=found.initial.u_mm,
                              final=found.final.u_mm, component=u),
        studyplots.end_errors(labels, initial=errors[0], final=errors[1], sd_mm=found.sd_mm, component=u),
    ]  # fmt: skip
    return dict(zip(FIGURES, texts, strict=True))
