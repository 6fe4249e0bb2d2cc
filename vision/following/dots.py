"""Centres of plain dots in a picture: iso-contour, ellipse, and what perspective does to it; and dots of
which nothing is known."""

from dataclasses import dataclass

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray
from skimage.measure import find_contours

from vision.camera import Array, Camera, Image

MIN_CONTRAST = 20.0  # grey levels between dot and paper
SMOOTH_PX = 0.8  # sd of the Gaussian before the contour, which rests on two pixels a point without it
# Length over which the smoothed noise is correlated along a contour.
CORRELATED_PX = 2.0 * np.sqrt(np.pi) * SMOOTH_PX
ROUGH = 0.5  # relative, of the extent of a contour that is looked at
LEVELS = (0.5, 0.25, 0.75)  # of the grey range round the guess, at which dots are looked for
INSIDE, OUTSIDE = 0.4, 1.45  # radii at which the grey of dot and paper are read
# Rms distance of a contour from its ellipse above which it is no dot: root of the sum of squares of px and a
# share of the radius. A printed rim is rough by about 1 % of the radius and never smoother than the pixels;
# a dot of which a third of the radius is covered is off by 4 %.
ROUND_PX, ROUND = 0.3, 0.015
LEAST_PX, LARGEST = 4.0, 0.05  # radii of dots of unknown size: in px, and as a share of the picture's height


@dataclass(frozen=True)
class Dot:
    """One dot as the picture shows it."""

    centre: Array  # (2,) of its ellipse in ideal px
    axes: Array  # (2,) px, half-axes, the smaller first
    dark: bool  # dark on light, or light on dark
    spread: Array  # (2,2) covariance of the centre for contour noise of unit variance
    variance: float  # px2, of the contour about its ellipse

    @property
    def radius(self) -> float:
        """Geometric mean of the half-axes, px."""
        return float(np.sqrt(self.axes.prod()))


