"""Pictures of a mesh for who has to choose nodes in it or to judge it: node labels, element shapes, and what
a deck was read as: materials, layers, supports, ties, and where the pressure acts."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fe import Case
from fe.case import Layer
from fe.element import Integers
from fe.mesh.elementshapes import Measure
from fe.mesh.refine import free_faces
from twin.drawing.theme import AFTER, BEFORE, EXTRA, INK, MEASURED, MUTED, NOISE, png, style
from twin.targets import Array

NEAREST = 22  # nodes that are labelled around a point: more would overlap
ACROSS = 3  # pictures in a row
AXES = ("x", "y", "z")


def labelled(case: Case, *, outside: Integers, points: Mapping[str, Array]) -> bytes:
    """A PNG with the labels of the surface nodes around each point {name: (3,) mm}; outside (f, m): the faces
    that are drawn."""
    rows = -(-len(points) // ACROSS)
    with style({"axes.grid": False}):
        figure = Figure(figsize=(4.2 * min(ACROSS, len(points)), 3.6 * rows), layout="constrained")
        for k, (name, x) in enumerate(points.items(), start=1):
            _around(figure.add_subplot(rows, min(ACROSS, len(points)), k), case, outside, name, x)
        return png(figure)


def _around(axes: Axes, case: Case, outside: Integers, name: str, x: Array) -> None:
    view, facing = _faced(case, outside, x)
    surface = np.unique(facing)
    near = surface[np.argsort(np.linalg.norm(case.nodes[surface] - x, axis=1), kind="stable")[:NEAREST]]
    places = case.nodes[near]
    across, up = (i for i in range(3) if i != view)
    touched = facing[np.isin(facing, near).any(axis=1)]
    loops = case.nodes[touched][:, list(case.element.corners)][..., [across, up]]
    axes.add_collection(PolyCollection(list(loops), facecolor="none", edgecolor=MUTED, linewidths=0.5))
    axes.plot(places[:, across], places[:, up], ".", color=INK, ms=3)
    for row, place in zip(near, places, strict=True):
        axes.annotate(
            str(case.labels[row]), (place[across], place[up]), xytext=(2, 2), textcoords="offset points",
            fontsize=6.5, color=AFTER if row == near[0] else INK,
        )  # fmt: skip
    axes.plot(x[across], x[up], "o", mfc="none", color=BEFORE, ms=9)
    away = float(np.linalg.norm(places[0] - x))
    axes.set(
        title=f"{name}: node {case.labels[near[0]]}, {away:.2f} mm away", xlabel=f"{AXES[across]}, mm",
        ylabel=f"{AXES[up]}, mm", aspect="equal",
    )  # fmt: skip
    room = 0.08 * max(float(np.ptp(places[:, across])), float(np.ptp(places[:, up])), 1e-6)
    for limit, i in ((axes.set_xlim, across), (axes.set_ylim, up)):
        seen = np.append(places[:, i], x[i])
        limit(float(seen.min()) - room, float(seen.max()) + room)


def _faced(case: Case, outside: Integers, x: Array) -> tuple[int, Integers]:
    """The axis along which the surface near a place (3,) mm is seen, and the faces (f, m) that face it: from
    the side if that can be, as the camera sees it, else from above or below, else from an end."""
    corners = case.nodes[outside][:, list(case.element.corners)]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0])
    axis = np.abs(normal).argmax(axis=1)
    surface = np.unique(outside)
    nearest = surface[np.linalg.norm(case.nodes[surface] - x, axis=1).argmin()]
    touching = set(axis[(outside == nearest).any(axis=1)].tolist())
    view = next(i for i in (1, 2, 0) if i in touching)
    return view, outside[axis == view]


def shapes(case: Case, *, outside: Integers, measures: Sequence[Measure]) -> bytes:
    """A PNG of the elements from the side, coloured by the ratio of their Jacobians, and how often each value
    of every measure occurs; outside (f, m): the faces that are drawn."""
    with style({"axes.grid": False}):
        figure = Figure(figsize=(11.0, 7.0), layout="constrained")
        rows = figure.subplot_mosaic([["side"] * len(measures), list(range(len(measures)))])
        _coloured(figure, rows["side"], case, outside, measures[0])
        for k, measure in enumerate(measures):
            _often(rows[k], measure)
        return png(figure)


def _coloured(figure: Figure, axes: Axes, case: Case, outside: Integers, measure: Measure) -> None:
    faces, owner = case.nodes[outside], _owners(case, outside)
    order = np.argsort(faces[..., 1].mean(axis=1))
    loops = faces[order][:, list(case.element.corners)][..., [0, 2]]
    drawn = PolyCollection(list(loops), array=measure.values[owner[order]], cmap="viridis", edgecolor="white",
                           linewidths=0.2, clim=(0.0, 1.0))  # fmt: skip
    axes.add_collection(drawn)
    axes.set(title=f"From the side: {measure.name}", xlabel="x, mm", ylabel="z, mm", aspect="equal")
    axes.autoscale_view()
    figure.colorbar(drawn, ax=axes, shrink=0.8)


def _owners(case: Case, outside: Integers) -> Integers:
    """The element (f,) of each face (f, m) of the skin, given by its nodes."""
    free = free_faces(case)
    nodes = np.take_along_axis(case.connectivity[free[:, 0]], case.element.faces[free[:, 1]], axis=1)
    owner = {frozenset(row): int(e) for row, e in zip(nodes.tolist(), free[:, 0], strict=True)}
    return np.array([owner.get(frozenset(row), 0) for row in outside.tolist()], np.int64)


def _often(axes: Axes, measure: Measure) -> None:
    low, high = float(measure.values.min()), float(measure.values.max())
    room = max(1e-6 * max(abs(low), abs(high)), 1e-12)  # of a regular mesh, whose elements are all alike
    axes.hist(measure.values, bins=30, range=(low - room, high + room), color=BEFORE)
    axes.axvline(measure.limit, color=AFTER, lw=1.0)
    unit = f", {measure.unit}" if measure.unit else ""
    axes.set(xlabel=f"{measure.name}{unit}", ylabel="elements" if measure.name.startswith("Jac") else "")
    axes.set_title(f"{len(measure.poor)} beyond {measure.limit:g}", fontsize=9)


MATERIALS = (MEASURED, "#e8d5a9", "#c9b8d9", "#b5d6c6", "#dfb7b0", "#bccbe6")  # again from the first
VIEWS = (("from the side", 1, 1.0), ("from below", 2, -1.0))  # what it looks along, and from which end


def as_read(case: Case, *, title: str) -> bytes:
    """A PNG of a deck's structure from the side and from below: its skin by materials, with layers and
    supports; and the surfaces under pressure, with the share of it that each carries."""
    skin = free_faces(case)
    owner = np.zeros(len(case.connectivity), int)
    for k, rows in enumerate(case.element_sets[name] for name in case.materials):
        owner[rows] = k
    colours = [MATERIALS[k % len(MATERIALS)] for k in owner[skin[:, 0]]]
    loaded = _loaded(case)
    with style({"axes.grid": False}):
        figure = Figure(figsize=(11.0, 7.0), layout="constrained")
        for row, (where, along, sign) in enumerate(VIEWS):
            outside, inside = (figure.add_subplot(2, 2, 2 * row + column + 1) for column in (0, 1))
            _faces(outside, case, case.nodes_of_faces(skin), colours, along, sign)
            for sheet in case.layers:
                faces = case.face_nodes(sheet.surface)
                _faces(outside, case, faces, [EXTRA] * len(faces), along, sign, alpha=0.6)
            _held(outside, case, along)
            for faces, share in loaded:
                strength = 0.25 + 0.75 * min(share, 1.0)
                _faces(inside, case, faces, [AFTER] * len(faces), along, sign, alpha=strength)
            for axes, what in ((outside, "what was read"), (inside, "under pressure")):
                _framed(axes, case, along, f"{where}: {what}")
        figure.suptitle(title, color=INK, fontsize=10)
        figure.legend(handles=_legend(case), loc="outside lower center", ncols=4)
        return png(figure)


def _loaded(case: Case) -> list[tuple[Integers, float]]:
    """The faces (f, m) under pressure, by surface, and the share of the largest one that they carry."""
    if case.pressurised is None:
        return []
    shares = case.shares or {case.pressurised: 1.0}
    return [(case.face_nodes(name), abs(share)) for name, share in shares.items()]


def _faces(
    axes: Axes, case: Case, faces: Integers, colours: Sequence[str], along: int, sign: float,
    *, alpha: float = 1.0,
) -> None:
    """Faces as seen along an axis, the nearest ones last."""
    if not len(faces):
        return
    places = case.nodes[faces[:, list(case.element.corners)]]
    order = np.argsort(sign * places[..., along].mean(axis=1), kind="stable")
    seen = [i for i in range(3) if i != along]
    axes.add_collection(PolyCollection(
        list(places[order][..., seen]), facecolors=[colours[k] for k in order], edgecolors="white",
        linewidths=0.2, alpha=alpha,
    ))  # fmt: skip


def _held(axes: Axes, case: Case, along: int) -> None:
    """The nodes that supports hold: all three components, or some."""
    seen = [i for i in range(3) if i != along]
    held = case.supported
    held[case.clamped] = True
    count = held.sum(axis=1)
    for nodes, mark, colour in ((count == 3, "s", BEFORE), ((count > 0) & (count < 3), ".", NOISE)):
        x: Array = case.nodes[nodes][:, seen]
        axes.plot(x[:, 0], x[:, 1], mark, color=colour, ms=2.5, mew=0)


def _framed(axes: Axes, case: Case, along: int, title: str) -> None:
    a, b = (i for i in range(3) if i != along)
    low, high = case.nodes.min(axis=0), case.nodes.max(axis=0)
    room = 0.05 * float((high - low).max())
    axes.set(
        title=title, xlabel=f"{'xyz'[a]}, mm", ylabel=f"{'xyz'[b]}, mm", aspect="equal",
        xlim=(low[a] - room, high[a] + room), ylim=(low[b] - room, high[b] + room),
    )  # fmt: skip


def _legend(case: Case) -> list[Patch | Line2D]:
    out: list[Patch | Line2D] = [
        Patch(color=MATERIALS[k % len(MATERIALS)], label=f"{name}: shear modulus {m.shear:.3g} MPa")
        for k, (name, m) in enumerate(case.materials.items())
    ]
    if case.layers:
        out.append(Patch(color=EXTRA, alpha=0.6, label=f"layers: {', '.join(map(_stiffness, case.layers))}"))
    shares = case.shares or ({case.pressurised: 1.0} if case.pressurised else {})
    out += [
        Patch(color=AFTER, alpha=0.25 + 0.75 * min(abs(s), 1.0), label=f"{name}: {_pressed(s)}")
        for name, s in shares.items()
    ]
    for mark, colour, what in (("s", BEFORE, "held in x, y and z"), (".", NOISE, "held in part")):
        out.append(Line2D([], [], ls="", marker=mark, color=colour, label=what))
    return out


def _pressed(share: float) -> str:
    return "under pressure" if share == 1 else f"{share:.3g} x the pressure"


def _stiffness(sheet: Layer) -> str:
    return f"{float(np.mean(sheet.stiffness)):.3g} N/mm"
