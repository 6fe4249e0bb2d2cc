"""A folder of recordings, each a step to a pressure that its name states -> targets, a block a recording.

Of such a step the top alone is known: how the pressure rises, and how the body rings after it, is not. So
the first row and the mean of the hold are taken, and what still moves in the hold becomes an error of its
own that its values share. Markers that stay are the base: its rigid motion is taken off. Markers off the
surface turn with it.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fe import Case
from fe.element import Integers
from fe.mesh.mirror import symmetry_support
from fe.mesh.points import nearest_on_faces
from twin.formats.basemotion import BASE, exchanged, settling_rows, without_base
from twin.formats.catalogue import format_of, read_recorded
from twin.formats.importtable import ImportTable
from twin.formats.recorded import PIXEL, Recorded
from twin.formats.settledsteps import TOP_SD, settled_step
from twin.formats.supplied import check_unit, mm_per_unit, turned
from twin.gauge.pressureunits import in_MPa
from twin.judging.stillnoise import stated_noise
from twin.marktables import PointTable
from twin.targets import Array, PointKind, TargetPoint, Targets, as_position

PRESSURE = re.compile(r"(?<![\d.])(\d+(?:\.\d+)?)[ _-]?(mbar|hPa|kPa|MPa|bar|psi|Pa)(?![A-Za-z])")
STILL = 0.05  # of the largest motion: a marker that moves less is on the base
OFF_MM = 3.0  # from the surface, beyond which a marker is a ball or on a stalk
SAME_MM = 1.0  # two feet nearer to each other are one
STATED_MM = 5.0  # by which stated places may lie elsewhere to each other than the recordings have them
TOLD_MM = 1.0  # beyond which that is told


@dataclass(frozen=True)
class Take:
    """A recording: its file, the pressure in MPa, and the places (p, 3) mm in axes of the model at rest, in
    the hold, and by how much they still move in it; how many first rows were left out."""

    file: str
    pressure: float
    rest: Array
    hold: Array
    drift: Array
    first: int = 0


def pressure_in(name: str) -> float:
    """The pressure in MPa that the name of a file states. ValueError where it states none, or several.

    >>> round(pressure_in("arm - run 2_250mbar (V3).csv"), 6), pressure_in("beam 20 kPa.c3d")
    (0.025, 0.02)
    """
    found = PRESSURE.findall(Path(name).stem)
    if len(found) != 1:
        raise ValueError(
            f"--pressure-from name: {name} states {'no pressure' if not found else 'several pressures'}; "
            "wanted one with its unit, such as 250mbar or 40 kPa; rename the file"
        )
    value, unit = found[0]
    return float(in_MPa(np.array([float(value)]), unit, line=None)[0])


def takes_of(
    folder: Path, axes: str, unit: str = "", on_body: Sequence[str] = ()
) -> tuple[tuple[str, ...], list[Take]]:
    """The names (p,) of the markers of a folder's recordings, and the recordings by their pressures.

    axes, unit: the file's axes that are the model's x, y, z, and its unit of length, as in [import]. on_body:
    names of markers that are not on the base. ValueError where recordings have other markers, or two of them
    have exchanged their names.
    """
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in (".csv", ".c3d"))
    if not files:
        raise ValueError(f"{folder}: no recording; wanted .csv or .c3d files with a pressure in each name")
    every = [(f.name, read_recorded(f, format_of(f))) for f in files]
    names = every[0][1].names
    for file, recorded in every:
        if set(recorded.names) != set(names):
            odd = sorted(set(recorded.names) ^ set(names))
            raise ValueError(
                f"{file}: other markers than {every[0][0]}: {', '.join(odd)}; wanted the same in all"
            )
    found = (_take(f, r, names, axes, unit, on_body) for f, r in every)
    takes = sorted(found, key=lambda take: take.pressure)
    for take in takes[1:]:
        if swapped := exchanged(take.rest, takes[0].rest):
            a, b = (names[k] for k in swapped)
            raise ValueError(
                f"{take.file}: marker {a} lies at rest where {b} lies in {takes[0].file}: their names are "
                "exchanged; correct the file"
            )
    return names, takes


def _take(
    file: str, recorded: Recorded, names: tuple[str, ...], axes: str, unit: str, on_body: Sequence[str]
) -> Take:
    if recorded.unit == PIXEL:
        raise ValueError(f"{file}: in pixels; wanted positions in a unit of length")
    if recorded.pressure is not None:
        raise ValueError(f"{file}: has a pressure of its own; wanted no --pressure-from, leave it out")
    table = ImportTable(file=file, format="csv", sd_mm=1.0, unit=unit or None)
    check_unit(recorded, table)
    order = [recorded.names.index(name) for name in names]
    place = turned(recorded.position * mm_per_unit(recorded, table), axes or recorded.axes or "x,y,z")
    place = place[:, order]
    first = settling_rows(place, _stay(place, names, on_body))
    step = settled_step(place[first:])
    return Take(file, pressure_in(file), step.rest, step.hold, step.drift, first)


def _stay(place: Array, names: Sequence[str], on_body: Sequence[str]) -> list[int]:
    """Rows of the markers off the body that move by less than STILL of the largest motion."""
    far = np.linalg.norm(settled_step(place).hold - place[0], axis=1)
    return [k for k, name in enumerate(names) if name not in on_body and far[k] < STILL * np.nanmax(far)]


def takes_targets(
    folder: Path, places: Mapping[str, Array], *, case: Case, outside: Integers, sd_mm: float,
    axes: str = "", unit: str = "", held_out: Sequence[str] = (),
) -> tuple[Targets, dict[str, PointTable], list[str]]:  # fmt: skip
    """Targets of a folder of recordings, the points that the markers on the body are, and remarks.

    places: of the markers on the body (3,) mm, by name. case, outside (f, m): the body and its outer faces.
    held_out: parts of the names of recordings that no fit may see.
    """
    names, takes = takes_of(folder, axes, unit, tuple(places))
    if unknown := sorted(set(places) - set(names)):
        raise ValueError(f"--node {unknown[0]}: not in the files, which have {', '.join(names)}; correct it")
    if lost := [part for part in held_out if not any(part in take.file for take in takes)]:
        files = ", ".join(take.file for take in takes)
        raise ValueError(f"--hold-out {lost[0]}: in no file's name; wanted a part of one of {files}")
    base, remarks = _base(names, takes, places)
    moved, sd = _without_base(takes, base, sd_mm)
    if first := max(take.first for take in takes):
        remarks.append(
            f"Markers that stay jump in the first rows, {first} at most: the capture's filter settles. These "
            "rows are left out."
        )
    rows = [names.index(name) for name in places]
    stated, more = _as_recorded(takes, rows, places)
    remarks += more
    half = np.array([_half(x, case) for x in stated])
    feet = np.array([nearest_on_faces(case.element, case.nodes[outside], x) for x in half])
    off = np.linalg.norm(half - feet, axis=1)
    value, high = moved[:, rows], off > OFF_MM
    if high.any():
        told = ", ".join(f"{name} {mm:.1f}" for name, mm in zip(places, off, strict=True) if mm > OFF_MM)
        remarks.append(f"Markers off the surface, which turn with it rigidly: {told} mm.")
    flip = half[:, 1] != stated[:, 1]
    value[:, flip, 1] *= -1.0
    if flip.any():
        remarks.append("Half of the body is meshed: markers at y < 0 stand at their mirror images.")
    apart = np.linalg.norm(feet[:, None] - feet[None], axis=2) > SAME_MM
    once = np.array([apart[k, :k].all() for k in range(len(feet))])
    if not once.all():
        left = ", ".join(np.array(list(places))[~once])
        remarks.append(f"{left}: left out, as the mirror image of another marker stands for it.")
    remarks.append(
        f"Of each step the top pressure alone is known, with an sd of {100 * TOP_SD:g} %, as regulators have "
        "it. Its rest and the mean of its last third are taken; what still moves there is an error that a "
        "recording shares."
    )
    drift = np.array([take.drift for take in takes])[:, rows][:, once] / 2
    held = [any(part in take.file for part in held_out) for take in takes]
    on = {name: foot for name, foot, kept in zip(places, feet, once, strict=True) if kept}
    found = _assembled(on, takes, value[:, once], drift, held, np.hypot(sd_mm, sd[rows][once]))
    table = {
        name: PointTable(name=name, position_mm=as_position(x), standoff_mm=mm if mm > OFF_MM else None)
        for name, x, mm, kept in zip(places, half, off.tolist(), once, strict=True)
        if kept
    }
    return found, table, remarks


def _base(
    names: tuple[str, ...], takes: Sequence[Take], places: Mapping[str, Array]
) -> tuple[list[int], list[str]]:
    """Rows of the markers on the base, and what to say of them."""
    far = np.array([np.linalg.norm(take.hold - take.rest, axis=1) for take in takes]).max(axis=0)
    base = [k for k, name in enumerate(names) if name not in places and far[k] < STILL * far.max()]
    if len(base) < BASE:
        return [], ["No three markers stay: the base is taken as still."]
    told = ", ".join(names[k] for k in base)
    return base, [
        f"{told} move by at most {far[base].max():.2g} mm: the base, whose rigid motion is taken off."
    ]


def _without_base(
    takes: Sequence[Take], base: Sequence[int], sd_mm: float
) -> tuple[Array, Array]:
    """Displacements (t, p, 3) mm from rest to hold without the rigid motion of the base, and the sd (p, 3) in
    mm that its own error adds at most."""
    if not base:
        return np.array([take.hold - take.rest for take in takes]), np.zeros_like(takes[0].rest)
    freed = [without_base(take.hold[None], take.rest, base, sd_mm) for take in takes]
    moved = np.array([f.position[0] - take.rest for f, take in zip(freed, takes, strict=True)])
    return moved, np.max([f.sd for f in freed], axis=0)


def _as_recorded(
    takes: Sequence[Take], rows: Sequence[int], places: Mapping[str, Array]
) -> tuple[Array, list[str]]:
    """Places (p, 3) mm of the markers on the body, to each other as they are recorded at rest and on average
    as stated, and what to say of them. ValueError where the two contradict each other."""
    stated = np.array(list(places.values()))
    rest = np.nanmean([take.rest[rows] for take in takes], axis=0)
    recorded = rest + (stated - rest).mean(axis=0)
    off = np.linalg.norm(recorded - stated, axis=1)
    name, most = list(places)[int(off.argmax())], float(off.max())
    if most > STATED_MM:
        raise ValueError(
            f"--node {name}: to the other markers it lies {most:.2g} mm elsewhere than in the recordings at "
            f"rest; wanted at most {STATED_MM:g} mm: correct its place, or --axes"
        )
    if most < TOLD_MM:
        return stated, []
    return recorded, [
        f"The stated places of the markers differ from the recorded ones at rest by up to {most:.2g} mm "
        f"({name}): the recorded ones are used, shifted to the mean of the stated."
    ]


def _half(x: Array, case: Case) -> Array:
    """A place (3,) mm, or its mirror image where that is what is meshed."""
    return x * [1.0, -1.0, 1.0] if symmetry_support(case) is not None and x[1] < 0 else x


def _assembled(
    feet: Mapping[str, Array], takes: Sequence[Take], value: Array, drift: Array, held: Sequence[bool],
    sd: Array,
) -> Targets:  # fmt: skip
    n, p = 2 * len(takes), len(feet)
    u, valid, modes = np.zeros((n, p, 3)), np.zeros((n, p, 3), bool), np.zeros((len(takes), n, p, 3))
    variance = np.tile(sd[:, :, None] ** 2 * np.eye(3), (n, 1, 1, 1))
    u[1::2], valid[1::2] = np.round(value, 6), True
    for k in range(len(takes)):
        modes[k, 2 * k + 1] = np.nan_to_num(drift[k])
    pressure = np.zeros(n)
    pressure[1::2] = [take.pressure for take in takes]
    noise = stated_noise(u, float(np.sqrt((sd**2).mean())))
    time = np.arange(float(n))
    points = tuple(TargetPoint(name, PointKind.PLACE, None, as_position(x)) for name, x in feet.items())
    return Targets(
        time=time, pressure=pressure, block=np.arange(n) // 2, points=points, value=u,
        covariance=variance, valid=valid, held_out=np.repeat(held, 2),
        modes=modes, mode_names=tuple(f"settling:{take.file}" for take in takes),
        noise=replace(noise, sd=sd), log_time=time, log_pressure=pressure, reference=np.arange(0, n, 2),
        gravity=None, pressure_sd=TOP_SD * pressure,
    )  # fmt: skip
