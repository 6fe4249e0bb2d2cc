"""What is drawn over the film's first picture, as SVG: tags with their roles, the model's outline with its
handles."""

from collections.abc import Mapping
from html import escape

import numpy as np

from twin.inputs.foundrecordings import Tags, first
from twin.setup.draft import Role
from twin.setup.outline import Handle, PlaneView
from twin.targets import Array

# Okabe and Ito, as in the plots: distinct with every kind of colour vision.
COLOURS: dict[Role, str] = {
    "frame": "#0072b2", "fixed": "#cc79a7", "clamp": "#8a5a00", "finger": "#009e73", "ignore": "#8a94a0"
}  # fmt: skip
OUTLINE = "#d55e00"
SIGNS: dict[Handle, str] = {"move": "move", "turn": "turn", "length_mm": "length", "height_mm": "height"}
REACH = 0.75  # of a tag's side: a click so near to its middle is on it
WIDE = 90.0  # of a picture's width is one unit that letters and handles are drawn in


def unit_of_picture(width: int) -> float:
    """The px that letters and handles are measured in, of a picture so many px wide."""
    return width / WIDE


def called(code: int) -> str:
    """What a tag of that id is called; dots are numbered from -1 down."""
    return f"tag {code}" if code >= 0 else f"dot {-code}"


def tag_at(film: Tags, pixel: Array) -> int | None:
    """The id of the tag at a pixel (2,), None where there is none."""
    if not film.codes:
        return None
    away = np.linalg.norm(first(film.centre) - pixel, axis=1)
    k = int(np.nanargmin(away))
    return film.codes[k] if away[k] <= REACH * _side(_rest(film)[k]) else None


def tags_svg(
    film: Tags, roles: Mapping[int, Role], names: Mapping[int, str], *, width: int, selected: int | None
) -> str:
    """The film's tags in the colour of their roles; those of the finger with their names."""
    unit, parts = unit_of_picture(width), []
    for code, quad in zip(film.codes, _rest(film), strict=True):
        colour, wide = COLOURS[roles[code]], 0.5 if code == selected else 0.2
        dash = f"{0.5 * unit:.2f}" if roles[code] == "ignore" else "none"
        shape = f'polygon points="{_points(quad)}"'
        if code < 0:
            x, y = quad.mean(axis=0)
            shape = f'circle cx="{x:.1f}" cy="{y:.1f}" r="{0.5 * _side(quad):.1f}"'
        parts.append(f'<{shape} fill="{colour}" fill-opacity="0.3" '
                     f'stroke="{colour}" '
                     f'stroke-width="{wide * unit:.2f}" stroke-dasharray="{dash}"/>')  # fmt: skip
        below = code in names or quad[:, 1].min() < 2 * unit
        y = quad[:, 1].max() + 1.5 * unit if below else quad[:, 1].min() - 0.4 * unit
        name = names.get(code) or called(code).removeprefix("tag ")
        parts.append(_text(name, quad[:, 0].mean(), y, unit, colour))
    return "".join(parts)


def outline_svg(
    contour: Array, handles: Mapping[Handle, Array], sight: PlaneView, *, width: int, held: Handle | None
) -> str:
    """The outline (n,2) mm of the frame, and its handles."""
    unit, colour = unit_of_picture(width), OUTLINE
    parts = [
        f'<polygon points="{_points(sight.px(contour))}" fill="{colour}" fill-opacity="0.12" stroke="white" '
        f'stroke-width="{0.5 * unit:.2f}" stroke-opacity="0.8"/>',
        f'<polygon points="{_points(sight.px(contour))}" fill="none" stroke="{colour}" '
        f'stroke-width="{0.25 * unit:.2f}"/>',
    ]
    seen = dict(zip(handles, sight.px(np.array(list(handles.values()))), strict=True))
    if {"turn", "move"} <= set(seen):
        (x0, y0), (x1, y1) = seen["move"], seen["turn"]
        parts.append(f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{colour}" '
                     f'stroke-width="{0.12 * unit:.2f}" stroke-dasharray="{0.5 * unit:.2f}"/>')  # fmt: skip
    for handle, (x, y) in seen.items():
        size = (1.1 if handle == held else 0.8) * unit
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size:.1f}" fill="white" stroke="{colour}" '
                     f'stroke-width="{0.3 * unit:.2f}"/>')  # fmt: skip
        parts.append(_text(SIGNS[handle], x, y - 1.2 * unit, unit, colour))
    return "".join(parts)


def _text(text: str, x: float, y: float, unit: float, colour: str) -> str:
    return (f'<text x="{x:.1f}" y="{y:.1f}" font-size="{1.5 * unit:.1f}" font-family="sans-serif" '
            f'text-anchor="middle" fill="{colour}" stroke="white" stroke-width="{0.4 * unit:.2f}" '
            f'paint-order="stroke" font-weight="bold">{escape(text)}</text>')  # fmt: skip


def _rest(film: Tags) -> Array:
    """Corners (n,4,2) px of the tags where they are first seen."""
    return first(film.quads.reshape(*film.quads.shape[:2], 8)).reshape(-1, 4, 2)


def _side(quad: Array) -> float:
    return float(np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).mean())


def _points(places: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
