"""Film of a marked finger in, displacements in mm with their uncertainty out; `synthetic` draws film."""

from vision.boards.board import Board
from vision.calibration.intrinsics import calibrate_camera
from vision.camera import Camera
from vision.errors.modes import Stated
from vision.errors.noise import NoiseModel
from vision.film.video import Video
from vision.following.locating import locate
from vision.following.tracks import Tracks
from vision.marks import Mark
from vision.measuring.displacements import Displacements, measure
from vision.placing.views import View

__all__ = [
    "Board",
    "Camera",
    "Displacements",
    "Mark",
    "NoiseModel",
    "Stated",
    "Tracks",
    "Video",
    "View",
    "calibrate_camera",
    "locate",
    "measure",
]
