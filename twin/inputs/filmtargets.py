"""Displacements of a film and the pressure log -> targets on the log's clock."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from twin.gauge.pressurelog import GaugeNoise, Log
from twin.gauge.synchrony import Join
from twin.targets import OPEN, Array, Noise, PointKind, TargetPoint, Targets, as_position, at_node

if TYPE_CHECKING:
    from vision import Displacements, Video

DIGITS = 6  # of mm: a nanometre, far below any sd, keeps targets.csv readable


def make_targets(
    moved: "Displacements",
    log: Log,
    *,
    join: Join,
    gauge: GaugeNoise,
    nodes: Mapping[str, int],
    late: Array | None = None,
) -> Targets:
    """Targets of one block on the log's clock, from displacements on the film's.

    Of frames with the same time stamp the first is kept; `nodes` gives the label of every finger marker.
    What the join leaves uncertain becomes the mode "sync", and what a rolling shutter does "readout".
    late: (s,p) s by which the camera read each mark after the middle of the picture.
    """
    from vision.errors.sharederrors import sync

    keep = np.concatenate([[True], np.diff(moved.time) > 0])
    time = moved.time[keep] - moved.time[0] + join.start_s
    value, covariance = np.round(moved.value[keep], DIGITS), moved.covariance[keep]
    variance = np.diagonal(covariance, axis1=2, axis2=3)
    n = moved.noise
    noise = Noise(
        sd=n.sd, rho=n.rho, correlation=n.correlation, frames=n.frames, codec_sd=n.codec_sd,
        gauge_sd_MPa=gauge.sd_MPa, gauge_frames=gauge.samples,
        lasting=n.persistence.lasting,
    )  # fmt: skip
    log_time, log_pressure = log.beside(time)
    speed = sync(time, moved.value[keep], 1.0) * np.isfinite(moved.value[keep])  # mm/s
    modes = {"sync": join.sd_s * speed}
    if late is not None:
        modes["readout"] = late[keep][..., None] * speed
    return Targets(
        time=time, pressure=np.round(log.at(time), DIGITS + 3), block=np.zeros(len(time), dtype=np.int64),
        points=_target_points(moved, nodes), value=value, covariance=covariance,
        valid=np.isfinite(value) & np.isfinite(variance), held_out=np.zeros(len(time), dtype=bool),
        modes=np.concatenate([moved.modes[:, keep], *(mode[None] for mode in modes.values())]),
        mode_names=(*moved.mode_names, *modes),
        noise=noise, log_time=log_time, log_pressure=log_pressure,
        reference=_kept(moved.reference, keep), gravity=None,
        pressure_sd=gauge.sd_MPa * log.gain(time),
    )  # fmt: skip


def read_late(moved: "Displacements", film: "Video", readout_ms: float | None) -> Array | None:
    """Times (s,p) s by which a rolling shutter read each mark after the middle of the picture; None without.

    Rows are those of the sensor: in a film that is turned by a quarter, the picture's columns.
    """
    if readout_ms is None:
        return None
    axis, side = (1, film.height) if film.turns % 2 == 0 else (0, film.width)
    tracks = moved.tracks
    frames = np.searchsorted(tracks.time, moved.time)
    place = tracks.position[frames][:, [tracks.names.index(name) for name in moved.names], axis]
    return np.nan_to_num(place / side - 0.5) * readout_ms / 1e3


def said_of_readout(targets: Targets, readout_ms: float | None) -> tuple[str, ...]:
    """A sentence on what a rolling shutter does to the targets."""
    if readout_ms is None:
        return ()
    most = float(np.abs(targets.modes[targets.mode_names.index("readout")]).max())
    return (
        f"The camera reads the rows of a frame one after another, in {readout_ms:g} ms (readout_ms). "
        f"Markers that move far from the picture's middle are off by up to {most:.2g} mm. This is stated as "
        "the error readout, and not corrected.",
    )


def said_of_log_rate(targets: Targets) -> tuple[str, ...]:
    """A sentence where the pressure's samples are too far apart for what it does."""
    lost = int((targets.valid != targets.logged.valid).any(axis=(1, 2)).sum())
    if not lost:
        return ()
    apart = float(np.median(np.diff(targets.log_time)))
    return (
        f"The pressure log has a sample every {apart:.2g} s. At {lost} of {len(targets.time)} frames, where "
        f"the pressure turns between two samples, it leaves open more than {100 * OPEN:g} % of its range, up "
        f"to {1e3 * float(targets.between.max()):.2g} kPa. These frames are not used: "
        "a faster log would keep them.",
    )


def _target_points(moved: "Displacements", nodes: Mapping[str, int]) -> tuple[TargetPoint, ...]:
    """The target point of every measured one: at its node, at its place on the face, or fixed."""
    rows = zip(moved.names, moved.roles, moved.points, moved.measured, strict=True)
    return tuple(
        replace(point, rest=point.position) if measured else point
        for name, role, place, measured in rows
        for point in [_target_point(name, role, as_position(place), nodes.get(name))]
    )


def _target_point(
    name: str, role: str, position: tuple[float, float, float] | None, node: int | None
) -> TargetPoint:
    if role != "finger":
        return TargetPoint(name, PointKind.FIXED, None, position)
    if node is None:
        return TargetPoint(name, PointKind.PLACE, None, position)
    return at_node(name, node, position)


def _kept(indices: NDArray[Any], keep: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Indices of kept steps after the others are removed.

    >>> _kept(np.array([0, 1, 3]), np.array([True, False, True, True])).tolist()
    [0, 2]
    """
    new = np.cumsum(keep) - 1
    return np.array([new[i] for i in indices if keep[i]], dtype=np.int64)
