"""The models as rerun entities over the film, below `film/`: edges, markers, and their errors as arrows; and
the strain of a speckled face below `film/strain/`: value, sd, legend."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from twin.review.filmed import Filmed, Trace, rms
from twin.review.scene import ERROR, RAMP, colours, round_up
from twin.review.states import Array, Generations, Strains

Colour = tuple[int, int, int]
BEFORE, AFTER, SEARCH, WAY = (245, 135, 40), (70, 185, 255), (249, 226, 62), (190, 150, 255)
QUIET, SEEN = (170, 176, 184), (60, 230, 150)
# of the markers' curves: one marker has one colour in both pictures
CYCLE = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 190, 140),
    (204, 121, 167),
    (240, 228, 66),
    (213, 94, 0),
    (190, 150, 255),
    (170, 176, 184),
)
LINE = 0.034  # of the picture's width: height of a line of the legend
DOTS = "green dots: markers in the film"
ARROWS = "red arrows: from the model's marker to the film's, {} times as long"


def log_filmed(
    recording: rr.RecordingStream, filmed: Filmed, generations: Generations, *, scale: Array
) -> None:
    """Log all models on their timelines; scale (2,): pixels of the shown film over those of the film."""
    ink = _Ink(recording, filmed, scale)
    film_time = rr.TimeColumn("film_time", duration=filmed.time_s)
    for trace, name, colour in zip(filmed.shown, ("before", "after"), (BEFORE, AFTER)):
        ink.trace(f"film/test/{name}", film_time, trace, colour=colour, arrows=filmed.magnified)
        ink.dots(f"film/test/{name}/measured", film_time, filmed.measured)
    ink.search(rr.TimeColumn("generation", sequence=generations.generation))
    ink.models(rr.TimeColumn("effect", sequence=np.arange(len(filmed.models))))
    ink.legends()
    _log_curves(recording, filmed, film_time)


@dataclass(frozen=True)
class _Ink:
    """Writer of the layer over the film."""

    recording: rr.RecordingStream
    filmed: Filmed
    scale: Array

    def trace(
        self,
        place: str,
        column: rr.TimeColumn,
        trace: Trace,
        *,
        colour: Colour,
        arrows: int,
        measured: Array | None = None,
    ) -> None:
        """Log a model's edge, and arrows from its markers to the film's, for all values of a timeline."""
        edge = [e if np.isfinite(e).all() else e[:0] for e in self._shown(trace.edge)]
        line = rr.LineStrips2D.from_fields(colors=colour, radii=rr.Radius.ui_points(1.2))
        self.recording.log(f"{place}/edge", line, static=True)
        strips = rr.LineStrips2D.columns(strips=edge).partition([1] * len(edge))
        self.recording.send_columns(f"{place}/edge", [column], strips)
        error = ((self.filmed.measured if measured is None else measured) - trace.markers) * self.scale
        seen = np.isfinite(error).all(axis=-1)
        style = rr.Arrows2D.from_fields(colors=ERROR, radii=rr.Radius.ui_points(1.6))
        self.recording.log(f"{place}/error", style, static=True)
        vectors = rr.Arrows2D.columns(origins=self._shown(trace.markers)[seen], vectors=arrows * error[seen])
        self.recording.send_columns(f"{place}/error", [column], vectors.partition(seen.sum(axis=1)))

    def dots(self, place: str, column: rr.TimeColumn, measured: Array) -> None:
        """Log where the film shows the markers."""
        seen = np.isfinite(measured).all(axis=-1)
        style = rr.Points2D.from_fields(colors=SEEN, radii=rr.Radius.ui_points(2.5))
        self.recording.log(place, style, static=True)
        dots = rr.Points2D.columns(positions=self._shown(measured)[seen])
        self.recording.send_columns(place, [column], dots.partition(seen.sum(axis=1)))

    def search(self, column: rr.TimeColumn) -> None:
        """The best model of every generation at top pressure."""
        f = self.filmed
        measured = np.broadcast_to(f.search_measured, f.search.markers.shape)
        self.trace(
            "film/search", column, f.search, colour=SEARCH, arrows=f.search_magnified, measured=measured
        )
        self.dots("film/search/measured", column, measured)

    def models(self, column: rr.TimeColumn) -> None:
        """The models one after the other at the worst moment of the film, and how the error falls."""
        f, worst = self.filmed, self.filmed.worst
        edge = np.stack([model.edge[worst] for model in f.models])
        markers = np.stack([model.markers[worst] for model in f.models])
        measured = np.broadcast_to(f.measured[worst], markers.shape)
        models = Trace(label="", rms_mm=0.0, edge=edge, markers=markers)
        self.trace("film/effect", column, models, colour=WAY, arrows=f.magnified, measured=measured)
        self.dots("film/effect/measured", column, measured)
        for step, model in enumerate(f.models):
            self.recording.set_time("effect", sequence=step)
            text = f"model {step}, {model.label}: {model.rms_mm:.3f} mm rms"
            self.text("film/effect/step", [(text, WAY)], static=False)
        self.recording.reset_time()
        for name, colour, values in (
            ("error", WAY, [model.rms_mm for model in f.models]),
            ("expected", QUIET, [f.expected_mm] * len(f.models)),
        ):
            points = rr.SeriesPoints(colors=colour, marker_sizes=5.0, names=f"{name}, mm")
            self.recording.log(f"fall/{name}", points, static=True)
            _log_curve(self.recording, f"fall/{name}", column, values, f"{name}, mm", colour)

    def legends(self) -> None:
        """Legend of lines, dots and arrows below the film, by view."""
        dots, arrows = (DOTS, SEEN), (ARROWS.format(self.filmed.magnified), ERROR)
        magnified = (ARROWS.format(self.filmed.search_magnified), ERROR)
        pairs = zip(self.filmed.shown, (("orange", BEFORE), ("blue", AFTER)))
        lines = [(f"{name}: model, {trace.label}", colour) for trace, (name, colour) in pairs]
        self.text("film/legend/test", [*lines, dots, arrows])
        self.text("film/legend/before", [lines[0], dots, arrows])
        self.text("film/legend/search", [("yellow: best model of this generation", SEARCH), dots, magnified])
        self.text("film/legend/effect", [dots, arrows], line=1)

    def text(
        self, place: str, lines: Sequence[tuple[str, Colour]], *, line: int = 0, static: bool = True
    ) -> None:
        """Log lines of text below the film, each with its colour; first: the line they begin with."""
        width, height = self.filmed.size * self.scale
        y = height + LINE * width * (line + 0.2 + np.arange(len(lines)))
        text = rr.Points2D(
            np.stack([np.full(len(lines), 0.5 * width), y], axis=1),
            colors=[colour for _, colour in lines],
            labels=[name for name, _ in lines],
            radii=rr.Radius.ui_points(0.5),
            show_labels=True,
        )
        self.recording.log(place, text, static=static)

    def _shown(self, pixels: Array) -> Array:
        """Places in the viewer's picture, which counts from the corner of the first pixel."""
        return np.asarray((pixels + 0.5) * self.scale)


