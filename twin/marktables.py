"""The tables [[points]] and [[frame.markers]] of twin.toml: what is followed on the finger and on the rig."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from twin.tablemodel import Label, Length, Name, NotNegative, Position, Positive, RelativePath, TableModel


class MarkTable(TableModel):
    """A marker that is glued on, or a natural feature of the silicone: on the rig or on the finger."""

    name: Name = Field(description="name in targets and reports")
    marker: int | None = Field(default=None, ge=0, le=10**6, description="ArUco id; none for a plain dot")
    size_mm: Positive | None = Field(
        default=None, description="side of the marker, or diameter of a dot, mm; needed with a film"
    )


class MarkerTable(MarkTable):
    """A marker on the rig."""

    role: Literal["frame", "fixed", "clamp"] = Field(
        description="frame: defines the world axes (6 or more); fixed: must show no motion (4 or more); "
        "clamp: a fixed one whose place on the finger is known; two or more tell where the finger stands"
    )
    position_mm: Position = Field(
        description="position of its centre in world axes, mm; of a clamp marker in the axes of the finger"
    )


class FrameTable(TableModel):
    sheet: RelativePath | None = Field(
        default=None,
        description="in place of [[frame.markers]]: raw/frame.toml, written by `twin print --frame a4`",
    )
    ruler_mm: tuple[Positive, Positive] | None = Field(
        default=None,
        description="of a sheet: what its rulers measure, across and upright, mm; left out: the scale may be "
        "off by 0.5 %",
    )
    pictures: RelativePath | None = Field(
        default=None,
        description="of loose markers: rig and board together, raw/rig/*.jpg or a film, from which `twin "
        "setup` measures the sheet",
    )
    axes: tuple[int, int] | None = Field(
        default=None,
        description="of loose markers: ids of the one at x = 0, z = 0 and of one level with it; left out: "
        "the one nearest to the clamp, and the rows of the film",
    )
    finger: Literal["right", "left"] = Field(
        default="right", description="of a sheet: side to which the finger points in the picture"
    )
    y_mm: Length | None = Field(
        default=None, description="of a sheet: its y, mm; left out: that of the finger's side face"
    )
    markers: tuple[MarkerTable, ...] = Field(default=(), description="markers on the rig")

    @model_validator(mode="after")
    def _once(self) -> Self:
        if self.sheet is None and (self.ruler_mm or self.y_mm is not None):
            raise ValueError(
                'frame.ruler_mm and frame.y_mm are of a sheet: name it, sheet = "raw/frame.toml"'
            )
        if self.sheet is not None and self.markers:
            raise ValueError(
                f"frame.sheet = {self.sheet!r} and [[frame.markers]] both say where the frame is: "
                "keep one of them"
            )
        return self


class PointTable(MarkTable):
    """A point on the finger."""

    node: Label | None = Field(
        default=None,
        description="label of the node in the model; or give position_mm, or neither",
    )
    position_mm: Position | None = Field(
        default=None,
        description="its centre without load, mm; the model takes its nearest place, or node; left out, "
        "and no node: where the film at rest shows it",
    )
    standoff_mm: Positive | None = Field(
        default=None,
        description="of a ball or a tag on a stalk: how far position_mm lies off the surface, mm; it turns "
        "with the surface beneath",
    )
    seen_mm: tuple[Length, Length] | None = Field(
        default=None,
        description="x and z of a natural feature in the first picture, mm; `twin pick` writes it",
    )

    @property
    def is_measured(self) -> bool:
        """True where the film at rest tells its place."""
        return self.node is None and self.position_mm is None

    @model_validator(mode="after")
    def _placed(self) -> Self:
        if self.is_measured and self.marker is None and self.seen_mm is None:
            raise ValueError(
                f"points.{self.name}: where it is on the finger is not stated; wanted position_mm = [x, y, "
                "z] in mm, or the label of a node, node = 4401; the film tells it of a coded marker"
            )
        if self.standoff_mm is not None and (self.position_mm is None or self.node is not None):
            raise ValueError(
                f"points.{self.name} has standoff_mm = {self.standoff_mm:g}"
                f"{' and a node' if self.node is not None else ' without position_mm'}; wanted the place of "
                "the marker itself, position_mm = [x, y, z] in mm, alone"
            )
        if self.seen_mm is not None and self.marker is not None:
            raise ValueError(
                f"points.{self.name} has marker = {self.marker} and seen_mm: wanted one of them; seen_mm is "
                "for a natural feature without a marker"
            )
        return self


class PoseTable(TableModel):
    """Where the body stands in the axes of the frame markers."""

    source: Literal["here", "outline"] = Field(
        default="here",
        alias="from",
        description="outline: the outline of the finger at rest tells where it stands, and x_mm, z_mm and "
        "turn_deg are where it is looked for",
    )
    x_mm: Length = Field(default=0.0, description="x of the middle of the clamped end's bottom, mm")
    z_mm: Length = Field(default=0.0, description="z of it, mm")
    turn_deg: Annotated[float, Field(ge=-180, le=180)] = Field(
        default=0.0, description="turn of the finger from x towards z, degrees; - where it points down"
    )
    sd_mm: NotNegative = Field(default=0.3, description="error of x and of z, mm")
    turn_sd_deg: NotNegative = Field(default=0.3, description="error of the turn, degrees")
    edge_sd_mm: Positive = Field(
        default=0.05,
        description="distance of the edge that is seen from the finger's, by light and round corners, mm",
    )


class OutlineTable(TableModel):
    """The outline of the moved finger, which carries no tags, beside the markers."""

    use: bool = Field(
        default=False,
        description="true: `twin compare` lays the edges of the finger in the film beside the fitted "
        "model's, and names a tag that does not move as the body beside it",
    )
    moments: int = Field(
        default=8, ge=2, le=100, description="moments at which it does, spread over the path of the pressure"
    )
