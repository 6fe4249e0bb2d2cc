"""The keys of targets.toml: one field here is one key there, as in `config` of twin.toml."""

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from twin.project.chambers import Shares
from twin.tablemodel import NotNegative, Position, Positive, Step, StillSteps, TableModel

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
    sd_mm: Positive | None = Field(default=None, description="in place of these: sd of every value, mm")
    rho: float = Field(default=0.0, ge=0, lt=1, description="correlation with the value of the step before")
    still_steps: StillSteps | None = Field(
        default=None,
        description="or first and last steps of rests and holds, whose scatter is the noise; or \"holds\"",
    )

    @property
    def told(self) -> bool:
        """Whether it stands in place of a static film."""
        return self.sd_mm is not None or self.still_steps is not None

    @model_validator(mode="after")
    def _one(self) -> Self:
        film = ("frames", "gauge_sd_MPa", "gauge_frames")
        missing = [key for key in film if getattr(self, key) is None]
        if self.told and (self.points or None not in (self.sd_mm, self.still_steps)):
            raise ValueError("noise: wanted one of points, sd_mm and still_steps; leave the others out")
        if missing and not self.told:
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
