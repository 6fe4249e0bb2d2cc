"""Displacement targets: what was measured, with all that is known of its errors."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas

    from fe import Material
    from fe.homogeneous import Kind

Array = NDArray[np.float64]
LONGEST_S = 1e8  # s, three years: of a test


class PointKind(StrEnum):
    """Kind of a target point in the model: its role in targets.toml."""

    FIXED = "fixed"  # a marker on the rig: it has no node and should show no displacement
    NODE = "finger"  # a marker on the finger, at a node of the mesh
    PLACE = "place"  # a point of the finger between nodes: its position is the material point
    UNKNOWN = "unknown"  # on the finger, its node yet to be stated in twin.toml


@dataclass(frozen=True)
class TargetPoint:
    """A measured point: its name, what it is in the model, and where.

    node: label in the mesh, of kind NODE only.   position (3,) mm, stress-free; None: not stated, the node's
    own. A PLACE must state it.   rest (3,) mm: where it is seen at rest, which tells the material point of a
    model that has weight; None: its position is stated.   off (3,) mm: from the material point to a marker
    that stands off the surface, stress-free; None: it lies on it.
    """

    name: str
    kind: PointKind
    node: int | None = None
    position: tuple[float, float, float] | None = None
    rest: tuple[float, float, float] | None = None
    off: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if (self.node is not None) != (self.kind is PointKind.NODE):
            raise ValueError(
                f"targets: point {self.name!r} is {self.kind.value!r} with node {self.node}; wanted a node "
                "label for a point at a node and for no other"
            )
        if self.kind is PointKind.PLACE and self.position is None:
            raise ValueError(
                f"targets: point {self.name!r} lies at no node and has no position; wanted "
                "position_mm [x, y, z]"
            )

    def place(self, position: Callable[[int], Array]) -> Array:
        """Position (3,) mm in the model: of its node, position(label), else its own; NaN if unstated.

        >>> TargetPoint("tip", PointKind.PLACE, position=(110.0, 11.5, 0.0)).place(lambda label: np.zeros(3))
        array([110. ,  11.5,   0. ])
        """
        if self.node is not None:
            return np.asarray(position(self.node), dtype=np.float64)
        return np.array(self.position or [math.nan] * 3, dtype=np.float64)


def at_node(name: str, node: int, position: tuple[float, float, float] | None = None) -> TargetPoint:
    """The target point of a marker at a node.

    >>> at_node("tip", 17).kind
    <PointKind.NODE: 'finger'>
    """
    return TargetPoint(name, PointKind.NODE, int(node), position)


def as_position(values: Array) -> tuple[float, float, float] | None:
    """Position (3,) mm as a point keeps it; None where it is not stated (NaN).

    >>> as_position(np.array([110.0, 11.5, 0.0])), as_position(np.full(3, np.nan))
    ((110.0, 11.5, 0.0), None)
    """
    x, y, z = (float(v) for v in values)
    return None if math.isnan(x + y + z) else (x, y, z)


@dataclass(frozen=True)
class Load:
    """A weight or force on the structure during a whole block, beside its pressure and own weight.

    at: the name of a point, or a position (3,) mm, stress-free. One of weight_g, grams, which pull along the
    block's gravity, and force (3,) N in world axes.
    """

    block: int
    at: str | tuple[float, float, float]
    weight_g: float | None = None
    force: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if (self.weight_g is None) == (self.force is None):
            raise ValueError(
                f"targets: the load of block {self.block} at {self.at} has weight_g = {self.weight_g} and "
                f"force_N = {self.force}; wanted one of them"
            )


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise model of measured displacements; diagnose only reads it."""

    sd: Array  # (p,3) mm, static frames; NaN where a component is not observed
    rho: Array  # (p,3) correlation from frame to frame of the part that lasts
    correlation: Array  # (3p,3p) within one step; identity rows where not observed
    frames: int  # static frames it was estimated from
    codec_sd: Array  # (p,3) mm, more where the patch moves
    gauge_sd_MPa: float  # white noise of one sample of the pressure log; 0: none was seen
    gauge_frames: int  # samples of the log it was estimated from
    coding_rho: float = 0.0  # correlation from step to step of what coding adds where a patch moves
    lasting: float = 1.0  # share of sd^2 that lasts from frame to frame; the rest is new in each
    basis: str = ""  # a sentence: what it rests on, where it is not a static film
    freedom: float = math.inf  # degrees of freedom of a factor of all sds that the film itself told


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialCurve:
    """A curve of nominal stress (n,) MPa against nominal strain (n,), below 0 in compression.

    sd (n,) MPa: of each value alone. modes (k, n) MPa: errors that all values share, 1 sd each, with
    mode_names (k,): the size of the specimen, the zero of its strain. time (n,) s since the pull began, where
    it is known. up_to: the largest stretch that is used. recorded, left_out: rows of the test, and those
    beyond that stretch.
    """

    name: str
    kind: "Kind"
    strain: Array
    stress: Array
    sd: Array
    modes: Array
    mode_names: tuple[str, ...]
    time: Array | None
    up_to: float
    recorded: int
    left_out: int

    @cached_property
    def _root(self) -> Array:
        """The lower Cholesky factor (n, n) MPa of the covariance."""
        return np.asarray(np.linalg.cholesky(np.diag(self.sd**2) + self.modes.T @ self.modes), float)

    def whiten(self, stress: Array) -> Array:
        """Stresses (..., n) MPa as values of variance 1 where they are errors of this curve."""
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self._root, np.moveaxis(stress, -1, 0), lower=True).T, float)

    def predicted(self, material: "Material") -> Array:
        """The nominal stress (n,) MPa of a material at the strains; NaN where it has none. ValueError for one
        that creeps where times are not known."""
        from fe.homogeneous import nominal_stress

        if material.prony and self.time is None:
            raise ValueError(
                f"material_tests.{self.name}: the model's silicone creeps, so its stress depends on time; "
                'wanted a column of rising times in the file (time = "..." names it), and cycle = 1'
            )
        return nominal_stress(material, self.strain, self.kind, time=self.time)

    def shared(self, residual: Array) -> Array:
        """The most probable size (k,) of each shared error in a residual (n,) MPa, in sds."""
        return np.asarray(self.whiten(self.modes) @ self.whiten(residual), float)