def _log_curves(recording: rr.RecordingStream, filmed: Filmed, column: rr.TimeColumn) -> None:
    """Log the errors of the models over the film, in mm: of all markers, and of each."""
    for k, name, colour in zip(filmed.numbers, ("before", "after"), (BEFORE, AFTER)):
        label, error = filmed.models[k].label, filmed.error_mm[k]
        _log_curve(recording, f"moment/{name}", column, rms(error), label, colour)
        for p, marker in enumerate(filmed.names):
            entity = f"marker/{name}/{rr.escape_entity_path_part(marker)}"
            _log_curve(recording, entity, column, error[:, p], marker, CYCLE[p % len(CYCLE)])


def _log_curve(
    recording: rr.RecordingStream,
    entity: str,
    column: rr.TimeColumn,
    values: Array | Sequence[float],
    name: str,
    colour: Colour,
) -> None:
    recording.log(entity, rr.SeriesLines(colors=colour, widths=2.0, names=name), static=True)
    recording.send_columns(entity, [column], rr.Scalars.columns(scalars=values))


VIEW = "strain"  # the name of the tab
# Blue is compression, orange tension, grey neither: as dark on both sides, told apart without red or green.
SIGNED = np.array([(38, 84, 180), (98, 150, 214), (186, 208, 226), (226, 226, 222), (240, 206, 152),
                   (228, 148, 58), (180, 84, 10)])  # fmt: skip
