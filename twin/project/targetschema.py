"""The keys of targets.toml, one field each as in `config` of twin.toml, from targets and back.

`tables_for` makes the tables of targets, `fields_from` the fields of `Targets` from tables.
"""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from twin.judging.stillnoise import stated_noise, still_noise
from twin.tablemodel import NotNegative, Position, Positive, Step, StillSteps, TableModel
from twin.targets import Array, Load, Noise, PointKind, TargetPoint, Targets, least_known

Shares = dict[str, Annotated[float, Field(ge=-10, le=10, allow_inf_nan=False)]]
Blocks = Sequence[tuple[int, int]]  # (s,) block and step of each step, as targets.csv numbers them
LIGHTEST, HEAVIEST = 0.1, 5000.0  # g, of a weight hung on a soft structure: others are in another unit
STRONGEST = 50.0  # N
FORMER_PLACE = -2  # node of a point between nodes in files of older versions; now its role is "place"


def _sd(x: float) -> float:
    if x < 0 or math.isinf(x):
        raise ValueError("wanted an sd in mm, 0 or more, or nan where the component is not observed")
    return x


def _correlation(x: float) -> float:
    if abs(x) > 1:
        raise ValueError("wanted a correlation, -1 to 1, or nan where the component is not observed")
    return x


MaybeSd = Annotated[float, AfterValidator(_sd)]
MaybeCorrelation = Annotated[float, AfterValidator(_correlation)]


class ReferenceTable(TableModel):
    block: int | None = Field(default=None, description="block of the reference steps; by default the first")
    steps: tuple[Step, ...] = Field(
        default=(), description="steps of that block whose mean the displacements are relative to"
    )
    each_block: bool = Field(
        default=False, description="true: every block is relative to the mean of its own reference_steps"
    )

    @model_validator(mode="after")
    def _stated(self) -> Self:
        if self.each_block == bool(self.steps):
            raise ValueError(
                f"reference: steps = {list(self.steps)}, each_block = {str(self.each_block).lower()}: wanted "
                "one step or more, such as steps = [0], or each_block = true with reference_steps in each"
            )
        return self


class LoadTable(TableModel):
    at: str | Position = Field(description="a point's name, or a position [x, y, z] in mm")
    weight_g: Annotated[float, Field(ge=LIGHTEST, le=HEAVIEST)] | None = Field(
        default=None, description=f"a hung weight, {LIGHTEST:g} to {HEAVIEST:g} grams, such as 20.0"
    )
    force_N: Position | None = Field(default=None, description="a measured force [x, y, z] in world axes, N")

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.weight_g is None) == (self.force_N is None):
            raise ValueError(
                f"a load at {self.at} has weight_g = {self.weight_g} and force_N = {self.force_N}: wanted "
                "one of weight_g in grams and force_N [x, y, z] in newtons"
            )
        if self.force_N is not None and not 0 < sum(x * x for x in self.force_N) <= STRONGEST**2:
            raise ValueError(
                f"a load at {self.at} has force_N = {list(self.force_N)}: wanted a force above 0 and up to "
                f"{STRONGEST:g} N; is it in another unit?"
            )
        return self


class TargetBlock(TableModel):
    block: int = Field(description="number of the block in targets.csv")
    held_out: bool = Field(default=False, description="true: kept from every fit")
    gravity: Position | None = Field(
        default=None, description="direction of gravity in world axes, a unit vector; for all blocks or none"
    )

    loads: tuple[LoadTable, ...] = Field(default=(), description="what hangs on the finger in this block")
    released: bool = Field(
        default=False, description="true: held unloaded at its reference steps; weight and loads act after"
    )
    pressure_shares: Shares = Field(
        default_factory=dict,
        description="of a deck with several chambers: what of the pressure each surface carries in this "
        "block, such as {LEFT = 1.0, RIGHT = 0.0}; for all blocks or none",
    )
    reference_steps: tuple[Step, ...] = Field(
        default=(), description="its own reference steps, where [reference] has each_block = true"
    )
    noise: "NoiseTable | None" = Field(default=None, description="its own noise model, in place of [noise]")

    @model_validator(mode="after")
    def _unit(self) -> Self:
        if self.gravity is not None and abs(sum(x * x for x in self.gravity) - 1) > 1e-6:
            raise ValueError(
                f"blocks: gravity = {list(self.gravity)} of block {self.block} is not a unit vector: wanted "
                "length 1, such as [0.0, 0.0, -1.0]"
            )
        return self


