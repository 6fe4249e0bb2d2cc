"""Turns the force on an object into a plot: over pressure, and finger and object seen from the side."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from fe.element import Integers
from fe.obstacles import Flat, Obstacle
from twin.drawing.theme import AFTER, BEFORE, FAINT, MUTED, NOISE, png, style
from twin.targets import Array

SIDE = [0, 2]  # x and z


def draw_touch(
    x: Array,
    force: Array,
    half: Array | None,
    *,
    label: str,
    nodes: Array,
    u: Array,
    triangles: Integers,
    obstacle: Obstacle,
    given_way: Array,
) -> bytes:
    """A PNG of the force (s,) N over x (s,), which `label` says, with half (s,) of its 95 % interval where
    there is one; and of the finger, nodes (n, 3) mm with displacements u (n, 3) mm and the triangles (t, 3)
    of its surface, beside an obstacle that has given way by (3,) mm."""
    with style():
        figure = Figure(figsize=(7.6, 3.4), layout="constrained")
        curve, side_view = figure.subplots(1, 2)
        curve.plot(x, force, "o-", color=AFTER, markersize=3.5, linewidth=1.2)
        if half is not None:
            curve.fill_between(x, force - half, force + half, color=AFTER, alpha=0.25, linewidth=0)
        curve.set_title("force on the object, N")
        curve.set_xlabel(label)
        for place, colour in ((nodes, FAINT), (nodes + u, NOISE)):
            skin = list(place[triangles][..., SIDE])
            side_view.add_collection(PolyCollection(skin, facecolor=colour, edgecolor="face", linewidth=0.4))
        ends = np.concatenate([nodes, nodes + u])[:, SIDE]
        low, high = ends.min(axis=0), ends.max(axis=0)
        room = 0.15 * float(np.ptp(ends, axis=0).max())
        limits = np.stack([low - room, high + room], axis=1)
        side_view.set(xlim=limits[0], ylim=limits[1], aspect="equal")
        _draw_obstacle(side_view, obstacle, np.zeros(3), BEFORE if not given_way.any() else MUTED)
        if given_way.any():
            _draw_obstacle(side_view, obstacle, given_way, BEFORE)
        side_view.set_title("from the side: x, z in mm, at rest and at the end")
        return png(figure)


def _draw_obstacle(axes: Axes, obstacle: Obstacle, by: Array, colour: str) -> None:
    """The obstacle's outline in the plane y = 0, moved by (3,) mm."""
    look: dict[str, Any] = {"facecolor": "none", "edgecolor": colour, "linewidth": 1.4}
    if not isinstance(obstacle, Flat):
        c, axis = np.asarray(obstacle.centre) + by, obstacle.axis
        if axis is None or axis[1]:
            axes.add_patch(Circle((c[0], c[2]), obstacle.radius, **look))
        else:
            for end in (-obstacle.radius, obstacle.radius):
                (axes.axhline if axis[0] else axes.axvline)(c[2 if axis[0] else 0] + end, color=colour)
        return
    n = obstacle.out[SIDE]
    if not n.any():
        return
    n = n / np.linalg.norm(n)
    foot = (obstacle.distance + obstacle.out @ by) / (obstacle.out[SIDE] @ n) * n
    along, far = np.array([-n[1], n[0]]), 1e3
    ends = [foot + far * along, foot - far * along, foot - far * (along + n), foot + far * (along - n)]
    axes.add_patch(Polygon(ends, hatch="//", **look))
