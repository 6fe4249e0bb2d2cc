"""The strain of a speckled face as rerun entities over the film, below `film/strain/`: value, sd, legend."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from twin.review.scene import RAMP, colours, round_up
from twin.review.states import Array, Strains

VIEW = "strain"  # the name of the tab
# Blue is compression, orange tension, grey neither: as dark on both sides, told apart without red or green.
SIGNED = np.array([(38, 84, 180), (98, 150, 214), (186, 208, 226), (226, 226, 222), (240, 206, 152),
                   (228, 148, 58), (180, 84, 10)])  # fmt: skip
FILLED = 0.42  # radius of a point, of the distance to its neighbour
LINE = 0.05  # of the picture's width: height of the legend
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
        np.stack([x, np.full(LABELS, height + LINE * width)], axis=1),
        colors=colours(value, top=top, low=low, ramp=ramp), labels=[f"{v:g}" for v in value + 0.0],
        radii=0.35 * LINE * width, show_labels=True,
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