FILLED = 0.42  # radius of a point, of the distance to its neighbour
LEGEND = 0.05  # of the picture's width: height of the legend
LABELS = 5


def log_strains(recording: rr.RecordingStream, strains: Strains, *, scale: Array) -> None:
    """Log every component and its sd at all times; scale (2,): pixels of the shown film over the film's."""
    column = rr.TimeColumn("film_time", duration=strains.time_s)
    radius = FILLED * _apart(strains.pixel) * float(scale.mean())
    for k, name in enumerate(strains.components):
        for entity, value, ramp in ((name, strains.value, SIGNED), (f"sd_{name}", strains.sd, RAMP)):
            component = value[..., k]
            top = round_up(float(np.nanmax(np.abs(component), initial=0.0)))
            low = -top if ramp is SIGNED else 0.0
            seen = np.isfinite(component) & np.isfinite(strains.pixel).all(axis=-1)
            place = ((strains.pixel + 0.5) * scale)[seen]
            colour = colours(component[seen], top=top, low=low, ramp=ramp)
            points = rr.Points2D.columns(positions=place, colors=colour)
            recording.log(f"film/strain/{entity}", rr.Points2D.from_fields(radii=radius), static=True)
            recording.send_columns(f"film/strain/{entity}", [column], points.partition(seen.sum(axis=1)))
            legend = _legend(strains, scale, low, top, ramp)
            recording.log(f"film/legend/strain/{entity}", legend, static=True)


def strain_view(strains: Strains) -> rrb.Vertical:
    """The components beside each other over the film, and below them their sds."""
    rows = [
        [_over_film(name, f"Green-Lagrange strain {name} (scrub film_time)") for name in strains.components],
        [_over_film(f"sd_{name}", f"sd of {name}") for name in strains.components],
    ]
    return rrb.Vertical(*(rrb.Horizontal(*row) for row in rows), name=VIEW)


def _over_film(entity: str, name: str) -> rrb.Spatial2DView:
    paths = ("/film/frame", f"/film/strain/{entity}", f"/film/legend/strain/{entity}")
    return rrb.Spatial2DView(origin="/film", contents=[f"+ {path}" for path in paths], name=name)


def _legend(
    strains: Strains, scale: Array, low: float, top: float, ramp: NDArray[np.int64]
) -> rr.Points2D:
    """A row of coloured points below the film, with their values."""
    width, height = np.array(strains.size) * scale
    value = np.linspace(low, top, LABELS)
    x = width * (0.1 + 0.8 * np.linspace(0.0, 1.0, LABELS))
    return rr.Points2D(
        np.stack([x, np.full(LABELS, height + LEGEND * width)], axis=1),
        colors=colours(value, top=top, low=low, ramp=ramp), labels=[f"{v:g}" for v in value + 0.0],
        radii=0.35 * LEGEND * width, show_labels=True,
    )  # fmt: skip


def _apart(pixel: Array) -> float:
    """Distance in px of a point to its nearest neighbour, the median at the first time that shows points."""
    row = next((row for row in pixel if np.isfinite(row).all(axis=1).sum() > 1), None)
    if row is None:
        return 20.0
    place = row[np.isfinite(row).all(axis=1)]
    away = np.linalg.norm(place[:, None] - place, axis=-1)
    np.fill_diagonal(away, np.inf)
    return float(np.median(away.min(axis=1)))
