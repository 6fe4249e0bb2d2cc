"""The pictures of the report, each with its title, its caption and its place."""

from typing import Any

import numpy as np

from twin.drawing import plots, studyplots
from twin.project import files
from twin.report.found import CHANGES, Story
from twin.report.heldoutrows import held_out_pictures
from twin.study.figures import FIGURES, file_of
from twin.study.record import page_facts
from twin.targets import Array


def pictures_of(story: Story) -> list[dict[str, Any]]:
    return [
        *_drawn(story, "error", place="top"), *_deformed(story), *_overlaid(story),
        *_drawn(story, "residuals", place="where"), *held_out_pictures(story),
        *_drawn(story, "evidence", place="evidence"),
        *_over_time(story), *_search(story),
    ]  # fmt: skip


def study_facts(story: Story) -> dict[str, Any] | None:
    """The tables and the seven figures of the study, where there is one."""
    if story.study_file is None:
        return None
    drawn = [
        _picture(f"Figure {name}.", FIGURES[name], half=True,
                 svg=story.study_file.with_name(file_of(name)).read_text(encoding="utf-8"))
        for name in FIGURES
    ]  # fmt: skip
    return page_facts(story.study) | {"pictures": drawn}


def _drawn(story: Story, name: str, *, place: str) -> list[dict[str, Any]]:
    """A picture of the way to the model of now, where there is one."""
    law = story.way.evidence.get("effect", "")
    said = {
        "error": ("How the error fell", "RMS of all markers. Pale: what the next step takes off.", True),
        "evidence": (
            f"What speaks for {law}",
            f"The residual without {law}, what {law} explains of it, and what it leaves.",
            False,
        ),
        "residuals": (
            "Measured minus model by marker and time",
            "Without the errors (scale, placement, mesh) that many values share.",
            False,
        ),
    }
    title, caption, half = said[name]
    svg = story.way.pictures.get(name)
    return [_picture(title, caption, half=half, svg=svg, place=place)] if svg else []


def _deformed(story: Story) -> list[dict[str, Any]]:
    """The finger at top pressure, where it could be drawn."""
    file = story.run.path("deformed.png")
    caption = "Best model of the genetic algorithm, and the measured markers."
    if not file.exists():
        return []
    return [_picture("Model at top pressure", caption, half=True, png=file, place="top")]


def _overlaid(story: Story) -> list[dict[str, Any]]:
    """The film at the worst moment with the models over it."""
    if story.footage is None:
        return []
    return [_picture("The worst moment", story.footage.caption, png=story.footage.worst, place="top")]


def _search(story: Story) -> list[dict[str, Any]]:
    """The genetic algorithm by generation and, of two constants, its valley; the study has its own."""
    g = story.generations
    if story.study:
        return []
    error = studyplots.best_error(g.generation, rms_mm=g.rms_mm)
    constants = studyplots.best_constants(g.generation, best=g.best, names=g.names)
    out = [
        _picture("Genetic algorithm", "Best RMS error of every generation.", half=True, svg=error),
        _picture("Constants of the best", "By generation.", half=True, svg=constants),
    ]
    if len(g.names) == 2:
        found, best = files.read_npz(story.file("calibrate", "candidates.npz")), {"best": g.best[-1]}
        valley = studyplots.valley(found["x"], rms_mm=found["rms_mm"], names=g.names, marks=best)
        caption = "All candidates. Along the valley the sum of the two is the same."
        out.append(_picture("Error landscape", caption, half=True, svg=valley))
    return out


def _over_time(story: Story) -> list[dict[str, Any]]:
    """Displacements, what is left of them, and displacements against pressure: of a film."""
    before = story.prediction(("diagnose", "compare", "calibrate"))
    after = story.prediction(CHANGES) if story.fields is not None else {}
    if not before or len(story.targets.time) < 3:
        return []
    models = dict(zip(story.labels, (m["u"] for m in (before, after) if m), strict=False))
    shown = f"Measured; {' and '.join(models)}."
    return [_courses(story, models, shown), *_against_pressure(story, models, shown)]


def _rows(story: Story) -> list[int]:
    """The rows of the markers that are shown: of the objective, else the last two."""
    t, rows = story.targets, np.flatnonzero(~story.targets.fixed)
    wanted = [r for r in rows if t.names[r] in story.project.config.calibrate.objective_points]
    return [int(r) for r in wanted or rows[-2:]]


def _courses(story: Story, models: dict[str, Array], shown: str) -> dict[str, Any]:
    """The markers of the objective over time."""
    t, own = story.targets, _rows(story)
    over_time = plots.displacements(
        t.time - t.time[0],
        measured=t.value[:, own],
        models={name: u[:, own] for name, u in models.items()},
        names=[t.names[r] for r in own],
    )
    return _picture("Displacement", shown, svg=over_time)


def _against_pressure(story: Story, models: dict[str, Array], shown: str) -> list[dict[str, Any]]:
    """The markers of the objective over pressure."""
    t = story.targets
    out = []
    for r in _rows(story):
        drawn = studyplots.against_pressure(
            t.pressure, models={name: u[:, r, 2] for name, u in models.items()}, read_at=t.pressure,
            read_mm=t.value[:, r, 2], title=t.names[r],
        )  # fmt: skip
        title, caption = f"U3 of {t.names[r]} against pressure", f"{shown} Every dot is a step of the film."
        out.append(_picture(title, caption, half=True, svg=drawn))
    return out


def _picture(title: str, caption: str, *, half: bool = False, **drawn: Any) -> dict[str, Any]:
    """A picture of the report, svg=text or png=file; two halves stand side by side."""
    return {"title": title, "caption": caption, "half": half, **drawn}
