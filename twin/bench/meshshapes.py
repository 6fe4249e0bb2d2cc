"""Reports on a mesh: the shape of its elements, and its surface node nearest to a place."""

from collections.abc import Sequence

import numpy as np

from fe.mesh.elementshapes import Measure, quality
from twin.model.structure import Structure
from twin.table import DataTable
from twin.targets import Array


def shape_table(structure: Structure) -> list[str]:
    """The worst element by every measure, one line each, under a heading."""
    rows = [_row(m, structure) for m in quality(structure.case)]
    head = ("shape of the elements", "worst", "element", "poor beyond", "poor")
    widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()
            for row in (head, *rows)]  # fmt: skip


def _row(m: Measure, structure: Structure) -> tuple[str, ...]:
    unit = f" {m.unit}" if m.unit else ""
    return (m.name, f"{m.values[m.worst]:.3g}{unit}", str(structure.elements[m.worst]), f"{m.limit:g}{unit}",
            str(len(m.poor)))  # fmt: skip


def poor_shapes(structure: Structure) -> str:
    """A sentence on the elements of poor shape, "" where there are none."""
    measures = [m for m in quality(structure.case) if len(m.poor)]
    if not measures:
        return ""
    clauses = ", ".join(
        f"{m.name} of {len(m.poor)} beyond {m.limit:g} (worst: {m.values[m.worst]:.3g}, element "
        f"{structure.elements[m.worst]})"
        for m in measures
    )
    return f"Some elements have a poor shape: {clauses}. `twin look` draws them."


def shape_csv(structure: Structure) -> str:
    """One row an element: its number and every measure."""
    measures = quality(structure.case)
    columns = ["element", *(m.name.replace(", ", " ").replace(" ", "_") for m in measures)]
    rows = [
        [number, *(float(m.values[e]) for m in measures)]
        for e, number in enumerate(structure.elements.tolist())
    ]
    return DataTable(columns, rows).csv(digits=6)


def places_asked(texts: Sequence[str]) -> list[Array]:
    """The places (3,) mm that --at X,Y,Z names. ValueError where one is none."""
    return [_place(text) for text in texts]


def _place(text: str) -> Array:
    try:
        place = np.array([float(part) for part in text.split(",")])
    except ValueError:
        place = np.empty(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ValueError(f"--at {text!r}: wanted x,y,z in mm from the clamp, such as 110,11.5,0")
    return place


def nearest_node(structure: Structure, place: Array) -> tuple[int, str]:
    """The label of the surface node nearest to a place (3,) mm, and a sentence that says how far it is."""
    surface, case = np.unique(structure.outside), structure.case
    distance = np.linalg.norm(case.nodes[surface] - place, axis=1)
    row = surface[int(distance.argmin())]
    label = int(case.labels[row])
    x, y, z = (float(v) for v in np.round(case.nodes[row], 3) + 0.0)
    coordinates = ", ".join(f"{v:g}" for v in place)
    return label, (
        f"At ({coordinates}) mm: the nearest surface node is {label} at ({x:.5g}, {y:.5g}, {z:.5g}) mm, "
        f"{distance.min():.2f} mm away. For this node write node = {label}, for the place itself position_mm "
        f"= [{coordinates}]."
    )
