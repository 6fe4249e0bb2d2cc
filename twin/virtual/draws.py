"""Synthetic targets of `twin measure` from a true motion, with noise from a seed; and the visibility of a
hidden effect in them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fe import Path
from twin.judging.whitening import whitener
from twin.targets import Array, Noise, PointKind, TargetPoint, Targets, as_position, at_node
from twin.virtual.protocols import Bench, Protocol

NOISE = {"white": 0.0, "ar1": 0.6}  # correlation of a marker's noise from step to step
REST_S = 1.8  # film A rests until 2 s: the steps before this are the reference


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Accuracy of a virtual measurement: picture noise `sd_mm` a marker and axis, of which kind (a name of
    NOISE), gauge noise, and how far a marker may sit from its place."""

    sd_mm: float = 0.015
    noise: str = "white"
    gauge_sd_MPa: float = 2e-5
    placement_sd_mm: float = 0.1
    scale_sd: float = 5e-4

    @property
    def bench(self) -> Bench:
        """The measuring side."""
        return Bench(
            ripple_MPa=0.0, gauge_sd_MPa=self.gauge_sd_MPa, sd=self.sd_mm, rho=NOISE[self.noise],
            placement_sd_mm=self.placement_sd_mm, scale_sd=self.scale_sd,
        )  # fmt: skip


def measured(
    protocol: Protocol,
    u: Array,
    slope: Array,
    *,
    points: Sequence[TargetPoint],
    setup: Setup,
    seed: int,
) -> Targets:
    """Targets of true displacements (s, p, 3) mm of a protocol's points (p,) and their slopes dU/dp (s, p, 3)
    mm per MPa; the last of several recordings is held out."""
    drawn = noisy_targets(
        u, slope, protocol.course, points=points, bench=setup.bench, seed=seed, fixed=protocol.fixed
    )
    held = np.zeros(len(u), bool) if protocol.held_out is None else protocol.block == protocol.held_out
    gravity = protocol.ways if protocol.weighed else None
    return replace(drawn, block=protocol.block, held_out=held, gravity=gravity)


def plainness(change: Array, targets: Targets, fitted: Array, slope: Array) -> float:
    """The non-centrality of a change (s, p, 3) mm of all points that is hidden in targets: its length in sds
    of the noise once the fitted parameters, derivatives fitted (d, s, p, 3), took what they can of it.

    slope (s, p, 3): dU/dp in mm per MPa, for the gauge's noise. A test of one parameter finds a change of 3
    in half of the films at a level of 0.3 %.
    """
    nothing = np.zeros((0, *targets.value.shape))
    w = whitener(targets, prediction_modes=nothing, gauge=slope * targets.pressure_error[:, None, None])
    rows = w.whiten(fitted).T
    z = w.whiten(_relative(change, targets))
    return float(np.linalg.norm(z - rows @ np.linalg.lstsq(rows, z, rcond=1e-12)[0]))


def _relative(change: Array, targets: Targets) -> Array:
    return change - change[targets.reference].mean(axis=0)


# -- one draw ------------------------------------------------------------------------------------------------


def noisy_targets(
    true: Array,
    slope: Array,
    course: Path,
    *,
    points: Sequence[TargetPoint],
    bench: Bench,
    seed: int,
    fixed: int = 4,
) -> Targets:
    """Targets as `twin measure` would give them for true displacements (s, p, 3) mm, with noise drawn from
    `seed`.

    true may hold the fixed markers too, where the camera sees them move.
    slope (s, p, 3): dU/dp of the truth, mm per MPa. points (p,): the markers, each with its position; `fixed`
    markers that do not move are appended. Drawn: picture noise (AR(1), correlated between markers), gauge
    noise, a placement of every tag on its node, the scale, and the static film from which the noise model is
    estimated. The gauge's error is put on the displacements (slope times error) and not on the log, to first
    order the same, so that one set of solves serves every seed.
    """
    rng, s = np.random.default_rng(seed), len(true)
    markers = (*points, *fixed_markers(fixed))
    names = tuple(p.name for p in markers)
    u, g = (np.concatenate([x, np.zeros((s, len(markers) - x.shape[1], 3))], axis=1) for x in (true, slope))
    reference = np.flatnonzero(course.output <= REST_S)
    shared, shared_names = _shared_modes(u, points, bench, reference)
    u = u + np.tensordot(rng.standard_normal(len(shared)), shared, 1)
    u = u + g * (bench.gauge_sd_MPa * rng.standard_normal(s))[:, None, None]
    picture = _picture(rng, bench, bench.static_frames + s, len(markers))
    noise = _noise(picture[: bench.static_frames], names, bench)
    reference_modes, reference_names = _reference_modes(noise, reference, s, names)
    value = _seen(u, picture[bench.static_frames :], reference)
    return Targets(
        time=course.output,
        pressure=course.at_output(),
        block=np.zeros(s, np.int64),
        points=markers,
        value=value,
        covariance=_covariance(noise, s),
        valid=np.isfinite(value),
        held_out=np.zeros(s, bool),
        modes=np.concatenate([shared, reference_modes]),
        mode_names=(*shared_names, *reference_names),
        noise=noise,
        log_time=course.time,
        log_pressure=course.pressure,
        reference=reference,
        gravity=None,
        pressure_sd=np.full(s, bench.gauge_sd_MPa),
    )


