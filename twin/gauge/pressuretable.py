"""The table [pressure] of twin.toml: the pressure log, its gauge, and its clock."""

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from twin.tablemodel import Finite, Positive, RelativePath, TableModel

if TYPE_CHECKING:
    from twin.gauge.logcolumns import LogFormat


class PressureTable(TableModel):
    file: RelativePath = Field(
        default="raw/pressure.csv",
        description="pressure log, a CSV file with columns such as time_s,pressure_MPa or t [ms],p [bar]",
    )
    column: str | None = Field(
        default=None, description="heading of the pressure, where it cannot be told"
    )
    unit: str | None = Field(
        default=None,
        description="unit where the heading has none: MPa, kPa, Pa, hPa, bar, mbar, psi or V",
    )
    volt_zero: Finite | None = Field(
        default=None, description="gauge that gives volts: reading at no pressure, V"
    )
    MPa_per_V: Finite | None = Field(
        default=None, description="gauge that gives volts: sensitivity, MPa/V"
    )
    top_kPa: Positive | None = Field(
        default=None, description="what the regulator was set to at most, kPa; tells a wrong unit of the log"
    )
    time_shift_s: Finite = Field(default=0.0, description="added to the times of the log, s")
    sync_sd_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = Field(
        default=0.002, description="sd of film_start_s where join is stamps, s"
    )
    join: Literal["stamps", "flash", "onset"] = Field(
        default="stamps",
        description="synchronise film and log by film_start_s, a lamp, or the finger's motion; left out: "
        "stamps, and onset where no film_start_s is stated",
    )
    flash_region: tuple[int, int, int, int] | None = Field(
        default=None, description="where the lamp is in the film, [x, y, width, height] in px"
    )
    flash_time_s: Finite | None = Field(
        default=None,
        description="time of the lamp on the clock of the log, s; else the log's column flash",
    )

    @property
    def form(self) -> "LogFormat":
        """How the log is to be read."""
        from twin.gauge.logcolumns import LogFormat
        from twin.gauge.pressureunits import Line

        line = None
        if self.volt_zero is not None and self.MPa_per_V is not None:
            line = Line(self.volt_zero, self.MPa_per_V)
        return LogFormat(self.column, self.unit, line, self.top_kPa)

    @model_validator(mode="after")
    def _joined(self) -> Self:
        if (self.volt_zero is None) != (self.MPa_per_V is None) or self.MPa_per_V == 0:
            raise ValueError(
                "volt_zero and MPa_per_V are the calibration line of a gauge: wanted both, MPa_per_V "
                "not 0, or none"
            )
        if self.join == "flash" and self.flash_region is None:
            raise ValueError('join = "flash" needs flash_region = [x, y, width, height] in px of the film')
        return self
