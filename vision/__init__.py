"""Displacements of a marked finger in mm, with their uncertainty, from film.

`measure(views, marks, ...)` is the door. Read what everything here speaks of first: `camera` (pixels and
lens), `marks` (what is glued where, by `kinds`), `dictionaries` (codes of markers), `plane` (the
finger's plane in a picture), `perspective` (what lies off that plane), `artwork` (sheets to print) and
`opencvfile` (files in OpenCV's manner). Then the rooms in the order in which a film passes them: `film`,
`boards` and `calibration`, `following`, `doubts`, `placing`, `errors`, `measuring`. `drawing` goes the other
way: it draws film of a known motion.
"""

from vision.boards.board import Board
from vision.calibration.intrinsics import calibrate_camera
from vision.camera import Camera
from vision.errors.sharederrors import Stated
from vision.errors.staticnoise import NoiseModel
from vision.film.video import Video
from vision.following.markercentres import locate
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
