"""Film of a known motion, as a camera would have recorded it, drawn with exact anti-aliasing.

Every mark is a texture, eight texels to a pixel or finer, already blurred; each pixel is the mean of four
Gauss-Legendre samples of it. The plane of the mark, perspective and lens distortion are in the mapping.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from vision.boards.board import Board
from vision.camera import Array, Camera, Image
from vision.film.video import Writer
from vision.marks import Mark, check_names

# Grey levels inside the 16..235 range of video luma, so that no player clips them.
INK, PAPER, BODY, BACKGROUND = 35.0, 210.0, 70.0, 120.0
TEXELS = 8  # texture points per pixel
_GAUSS = np.array([(x, y) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]) / np.sqrt(12.0)


class Pose(NamedTuple):
    """World to camera: rotation vector (3,) rad and translation (3,) mm, as in OpenCV."""

    rvec: Array
    tvec: Array


@dataclass(frozen=True)
class _Texture:
    ink: Array  # (k,k) reflectance (0 ink, 1 paper) times cover
    cover: Array  # (k,k) 1 inside the paper, 0 outside, blurred
    per_mm: float  # texels per mm


# Fifteen arguments, nine with a default: one call tells a whole film, and reads like its description.
def film(
    path: Path | str,
    *,
    camera: Camera,
    pose: tuple[Array, Array],
    marks: tuple[Mark, ...] | list[Mark],
    positions: Array,
    rotations: Array,
    fps: float = 10.0,
    blur_px: float = 0.8,
    noise_grey: float = 1.0,
    seed: int = 0,
    dictionary: str = "DICT_4X4_50",
    outline: Array | None = None,
    face: tuple[float, Callable[[int, Array], Array]] | None = None,
    codec: str = "libx264",
    crf: int = 18,
) -> None:
    """Write the film of marks that move as told.

    path: file to write; an existing one is replaced when the film is complete.
    camera: the camera that looks.   pose: (rvec (3,) rad, tvec (3,) mm) from world to camera.
    marks: what is glued where; `size_mm` is the black square or the dot's diameter.
    positions: (t,p,3) mm centres.   rotations: (t,p) rad in the x-z plane, from x towards z.
    fps: 1/s.   blur_px: sd of the lens blur.   noise_grey: sd of the sensor noise, grey levels.
    outline: (t,k,3) mm polygon of the body behind the marks, or None.
    face: y in mm of a speckled plane behind the marks, and its grey levels (n,) in frame t at points (n,2) mm
    (x, z): f(t, points), NaN where it is not. As sharp as f is: it is not blurred.
    codec: "libx264" (crf, preset medium, tune grain, no B-frames) or a lossless one such as "ffv1".

    Marks face +y, upright when seen from +y with z up; at rotation 0 their right-hand side points to -x.
    Raises ValueError when shapes do not fit.
    """
    check_names(marks)
    if positions.shape != (len(positions), len(marks), 3) or rotations.shape != positions.shape[:2]:
        raise ValueError(
            f"positions {positions.shape} and rotations {rotations.shape} do not fit {len(marks)} marks: "
            "give (frames, marks, 3) mm and (frames, marks) rad"
        )
    scene = _Scene(camera, Pose(*pose), marks, blur_px, dictionary)
    moving = np.ptp(positions, axis=0).any(axis=1) | (np.ptp(rotations, axis=0) != 0)
    rng = np.random.default_rng(seed)
    still = _background(camera.size, rng)
    # Marks at rest are drawn once; only those of the finger lie in front of its body.
    front = moving | np.array([mark.role == "finger" for mark in marks])
    scene.draw(still, positions[0], rotations[0], np.flatnonzero(~front))
    shown = [a.reshape(len(a), -1) for a in (positions, rotations, outline) if a is not None]
    same = np.all([(a[1:] == a[:-1]).all(axis=1) for a in shown], axis=0) & (face is None)
    with Writer(Path(path), camera.size, fps=fps, codec=codec, crf=crf) as writer:
        for t in range(len(positions)):
            if t == 0 or not same[t - 1]:
                picture = still.copy()
                if outline is not None:
                    scene.body(picture, outline[t])
                if face is not None:
                    scene.face(picture, face[0], partial(face[1], t))
                scene.draw(picture, positions[t], rotations[t], np.flatnonzero(front))
            writer.add(_expose(picture, noise_grey, rng))


def board_image(
    camera: Camera,
    board: Board,
    pose: tuple[Array, Array],
    *,
    blur_px: float = 0.8,
    noise_grey: float = 1.0,
    seed: int = 0,
    marks: tuple[Mark, ...] | list[Mark] = (),
    marks_pose: tuple[Array, Array] | None = None,
) -> Image:
    """Picture (h,w) of a board of any kind, and of marks beside it.

    camera, board: who looks, at what.   pose: (rvec, tvec) from board (mm, x right, y down) to camera.
    blur_px: sd of the lens blur.   noise_grey: sd of the noise.
    marks_pose: from the world in which the marks have their places to camera.
    """
    homography = _plane_homography(Pose(*pose), np.zeros(3), np.eye(3)[0], np.eye(3)[1])
    middle = homography @ (board.columns * board.square_mm / 2.0, board.rows * board.square_mm / 2.0, 1.0)
    px_per_mm = camera.matrix[0, 0] * np.linalg.norm(homography[:, 0]) / middle[2]
    paper, origin, per_mm = board.print_of(max(3.0 * px_per_mm * board.square_mm, 24.0))
    paper = 1.0 - paper if board.inverted else paper
    blurred = scipy.ndimage.gaussian_filter(paper, blur_px * per_mm / px_per_mm)
    picture = _background(camera.size, np.random.default_rng(seed))
    rays = _rays_of(camera)
    local = _local(np.linalg.inv(homography), rays.at(slice(None), slice(None)))
    texel = local * per_mm + origin - 0.5
    inside = ((texel > 0) & (texel < np.array(paper.shape[::-1]) - 1)).all(axis=-1)
    seen = np.where(inside, _lookup(blurred, texel), -1.0).reshape((*picture.shape, 4))
    drawn = np.where(seen >= 0, INK + (PAPER - INK) * seen, picture[..., None]).mean(axis=-1)
    if marks and marks_pose is not None:
        scene = _Scene(camera, Pose(*marks_pose), marks, blur_px, "DICT_4X4_50")
        places = np.array([mark.position for mark in marks])
        scene.draw(drawn, places, np.zeros(len(marks)), np.arange(len(marks)))
    return _expose(drawn, noise_grey, np.random.default_rng([seed, 1]))


class _Rays:
    """Ideal normalised camera coordinates of every pixel, and how they change across it."""

    def __init__(self, camera: Camera) -> None:
        width, height = camera.size
        x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        ideal = camera.undistort(np.stack([x, y], axis=-1))
        self.centre = (ideal - camera.matrix[:2, 2]) / (camera.matrix[0, 0], camera.matrix[1, 1])
        down, right = np.gradient(self.centre, axis=(0, 1))
        self.right, self.down = np.asarray(right), np.asarray(down)

    def at(self, rows: slice, columns: slice) -> Array:
        """Rays (n,4,2) of a block of pixels, at the four Gauss points of each."""
        centre, right, down = (
            a[rows, columns].reshape(-1, 1, 2) for a in (self.centre, self.right, self.down)
        )
        return np.asarray(centre + right * _GAUSS[:, :1] + down * _GAUSS[:, 1:], dtype=np.float64)


def _rays_of(camera: Camera) -> _Rays:
    """The camera's rays, kept for its next picture."""
    return _kept_rays(camera.parameters.tobytes(), camera.size)


