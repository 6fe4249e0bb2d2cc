"""Layout of the review in rerun: four named views, each with the timeline to scrub in its title."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun.blueprint as rrb

from twin.review.filmed import Filmed
from twin.review.filmlayer import strain_view
from twin.review.scene import Scene
from twin.review.states import Array, Strains

VIEWS = {  # name of each view, and the timeline that plays it
    "search": "generation",
    "test": "film_time",
    "where it fails": "film_time",
    "effects": "effect",
}
OPENS = "test"


def arranged(
    scene: Scene,
    *,
    has_film: bool,
    filmed: Filmed | None,
    pictures: Sequence[str],
    strains: Strains | None = None,
) -> rrb.Blueprint:
    """Blueprint with four views as tabs, and a fifth for the strain of a speckled face. filmed: the models
    that are drawn over the film; pictures: titles of those at `pictures/0`, `pictures/1`, ..."""
    paths = {title: f"/pictures/{number}" for number, title in enumerate(pictures)}
    views = [
        _search(scene, has_film=has_film),
        _test(scene, has_film=has_film, filmed=filmed),
        _where(filmed=filmed, pictures=paths),
        _effects(filmed=filmed, pictures=paths),
        *([strain_view(strains)] if strains is not None else []),
    ]
    tabs = rrb.Tabs(*views, active_tab=list(VIEWS).index(OPENS), name="softtwin")
    return alone(tabs, rrb.TimePanel(timeline=VIEWS[OPENS], state="collapsed", fps=2.0))


def alone(tabs: rrb.Tabs, time: rrb.TimePanel) -> rrb.Blueprint:
    """Tabs and the panel of the time, without rerun's other panels."""
    return rrb.Blueprint(tabs, time, rrb.SelectionPanel(state="hidden"), rrb.BlueprintPanel(state="hidden"))


def _search(scene: Scene, *, has_film: bool) -> Any:
    film = [_film("search", "film and best model (scrub generation)")] if has_film else []
    below = rrb.Horizontal(
        rrb.TimeSeriesView(origin="/rms", contents=["/rms/best"], name="RMS error of the best, mm"),
        rrb.TimeSeriesView(
            origin="/parameters", contents=["$origin/**", "- /parameters/pressure"], name="its constants, MPa"
        ),
        _text("/diagnosis", "diagnosis"),
        column_shares=[1, 1, 1.2],
    )
    top = rrb.Horizontal(*film, _finger(scene))
    return rrb.Vertical(top, below, row_shares=[9, 4], name="search")


def _test(scene: Scene, *, has_film: bool, filmed: Filmed | None) -> Any:
    film = [_film("test", "film and models (scrub film_time)")] if has_film else []
    error = rrb.TimeSeriesView(
        origin="/moment" if filmed else "/rms",
        contents=["$origin/**"] if filmed else ["/rms/calibrated"],
        name="RMS error at each moment, mm",
    )
    below = rrb.Horizontal(
        error,
        rrb.TimeSeriesView(origin="/parameters", contents=["/parameters/pressure"], name="pressure, MPa"),
        _text("/diagnosis", "diagnosis"),
        column_shares=[1, 1, 1.2],
    )
    top = rrb.Horizontal(*film, _finger(scene))
    return rrb.Vertical(top, below, row_shares=[9, 4], name="test")


def _where(*, filmed: Filmed | None, pictures: dict[str, str]) -> Any:
    film = _film("where", "film and the model without effects (scrub film_time)") if filmed else None
    maps = _picture(pictures, "residuals", "measured - model: markers over film time")
    curves = [
        rrb.TimeSeriesView(
            origin=f"/marker/{name}",
            name=f"error of each marker, mm: {model.label}",
            axis_y=_from_zero(filmed),
        )
        for name, model in zip(("before", "after"), filmed.shown if filmed else ())
    ]
    top = [view for view in (film, maps) if view is not None]
    rows = [rrb.Horizontal(*top)] if top else []
    rows += [rrb.Horizontal(*curves)] if curves else []
    return rrb.Vertical(*rows, row_shares=[9, 4][: len(rows)], name="where it fails")


def _effects(*, filmed: Filmed | None, pictures: dict[str, str]) -> Any:
    film = _film("effect", "worst moment, model by model (scrub effect)") if filmed else None
    evidence = _picture(pictures, "evidence", "what the effect explains")
    error = _picture(pictures, "error", "how the error fell")
    fall = _fall(filmed) if filmed else None
    top = [view for view in (film, evidence) if view is not None]
    below = [view for view in (fall, error) if view is not None]
    rows = [rrb.Horizontal(*top)] if top else []
    rows += [rrb.Horizontal(*below, _text("/diagnosis", "diagnosis"))]
    return rrb.Vertical(*rows, row_shares=[9, 4][: len(rows)], name="effects")


def _fall(filmed: Filmed) -> rrb.TimeSeriesView:
    top = 1.1 * max(model.rms_mm for model in filmed.models)
    return rrb.TimeSeriesView(
        origin="/fall",
        name="error, mm rms, model by model",
        axis_y=rrb.ScalarAxis(range=(0.0, top)),
    )


def _from_zero(filmed: Filmed | None) -> rrb.ScalarAxis | None:
    """One scale for the errors of all models, so that they can be compared."""
    if filmed is None:
        return None
    top = max(float(np.nanmax(filmed.error_mm[k], initial=0.0)) for k in filmed.numbers)
    return rrb.ScalarAxis(range=(0.0, 1.05 * top))


def _film(view: str, name: str) -> rrb.Spatial2DView:
    """The film with what belongs to one view."""
    visible = {
        "search": ["+ /film/search/**", "+ /film/legend/search"],
        "test": ["+ /film/test/**", "+ /film/legend/test"],
        "where": ["+ /film/test/before/**", "+ /film/legend/before"],
        "effect": ["+ /film/effect/**", "+ /film/legend/effect"],
    }[view]
    return rrb.Spatial2DView(origin="/film", contents=["+ /film/frame", *visible], name=name)


def _picture(pictures: dict[str, str], title: str, name: str) -> rrb.Spatial2DView | None:
    return rrb.Spatial2DView(origin=pictures[title], name=name) if title in pictures else None


def _text(origin: str, name: str) -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin=origin, name=name)


def _finger(scene: Scene) -> rrb.Spatial3DView:
    return finger_view("/model", "model: displacement, mm", low=scene.low, high=scene.high)


def finger_view(origin: str, name: str, *, low: Array, high: Array) -> rrb.Spatial3DView:
    """A finger between two corners (3,) mm, seen from the film's side: x runs to the left."""
    centre, extent = 0.5 * (low + high), high - low
    # The viewer's vertical angle is about 55 degrees; beside the film the view is 1.6 times as wide as high.
    distance = max(0.75 * extent[0], 1.15 * extent[2]) + 0.5 * extent[1]
    position = centre + distance * np.array([0.0, 1.0, 0.16])
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        eye_controls=rrb.EyeControls3D(position=position, look_target=centre, eye_up=(0, 0, 1)),
        background=(38, 41, 48),
        line_grid=False,
    )
