"""Read the files that `targetwriting` writes, or that a person does, back into displacement targets."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin import files
from twin.csvtable import Table, read_table
from twin.judging.stillnoise import stated_noise, still_noise
from twin.project.chambers import shares_by_surface
from twin.project.targetarrays import EXACT, FARTHEST, check_blocks, check_exact, check_log
from twin.project.targetschema import (
    FORMER_PLACE,
    LoadTable,
    NoiseOfPoint,
    NoiseTable,
    TargetMark,
    TargetsTable,
)
from twin.project.targetwriting import COLUMNS
from twin.sanity import pressure_fault, zero_fault
from twin.targets import Array, Load, Noise, PointKind, TargetPoint, Targets, least_known
from twin.validation import checked, tables_of

LATEST = 1e13  # s: any clock, and one that counts ms since 1970


def read_targets(folder: Path, *, nodes: Mapping[str, int] | None = None) -> Targets:
    """The targets of a folder; targets.csv alone is enough (no modes, no noise model then).

    `nodes` gives node labels by point name (twin.toml [[points]]); they must agree with targets.toml where it
    states them. A point whose node nobody states is of kind UNKNOWN. ValueError names file, line and column.
    """
    table = read_table(folder / "targets.csv", COLUMNS)
    about = _read_toml(folder / "targets.toml")
    exact = files.read_npz(folder / "targets.npz") if (folder / "targets.npz").exists() else {}
    stated = [n for n in (about.noise, *(b.noise for b in about.blocks)) if n is not None]
    if not exact and not all(n.told for n in stated):
        raise ValueError(
            f"{folder / 'targets.npz'} is missing, but targets.toml has a noise model whose modes and "
            "covariances it holds; put it back, or remove [noise] from targets.toml"
        )
    grid = _Grid.of(table)
    _check_pressure(folder, grid)
    told = _points(folder, about, grid.names, nodes or {})
    columns = _columns(table, grid, exact, folder)
    log = _read_log(folder, grid, columns["pressure_sd"])
    noises = _noises(folder, about, grid, exact, columns["value"])
    if any(n.told for n in stated):
        own = noises.get("noises") or (noises["noise"],) * (int(grid.block[-1]) + 1)
        columns["covariance"] = _at_least(columns["covariance"], np.array([n.sd for n in own])[grid.block])
    return Targets(
        time=grid.time, pressure=grid.pressure, block=grid.block, points=told, **columns,
        **_blocks(folder, about, grid), loads=_loads(folder, about, grid, told),
        **noises,
        log_time=log[0], log_pressure=log[1], reference=_reference(folder, about, grid, columns),
    )  # fmt: skip


def _check_pressure(folder: Path, grid: "_Grid") -> None:
    if fault := pressure_fault(float(np.abs(grid.pressure).max())):
        raise ValueError(f"{folder / 'targets.csv'}: pressure_MPa {fault}; convert them")
    if fault := zero_fault(grid.pressure):
        raise ValueError(f"{folder / 'targets.csv'}: pressure_MPa {fault}")


@dataclass(frozen=True)
class _Grid:
    """Where each row of the file stands: its step and point."""

    time: Array
    pressure: Array
    block: NDArray[np.int64]  # (s,) rank of the label
    labels: list[tuple[int, int]]  # (s,) block and step as the file has them
    names: tuple[str, ...]
    row: NDArray[np.int64]  # (s,p) row of the table

    @classmethod
    def of(cls, table: Table) -> "_Grid":
        keys = list(zip(table.integers("block").tolist(), table.integers("step").tolist(), strict=True))
        labels, names = sorted(set(keys)), tuple(dict.fromkeys(table.cells["point"]))
        at, point = {key: s for s, key in enumerate(labels)}, {name: p for p, name in enumerate(names)}
        row = np.full((len(labels), len(names)), -1, dtype=np.int64)
        for r, (key, name) in enumerate(zip(keys, table.cells["point"], strict=True)):
            if row[at[key], point[name]] >= 0:
                raise table.error(r, "point", f"block {key[0]}, step {key[1]} has this point twice")
            row[at[key], point[name]] = r
        if (row < 0).any():
            s, p = (int(i) for i in np.argwhere(row < 0)[0])
            raise ValueError(
                f"{table.path}: block {labels[s][0]}, step {labels[s][1]} has no row for point "
                f"{names[p]!r}; add one with empty cells where it was not observed and valid 0"
            )
        time = _per_step(table, "time_s", "s", row, most=LATEST)
        table_rows = row[:, 0].tolist()
        for s in np.flatnonzero(np.diff(time) <= 0)[:1].tolist():
            raise table.error(
                table_rows[s + 1],
                "time_s",
                f"wanted more than the {time[s]:g} s of the step before it: time is absolute across blocks",
            )
        blocks = sorted({b for b, _ in labels})
        block = np.array([blocks.index(b) for b, _ in labels], dtype=np.int64)
        return cls(time, _per_step(table, "pressure_MPa", "MPa", row), block, labels, names, row)


def _per_step(
    table: Table, column: str, unit: str, row: NDArray[np.int64], *, most: float = math.inf
) -> Array:
    """The value (s,) that all points of a step must share."""
    values: Array = table.numbers(column, unit=unit, most=most)[row]
    odd = np.argwhere(values != values[:, :1])
    if odd.size:
        s, p = (int(i) for i in odd[0])
        raise table.error(int(row[s, p]), column, f"the step's first row says {values[s, 0]:g} {unit}")
    return values[:, 0]


def _columns(table: Table, grid: _Grid, exact: dict[str, NDArray[Any]], folder: Path) -> dict[str, Any]:
    """Value, covariance, valid, modes and pressure_sd."""
    value, sd = (
        np.stack([table.numbers(f"{what}{i}_mm", unit="mm", empty=True, most=FARTHEST)[grid.row]
                  for i in (1, 2, 3)], axis=-1)
        for what in ("u", "sd")
    )  # fmt: skip
    valid = table.flags("valid")[grid.row][..., None] & ~np.isnan(value)
    for s, p, i in np.argwhere(valid & ~(np.nan_to_num(sd) > 0))[:1].tolist():
        raise table.error(
            int(grid.row[s, p]),
            f"sd{i + 1}_mm",
            f"u{i + 1}_mm is observed: wanted its standard deviation in mm, above 0, or valid 0",
        )
    if not exact:
        steps, points = value.shape[:2]
        covariance = np.full((steps, points, 3, 3), np.nan)
        variance = np.where(np.isnan(value), np.nan, sd**2)
        covariance[:] = np.where(
            np.isnan(variance)[..., :, None] | np.isnan(variance)[..., None, :], np.nan, 0.0
        )
        covariance[..., range(3), range(3)] = variance
        modes = {"modes": np.zeros((0, steps, points, 3)), "mode_names": ()}
        return {
            "value": value,
            "covariance": covariance,
            "valid": valid,
            "pressure_sd": np.zeros(steps),
        } | modes
    check_exact(folder / "targets.npz", exact, value=value, sd=sd, valid=valid)
    names = tuple(str(name) for name in exact["mode_names"])
    return (
        {"value": value}
        | {n: exact[n] for n in EXACT}
        | {"mode_names": names, "valid": exact["valid"] & valid}
    )


def _read_toml(path: Path) -> TargetsTable:
    """What targets.toml says; without it what it would say by default."""
    if not path.exists():
        return TargetsTable()
    return checked(TargetsTable, tables_of(path.read_bytes(), name=str(path)), name=str(path))


def _check_names(path: Path, rows: Sequence[TargetMark | NoiseOfPoint], names: tuple[str, ...]) -> None:
    """Raise ValueError where one names a point that targets.csv does not have, or two the same."""
    for k, row in enumerate(rows):
        if row.name not in names:
            raise ValueError(
                f"{path}: point {row.name!r} is not in targets.csv, which has {', '.join(names)}"
            )
        if row.name in [other.name for other in rows[:k]]:
            raise ValueError(f"{path}: point {row.name!r} stands twice; keep one of the two")


def _points(
    folder: Path, about: TargetsTable, names: tuple[str, ...], nodes: Mapping[str, int]
) -> tuple[TargetPoint, ...]:
    """The points (p,) of targets.csv with what targets.toml and twin.toml say of them."""
    path = folder / "targets.toml"
    _check_names(path, about.points, names)
    rows = {row.name: row for row in about.points}
    return tuple(_point(path, name, rows.get(name) or TargetMark(name=name), nodes.get(name))
                 for name in names)  # fmt: skip


def _point(path: Path, name: str, row: TargetMark, told: int | None) -> TargetPoint:
    """The point of a name: `row` is its table in targets.toml, `told` its node in twin.toml."""
    kind, node = _kind_and_node(row)
    if told is not None and kind not in (PointKind.NODE, PointKind.UNKNOWN):
        raise ValueError(
            f"{path}: point {name!r} has role {kind.value!r}, twin.toml gives it node {told}; correct one"
        )
    if told is not None and node is not None and node != told:
        raise ValueError(f"{path}: point {name!r} is node {node}, twin.toml says {told}; correct one")
    node = told if node is None else node
    if kind is PointKind.UNKNOWN and node is None and re.fullmatch("[0-9]{1,18}", name):
        node = int(name)
    return TargetPoint(name, kind if node is None else PointKind.NODE, node, row.position_mm)


def _kind_and_node(row: TargetMark) -> tuple[PointKind, int | None]:
    """What targets.toml says a point is, and its node; UNKNOWN and None where it does not say."""
    if row.role == "place" or row.node == FORMER_PLACE:
        return PointKind.PLACE, None
    if row.role == "fixed":
        return PointKind.FIXED, None
    return (PointKind.UNKNOWN, None) if row.node is None else (PointKind.NODE, row.node)


def _blocks(folder: Path, about: TargetsTable, grid: _Grid) -> dict[str, Any]:
    """Mask held_out (s,), gravity (blocks,3) or None, and shares of the pressure."""
    path = folder / "targets.toml"
    labels = sorted({b for b, _ in grid.labels})
    rows = {row.block: row for row in about.blocks}
    if len(rows) < len(about.blocks):
        raise ValueError(f"{path}: a block stands twice in [[blocks]]; keep one of the two")
    for label in rows.keys() - set(labels):
        raise ValueError(f"{path}: block {label} is not in targets.csv, which has {labels}")
    held_out = np.array([b in rows and rows[b].held_out for b, _ in grid.labels])
    out: dict[str, Any] = {"held_out": held_out, "gravity": None}
    try:
        stating = {f"block {b}": rows[b].pressure_shares if b in rows else {} for b in labels}
        out["shares"] = shares_by_surface(stating)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    stated = [rows[b].gravity for b in labels if b in rows and rows[b].gravity is not None]
    if not stated:
        return out
    if len(stated) != len(labels):
        raise ValueError(
            f"{path}: gravity is stated for {len(stated)} of {len(labels)} blocks; state all or none"
        )
    return out | {"gravity": np.array(stated)}


def _loads(
    folder: Path, about: TargetsTable, grid: _Grid, points: tuple[TargetPoint, ...]
) -> tuple[Load, ...]:
    """What hangs on the structure, by block."""
    path, labels = folder / "targets.toml", sorted({b for b, _ in grid.labels})
    names = [p.name for p in points if p.kind is not PointKind.FIXED]
    return tuple(
        _load(path, labels.index(row.block), load, names) for row in about.blocks for load in row.loads
    )


def _load(path: Path, block: int, row: LoadTable, names: Sequence[str]) -> Load:
    """The load of a table. ValueError where it is at no point on the finger."""
    if isinstance(row.at, str) and row.at not in names:
        raise ValueError(
            f"{path}: a load of block {block} is at {row.at!r}; wanted one of the points {', '.join(names)}, "
            "or a position [x, y, z] in mm"
        )
    return Load(block, row.at, row.weight_g, row.force_N)


def _reference(
    folder: Path, about: TargetsTable, grid: _Grid, columns: dict[str, Any]
) -> NDArray[np.int64]:
    """The steps that displacements are relative to; default the first, if it shows none."""
    if about.reference is not None:
        if about.reference.each_block:
            wanted = [(row.block, step) for row in about.blocks for step in row.reference_steps]
        else:
            own = about.reference.block
            wanted = [(grid.labels[0][0] if own is None else own, step) for step in about.reference.steps]
        for block, step in wanted:
            if (block, step) not in grid.labels:
                raise ValueError(
                    f"{folder / 'targets.toml'}: reference block {block}, step {step} is not in targets.csv"
                )
        return np.array([grid.labels.index(key) for key in wanted], dtype=np.int64)
    value = columns["value"][0]
    sd = np.sqrt(np.nan_to_num(np.diagonal(columns["covariance"][0], axis1=1, axis2=2)))
    for p, i in np.argwhere(np.abs(np.nan_to_num(value)) > 5 * sd)[:1].tolist():
        raise ValueError(
            f"{folder / 'targets.csv'}: displacements are relative to a reference step, but the first step "
            f"has U{i + 1} = {value[p, i]:g} mm at {grid.names[p]!r}; add the unloaded step with "
            "displacement 0 before it, or name the steps in targets.toml under [reference]"
        )
    return np.array([0], dtype=np.int64)


def _noises(
    folder: Path, about: TargetsTable, grid: _Grid, exact: dict[str, Any], value: Array
) -> dict[str, Any]:
    """The noise model, and those of the blocks (b,) where each has its own."""
    path, labels = folder / "targets.toml", sorted({b for b, _ in grid.labels})

    def read(table: NoiseTable, correlation: str, steps: NDArray[np.bool_]) -> Noise:
        if table.told:
            return _told_noise(path, table, value[steps], grid.pressure[steps])
        return _read_noise(path, table, grid.names, exact.get(correlation))

    if about.noise is not None:
        return {"noise": read(about.noise, "correlation", grid.block >= 0)}
    rows = {row.block: row.noise for row in about.blocks if row.noise is not None}
    if not rows:
        return {"noise": None}
    if len(rows) != len(labels):
        raise ValueError(f"{path}: {len(rows)} of {len(labels)} blocks have a noise model; state all or none")
    own = tuple(read(rows[b], f"correlation_{k}", grid.block == k) for k, b in enumerate(labels))
    return {"noise": least_known(own), "noises": own}


def _told_noise(path: Path, table: NoiseTable, value: Array, pressure: Array) -> Noise:
    """The noise model that [noise] states for all values (s, p, 3) mm, or says where they rest."""
    if table.sd_mm is not None:
        return stated_noise(value, table.sd_mm, table.rho)
    assert table.still_steps is not None  # one of both is there
    try:
        return still_noise(value, pressure, table.still_steps)
    except ValueError as error:
        raise ValueError(f"{path}: [noise] {error}") from None


def _at_least(covariance: Array, sd: Array) -> Array:
    """The covariance (s, p, 3, 3) mm2 with no variance below that of the noise, sd (s, p, 3) mm."""
    out = covariance.copy()
    diagonal = range(3)
    out[..., diagonal, diagonal] = np.maximum(out[..., diagonal, diagonal], sd**2)
    return out


def _read_noise(path: Path, table: NoiseTable, names: tuple[str, ...], correlation: Any) -> Noise:
    _check_names(path, table.points, names)
    rows = {row.name: row for row in table.points}
    missing = [f"points {name!r}" for name in names if name not in rows]
    if missing or correlation is None:
        raise ValueError(
            f"{path}: [noise] lacks {missing[0] if missing else 'correlation in targets.npz'}; "
            "measure again, or remove [noise]"
        )
    assert table.frames is not None  # checked
    assert table.gauge_frames is not None
    per = {key: np.array([getattr(rows[n], key) for n in names]) for key in ("sd_mm", "rho", "codec_sd_mm")}
    return Noise(
        sd=per["sd_mm"], rho=per["rho"], codec_sd=per["codec_sd_mm"], correlation=correlation,
        frames=table.frames, gauge_sd_MPa=table.gauge_sd_MPa or 0.0, gauge_frames=table.gauge_frames,
        lasting=table.lasting, basis=table.basis,
    )  # fmt: skip


def _read_log(folder: Path, grid: _Grid, pressure_sd: Array) -> tuple[Array, Array]:
    """The dense log, or the steps themselves (linear between them) where there is none."""
    path = folder / "pressure.csv"
    if not path.exists():
        return grid.time, grid.pressure
    table = read_table(path, ("block", "time_s", "pressure_MPa"))
    time, pressure = table.numbers("time_s", unit="s"), table.numbers("pressure_MPa", unit="MPa")
    table.increasing("time_s", time, unit="s")
    if time[0] > grid.time[0] or time[-1] < grid.time[-1]:
        raise ValueError(
            f"{path}: covers {time[0]:g} to {time[-1]:g} s, targets.csv {grid.time[0]:g} to "
            f"{grid.time[-1]:g} s; wanted a log that covers all steps"
        )
    labels = sorted({b for b, _ in grid.labels})
    check_blocks(path, table.integers("block"), time, labels=labels, block=grid.block, time=grid.time)
    check_log(path, (time, pressure), time=grid.time, pressure=grid.pressure, sd=pressure_sd)
    return time, pressure
