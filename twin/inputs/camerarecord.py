"""Records camera.json and rig.json: the lenses that `twin camera` has calibrated, and their positions."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from twin import files
from twin.judging.fitrecord import Rows, check_covariance
from twin.records import Record
from twin.tablemodel import Finite, NotNegative

if TYPE_CHECKING:  # vision takes a second to import
    from vision import Camera
    from vision.calibration.rig import Rig

Three = tuple[Finite, Finite, Finite]


class CameraRecord(Record):
    """A lens."""

    file: ClassVar[str] = "camera.json"
    matrix: tuple[Three, Three, Three]  # of the camera, px
    distortion: tuple[Finite, Finite, Finite, Finite, Finite]  # k1, k2, p1, p2, k3
    size: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]  # px
    rms_px: NotNegative  # reprojection error
    images: int = Field(ge=0)
    covariance: Rows  # of focal lengths, centre and distortion
    model: tuple[str, ...]  # which of the distortion were fitted
    covered: tuple[tuple[Finite, Finite], ...]  # hull of where the board was seen, px
    remarks: tuple[str, ...]  # what was found of the images, in words
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _focused(self) -> Self:
        if self.matrix[0][0] <= 0 or self.matrix[1][1] <= 0:
            raise ValueError(
                f"matrix: the focal lengths are {self.matrix[0][0]:g} and {self.matrix[1][1]:g} px; wanted "
                "them above 0"
            )
        check_covariance(self.covariance, 9)
        return self


class RigRecord(Record):
    """Several cameras."""

    file: ClassVar[str] = "rig.json"
    cameras: tuple[CameraRecord, ...] = Field(min_length=2)
    turn: tuple[Any, ...]  # of each camera from the first, with the shift in mm
    shift: tuple[Any, ...]
    covariance: tuple[Any, ...]  # of turns and shifts
    remarks: tuple[str, ...]  # in words


def stored_rig(path: Path) -> "Rig":
    """The cameras of a rig.json."""
    from vision.calibration.rig import Rig

    return Rig.from_dict(files.plain(files.read(RigRecord, path)))


def stored_cameras(path: Path) -> "tuple[Camera, ...]":
    """The cameras (c,) of a camera.json or a rig.json."""
    from vision import Camera

    if path.name == RigRecord.file:
        return stored_rig(path).cameras
    return (Camera.from_dict(files.plain(files.read(CameraRecord, path))),)