@lru_cache(maxsize=2)
def _kept_rays(parameters: bytes, size: tuple[int, int]) -> _Rays:
    return _Rays(Camera(np.zeros((3, 3)), np.zeros(5), size).moved(np.frombuffer(parameters)))


class _Scene:
    """Draws marks and the body into grey pictures (h,w)."""

    def __init__(
        self,
        camera: Camera,
        pose: Pose,
        marks: tuple[Mark, ...] | list[Mark],
        blur_px: float,
        dictionary: str,
    ) -> None:
        self.camera, self.pose, self.marks, self.blur_px = camera, pose, marks, blur_px
        self.rays = _rays_of(camera)
        self.planes: dict[float, Array] = {}  # by y mm, where the rays meet that plane
        depth = self._to_camera(np.array([mark.position for mark in marks]))[:, 2]
        px_per_mm = camera.matrix[0, 0] / depth
        self.textures = [
            _texture(mark, float(scale), blur_px, dictionary)
            for mark, scale in zip(marks, px_per_mm, strict=True)
        ]

    def _to_camera(self, points: Array) -> Array:
        rotation, _ = cv2.Rodrigues(np.asarray(self.pose.rvec, dtype=np.float64))
        return np.asarray(points @ np.asarray(rotation).T + np.reshape(self.pose.tvec, 3))

    def pixels(self, points: Array) -> Array:
        """Raw pixels (n,2) of world points (n,3) mm."""
        seen = self._to_camera(points)
        ideal = seen[:, :2] / seen[:, 2:] * (self.camera.matrix[0, 0], self.camera.matrix[1, 1])
        return self.camera.distort(ideal + self.camera.matrix[:2, 2])

    def draw(
        self, picture: NDArray[np.float32], positions: Array, rotations: Array, which: NDArray[np.intp]
    ) -> None:
        """Lay the marks on the picture, in their order."""
        for p in which:
            self._mark(picture, self.textures[p], positions[p], float(rotations[p]))

    def _mark(self, picture: NDArray[np.float32], texture: _Texture, centre: Array, angle: float) -> None:
        right = np.array([-np.cos(angle), 0.0, -np.sin(angle)])  # of the mark's own picture, seen from +y
        down = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        reach = 0.5 * len(texture.cover) / texture.per_mm
        corners = centre + reach * np.array([right + down, right - down, -right + down, -right - down])
        block = _block(self.pixels(corners), picture.shape)
        if block is None:
            return
        homography = _plane_homography(self.pose, centre, right, down)
        texel = (
            _local(np.linalg.inv(homography), self.rays.at(*block)) * texture.per_mm
            + 0.5 * len(texture.cover)
            - 0.5
        )
        cover = _lookup(texture.cover, texel).mean(axis=1).reshape(picture[block].shape)
        ink = _lookup(texture.ink, texel).mean(axis=1).reshape(picture[block].shape)
        picture[block] = picture[block] * (1.0 - cover) + INK * cover + (PAPER - INK) * ink

    def face(self, picture: NDArray[np.float32], y: float, grey: Callable[[Array], Array]) -> None:
        """Lay a plane of that y mm on the picture, from its grey levels (n,) at points (n,2) mm (x, z)."""
        if y not in self.planes:
            axes = np.eye(3)
            homography = _plane_homography(self.pose, y * axes[1], axes[0], axes[2])
            every = self.rays.at(slice(None), slice(None))
            self.planes[y] = _local(np.linalg.inv(homography), every)
        places = self.planes[y]
        seen = grey(places.reshape(-1, 2)).reshape(places.shape[:2]).mean(axis=1).reshape(picture.shape)
        inside = np.isfinite(seen)
        picture[inside] = seen[inside]

    def body(self, picture: NDArray[np.float32], polygon: Array) -> None:
        """Fill the body's polygon (k,3) mm in dark grey, its edge blurred like the rest."""
        pixels = self.pixels(polygon)
        block = _block(np.concatenate([pixels - 4, pixels + 4]), picture.shape)
        if block is None:
            return
        corner = np.array([block[1].start, block[0].start])
        mask = np.zeros(picture[block].shape, dtype=np.uint8)
        cv2.fillPoly(mask, [np.round((pixels - corner) * 64).astype(np.int32)], 255, cv2.LINE_AA, 6)
        cover = cv2.GaussianBlur(mask, (0, 0), self.blur_px).astype(np.float64) / 255.0
        picture[block] += cover * (BODY - picture[block])