class TargetMark(TableModel):
    name: str = Field(min_length=1, description="name of the point in targets.csv")
    role: Literal["finger", "place", "fixed"] = Field(
        default="finger",
        description="finger: a marker at a node; place: a point between nodes; fixed: a marker on the rig",
    )
    node: int | None = Field(default=None, le=10**9, description="label of its node in the mesh")
    position_mm: Position | None = Field(default=None, description="where it is without load, mm")
    rest_mm: Position | None = Field(
        default=None, description="of a place: where the film at rest shows it, which then counts"
    )

    @model_validator(mode="after")
    def _placed(self) -> Self:
        if self.node is not None and self.node < 1 and self.node != FORMER_PLACE:
            raise ValueError(
                f"points: node = {self.node} of point {self.name!r}: wanted a node label, 1 or more"
            )
        return self


class NoiseOfPoint(TableModel):
    name: str = Field(description="name of the point in targets.csv")
    sd_mm: tuple[MaybeSd, MaybeSd, MaybeSd] = Field(description="sd at rest in x, y, z, mm")
    rho: tuple[MaybeCorrelation, MaybeCorrelation, MaybeCorrelation] = Field(
        description="correlation from step to step, -1 to 1"
    )
    codec_sd_mm: tuple[MaybeSd, MaybeSd, MaybeSd] = Field(description="more noise where it moves, mm")


class NoiseTable(TableModel):
    """The noise as a static film shows it; or, in place of that, as the user knows it, or where it shows."""

    frames: int | None = Field(
        default=None, ge=1, le=10**9, description="static frames that the noise was estimated from"
    )
    lasting: float = Field(default=1.0, ge=0, le=1, description="share of the variance that rho is of")
    gauge_sd_MPa: NotNegative | None = Field(
        default=None, description="noise of one sample of the pressure log, MPa"
    )
    gauge_frames: int | None = Field(
        default=None, ge=0, le=10**9, description="samples that it was estimated from"
    )
    points: tuple[NoiseOfPoint, ...] = Field(default=(), description="one for each point of targets.csv")
    basis: str = Field(default="", description="what it rests on, where that is no static film")
    coding_rho: float = Field(
        default=0.0, ge=0, lt=1, description="correlation from step to step of what coding adds"
    )
    freedom: Positive | None = Field(
        default=None, description="degrees of freedom of a factor of all sds that the film itself told"
    )
    sd_mm: Positive | None = Field(default=None, description="in place of these: sd of every value, mm")
    rho: float = Field(default=0.0, ge=0, lt=1, description="correlation with the value of the step before")
    still_steps: StillSteps | None = Field(
        default=None,
        description="or first and last steps of rests and holds, whose scatter is the noise; or \"holds\"",
    )

    @property
    def is_stated(self) -> bool:
        """True where the user states the noise, or where it shows, in place of a static film."""
        return self.sd_mm is not None or self.still_steps is not None

    @model_validator(mode="after")
    def _one(self) -> Self:
        film = ("frames", "gauge_sd_MPa", "gauge_frames")
        missing = [key for key in film if getattr(self, key) is None]
        if self.is_stated and (self.points or None not in (self.sd_mm, self.still_steps)):
            raise ValueError("noise: wanted one of points, sd_mm and still_steps; leave the others out")
        if missing and not self.is_stated:
            raise ValueError(
                f"noise.{missing[0]} is missing; add it, or state sd_mm (such as 0.02) or still_steps (such "
                'as [[0, 60]], or "holds") in place of all'
            )
        return self


class TargetsTable(TableModel):
    """The whole of targets.toml."""

    reference: ReferenceTable | None = None
    blocks: tuple[TargetBlock, ...] = ()
    points: tuple[TargetMark, ...] = ()
    noise: NoiseTable | None = None


