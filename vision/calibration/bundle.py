"""Several cameras and their relative poses with one covariance, from board corners that they see."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.calibration.rig import OWN, Rig, project
from vision.camera import DISTORTION, Array, Camera

REACH = 2.0  # squares over which the errors of corners in one picture fall by a factor e
MAX_ROUNDS, MAX_STEPS = 12, 40
SETTLED = 0.02  # relative change of every variance from round to round
LEAST = 1e-4  # smallest variance of a camera's corners, relative to the largest
START = (0.04, 0.01, 1e-4, 1e-7, 1e-8)  # px2, px2, s2, s4, s2


@dataclass(frozen=True, kw_only=True)
class Shot:
    """One camera's picture of the board at one instant."""

    camera: int
    instant: int  # shots with the same instant show the board in one pose
    points: Array  # (n,3) mm on the board
    pixels: Array  # (n,2) raw px
    speed: Array  # (n,2) px/s of the corners in the picture; 0 for a board at rest
    acceleration: Array  # (n,2) px/s2

    def only(self, rows: NDArray[np.intp]) -> "Shot":
        """The shot with some of its corners."""
        parts = {k: getattr(self, k)[rows] for k in ("points", "pixels", "speed", "acceleration")}
        return replace(self, **parts)


@dataclass(frozen=True)
class CornerNoise:
    """Variances of corners in a picture, all estimated from calibration residuals.

    A time error moves all corners of a picture along their speed: cameras that run freely or are stamped
    late show the board at slightly different times. Its square acts along the acceleration.
    """

    own: Array  # (c,) px2 of each camera, every corner for itself
    shared: Array  # (c,) px2, correlation exp(-distance / (2 squares)): lens, board, light
    time: Array  # (c,) s2, time error of a picture
    late: Array  # (c,) s4, of its square
    blur: float  # s2, time error of every corner for itself: motion blur, rolling shutter

    def covariance(self, shot: Shot, square_mm: float) -> Array:
        """Covariance (2n,2n) px2 of a shot's corners, x and y of each in turn."""
        c = shot.camera
        power = (self.own[c], self.shared[c], self.time[c], self.late[c], self.blur)
        return np.asarray(np.tensordot(power, _bases(shot, square_mm), 1))


def _bases(shot: Shot, square_mm: float) -> Array:
    """Covariances (5,2n,2n) that unit variances give."""
    n, speed, acceleration = len(shot.points), shot.speed.ravel(), shot.acceleration.ravel()
    apart = np.linalg.norm(shot.points[:, None] - shot.points[None], axis=-1)
    shared = np.kron(np.exp(-apart / (REACH * square_mm)), np.eye(2))
    along = np.outer(speed, speed)
    alone = along * np.kron(np.eye(n), np.ones((2, 2)))
    return np.array([np.eye(2 * n), shared, along, np.outer(acceleration, acceleration), alone])


def bundle_adjust(
    shots: Sequence[Shot], cameras: Sequence[Camera], *, square_mm: float
) -> tuple[Rig, CornerNoise]:
    """The rig whose cameras and board poses fit all corners best, weighted by their noise; and that noise.

    shots: corners of the board, at least 4 each; every camera shares instants with some other.
    cameras: first guesses; of their distortion only what their `model` names is fitted.   square_mm: mm.

    Bundle adjustment by Gauss-Newton with the board poses eliminated, doi 10.1007/3-540-44480-7_21; the
    noise by restricted maximum likelihood from the same residuals, doi 10.1093/biomet/58.3.545. Raises
    ValueError when a camera shares no instant with the others.
    """
    theta, poses = _start(shots, cameras)
    columns = np.flatnonzero(_free(cameras))
    single, shared, time, late = np.outer(START[:4], np.ones(len(cameras)))
    noise = CornerNoise(single, shared, time, late, START[4])
    inverse = np.empty(0)
    for _ in range(MAX_ROUNDS):
        theta, poses, inverse = _fit(shots, theta, poses, noise, columns, square_mm)
        before, noise = noise, _noise(shots, theta, poses, noise, square_mm)
        if _same(before, noise):
            break
    covariance = np.zeros((theta.size, theta.size))
    covariance[np.ix_(columns, columns)] = inverse
    single = [covariance[k : k + 9, k : k + 9] for k in range(0, theta.size, OWN)]
    fitted = tuple(
        replace(c.moved(row[:9] - c.parameters), covariance=part)
        for c, row, part in zip(cameras, theta, single, strict=True)
    )
    return Rig(fitted, theta[:, 9:12], theta[:, 12:], covariance), noise


