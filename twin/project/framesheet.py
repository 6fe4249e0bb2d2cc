"""The printed sheet of markers round the finger, frame.toml: places in mm as the printer was told them."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from twin.marktables import MarkerTable
from twin.project.config import Config
from twin.tablemodel import Length, NotNegative, Positive, SdMm, TableModel
from twin.validation import checked, tables_of, value_text

UNMEASURED = 0.005  # relative sd of a printer's scale along one direction, which no ruler tells
OFF = 0.1  # of a ruler's length: beyond it the two are exchanged, or of another sheet


class SheetMarker(TableModel):
    marker: int = Field(ge=0, le=10**6)
    role: Literal["frame", "fixed"]
    place_mm: tuple[Length, Length]
    out_mm: Length = Field(default=0.0, description="towards the camera, of a loose marker")
    size_mm: Positive | None = Field(default=None, description="its side, where it has its own")


class SheetTable(TableModel):
    """What stands on a sheet: mm to the right and up, from the middle of the window and z = 0. Loose markers
    that pictures have measured are written in the same way."""

    size_mm: Positive = Field(description="side of its markers, mm")
    sd_mm: SdMm = Field(description="sd of a marker's centre along one direction, beside the rulers, mm")
    ruler_mm: tuple[Positive, Positive] | None = Field(
        default=None, description="length of its rulers, across and upright, mm; loose markers have none"
    )
    clamp_mm: NotNegative = Field(description="from the middle of the window to x = 0, on either side, mm")
    markers: tuple[SheetMarker, ...]

    def text(self) -> str:
        """The file's text."""
        told = {
            "sd_mm": "sd of a printed marker's centre; correct it for a better or worse printer"
            if self.ruler_mm
            else "sd of a marker's place in the plane",
            "ruler_mm": "rulers, across and upright, as drawn; what they measure goes into twin.toml",
        }
        origin = (
            "The loose markers of the rig, measured in pictures: mm to the right and up, from x = 0, z = 0."
            if self.ruler_mm is None
            else "The sheet frame.pdf as drawn: mm to the right and up, from the window's middle and z = 0."
        )
        lines = [
            f"# {origin}",
            '# Keep it as long as the rig is used. In twin.toml: [frame] sheet = "raw/frame.toml".',
            "",
        ]
        for key in ("size_mm", "sd_mm", "ruler_mm", "clamp_mm"):
            if (value := getattr(self, key)) is not None:
                about = told.get(key) or type(self).model_fields[key].description
                lines.append(f"{key} = {value_text(value)}  # {about}")
        for mark in self.markers:
            stated = mark.model_dump(exclude_defaults=True).items()
            lines += ["", "[[markers]]", *(f"{key} = {value_text(value)}" for key, value in stated)]
        return "\n".join(lines) + "\n"


def read_sheet(path: Path) -> SheetTable:
    """The sheet of a file; ValueError where it is not there or not right."""
    if not path.is_file():
        raise ValueError(
            f"frame.sheet: {path} does not exist; `twin print --frame a4` writes it beside the sheet, and "
            "another print of that command is the same sheet"
        )
    return checked(SheetTable, tables_of(path.read_bytes(), name=path.name), name=path.name)


def with_sheet(config: Config, folder: Path) -> Config:
    """The configuration with the markers of its sheet, their sd and that of the scale; itself without one.

    The error of the printer's scale is what the rulers tell; where nobody measured them, `UNMEASURED`.
    """
    if config.frame.sheet is None:
        return config
    return on_sheet(config, read_sheet(folder / config.frame.sheet))


def on_sheet(config: Config, sheet: SheetTable) -> Config:
    """The configuration with the markers of a sheet."""
    frame, measure = config.frame, config.measure
    known = frame.ruler_mm or sheet.ruler_mm is None  # of loose markers the board tells it
    scale = measure.scale_sd if known else float((measure.scale_sd**2 + UNMEASURED**2) ** 0.5)
    update = {"frame_sd_mm": sheet.sd_mm, "scale_sd": scale}
    placed = frame.model_copy(update={"markers": markers_of(sheet, config)})
    full = config.model_copy(
        update={"frame": placed, "measure": measure.model_copy(update=update)}
    )
    full.check()
    return full


def said_of_sheet(config: Config) -> str:
    """One sentence on the sheet of a configuration; empty without one."""
    frame = config.frame
    if frame.sheet is None:
        return ""
    roles = [marker.role for marker in frame.markers]
    scale = (f"The board in {frame.pictures} tells the scale." if frame.pictures else
             f"Its rulers measure {frame.ruler_mm[0]:g} and {frame.ruler_mm[1]:g} mm." if frame.ruler_mm else
             f"Nobody measured its rulers, so all displacements may be off by {100 * UNMEASURED:g} %: "
             "measure both and write ruler_mm = [across, upright] under [frame].")  # fmt: skip
    return (
        f"The sheet {frame.sheet} has {roles.count('frame')} markers for the axes and "
        f"{roles.count('fixed')} fixed ones, {config.measure.frame_sd_mm:g} mm (sd) off their places, at y = "
        f"{frame.markers[0].position_mm[1]:g} mm. {scale}"
    )


def _face(config: Config) -> float:
    """Distance mm of the side face from the middle of the finger, at which the sheet lies."""
    if config.frame.y_mm is not None:
        return config.frame.y_mm
    width = getattr(config.model.dimensions, "width_mm", None)
    if width is None:
        raise ValueError(
            f"frame.y_mm is missing: wanted y of the sheet in mm, as the body {config.model.kind!r} does not "
            "say where its side face is"
        )
    return 0.5 * float(width) * (-1.0 if config.frame.finger == "right" else 1.0)


def markers_of(sheet: SheetTable, config: Config) -> tuple[MarkerTable, ...]:
    """The markers in world axes, which the finger's direction turns: x goes from the clamp to its tip."""
    frame, y = config.frame, _face(config)
    drawn = sheet.ruler_mm or (1.0, 1.0)
    measured = frame.ruler_mm or drawn
    across, upright = (m / d for m, d in zip(measured, drawn, strict=True))
    if max(abs(across - 1.0), abs(upright - 1.0)) > OFF:
        raise ValueError(
            f"frame.ruler_mm = {list(measured)}: the sheet has rulers of {drawn[0]:g} mm across and "
            f"{drawn[1]:g} mm upright, wanted them within {100 * OFF:g} %; exchange the two, or "
            "print at 100 %"
        )
    along = 1.0 if frame.finger == "right" else -1.0

    def placed(mark: SheetMarker) -> tuple[float, float, float]:
        right, up = mark.place_mm
        x = across * (along * right + sheet.clamp_mm)
        return round(x, 4), y - along * mark.out_mm, round(upright * up, 4)

    grown = (across * upright) ** 0.5
    return tuple(
        MarkerTable(
            name=f"s{m.marker}", marker=m.marker, role=m.role, position_mm=placed(m),
            size_mm=grown * (m.size_mm or sheet.size_mm),
        )
        for m in sheet.markers
    )  # fmt: skip