# -- targets -> tables ---------------------------------------------------------------------------------------


def tables_for(t: Targets) -> TargetsTable:
    """The tables of targets.toml that describe targets."""
    start = np.searchsorted(t.block, np.arange(int(t.block[-1]) + 1))
    reference_block = t.block[t.reference]
    step = t.reference - start[reference_block]  # counted within its block
    each = bool(t.rests.any())
    reference: dict[str, Any] = {"each_block": True}
    if not each:
        reference = {"block": int(reference_block[0]), "steps": tuple(step.tolist())}
    blocks = []
    for b, first_step in enumerate(start):
        keys = {
            "gravity": None if t.gravity is None else tuple(t.gravity[b].tolist()),
            "pressure_shares": {name: float(shares[b]) for name, shares in t.shares.items()},
            "loads": tuple(_load_table(load) for load in t.loads if load.block == b),
            "released": b in t.released or None,
            "reference_steps": tuple(step[reference_block == b].tolist()) if each else (),
            "noise": _noise_table(t.noises[b], t.names) if t.noises else None,
        }
        blocks.append(TargetBlock(block=b, held_out=bool(t.held_out[first_step]), **_stated(keys)))
    noise = None if t.noises or t.noise is None else _noise_table(t.noise, t.names)
    return TargetsTable(
        reference=ReferenceTable(**reference), blocks=tuple(blocks), noise=noise,
        points=tuple(_point_table(point) for point in t.points),
    )  # fmt: skip


def _stated(keys: Mapping[str, Any]) -> dict[str, Any]:
    """The keys that have a value."""
    return {key: value for key, value in keys.items() if value not in (None, (), {}, "")}


def _load_table(load: Load) -> LoadTable:
    return LoadTable(at=load.at, **_stated({"weight_g": load.weight_g, "force_N": load.force}))


def _point_table(point: TargetPoint) -> TargetMark:
    role = "" if point.kind is PointKind.UNKNOWN else point.kind.value
    keys = {"role": role, "node": point.node, "position_mm": point.position, "rest_mm": point.rest}
    return TargetMark(name=point.name, **_stated(keys))


def _noise_table(n: Noise, names: tuple[str, ...]) -> NoiseTable:
    rows = [tuple(tuple(row) for row in values.tolist()) for values in (n.sd, n.rho, n.codec_sd)]
    points = tuple(
        NoiseOfPoint(name=name, sd_mm=sd, rho=rho, codec_sd_mm=codec_sd)
        for name, sd, rho, codec_sd in zip(names, *rows, strict=True)
    )
    return NoiseTable(
        frames=n.frames, lasting=float(n.lasting), gauge_sd_MPa=float(n.gauge_sd_MPa),
        gauge_frames=n.gauge_frames, points=points,
        **_stated({"basis": n.basis, "freedom": None if np.isinf(n.freedom) else n.freedom,
                   "coding_rho": n.coding_rho or None}),
    )  # fmt: skip


# -- tables -> fields of targets -----------------------------------------------------------------------------


def fields_from(
    about: TargetsTable, path: Path, steps: Blocks, names: tuple[str, ...], *, nodes: Mapping[str, int],
    value: Array, pressure: Array, correlations: Mapping[str, Array],
) -> dict[str, Any]:  # fmt: skip
    """The fields of `Targets` that targets.toml (`path`) states: points, held_out, gravity, shares, loads,
    noise and noises, and the reference steps where it names them.

    steps (s,) and names (p,) of targets.csv; nodes: labels by point name, of twin.toml; value (s, p, 3) mm
    and pressure (s,) MPa, in which a rest shows its noise; correlations: of targets.npz.
    """
    labels = sorted({b for b, _ in steps})
    _check_names(path, about.points, names)
    marks = {row.name: row for row in about.points}
    points = tuple(_point(path, marks.get(name) or TargetMark(name=name), nodes.get(name)) for name in names)
    return {
        "points": points, **_block_fields(path, about, steps, labels),
        "loads": _loads(path, about, labels, points), **_reference(path, about, steps),
        **_noises(path, about, [labels.index(b) for b, _ in steps], names, value, pressure, correlations),
    }  # fmt: skip


