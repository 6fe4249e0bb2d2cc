"""Write displacement targets as files a person can read, bit for bit."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin import files
from twin.project.record import SourceRecord
from twin.project.targetarrays import EXACT
from twin.targets import Load, Noise, PointKind, Targets

COLUMNS = (
    "block", "step", "time_s", "pressure_MPa", "point",
    "u1_mm", "u2_mm", "u3_mm", "sd1_mm", "sd2_mm", "sd3_mm", "valid",
)  # fmt: skip


def write_targets(folder: Path, targets: Targets, *, source: SourceRecord | None = None) -> None:
    """Write the folder in one step; `source` says what it was measured from. ValueError if it is there."""
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


def _csv(t: Targets) -> str:
    """One row a step and point; values in full, sds rounded (their exact form is in targets.npz)."""
    variance = np.diagonal(t.covariance, axis1=2, axis2=3)
    sd = np.sqrt(np.where(np.isnan(t.value), np.nan, variance))
    lines = [",".join(COLUMNS)]
    for s, first in enumerate(np.searchsorted(t.block, t.block)):  # steps are counted within their block
        head = f"{t.block[s]},{s - first},{float(t.time[s])!r},{float(t.pressure[s])!r}"
        for p, name in enumerate(t.names):
            cells = [_cell(float(v)) for v in t.value[s, p]] + [_cell(float(f"{v:.6g}")) for v in sd[s, p]]
            lines.append(f"{head},{name},{','.join(cells)},{int(t.valid[s, p].any())}")
    return "\n".join(lines) + "\n"


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def _log_csv(t: Targets) -> str:
    """The dense log; a sample between two blocks belongs to the nearer one."""
    starts = np.flatnonzero(np.diff(t.block))
    borders = (t.time[starts] + t.time[starts + 1]) / 2
    blocks = np.searchsorted(borders, t.log_time, side="right")
    rows = zip(blocks.tolist(), t.log_time.tolist(), t.log_pressure.tolist(), strict=True)
    return "block,time_s,pressure_MPa\n" + "".join(f"{b},{time!r},{p!r}\n" for b, time, p in rows)


def _toml(t: Targets) -> str:
    """What the columns mean: reference, blocks, points, noise."""
    first = int(np.searchsorted(t.block, t.block[t.reference[0]]))
    lines = [
        "# What targets.csv holds: displacements in mm relative to the mean of the reference steps.",
        "# World axes: x along the finger from the clamp, y across the width, z up; the finger bends to -z.",
        "", "[reference]",
    ]  # fmt: skip
    if t.rests.any():
        lines += ["each_block = true  # displacements of a block are relative to the mean of its own steps"]
    else:
        lines += [f"block = {t.block[t.reference[0]]}", f"steps = {(t.reference - first).tolist()}"]
    for b in range(int(t.block[-1]) + 1):
        held_out = str(bool(t.held_out[t.block == b][0])).lower()
        lines += ["", "[[blocks]]", f"block = {b}", f"held_out = {held_out}  # true: kept from every fit"]
        if t.gravity is not None:
            lines.append(f"gravity = {t.gravity[b].tolist()}  # unit vector in world axes")
        if t.shares:
            told = ", ".join(f"{_quoted(name)} = {float(shares[b])!r}" for name, shares in t.shares.items())
            lines.append(f"pressure_shares = {{{told}}}")
        if hung := [_load_toml(load) for load in t.loads if load.block == b]:
            lines.append(f"loads = [{', '.join(hung)}]")
        if t.rests.any():
            own = t.reference[t.block[t.reference] == b] - int(np.searchsorted(t.block, b))
            lines.append(f"reference_steps = {own.tolist()}")
        if t.noises:
            lines += _noise_lines(t.noises[b], t.names, "blocks.noise")
    for point in t.points:
        lines += ["", "[[points]]", f"name = {_quoted(point.name)}"]
        if point.kind is not PointKind.UNKNOWN:
            lines.append(f'role = "{point.kind.value}"')
        if point.node is not None:
            lines.append(f"node = {point.node}")
        if point.position is not None:
            lines.append(f"position_mm = {list(point.position)}")
    return "\n".join(lines + _noise_toml(t)) + "\n"


def _load_toml(load: Load) -> str:
    at = _quoted(load.at) if isinstance(load.at, str) else list(load.at)
    much = f"weight_g = {load.weight_g!r}" if load.force is None else f"force_N = {list(load.force)}"
    return f"{{{much}, at = {at}}}"


def _noise_toml(t: Targets) -> list[str]:
    return [] if t.noise is None or t.noises else _noise_lines(t.noise, t.names, "noise")


def _noise_lines(n: Noise, names: tuple[str, ...], table: str) -> list[str]:
    lines = [
        "", f"[{table}]  # independent variance = static variance + codec variance (where the patch moves)",
        f"frames = {n.frames}  # static frames it was estimated from",
        f"lasting = {float(n.lasting)!r}  # share of the variance at rest that is correlated by rho in time",
        f"gauge_sd_MPa = {float(n.gauge_sd_MPa)!r}  # white noise of the pressure log",
        f"gauge_frames = {n.gauge_frames}",
        *([f"basis = {_quoted(n.basis)}"] if n.basis else []),
    ]  # fmt: skip
    for p, name in enumerate(names):
        lines += ["", f"[[{table}.points]]  # nan: not observed", f"name = {_quoted(name)}"]
        for key, values in (("sd_mm", n.sd), ("rho", n.rho), ("codec_sd_mm", n.codec_sd)):
            lines.append(f"{key} = {values[p].tolist()}")
    return lines


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)  # TOML has the escapes of JSON