def _seen(u: Array, picture: Array, reference: NDArray[np.int64]) -> Array:
    """Measured displacements (s, p, 3) mm relative to the reference: x and z with the picture's noise
    (s, p, 2) mm, y not seen."""
    moved = u[..., (0, 2)] + picture
    value = np.full(u.shape, np.nan)
    value[..., (0, 2)] = moved - moved[reference].mean(axis=0)
    return value


def _covariance(noise: Noise, steps: int) -> Array:
    """Independent covariance (s, p, 3, 3) mm2, constant over the steps; NaN for y, which is not seen."""
    covariance = np.zeros((steps, len(noise.sd), 3, 3))
    covariance[..., range(3), range(3)] = noise.sd**2
    covariance[:, :, 1], covariance[:, :, :, 1] = np.nan, np.nan
    return covariance


def at_nodes(
    names: Sequence[str], nodes: Iterable[int] | Array, positions: Array
) -> tuple[TargetPoint, ...]:
    """Points (p,) at nodes with these labels (p,) and positions (p, 3) mm."""
    rows = zip(names, nodes, positions, strict=True)
    return tuple(at_node(name, int(node), as_position(position)) for name, node, position in rows)


def fixed_markers(count: int) -> list[TargetPoint]:
    """Markers on the rig, above the finger."""
    x = np.linspace(10.0, 100.0, count)
    return [TargetPoint(f"fixed{k}", PointKind.FIXED, None, (float(x[k]), 11.5, 32.0)) for k in range(count)]


def _picture(rng: np.random.Generator, bench: Bench, frames: int, count: int) -> Array:
    """Noise (t, p, 2) mm of measured places: AR(1) in time, with a part that all markers of a frame share."""
    white = rng.standard_normal((frames, count, 2))
    common = rng.standard_normal((frames, 1, 2))
    e = np.sqrt(1 - bench.common) * white + np.sqrt(bench.common) * common
    out = np.empty_like(e)
    out[0] = e[0]
    for t in range(1, frames):
        out[t] = bench.rho * out[t - 1] + np.sqrt(1 - bench.rho**2) * e[t]
    return bench.sd * out


def _noise(static: Array, names: tuple[str, ...], bench: Bench) -> Noise:
    """The noise model estimated from a static film, as `twin measure` does it."""
    from vision.errors.staticnoise import static_noise

    noise = static_noise(static, names, "virtual")
    return Noise(
        sd=noise.sd,
        rho=noise.rho,
        correlation=noise.correlation,
        frames=noise.frames,
        codec_sd=noise.codec_sd,
        lasting=noise.persistence.lasting,
        gauge_sd_MPa=bench.gauge_sd_MPa,
        gauge_frames=bench.static_frames * 5,
    )


def _shared_modes(
    u: Array, points: Sequence[TargetPoint], bench: Bench, reference: NDArray[np.int64]
) -> tuple[Array, tuple[str, ...]]:
    """Scale and tag placement (k, s, p, 3) mm, 1 sd each, relative to the reference as the displacements are;
    a tag turns with the side face, whose slope its neighbours show."""
    modes, labels = [u * bench.scale_sd], ["scale"]
    angle = _turned(u[:, : len(points)], np.array([p.position for p in points]))
    for k, name in enumerate(p.name for p in points):
        c, s = np.cos(angle[:, k]) - 1, np.sin(angle[:, k])
        for label, (x, z) in (("x", (c, s)), ("z", (-s, c))):
            mode = np.zeros_like(u)
            mode[:, k, 0], mode[:, k, 2] = bench.placement_sd_mm * x, bench.placement_sd_mm * z
            modes.append(mode)
            labels.append(f"placement:{name}:{label}")
    shared = np.array(modes)
    return shared - shared[:, reference].mean(axis=1, keepdims=True), tuple(labels)


def _turned(u: Array, points: Array) -> Array:
    """By how much (s, p) rad the side face has turned at points (p, 3) mm, from x towards z: as its lower
    edge has, along which it is known at the clamp and at the lowest markers."""
    low = np.flatnonzero(points[:, 2] < points[:, 2].min() + 1e-6)
    low = low[np.argsort(points[low, 0])]
    x = np.concatenate([[0.0], points[low, 0]])
    gradient = np.gradient(np.concatenate([np.zeros((len(u), 1, 3)), u[:, low]], axis=1), x, axis=1)
    angle = np.arctan2(gradient[..., 2], 1 + gradient[..., 0])
    return np.array([np.interp(points[:, 0], x, row) for row in angle])


def _reference_modes(
    noise: Noise, reference: NDArray[np.int64], steps: int, names: tuple[str, ...]
) -> tuple[Array, tuple[str, ...]]:
    """The noise of the reference mean: the same in every step, one mode for each marker and axis."""
    modes, labels, r = [], [], len(reference)
    for k, name in enumerate(names):
        for axis in (0, 2):
            rho = noise.rho[k, axis]
            lags = np.arange(1, r)
            # variance of a mean of white values and of AR(1) ones
            inflation = 1 + 2 * noise.lasting * ((1 - lags / r) * rho**lags).sum()
            mode = np.zeros((steps, len(names), 3))
            mode[:, k, axis] = noise.sd[k, axis] * np.sqrt(inflation / r)
            modes.append(mode)
            labels.append(f"reference:{name}:{axis + 1}")
    return np.array(modes), tuple(labels)
