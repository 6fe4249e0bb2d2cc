"""The pictures of the report, each with its title, its caption and its place."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.drawing import plots
from twin.project import files
from twin.report.found import CHANGES, Story, calibration_file
from twin.report.page import Picture
from twin.study.record import page_facts
from twin.targets import Array

FIGURES = {  # of the reference study, and what each shows
    "5a": "Best RMS error of every generation of the genetic algorithm.",
    "5b": "Constants of the best candidate. Their sum settles before they do.",
    "5c": "Error of all candidates. Along the ridge the error hardly changes.",
    "6a": "Displacement against pressure, first point.",
    "6b": "Displacement against pressure, second point.",
    "6c": "Displacements at the top pressure.",
    "6d": "Absolute errors at the top pressure, before and after.",
}


def pictures_of(story: Story) -> list[Picture]:
    """All pictures of the page, in the order of their places."""
    return [
        *_drawn(story, "error", place="top"), *_deformed(story), *_overlaid(story),
        *_drawn(story, "residuals", place="where"), *map(_unseen, held_out_films(story)),
        *_drawn(story, "evidence", place="evidence"),
        *_over_time(story), *_search(story),
    ]  # fmt: skip


def study_facts(story: Story) -> dict[str, Any] | None:
    """The tables and the seven figures of the study, where there is one."""
    if story.study_file is None:
        return None
    drawn = [
        Picture(title=f"Figure {name}.", caption=FIGURES[name], half=True,
                svg=story.study_file.with_name(f"figure-{name}.svg").read_text(encoding="utf-8"))
        for name in FIGURES
    ]  # fmt: skip
    return page_facts(story.study) | {"pictures": drawn}


def _drawn(story: Story, name: str, *, place: str) -> list[Picture]:
    """A picture of the way to the model of now, where there is one."""
    law = story.way.law
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
    return [Picture(title=title, caption=caption, half=half, svg=svg, place=place)] if svg else []


def _deformed(story: Story) -> list[Picture]:
    """The finger at top pressure, where it could be drawn."""
    file = story.run.path("deformed.png")
    caption = "Best model of the genetic algorithm, and the measured markers."
    if not file.exists():
        return []
    return [Picture(title="Model at top pressure", caption=caption, half=True, png=file, place="top")]


def _overlaid(story: Story) -> list[Picture]:
    """The film at the worst moment with the models over it."""
    if story.footage is None:
        return []
    shown = story.footage
    return [Picture(title="The worst moment", caption=shown.caption, png=shown.worst, place="top")]


def _search(story: Story) -> list[Picture]:
    """The genetic algorithm by generation and, of two constants, its landscape; the study has its own."""
    g = story.generations
    if story.study:
        return []
    course = plots.generations(g.generation, rms_mm=g.rms_mm, best=g.best, names=g.names)
    caption = "Best RMS and constants of every generation."
    out = [Picture(title="Genetic algorithm", caption=caption, half=True, svg=course)]
    if len(g.names) == 2:
        found = files.read_npz(calibration_file(story.project, "candidates.npz"))
        valley = plots.landscape(found["x"], rms_mm=found["rms_mm"], names=g.names, best=g.best[-1])
        caption = "All candidates. Along the valley the sum of the two is the same."
        out.append(Picture(title="Error landscape", caption=caption, half=True, svg=valley))
    return out


def _over_time(story: Story) -> list[Picture]:
    """Displacements, what is left of them, and displacements against pressure: of a film."""
    before = story.prediction(("diagnose", "compare", "calibrate"))
    after = story.prediction(CHANGES) if story.fields is not None else {}
    if not before or len(story.targets.time) < 3:
        return []
    displacement, pressure = _courses(story, before, after)
    return [displacement, pressure]


def _courses(story: Story, before: dict[str, Array], after: dict[str, Array]) -> list[Picture]:
    """The markers of the objective over time, and over pressure."""
    t, end = story.targets, after.get("u")
    rows = np.flatnonzero(~t.fixed)
    wanted = [r for r in rows if t.names[r] in story.project.config.calibrate.objective_points]
    own = wanted or rows[-2:]
    drawn: dict[str, Any] = {"names": [t.names[r] for r in own], "labels": story.labels}
    over_time = plots.displacements(
        t.time - t.time[0],
        measured=t.value[:, own],
        before=before["u"][:, own],
        after=None if end is None else end[:, own],
        **drawn,
    )
    over_pressure = plots.pressure_curves(
        t.pressure,
        measured=t.value[:, own, 2],
        before=before["u"][:, own, 2],
        after=None if end is None else end[:, own, 2],
        **drawn,
    )
    shown = f"Measured; {' and '.join(story.labels[: 1 + bool(after)])}."
    return [
        Picture(title="Displacement", caption=shown, svg=over_time),
        Picture(
            title="U3 against pressure",
            caption=f"{shown} Every dot is a step of the film.",
            svg=over_pressure,
        ),
    ]


# -- films that no fit has seen ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class HeldOutFilm:
    """The error of the calibrated model in a film, and of that with effects, mm, with the noise."""

    film: str
    before_mm: float
    after_mm: float | None
    noise_mm: float

    @property
    def ratio(self) -> float | None:
        """Before over after."""
        return self.before_mm / self.after_mm if self.after_mm else None


def held_out_films(story: Story) -> list[HeldOutFilm]:
    """The films that no fit has seen; the error with effects is that of the newest model."""
    after = {row.film: row.after for row in story.diagnosis.held_out}
    after |= {row.film: row for row in (story.added.held_out if story.added else ())}
    found = {film: row.rms_mm for film, row in after.items() if row}
    return [
        HeldOutFilm(
            film=row.film, before_mm=row.rms_mm, after_mm=found.get(row.film), noise_mm=row.noise_sd_mm
        )
        for row in (story.start.held_out if story.start else ())
    ]


def _unseen(row: HeldOutFilm) -> Picture:
    """The error in a film before and after, and its noise."""
    bars = [("calibrated", row.before_mm)]
    bars += [("with effects", row.after_mm)] if row.after_mm is not None else []
    drawing = plots.falling(bars, noise_mm=row.noise_mm)
    caption = "No fit has seen this film."
    return Picture(title=row.film, caption=caption, half=True, svg=drawing, place="held_out")