def _check_names(path: Path, rows: Sequence[TargetMark | NoiseOfPoint], names: tuple[str, ...]) -> None:
    """Raise ValueError where a row names a point that targets.csv lacks, or two rows one point."""
    for k, row in enumerate(rows):
        if row.name not in names:
            raise ValueError(
                f"{path}: point {row.name!r} is not in targets.csv, which has {', '.join(names)}"
            )
        if row.name in [before.name for before in rows[:k]]:
            raise ValueError(f"{path}: point {row.name!r} stands twice; keep one of the two")


def _point(path: Path, row: TargetMark, project_node: int | None) -> TargetPoint:
    """The point of a table in targets.toml; stated: its node in twin.toml."""
    name, node, kind = row.name, row.node, PointKind.UNKNOWN
    if row.role == "place" or node == FORMER_PLACE:
        kind, node = PointKind.PLACE, None
    elif row.role == "fixed":
        kind, node = PointKind.FIXED, None
    if project_node is not None and kind is not PointKind.UNKNOWN:
        raise ValueError(
            f"{path}: point {name!r} has role {kind.value!r}, twin.toml gives it node "
            f"{project_node}; correct one"
        )
    if project_node is not None and node not in (None, project_node):
        raise ValueError(f"{path}: point {name!r} is node {node}, twin.toml says {project_node}; correct one")
    node = project_node if node is None else node
    if kind is PointKind.UNKNOWN and node is None and re.fullmatch("[0-9]{1,18}", name):
        node = int(name)
    return TargetPoint(name, kind if node is None else PointKind.NODE, node, row.position_mm, row.rest_mm)


def _block_fields(path: Path, about: TargetsTable, steps: Blocks, labels: list[int]) -> dict[str, Any]:
    """Mask held_out (s,), gravity (blocks, 3) or None, shares of the pressure, and what is released."""
    rows = {row.block: row for row in about.blocks}
    if len(rows) < len(about.blocks):
        raise ValueError(f"{path}: a block stands twice in [[blocks]]; keep one of the two")
    for label in rows.keys() - set(labels):
        raise ValueError(f"{path}: block {label} is not in targets.csv, which has {labels}")
    every = [rows.get(b, TargetBlock(block=b)) for b in labels]
    try:
        shares = shares_by_surface({f"block {row.block}": row.pressure_shares for row in every})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    gravity = [row.gravity for row in every if row.gravity is not None]
    if gravity and len(gravity) != len(labels):
        raise ValueError(
            f"{path}: gravity is stated for {len(gravity)} of {len(labels)} blocks; state all or none"
        )
    held_out = np.array([b in rows and rows[b].held_out for b, _ in steps])
    return {
        "held_out": held_out, "gravity": np.array(gravity) if gravity else None, "shares": shares,
        "released": tuple(k for k, row in enumerate(every) if row.released),
    }  # fmt: skip


def shares_by_surface(recordings: Mapping[str, Mapping[str, float]]) -> dict[str, NDArray[np.float64]]:
    """The shares (b,) of the logged pressure that each surface carries in the recordings, from the shares of
    each recording by its name. ValueError where recordings name other surfaces, or one presses on none.

    >>> shares_by_surface({"bend": {"LEFT": 1.0, "RIGHT": 0.0}, "push": {"LEFT": 1.0, "RIGHT": 1.0}})
    {'LEFT': array([1., 1.]), 'RIGHT': array([0., 1.])}
    """
    surfaces = tuple(next(iter(recordings.values()), ()))
    for name, shares in recordings.items():
        if shares.keys() != set(surfaces):
            raise ValueError(
                f"{name}: pressure_shares names {', '.join(shares) or 'no surface'}, that of "
                f"{next(iter(recordings))} {', '.join(surfaces) or 'none'}; wanted the same surfaces in "
                "each, with 0.0 for one that has no pressure"
            )
        if shares and not any(shares.values()):
            raise ValueError(
                f"{name}: pressure_shares is 0.0 throughout, so the logged pressure acts on nothing; wanted "
                "1.0 for the surface that it acts on"
            )
    return {surface: np.array([shares[surface] for shares in recordings.values()]) for surface in surfaces}


