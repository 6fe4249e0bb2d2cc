"""Results of `twin predict --object`: the force on an object as rows, sentence, table and picture."""

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from fe.element import triangles
from twin.bench.workbench import Workbench
from twin.calibrated.objectforce import RISE, Touched
from twin.drawing.touchplot import draw_touch
from twin.model.objects import RigidObject
from twin.records import Maybe, Record
from twin.table import DataTable
from twin.tablemodel import Finite
from twin.targets import Array

NO_FORCE = 1e-4  # N: what the penalty's smooth beginning leaves of a finger that does not touch


class PredictedForce(Record):
    """The force upwards on the end face that keeps its middle at its height."""

    pressure_MPa: Finite
    force_N: Finite
    low_N: Maybe = Field(description="95 % interval; null where the fit has none")
    high_N: Maybe
    beyond: bool = Field(description="above the pressure that was tested")


class PredictedContact(Record):
    """The force of the finger on an object at one time."""

    time_s: Finite
    pressure_MPa: Finite
    force_N: Finite = Field(description="its size")
    low_N: Maybe = Field(description="95 % interval; null where the fit has none")
    high_N: Maybe
    along_N: tuple[Finite, Finite, Finite] = Field(description="its parts along x, y, z")
    half_N: tuple[Maybe, Maybe, Maybe] = Field(description="half of the 95 % intervals of these parts")
    beyond: bool = Field(description="above the pressure that was tested")


def contact_rows(contact: Touched) -> list[PredictedContact]:
    """A row a time."""
    every = zip(
        contact.time, contact.pressure, contact.size, contact.force, contact.half, contact.beyond, strict=True
    )
    return [
        PredictedContact(
            time_s=t, pressure_MPa=p, force_N=size, along_N=tuple(force),
            low_N=None if contact.why else max(size - half[0], 0.0),
            high_N=None if contact.why else size + half[0],
            half_N=(None,) * 3 if contact.why else tuple(half[1:]), beyond=bool(beyond),
        )
        for t, p, size, force, half, beyond in every
    ]  # fmt: skip


def contact_csv(rows: Sequence[PredictedContact]) -> str:
    """The rows as a table."""
    columns = ("time_s", "pressure_MPa", "force_N", "low_N", "high_N", "x_N", "y_N", "z_N", "beyond")
    cells = [
        [row.time_s, row.pressure_MPa, row.force_N, row.low_N, row.high_N, *(v + 0.0 for v in row.along_N),
         row.beyond]
        for row in rows
    ]  # fmt: skip
    return DataTable(columns, cells).csv(digits=6)


def pushed(contact: Touched, obstacle: RigidObject) -> str:
    """A sentence on the force at the end of a course, or at its highest."""
    k = len(contact.size) - 1 if len(contact.size) <= RISE + 2 else int(contact.size.argmax())
    begins = f"{1e3 * contact.pressure[k]:.4g} kPa: "
    if contact.size[k] < NO_FORCE:
        return f"{begins}the finger does not reach {obstacle.text}."
    row = contact_rows(contact)[k]
    x, y, z = (v + 0.0 for v in row.along_N)
    parts = f"x {x:.3g}, z {z:.3g} N" if abs(y) < NO_FORCE else f"x {x:.3g}, y {y:.3g}, z {z:.3g} N"
    begun = contact.pressure[contact.size > NO_FORCE].min()
    gives = (
        f" The object gives way by {contact.yielded:.3g} mm at the end."
        if obstacle.spring is not None
        else ""
    )
    return (
        f"{begins}the finger presses on {obstacle.text} with {in_N(row)}: {parts}. It touches between "
        f"{1e3 * _before(contact.pressure, begun):.3g} and {1e3 * begun:.3g} kPa.{gives}"
    )


def _before(pressure: Array, begun: float) -> float:
    """Highest pressure of (s,) below the first contact, or 0."""
    return float(pressure[pressure < begun].max(initial=min(0.0, begun)))


def contact_picture(bench: Workbench, contacts: Sequence[Touched], obstacle: RigidObject) -> bytes:
    """Of the course with the highest pressure: over pressure where it is held, else over time."""
    contact = max(contacts, key=lambda m: float(m.pressure.max()))
    held = len(contact.time) == RISE + 2
    end = contact.shape[-1] if held else contact.shape[int(contact.size.argmax())]
    direction = (
        np.asarray(obstacle.way) / np.linalg.norm(obstacle.way) * np.sign(contact.force[-1] @ obstacle.way)
    )
    return draw_touch(
        1e3 * contact.pressure if held else contact.time, contact.size,
        None if contact.why else contact.half[:, 0], label="pressure, kPa" if held else "time, s",
        nodes=bench.case.nodes, u=end, triangles=triangles(bench.structure.outside), obstacle=obstacle.shape,
        given_way=contact.yielded * direction,
    )  # fmt: skip


def told(in_film: bool) -> str:
    """A sentence on the validity of the force; in_film: the filmed finger met the object, too."""
    free = "" if in_film else "The displacements are those of the finger that meets nothing. "
    return (
        f"{free}The force in contact.csv and contact.png is that of a finger which begins at rest: what the "
        "film made creep or soften is not in it. Its interval has the errors of the constants and of the "
        "mesh's stiffness, and no other error of the mesh."
    )


def in_N(force: PredictedForce | PredictedContact) -> str:
    """A force with its 95 % interval in words."""
    if force.low_N is None or force.high_N is None:
        return f"{force.force_N:.3g} N"
    return f"{force.force_N:.3g} N (95 %: {force.low_N:.3g} to {force.high_N:.3g})"
