"""The tables of twin.toml for recordings: cameras and board, films, another program's files, speckled face,
errors of measuring."""

from typing import Literal, Self

from pydantic import Field, model_validator

from twin.formats.importtable import ImportTable
from twin.project.targetschema import LoadTable, Shares
from twin.tablemodel import (
    Dictionary,
    Direction,
    Finite,
    Length,
    Name,
    Positive,
    RelativePath,
    SdMm,
    Share,
    StaticStart,
    TableModel,
)


class BoardTable(TableModel):
    kind: Literal["charuco", "chessboard", "circles", "acircles", "codedcircles"] = Field(
        default="charuco",
        description="acircles: every other row shifted; codedcircles: three are rings or larger",
    )
    columns: int = Field(
        ge=2, le=1000, description="number across: squares (charuco), inner corners (chessboard) or circles"
    )
    rows: int = Field(ge=2, le=1000, description="number down, counted alike")
    square_mm: Positive = Field(
        description="measured side of a square, or distance of circles (acircles: of rows), mm"
    )
    marker_mm: Positive | None = Field(
        default=None, description="measured side of a marker of a charuco board, mm"
    )
    dictionary: Dictionary = Field(
        default="DICT_4X4_50", description="ArUco dictionary of the board: a name, or a file of your own"
    )
    coding: tuple[tuple[int, int], ...] = Field(
        default=(),
        description="for codedcircles: column and row of the three coding dots, from 0 at the"
        " top left, such as [[2, 2], [10, 2], [2, 7]]",
    )
    inverted: bool = Field(default=False, description="whether the board is white on black")
    mirrored: bool = Field(
        default=False,
        description="whether the board is printed mirrored, or filmed from behind",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.kind == "codedcircles") != (len(self.coding) == 3):
            raise ValueError(
                f"coding = {[list(dot) for dot in self.coding]}: wanted column and row of the three coding "
                "dots with codedcircles, and no coding with another kind"
            )
        if self.kind != "charuco":
            return self
        if self.marker_mm is None:
            raise ValueError("marker_mm is missing: wanted the measured side of the charuco markers in mm")
        if self.marker_mm >= self.square_mm:
            raise ValueError(
                f"marker_mm = {self.marker_mm:g}: wanted less than square_mm = {self.square_mm:g} mm; "
                "measure both on the printed board"
            )
        return self


class CameraTable(TableModel):
    name: Name = Field(description="name of the camera")
    film: RelativePath = Field(
        description="film of the test, or pictures: a folder, or a pattern such as raw/film-*.png"
    )
    fps: Positive | None = Field(
        default=None, description="frame rate of pictures without times.csv, 1/s"
    )
    static: RelativePath = Field(
        description="film of the finger at rest, 300 frames or more, which gives the noise"
    )
    boards: RelativePath | None = Field(
        default=None,
        description="the calibration board: pictures such as raw/boards/*.png, or a film, raw/boards.mp4",
    )
    board_times: RelativePath | None = Field(
        default=None,
        description="CSV with columns camera,time_s for the board's films; else they start together",
    )
    camera_file: RelativePath | None = Field(
        default=None,
        description="in place of boards: another program's calibration, such as OpenCV YAML",
    )
    dictionary: Dictionary = Field(
        default="DICT_4X4_50", description="ArUco dictionary of the markers: a name, or a file of your own"
    )
    mirrored: bool = Field(
        default=False,
        description="whether all its films and pictures are mirrored",
    )
    film_start_s: Finite = Field(
        default=0.0,
        description="time of the film's first frame on the clock of the pressure log, s; left out: the "
        "finger's motion tells it",
    )
    static_start_s: StaticStart = None
    readout_ms: Positive | None = Field(
        default=None, description="rolling shutter: time from the first row of a frame to the last, ms"
    )
    max_rms_px: Positive = Field(
        default=0.3, description="largest reprojection RMS that is accepted, px"
    )
    board: BoardTable | None = None

    @model_validator(mode="after")
    def _calibrated(self) -> Self:
        if self.camera_file is None and (self.boards is None or self.board is None):
            raise ValueError(
                f"cameras {self.name!r} has no calibration: give boards and [cameras.board], or camera_file"
            )
        if self.board_times is not None and self.boards is None:
            raise ValueError(f"cameras {self.name!r} has board_times but no boards: name the board's film")
        if self.camera_file is not None and self.boards is not None:
            raise ValueError(f"cameras {self.name!r} has boards and camera_file: keep one of them")
        return self


