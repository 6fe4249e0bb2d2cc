"""Draws what a user's mesh was read as: materials, layers, supports, ties, and where the pressure acts."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fe import Case
from fe.case import Layer
from fe.element import Integers
from fe.mesh.refine import free_faces
from twin.drawing.theme import AFTER, BEFORE, EXTRA, INK, MEASURED, NOISE, png, style
from twin.targets import Array

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
