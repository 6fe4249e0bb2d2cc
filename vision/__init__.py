"""Film of a marked finger in, displacements in mm with their uncertainty out; `synthetic` draws film."""

from vision.boards import Board
from vision.budget import Budget
from vision.calibration import calibrate_camera
from vision.camera import Camera
from vision.displacements import Displacements, measure
from vision.locate import locate
from vision.marks import Mark
from vision.modes import Stated
from vision.noise import NoiseModel
from vision.rig import Rig
from vision.space import Recording, measure_in_space
from vision.stereo import calibrate_rig
from vision.tracks import Tracks
from vision.video import Video

__all__ = [
    "Board",
    "Budget",
    "Camera",
    "Displacements",
    "Mark",
    "NoiseModel",
    "Recording",
    "Rig",
    "Stated",
    "Tracks",
    "Video",
    "calibrate_camera",
    "calibrate_rig",
    "locate",
    "measure",
    "measure_in_space",
]
