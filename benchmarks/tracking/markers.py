"""Marker displacement against the Cramer-Rao bound, OpenCV's own methods beside it, and the speed.

    python benchmarks/tracking/markers.py [--quick] [--json]

28 markers in a drawn 1080p picture (f 1600 px, 400 mm away, tilted by 15 and 5 degrees, k1 -0.2, lens blur
0.8 px, noise 2 grey levels): twelve frames at rest make the reference, then every marker moves by 8 px and
turns by up to 90 degrees. An error is measured minus true displacement of the centre in undistorted px.

The bound is that of any unbiased estimate of a homography (8), gain and offset from the frame's pixels, on
white paper without end, plus that of the mean of the twelve. It is made of the drawn pictures' own finite
differences and knows nothing of the registration.
"""

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import whole
from benchmarks.tracking import studio

import cv2
import numpy as np
from numpy.typing import NDArray

from vision import Camera, Mark, Video, kinds
from vision.drawing import synthetic
from vision.film.video import Writer
from vision.following.markrotations import mean_seen
from vision.following.reference import Follower, prepare
from vision.following.tracking import follow
from vision.following.tracks import Followed, Method
from vision.kinds import CodedMarker, PlainDot
from vision.marks import detect

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
SIZES = (20, 30, 40, 60)  # px
NOISE = 2.0  # grey levels
BLUR = 0.8  # px
REFERENCE = 12  # frames
SHIFT_PX, TURN = 8.0, np.pi / 2
FOCAL, AWAY = 1600.0, 400.0  # px, mm
SPOTS = [(float(x), float(z)) for z in (-82.5, -27.5, 27.5, 82.5) for x in range(-180, 181, 60)]


@cache
def camera(zoom: int) -> Camera:
    """1080p, or 4K with `zoom` 2."""
    width, height = 1920 * zoom, 1080 * zoom
    matrix = np.array([[FOCAL, 0, 0.5 * width], [0, FOCAL, 0.5 * height], [0, 0, 1.0]])
    return Camera(matrix, np.array([-0.2 / zoom**2, 0, 0, 0, 0]), (width, height))


@dataclass(frozen=True)
class Scene:
    """A camera, marks, and where they truly are."""

    camera: Camera
    pose: synthetic.Pose
    marks: tuple[Mark, ...]
    place: Array  # (t,p,3) mm
    turn: Array  # (t,p) rad

    def drawing(self, *, paper: bool = False) -> synthetic._Scene:
        """The renderer; `paper` draws the marks on white paper without end."""
        border, side = (4, 4.0) if paper else (kinds.QUIET_CELLS, kinds.PAPER)
        with patch.object(kinds, "QUIET_CELLS", border), patch.object(kinds, "PAPER", side):
            return synthetic._Scene(self.camera, self.pose, self.marks, BLUR, "DICT_4X4_50")

    def ideal(self) -> Array:
        """True centres (t,p,2) in undistorted px."""
        rotation = np.asarray(cv2.Rodrigues(self.pose.rvec)[0])
        seen = self.place @ rotation.T + self.pose.tvec
        return seen[..., :2] / seen[..., 2:] * FOCAL + self.camera.matrix[:2, 2]


@dataclass(frozen=True)
class Frames:
    """Pictures that can be read like a film."""

    pictures: list[Image]
    path: Path = Path("drawn")

    @property
    def time(self) -> Array:
        return np.arange(len(self.pictures)) / 10.0

    @property
    def width(self) -> int:
        return self.pictures[0].shape[1]

    @property
    def height(self) -> int:
        return self.pictures[0].shape[0]

    def frames(self) -> Iterator[tuple[int, float, Image]]:
        yield from ((i, i / 10.0, picture) for i, picture in enumerate(self.pictures))


def scene(size_px: float, moving: int, seed: int, *, zoom: int = 1, marker: bool = True) -> Scene:
    """28 marks that rest for the reference and then move in `moving` even steps; `zoom` 2 is 4K."""
    rotation = np.asarray(cv2.Rodrigues(np.deg2rad([15.0, 5.0, 0.0]))[0]) @ studio.FACING
    pose = synthetic.Pose(np.asarray(cv2.Rodrigues(rotation)[0]).ravel(), np.array([0.0, 0.0, AWAY]))
    size = size_px * AWAY / FOCAL
    marks = tuple(
        Mark(f"m{i}", CodedMarker(i, size) if marker else PlainDot(size), (x * zoom, 0.0, z * zoom), "frame")
        for i, (x, z) in enumerate(SPOTS)
    )
    rng = np.random.default_rng(seed)
    direction = rng.uniform(0, 2 * np.pi, len(marks))
    step = np.stack([np.cos(direction), 0 * direction, np.sin(direction)], axis=-1) * SHIFT_PX * AWAY / FOCAL
    done = np.concatenate([np.zeros(REFERENCE), np.arange(1, moving + 1) / moving])[:, None]
    start = np.array([mark.position for mark in marks]) + rng.uniform(-1, 1, (len(marks), 3)) * (1, 0, 1)
    turn = rng.uniform(-TURN, TURN, len(marks)) * done
    return Scene(camera(zoom), pose, marks, start + done[..., None] * step, turn)