@dataclass(frozen=True, kw_only=True)
class KnownValue:
    """A parameter, a sum C10+C01 or the share of C01, measured elsewhere: its mean and sd, in its unit."""

    name: str
    mean: float
    sd: float


@dataclass(frozen=True, kw_only=True)
class Targets:
    """Displacements relative to the mean of the reference steps, with all that is known of their errors."""

    time: Array  # (s,) s, absolute across blocks, increasing
    pressure: Array  # (s,) MPa
    block: NDArray[np.int64]  # (s,) 0, 1, ...: one recording in one orientation
    points: tuple[TargetPoint, ...]  # (p,)
    value: Array  # (s,p,3) mm; NaN = not observed
    covariance: Array  # (s,p,3,3) mm2, independent part; NaN where not observed
    valid: NDArray[np.bool_]  # (s,p,3) the component is data
    held_out: NDArray[np.bool_]  # (s,) kept from every fit; the same within a block
    modes: Array  # (k,s,p,3) mm, errors shared by many values, 1 sd each
    mode_names: tuple[str, ...]  # (k,)
    noise: Noise | None  # None: nothing is known of it, and diagnose cannot test
    log_time: Array  # (t,) s; equal to time where no log is known
    log_pressure: Array  # (t,) MPa
    reference: NDArray[np.int64]  # (r,) step indices
    gravity: Array | None  # (blocks,3) unit vectors in world axes, or None
    pressure_sd: Array  # (s,) MPa, gauge noise of each step's pressure; 0 where not known
    noises: tuple[Noise, ...] = ()  # (blocks,) where each film has its own; `noise` is the least known then
    loads: tuple[Load, ...] = ()  # what hangs on the structure, by block
    released: tuple[int, ...] = ()  # blocks in whose rest it is held unloaded: weight and loads act after it
    shares: Mapping[str, Array] = field(default_factory=dict)  # of the pressure, by surface: (blocks,)
    known: tuple[KnownValue, ...] = ()  # what is known of the parameters beside the film
    tails: float = 0.0  # degrees of freedom of Student's t, which the errors have; 0: they are normal
    curves: tuple[MaterialCurve, ...] = ()  # of tests of the silicone itself, fitted beside the displacements

    def __post_init__(self) -> None:
        s, p, k = len(self.time), len(self.points), len(self.mode_names)
        shapes = {
            "time": (s,), "pressure": (s,), "block": (s,), "value": (s, p, 3), "covariance": (s, p, 3, 3),
            "valid": (s, p, 3), "held_out": (s,), "modes": (k, s, p, 3),
            "log_pressure": (len(self.log_time),), "pressure_sd": (s,),
        }  # fmt: skip
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"targets: {name} has shape {getattr(self, name).shape}; wanted {shape}")
        _check(self)

    def __str__(self) -> str:
        """Points, steps, pressure and noise in one line."""
        names, count = ", ".join(self.names[:6]) + (", ..." if len(self.names) > 6 else ""), len(self.names)
        variance = np.diagonal(self.covariance, axis1=2, axis2=3)[self.valid]
        sd = float(np.sqrt(np.median(variance))) if len(variance) else 0.0
        return (
            f"Targets of {count} point{'s' * (count > 1)} ({names}) at {len(self.time)} steps up to "
            f"{1e3 * float(self.pressure.max()):.3g} kPa; sd {sd:.2g} mm"
        )

    @property
    def alone(self) -> "Targets":
        """The targets with normal errors, and with nothing that is known beside them."""
        return replace(self, known=(), tails=0.0) if self.known or self.tails else self

    @property
    def bare(self) -> bool:
        """True where the film and its normal errors are all that tells parameters: no priors, no tests of the
        silicone, no heavy tails."""
        return not (self.known or self.curves or self.tails)

    @property
    def rests(self) -> NDArray[np.int64]:
        """The number (s,) of the rest that each step is relative to: its block, where each has its own."""
        return self.block if len(np.unique(self.block[self.reference])) > 1 else np.zeros_like(self.block)

    @property
    def names(self) -> tuple[str, ...]:
        """Names (p,) of the points."""
        return tuple(point.name for point in self.points)

    @property
    def fixed(self) -> NDArray[np.bool_]:
        """Mask (p,) of the fixed markers."""
        return self.of_kind(PointKind.FIXED)

    @property
    def used(self) -> NDArray[np.bool_]:
        """Flags (s, p, 3) of the values that fits use: data of the finger in films that are not held out."""
        return self.valid & ~self.fixed[:, None] & ~self.held_out[:, None, None]

    def carried(self, most: float, held_out: float) -> "Targets":
        """The targets up to a pressure in MPa, and in blocks that are held out up to another: no value beyond
        is data, and the path is held there. Where the pressure between the steps is known, what a block has
        after that is no data either: its course counts for a memory."""
        top = np.where(self.held_out, held_out, most)
        starts = np.flatnonzero(np.diff(self.block, prepend=-1))
        block = np.searchsorted(self.time[starts], self.log_time, side="right") - 1
        log_top = top[starts][np.maximum(block, 0)]
        beyond = self.pressure > top * (1 + 1e-9)
        if self.has_log:
            over = self.log_pressure > log_top * (1 + 1e-9)
            first = [self.log_time[over & (block == b)].min(initial=np.inf) for b in range(len(starts))]
            beyond |= self.time >= np.array(first)[self.block]
        beyond[self.reference] = False
        return replace(
            self, valid=self.valid & ~beyond[:, None, None], pressure=np.minimum(self.pressure, top),
            log_pressure=np.minimum(self.log_pressure, log_top),
        )  # fmt: skip

    def rms(self, field: Array) -> float:
        """Root mean square of a field (s, p, 3) over the values that fits use."""
        return float(np.sqrt((field[self.used] ** 2).mean()))

    def of_kind(self, kind: PointKind) -> NDArray[np.bool_]:
        """Mask (p,) of the points of a kind."""
        return np.array([point.kind is kind for point in self.points], dtype=bool)

    def places(self, position: Callable[[int], Array]) -> Array:
        """Positions (p,3) mm in the model; position(label) gives a node's."""
        return np.array([point.place(position) for point in self.points])

    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns of targets.csv, one row for each step and point (s p,)."""
        shape = self.value.shape[:2]
        return {name: np.broadcast_to(cells(self), shape).ravel() for name, cells in COLUMNS.items()}

    def to_pandas(self) -> "pandas.DataFrame":
        """The columns of targets.csv, one row for each step and point: time_s, point, u1_mm, sd1_mm, ..."""
        import pandas

        return pandas.DataFrame(self.columns())

    @cached_property
    def between(self) -> Array:
        """The sd (s,) MPa of each step's pressure that comes from where it lies between the log's samples."""
        return between_samples(self.log_time, self.log_pressure, self.time)

    @property
    def pressure_error(self) -> Array:
        """The sd (s,) MPa of each step's pressure: noise of the gauge, and what the log leaves open."""
        return np.hypot(self.pressure_sd, self.between)

    @property
    def logged(self) -> "Targets":
        """The targets without the finger's values at steps whose pressure the log leaves open by more than
        OPEN of its range: so large an error is not in proportion to the slope of the motion."""
        left_open = self.between > OPEN * float(np.ptp(self.log_pressure))
        valid = self.valid & ~(left_open[:, None] & ~self.fixed)[..., None]
        return replace(self, valid=valid) if left_open.any() else self

    @property
    def has_log(self) -> bool:
        """True where the pressure between the steps was recorded; effects with a memory need it."""
        return not np.array_equal(self.log_time, self.time)