def _free(cameras: Sequence[Camera]) -> NDArray[np.bool_]:
    """Parameters (c,15) that are fitted: what the cameras' models have, and the others' poses."""
    free = np.ones((len(cameras), OWN), dtype=bool)
    for row, camera in zip(free, cameras, strict=True):
        row[4:9] = [name in camera.model for name in DISTORTION]
    free[0, 9:] = False
    return free


Poses = dict[int, Array]  # rotation vector (rad) and place (mm) of the board at each instant


@dataclass(frozen=True, kw_only=True)
class _Instant:
    """All corners of one instant."""

    key: int
    shots: list[Shot]
    residual: Array  # (m,) px
    shared: Array  # (m,15c) derivatives to the rig's parameters
    pose: Array  # (m,6) to the board's pose
    weight: Array  # (m,m)

    @property
    def projected(self) -> Array:
        """Weight (m,m) with the pose projected out."""
        heavy = self.weight @ self.pose
        return np.asarray(self.weight - heavy @ np.linalg.solve(self.pose.T @ heavy, heavy.T))


def _instants(
    shots: Sequence[Shot], theta: Array, poses: Poses, noise: CornerNoise, square_mm: float
) -> Iterator[_Instant]:
    for key, pose in poses.items():
        here = [v for v in shots if v.instant == key]
        m = 2 * sum(len(v.points) for v in here)
        shared, slope = np.zeros((m, theta.size)), np.zeros((m, 6))
        weight, residual = np.zeros((m, m)), np.zeros(m)
        for v, rows in _rows(here):
            pixels, to_camera, slope[rows] = project(theta[v.camera], pose[:3], pose[3:], v.points)
            residual[rows] = (v.pixels - pixels).ravel()
            shared[rows, OWN * v.camera : OWN * (v.camera + 1)] = to_camera
            weight[rows, rows] = np.linalg.inv(noise.covariance(v, square_mm))
        yield _Instant(key=key, shots=here, residual=residual, shared=shared, pose=slope, weight=weight)


def _rows(shots: Sequence[Shot]) -> Iterator[tuple[Shot, slice]]:
    row = 0
    for v in shots:
        yield v, slice(row, row + 2 * len(v.points))
        row += 2 * len(v.points)


def _fit(
    shots: Sequence[Shot], theta: Array, poses: Poses, noise: CornerNoise, columns: NDArray[np.intp],
    square_mm: float,
) -> tuple[Array, Poses, Array]:  # fmt: skip
    """Parameters, poses and the covariance of the free parameters, at the least squares."""
    inverse = np.empty(0)
    for _ in range(MAX_STEPS):
        normal, right, each = np.zeros((len(columns),) * 2), np.zeros(len(columns)), {}
        for instant in _instants(shots, theta, poses, noise, square_mm):
            shared, weight = instant.shared[:, columns], instant.projected
            heavy = instant.weight @ instant.pose
            normal += shared.T @ weight @ shared
            right += shared.T @ weight @ instant.residual
            each[instant.key] = np.linalg.solve(heavy.T @ instant.pose, heavy.T), instant.residual, shared
        scale = 1.0 / np.sqrt(np.diag(normal))
        inverse = np.linalg.inv(normal * np.outer(scale, scale)) * np.outer(scale, scale)
        step = inverse @ right
        theta = theta.copy()
        theta.reshape(-1)[columns] += step
        poses = {k: poses[k] + gain @ (r - shared @ step) for k, (gain, r, shared) in each.items()}
        if step @ right < 1e-6:  # the step in sds, squared
            break
    return theta, poses, inverse


