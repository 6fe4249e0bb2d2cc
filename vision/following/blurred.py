"""A mark that is seen more blurred than in its reference, or with a slope of light over it: its place, with
both fitted beside it.

A printed pattern is not symmetric, so that blur moves the place which plain registration finds: by 0.01 px
for a marker of 30 px and a blur of 1 px, by 0.1 px for 20 px and 2 px. It also leaves a residual, which looks
like a large noise. With blur and light in the fit there is neither.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from vision.camera import Array
from vision.following import influence, registration
from vision.following.registration import INTERPOLATED, Picture, Templates
from vision.marks import linear_at_centre

EXCESS = 1.8  # times what a fit at rest leaves: below it nothing is tried
FIRST = 0.5  # of what is left beyond that must go in the first step; what coding leaves goes by a hundredth
ENOUGH, NEARLY = 0.85, 3.0  # of it must go in all, or so many times what is usual be left at most
SHARPER, MOST = -0.25, 9.0  # px2, of a blur's variance along any axis, against that at rest
STEPS = 8
FAR_PX = 1.0  # from where plain registration lies: blur and light move a mark by a third of it at most
CONVERGED_PX, CONVERGED_PX2 = 0.002, 0.02
REACH = 1.5  # sds of the blur from a patch's edge, within which other things show
PAD = 12  # points round a patch, over which its edge goes on
PLACE, BLUR, CONTRAST = slice(0, 8), slice(8, 11), 11  # columns of the design
NUMBERS = 17


@dataclass(frozen=True)
class Spectra:
    """Fourier transforms of reference patches, from which they are blurred."""

    side: int  # points
    pitch: float  # local units from one point to the next
    wave: Array  # (2,h,w) waves per point times 2 pi, x and y
    patch: np.ndarray  # (p,h,w) complex
    grid: Array  # (3,n) of the reference

    @cached_property
    def sharp(self) -> Array:
        """Orthonormal bases (p,17,n) of all that the first step of a fit can explain."""
        designs = (_design(self, row, np.zeros(3)) for row in range(len(self.patch)))
        return np.array([np.linalg.qr(design)[0].T for design in designs])


@dataclass(frozen=True)
class Adjusted:
    """A mark with its blur and light fitted."""

    warp: Array  # (3,3) local to ideal px
    left: float  # share of the patch's power that is not explained
    covariance: Array  # (2,2) px2 of the centre, from that
    growth: float  # of the variance by the blur alone
    leaning: Array  # (2,) see `uneven.lean`


def spectra(reference: Templates) -> Spectra:
    """Fourier transforms of all reference patches, continued over their edges."""
    count = reference.grid.shape[1]
    side = round(float(np.sqrt(count)))
    more = scipy.fft.next_fast_len(side + 2 * PAD, real=True) - side - PAD
    wide = np.pad(reference.grey.reshape(-1, side, side), ((0, 0), (PAD, more), (PAD, more)), mode="edge")
    size = wide.shape[1]
    wave = 2.0 * np.pi * np.stack(np.meshgrid(scipy.fft.rfftfreq(size), scipy.fft.fftfreq(size)))
    pitch = float(reference.grid[0, 1] - reference.grid[0, 0])
    return Spectra(side, pitch, wave, scipy.fft.rfft2(wide), reference.grid)


def adjust(
    image: Picture, lens: Array, reference: Templates, fourier: Spectra, rows: NDArray[np.intp], *,
    start: Array, usual: Array, match: Array, grey: Array,
) -> list[Adjusted | None]:  # fmt: skip
    """The marks' places (m,) with their blur and their light; None where these do not explain what plain
    registration leaves: a cover, glare, noise.

    rows: (m,) of the reference.   start: (m,3,3) as registered.   usual: (m,) share of the power that is left
    at rest.   match: (m,) correlation as registered.   grey: (m,n) levels under them, as registered.

    Coding leaves much in most marks of a film, and no blur: what the first step gains, a projection while the
    patch is sharp, tells which to fit.
    """
    grey = grey - grey.mean(axis=1, keepdims=True)
    before, power = 1.0 - match**2, np.sum(grey**2, axis=1)
    explained = [np.sum((fourier.sharp[row] @ levels) ** 2) for row, levels in zip(rows, grey, strict=True)]
    gain = explained - match**2 * power  # on what plain registration explains
    return [
        _adjust(image, lens, reference, fourier, int(rows[k]), start[k], float(usual[k]), float(before[k]))
        if gain[k] >= FIRST * (before[k] - usual[k]) * power[k] else None
        for k in range(len(rows))
    ]  # fmt: skip


def _adjust(
    image: Picture, lens: Array, reference: Templates, fourier: Spectra, row: int, start: Array, usual: float,
    before: float,
) -> Adjusted | None:  # fmt: skip
    """One mark, by Gauss-Newton, inverse compositional in the warp, on homography, covariance of a Gaussian
    blur (3), contrast, brightness and the slopes of both.

    before: share of the patch's power that plain registration leaves.
    """
    warp, blur = start, np.zeros(3)
    for _ in range(STEPS):
        fit = _fitted(image, lens, fourier, row, warp, blur)
        if fit is None:
            return None
        warp, blur = _composed(warp, fit.change[PLACE]), _within(blur + fit.change[BLUR])
        if not np.hypot(*(warp - start)[:2, 2]) <= FAR_PX:
            return None
        still = np.abs(fit.change[[2, 5]]).max() <= CONVERGED_PX * fourier.pitch
        if still and np.abs(fit.change[BLUR]).max() <= CONVERGED_PX2:
            break
    else:
        return None
    if fit.left > NEARLY * usual and before - fit.left < ENOUGH * (before - usual):
        return None
    return _adjusted(reference, fourier, row, warp, fit)


@dataclass(frozen=True)
class _Fit:
    """One step, in units of the reference patch."""

    design: Array  # (n,17)
    change: Array  # (17,)
    residual: Array  # (n,)
    left: float  # share of the patch's power


def _fitted(image: Picture, lens: Array, fourier: Spectra, row: int, warp: Array, blur: Array) -> _Fit | None:
    """The step from a warp and a blur; None where the picture shows no contrast like the patch's."""
    sure = _sure(fourier, blur)
    grey = sure * registration.grey_under(image, lens, warp[None], fourier.grid)[0]
    design = sure[:, None] * _design(fourier, row, blur)
    power = float(grey @ grey - grey.sum() ** 2 / sure.sum())
    coefficients = np.linalg.solve(design.T @ design, design.T @ grey)
    if not (power > 0.0 and coefficients[CONTRAST] > 0.0):
        return None
    residual = grey - design @ coefficients
    contrast = coefficients[CONTRAST]
    return _Fit(design, coefficients / contrast, residual / contrast, float(residual @ residual) / power)