ALIKE = 2.0  # longest over shortest of three intervals of a logger
OPEN = 0.005  # of the log's range: of it the motion's slope by the pressure changes by some 1 %


def between_samples(time: Array, value: Array, at: Array) -> Array:
    """How far a course may lie off the lines between its samples at times (s,): the sd (s,), in its unit.

    time (t,) s and value (t,): the samples. Where both ends of an interval bend the same way, a course that
    bends so within it lies between its line and the lines of the intervals beside it, drawn on. This distance
    is the sd, as a corner reaches it. Nothing is added where the bends differ, nor where the intervals are
    not alike: the corners of a course that somebody wrote down are its samples.

    >>> time = np.arange(0.0, 0.6, 0.1)
    >>> ramp = 10.0 * np.clip(time - 0.25, 0.0, None)  # a corner between two samples
    >>> between_samples(time, ramp, np.array([0.1, 0.22, 0.25])).round(3).tolist()
    [0.0, 0.1, 0.25]
    """
    if len(time) < 4:
        return np.zeros(len(at))
    step = np.diff(time)
    slope = np.diff(value) / step
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 1, len(slope) - 2)
    before = (slope[k] - slope[k - 1]) * (at - time[k])
    after = (slope[k + 1] - slope[k]) * (time[k + 1] - at)
    beside = np.stack([step[k - 1], step[k], step[k + 1]])
    alike = beside.max(axis=0) < ALIKE * beside.min(axis=0)
    inside = (time[k] <= at) & (at <= time[k + 1]) & (before * after > 0) & alike
    return np.where(inside, np.minimum(np.abs(before), np.abs(after)), 0.0)


