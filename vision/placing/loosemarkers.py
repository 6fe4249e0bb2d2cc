"""Places of markers that are glued on anywhere, from pictures that show them together with a board."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.boards.board import MIN_CORNERS, Board, BoardView
from vision.calibration.bundle import Shot, board_pose
from vision.calibration.intrinsics import camera_from
from vision.calibration.rig import project
from vision.camera import DISTORTION, Array, Camera, Image
from vision.following.markercentres import Located, locate
from vision.plane import fit_homography, to_plane

LEAST_SEEN = 3  # pictures that show a marker, and pictures of all
MAX_STEPS, MAX_ROUNDS = 30, 6
SETTLED = 0.02  # relative change of both variances from round to round
ODD = 6.0  # sds beyond which a marker's centre in one picture is another thing
CORNER, CENTRE = 0.01, 1.0  # first variances: px2 of a corner, times the stated one of a centre


@dataclass(frozen=True)
class LooseMarkers:
    """Markers in the axes of the board: x right, y down, z away from who looks at it, mm."""

    codes: tuple[int, ...]
    place: Array  # (n,3) mm
    covariance: Array  # (3n,3n) mm2
    sight: Array  # (n,) number of pictures that show each
    pictures: int  # that were used
    corner_px: float  # sd of a corner of the board
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class RigPicture:
    """One picture: corners of the board, and centres of markers with their covariance."""

    board: BoardView
    codes: NDArray[np.intp]  # (m,)
    centre: Array  # (m,2) raw px
    covariance: Array  # (m,2,2) px2

    def without(self, codes: set[int]) -> "RigPicture":
        """The picture without some of its markers."""
        keep = ~np.isin(self.codes, list(codes))
        return replace(
            self, codes=self.codes[keep], centre=self.centre[keep], covariance=self.covariance[keep]
        )


def loose_markers(
    pictures: Sequence[Image], names: Sequence[str], board: Board, *, dictionary: str
) -> LooseMarkers:
    """Places of all markers beside a board that stands still among them, from pictures from all sides.

    names: what each picture is called.   dictionary: of the markers.

    Bundle adjustment of lens, poses and places: the board's corners give scale and axes. Raises ValueError
    as `camera_from`, and where fewer than 3 pictures show the board and markers beside it.
    """
    black = [board.black_on_white(picture) for picture in pictures]
    camera = camera_from(black, names, board)
    sights = []
    for picture, grey in zip(pictures, black, strict=True):
        view = board.find(grey)
        if len(view) >= MIN_CORNERS:
            sights.append(_beside(view, locate(picture, dictionary=dictionary, camera=camera), board))
    return adjusted(sights, camera)


def _beside(view: BoardView, seen: Located, board: Board) -> RigPicture:
    """A picture with the markers that do not lie on the board itself."""
    to_px = fit_homography(view.points[:, :2], view.pixels)
    place = to_plane(to_px[None], seen.centre[None])[0] / board.square_mm
    apart = (place < -0.2) | (place > np.array([board.columns, board.rows]) + 0.2)
    keep = apart.any(axis=1) & (seen.correlation > 0)
    return RigPicture(view, seen.ids[keep], seen.centre[keep], seen.covariance[keep])


def adjusted(sights: Sequence[RigPicture], camera: Camera) -> LooseMarkers:
    """Places from what pictures show, by bundle adjustment from a first guess of the camera.

    Gauss-Newton on the reprojection error; the variances of corners and of centres from the residuals, each
    over the degrees of freedom that the fit leaves it. Raises ValueError where too few pictures show both.
    """
    every = [int(c) for s in sights for c in s.codes]
    seldom = {c for c in every if every.count(c) < LEAST_SEEN}
    kept = [s.without(seldom) for s in sights]
    kept = [s for s in kept if len(s.codes)]
    codes = sorted(set(every) - seldom)
    if len(kept) < LEAST_SEEN or not codes:
        raise ValueError(
            f"{len(sights)} pictures show the board, and {len(codes)} markers beside it are in {LEAST_SEEN} "
            "or more of them: wanted 8 to 20 pictures from all sides, the board lying still among the markers"
        )
    problem = _Problem.of(kept, codes, camera)
    dropped = 0
    for _ in range(2):
        theta, inverse, power = problem.solved()
        odd = problem.odd(theta, power)
        if not odd.any():
            break
        dropped += int(odd.sum())
        problem = replace(problem, left_out=problem.left_out | odd, start=theta)
    place, rows = theta[problem.first_place :].reshape(-1, 3), slice(problem.first_place, None)
    covariance = inverse[rows, rows] * problem.shared(theta, inverse, power)
    remarks = []
    if seldom:
        remarks.append(f"Markers {', '.join(map(str, sorted(seldom)))} are seen in fewer than {LEAST_SEEN} "
                       "pictures and left out.")  # fmt: skip
    if dropped:
        remarks.append(f"{dropped} sights of markers lie more than {ODD:g} sd off and are left out.")
    sight = np.array([sum(c in s.codes for s in kept) for c in codes])
    return LooseMarkers(
        tuple(codes), place, covariance, sight, len(kept), float(np.sqrt(power[0])), tuple(remarks)
    )


@dataclass(frozen=True)
class _Problem:
    """Unknowns theta: the lens (9), the pose of the board in each picture (6), each marker (3)."""

    sights: Sequence[RigPicture]
    codes: Sequence[int]
    free: NDArray[np.bool_]  # of theta
    start: Array
    left_out: NDArray[np.bool_]  # centres, in the order of pictures

    @classmethod
    def of(cls, sights: Sequence[RigPicture], codes: Sequence[int], camera: Camera) -> "_Problem":
        """With first guesses: poses from the board, places where the rays of two pictures come nearest."""
        poses = []
        for s in sights:
            none = np.zeros((len(s.board), 2))
            shot = Shot(camera=0, instant=0, points=s.board.points, pixels=s.board.pixels, speed=none,
                        acceleration=none)  # fmt: skip
            poses.append(board_pose(shot, camera))
        places = [_crossing(sights, poses, camera, code) for code in codes]
        turns = [np.r_[np.ravel(cv2.Rodrigues(p[:3, :3])[0]), p[:3, 3]] for p in poses]
        start = np.concatenate([camera.parameters, *turns, *places])
        free = np.ones(len(start), dtype=bool)
        free[4:9] = [name in camera.model for name in DISTORTION]
        return cls(sights, codes, free, start, np.zeros(sum(len(s.codes) for s in sights), dtype=bool))

    @property
    def first_place(self) -> int:
        """Row of theta at which the places begin."""
        return 9 + 6 * len(self.sights)

    def solved(self) -> tuple[Array, Array, Array]:
        """Theta, its covariance, and the two variances (2,), of corners in px2 and of centres as a factor."""
        theta, power = self.start, np.array([CORNER, CENTRE])
        for _ in range(MAX_ROUNDS):
            for _ in range(MAX_STEPS):
                residual, slope, weight, is_centre = self._system(theta, power)
                white = np.einsum("nij,njk->nik", weight, slope).reshape(-1, slope.shape[-1])[:, self.free]
                off = np.einsum("nij,nj->ni", weight, residual).ravel()
                scale = 1.0 / np.linalg.norm(white, axis=0)
                inverse = np.linalg.pinv((white * scale).T @ (white * scale), hermitian=True)
                step = scale * (inverse @ ((white * scale).T @ off))
                theta = theta.copy()
                theta[self.free] += step
                if step @ (white.T @ off) < 1e-6:  # the step in sds, squared
                    break
            inverse = inverse * np.outer(scale, scale)
            leverage = np.einsum("ij,jk,ik->i", white, inverse, white).reshape(-1, 2)
            left = off.reshape(-1, 2)
            before, ratio = power, np.array([
                (left[rows] ** 2).sum() / (1.0 - leverage[rows]).sum() for rows in (~is_centre, is_centre)
            ])  # fmt: skip
            power = before * ratio
            if np.all(np.abs(ratio - 1.0) < SETTLED):
                break
        full = np.zeros((len(theta), len(theta)))
        full[np.ix_(self.free, self.free)] = inverse
        return theta, full, power

    def shared(self, theta: Array, inverse: Array, power: Array) -> float:
        """Factor, 1 at least, of the places' variance: errors that a whole picture shares, such as its blur,
        show where pictures are left out in turn.

        The jackknife's trace over that of the covariance, doi 10.1214/aos/1176345462; what a picture moves is
        its score over the degrees of freedom that it keeps.
        """
        residual, slope, weight, _ = self._system(theta, power)
        white, off = np.einsum("nij,njk->nik", weight, slope), np.einsum("nij,nj->ni", weight, residual)
        counts, done = self._counts(), 0
        total = 0.0
        for count in counts:
            here = white[done : done + count].reshape(2 * count, -1)
            left = off[done : done + count].ravel()
            done += count
            keeps = np.eye(len(left)) - here @ inverse @ here.T
            moved = inverse @ (here.T @ (np.linalg.pinv(keeps, rcond=1e-6, hermitian=True) @ left))
            total += float((moved[self.first_place :] ** 2).sum())
        alone = float(np.trace(inverse[self.first_place :, self.first_place :]))
        return max(total * (len(counts) - 1) / len(counts) / alone, 1.0)

    def _counts(self) -> list[int]:
        """Number of corners and centres that each picture has."""
        done, counts = 0, []
        for s in self.sights:
            counts.append(len(s.board) + int((~self.left_out[done : done + len(s.codes)]).sum()))
            done += len(s.codes)
        return counts

    def odd(self, theta: Array, power: Array) -> NDArray[np.bool_]:
        """Mask of the centres that lie far off where the fit has them."""
        residual, _, weight, is_centre = self._system(theta, power)
        away = np.linalg.norm(np.einsum("nij,nj->ni", weight, residual), axis=1)[is_centre]
        result = np.zeros(len(self.left_out), dtype=bool)
        result[np.flatnonzero(~self.left_out)] = away > ODD
        return result

    def _system(self, theta: Array, power: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Residuals (n,2) px, their slopes (n,2,k), whitening (n,2,2), and which are of centres (n,)."""
        parts, done = [], 0
        lens = np.concatenate([theta[:9], np.zeros(6)])
        for k, s in enumerate(self.sights):
            keep = ~self.left_out[done : done + len(s.codes)]
            done += len(s.codes)
            rows = [self.codes.index(int(c)) for c in s.codes[keep]]
            at = slice(9 + 6 * k, 15 + 6 * k)
            place = theta[self.first_place :].reshape(-1, 3)[rows]
            points = np.concatenate([s.board.points, place])
            pixels, to_lens, to_pose = project(lens, theta[at][:3], theta[at][3:], points)
            slope = np.zeros((len(points), 2, len(theta)))
            slope[:, :, :9] = to_lens[:, :9].reshape(-1, 2, 9)
            slope[:, :, at] = to_pose.reshape(-1, 2, 6)
            turn = np.asarray(cv2.Rodrigues(theta[at][:3])[0], dtype=np.float64)
            corners = len(s.board)
            for n, row in enumerate(rows):
                column = self.first_place + 3 * row
                slope[corners + n, :, column : column + 3] = slope[corners + n, :, at][:, 3:] @ turn
            seen = np.concatenate([s.board.pixels, s.centre[keep]])
            covariance = np.concatenate([
                np.tile(power[0] * np.eye(2), (corners, 1, 1)), power[1] * s.covariance[keep]
            ])  # fmt: skip
            weight = np.linalg.inv(np.linalg.cholesky(covariance))
            parts.append((seen - pixels, slope, weight, np.arange(len(points)) >= corners))
        residual, slope, weight, is_centre = (np.concatenate(a) for a in zip(*parts, strict=True))
        return residual, slope, weight, is_centre


def _crossing(sights: Sequence[RigPicture], poses: Sequence[Array], camera: Camera, code: int) -> Array:
    """The place (3,) mm nearest to the rays on which pictures show a marker."""
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for s, pose in zip(sights, poses, strict=True):
        if code not in s.codes:
            continue
        ideal = camera.undistort(s.centre[s.codes == code])[0]
        ray = pose[:3, :3].T @ np.linalg.solve(camera.matrix, np.append(ideal, 1.0))
        eye = -pose[:3, :3].T @ pose[:3, 3]
        across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
        normal += across
        right += across @ eye
    return np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
