"""Displacements of another program, with [import] of twin.toml, -> targets."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.fitmemory import MOST_BYTES, MOST_STEPS, steps_held
from twin.formats.basemotion import BASE, settling_rows, without_base
from twin.formats.importtable import ImportTable
from twin.formats.lostpoints import identity_faults
from twin.formats.recorded import PIXEL, Recorded, plain
from twin.formats.settledsteps import TOP_SD, settled_step
from twin.formats.supplied import (
    across_doubt,
    check_stated,
    mm_per_unit,
    pressure_of,
    read_course,
    times_of,
    turned,
)
from twin.gauge.agreement import check_agrees
from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Motion
from twin.judging.scatter import with_own_noise
from twin.judging.stillnoise import mean_variance, stated_noise, still_noise
from twin.marktables import PointTable
from twin.targets import Array, Noise, PointKind, TargetPoint, Targets, as_position, at_node

MOST_MODES = 90  # of references: with more points their error counts as one of each value
OFTEN = 0.9  # share of the rows in which a point is seen whose motion is compared with the pressure
COARSE_S = 0.25  # rows farther apart cannot tell another rate from a line that lags
DIGITS = 6  # of mm, as measured targets have
STILL = 0.05  # of the largest motion: a marker that moves less stays
BASE_TOLD = 3.0  # sds by which markers that stay must move to be told


NO_COURSE = (
    "What the pressure does between the rows is not known, so that effects with a memory (creep, mullins, "
    "pressure_lag) cannot be tested: give a pressure log as log under [import], or rows with times between "
    "which the pressure changes by a quarter at most."
)


def targets_of(
    recorded: Recorded, table: ImportTable, points: Sequence[PointTable], *, log: Path | None = None,
    parts: int = 1,
) -> tuple[Targets, list[str]]:
    """Targets of one block, and remarks for the user, one sentence each.

    points: those of twin.toml, by their names in the file. One that is none of them is left out, or with an
    origin taken for a point between nodes.   log: the path of the log that `table` names. ValueError names
    what is missing or does not fit.   parts: recordings that are fitted together.
    """
    check_stated(recorded, table, log)
    position = turned(recorded.position * mm_per_unit(recorded, table), table.axes or recorded.axes)
    time = times_of(recorded, table)
    pressure, between, doubt = pressure_of(recorded, table, time, log)
    course = read_course(recorded, table, time, log)
    position, time, pressure = (_after(table.first_step, x) for x in (position, time, pressure))
    rest = np.arange(min(table.rest_steps, len(position)))
    mean = _at_rest(position, rest)
    target_points, chosen, remarks = _points(recorded, table, mean, {point.name: point for point in points})
    position, base_sd, told_of_base = _of_base(recorded, table, position, mean, chosen)
    every = (position - mean)[:, chosen]
    most = _most_steps(every, table, len(rest), parts)
    keep = np.union1d(_even(len(position), most), rest)
    noise = _noise(every, pressure, table, thinned=len(position) / len(keep))
    noise = replace(noise, sd=np.hypot(noise.sd, base_sd[chosen]))
    scale_sd = table.scale_sd if recorded.unit == PIXEL else None
    if table.top_kPa is None:
        targets = _assembled(np.round(every[keep], DIGITS), target_points, noise, time=time[keep],
                             pressure=pressure[keep], log=between, rest=np.searchsorted(keep, rest),
                             scale_sd=scale_sd)  # fmt: skip
    else:
        targets, told_of_step = _step(table, every, time, target_points, noise, scale_sd)
        remarks, keep = [*remarks, told_of_step], np.arange(len(position))
    targets = with_own_noise(targets)
    targets = _held(targets, table.hold_sd_mm) if table.hold_sd_mm else targets
    told = [targets.noise.basis] if targets.noise and (not table.sd_mm or targets.noise is not noise) else []
    moved = every[:, [p for p, point in enumerate(target_points) if point.kind is not PointKind.FIXED]]
    across = across_doubt(moved, table.axes or recorded.axes)
    remarks += [*_identities(recorded, position[:, chosen], chosen, time), *filter(None, (across, doubt))]
    remarks += [*told_of_base, *_agreement(moved, time, course, noise, table)]
    sentences = [*_said(recorded, len(keep), len(position), most), *remarks, *told]
    return targets, [*sentences, *([] if targets.has_log or table.top_kPa is not None else [NO_COURSE])]


def _after(first: int, rows: Array) -> Array:
    """The rows (s, ...) without the first ones; ValueError where fewer than two are left."""
    if first > len(rows) - 2:
        raise ValueError(f"import.first_step = {first}: of {len(rows)} rows two or more must be left")
    return rows[first:]


def _of_base(
    recorded: Recorded, table: ImportTable, position: Array, mean: Array, chosen: Sequence[int]
) -> tuple[Array, Array, list[str]]:
    """Places (s,p,3) mm without the motion of the base, the sd (p,3) mm that this adds, and sentences on
    markers that stay."""
    names, none = recorded.names, np.zeros_like(mean)
    base, fixed = ([names.index(plain(name)) for name in some] for some in (table.base, table.fixed))
    still = base or fixed
    size = np.nan_to_num(np.linalg.norm(position - mean, axis=2)).max(axis=0)
    stays = still or [p for p in range(len(names)) if p not in chosen and size[p] < STILL * size.max()]
    told = []
    if rows := settling_rows(position, stays):
        told.append(
            f"In the first {rows} rows {', '.join(names[p] for p in stays)}, which stay, jump by up to "
            f"{size[stays].max():.2g} mm: the capture's filter settles. Write first_step = "
            f"{rows + table.first_step} under [import]"
        )
    if base:
        freed = without_base(position, mean, base, table.sd_mm or 0.0)
        at = float(freed.sd[list(chosen)].max())
        told.append(
            f"The base ({', '.join(names[p] for p in base)}) moves by up to {freed.moved:.2g} mm. Its rigid "
            f"motion is taken off: up to {freed.taken:.2g} mm at the points, known to {at:.2g} mm (1 sd)."
        )
        return freed.position, freed.sd, told
    if not still and len(stays) >= BASE and size[stays].max() > BASE_TOLD * (table.sd_mm or np.inf):
        listed = ", ".join(f'"{names[p]}"' for p in stays)
        told.append(
            f"Markers that are no points stay within {size[stays].max():.2g} mm. Where they are on the base, "
            f"base = [{listed}] under [import] takes its motion off."
        )
    return position, none, told


def _step(
    table: ImportTable, every: Array, time: Array, points: tuple[TargetPoint, ...], noise: Noise,
    scale_sd: float | None,
) -> tuple[Targets, str]:  # fmt: skip
    """The targets of a step whose top pressure alone is known: rest and hold, and a sentence on them."""
    assert table.top_kPa is not None
    top, sd = table.top_kPa, TOP_SD * table.top_kPa if table.top_sd_kPa is None else table.top_sd_kPa
    found = settled_step(every, table.rest_steps)
    value = np.round(np.array([found.rest - found.rest, found.hold - found.rest]), DIGITS)
    targets = _assembled(
        value, points, noise, time=np.array([time[0], time[found.begins :].mean()]), log=None,
        pressure=1e-3 * np.array([0.0, top]), rest=np.array([0]), scale_sd=scale_sd,
    )  # fmt: skip
    mode = np.nan_to_num(np.array([0.0 * found.drift, found.drift / 2]))
    targets = replace(
        targets, pressure_sd=1e-3 * np.array([0.0, sd]), modes=np.concatenate([targets.modes, mode[None]]),
        mode_names=(*targets.mode_names, "settling"),
    )  # fmt: skip
    moves = np.nanmax(np.abs(found.drift))
    told = f"Rest and mean of the last third are taken. What still moves there is an error, {moves:.2g} mm."
    known = f"Of the step the top pressure alone is known, {top:g} kPa with an sd of {sd:.2g} kPa."
    return targets, f"{known} {told}" if top else told


def _held(targets: Targets, sd_mm: float) -> Targets:
    """The targets of a body that a hand holds at rest, where a point may stand off by an sd in each
    direction: that of the one that moves most in the end, of others as much less as they move less."""
    moves = np.linalg.norm(np.nan_to_num(targets.value[-1]), axis=1)
    sd = sd_mm * moves / moves.max(initial=1e-12)
    after = np.setdiff1d(np.arange(len(targets.time)), targets.reference)
    modes, names = np.zeros((len(sd), 3, *targets.value.shape)), list(targets.mode_names)
    for p, point in enumerate(targets.names):
        for i in range(3):
            modes[p, i, after, p, i] = sd[p]
            names.append(f"hold:{point}:{i + 1}")
    held = np.where(targets.valid, modes, 0.0).reshape(-1, *targets.value.shape)
    return replace(targets, modes=np.concatenate([targets.modes, held]), mode_names=tuple(names))


def _identities(recorded: Recorded, position: Array, chosen: Sequence[int], time: Array) -> list[str]:
    """Sentences on points (s,p,3) mm that jump alone; ValueError where two exchange their places."""
    fault, jumps = identity_faults([recorded.names[p] for p in chosen], position, time)
    if fault:
        raise ValueError(fault)
    return jumps


def _agreement(moved: Array, time: Array, course: Log | None, noise: Noise, table: ImportTable) -> list[str]:
    """Sentences on how the points' motion (s,p,3) mm goes with the log, as on a film's; ValueError where it
    contradicts it. Points that are seldom seen do not count."""
    often = np.isfinite(moved).any(axis=2).mean(axis=0) >= OFTEN
    if course is None or not often.any() or np.median(np.diff(time)) > COARSE_S:
        return []
    squares = np.nansum(moved[:, often] ** 2, axis=2)
    complete = np.all(np.isfinite(moved[:, often]).any(axis=2), axis=1)
    mm = np.where(complete, np.sqrt(squares.mean(axis=1)), np.nan)
    motion = Motion(time - time[0], mm, float(np.nanmedian(noise.sd)))
    remedy = "Correct the times of the file"
    if table.fps is not None:
        remedy = f"Correct fps = {table.fps:g} under [import]"
    start = float(time[0])
    return [
        *check_agrees(motion, course, start, stated=True, key="import.start_s", remedy=remedy, moves="file")
    ]


def _noise(value: Array, pressure: Array, table: ImportTable, *, thinned: float) -> Noise:
    """The noise model of values (s,p,3) mm, stated or from their scatter; thinned: rows per kept row."""
    if table.sd_mm is not None:
        return stated_noise(value, table.sd_mm, table.rho**thinned)
    assert table.still_steps is not None  # checked
    still = table.still_steps
    if still != "holds":  # rows of the file
        still = tuple((max(a - table.first_step, 0), b - table.first_step) for a, b in still)
    noise = still_noise(value, pressure, still)
    return replace(noise, rho=noise.rho**thinned)


def _assembled(
    value: Array, points: tuple[TargetPoint, ...], noise: Noise, *, time: Array, pressure: Array,
    log: tuple[Array, Array] | None, rest: NDArray[np.int64], scale_sd: float | None,
) -> Targets:  # fmt: skip
    """The targets (s,p,3) with their covariance and shared errors; scale_sd: of a file in pixels."""
    seen = np.isfinite(value)
    modes = _modes(value, points, noise, len(rest))
    if scale_sd is not None:
        modes["scale"] = scale_sd * np.nan_to_num(value)
    single = 1 if any(name.startswith("reference:") for name in modes) else 1 + 1 / len(rest)
    both = seen[..., :, None] & seen[..., None, :]
    valid = seen.copy()
    if len(rest) == 1:
        valid[rest] = False  # zero by definition, not measured
    log_time, log_pressure = (time, pressure) if log is None else log
    return Targets(
        time=time, pressure=pressure, block=np.zeros(len(time), dtype=np.int64), points=points, value=value,
        covariance=np.where(both, single * noise.sd[:, :, None] ** 2 * np.eye(3), np.nan), valid=valid,
        held_out=np.zeros(len(time), dtype=bool), modes=np.array([*modes.values()]).reshape(-1, *value.shape),
        mode_names=tuple(modes), noise=noise, log_time=log_time, log_pressure=log_pressure, reference=rest,
        gravity=None, pressure_sd=np.zeros(len(time)),
    )  # fmt: skip


def _modes(value: Array, points: Sequence[TargetPoint], noise: Noise, rest: int) -> dict[str, Array]:
    """Errors (s,p,3) mm that many values share, 1 sd each: of each point's reference, the mean of so many
    steps at rest."""
    modes = {}
    if 3 * len(points) <= MOST_MODES:
        for p, i in np.argwhere(np.isfinite(value).any(axis=0)).tolist():
            mode = np.zeros_like(value)
            mode[:, p, i] = noise.sd[p, i] * np.sqrt(mean_variance(float(noise.rho[p, i]), rest))
            modes[f"reference:{points[p].name}:{i + 1}"] = np.where(np.isfinite(value), mode, 0.0)
    return modes


def _points(
    recorded: Recorded, table: ImportTable, mean: Array, points: Mapping[str, PointTable]
) -> tuple[tuple[TargetPoint, ...], list[int], list[str]]:
    """The target points, where each stands in the file, and what is to be said of the others."""
    fixed, base, names = [[plain(n) for n in found] for found in (table.fixed, table.base, recorded.names)]
    if base and (len(base) < BASE or set(base) & {*points, *fixed}):
        raise ValueError(
            f"import.base = {list(table.base)}: wanted {BASE} markers or more, none of which is in "
            "[[points]] or fixed"
        )
    for name in (*points, *fixed, *base):
        if name not in names:
            listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
            raise ValueError(
                f"point {name!r} is not in the file, which has {listed}; "
                "wanted a name that it has"
            )
    rest = mean if table.origin_mm is None else np.where(np.isfinite(mean), mean, 0.0) + table.origin_mm
    kinds = [_point(name, points, fixed, rest[p], table) for p, name in enumerate(names)]
    unseen: NDArray[np.bool_] = np.asarray(np.isnan(mean).all(axis=1))
    for p, point in enumerate(kinds):
        if point is not None and unseen[p] and point.name in (*points, *fixed):
            raise ValueError(
                f"point {point.name!r} is not seen in the first {table.rest_steps} steps, which "
                "displacements are relative to; raise rest_steps under [import], or leave it out"
            )
    chosen = [p for p, point in enumerate(kinds) if point is not None and not unseen[p]]
    out = [names[p] for p in range(len(names)) if p not in chosen and names[p] not in base]
    more = ", ..." if len(out) > 12 else ""
    omitted = [f"Left out, as [[points]] does not name them: {', '.join(out[:12])}{more}."] if out else []
    return tuple(point for p in chosen if (point := kinds[p]) is not None), chosen, omitted


def _point(
    name: str, points: Mapping[str, PointTable], fixed: Sequence[str], rest: Array, table: ImportTable
) -> TargetPoint | None:
    """A point of the file as a point of the model; None where neither twin.toml nor an origin places it."""
    rest_place = None if table.origin_mm is None else as_position(rest)
    point = points.get(name)
    if point is not None and point.node is not None:
        return at_node(name, point.node, rest_place)
    if point is not None:
        return TargetPoint(name, PointKind.PLACE, None, point.position_mm)
    if name in fixed:
        return TargetPoint(name, PointKind.FIXED, None, rest_place)
    return None if rest_place is None else TargetPoint(name, PointKind.PLACE, None, rest_place)


def _at_rest(position: Array, rest: NDArray[Any]) -> Array:
    """The mean place (p,3) in the steps at rest; NaN where a point was not seen in any of them."""
    seen = np.isfinite(position[rest])
    total = np.where(seen, position[rest], 0.0).sum(axis=0)
    return np.where(seen.any(axis=0), total / np.maximum(seen.sum(axis=0), 1), np.nan)


def _even(steps: int, most: int) -> NDArray[np.int64]:
    """Numbers of at most so many evenly spaced steps."""
    return np.unique(np.linspace(0, steps - 1, min(steps, most)).round().astype(np.int64))


def _most_steps(every: Array, table: ImportTable, rest: int, parts: int) -> int:
    """Most evenly spaced steps of displacements (s,p,3) whose errors a fit of so many parts holds."""
    components, points = int(np.isfinite(every).any(axis=0).sum()), every.shape[1]
    errors = 1 + 3 * points * (bool(table.hold_sd_mm) + (3 * points <= MOST_MODES))
    return steps_held(components, parts * errors, rest=rest, parts=parts)


def _said(recorded: Recorded, kept: int, steps: int, most: int) -> list[str]:
    room = f": a fit of so many points holds no more in {MOST_BYTES / 1e9:.0f} GB" * (most < MOST_STEPS)
    thinned = f"{kept} of {steps} steps are kept, evenly spaced{room}." if kept < steps else ""
    all_of_them = recorded.position.shape[0] * recorded.position.shape[1]
    missing = f"{recorded.missing} of {all_of_them} positions have {recorded.doubt}: they count as not seen."
    return [s for s in (thinned, missing if recorded.missing else "", *recorded.remarks) if s]
