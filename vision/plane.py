"""The homography between the finger's plane (mm) and ideal pixels in each frame, and how its errors move
a place."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array

MIN_VISIBLE = 4
STEPS = 4  # of Gauss-Newton from the direct solution: quadratic, so that three reach rounding
FLAT = 1e-9  # of the largest power in the equations: below it the marks lie on one line
# The same of the marks' nominal places: below it noise is carried on a thousandfold, as by a fourth mark that
# lies 2 % off the line of the others, or, beyond all bounds, by one mark beside three on a line.
SLIM = 1e-6


@dataclass(frozen=True)
class Plane:
    """The homographies of a film and the frame marks that made them."""

    nominal: Array  # (f,2) mm, x and z of the frame marks
    seen: NDArray[np.bool_]  # (t,f)
    homography: Array  # (t,3,3) plane (x, z, 1) mm to ideal px; NaN where the marks tell none
    spread: Array  # (t,8,8) covariance of its amplitudes, see `_field`, for pixel noise of unit variance
    residual: Array  # (t,f,2) mm, where the frame marks are seen minus their nominal places


def plane_of(nominal: Array, ideal: Array) -> Plane:
    """The plane from the frame marks' nominal places (f,2) mm and ideal pixels (t,f,2).

    The homography's fit minimises sum |G B(X) a - du|^2 in pixels, G (2,2) px/mm, so that its amplitudes a
    have the covariance (sum B' G' G B)^-1.
    """
    homography = homographies(nominal, ideal)
    seen = np.isfinite(ideal[..., 0])
    field = _field(nominal, nominal)
    normal = np.einsum("fia,tfij,fjb->tab", field, _weights(nominal, seen, homography), field)
    spread = np.full(normal.shape, np.nan)
    finite = np.isfinite(homography[:, 0, 0])
    spread[finite] = _each(np.linalg.inv, normal[finite])
    return Plane(nominal, seen, homography, spread, to_plane(homography, ideal) - nominal)


def fit_homography(plane: Array, pixels: Array) -> Array:
    """Least-squares homography (3,3) from plane points (n,2) mm to ideal pixels (n,2), n >= 4.

    >>> square = np.array([[0.0, 0], [100, 0], [100, 50], [0, 50]])  # mm
    >>> pixels = square * 3.0 + (200.0, 100.0)
    >>> homography = fit_homography(square, pixels)
    >>> homography.round(6)
    array([[  3.,   0., 200.],
           [  0.,   3., 100.],
           [  0.,   0.,   1.]])
    """
    return np.asarray(homographies(plane, pixels[None])[0])


def homographies(plane: Array, ideal: Array) -> Array:
    """Homographies (t,3,3) from the frame marks' nominal places (f,2) mm and ideal pixels (t,f,2).

    Least squares of the reprojection error, all frames at once. A frame gets NaN that shows fewer than 4 of
    the marks, or no 4 of which no three lie on a line.
    """
    seen = np.isfinite(ideal[..., 0])
    result = np.full((len(ideal), 3, 3), np.nan)
    rows = np.flatnonzero(seen.sum(axis=1) >= MIN_VISIBLE)
    rows = rows[_wide(plane, seen[rows])]
    if not len(rows):
        return result
    to_local, to_unit = _centring(plane), _centring(ideal[seen])
    local = np.column_stack([plane, np.ones(len(plane))]) @ to_local.T
    pixels = np.where(seen[rows, :, None], ideal[rows], 0.0) * to_unit[0, 0] + to_unit[:2, 2]
    solution, fit = _direct(local, pixels, seen[rows])
    for _ in range(STEPS):
        solution[fit] = _improved(solution[fit], local, pixels[fit], seen[rows][fit])
    full = np.linalg.inv(to_unit) @ solution[fit] @ to_local
    result[rows[fit]] = full / full[:, 2:, 2:]
    return result


def _wide(plane: Array, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (t,) of the frames whose marks that are seen (t,f), at plane (f,2) mm, tell a homography."""
    field = _field(plane, plane)
    power = np.linalg.eigvalsh(np.einsum("fia,tf,fib->tab", field, seen.astype(np.float64), field))
    return np.asarray(power[:, 0] > SLIM * power[:, -1])


