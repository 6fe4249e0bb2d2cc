"""Draws the undeformed finger with its dimensions, marks and points: from the side, cut along and across.

All of it comes from the case that is solved; only the numbers beside the arrows come from the dimensions.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from fe import Case
from fe.element import Integers
from twin.bodies.body import GAP, Arrow, Sketch
from twin.drawing.deformed import grid_of
from twin.drawing.theme import AFTER, BEFORE, INK, MUTED, png, style
from twin.targets import Array

SKIN, CUT, EDGE = "#e3e8ec", "#b9c4cd", "#8a97a3"
NAME = 0.15  # of the drawn length: room for a name that stands upright below a point
ASIDE = 1e-6  # of the mesh's size: by so much a plane is moved off nodes that lie on it
WIDE, CUTS = 11.0, 3.4  # inches: the picture's width, the height of the two cuts


def dimensioned(
    case: Case,
    *,
    outside: Integers,
    points: Mapping[str, Array],
    marks: Mapping[str, Array],
    sketch: Sketch | None,
    title: str,
) -> bytes:
    """A PNG of a finger at rest.

    outside (f, m): the faces that are drawn; points {name: (3,) mm} on the finger; marks {name: (3,) mm} on
    the rig; sketch: its dimensions, None where a deck has none.
    """
    tall = _side_height(case, [*points.values(), *marks.values()])
    with style({"axes.grid": False}):
        figure = Figure(figsize=(WIDE, tall + CUTS), layout="constrained")
        rows = figure.subplot_mosaic(
            [["side", "side"], ["along", "across"]], width_ratios=[2.6, 1.0], height_ratios=[tall, CUTS]
        )
        _side(rows["side"], case, outside, points, marks, sketch)
        _along(rows["along"], case, sketch)
        _across(rows["across"], case, sketch)
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, parse_math=False)  # $ in a name is a $
        return png(figure)


def _side_height(case: Case, places: Sequence[Array]) -> float:
    """Height in inches of the side view, drawn across the width of the picture."""
    every = np.concatenate([case.nodes[:, [0, 2]], *(p[None, [0, 2]] for p in places)])
    across, up = np.ptp(every, axis=0)
    room = (3.5 * GAP + NAME) * across  # for dimensions above and names below
    return float(np.clip(0.85 * WIDE * (up + room) / across, 2.5, 7.5))


# -- the three views ---------------------------------------------------------------------------------------


def _side(
    axes: Axes, case: Case, outside: Integers, points: Mapping[str, Array], marks: Mapping[str, Array],
    sketch: Sketch | None,
) -> None:  # fmt: skip
    """From +y as the camera sees it, with all points and marks."""
    faces = case.nodes[outside]
    order = np.argsort(faces[..., 1].mean(axis=1))
    loops = faces[order][:, _loop(case)][..., [0, 2]]
    axes.add_collection(PolyCollection(list(loops), facecolor=SKIN, edgecolor=EDGE, linewidths=0.25))
    low, high = case.nodes.min(axis=0), case.nodes.max(axis=0)
    _named(axes, points, colour=BEFORE, marker="o", below=True)
    _named(axes, marks, colour=AFTER, marker="s", below=False)
    gap = GAP * float(high[0] - low[0])
    arrows = [Arrow(f"{high[0] - low[0]:g}", (low[0], high[2]), (high[0], high[2]), 2.2 * gap)]
    arrows += [] if sketch is None else sketch.side
    _arrows(axes, arrows)
    _finished(axes, "From the side, as the camera sees it", "x, mm from the clamp", "z, mm")
    room = min((float(p[2]) for p in points.values()), default=0.0) - NAME * float(high[0] - low[0])
    axes.set_ylim(bottom=min(room, axes.get_ylim()[0]))


def _along(axes: Axes, case: Case, sketch: Sketch | None) -> None:
    """The cut along the plane of symmetry, the chamber open."""
    _material(axes, cut(case, axis=1, place=0.0))
    _arrows(axes, () if sketch is None else sketch.along)
    _finished(axes, "Cut along the middle (y = 0)", "x, mm", "z, mm")


def _across(axes: Axes, case: Case, sketch: Sketch | None) -> None:
    """The cut across: where the body's sketch has it, at two places left and right; else through the
    middle."""
    low, high = case.nodes.min(axis=0), case.nodes.max(axis=0)
    if sketch is None:
        x = float(low[0] + high[0]) / 2
        _material(axes, cut_across(case, x))
        _finished(axes, f"Cut across (x = {x:.3g})", "y, mm", "")
        return
    left_cut, right_cut = (cut(case, axis=0, place=x) for x in (sketch.left, sketch.right))
    _material(axes, [*_mirrored(left_cut), *right_cut])
    _arrows(axes, sketch.across)
    _finished(axes, f"Cut across: {sketch.names}" if sketch.names else "Cut across", "y, mm", "")


def cut(case: Case, *, axis: int, place: float) -> list[Array]:
    """Triangles (3, 2) in mm where the plane x[axis] = place, in mm, meets the elements; the other two axes
    in their order."""
    low, high = case.nodes[:, axis].min(), case.nodes[:, axis].max()
    aside = ASIDE * float(high - low)
    place = float(np.clip(place + 0.37 * aside, low + aside, high - aside))
    normal = np.eye(3)[axis]
    grid = grid_of(case.nodes, case.connectivity)
    plane = grid.slice(normal, origin=place * normal, generate_triangles=True)
    return list(np.delete(plane.points[plane.regular_faces], axis, axis=2))


def cut_across(case: Case, place: float) -> list[Array]:
    """The cut of a case at x = place mm, with its mirror image where it is half of a body: where it ends at
    y = 0 in nodes that are held across alone."""
    shapes = cut(case, axis=0, place=place)
    half = any(s.components == (1,) for s in case.supports) and case.nodes[:, 1].min() > -1e-6
    return [*shapes, *(_mirrored(shapes) if half else [])]


def _mirrored(shapes: Sequence[Array]) -> list[Array]:
    return [shape * np.array([-1.0, 1.0]) for shape in shapes]


# -- what they are drawn with ------------------------------------------------------------------------------


def _loop(case: Case) -> list[int]:
    """The corners of a face in turn."""
    return list(case.element.corners)


def _material(axes: Axes, shapes: Sequence[Array]) -> None:
    axes.add_collection(PolyCollection(list(shapes), facecolor=CUT, edgecolor=CUT, linewidths=0.6))
    axes.autoscale_view()


def _named(axes: Axes, places: Mapping[str, Array], *, colour: str, marker: str, below: bool) -> None:
    """Places (3,) mm with their names; below: upright, with x and z, as neighbours would overlap."""
    for name, (x, _, z) in places.items():
        axes.plot(x, z, marker, ms=4.5, color=colour, mec="white", mew=0.5, zorder=4)
        text = f"{name} ({x:.4g}, {round(z, 3) + 0.0:.4g})" if below else name
        axes.annotate(
            text, (x, z), xytext=(0, -6), textcoords="offset points", rotation=90 if below else 0,
            ha="center", va="top", fontsize=7.5, color=colour, zorder=4,
        )  # fmt: skip


def _arrows(axes: Axes, arrows: Sequence[Arrow]) -> None:
    for arrow in arrows:
        _arrow(axes, arrow)


def _arrow(axes: Axes, arrow: Arrow) -> None:
    """A double arrow with its text; beside the points where `off` is not 0, with thin lines to them."""
    a, b = np.array(arrow.start), np.array(arrow.end)
    upright = abs(a[0] - b[0]) < 1e-9
    aside = arrow.off * (np.array([-1.0, 0.0]) if upright else np.array([0.0, 1.0]))
    for end in (a, b) if arrow.off else ():
        axes.plot(*np.transpose([end, end + 1.15 * aside]), color=MUTED, lw=0.5)
    line = {"arrowstyle": "<->", "color": INK, "lw": 0.8, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
    (x, y), (x_end, y_end) = a + aside, b + aside
    axes.annotate("", (x, y), (x_end, y_end), arrowprops=line)
    inside = arrow.off == 0.0 and upright  # a wall is thinner than its text is high
    axes.annotate(
        arrow.text, ((x + x_end) / 2, (y + y_end) / 2), textcoords="offset points",
        xytext=(6, 0) if inside else (-3, 0) if upright else (0, 2),
        rotation=90 if upright and not inside else 0,
        ha="left" if inside else "right" if upright else "center", va="center" if upright else "bottom",
        fontsize=8, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5},
    )  # fmt: skip


def _finished(axes: Axes, title: str, across: str, up: str) -> None:
    axes.set(title=title, xlabel=across, ylabel=up, aspect="equal")
    axes.autoscale_view()
    axes.margins(0.04)