def _adjusted(reference: Templates, fourier: Spectra, row: int, warp: Array, fit: _Fit) -> Adjusted:
    """The result, from the last step."""
    linear = linear_at_centre(warp[None])[0]
    pixels = fourier.pitch**2 * float(abs(np.linalg.det(linear)))
    covariance = linear @ np.linalg.inv(fit.design.T @ fit.design)[[[2], [5]], [2, 5]] @ linear.T
    sharp = linear @ reference.covariance[row][[[2], [5]], [2, 5]] @ linear.T
    count = np.count_nonzero(fit.design.any(axis=1))
    noise = float(fit.residual @ fit.residual) / max(count - NUMBERS / pixels, 1.0)
    return Adjusted(
        warp,
        fit.left,
        noise * max(1.0 / (INTERPOLATED * pixels), 1.0) * covariance,
        float(np.trace(covariance) / np.trace(sharp)),
        influence.lean_of(fit.design, fit.residual, linear),
    )


def _design(fourier: Spectra, row: int, blur: Array) -> Array:
    """Columns (n,17) of the blurred patch: homography (8), covariance of the blur xx, xy, yy in points2, the
    patch, a constant, and the slopes of both."""
    across, down = fourier.wave
    power = blur[0] * across**2 + 2.0 * blur[1] * across * down + blur[2] * down**2
    patch = fourier.patch[row] * np.exp(-0.5 * power)
    fields = np.stack([
        patch, 1j * across / fourier.pitch * patch, 1j * down / fourier.pitch * patch,
        -0.5 * across**2 * patch, -across * down * patch, -0.5 * down**2 * patch,
    ])  # fmt: skip
    size = fourier.wave.shape[1]
    inside = slice(PAD, PAD + fourier.side)
    seen = scipy.fft.irfft2(fields, (size, size))[:, inside, inside].reshape(6, -1)
    (grey, gx, gy, *widths), (x, y, ones) = seen, fourier.grid
    radial = gx * x + gy * y
    place = [gx * x, gx * y, gx, gy * x, gy * y, gy, -radial * x, -radial * y]
    return np.stack([*place, *widths, grey, ones, x * grey, y * grey, x, y], axis=1)


def _sure(fourier: Spectra, blur: Array) -> Array:
    """1 for points (n,) that show the mark and its paper alone, 0 for those near the patch's edge, into which
    the blur brings what lies beyond; the mark itself, -1 to 1, always counts."""
    width = REACH * fourier.pitch * np.sqrt(max(0.5 * (blur[0] + blur[2]), 0.0))
    most = max(float(fourier.grid[0].max()) - width, 1.0)
    return np.asarray(np.max(np.abs(fourier.grid[:2]), axis=0) <= most, dtype=np.float64)


def _composed(warp: Array, change: Array) -> Array:
    """The warp with the inverse of a step (8,) before it; NaN where it folds."""
    step = np.append(change, 0.0).reshape(3, 3) + np.eye(3)
    if np.linalg.det(step) < 0.1:
        return np.full((3, 3), np.nan)
    after = warp @ np.linalg.inv(step)
    return np.asarray(after / after[2, 2])


def _within(blur: Array) -> Array:
    """A covariance xx, xy, yy whose variances are held within what a blur can be."""
    size, axes = np.linalg.eigh(np.array([[blur[0], blur[1]], [blur[1], blur[2]]]))
    held = (axes * np.clip(size, SHARPER, MOST)) @ axes.T
    return np.array([held[0, 0], held[0, 1], held[1, 1]])
