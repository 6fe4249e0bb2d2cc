"""Displacement targets as files that a person can read and write: targets.csv, targets.toml, targets.npz and
pressure.csv, bit for bit."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray

from twin import files
from twin.csvtable import Table, read_table
from twin.project.record import SourceRecord
from twin.project.targetschema import TargetsTable, fields_from, tables_for
from twin.sanity import MOST_MPA, pressure_fault, zero_fault
from twin.targets import COLUMNS, Array, Targets
from twin.validation import checked, tables_of

EXACT = ("covariance", "valid", "modes", "mode_names", "pressure_sd")  # what targets.npz adds to the text
LOG = ("block", "time_s", "pressure_MPa")
HEAD = (
    "Displacements in mm relative to the mean of the reference steps; nan: not observed.",
    "World axes: x along the finger from the clamp, y across the width, z up; the finger bends to -z.",
)
FARTHEST = 1e6  # mm, of displacements and their errors: below it a wrong unit is told by what it does
UNITS = {"mm": FARTHEST, "s": 1e13, "MPa": np.inf}  # largest value of each: any clock, also in ms since 1970
WAY_OUT = "restore targets.csv, or remove targets.npz to use the csv alone"
ROUND = 1e-9  # relative rounding of a matrix that was symmetric, or had no negative eigenvalue
KIND = {"b": "booleans", "U": "text", "f": "numbers"}
APART = 0.05  # of the largest pressure, between the log and the steps


# -- writing -------------------------------------------------------------------------------------------------


def write_targets(folder: Path, targets: Targets, *, source: SourceRecord | None = None) -> None:
    """Write the folder in one step. ValueError if it is there.   source: what it was measured from."""
    if folder.exists():
        raise ValueError(f"{folder} is there already and is never overwritten; move it away first")
    with files.whole_folder(folder) as draft:
        files.write_text(draft / "targets.csv", _csv(targets))
        files.write_text(draft / "targets.toml", _toml(targets))
        files.write_npz(draft / "targets.npz", _exact(targets))
        if targets.has_log:
            files.write_text(draft / "pressure.csv", _log_csv(targets))
        if source is not None:
            files.write_json(draft / source.file, source)


def _exact(targets: Targets) -> dict[str, NDArray[Any]]:
    """The arrays of targets.npz."""
    exact = {name: np.asarray(getattr(targets, name)) for name in EXACT}
    exact["mode_names"] = np.array(targets.mode_names, dtype=str)
    if targets.noises:
        return exact | {f"correlation_{b}": n.correlation for b, n in enumerate(targets.noises)}
    return exact if targets.noise is None else exact | {"correlation": targets.noise.correlation}


def _csv(targets: Targets) -> str:
    """One row a step and point; values in full, sds to 6 digits (targets.npz has them in full)."""
    cells = {name: column.tolist() for name, column in targets.columns().items()}
    for name in (name for name in cells if name.startswith("sd")):
        cells[name] = [float(f"{sd:.6g}") for sd in cells[name]]
    return _rows(cells)


def _log_csv(t: Targets) -> str:
    """The dense log; a sample between two blocks belongs to the nearer one."""
    starts = np.flatnonzero(np.diff(t.block))
    block = np.searchsorted((t.time[starts] + t.time[starts + 1]) / 2, t.log_time, side="right")
    columns = (block.tolist(), t.log_time.tolist(), t.log_pressure.tolist())
    return _rows(dict(zip(LOG, columns, strict=True)))


def _rows(cells: Mapping[str, list[Any]]) -> str:
    """The text of a CSV file with these columns; NaN is an empty cell, a mask 1 or 0."""

    def text(cell: Any) -> str:
        return "" if cell != cell else str(int(cell) if isinstance(cell, bool) else cell)

    return "".join(f"{','.join(map(text, row))}\n" for row in (cells, *zip(*cells.values(), strict=True)))


def _toml(targets: Targets) -> str:
    """The text of targets.toml: reference, blocks, points, noise."""
    tables = tables_for(targets).model_dump(exclude_unset=True, exclude_none=True)
    return "".join(f"# {line}\n" for line in HEAD) + "\n" + tomlkit.dumps(tables)


# -- reading -------------------------------------------------------------------------------------------------


def read_targets(folder: Path, *, nodes: Mapping[str, int] | None = None) -> Targets:
    """The targets of a folder; targets.csv alone is enough (no modes, no noise model then).

    nodes: labels by point name (twin.toml [[points]]); they must agree with targets.toml where it states
    them. A point whose node nobody states is of kind UNKNOWN. ValueError names file, line and column.
    """
    path, about = folder / "targets.csv", TargetsTable()
    table = read_table(path, tuple(COLUMNS))
    if (toml := folder / "targets.toml").exists():
        about = checked(TargetsTable, tables_of(files.read_bytes(toml), name=str(toml)), name=str(toml))
    exact = files.read_npz(npz) if (npz := folder / "targets.npz").exists() else {}
    noises = [n for n in (about.noise, *(b.noise for b in about.blocks)) if n is not None]
    if not exact and not all(n.is_stated for n in noises):
        raise ValueError(
            f"{npz} is missing, but targets.toml has a noise model whose modes and covariances it holds; put "
            "it back, or remove [noise] from targets.toml"
        )
    grid = _Grid.of(table)
    fault = pressure_fault(float(np.abs(grid.pressure).max()))
    if fault := f"{fault}; convert them" if fault else zero_fault(grid.pressure):
        raise ValueError(f"{path}: pressure_MPa {fault}")
    measured = _measured(table, grid, exact, npz)
    described = fields_from(
        about, toml, grid.steps, grid.names, nodes=nodes or {}, value=measured["value"],
        pressure=grid.pressure, correlations=exact,
    )  # fmt: skip
    if any(n.is_stated for n in noises):
        each = described.get("noises") or (described["noise"],) * (int(grid.block[-1]) + 1)
        diagonal = measured["covariance"][..., range(3), range(3)]
        least = np.array([n.sd for n in each])[grid.block] ** 2
        measured["covariance"] = measured["covariance"].copy()
        measured["covariance"][..., range(3), range(3)] = np.maximum(diagonal, least)
    log = _read_log(folder / "pressure.csv", grid, measured["pressure_sd"])
    if "reference" not in described:
        described["reference"] = _first_step(path, grid.names, measured)
    targets = Targets(
        time=grid.time, pressure=grid.pressure, block=grid.block, **measured, **described,
        log_time=log[0], log_pressure=log[1],
    ).logged  # fmt: skip
    if not any(n.is_stated for n in noises):
        return targets
    from twin.judging.scatter import with_own_noise

    return with_own_noise(targets)


def _numbers(table: Table, name: str) -> Array:
    """A column (rows,) in the unit that its heading ends with; of mm an empty cell is NaN: not observed."""
    unit = name.rsplit("_", 1)[1]
    return table.numbers(name, unit=unit, empty=unit == "mm", most=UNITS[unit])


@dataclass(frozen=True)
class _Grid:
    """The rows of targets.csv by step and point."""

    time: Array
    pressure: Array
    block: NDArray[np.int64]  # (s,) rank of the label
    steps: list[tuple[int, int]]  # (s,) block and step as the file has them
    names: tuple[str, ...]
    row: NDArray[np.int64]  # (s,p) row of the table

    @classmethod
    def of(cls, table: Table) -> "_Grid":
        keys = np.stack([table.integers("block"), table.integers("step")], axis=1)
        steps, step = np.unique(keys, axis=0, return_inverse=True)
        names = tuple(dict.fromkeys(table.cells["point"]))
        number = {name: p for p, name in enumerate(names)}
        point = np.array([number[name] for name in table.cells["point"]])
        cell = step.reshape(-1) * len(names) + point
        cells, row_of_cell = np.unique(cell, return_index=True)
        for r in np.setdiff1d(np.arange(len(table)), row_of_cell)[:1].tolist():
            raise table.error(r, "point", f"block {keys[r, 0]}, step {keys[r, 1]} has this point twice")
        for k in np.setdiff1d(np.arange(len(steps) * len(names)), cells)[:1].tolist():
            label = "block {}, step {}".format(*steps[k // len(names)])
            raise ValueError(
                f"{table.path}: {label} has no row for point "
                f"{names[k % len(names)]!r}; add one with empty cells where it was not observed and valid 0"
            )
        row = row_of_cell.reshape(len(steps), len(names))
        time, pressure = _per_step(table, "time_s", row), _per_step(table, "pressure_MPa", row)
        for s in np.flatnonzero(np.diff(time) <= 0)[:1].tolist():
            before = f"the {time[s]:g} s of the step before it: time is absolute across blocks"
            raise table.error(int(row[s + 1, 0]), "time_s", f"wanted more than {before}")
        block = np.unique(steps[:, 0], return_inverse=True)[1].reshape(-1)
        return cls(time, pressure, block, [(b, n) for b, n in steps.tolist()], names, row)


def _per_step(table: Table, column: str, row: NDArray[np.int64]) -> Array:
    """The value (s,) that all points of a step must share."""
    values = _numbers(table, column)[row]
    for s, p in np.argwhere(values != values[:, :1])[:1].tolist():
        common = f"{values[s, 0]:g} {column.rsplit('_', 1)[1]}"
        raise table.error(int(row[s, p]), column, f"the step's first row says {common}")
    return values[:, 0]


def _measured(table: Table, grid: _Grid, exact: Mapping[str, NDArray[Any]], npz: Path) -> dict[str, Any]:
    """Value, covariance, valid, modes and pressure_sd."""
    value, sd = (
        np.stack([_numbers(table, f"{what}{i}_mm")[grid.row] for i in (1, 2, 3)], axis=-1)
        for what in ("u", "sd")
    )
    valid = table.flags("valid")[grid.row][..., None] & ~np.isnan(value)
    for s, p, i in np.argwhere(valid & ~(np.nan_to_num(sd) > 0))[:1].tolist():
        raise table.error(
            int(grid.row[s, p]),
            f"sd{i + 1}_mm",
            f"u{i + 1}_mm is observed: wanted its standard deviation in mm, above 0, or valid 0",
        )
    if exact:
        _check_exact(npz, exact, value=value, sd=sd, valid=valid)
        names = tuple(str(name) for name in exact["mode_names"])
        fields = {"value": value} | {name: exact[name] for name in EXACT}
        return fields | {"mode_names": names, "valid": exact["valid"] & valid}
    variance = np.where(np.isnan(value), np.nan, sd**2)
    seen = ~np.isnan(variance)
    covariance = np.where(seen[..., :, None] & seen[..., None, :], 0.0, np.nan)
    covariance[..., range(3), range(3)] = variance
    return {
        "value": value, "covariance": covariance, "valid": valid, "pressure_sd": np.zeros(len(value)),
        "modes": np.zeros((0, *value.shape)), "mode_names": (),
    }  # fmt: skip


def _first_step(path: Path, names: tuple[str, ...], measured: Mapping[str, Array]) -> NDArray[np.int64]:
    """The first step (1,) as the reference. ValueError where it shows a displacement."""
    value = measured["value"][0]
    sd = np.sqrt(np.nan_to_num(np.diagonal(measured["covariance"][0], axis1=1, axis2=2)))
    for p, i in np.argwhere(np.abs(np.nan_to_num(value)) > 5 * sd)[:1].tolist():
        raise ValueError(
            f"{path}: displacements are relative to a reference step, but the first step has U{i + 1} = "
            f"{value[p, i]:g} mm at {names[p]!r}; add the unloaded step with displacement 0 before it, or "
            "name the steps in targets.toml under [reference]"
        )
    return np.array([0], dtype=np.int64)


def _read_log(path: Path, grid: _Grid, pressure_sd: Array) -> tuple[Array, Array]:
    """The dense log, or the steps themselves (linear between them) where there is none."""
    if not path.exists():
        return grid.time, grid.pressure
    table = read_table(path, LOG)
    time, pressure = (table.numbers(name, unit=name.rsplit("_", 1)[1]) for name in LOG[1:])
    table.increasing("time_s", time, unit="s")
    if time[0] > grid.time[0] or time[-1] < grid.time[-1]:
        raise ValueError(
            f"{path}: covers {time[0]:g} to {time[-1]:g} s, targets.csv {grid.time[0]:g} to "
            f"{grid.time[-1]:g} s; wanted a log that covers all steps"
        )
    _check_blocks(path, table.integers("block"), time, grid)
    _check_log(path, (time, pressure), grid, pressure_sd)
    return time, pressure


# -- checks of targets.npz and of the log --------------------------------------------------------------------


def _check_exact(
    path: Path, exact: Mapping[str, NDArray[Any]], *, value: Array, sd: Array, valid: NDArray[Any]
) -> None:
    """Raise ValueError where targets.npz is not what it should be, or does not belong to targets.csv, which
    has value and sd (s, p, 3) mm and valid (s, p, 3)."""
    missing = [name for name in EXACT if name not in exact]
    if missing:
        raise ValueError(f"{path}: array {missing[0]!r} is missing; {WAY_OUT}")
    correlations = [name for name in exact if re.fullmatch(r"correlation(_\d+)?", name)]
    extra = sorted(set(exact) - {*EXACT, *correlations})
    if extra:
        raise ValueError(f"{path}: array {extra[0]!r} is not known; wanted {', '.join(EXACT)}, correlation")
    _check_shapes(path, exact, value.shape)
    valid = valid & exact["valid"]
    _check_finite(path, exact, valid)
    _check_covariance(path, exact["covariance"], valid)
    stored_sd = np.sqrt(np.diagonal(exact["covariance"], axis1=2, axis2=3)[valid])
    if not np.allclose(stored_sd, sd[valid], rtol=1e-4, atol=0):  # the csv holds 6 digits
        raise ValueError(f"{path}: its standard deviations are not those of targets.csv; {WAY_OUT}")
    for name in correlations:
        _check_correlation(path, name, exact[name])


def _check_shapes(path: Path, exact: Mapping[str, NDArray[Any]], shape: tuple[int, ...]) -> None:
    (s, p, _), k, made_for = shape, exact["mode_names"].size, exact["valid"].shape
    if made_for[:2] != (s, p) and len(made_for) == 3:
        raise ValueError(
            f"{path}: made for {made_for[:2]} steps and points, targets.csv has {(s, p)}; {WAY_OUT}"
        )
    each = {
        "covariance": ("f", (s, p, 3, 3)), "valid": ("b", (s, p, 3)), "modes": ("f", (k, s, p, 3)),
        "mode_names": ("U", (k,)), "pressure_sd": ("f", (s,)),
    } | {name: ("f", (3 * p, 3 * p)) for name in exact if name.startswith("correlation")}  # fmt: skip
    for name, (kind, size) in each.items():
        array = exact[name]
        # an array of no names is stored as numbers
        right = array.dtype.kind in (kind, *("iu" if kind == "f" else "")) or (kind != "b" and not array.size)
        if not right:
            raise ValueError(f"{path}: array {name!r} holds {array.dtype}; wanted {KIND[kind]}; {WAY_OUT}")
        if array.shape != size:
            raise ValueError(f"{path}: array {name!r} has shape {array.shape}; wanted {size}; {WAY_OUT}")


def _check_finite(path: Path, exact: Mapping[str, NDArray[Any]], valid: NDArray[np.bool_]) -> None:
    for name, values, limits in (
        ("modes", exact["modes"][:, valid], f"mm, of {FARTHEST:g} at most, where a value is valid"),
        ("pressure_sd", exact["pressure_sd"], f"MPa, 0 to {MOST_MPA:g}"),
    ):
        low, high = (0.0, MOST_MPA) if name == "pressure_sd" else (-FARTHEST, FARTHEST)
        bad = ~((values >= low) & (values <= high))
        if bad.any():
            raise ValueError(f"{path}: array {name!r} holds {values[bad][0]:g}; wanted finite numbers in "
                             f"{limits}; {WAY_OUT}")  # fmt: skip


def _check_covariance(path: Path, covariance: Array, valid: NDArray[np.bool_]) -> None:
    """Raise ValueError unless the covariance of what is valid is finite, symmetric and positive."""
    used = valid[..., :, None] & valid[..., None, :]
    for s, p, i, k in np.argwhere(used & ~(np.abs(covariance) <= FARTHEST**2))[:1].tolist():
        raise ValueError(
            f"{path}: covariance of step {s}, point {p} holds {covariance[s, p, i, k]:g}; wanted finite "
            f"numbers in mm2, of {FARTHEST**2:g} at most, where a value is valid; {WAY_OUT}"
        )
    observed = np.where(used, covariance, 0.0)
    scale = np.abs(observed).max(axis=(2, 3), initial=0.0)
    odd = np.abs(observed - observed.swapaxes(2, 3)).max(axis=(2, 3)) > ROUND * scale
    for s, p in np.argwhere(odd)[:1].tolist():
        raise ValueError(
            f"{path}: covariance of step {s}, point {p} is not symmetric; wanted a covariance in "
            f"mm2; {WAY_OUT}"
        )
    unseen = np.where(valid, 0.0, scale[..., None])[..., None] * np.eye(3)
    least = np.linalg.eigvalsh(observed + unseen)[..., 0]
    for s, p in np.argwhere(valid.any(axis=2) & (least < -ROUND * scale))[:1].tolist():
        raise ValueError(
            f"{path}: covariance of step {s}, point {p} has the eigenvalue {least[s, p]:.3g} mm2; wanted "
            f"none below 0; {WAY_OUT}"
        )


def _check_correlation(path: Path, name: str, correlation: Array) -> None:
    """Raise ValueError unless an array is a correlation: finite, symmetric, 1 on the diagonal, positive."""
    what = ""
    if not np.isfinite(correlation).all():
        what = "holds numbers that are not finite"
    elif np.abs(correlation - correlation.T).max(initial=0.0) > ROUND:
        what = "is not symmetric"
    elif np.abs(np.diagonal(correlation) - 1).max(initial=0.0) > 1e-6:
        what = "is not 1 on its diagonal"
    elif len(correlation) and (least := float(np.linalg.eigvalsh(correlation)[0])) < -1e-6:
        what = f"has the eigenvalue {least:.3g}, below 0"
    if what:
        raise ValueError(f"{path}: array {name!r} {what}; wanted a correlation within one step; measure "
                         "again, or remove [noise] from targets.toml")  # fmt: skip


def _check_log(path: Path, log: tuple[Array, Array], grid: _Grid, sd: Array) -> None:
    """Raise ValueError where a log (t,) s and (t,) MPa contradicts the pressures of the steps, whose gauge
    noise is sd (s,). Between its samples the log is linear; a few steps may lie off it, since a log cuts off
    a fast step of the valve."""
    apart = np.abs(np.interp(grid.time, *log) - grid.pressure)
    off = apart > APART * np.abs(grid.pressure).max() + 6 * sd
    if off.mean() <= 0.1:
        return
    worst = int(apart.argmax())
    raise ValueError(
        f"{path}: says {np.interp(grid.time[worst], *log):.4g} MPa at {grid.time[worst]:g} s, targets.csv "
        f"{grid.pressure[worst]:.4g} MPa, and they differ at {int(off.sum())} of {len(off)} steps; wanted "
        "the log of the same test, in the same unit and on the same clock; correct one of them, or remove "
        "pressure.csv"
    )


def _check_blocks(path: Path, label: NDArray[np.int64], log_time: Array, grid: _Grid) -> None:
    """Raise ValueError where the block of a sample of the log, label (t,), is none of targets.csv, or the
    sample lies among the steps of another block."""
    labels = sorted({block for block, _ in grid.steps})
    for b in sorted(set(label.tolist()) - set(labels)):
        raise ValueError(f"{path}: block {b} is not in targets.csv, which has {labels}")
    for rank, b in enumerate(labels):
        time = grid.time[grid.block == rank]
        inside = (log_time >= time[0]) & (log_time <= time[-1])
        for k in np.flatnonzero(inside & (label != b))[:1].tolist():
            raise ValueError(
                f"{path}: the sample at {log_time[k]:g} s is of block {label[k]}, but targets.csv has block "
                f"{b} there; correct one of them"
            )
