"""The printed pattern of markers: where it lies in their patches, and how far its centre may be off.

Light, sharpening in the camera and a print that is not flat leave a residual that is alike over many pixels.
White noise of its size would average out over them; it does not.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import scipy

from vision.camera import Array
from vision.dictionaries import bits_of, dictionary_of
from vision.following import registration
from vision.following.registration import Templates

BLUR_PX = (0.3, 3.0)  # px, sd of lens blur and pixel together, between which it is sought
SHOWS_BLUR = 6  # marks that are enough to see it
CELLS_BEYOND = 0.6  # how far a patch reaches into the border round a marker, in marker cells
MATCHES = 0.87  # correlation that shows the pattern, as for a registered mark
BLOCKS = 6  # along a marker's side: a block is about as wide as its cells, over which residuals are alike
# Distance of a print from the plane that it should lie in, 1 sd in sides of the marker: 0.1 mm for 40 mm. It
# moves a centre only where the marker is seen at an angle. Real boards: 0.27 % and 0.3 to 0.4 %.
OFF_PLANE = 0.003


def printed_centres(mean: Array, grid: Array, codes: Sequence[int], dictionary: str, scale: Array) -> Array:
    """Local coordinates (p,2) of the true centres: the printed pattern registered to the mean patches.

    mean: (p,n) grey levels on the grid (3,n).   codes: (p,) of the markers.
    scale: (p,) px per local unit, NaN for a mark not seen.

    The corners that started a patch are off by some 0.05 px; the pattern as a whole by 0.004, if it is
    blurred as the picture is: the blur that matches best is found first. (0, 0) where nothing matches.
    """
    seen = [int(i) for i in np.flatnonzero(np.isfinite(scale))]
    few = seen[:: max(len(seen) // SHOWS_BLUR, 1)]

    def mismatch(blur: float) -> float:
        return -float(sum(_found(mean[i], grid, codes[i], dictionary, blur / scale[i])[1] for i in few))

    best = scipy.optimize.minimize_scalar(
        mismatch, bounds=BLUR_PX, method="bounded", options={"xatol": 0.02}
    ).x
    centre = np.zeros((len(codes), 2))
    for i in seen:
        place, match = _found(mean[i], grid, codes[i], dictionary, best / scale[i])
        centre[i] = place if match > MATCHES else 0.0
    return centre


def _found(mean: Array, grid: Array, code: int, dictionary: str, blur: float) -> tuple[Array, float]:
    """Local coordinates (2,) of the pattern's centre in the patch (n,), and the correlation."""
    side = round(float(np.sqrt(grid.shape[1])))
    half = float(grid[0].max())
    pitch = 2.0 * half / (side - 1)
    inner = registration.local_grid(side, half - 2.0 * pitch)
    to_index = np.array([[1.0, 0.0, half], [0.0, 1.0, half], [0.0, 0.0, pitch]]) / pitch
    upright = polarity(mean, grid, dictionary_of(dictionary).markerSize + 2)
    warp, match = registration.register(
        mean.reshape(side, side).astype(np.float32),
        registration.NO_LENS,
        registration.templates(upright * drawn(code, inner, dictionary, blur), inner),
        to_index[None],
        np.array([1.0 / pitch]),
        np.zeros(1, int),
    )
    return warp[0, :2, 2] * pitch - half, float(match[0])


def polarity(patch: Array, grid: Array, cells: int) -> float:
    """1 for a black marker on white, -1 for an inverted one, from a patch (n,) on the grid (3,n).

    cells: along the marker's side, its border included.   The border tells from what surrounds it.
    """
    distance, cell = np.abs(grid[:2]).max(axis=0), 2.0 / cells
    border = (distance < 1.0 - 0.25 * cell) & (distance > 1.0 - 0.75 * cell)
    return 1.0 if patch[distance > 1.0 + 0.25 * cell].mean() > patch[border].mean() else -1.0


def drawn(code: int, grid: Array, dictionary: str, blur: float) -> Array:
    """Grey and slopes (1,3,n) of the printed pattern, blurred with an sd of `blur` local units."""
    bits = np.asarray(bits_of(code, dictionary), dtype=np.float64) / 255.0
    cells = len(bits)
    fine = max(16, int(np.ceil(2.0 * 2.0 / (cells * blur))))  # the blur is at least two texels
    texture = np.kron(np.pad(bits, 1, constant_values=1.0), np.ones((fine, fine)))
    texture = cv2.GaussianBlur(texture, (0, 0), blur * 0.5 * cells * fine).astype(np.float32)
    to_texel = np.array(
        [
            [1.0, 0.0, 1.0 + 2.0 / cells - 1.0 / (cells * fine)],
            [0.0, 1.0, 1.0 + 2.0 / cells - 1.0 / (cells * fine)],
            [0.0, 0.0, 2.0 / (cells * fine)],
        ]
    ) * (0.5 * cells * fine)
    return registration.patches(texture, registration.NO_LENS, to_texel[None], grid)


def misfit_covariance(reference: Templates, grey: Array, linear: Array) -> Array:
    """Covariance (p,2,2) px2 of the centres from residuals that are alike within blocks of the patch.

    grey: (p,n) what the picture shows under the patches.   linear: (p,2,2) px per local unit at the centre.

    Each of 6 x 6 blocks moves the centre by the sum of its residuals' pulls; their squares are added (the
    sandwich of White, doi 10.2307/1912934, by blocks).
    """
    flat = grey - grey.mean(axis=1, keepdims=True)
    flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    residual = flat - np.sum(flat * reference.grey, axis=1, keepdims=True) * reference.grey
    pull = residual[..., None] * reference.step[..., [2, 5]]
    side = round(float(np.sqrt(reference.grid.shape[1])))
    along = np.arange(side) * BLOCKS // side
    block = np.eye(BLOCKS**2)[(BLOCKS * along[:, None] + along).ravel()]
    moves = np.einsum("pnk,nb,pjk->pbj", pull, block, linear)
    return np.asarray(np.einsum("pbi,pbj->pij", moves, moves))


def print_covariance(linear: Array) -> Array:
    """Covariance (p,2,2) px2 of the centres for prints that lie off their plane, as far as the view shows it.

    linear: (p,2,2) px per local unit at the centre, half a side being the unit. A normal of length 1 is seen
    along the shorter axis, with a length of sqrt(longer^2 - shorter^2).
    """
    axes, size, _ = np.linalg.svd(linear)
    seen = np.sqrt(np.maximum(size[:, 0] ** 2 - size[:, 1] ** 2, 0.0))
    shift = 2.0 * OFF_PLANE * seen[:, None] * axes[:, :, 1]
    return np.asarray(shift[:, :, None] * shift[:, None])


def larger(a: Array, b: Array) -> Array:
    """The larger (p,2,2) of two covariances each, by their traces."""
    is_first = np.trace(a, axis1=1, axis2=2) >= np.trace(b, axis1=1, axis2=2)
    return np.where(is_first[:, None, None], a, b)
