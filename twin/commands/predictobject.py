"""What `twin predict --object` tells: the force on an object as rows, a sentence, a table, a picture."""

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from fe.element import triangles
from twin.bench.workbench import Workbench
from twin.calibrated.objectforce import RISE, Touched
from twin.drawing.touchplot import draw_touch
from twin.model.objects import RigidObject
from twin.records import Maybe, Record
from twin.tablemodel import Finite
from twin.targets import Array

NO_FORCE = 1e-4  # N: what the penalty's smooth beginning leaves of a finger that does not touch


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


def contact_rows(one: Touched) -> list[PredictedContact]:
    """A row a time."""
    every = zip(one.time, one.pressure, one.size, one.force, one.half, one.beyond, strict=True)
    return [
        PredictedContact(
            time_s=t, pressure_MPa=p, force_N=size, along_N=tuple(force),
            low_N=None if one.why else max(size - half[0], 0.0), high_N=None if one.why else size + half[0],
            half_N=(None,) * 3 if one.why else tuple(half[1:]), beyond=bool(beyond),
        )
        for t, p, size, force, half, beyond in every
    ]  # fmt: skip


def contact_csv(rows: Sequence[PredictedContact]) -> str:
    """The rows as a table."""
    lines = ["time_s,pressure_MPa,force_N,low_N,high_N,x_N,y_N,z_N,beyond"]
    for row in rows:
        ends = ["" if v is None else f"{v:.6g}" for v in (row.low_N, row.high_N)]
        cells = [f"{v:.6g}" for v in (row.time_s, row.pressure_MPa, row.force_N)]
        parts = [f"{v + 0.0:.6g}" for v in row.along_N]
        lines.append(",".join([*cells, *ends, *parts, str(row.beyond).lower()]))
    return "\n".join(lines) + "\n"


def pushed(one: Touched, thing: RigidObject) -> str:
    """A sentence on the force at the end of a course, or at its highest."""
    k = len(one.size) - 1 if len(one.size) <= RISE + 2 else int(one.size.argmax())
    begins = f"{1e3 * one.pressure[k]:.4g} kPa: "
    if one.size[k] < NO_FORCE:
        return f"{begins}the finger does not reach {thing.text}."
    row = contact_rows(one)[k]
    x, y, z = (v + 0.0 for v in row.along_N)
    parts = f"x {x:.3g}, z {z:.3g} N" if abs(y) < NO_FORCE else f"x {x:.3g}, y {y:.3g}, z {z:.3g} N"
    begun = one.pressure[one.size > NO_FORCE].min()
    gives = f" The object gives way by {one.yielded:.3g} mm at the end." if thing.spring is not None else ""
    return (
        f"{begins}the finger presses on {thing.text} with {_in_N(row)}: {parts}. It touches between "
        f"{1e3 * _before(one.pressure, begun):.3g} and {1e3 * begun:.3g} kPa.{gives}"
    )


def _before(pressure: Array, begun: float) -> float:
    """The highest of the pressures (s,) below one of them, or that one."""
    return float(pressure[pressure < begun].max(initial=min(0.0, begun)))


def contact_picture(bench: Workbench, meets: Sequence[Touched], thing: RigidObject) -> bytes:
    """Of the course with the highest pressure: over pressure where it is held, else over time."""
    one = max(meets, key=lambda m: float(m.pressure.max()))
    held = len(one.time) == RISE + 2
    end = one.shape[-1] if held else one.shape[int(one.size.argmax())]
    way = np.asarray(thing.way) / np.linalg.norm(thing.way) * np.sign(one.force[-1] @ thing.way)
    return draw_touch(
        1e3 * one.pressure if held else one.time, one.size, None if one.why else one.half[:, 0],
        label="pressure, kPa" if held else "time, s", nodes=bench.case.nodes, u=end,
        triangles=triangles(bench.structure.outside), obstacle=thing.shape, given_way=one.yielded * way,
    )  # fmt: skip


def told(own: bool) -> str:
    """What the force holds for; own: whether the film, too, is of a finger that meets the object."""
    free = "" if own else "The displacements are those of the finger that meets nothing. "
    return (
        f"{free}The force in contact.csv and contact.png is that of a finger which begins at rest: what the "
        "film made creep or soften is not in it. Its interval has the errors of the constants and of the "
        "mesh's stiffness, and no other error of the mesh."
    )


def _in_N(row: PredictedContact) -> str:
    if row.low_N is None or row.high_N is None:
        return f"{row.force_N:.3g} N"
    return f"{row.force_N:.3g} N (95 %: {row.low_N:.3g} to {row.high_N:.3g})"
