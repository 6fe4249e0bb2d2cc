"""The table [import] of twin.toml: what a file of another program does not say of its displacements."""

from typing import Annotated, Literal

from pydantic import Field

from twin.tablemodel import (
    Finite,
    NotNegative,
    Position,
    Positive,
    RelativePath,
    SdMm,
    Share,
    StillSteps,
    TableModel,
)

LIKELY = 0.6  # the value below which DeepLabCut itself draws no point (pcutoff in its config.yaml)


class ImportTable(TableModel):
    """Displacements that another program measured, and what its file does not say of them."""

    file: RelativePath = Field(
        description="file or folder of the other program, such as raw/film.csv"
    )
    format: Literal["deeplabcut", "anipose", "dice", "matchid", "c3d", "csv"] = Field(
        description="program or format"
    )
    sd_mm: SdMm | None = Field(
        default=None,
        description="sd of one position, mm, while the finger is still; wanted without still_steps",
    )
    rho: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.0, description="correlation of that error with the one in the row before"
    )
    still_steps: StillSteps | None = Field(
        default=None,
        description="first and last rows of rests and holds, whose scatter is the noise; or \"holds\"",
    )
    mm_per_px: Positive | None = Field(
        default=None,
        description="size of a pixel, mm; wanted where the file is in pixels",
    )
    scale_sd: Share = Field(
        default=0.001, description="relative sd of mm_per_px"
    )
    axes: str | None = Field(
        default=None,
        description="the file's axes along, across and up, 0: not seen; x,0,-y: finger to the right",
    )
    fps: Positive | None = Field(
        default=None,
        description="frames in a second, where the file counts frames; not for single load steps",
    )
    unit: str | None = Field(
        default=None, description="unit of its lengths, such as m, where the file states none"
    )
    log: RelativePath | None = Field(
        default=None,
        description="pressure log, with times or one row a step; wanted where the file has no pressure, such "
        "as a column pressure_kPa, and none is stated as top_kPa",
    )
    log_column: str | None = Field(
        default=None, description="heading of the pressure in that log, where it cannot be told"
    )
    log_unit: str | None = Field(
        default=None, description="unit of that pressure, where its heading has none"
    )
    start_s: Finite = Field(
        default=0.0, description="time of the first frame on the clock of the log, s"
    )
    top_kPa: NotNegative | None = Field(
        default=None,
        description="of a step whose top pressure alone is known: that pressure, kPa, in place of a log; 0 "
        "of a body that is released",
    )
    released: bool = Field(
        default=False,
        description="true: a hand holds the body unloaded in its rest; weight and loads act after that",
    )
    hold_sd_mm: NotNegative = Field(
        default=0.0,
        description="sd of a point in that hand in each direction, mm, where it moves most; with released",
    )
    top_sd_kPa: NotNegative | None = Field(
        default=None, description="sd of that pressure in the hold, kPa; left out: 2 % of it"
    )
    first_step: int = Field(
        default=0, ge=0, description="number of first rows that are left out, as the capture's filter settles"
    )
    rest_steps: int = Field(
        default=1,
        ge=1,
        description="number of first steps, at rest, that displacements are relative to",
    )
    base: tuple[str, ...] = Field(
        default=(),
        description="names of three or more markers on the base, whose rigid motion is taken off",
    )
    fixed: tuple[str, ...] = Field(
        default=(), description="names of markers on the rig"
    )
    origin_mm: Position | None = Field(
        default=None,
        description="the file's origin in world axes, mm; then points not in [[points]] count too",
    )
    min_likelihood: Annotated[float, Field(ge=0, le=1)] = Field(
        default=LIKELY,
        description="likelihood or score below which a point is not seen (deeplabcut, anipose)",
    )
