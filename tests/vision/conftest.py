"""A small drawn laboratory: one camera, 6 frame, 4 fixed and 3 finger marks, 640 x 400 px at 3.4 px/mm."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vision import Camera, Mark, Video
from vision.drawing import synthetic
from vision.kinds import CodedMarker

Array = NDArray[np.float64]
DEPTH = 12.0  # mm, y of the plane of all marks


@dataclass(frozen=True)
class Lab:
    camera: Camera
    pose: tuple[Array, Array]
    marks: tuple[Mark, ...]

    def rows(self, *roles: str) -> list[int]:
        return [i for i, mark in enumerate(self.marks) if mark.role in roles]

    def motion(self, curvature: Sequence[float] | Array) -> tuple[Array, Array]:
        """Centres (t,p,3) mm and rotations (t,p) rad of a finger bent to arcs towards -z, curvature 1/mm."""
        bend = np.where(np.abs(curvature) < 1e-9, 1e-9, np.asarray(curvature, dtype=np.float64))
        place = np.tile([mark.position for mark in self.marks], (len(bend), 1, 1)).astype(np.float64)
        turn = np.zeros(place.shape[:2])
        for p in self.rows("finger"):
            x = self.marks[p].position[0]
            place[:, p, 0], place[:, p, 2] = np.sin(bend * x) / bend, -(1.0 - np.cos(bend * x)) / bend
            turn[:, p] = -bend * x
        return place, turn

    def film(
        self,
        path: Path,
        curvature: Sequence[float] | Array,
        *,
        marks: Sequence[Mark] | None = None,
        codec: str = "rawvideo",
        noise: float = 1.0,
        seed: int = 0,
    ) -> Video:
        lab = self if marks is None else replace(self, marks=tuple(marks))
        place, turn = lab.motion(curvature)
        synthetic.film(
            path,
            camera=self.camera,
            pose=self.pose,
            marks=lab.marks,
            positions=place,
            rotations=turn,
            noise_grey=noise,
            seed=seed,
            codec=codec,
        )
        return Video(path)

    def pixels(self, points: Array) -> Array:
        """Raw pixels (...,2) of world points (...,3) by OpenCV's own projection."""
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        seen, _ = cv2.projectPoints(flat, *self.pose, self.camera.matrix, self.camera.distortion)
        return np.asarray(seen, dtype=np.float64).reshape((*points.shape[:-1], 2))


class Kept(dict[str, Mapping[str, NDArray[Any]]]):
    """A keeper in memory."""

    def load(self, name: str) -> Mapping[str, NDArray[Any]] | None:
        return self.get(name)

    def save(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        assert name not in self  # no part is written twice
        self[name] = {key: array.copy() for key, array in arrays.items()}


@pytest.fixture
def kept() -> Kept:
    return Kept()


@pytest.fixture(scope="session")
def lab() -> Lab:
    matrix = np.array([[1300.0, 0.0, 323.0], [0.0, 1301.0, 197.0], [0.0, 0.0, 1.0]])
    camera = Camera(matrix, np.array([-0.12, 0.03, 0.0008, -0.0005, 0.0]), (640, 400))
    # Looks along -y with z up, tilted by 3 and 2 degrees: x runs to the left of the picture.
    facing = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    turned = cv2.Rodrigues(np.deg2rad([3.0, 2.0, 0.0]))[0] @ facing
    centre = np.array([45.0, DEPTH, -15.0])
    pose = (cv2.Rodrigues(turned)[0].ravel(), np.array([0.0, 0.0, 380.0]) - turned @ centre)
    places = {
        "frame": [(-30, 30), (45, 34), (120, 30), (-30, -60), (45, -64), (120, -60)],
        "fixed": [(5, 32), (85, 32), (-32, -15), (122, -15)],
        "finger": [(30, 0), (60, 0), (90, 0)],
    }
    flat = [(role, x, z) for role, spots in places.items() for x, z in spots]
    marks = tuple(
        Mark(f"{role}{i}", CodedMarker(i, 9.0), (float(x), DEPTH, float(z)), role)
        for i, (role, x, z) in enumerate(flat)
    )
    return Lab(camera, pose, marks)


@pytest.fixture(scope="session")
def still(lab: Lab, tmp_path_factory: pytest.TempPathFactory) -> Video:
    """A static film of 120 frames."""
    return lab.film(tmp_path_factory.mktemp("still") / "still.mkv", np.zeros(120), seed=1)


@pytest.fixture(scope="session")
def coded_still(lab: Lab, tmp_path_factory: pytest.TempPathFactory) -> Video:
    """The same, coded with loss."""
    folder = tmp_path_factory.mktemp("coded")
    return lab.film(folder / "still.mkv", np.zeros(120), codec="libx264", seed=4)


@pytest.fixture
def write_clip(tmp_path: Path) -> Callable[..., Path]:
    """Writes grey noise-free frames with the given time stamps in ms."""
    import av

    def write(stamps_ms: Sequence[int], name: str = "clip.mkv", codec: str = "ffv1") -> Path:
        from fractions import Fraction

        path = tmp_path / name
        with av.open(str(path), "w") as container:
            stream = container.add_stream(codec, rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
            for level, stamp in enumerate(stamps_ms):
                planes = np.full((72, 64), 128, dtype=np.uint8)
                planes[:48] = 20 + 5 * (level % 40)
                frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
                frame.pts, frame.time_base = stamp, Fraction(1, 1000)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
        return path

    return write