def _displacement(i: int) -> Callable[[Targets], Array]:
    return lambda t: np.asarray(t.value[..., i])


def _sd(i: int) -> Callable[[Targets], Array]:
    return lambda t: np.sqrt(np.where(np.isnan(t.value[..., i]), np.nan, t.covariance[..., i, i]))


# Cells (s, p) of each column of targets.csv by its heading, which ends with the unit.
COLUMNS: dict[str, Callable[[Targets], NDArray[Any]]] = {
    "block": lambda t: t.block[:, None],
    "step": lambda t: (np.arange(len(t.time)) - np.searchsorted(t.block, t.block))[:, None],  # in its block
    "time_s": lambda t: t.time[:, None],
    "pressure_MPa": lambda t: t.pressure[:, None],
    "point": lambda t: np.array(t.names)[None],
    **{f"u{i + 1}_mm": _displacement(i) for i in range(3)},
    **{f"sd{i + 1}_mm": _sd(i) for i in range(3)},
    "valid": lambda t: np.asarray(t.valid.any(axis=2)),
}


def least_known(noises: Sequence[Noise]) -> Noise:
    """The noise model that the fewest static frames were there for: a test of all films trusts it."""
    return min(noises, key=lambda noise: noise.frames)


def relative(field: Array, reference: NDArray[np.int64], rests: NDArray[np.int64]) -> Array:
    """A field (s, ...) less its mean over the reference steps (r,), within each rest, (s,) numbers.

    >>> field = np.array([1.0, 3.0, 5.0, 10.0, 12.0])
    >>> relative(field, np.array([0, 3]), np.array([0, 0, 0, 1, 1])).tolist()
    [0.0, 2.0, 4.0, 0.0, 2.0]
    """
    out = np.empty_like(field)
    for rest in np.unique(rests):
        of_rest = rests == rest
        out[of_rest] = field[of_rest] - field[reference[rests[reference] == rest]].mean(axis=0)
    return out


