"""The rig of several cameras, from board pictures or films of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vision.boards.board import Board, BoardView
from vision.calibration.bundle import CornerNoise, Shot, board_pose, bundle_adjust, middle
from vision.calibration.intrinsics import read_picture
from vision.calibration.lens import centred
from vision.calibration.rejectedpictures import worst_pose
from vision.calibration.rig import Rig, same
from vision.camera import Array, Camera

MIN_CORNERS = 7
MIN_COMMON = 5  # instants at which two cameras must see the board
LEFT = 0.7  # of the poses, at least, when those with a moved board are left out
MAX_LAG = 2.0  # frames by which a camera may be stamped late or early
LAG_STEP = 0.25  # frames
ENOUGH = 20  # instants that tell a lag
Found = Sequence[BoardView]  # what each picture shows of the board


def calibrate_rig(
    images: Sequence[Sequence[Path]],
    board: Board,
    cameras: Sequence[Camera],
    *,
    max_rms_px: float = 0.3,
    mirrored: Sequence[bool] = (),
) -> Rig:
    """The rig of cameras that photographed a board at rest.

    images: of each camera its picture files; pictures of the same file name show the same pose.
    cameras: each from `calibrate_camera`.   max_rms_px: px, largest error of the corners that is accepted.
    mirrored: of each camera whether it looked into a mirror; none by default.

    Raises ValueError when two cameras share fewer than 5 pictures, or when the error is above the limit
    (the board moved between two pictures of one name).
    """
    names = sorted({Path(p).name for of_camera in images for p in of_camera})
    shared = [n for n in names if sum(n in {Path(p).name for p in paths} for paths in images) > 1]
    if len(shared) < MIN_COMMON:
        raise ValueError(
            f"{len(shared)} board pictures have the same file name in two cameras, wanted {MIN_COMMON} or "
            "more: photograph the board, at rest, with all cameras and give the pictures of one pose one name"
        )
    can_join(board)
    fitted = _fit_poses(_photographed(images, names, board, mirrored, cameras), cameras, board, names)
    rms = np.sqrt(fitted.noise.own + fitted.noise.shared)
    if rms.max() > max_rms_px:
        worst = f"; {fitted.worst} is worst" if fitted.worst else ""
        raise ValueError(
            f"board corners fit the cameras together to {rms.max():.3f} px only, wanted at most {max_rms_px} "
            f"px{worst}: the board must not move between the pictures of one name; remove the pairs where it "
            "did, and photograph it in more poses"
        )
    return replace(fitted.rig, remarks=(_remark(fitted.rig, fitted.shots, rms), *_moved(fitted.moved)))


def _photographed(
    images: Sequence[Sequence[Path]],
    names: Sequence[str],
    board: Board,
    mirrored: Sequence[bool],
    cameras: Sequence[Camera],
) -> list[Shot]:
    """Shots of the board at rest; pictures with one name are of one instant."""
    shots = []
    for c, paths in enumerate(images):
        for path in paths:
            seen = board.find(read_picture(Path(path), board, mirrored=c < len(mirrored) and mirrored[c]))
            if len(seen) < MIN_CORNERS:
                continue
            seen, instant = centred(seen, cameras[c]), names.index(Path(path).name)
            still = {"speed": np.zeros(seen.pixels.shape), "acceleration": np.zeros(seen.pixels.shape)}
            shots.append(Shot(camera=c, instant=instant, points=seen.points, pixels=seen.pixels, **still))
    return shots


@dataclass(frozen=True)
class _Fitted:
    """A rig from the board poses that fit it."""

    rig: Rig
    noise: CornerNoise
    shots: list[Shot]
    moved: list[str]  # the poses that were left out, worst first
    worst: str  # a pose that does not fit and could not be left out


def _fit_poses(shots: list[Shot], cameras: Sequence[Camera], board: Board, names: Sequence[str]) -> _Fitted:
    """The rig, without the poses between whose pictures the board was moved: the worst first, as long as
    five poses and seven of ten are left."""
    moved: list[str] = []
    while True:
        rig, noise = bundle_adjust(shots, cameras, square_mm=board.square_mm)
        out = worst_pose(rig, shots)
        called = f"{names[out.instant]} ({out.rms:.2f} px, usually {out.usual:.2f} px)" if out else ""
        if out is None or len({v.instant for v in shots}) - 1 < max(MIN_COMMON, LEFT * len(names)):
            return _Fitted(rig, noise, shots, moved, called)
        moved.append(called)
        shots = [v for v in shots if v.instant != out.instant]


def can_join(board: Board) -> None:
    """Raises ValueError for a kind of board whose points are not found again in another camera's picture."""
    if not board.joins_cameras:
        able = ", ".join(name for name, kind in Board.kinds().items() if kind.joins_cameras)
        raise ValueError(f"board kind {board.kind!r} does not join cameras: use one of {able}")


