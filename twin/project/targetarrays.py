"""Whether the arrays of targets.npz and the log of pressure.csv are what they claim to be, and belong to
targets.csv."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.sanity import MOST_MPA
from twin.targets import Array

EXACT = ("covariance", "valid", "modes", "mode_names", "pressure_sd")  # what targets.npz adds to the text
WAY_OUT = "restore targets.csv, or remove targets.npz to use the csv alone"
FARTHEST = 1e6  # mm, of displacements and their errors: below it a wrong unit is told by what it does
ROUND = 1e-9  # relative: what rounding leaves of a matrix that was symmetric, or had no negative eigenvalue
KIND = {"b": "booleans", "U": "text", "f": "numbers"}


def check_exact(
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
    known = np.sqrt(np.diagonal(exact["covariance"], axis1=2, axis2=3)[valid])
    if not np.allclose(known, sd[valid], rtol=1e-4, atol=0):  # the csv holds 6 digits
        raise ValueError(f"{path}: its standard deviations are not those of targets.csv; {WAY_OUT}")
    for name in correlations:
        _check_correlation(path, name, exact[name])


def _check_shapes(path: Path, exact: Mapping[str, NDArray[Any]], shape: tuple[int, ...]) -> None:
    s, p, _ = shape
    found = exact["valid"].shape
    if found[:2] != (s, p) and len(found) == 3:
        raise ValueError(
            f"{path}: made for {found[:2]} steps and points, targets.csv has {(s, p)}; {WAY_OUT}"
        )
    k = exact["mode_names"].size
    wanted = {
        "covariance": ("f", (s, p, 3, 3)), "valid": ("b", (s, p, 3)), "modes": ("f", (k, s, p, 3)),
        "mode_names": ("U", (k,)), "pressure_sd": ("f", (s,)),
    } | {name: ("f", (3 * p, 3 * p)) for name in exact if name.startswith("correlation")}  # fmt: skip
    for name in [name for name in wanted if name in exact]:
        kind, size = wanted[name]
        array = exact[name]
        # an array of no names is stored as numbers
        right = array.dtype.kind == kind or (kind != "b" and not array.size) or (
            kind == "f" and array.dtype.kind in "iu"
        )
        if not right:
            raise ValueError(f"{path}: array {name!r} holds {array.dtype}; wanted {KIND[kind]}; {WAY_OUT}")
        if array.shape != size:
            raise ValueError(f"{path}: array {name!r} has shape {array.shape}; wanted {size}; {WAY_OUT}")


def _check_finite(path: Path, exact: Mapping[str, NDArray[Any]], valid: NDArray[np.bool_]) -> None:
    for name, values, wanted in (
        ("modes", exact["modes"][:, valid], f"mm, of {FARTHEST:g} at most, where a value is valid"),
        ("pressure_sd", exact["pressure_sd"], f"MPa, 0 to {MOST_MPA:g}"),
    ):
        low, high = (0.0, MOST_MPA) if name == "pressure_sd" else (-FARTHEST, FARTHEST)
        bad = ~((values >= low) & (values <= high))
        if bad.any():
            raise ValueError(f"{path}: array {name!r} holds {values[bad][0]:g}; wanted finite numbers in "
                             f"{wanted}; {WAY_OUT}")  # fmt: skip


def _check_covariance(path: Path, covariance: Array, valid: NDArray[np.bool_]) -> None:
    """Raise ValueError unless the covariance of what is valid is finite, symmetric and positive."""
    used = valid[..., :, None] & valid[..., None, :]
    for s, p, i, k in np.argwhere(used & ~(np.abs(covariance) <= FARTHEST**2))[:1].tolist():
        raise ValueError(
            f"{path}: covariance of step {s}, point {p} holds {covariance[s, p, i, k]:g}; wanted finite "
            f"numbers in mm2, of {FARTHEST**2:g} at most, where a value is valid; {WAY_OUT}"
        )
    own = np.where(used, covariance, 0.0)
    scale = np.abs(own).max(axis=(2, 3), initial=0.0)
    odd = np.abs(own - own.swapaxes(2, 3)).max(axis=(2, 3)) > ROUND * scale
    for s, p in np.argwhere(odd)[:1].tolist():
        raise ValueError(
            f"{path}: covariance of step {s}, point {p} is not symmetric; wanted a covariance in "
            f"mm2; {WAY_OUT}"
        )
    least = np.linalg.eigvalsh(own + np.where(valid, 0.0, scale[..., None])[..., None] * np.eye(3))[..., 0]
    for s, p in np.argwhere(valid.any(axis=2) & (least < -ROUND * scale))[:1].tolist():
        raise ValueError(
            f"{path}: covariance of step {s}, point {p} has the eigenvalue {least[s, p]:.3g} mm2; wanted "
            f"none below 0; {WAY_OUT}"
        )


def _check_correlation(path: Path, name: str, correlation: Array) -> None:
    """Raise ValueError unless it is a correlation: finite, symmetric, 1 on the diagonal, positive."""
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


# The log and the steps are of one gauge: between its samples the log is linear, and its noise stays.
APART = 0.05  # of the largest pressure


def check_log(
    path: Path, log: tuple[Array, Array], *, time: Array, pressure: Array, sd: Array
) -> None:
    """Raise ValueError where a log (t,) s and (t,) MPa contradicts the pressures (s,) MPa of the steps at
    time (s,), whose gauge noise is sd (s,)."""
    apart = np.abs(np.interp(time, *log) - pressure)
    allowed = APART * np.abs(pressure).max() + 6 * sd
    # a fast step of the valve is cut off by any log: a few steps may lie off it
    off = apart > allowed
    if off.mean() <= 0.1:
        return
    worst = int(apart.argmax())
    raise ValueError(
        f"{path}: says {np.interp(time[worst], *log):.4g} MPa at {time[worst]:g} s, targets.csv "
        f"{pressure[worst]:.4g} MPa, and they differ at {int(off.sum())} of {len(time)} steps; wanted the "
        "log of the same test, in the same unit and on the same clock; correct one of them, or remove "
        "pressure.csv"
    )


def check_blocks(
    path: Path, label: NDArray[np.int64], log_time: Array, *,
    labels: list[int], block: NDArray[np.int64],
    time: Array,
) -> None:
    """Raise ValueError where the block of a sample of the log, label (t,), is not one of targets.csv's
    labels, or the sample lies among the steps of another block; block (s,) is the rank of each step's."""
    for b in sorted(set(label.tolist()) - set(labels)):
        raise ValueError(f"{path}: block {b} is not in targets.csv, which has {labels}")
    for rank, b in enumerate(labels):
        own = time[block == rank]
        inside = (log_time >= own[0]) & (log_time <= own[-1])
        if (label[inside] != b).any():
            k = int(np.flatnonzero(inside & (label != b))[0])
            raise ValueError(
                f"{path}: the sample at {log_time[k]:g} s is of block {label[k]}, but targets.csv has block "
                f"{b} there; correct one of them"
            )