def _block(pixels: Array, shape: tuple[int, ...]) -> tuple[slice, slice] | None:
    """Rows and columns that hold the pixels (n,2); None when all are outside the picture."""
    low = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 2, 0)
    high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 3, (shape[1], shape[0]))
    if np.any(high <= low):
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _plane_homography(pose: Pose, origin: Array, right: Array, down: Array) -> Array:
    """From mm in the plane (right, down, 1) to normalised camera coordinates, (3,3)."""
    rotation, _ = cv2.Rodrigues(np.asarray(pose.rvec, dtype=np.float64))
    turned = np.asarray(rotation) @ np.stack([right, down, origin], axis=1)
    turned[:, 2] += np.reshape(pose.tvec, 3)
    return np.asarray(turned)


def _local(inverse: NDArray[np.floating], rays: NDArray[np.floating]) -> Array:
    """Plane coordinates mm of rays (...,2)."""
    mapped = rays @ inverse[:, :2].T + inverse[:, 2]
    return np.asarray(mapped[..., :2] / mapped[..., 2:])


def _lookup(texture: Array, texel: Array) -> Array:
    place = [texel[..., 1], texel[..., 0]]
    return np.asarray(scipy.ndimage.map_coordinates(texture, place, order=1, mode="nearest"))


def _texture(mark: Mark, px_per_mm: float, blur_px: float, dictionary: str) -> _Texture:
    """The printed mark on its white paper, blurred as the lens will blur it."""
    paper, per_mm = mark.kind.texture(TEXELS * px_per_mm, dictionary)
    sigma = blur_px * per_mm / px_per_mm
    pad = int(np.ceil(4 * sigma)) + 1
    cover = np.pad(np.ones_like(paper), pad)
    return _Texture(_blur(np.pad(paper, pad), sigma), _blur(cover, sigma), per_mm)


def _blur(texture: Array, sigma: float) -> Array:
    if sigma <= 0:
        return texture
    return np.asarray(scipy.ndimage.gaussian_filter(texture, sigma, truncate=4.0, mode="constant"))


def _background(size: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    """Mid-grey wall (h,w) with a faint, smooth texture of 3 grey levels."""
    coarse = rng.standard_normal((size[1] // 16 + 2, size[0] // 16 + 2)).astype(np.float32)
    wall = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(BACKGROUND + 3.0 * wall, dtype=np.float32)


def _expose(picture: NDArray[np.floating], noise_grey: float, rng: np.random.Generator) -> Image:
    noisy = picture.astype(np.float32)
    if noise_grey > 0:
        noisy += np.float32(noise_grey) * rng.standard_normal(picture.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8)