def _moved(moved: Sequence[str]) -> list[str]:
    """A sentence about pictures between which the board was moved."""
    if not moved:
        return []
    return [
        f"The board was moved between the cameras' pictures called {', '.join(moved)}: no one pose fits "
        "both, and they were left out."
    ]


def _remark(rig: Rig, shots: Sequence[Shot], rms: Array) -> str:
    base = np.linalg.norm(rig.shift[1:], axis=1)
    return (
        f"{len(rig.cameras)} cameras from {len({v.instant for v in shots})} board poses, reprojection RMS "
        f"{rms.max():.3f} px, up to {base.max():.1f} mm apart."
    )


def synchronous_shots(
    views: Sequence[Found], times: Sequence[Array], cameras: Sequence[Camera]
) -> tuple[list[Shot], Array]:
    """Views of films of a moving board, joined by time stamps, and by how many frames (c,) each camera lags.

    found: of each camera the corners in its frames.   times: (t,) s of its frames on
    one clock.   cameras: each from its own calibration.

    Time stamps are often those of the transfer, late by a part of a frame or more. It shows: the cameras'
    relative pose then changes from instant to instant; the lag is taken for which it changes least. Corners
    are moved along their speed to the common time. What is left is estimated by `bundle` as a time error.
    """
    period = float(np.median(np.concatenate([np.diff(t) for t in times])))
    begin = min(float(t[0]) for t in times)
    moving = [_moving(f, t) for f, t in zip(views, times, strict=True)]
    shots, lags = [_shots(0, moving[0], times[0], begin, period, 0.0)], [0.0]
    tried = sorted(np.arange(-MAX_LAG, MAX_LAG + LAG_STEP, LAG_STEP), key=abs)
    for c in range(1, len(views)):
        before = [v for of_camera in shots for v in of_camera]
        tries = [_shots(c, moving[c], times[c], begin, period, lag) for lag in tried]
        best = int(np.argmin([_disagreement(before, of_camera, cameras) for of_camera in tries]))
        lags.append(tried[best])
        shots.append(tries[best])
    return [v for of_camera in shots for v in of_camera], np.array(lags)


def _moving(views: Found, time: Array) -> list[tuple[Array, Array, Array, Array]]:
    """Points, pixels, speed (px/s) and acceleration (px/s2) of each frame's corners, from the frames beside
    it; a corner that they do not show moves as the others do."""
    moving = []
    for i, (points, pixels) in enumerate((v.points, v.pixels) for v in views):
        rates = np.full((len(points), 2, 2), np.nan)
        beside = [k for k in (i - 1, i + 1) if 0 <= k < len(views)]
        shifts = []
        for k in beside:
            here, there = same(points, views[k].points)
            shift = np.full(pixels.shape, np.nan)
            shift[here] = views[k].pixels[there] - pixels[here]
            shifts.append((time[k] - time[i], shift))
        if len(shifts) == 2:
            (a, before), (b, after) = shifts
            rates[:, 0] = (before * b / a - after * a / b) / (b - a)
            rates[:, 1] = 2.0 * (after / b - before / a) / (b - a)
        for dt, shift in shifts:
            lone = np.isnan(rates[:, 0, 0]) & np.isfinite(shift[:, 0])
            rates[lone, 0], rates[lone, 1] = shift[lone] / dt, 0.0
        finite = np.isfinite(rates[:, 0, 0])
        rates[~finite] = rates[finite].mean(axis=0) if finite.any() else np.nan
        moving.append((points, pixels, rates[:, 0], rates[:, 1]))
    return moving


def _shots(
    camera: int,
    moving: list[tuple[Array, Array, Array, Array]],
    time: Array,
    begin: float,
    period: float,
    lag: float,
) -> list[Shot]:
    shots: dict[int, Shot] = {}
    for (points, pixels, speed, gain), t in zip(moving, time, strict=True):
        place = (t - begin) / period - lag
        instant = round(place)
        if len(points) < MIN_CORNERS or np.isnan(speed).any() or instant in shots:
            continue
        dt = (instant - place) * period
        shots[instant] = Shot(
            camera=camera,
            instant=instant,
            points=points,
            pixels=pixels + speed * dt + 0.5 * gain * dt**2,
            speed=speed,
            acceleration=gain,
        )
    return list(shots.values())


def _disagreement(before: list[Shot], shots: list[Shot], cameras: Sequence[Camera]) -> float:
    """Scatter of the relative poses of a camera and the one that shares most instants with it."""
    instants = {v.instant: v for v in shots}
    partners = [[v for v in before if v.camera == c and v.instant in instants] for c in range(len(cameras))]
    most = max(partners, key=len)
    if len(most) < MIN_COMMON:
        return np.inf
    most = most[:: max(len(most) // ENOUGH, 1)]
    relative = [
        board_pose(instants[v.instant], cameras[instants[v.instant].camera])
        @ np.linalg.inv(board_pose(v, cameras[v.camera]))
        for v in most
    ]
    return middle(np.array(relative))[1]