class FilmTable(TableModel):
    """One of several films of a batch."""

    name: Name = Field(description="name of the film")
    file: RelativePath = Field(description="the film, or pictures: a folder or a pattern")
    static: RelativePath | None = Field(
        default=None,
        description="its own static film; left out: that of [[cameras]]",
    )
    pressure: RelativePath | None = Field(
        default=None,
        description="its own pressure log; left out: that of [pressure]",
    )
    film_start_s: Finite = Field(
        default=0.0,
        description="time of its first frame on the clock of its log, s; left out: the motion tells it",
    )
    static_start_s: StaticStart = None
    gravity: Direction | None = Field(
        default=None,
        description="direction of gravity where the rig was turned; in every film, or in none",
    )
    pressure_shares: Shares = Field(
        default_factory=dict,
        description="of a deck with several chambers: what of the pressure each surface carries in this "
        "film, such as {LEFT = 1.0, RIGHT = 0.0}; in every film, or in none",
    )
    held_out: bool = Field(
        default=False, description="true: predicted, never fitted"
    )


class RecordingTable(ImportTable):
    """Displacements that another program measured, one of several recordings."""

    name: Name = Field(default="", description="name of the recording; left out: that of its file")
    gravity: Direction | None = Field(
        default=None,
        description="direction of gravity in it, in world axes; in every [[import]], or in none",
    )
    loads: tuple[LoadTable, ...] = Field(
        default=(),
        description='what hangs on the body in it, such as [{weight_g = 20.0, at = "tip"}]',
    )
    pressure_shares: Shares = Field(
        default_factory=dict, description="as in [[films]]; in every [[import]], or in none"
    )
    held_out: bool = Field(default=False, description="true: predicted, never fitted")


class MeasureTable(TableModel):
    placement_sd_mm: SdMm = Field(
        default=0.3, description="distance of a marker from its stated place or node, mm"
    )
    place_sd_mm: SdMm = Field(
        default=0.02, description="what is left of that where the film measures its place, mm"
    )
    scale_sd: Share = Field(default=0.001, description="relative error of the mm scale")
    frame_sd_mm: SdMm = Field(
        default=0.1, description="distance of a frame marker from its stated position, mm"
    )
    node_sd_mm: SdMm = Field(
        default=0.1, description="distance of the finger's point from the model's node, mm"
    )
    height_sd_mm: SdMm = Field(
        default=0.3,
        description="error of a marker's distance from the frame markers' plane, mm",
    )
    out_of_plane_sd_mm: SdMm = Field(
        default=0.3,
        description="motion of a marker towards the camera at its largest displacement, mm",
    )
    reference_s: Positive = Field(
        default=1.8,
        description="rest at the start of the film that displacements are relative to, s",
    )
    steps: int | None = Field(
        default=None,
        ge=2,
        description="largest number of evenly spaced frames kept as targets, by default as many as a fit "
        "holds in 3 GB, 2000 at most; tracking uses every frame",
    )
    corrections: RelativePath | None = Field(
        default=None,
        description="what you mend of the tracks by hand, such as raw/corrections.csv; see files.md",
    )


class DicTable(TableModel):
    low_mm: tuple[Length, Length] = Field(description="smallest x and z of the speckled part at rest, mm")
    high_mm: tuple[Length, Length] = Field(description="largest x and z of the speckled part at rest, mm")
    y_mm: Length = Field(description="y of the face, mm; it must be flat")
    step_mm: Positive = Field(default=4.0, description="distance from one measured point to the next, mm")
    subset_mm: Positive = Field(
        default=6.0,
        description="side of the square followed around each point, mm; wanted 15 px and 5 speckles or more",
    )