def film(s: Scene, seed: int, noise: float = NOISE) -> Frames:
    """The pictures that the camera takes."""
    drawing, rng = s.drawing(), np.random.default_rng([seed, 1])
    wall = synthetic._background(s.camera.size, rng)
    pictures, still = [], None
    for place, turn in zip(s.place, s.turn, strict=True):
        if still is None or len(pictures) >= REFERENCE:
            still = wall.copy()
            drawing.draw(still, place, turn, np.arange(len(s.marks)))
        pictures.append(synthetic._expose(still, noise, rng))
    return Frames(pictures)


def bound(s: Scene, frames: NDArray[np.intp], every: int = 1) -> Array:
    """Cramer-Rao covariance (f,p,2,2) of the centre in undistorted px, in some frames, of every n-th mark."""
    drawing = s.drawing(paper=True)
    canvas = np.empty((s.camera.size[1], s.camera.size[0]), dtype=np.float32)
    found = [[_bound(s, drawing, canvas, p, t) for p in range(0, len(s.marks), every)] for t in frames]
    return np.array(found)


def _bound(s: Scene, drawing: synthetic._Scene, canvas: NDArray[np.float32], p: int, t: int) -> Array:
    centre, angle = s.place[t, p], float(s.turn[t, p])
    size, delta = s.marks[p].size_mm, 1e-2 * AWAY / FOCAL
    right, down = np.array([-np.cos(angle), 0, -np.sin(angle)]), np.array([np.sin(angle), 0, -np.cos(angle)])
    corners = centre + (0.75 * size + 5.0 * AWAY / FOCAL) * np.array(
        [right + down, right - down, -right + down, -right - down]
    )
    block = synthetic._block(drawing.pixels(corners), (s.camera.size[1], s.camera.size[0]))
    assert block is not None
    grey = {}
    for name, at in {"0": 0.0 * right, "r": right, "l": -right, "d": down, "u": -down}.items():
        canvas[block] = synthetic.PAPER
        drawing._mark(canvas, drawing.textures[p], centre + delta * at, angle)
        grey[name] = canvas[block].astype(np.float64).ravel()
    gx, gy = (grey["l"] - grey["r"]) / (2 * delta), (grey["u"] - grey["d"]) / (2 * delta)
    plane = synthetic._plane_homography(s.pose, centre, right, down)
    x, y = synthetic._local(np.linalg.inv(plane), drawing.rays.centre[block].reshape(-1, 2)).T
    if not s.marks[p].kind.shows_turn:  # a dot does not show its turn, nor perspective
        columns = [gx, gy, gx * x, gy * y, gx * y + gy * x]
    else:
        columns = [gx, gy, gx * x, gx * y, gy * x, gy * y, x * (gx * x + gy * y), y * (gx * x + gy * y)]
    columns = np.stack([*columns, grey["0"], np.ones_like(x)], axis=1)
    scale = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.inv((columns / scale).T @ (columns / scale)) / np.outer(scale, scale)
    mm = inverse[:2, :2] * (NOISE**2 + 1.0 / 12.0)  # rounding to whole grey levels is noise too
    to_px = FOCAL * (plane[:2, :2] - np.outer(plane[:2, 2] / plane[2, 2], plane[2, :2])) / plane[2, 2]
    return to_px @ mm @ to_px.T


@dataclass(frozen=True)
class Trial:
    """Errors of the moving frames of one film, the sd that the fit states, and the bound."""

    error: Array  # (t,p,2) px
    sd: Array  # (t,p,2) px
    bound: Array  # (t,p,2) px, 1 sd
    lost: int

    @property
    def rms(self) -> float:
        """Root mean square error of a component, px."""
        return float(np.sqrt(np.nanmean(self.error**2)))

    @property
    def ratio(self) -> float:
        """Root mean square error over that of the bound."""
        return float(np.sqrt(np.nanmean(self.error**2) / np.nanmean(self.bound**2)))

    @property
    def pull(self) -> float:
        return float(np.sqrt(np.nanmean((self.error / self.sd) ** 2)))

    @property
    def about(self) -> float:
        """Relative standard error of rms, ratio and pull, from how mean squares differ from mark to mark."""
        seen = np.isfinite(self.error).any(axis=(0, 2))
        square = np.nanmean(self.error[:, seen] ** 2, axis=(0, 2))
        return float(np.std(square, ddof=1) / np.sqrt(len(square)) / (2.0 * np.mean(square)))


