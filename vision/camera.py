"""A camera: matrix, lens distortion, and how well each number of them is known."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

DISTORTION = ("k1", "k2", "p1", "p2", "k3")  # in OpenCV's order


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with lens distortion as in OpenCV; pixel (0, 0) is the top-left one's centre.

    >>> import numpy as np
    >>> matrix = np.array([[1000.0, 0, 640], [0, 1000, 360], [0, 0, 1]])
    >>> camera = Camera(matrix, np.array([-0.1, 0, 0, 0, 0]), (1280, 720))
    >>> raw = camera.distort(np.array([[640.0, 360.0], [1140.0, 360.0]]))  # k1 < 0: barrel distortion
    >>> raw.round(1)
    array([[ 640. ,  360. ],
           [1127.5,  360. ]])
    >>> camera.undistort(raw).round(6)
    array([[ 640.,  360.],
           [1140.,  360.]])
    """

    matrix: Array  # (3,3) px
    distortion: Array  # (5,) k1 k2 p1 p2 k3
    size: tuple[int, int]  # px, width and height
    rms_px: float = 0.0  # px, reprojection error of the board corners
    images: int = 0  # number of board pictures used
    covariance: Array = field(default_factory=lambda: np.zeros((9, 9)))  # of `parameters`
    model: tuple[str, ...] = DISTORTION  # what was fitted of the distortion; the rest is 0
    covered: Array = field(default_factory=lambda: np.empty((0, 2)))  # (k,2) px, polygon that boards filled
    remarks: tuple[str, ...] = ()  # what the user should check or change, in sentences
    notes: tuple[str, ...] = ()  # how it was made and what was checked: for a log

    @property
    def parameters(self) -> Array:
        """The numbers (9,) fx fy cx cy (px) k1 k2 p1 p2 k3."""
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        return np.concatenate([[fx, fy, cx, cy], self.distortion])

    @property
    def stdevs(self) -> Array:
        """1 sd (9,) of the `parameters`; 0 for what was not fitted."""
        return np.sqrt(np.diag(self.covariance))

    def moved(self, change: Array) -> "Camera":
        """The camera with its `parameters` changed by (9,).

        >>> import numpy as np
        >>> camera = Camera(np.diag([1000.0, 1000.0, 1.0]), np.zeros(5), (1280, 720))
        >>> camera.moved(np.array([2.0, 0, 0, 0, 0, 0, 0, 0, 0])).parameters[:2]
        array([1002., 1000.])
        """
        fx, fy, cx, cy, *rest = self.parameters + change
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        return replace(self, matrix=matrix, distortion=np.array(rest))

    def distort(self, points: Array) -> Array:
        """Raw pixels (...,2) of ideal pinhole pixels (...,2)."""
        x, y = self._normal(points)
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xy2 = 2.0 * x * y
        return self._pixels(
            x * radial + p1 * xy2 + p2 * (r2 + 2.0 * x * x), y * radial + p2 * xy2 + p1 * (r2 + 2.0 * y * y)
        )

    def undistort(self, points: Array) -> Array:
        """Ideal pinhole pixels (...,2) of raw pixels (...,2); the inverse of `distort`, to 1e-9 px."""
        raw = np.asarray(points, dtype=np.float64)
        ideal = raw
        for _ in range(30):
            error = self.distort(ideal) - raw
            ideal = ideal - error
            if not np.any(np.abs(error) > 1e-9):  # NaN (lost) compares false
                break
        return ideal

    def _normal(self, points: Array) -> tuple[Array, Array]:
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        points = np.asarray(points, dtype=np.float64)
        return (points[..., 0] - cx) / fx, (points[..., 1] - cy) / fy

    def _pixels(self, x: Array, y: Array) -> Array:
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        return np.stack([fx * x + cx, fy * y + cy], axis=-1)

    def to_dict(self) -> dict[str, Any]:
        """The camera as plain lists and numbers, for a JSON file."""
        return {
            "matrix": self.matrix.tolist(),
            "distortion": self.distortion.tolist(),
            "size": list(self.size),
            "rms_px": self.rms_px,
            "images": self.images,
            "covariance": self.covariance.tolist(),
            "model": list(self.model),
            "covered": self.covered.tolist(),
            "remarks": list(self.remarks),
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Camera":
        """The camera that `to_dict` wrote."""
        width, height = data["size"]
        return cls(
            np.array(data["matrix"], dtype=np.float64),
            np.array(data["distortion"], dtype=np.float64),
            (int(width), int(height)),
            float(data["rms_px"]),
            int(data["images"]),
            np.array(data["covariance"], dtype=np.float64),
            tuple(data["model"]),
            np.array(data["covered"], dtype=np.float64).reshape(-1, 2),
            tuple(data["remarks"]),
            tuple(data.get("notes", ())),
        )
