"""Cameras that look at one scene, with one covariance of all their numbers; where several see a point."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera

OWN = 15  # parameters of a camera: fx fy cx cy k1 k2 p1 p2 k3, rotation vector rad, translation mm
MAX_STEPS = 8


@dataclass(frozen=True)
class Rig:
    """Cameras in the frame of the first camera (x right, y down, z forward, mm).

    The i-th camera sees a point X of that frame at Rodrigues(turn_i) X + shift_i in its own.
    """

    cameras: tuple[Camera, ...]
    turn: Array  # (c,3) rad, rotation vectors
    shift: Array  # (c,3) mm
    covariance: Array  # (15c,15c) of `parameters`, row by row; zero for what was held
    remarks: tuple[str, ...] = ()  # how it was made, one sentence each

    @property
    def parameters(self) -> Array:
        """The numbers (c,15): those of each camera, its rotation vector (rad) and its translation (mm)."""
        return np.array(
            [
                np.concatenate([c.parameters, t, s])
                for c, t, s in zip(self.cameras, self.turn, self.shift, strict=True)
            ]
        )

    def moved(self, change: Array) -> "Rig":
        """The rig with its `parameters` changed by (c,15) or as many in one row."""
        change = np.reshape(change, (-1, OWN))
        cameras = tuple(c.moved(step[:9]) for c, step in zip(self.cameras, change, strict=True))
        return replace(
            self, cameras=cameras, turn=self.turn + change[:, 9:12], shift=self.shift + change[:, 12:]
        )

    @property
    def matrices(self) -> Array:
        """Projections (c,3,4) from the rig's frame (mm) to ideal pixels."""
        turns = [np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64) for turn in self.turn]
        return np.array(
            [
                c.matrix @ np.column_stack([turn, shift])
                for c, turn, shift in zip(self.cameras, turns, self.shift, strict=True)
            ]
        )

    def to_dict(self) -> dict[str, Any]:
        """The rig as plain lists and numbers, for a JSON file."""
        arrays = {key: getattr(self, key).tolist() for key in ("turn", "shift", "covariance")}
        return {"cameras": [c.to_dict() for c in self.cameras], **arrays, "remarks": list(self.remarks)}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Rig":
        """The rig that `to_dict` wrote."""
        turn, shift, covariance = (
            np.array(data[key], dtype=np.float64) for key in ("turn", "shift", "covariance")
        )
        cameras = tuple(Camera.from_dict(c) for c in data["cameras"])
        return cls(cameras, turn, shift, covariance, tuple(data["remarks"]))


def project(parameters: Array, turn: Array, shift: Array, points: Array) -> tuple[Array, Array, Array]:
    """Raw pixels (n,2) of points (n,3) mm, with their derivatives to the camera's parameters (2n,15) and to
    the pose (2n,6).

    The pose is a rotation vector (3,) rad and a shift (3,) mm into the rig's frame.
    """
    after = cv2.composeRT(turn, shift, parameters[9:12], parameters[12:])
    composed = [np.asarray(part, dtype=np.float64) for part in after]
    fx, fy, cx, cy = parameters[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    pixels, slope = cv2.projectPoints(points, composed[0], composed[1], matrix, parameters[4:9])
    slope = np.asarray(slope, dtype=np.float64)
    outer = slope[:, :6] @ np.block([[composed[4], composed[5]], [composed[8], composed[9]]])
    pose = slope[:, :6] @ np.block([[composed[2], composed[3]], [composed[6], composed[7]]])
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2), np.hstack([slope[:, 6:15], outer]), pose


def triangulate(matrices: Array, ideal: Array, covariance: Array) -> tuple[Array, Array]:
    """Points (n,3) mm and their covariance (n,3,3) mm2 from ideal pixels (c,n,2) of c cameras.

    matrices: (c,3,4) or (c,n,3,4) from mm to ideal pixels.   covariance: (c,n,2,2) px2, independent from
    camera to camera. A lost point is NaN; one that fewer than two cameras see gives NaN.

    Least squares of the reprojection error from the linear solution, doi 10.1006/cviu.1997.0547.

    >>> left = np.array([[1000.0, 0, 0, 0], [0, 1000, 0, 0], [0, 0, 1, 0]])
    >>> right = left + 1000 * np.array([[0, 0, 0, -100], [0, 0, 0, 0], [0, 0, 0, 0]])  # 100 mm to the right
    >>> seen = np.array([[[0.0, 0.0]], [[-200.0, 0.0]]])  # px, of one point
    >>> noise = np.tile(0.01 * np.eye(2), (2, 1, 1, 1))  # px2
    >>> point, covariance = triangulate(np.array([left, right]), seen, noise)
    >>> point.round(6) + 0.0
    array([[  0.,   0., 500.]])
    >>> np.sqrt(np.diag(covariance[0])).round(3)  # mm: depth is known least
    array([0.05 , 0.035, 0.354])
    """
    matrices = np.broadcast_to(
        matrices if matrices.ndim == 4 else matrices[:, None], (*ideal.shape[:2], 3, 4)
    )
    seen = np.isfinite(ideal[..., 0]) & np.isfinite(matrices[..., 0, 0])
    enough = seen.sum(axis=0) >= 2
    matrices = np.where(seen[..., None, None], matrices, np.eye(3, 4))
    pixels, weight = np.where(seen[..., None], ideal, 0.0), np.zeros(covariance.shape)
    weight[seen] = np.linalg.inv(covariance[seen])
    place, normal = _linear(matrices, pixels, seen, enough), np.zeros((ideal.shape[1], 3, 3))
    for _ in range(MAX_STEPS):
        error, slope = _reprojected(matrices, pixels, place)
        heavy = np.swapaxes(slope, -1, -2) @ weight
        normal = np.where(enough[:, None, None], (heavy @ slope).sum(axis=0), np.eye(3))
        step = np.linalg.solve(normal, (heavy @ error[..., None]).sum(axis=0))[..., 0]
        place = place + np.where(enough[:, None], step, 0.0)
        if np.abs(step[enough]).max(initial=0.0) < 1e-9:
            break
    spread = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    place[~enough], spread[~enough] = np.nan, np.nan
    return place, spread


def _linear(matrices: Array, pixels: Array, seen: NDArray[np.bool_], enough: NDArray[np.bool_]) -> Array:
    rows = np.where(
        seen[..., None, None], pixels[..., None] * matrices[..., 2:, :] - matrices[..., :2, :], 0.0
    )
    normal = np.einsum("cnki,cnkj->nij", rows[..., :3], rows[..., :3])
    right = -np.einsum("cnki,cnk->ni", rows[..., :3], rows[..., 3])
    normal[~enough], right[~enough] = np.eye(3), (0.0, 0.0, 1.0)
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def _reprojected(matrices: Array, pixels: Array, place: Array) -> tuple[Array, Array]:
    """Reprojection error (c,n,2) and derivatives (c,n,2,3) of the pixels to the place."""
    mapped = np.einsum("cnij,nj->cni", matrices[..., :3], place) + matrices[..., 3]
    seen = mapped[..., :2] / mapped[..., 2:]
    slope = (matrices[..., :2, :3] - seen[..., None] * matrices[..., 2:, :3]) / mapped[..., 2:, None]
    return np.asarray(pixels - seen), np.asarray(slope)


def same(points: Array, others: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of board points (n,3) and of others (m,3) that are one corner."""
    equal = (points[:, None] == others[None]).all(axis=-1)
    rows, columns = np.nonzero(equal)
    return rows, columns