def displacement(ideal: Array) -> Array:
    """Displacements (t,p,2) of the moving frames against the mean of the reference."""
    return ideal[REFERENCE:] - mean_seen(ideal[:REFERENCE])


def tracked(s: Scene, pictures: Frames) -> tuple[Follower, Followed]:
    """The film, followed as `twin measure` follows it."""
    seconds = (REFERENCE - 0.5) / 10.0
    follower = prepare(pictures, s.camera, s.marks, dictionary="DICT_4X4_50", reference_s=seconds)
    return follower, follow(pictures, follower, reference_s=seconds, stage="film")


def trial(size_px: float, moving: int, seed: int, every: int = 5, of: int = 1, noise: float = NOISE) -> Trial:
    """One film of markers of one size; the bound is taken in every fifth frame, of every n-th mark."""
    s = scene(size_px, moving, seed)
    _, followed = tracked(s, film(s, seed, noise))
    error = displacement(followed.ideal) - displacement(s.ideal())
    at = np.arange(REFERENCE, len(s.place), every)
    rest = bound(s, np.array([0]), of)[0]
    total = bound(s, at, of) + rest / REFERENCE
    limit = np.sqrt(np.diagonal(total, axis1=2, axis2=3))
    stated = followed.covariance[REFERENCE:] + np.nanmean(followed.covariance[:REFERENCE], axis=0) / REFERENCE
    lost = int(np.isnan(error[..., 0]).sum())
    return Trial(error, np.sqrt(np.diagonal(stated, axis1=2, axis2=3)), limit, lost)


def speed(size_px: float, frames: int, zoom: int) -> tuple[float, float, float]:
    """CPU ms a frame of 28 markers followed, detected, and the share of them that is followed."""
    s = scene(size_px, frames, 1, zoom=zoom)
    pictures = film(s, 1)
    follower, _ = tracked(s, Frames(pictures.pictures[:REFERENCE]))
    began = time.process_time()
    followed = follow(pictures, follower, reference_s=1.15, stage="film")
    each = (time.process_time() - began) / len(s.place)
    began = time.process_time()
    detect(pictures.pictures[0], "DICT_4X4_50")
    return (
        1e3 * each,
        1e3 * (time.process_time() - began),
        float(np.mean(followed.method == Method.REGISTERED)),
    )


def decoding(pictures: Frames, codec: str) -> float:
    """CPU ms to read a frame of 1080p."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mkv"
        with Writer(path, (1920, 1080), fps=10.0, codec=codec, crf=18.0) as writer:
            for picture in pictures.pictures:
                writer.add(picture)
        recorded = Video(path)
        began = time.process_time()
        count = sum(1 for _ in recorded.frames())
        return 1e3 * (time.process_time() - began) / count


def figures(quick: bool) -> dict[str, Any]:
    """`crb_ratio` and `registration_pull_sd` by marker size in px, and the speed."""
    moving = 12 if quick else 90
    print(
        "| marker / px | rms / px | bound / px | ratio | pull sd | +- | lost |\n|---|---|---|---|---|---|---|"
    )
    trials = {}
    for size in SIZES:
        t = trials[str(size)] = trial(size, moving, size, every=6 if quick else 10, of=4 if quick else 1)
        limit = np.sqrt(np.mean(t.bound**2))
        told = f"{t.ratio:.2f} | {t.pull:.2f} | {100 * t.about:.0f} %"
        print(f"| {size} | {t.rms:.4f} | {limit:.4f} | {told} | {t.lost} |", flush=True)
    print("\n| 28 markers of | ms/frame | frames/s | detection, ms | registered |\n|---|---|---|---|---|")
    rates = {}
    for size, zoom in ((40, 1), (60, 1), (22, 2)):
        each, found, share = speed(size, 6 if quick else 40, zoom)
        rates[f"{size} px, {1080 * zoom}p"] = 1e3 / each
        name = f"{size} px, {1920 * zoom} x {1080 * zoom}"
        print(f"| {name} | {each:.1f} | {1e3 / each:.0f} | {found:.0f} | {100 * share:.0f} % |")
    pictures = film(scene(40.0, 8, 1), 1)
    for codec in ("libx264", "ffv1"):
        print(f"decoding 1080p {codec}: {decoding(pictures, codec):.1f} ms/frame")
    return {
        "crb_ratio": {size: round(t.ratio, 3) for size, t in trials.items()},
        "registration_pull_sd": {size: round(t.pull, 3) for size, t in trials.items()},
        "crb_ratio_se": {size: round(t.ratio * t.about, 3) for size, t in trials.items()},
        "fps_1080p_28_markers": round(rates["40 px, 1080p"], 1),
        "fps": {name: round(rate, 1) for name, rate in rates.items()},
    }


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="12 moving frames instead of 90"))
