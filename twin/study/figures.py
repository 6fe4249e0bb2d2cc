"""The record of a study and the search it began with -> the seven figures of the reference study."""

from collections.abc import Mapping

import numpy as np

from twin.drawing import studyplots
from twin.drawing.studyplots import FINAL, INITIAL
from twin.review.states import Generations
from twin.study.record import Study
from twin.targets import Array

FIGURES = {  # and what each shows
    "5a": "Best RMS error of every generation of the genetic algorithm.",
    "5b": "Constants of the best candidate. Their sum settles before they do.",
    "5c": "Error of all candidates. Along the ridge the error hardly changes.",
    "6a": "Displacement against pressure, first point.",
    "6b": "Displacement against pressure, second point.",
    "6c": "Displacements at the top pressure.",
    "6d": "Absolute errors at the top pressure, before and after.",
}


def file_of(figure: str) -> str:
    """The file of a figure in its run."""
    return f"figure-{figure}.svg"


def drawn(g: Generations, candidates: Mapping[str, Array], found: Study) -> dict[str, str]:
    """The seven figures by name, each an SVG text. candidates: x (m, 2) MPa and rms_mm (m,)."""
    u, points, pressure = f"U{found.component}", found.curves.points, np.array(found.curves.pressure_MPa)
    sides = {"genetic algorithm": found.final, "least squares": found.least_squares,
             "published": found.published, "initial": found.initial}  # fmt: skip
    labels, totals = [c.label for c in points], np.array(found.ridge.total_MPa)
    over_pressure = [
        studyplots.against_pressure(
            pressure, models={INITIAL: np.array(c.initial_mm), FINAL: np.array(c.final_mm)},
            read_at=np.array(c.measured_at_MPa), read_mm=np.array(c.measured_mm),
            read_sd_mm=np.array(c.measured_sd_mm), title=c.label, component=u,
        )
        for c in points
    ]  # fmt: skip
    measured, initial, final = map(np.array, (found.measured_mm, found.initial.u_mm, found.final.u_mm))
    texts = [
        studyplots.best_error(g.generation, rms_mm=g.rms_mm, initial_mm=found.initial.rms_mm),
        studyplots.best_constants(g.generation, best=g.best, names=g.names),
        studyplots.valley(
            candidates["x"], rms_mm=candidates["rms_mm"], names=g.names,
            marks={name: np.array([side.C10, side.C01]) for name, side in sides.items() if side},
            ridge=np.stack([(1 - np.array(found.ridge.share)) * totals, found.ridge.share * totals], axis=1),
        ),
        *over_pressure,
        studyplots.end_values(labels, measured=measured, initial=initial, final=final, component=u),
        studyplots.end_errors(labels, initial=np.abs(initial - measured), final=np.abs(final - measured),
                              sd_mm=found.measured_sd_mm, component=u),
    ]  # fmt: skip
    return dict(zip(FIGURES, texts, strict=True))