def _loads(
    path: Path, about: TargetsTable, labels: list[int], points: tuple[TargetPoint, ...]
) -> tuple[Load, ...]:
    """The loads on the structure, by block. ValueError for one at no point on the finger."""
    names = [p.name for p in points if p.kind is not PointKind.FIXED]
    rows = [(labels.index(row.block), load) for row in about.blocks for load in row.loads]
    for block, load in rows:
        if isinstance(load.at, str) and load.at not in names:
            raise ValueError(
                f"{path}: a load of block {block} is at {load.at!r}; wanted one of the points "
                f"{', '.join(names)}, or a position [x, y, z] in mm"
            )
    return tuple(Load(block, load.at, load.weight_g, load.force_N) for block, load in rows)


def _reference(path: Path, about: TargetsTable, steps: Blocks) -> dict[str, NDArray[np.int64]]:
    """The steps (r,) that displacements are relative to, where targets.toml names them."""
    if about.reference is None:
        return {}
    keys = [(row.block, step) for row in about.blocks for step in row.reference_steps]
    if not about.reference.each_block:
        block = steps[0][0] if about.reference.block is None else about.reference.block
        keys = [(block, step) for step in about.reference.steps]
    for block, step in keys:
        if (block, step) not in steps:
            raise ValueError(f"{path}: reference block {block}, step {step} is not in targets.csv")
    return {"reference": np.array([steps.index(key) for key in keys], dtype=np.int64)}


def _noises(
    path: Path, about: TargetsTable, block: list[int], names: tuple[str, ...], value: Array, pressure: Array,
    correlations: Mapping[str, Array],
) -> dict[str, Any]:  # fmt: skip
    """The noise model, and one for each block (b,) where these differ; block (s,): rank of each step's."""

    def read(table: NoiseTable, correlation: str, steps: NDArray[np.bool_]) -> Noise:
        if table.is_stated:
            return _stated_noise(path, table, value[steps], pressure[steps])
        return _film_noise(path, table, names, correlations.get(correlation))

    rank, every = np.array(block), sorted(set(block))
    if about.noise is not None:
        return {"noise": read(about.noise, "correlation", rank >= 0)}
    rows = [row.noise for row in sorted(about.blocks, key=lambda row: row.block) if row.noise is not None]
    if not rows:
        return {"noise": None}
    if len(rows) != len(every):
        raise ValueError(f"{path}: {len(rows)} of {len(every)} blocks have a noise model; state all or none")
    noises = tuple(read(row, f"correlation_{b}", rank == b) for b, row in enumerate(rows))
    return {"noise": least_known(noises), "noises": noises}


def _stated_noise(path: Path, table: NoiseTable, value: Array, pressure: Array) -> Noise:
    """The noise model that [noise] states for all values (s, p, 3) mm, or says where they rest."""
    if table.sd_mm is not None:
        return stated_noise(value, table.sd_mm, table.rho)
    assert table.still_steps is not None  # either of both is there
    try:
        return still_noise(value, pressure, table.still_steps)
    except ValueError as error:
        raise ValueError(f"{path}: [noise] {error}") from None


def _film_noise(path: Path, table: NoiseTable, names: tuple[str, ...], correlation: Array | None) -> Noise:
    """The noise model of a static film."""
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
    sd, rho, codec = (np.array([getattr(rows[n], k) for n in names]) for k in ("sd_mm", "rho", "codec_sd_mm"))
    return Noise(
        sd=sd, rho=rho, codec_sd=codec, correlation=correlation, frames=table.frames,
        gauge_sd_MPa=table.gauge_sd_MPa or 0.0, gauge_frames=table.gauge_frames, lasting=table.lasting,
        basis=table.basis, freedom=table.freedom or np.inf, coding_rho=table.coding_rho,
    )  # fmt: skip
