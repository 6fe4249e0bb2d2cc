"""The tables [[points]] and [[frame.markers]] of twin.toml: what is followed on the finger and on the rig."""

from typing import Literal, Self

from pydantic import Field, model_validator

from twin.tablemodel import Label, Length, Name, Position, Positive, TableModel


class MarkTable(TableModel):
    """A marker that is glued on, or a natural feature of the silicone: on the rig or on the finger."""

    name: Name = Field(description="name in targets and reports")
    marker: int | None = Field(default=None, ge=0, le=10**6, description="ArUco id; none for a plain dot")
    size_mm: Positive | None = Field(
        default=None, description="side of the marker, or diameter of a dot, mm; needed with a film"
    )


class MarkerTable(MarkTable):
    """A marker on the rig."""

    role: Literal["frame", "fixed"] = Field(
        description="frame: defines the world axes (6 or more); fixed: must show no motion (4 or more)"
    )
    position_mm: Position = Field(description="position of its centre in world axes, mm")


class FrameTable(TableModel):
    markers: tuple[MarkerTable, ...] = Field(default=(), description="markers on the rig")


class PointTable(MarkTable):
    """A point on the finger."""

    node: Label | None = Field(
        default=None,
        description="label of the node in the model; or give position_mm",
    )
    position_mm: Position | None = Field(
        default=None,
        description="its centre without load, mm; the model takes its nearest place, or node",
    )
    seen_mm: tuple[Length, Length] | None = Field(
        default=None,
        description="x and z of a natural feature in the first picture, mm; `twin pick` writes it",
    )

    @model_validator(mode="after")
    def _placed(self) -> Self:
        if self.node is None and self.position_mm is None:
            raise ValueError(
                f"points.{self.name}: where it is on the finger is not stated; wanted position_mm = [x, y, "
                "z] in mm, or the label of a node, node = 4401"
            )
        if self.seen_mm is not None and self.marker is not None:
            raise ValueError(
                f"points.{self.name} has marker = {self.marker} and seen_mm: wanted one of them; seen_mm is "
                "for a natural feature without a marker"
            )
        return self
