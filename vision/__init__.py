"""Film of a marked finger in, displacements in mm with their uncertainty out; `synthetic` draws film."""

from vision.boards import Board
from vision.calibration import calibrate_camera
from vision.camera import Camera
from vision.displacements import Displacements, measure
from vision.locate import locate
from vision.marks import Mark
from vision.modes import Stated
from vision.noise import NoiseModel
from vision.tracks import Tracks
from vision.video import Video
from vision.views import View

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