def find_dots(
    image: Image,
    camera: Camera,
    guess: Array,
    axes: Array,
    *,
    search: float,
    dark: bool,
    tolerance: float = 0.35,
) -> list[Dot]:
    """Dots with about the half-axes (2,) px and centres within `search` px of the guess (2,) in ideal px.

    tolerance: relative, of either half-axis. A dot of which a part is covered is smaller across; its centre
    is off by as much.

    The contour runs at half the grey step from dot to paper on the cubic spline of the slightly smoothed
    picture; its points are undistorted, and an ellipse is fitted by least squares of the algebraic distance
    with unit trace.
    """
    raw, radius = camera.distort(guess), float(np.mean(axes))
    reach = search + 1.6 * radius + 4.0
    low = np.maximum(np.floor(raw - reach).astype(int), 0)
    high = np.minimum(np.ceil(raw + reach).astype(int) + 1, image.shape[::-1])
    if not np.all(high - low >= 5):
        return []
    part = image[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    part = part if dark else 255.0 - part
    low_grey, high_grey = np.percentile(part, [2.0, 98.0])
    if high_grey - low_grey < MIN_CONTRAST:
        return []
    smooth = np.asarray(cv2.GaussianBlur(part, (0, 0), SMOOTH_PX), dtype=np.float64)
    coefficients = scipy.ndimage.spline_filter(smooth, order=3, mode="mirror")
    dots: list[Dot] = []
    for share in LEVELS:
        for contour in find_contours(smooth, low_grey + share * (high_grey - low_grey)):
            if not _is_round(smooth, contour, radius) or _known(contour, dots, low, camera):
                continue
            edge = _at_half_step(coefficients, contour[:-1])
            dot = None if edge is None else _dot(camera.undistort(edge[:, ::-1] + low), dark)
            if dot is None or np.hypot(*(dot.centre - guess)) > search:
                continue
            if np.all(np.abs(dot.axes / axes - 1.0) < tolerance):
                dots.append(dot)
    return dots


def unknown_dots(image: Image) -> list[Dot]:
    """All dots of a picture, of any size, dark and light ones; of two rings round one middle the first."""
    flat = Camera(np.eye(3), np.zeros(5), (image.shape[1], image.shape[0]))
    found: list[Dot] = []
    for dark in (True, False):
        wanted = cv2.SimpleBlobDetector.Params()
        wanted.blobColor = 0 if dark else 255
        wanted.minArea, wanted.maxArea = np.pi * LEAST_PX**2, np.pi * (LARGEST * image.shape[0]) ** 2
        wanted.filterByCircularity, wanted.minCircularity = True, 0.8
        for spot in cv2.SimpleBlobDetector.create(wanted).detect(image):
            guess, radius = np.array(spot.pt), 0.5 * spot.size
            for dot in find_dots(image, flat, guess, np.full(2, radius), search=0.5 * radius, dark=dark)[:1]:
                if all(np.hypot(*(dot.centre - other.centre)) > other.radius for other in found):
                    found.append(dot)
    return found


def _known(contour: Array, dots: list[Dot], low: NDArray[np.int_], camera: Camera) -> bool:
    """True if a contour belongs to a dot that another level has shown."""
    centre = camera.undistort(contour.mean(axis=0)[::-1] + low)
    return any(np.hypot(*(dot.centre - centre)) < 0.5 * dot.radius for dot in dots)


def _at_half_step(coefficients: Array, contour: Array) -> Array | None:
    """A contour (k,2) (row, column), moved along the slope to half the step between dot and paper.

    A linear contour is off by up to 0.01 px between the pixels, and more where light or a coarse level
    misplace it. None where the step is faint.
    """

    def grey(points: Array) -> Array:
        return scipy.ndimage.map_coordinates(coefficients, points.T, order=3, mode="mirror", prefilter=False)

    centre = contour.mean(axis=0)
    ink = float(np.mean(grey(centre + INSIDE * (contour - centre))))
    paper = float(np.median(grey(centre + OUTSIDE * (contour - centre))))
    if paper - ink < MIN_CONTRAST:
        return None
    edge = contour
    for _ in range(3):
        slope = np.stack([grey(edge + h) - grey(edge - h) for h in 0.05 * np.eye(2)], axis=1) / 0.1
        steep = np.maximum(np.sum(slope**2, axis=1), (0.02 * (paper - ink)) ** 2)
        step = slope * ((0.5 * (ink + paper) - grey(edge)) / steep)[:, None]
        edge = edge + np.clip(step, -1.0, 1.0)
    return edge


def _is_round(part: Array, contour: Array, radius: float) -> bool:
    """True if a contour (k,2) (row, column) is closed, of about the size, and dark inside."""
    if len(contour) < 9 or np.any(contour[0] != contour[-1]):
        return False
    size = np.ptp(contour, axis=0) / (2.0 * radius)
    if not np.all(np.abs(size - 1.0) < ROUGH):
        return False
    row, column = np.round(contour.mean(axis=0)).astype(int)
    return bool(part[row, column] < part[tuple(np.round(contour[0]).astype(int))] + 1.0)


def _dot(points: Array, dark: bool) -> Dot | None:
    """The dot whose contour are the points (k,2); None where they are no ellipse."""
    offset, unit = points.mean(axis=0), float(points.std())
    x, y = ((points - offset) / unit).T
    length = np.linalg.norm(np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0), axis=1) / 2.0
    root = np.sqrt(length)[:, None]  # points lie unevenly on the contour
    columns = np.stack([x * x - y * y, 2.0 * x * y, x, y, np.ones_like(x)], axis=1)
    (a, b, *linear, constant), *_ = np.linalg.lstsq(columns * root, -(x * x + y * y) * root[:, 0], rcond=None)
    shape = np.array([[1.0 + a, b], [b, 1.0 - a]])
    if not np.linalg.det(shape) > 0.05:
        return None
    centre = np.linalg.solve(-2.0 * shape, linear)
    level = float(centre @ shape @ centre) - constant
    axes = unit * np.sqrt(max(level, 0.0) / np.linalg.eigvalsh(shape)[::-1])
    slope = 2.0 * (np.stack([x, y], axis=1) - centre) @ shape
    steep = np.linalg.norm(slope, axis=1)
    away = unit * (columns @ [a, b, *linear, constant] + x * x + y * y) / steep
    if not np.sqrt(np.mean(away**2)) < np.hypot(ROUND_PX, ROUND * np.sqrt(axes.prod())):
        return None
    normal = slope / steep[:, None]
    spread = np.linalg.inv((normal * (length / CORRELATED_PX)[:, None]).T @ normal)
    free = 1.0 - _explained(float(np.sqrt(axes.prod())))
    variance = float(np.average(away**2, weights=length)) / free
    return Dot(offset + unit * centre, axes, dark, spread, variance)


def _explained(radius: float) -> float:
    """Share of contour noise that the ellipse's five numbers take up: harmonics 0, 1 and 2 round the dot."""
    order = np.arange(-60, 61)
    power = np.exp(-((SMOOTH_PX * order / radius) ** 2))
    return float(power[np.abs(order) <= 2].sum() / power.sum())


def eccentricity(homography: Array, places: Array, radius: Array) -> Array:
    """Centre of the ellipse minus the projected centre, (...,2) ideal px: centre of the conic H^-T C H^-1
    minus the projection, for circles C of the plane, doi 10.1109/34.879788.

    homography: (...,3,3) plane mm to ideal px.   places: (...,2) mm centres.   radius: (...) mm.
    """
    x, z = places[..., 0], places[..., 1]
    ones, zero = np.ones_like(x), np.zeros_like(x)
    circle = np.stack(
        [
            np.stack([ones, zero, -x], axis=-1),
            np.stack([zero, ones, -z], axis=-1),
            np.stack([-x, -z, x * x + z * z - radius**2], axis=-1),
        ],
        axis=-2,
    )
    inverse = np.linalg.inv(homography)
    conic = np.swapaxes(inverse, -1, -2) @ circle @ inverse
    centre = -np.linalg.solve(conic[..., :2, :2], conic[..., :2, 2:])[..., 0]
    seen = (homography @ np.stack([x, z, ones], axis=-1)[..., None])[..., 0]
    return np.asarray(centre - seen[..., :2] / seen[..., 2:])