def _noise(
    shots: Sequence[Shot], theta: Array, poses: Poses, noise: CornerNoise, square_mm: float
) -> CornerNoise:
    """One Fisher step of the restricted likelihood: the variances that the residuals speak for."""
    c = len(theta)
    count = 4 * c + 1
    normal, right = np.zeros((count, count)), np.zeros(count)
    for instant in _instants(shots, theta, poses, noise, square_mm):
        bases = np.zeros((count, *instant.weight.shape))
        for v, rows in _rows(instant.shots):
            which = [v.camera, c + v.camera, 2 * c + v.camera, 3 * c + v.camera, 4 * c]
            bases[which, rows, rows] = _bases(v, square_mm)
        heavy, turned = instant.weight @ instant.residual, bases @ instant.projected
        right += np.einsum("i,kij,j->k", heavy, bases, heavy)
        normal += np.einsum("kij,lji->kl", turned, turned)
    value, estimable = np.zeros(count), np.flatnonzero(np.diag(normal) > 0)
    scale = 1.0 / np.sqrt(np.diag(normal)[estimable])
    value[estimable] = scale * np.linalg.solve(
        normal[np.ix_(estimable, estimable)] * np.outer(scale, scale), scale * right[estimable]
    )
    value = np.maximum(value, 0.0)
    value[:c] = np.maximum(value[:c], LEAST * value[: 2 * c].max())
    single, shared, time, late = value[: 4 * c].reshape(4, c)
    return CornerNoise(single, shared, time, late, float(value[-1]))


def _same(a: CornerNoise, b: CornerNoise) -> bool:
    before, after = (np.concatenate([n.own, n.shared, n.time, n.late, [n.blur]]) for n in (a, b))
    return bool(np.all(np.abs(after - before) <= SETTLED * after + 1e-9))


def board_pose(shot: Shot, camera: Camera) -> Array:
    """Board to camera (4,4) of one shot: the better of a plane's two, doi 10.1007/s11263-014-0725-5."""
    ideal = camera.undistort(shot.pixels)
    _, rvec, tvec = cv2.solvePnP(shot.points, ideal, camera.matrix, None, flags=cv2.SOLVEPNP_IPPE)
    _, rvec, tvec = cv2.solvePnP(shot.points, ideal, camera.matrix, None, rvec, tvec, True)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(rvec)[0], np.ravel(tvec)
    return pose


def middle(poses: Array) -> tuple[Array, float]:
    """The pose (4,4) of (n,4,4) nearest to the others (a flipped board is not it), and how near they are."""
    scale = np.abs(poses[:, :3, 3]).mean()
    part = np.concatenate([poses[:, :3, :3], poses[:, :3, 3:] / scale], axis=2).reshape(len(poses), -1)
    apart = np.median(np.linalg.norm(part[:, None] - part[None], axis=2), axis=1)
    best = int(np.argmin(apart))
    return np.asarray(poses[best]), float(apart[best])


def _start(shots: Sequence[Shot], cameras: Sequence[Camera]) -> tuple[Array, Poses]:
    """First parameters (c,15) and board poses, the cameras chained by common instants."""
    seen = {(v.camera, v.instant): board_pose(v, cameras[v.camera]) for v in shots}
    world = {0: np.eye(4)}
    while len(world) < len(cameras):
        links = {
            (placed, new): [i for (c, i) in seen if c == new and (placed, i) in seen]
            for placed in world
            for new in range(len(cameras))
            if new not in world
        }
        placed, new = max(links, key=lambda pair: len(links[pair]))
        if not links[placed, new]:
            raise ValueError(
                f"camera {new + 1} sees no board together with another camera: take board pictures that two "
                "cameras take at the same time"
            )
        both = [seen[new, i] @ np.linalg.inv(seen[placed, i]) for i in links[placed, new]]
        world[new] = middle(np.array(both))[0] @ world[placed]
    theta = [np.concatenate([camera.parameters, _vector(world[c])]) for c, camera in enumerate(cameras)]
    poses = {i: np.linalg.inv(world[c]) @ pose for (c, i), pose in sorted(seen.items(), reverse=True)}
    return np.array(theta), {i: _vector(pose) for i, pose in sorted(poses.items())}


def _vector(pose: Array) -> Array:
    """Rotation vector and translation (6,) of a pose (4,4)."""
    turn = np.asarray(cv2.Rodrigues(pose[:3, :3])[0], dtype=np.float64).ravel()
    return np.concatenate([turn, pose[:3, 3]])
