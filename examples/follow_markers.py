"""Three markers of a film are followed: how far did each move, in mm, with its sd? With `vision` alone.

The film is drawn here, so that the true motion is known. With your own films begin at `measured`.
"""

import tempfile
from pathlib import Path

import numpy as np

from vision import Camera, Mark, Video, View, measure
from vision.drawing import synthetic
from vision.kinds import CodedMarker

# What is glued where: six markers on the rig carry the axes, four must not move, three are on the finger.
PLACES = {  # mm: x along the finger, z up; all lie at y = 12 mm
    "frame": [(-30, 30), (45, 34), (120, 30), (-30, -60), (45, -64), (120, -60)],
    "fixed": [(5, 32), (85, 32), (-32, -15), (122, -15)],
    "finger": [(30, 0), (60, 0), (90, 0)],
}
spots = [(role, x, z) for role, row in PLACES.items() for x, z in row]
marks = [Mark(f"{role}{k}", CodedMarker(k, 9.0), (x, 12.0, z), role) for k, (role, x, z) in enumerate(spots)]

# The camera's matrix, distortion and picture in px; `vision.calibrate_camera` finds them from a board.
camera = Camera(np.array([[1300.0, 0, 319.5], [0, 1300.0, 199.5], [0, 0, 1]]), np.zeros(5), (640, 400))
facing = (np.pi / 2**0.5 * np.array([0, 1.0, -1.0]), np.array([45.0, -15.0, 392.0]))  # rotation, mm

folder = Path(tempfile.mkdtemp())
rest = np.array([m.position for m in marks])
for name, drop in (("static", np.zeros(120)), ("film", np.repeat([0.0, 2.5], [20, 10]))):  # mm, each frame
    seen = np.tile(rest, (len(drop), 1, 1))
    seen[:, -3:, 2] -= drop[:, None] * np.array([0.2, 0.5, 1.0])  # the outer ones go down farther
    synthetic.film(folder / f"{name}.mkv", camera=camera, pose=facing, marks=marks, positions=seen,
                   rotations=np.zeros(seen.shape[:2]), codec="rawvideo", seed=len(drop))  # fmt: skip

measured = measure([View(Video(folder / "film.mkv"), Video(folder / "static.mkv"), camera)], marks)
for k in range(4, 7):  # the fixed markers come first
    u, new = measured.value[-1, k, 2], measured.covariance[-1, k, 2, 2] ** 0.5
    every = np.hypot(new, np.linalg.norm(measured.modes[:, -1, k, 2]))  # with scale, places, depth
    print(f"{measured.names[k]}: U3 = {u:.4f} mm; sd {new:.4f} mm frame by frame, {every:.4f} mm in all")
