"""A file of motion capture as times and places against its base, without a project."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fe.element import Flags
from twin.formats.basemotion import BASE, rigid
from twin.formats.catalogue import format_of, read_recorded
from twin.formats.importtable import ImportTable
from twin.formats.recorded import PIXEL
from twin.formats.supplied import mm_per_unit, times_of
from twin.targets import Array

STILL = 0.2  # of the largest motion, rms: a marker that moves less is on the base


@dataclass(frozen=True)
class MotionFile:
    """A recording: its file, times (t,) s, names (p,) and places (t, p, 3) mm of what moves, NaN where it
    was not seen, the names of the base whose rigid motion is taken off, and the pressure (t,) MPa where the
    file has it."""

    file: str
    time: Array
    names: tuple[str, ...]
    position: Array
    base: tuple[str, ...]
    pressure: Array | None


def read_motion(path: Path, *, fps: float = 0.0, base: Sequence[str] = (), scale: float = 0.0) -> MotionFile:
    """The motion in a file of another program.

    fps: frames in a second, where the file has no times. base: markers on the base, by default those that
    hardly move, where there are three. scale: size of a pixel in mm, of a file in pixels. ValueError for
    what the file does not say, and for names that it has not.
    """
    if not path.exists():
        raise ValueError(f"{path}: no such file; wanted a csv or c3d file of markers")
    recorded = read_recorded(path, format_of(path))
    if recorded.time is None and not fps:
        raise ValueError(f"{path}: has no times; state its frames in a second, as in --fps 100")
    if recorded.unit == PIXEL and not scale:
        raise ValueError(f"{path}: is in pixels; state how many are a mm, as in --px-per-mm 4")
    if unknown := sorted(set(base) - set(recorded.names)):
        raise ValueError(f"--base {unknown[0]}: not in {path}, which has {', '.join(recorded.names)}")
    table = ImportTable(file=path.name, format="csv", sd_mm=1.0, fps=fps or None, mm_per_px=scale or None)
    place = recorded.position * mm_per_unit(recorded, table)
    still = _still(place, recorded.names, base)
    moving = np.flatnonzero(~still)
    if not len(moving):
        raise ValueError(f"--base: all points of {path}; wanted some that move")
    return MotionFile(
        path.name, times_of(recorded, table), tuple(recorded.names[k] for k in moving),
        _against(place, still)[:, moving], tuple(np.array(recorded.names)[still]), recorded.pressure,
    )  # fmt: skip


def _still(place: Array, names: Sequence[str], base: Sequence[str]) -> Flags:
    """Flags (p,) of the points on the base; none where fewer than three are."""
    if base:
        return np.array([name in base for name in names])
    rms = np.sqrt(np.nanmean(np.nansum((place - np.nanmean(place, axis=0)) ** 2, axis=2), axis=0))
    still = rms < STILL * rms.max()
    return still if still.sum() >= BASE else np.zeros(len(names), dtype=bool)


def _against(place: Array, still: Flags) -> Array:
    """Places (t, p, 3) without the rigid motion of the base; of one or two points: without their shift."""
    if not still.any():
        return place
    rest, out = np.nanmedian(place[:, still], axis=0), np.full_like(place, np.nan)
    for k, frame in enumerate(place):
        seen = np.isfinite(frame[still]).all(axis=1)
        if seen.sum() < min(BASE, len(rest)):
            continue
        a, b = frame[still][seen], rest[seen]
        turn, shift = rigid(a, b) if len(a) >= BASE else (np.eye(3), (b - a).mean(axis=0))
        out[k] = frame @ turn.T + shift
    return out
