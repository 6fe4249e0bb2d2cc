"""Centres of all markers of a dictionary in one picture, to a few hundredths of a pixel or better."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from vision.camera import Array, Camera, Image
from vision.dictionaries import dictionary_of, other_dictionary
from vision.film.picturefaults import picture_trouble
from vision.following import registration
from vision.following.printedpattern import (
    BLUR_PX,
    CELLS_BEYOND,
    SHOWS_BLUR,
    drawn,
    larger,
    misfit_covariance,
    polarity,
    print_covariance,
)
from vision.marks import corner_warp, detect, linear_at_centre, px_per_unit


@dataclass(frozen=True)
class Located:
    """Markers in one picture."""

    ids: NDArray[np.intp]  # (m,) sorted; an id that is seen twice is left out
    centre: Array  # (m,2) raw px
    covariance: Array  # (m,2,2) px2, of noise, of what the pattern is not, and of a print off its plane
    correlation: Array  # (m,) of the picture with the printed pattern; 0 where the fit failed
    inverted: NDArray[np.bool_]  # (m,) white on black
    repeated: tuple[int, ...] = ()  # ids that are seen more than once, and therefore left out
    reason: str = ""  # why there are none, one sentence; "" where there are some


def locate(image: Image, *, dictionary: str, camera: Camera | None = None) -> Located:
    """Centres of the markers in a picture.

    image: (h,w) grey levels.   dictionary: name or file, as `dictionary_of`.
    camera: its lens; without it the lens is taken as free of distortion across one marker.

    The printed pattern, blurred as the picture is, is registered to it by a homography; OpenCV's corners
    are the start only. Raises ValueError for an unknown dictionary.
    """
    quads, more = detect(image, dictionary)
    ids, repeated = np.array(sorted(quads), dtype=np.intp), tuple(sorted(more))
    if not len(ids):
        none = np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0), np.empty(0, dtype=bool)
        return Located(ids, *none, repeated, _reason(image, dictionary, repeated))
    used = camera or no_lens(image)
    start = np.array([corner_warp(used.undistort(quads[int(i)])) for i in ids])
    fit = _Fit(image, registration.lens_of(used), start, ids, dictionary)
    few = np.arange(len(ids))[:: max(len(ids) // SHOWS_BLUR, 1)]
    blur = scipy.optimize.minimize_scalar(
        lambda b: -fit.at(b, few)[2].sum(), bounds=BLUR_PX, method="bounded", options={"xatol": 0.02}
    ).x
    templates, warp, correlation = fit.at(float(blur), np.arange(len(ids)))
    centre = warp[:, :2, 2] / warp[:, 2:, 2]
    covariance = fit.covariance(templates, warp, correlation)
    return Located(ids, used.distort(centre), covariance, correlation, fit.sign < 0, repeated)


def _reason(image: Image, dictionary: str, repeated: tuple[int, ...]) -> str:
    """Reason why no marker is located, one sentence."""
    if repeated:
        return (f"All markers of {dictionary} that are seen are there more than once: ids "
                f"{', '.join(map(str, repeated))}. Print and glue every id once.")  # fmt: skip
    better = other_dictionary([image], dictionary)
    if better:
        return f"No marker of {dictionary} is seen; {better[0]} finds {better[1]}: give that dictionary."
    trouble = picture_trouble(image)
    if trouble:
        return f"No marker of {dictionary} is seen: {trouble}."
    return (f"No marker of {dictionary}, nor of another predefined dictionary, is seen: check focus and the "
            "markers' white border; they need 12 px or more.")  # fmt: skip


class _Fit:
    """The printed patterns of the markers that were detected, laid on the picture with any blur."""

    def __init__(
        self, image: Image, lens: Array, start: Array, ids: NDArray[np.intp], dictionary: str
    ) -> None:
        self.image, self.lens, self.start, self.dictionary = image, lens, start, dictionary
        self.codes = [int(i) for i in ids]
        self.scale = px_per_unit(start)
        cells = dictionary_of(dictionary).markerSize + 2
        half = 1.0 + CELLS_BEYOND * 2.0 / cells
        points = int(np.clip(np.ceil(2.0 * half * np.median(self.scale)), 24, 160))
        self.grid = registration.local_grid(points, half)
        grey = registration.patches(image, lens, start, self.grid)[:, 0]
        self.sign = np.array([polarity(patch, self.grid, cells) for patch in grey])

    def at(self, blur_px: float, which: NDArray[np.intp]) -> tuple[registration.Templates, Array, Array]:
        """The patterns with this blur, their warps (m,3,3) and correlations (m,)."""
        patch = [
            self.sign[i] * drawn(self.codes[i], self.grid, self.dictionary, blur_px / self.scale[i])
            for i in which
        ]
        templates = registration.templates(np.concatenate(patch), self.grid)
        warp, correlation = registration.register(
            self.image, self.lens, templates, self.start[which], self.scale[which], np.arange(len(which))
        )
        return templates, warp, correlation

    def covariance(self, templates: registration.Templates, warp: Array, correlation: Array) -> Array:
        """Covariances (m,2,2) px2 of all centres: of noise, or of blocks of the residual where these say
        more; and of prints that lie off their plane."""
        linear = linear_at_centre(warp)
        linear[correlation == 0.0] = np.eye(2)  # no fit: any size will do
        white = registration.centre_covariance(templates, linear, correlation)
        grey = registration.patches(self.image, self.lens, warp, self.grid)[:, 0]
        return larger(white, misfit_covariance(templates, grey, linear)) + print_covariance(linear)


def no_lens(image: Image) -> Camera:
    """A camera without distortion of the picture's size: ideal pixels are raw ones."""
    return replace(Camera(np.eye(3), np.zeros(5), (image.shape[1], image.shape[0])), model=())