def check_duration(time: Array, *, what: str) -> None:
    """Raise ValueError for increasing times (t,) s of `what` that no test lasts."""
    if (lasts := float(time[-1] - time[0])) > LONGEST_S:
        raise ValueError(
            f"{what}: the times cover {lasts:.3g} s; wanted {LONGEST_S:g} s at most, which are three years; "
            "correct them, or their unit"
        )


def _check(t: Targets) -> None:
    """Raise ValueError at the first thing that does not fit together."""
    if not len(t.time) or not t.points:
        raise ValueError("targets: no steps or no points; wanted at least one of each")
    if np.any(np.diff(t.time) <= 0) or np.any(np.diff(t.log_time) <= 0):
        raise ValueError(
            "targets: time must increase from step to step and in the pressure log, across blocks too"
        )
    for time in (t.time, t.log_time):
        check_duration(time, what="targets")
    if len(set(t.names)) != len(t.names):
        raise ValueError(f"targets: point names {sorted(t.names)} are not all different")
    if t.block[0] != 0 or not np.isin(np.diff(t.block), (0, 1)).all():
        raise ValueError("targets: blocks must be numbered 0, 1, ... in the order of time")
    for b in range(int(t.block[-1]) + 1):
        if len(set(t.held_out[t.block == b].tolist())) != 1:
            raise ValueError(f"targets: block {b} is held out in part; hold out a whole block or none of it")
    if t.gravity is not None and t.gravity.shape != (int(t.block[-1]) + 1, 3):
        raise ValueError(
            f"targets: gravity has shape {t.gravity.shape}; wanted one unit vector for each block"
        )
    for surface, shares in t.shares.items():
        if shares.shape != (int(t.block[-1]) + 1,):
            raise ValueError(
                f"targets: shares of {surface} have shape {shares.shape}; wanted one for each block"
            )
    _check_loads(t)
    if not len(t.reference) or t.reference.min() < 0 or t.reference.max() >= len(t.time):
        raise ValueError(f"targets: reference steps must lie in 0..{len(t.time) - 1} and be at least one")
    resting = np.unique(t.block[t.reference])
    if len(resting) not in (1, int(t.block[-1]) + 1):
        raise ValueError(
            f"targets: reference steps lie in blocks {resting.tolist()} of {int(t.block[-1]) + 1}; wanted "
            "them in one block, for all, or in every block, each for its own"
        )
    for b in set(t.released) - set(resting.tolist()):
        raise ValueError(
            f"targets: block {b} is released, but has no rest; wanted reference steps of its "
            "own, or released = false"
        )
    if t.noises and (len(t.noises) != int(t.block[-1]) + 1 or t.noise is None):
        raise ValueError(f"targets: {len(t.noises)} noise models; wanted one for each block, or one for all")
    variance = np.diagonal(t.covariance, axis1=2, axis2=3)
    good = np.isfinite(t.value) & np.isfinite(variance) & (np.nan_to_num(variance) > 0)
    if (t.valid & ~good).any():
        step, point, component = (int(i) for i in np.argwhere(t.valid & ~good)[0])
        raise ValueError(
            f"targets: step {step}, point {t.names[point]}, U{component + 1} is valid but has value "
            f"{t.value[step, point, component]:g} mm and variance {variance[step, point, component]:g} mm2; "
            "wanted a finite value and a variance above 0"
        )


def _check_loads(t: Targets) -> None:
    """Raise ValueError at the first load of no block, at no point, or a weight that nothing pulls down."""
    for load in t.loads:
        if not 0 <= load.block <= int(t.block[-1]):
            raise ValueError(f"targets: a load of block {load.block}; there are blocks 0 to {t.block[-1]}")
        if isinstance(load.at, str) and load.at not in t.names:
            raise ValueError(
                f"targets: the load of block {load.block} is at {load.at!r}; wanted one of the points "
                f"{', '.join(t.names)}, or a position [x, y, z] in mm"
            )