def _each(of: Callable[..., Array], *stacks: Array) -> Array:
    """Result of a function of numpy for stacks (t,...) of matrices, NaN for those that are singular."""
    try:
        return of(*stacks)
    except np.linalg.LinAlgError:
        if len(stacks[0]) == 1:
            return np.full(stacks[-1].shape, np.nan)
        return np.concatenate([_each(of, *(s[k : k + 1] for s in stacks)) for k in range(len(stacks[0]))])


def _centring(points: Array) -> Array:
    """Map (3,3) of points (n,2) to their middle and spread: near 0, of size 1."""
    shift, spread = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    return np.array([[1.0, 0.0, -shift[0]], [0.0, 1.0, -shift[1]], [0.0, 0.0, spread]]) / spread


def _direct(local: Array, pixels: Array, seen: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Homographies (t,3,3) of least algebraic error, last entry 1, and for which frames (t,) there is one."""
    zero = np.zeros((*pixels.shape[:2], 3))
    wide = np.broadcast_to(local, zero.shape)
    rows = [
        np.concatenate(parts, axis=2) * seen[..., None]
        for parts in ((wide, zero, -pixels[..., :1] * wide), (zero, wide, -pixels[..., 1:] * wide))
    ]
    equations = np.concatenate(rows, axis=1)
    power, vectors = np.linalg.eigh(np.swapaxes(equations, 1, 2) @ equations)
    solution = vectors[:, :, 0].reshape(-1, 3, 3)
    fit = (power[:, 1] > FLAT * power[:, -1]) & (np.abs(solution[:, 2, 2]) > FLAT)
    return solution / np.where(fit, solution[:, 2, 2], 1.0)[:, None, None], fit


def _improved(homography: Array, local: Array, pixels: Array, seen: NDArray[np.bool_]) -> Array:
    """Homographies (t,3,3) after one Gauss-Newton step on the reprojection error."""
    mapped = np.einsum("tij,fj->tfi", homography, local)
    u, v, w = np.moveaxis(mapped, -1, 0)
    x, y = local[:, 0], local[:, 1]
    u, v, ones, zero = u / w, v / w, np.ones_like(w), np.zeros_like(w)
    across = np.stack([x * ones, y * ones, ones, zero, zero, zero, -u * x, -u * y], axis=-1)
    down = np.stack([zero, zero, zero, x * ones, y * ones, ones, -v * x, -v * y], axis=-1)
    slope = np.concatenate([across, down], axis=1) / np.concatenate([w, w], axis=1)[..., None]
    slope = slope * np.concatenate([seen, seen], axis=1)[..., None]
    error = np.concatenate([pixels[..., 0] - u, pixels[..., 1] - v], axis=1)
    turned = np.swapaxes(slope, 1, 2)
    step = _each(np.linalg.solve, turned @ slope, turned @ error[..., None])[..., 0]
    return homography + np.concatenate([step, np.zeros((len(step), 1))], axis=1).reshape(-1, 3, 3)


def to_plane(homography: Array, ideal: Array) -> Array:
    """Plane coordinates mm (t,p,2) of ideal pixels (t,p,2) under homographies (t,3,3); NaN stays NaN.

    >>> homography = np.array([[[3.0, 0, 200], [0, 3, 100], [0, 0, 1]]])  # 3 px per mm
    >>> to_plane(homography, np.array([[[350.0, 175.0], [np.nan, np.nan]]]))
    array([[[50., 25.],
            [nan, nan]]])
    """
    inverse = np.full(homography.shape, np.nan)
    finite = np.isfinite(homography[:, 0, 0])
    inverse[finite] = _each(np.linalg.inv, homography[finite])
    mapped = np.einsum("tij,tpj->tpi", inverse[:, :, :2], ideal) + inverse[:, None, :, 2]
    return np.asarray(mapped[..., :2] / mapped[..., 2:])


def place_noise(plane: Plane, place: Array) -> Array:
    """Covariance (t,p,2,2) mm2 of places (t,p,2) mm for pixel noise of unit variance in the frame marks.

    >>> frame = np.array([[0.0, 0], [100, 0], [100, 50], [0, 50]])  # mm
    >>> plane = plane_of(frame, 3.0 * frame[None] + 200.0)
    >>> noise = place_noise(plane, np.array([[[50.0, 25.0], [100.0, 25.0], [150.0, 25.0]]]))
    >>> np.sqrt(noise[0, :, 0, 0]).round(2)  # mm in x for 1 px in each frame mark: least in the middle
    array([0.37, 0.24, 1.07])
    """
    field = _field(plane.nominal, place)
    return np.asarray(np.einsum("tpia,tab,tpjb->tpij", field, plane.spread, field))


def shared_noise(plane: Plane, place: Array) -> Array:
    """Mean covariance (2,) mm2 of two different places (p,2) mm for pixel noise of unit variance in the frame
    marks, mean over the frames."""
    field, spread = _field(plane.nominal, place), np.nanmean(plane.spread, axis=0)
    every = np.einsum("pia,ab,pib->i", field, spread, field)
    total = np.einsum("ia,ab,ib->i", field.sum(axis=0), spread, field.sum(axis=0))
    return np.asarray((total - every) / max(len(place) * (len(place) - 1), 1))


def misplaced(plane: Plane, place: Array) -> Array:
    """Shift (2f,t,p,2) of places (t,p,2) mm for each frame mark 1 mm off its nominal place, in x and then z.

    A mark that is off by d takes the homography with it, a = (sum B'WB)^-1 B_f' W_f d with W = G'G, and a
    place is measured B(X) a short.
    """
    weight = _weights(plane.nominal, plane.seen, plane.homography)
    amplitude = np.einsum("tab,fib,tfij->tafj", plane.spread, _field(plane.nominal, plane.nominal), weight)
    shift = -np.einsum("tpia,tafj->fjtpi", _field(plane.nominal, place), amplitude)
    return np.asarray(shift.reshape(-1, *place.shape))


def _weights(plane: Array, seen: NDArray[np.bool_], homography: Array) -> Array:
    """G'G (t,f,2,2) px2/mm2 at plane points (f,2) mm, G the homography's slope; 0 for those not seen."""
    mapped = np.einsum("tij,fj->tfi", homography, np.column_stack([plane, np.ones(len(plane))]))
    pixel = mapped[..., :2] / mapped[..., 2:]
    slope = homography[:, None, :2, :2] - pixel[..., None] * homography[:, None, 2:, :2]
    weight = np.swapaxes(slope, -1, -2) @ slope / mapped[..., 2, None, None] ** 2
    return np.where(seen[..., None, None], weight, 0.0)


def _field(plane: Array, place: Array) -> Array:
    """Plane fields B (...,2,8) at places (...,2) mm: the tangent of all homographies at the identity.

    (x, z) -> (1, x, z) in both components, and the two perspective ones; x, z from the middle of the frame
    marks (f,2) in units of their half width, so that the eight are of one size.
    """
    middle, half = plane.mean(axis=0), 0.5 * float(np.ptp(plane, axis=0).max())
    x, z = np.moveaxis((place - middle) / half, -1, 0)
    ones, zero = np.ones_like(x), np.zeros_like(x)
    across = np.stack([ones, x, z, zero, zero, zero, x * x, x * z], axis=-1)
    up = np.stack([zero, zero, zero, ones, x, z, x * z, z * z], axis=-1)
    return np.stack([across, up], axis=-2)
