"""The pictures of the report, each with its title, its caption and its place."""

from typing import Any

import numpy as np

from twin import files
from twin.diagnosis.diagnosisrecord import ForetoldFilm
from twin.drawing import plots, studyplots
from twin.drawing.fitplots import draw_curves
from twin.report.page import Picture
from twin.report.story import CHANGES, Story, calibration_file
from twin.study.record import page_facts
from twin.study.reference import FIGURES, file_of
from twin.targets import Array


def pictures_of(story: Story) -> list[Picture]:
    """All pictures of the page, in the order of their places."""
    return [
        *_drawn(story, "error", place="top"), *_deformed(story), *_overlaid(story),
        *_drawn(story, "residuals", place="where"), *map(_unseen, held_out_films(story)),
        *_drawn(story, "evidence", place="evidence"),
        *_material_tests(story), *_over_time(story), *_search(story),
    ]  # fmt: skip


def study_facts(story: Story) -> dict[str, Any] | None:
    """The tables and the seven figures of the study, where there is one."""
    if story.study is None or story.study_file is None:
        return None
    drawn = [
        Picture(title=f"Figure {name}.", caption=FIGURES[name], half=True,
                svg=story.study_file.with_name(file_of(name)).read_text(encoding="utf-8"))
        for name in FIGURES
    ]  # fmt: skip
    return page_facts(story.study) | {"pictures": drawn}


def _drawn(story: Story, name: str, *, place: str) -> list[Picture]:
    """Picture of the models in their order, where there is one."""
    law = story.history.law
    texts = {
        "error": (
            "How the error fell",
            "RMS of measured minus model at all markers, and that of a right model after its fit. "
            "Pale: what the next step takes off.",
            True,
        ),
        "evidence": (
            f"What speaks for {law}",
            f"The residual without {law}, what {law} explains of it, and what it leaves.",
            False,
        ),
        "residuals": (
            "Measured minus model by marker and time",
            "Without the errors (scale, placement, mesh) that many values share, each at most 3 sd of it.",
            False,
        ),
    }
    title, caption, half = texts[name]
    drawn = story.history.pictures.get(name)
    return [Picture(title=title, caption=caption, half=half, svg=drawn[0], place=place)] if drawn else []


def _deformed(story: Story) -> list[Picture]:
    """The finger at top pressure, where it could be drawn."""
    file = story.run.path("deformed.png")
    model = "Best model of the genetic algorithm" if story.fields is None else f"The model {story.labels[1]}"
    caption = f"{model}, and the measured markers."
    if not file.exists():
        return []
    return [Picture(title="Model at top pressure", caption=caption, half=True, png=file, place="top")]


def _overlaid(story: Story) -> list[Picture]:
    """The film at the worst moment with the models over it."""
    if story.footage is None:
        return []
    footage = story.footage
    return [Picture(title="The worst moment", caption=footage.caption, png=footage.worst, place="top")]


def _search(story: Story) -> list[Picture]:
    """The genetic algorithm by generation and, of two constants, its valley; the study has its own."""
    g = story.generations
    if story.study:
        return []
    error = studyplots.best_error(g.generation, rms_mm=g.rms_mm)
    constants = studyplots.best_constants(g.generation, best=g.best, names=g.names)
    out = [
        Picture(
            title="Genetic algorithm", caption="Best RMS error of every generation.", half=True, svg=error
        ),
        Picture(title="Constants of the best", caption="By generation.", half=True, svg=constants),
    ]
    if len(g.names) == 2:
        candidates = files.read_npz(calibration_file(story.project, "candidates.npz"), "x", "rms_mm")
        best = {"best": g.best[-1]}
        valley = studyplots.valley(candidates["x"], rms_mm=candidates["rms_mm"], names=g.names, marks=best)
        caption = "All candidates. Along the valley the sum of the two is the same."
        out.append(Picture(title="Error landscape", caption=caption, half=True, svg=valley))
    return out


def _material_tests(story: Story) -> list[Picture]:
    """The curves of the silicone's tests that the newest fit has taken, where it has."""
    if story.fit.material_tests is None:
        return []
    caption = "Nominal stress against strain: measured with 1 sd, and the law of the newest fit."
    png = draw_curves(story.fit.material_tests.tests)
    return [Picture(title="Tests of the silicone itself", caption=caption, png=png)]


def _over_time(story: Story) -> list[Picture]:
    """Displacements, what is left of them, and displacements against pressure: of a film."""
    before = story.prediction(("diagnose", "compare", "calibrate"))
    after = story.prediction(CHANGES) if story.fields is not None else {}
    if not before or len(story.targets.time) < 3:
        return []
    models = dict(zip(story.labels, (m["u"] for m in (before, after) if m), strict=False))
    caption = f"Measured; {' and '.join(models)}."
    return [_courses(story, models, caption), *_against_pressure(story, models, caption)]


def _rows(story: Story) -> list[int]:
    """The rows of the markers that are shown: of the objective, else the last two."""
    t, rows = story.targets, np.flatnonzero(~story.targets.fixed)
    objective = [r for r in rows if t.names[r] in story.project.config.objective_points]
    return [int(r) for r in objective or rows[-2:]]


def _courses(story: Story, models: dict[str, Array], caption: str) -> Picture:
    """The markers of the objective over time."""
    t, columns = story.targets, _rows(story)
    over_time = plots.displacements(
        t.time - t.time[0],
        measured=t.value[:, columns],
        models={name: u[:, columns] for name, u in models.items()},
        names=[t.names[r] for r in columns],
    )
    return Picture(title="Displacement", caption=caption, svg=over_time)


def _against_pressure(story: Story, models: dict[str, Array], curves: str) -> list[Picture]:
    """The markers of the objective over pressure."""
    t = story.targets
    out = []
    for r in _rows(story):
        drawn = studyplots.against_pressure(
            t.pressure, models={name: u[:, r, 2] for name, u in models.items()}, read_at=t.pressure,
            read_mm=t.value[:, r, 2], title=t.names[r],
        )  # fmt: skip
        title, caption = f"U3 of {t.names[r]} against pressure", f"{curves} Every dot is a step of the film."
        out.append(Picture(title=title, caption=caption, half=True, svg=drawn))
    return out


# -- films that no fit has seen ------------------------------------------------------------------------------


def held_out_films(story: Story) -> list[ForetoldFilm]:
    """Errors of the films that no fit has seen, before and with the effects of the newest model."""
    after = {row.film: row.after for row in story.diagnosis.held_out}
    after |= {row.film: row for row in (story.added.held_out if story.added else ())}
    before = story.start.held_out if story.start else ()
    return [ForetoldFilm.of(row, after.get(row.film)) for row in before]


def _unseen(row: ForetoldFilm) -> Picture:
    """Picture of the error in a film before and after, with its expected value."""
    both = {"calibrated": row.before, "with effects": row.after}
    bars = [(name, film.raw_rms_mm) for name, film in both.items() if film]
    foot = row.before.noise_sd_mm if row.before.expected_mm is None else row.before.expected_mm
    drawing = plots.falling(bars, expected_mm=foot)
    caption = "No fit has seen this film."
    return Picture(title=row.film, caption=caption, half=True, svg=drawing, place="held_out")
