"""Spline samples and Gauss-Newton loops over patch points, compiled to machine code by numba.

A lens is the vector fx fy cx cy k1 k2 p1 p2 k3 sx sy: OpenCV's distortion, then a shift in px. Only the block
of the picture round a patch is turned into spline coefficients: a mark covers a thousandth of a frame.
Values are set one by one: for an array set as a whole numba compiles a second more, its error messages.
"""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

_compiled: Callable[[Any], Any] = numba.njit(
    cache=True, nogil=True, fastmath={"contract"}, error_model="numpy"
)

_POLE = np.sqrt(3.0) - 2.0  # of the cubic B-spline prefilter, doi 10.1109/79.799930
MARGIN = 10  # px cut round a patch
TRUSTED = 8  # px from a cut edge where the mirror there is forgotten to 3e-5
MAX_ITERATIONS = 20
CONVERGED_PX = 0.002


@_compiled
def _prefilter(block: Any) -> None:
    """Prefilter of all columns, in place, mirrored at their ends (but for the constant factor of 6).

    From row to row: the recursion along one column alone waits for every step of it.
    """
    rows, columns = block.shape
    start, power = np.zeros(columns), 1.0
    for k in range(min(rows, 14)):
        for i in range(columns):
            start[i] += power * block[k, i]
        power *= _POLE
    for i in range(columns):
        block[0, i] = start[i]
    for k in range(1, rows):
        for i in range(columns):
            block[k, i] += _POLE * block[k - 1, i]
    for i in range(columns):
        block[rows - 1, i] = _POLE / (_POLE * _POLE - 1.0) * (block[rows - 1, i] + _POLE * block[rows - 2, i])
    for k in range(rows - 2, -1, -1):
        for i in range(columns):
            block[k, i] = _POLE * (block[k + 1, i] - block[k, i])


@_compiled
def coefficients(image: Any, left: int, top: int, right: int, bottom: int) -> Any:
    """Cubic B-spline coefficients of the columns left to right - 1 and the rows top to bottom - 1."""
    turned = np.empty((right - left, bottom - top))
    for row in range(bottom - top):
        for column in range(right - left):
            turned[column, row] = 36.0 * image[top + row, left + column]
    _prefilter(turned)
    block = turned.T.copy()
    _prefilter(block)
    return block


@_compiled
def _spline_at(block: Any, x: float, y: float) -> float:
    """Value at a place inside the block, which is held one px from its edge."""
    x = min(max(x, 1.0), block.shape[1] - 2.0001)
    y = min(max(y, 1.0), block.shape[0] - 2.0001)
    column, row = int(x), int(y)
    u, v = x - column, y - row
    a, b = 1.0 - u, 1.0 - v
    u0, u3 = a * a * a, u * u * u
    u1, u2 = 4.0 + u * u * (3.0 * u - 6.0), 4.0 + a * a * (3.0 * a - 6.0)
    v0, v3 = b * b * b, v * v * v
    v1, v2 = 4.0 + v * v * (3.0 * v - 6.0), 4.0 + b * b * (3.0 * b - 6.0)
    # Unsigned numbers: of others numba asks at each access whether they count from the end.
    one, left, top = np.uint64(1), np.uint64(column - 1), np.uint64(row - 1)
    total = 0.0
    for weight in (v0, v1, v2, v3):
        total += weight * (
            u0 * block[top, left]
            + u1 * block[top, left + one]
            + u2 * block[top, left + one + one]
            + u3 * block[top, left + one + one + one]
        )
        top += one
    return total / 36.0


@_compiled
def _pixel(lens: Any, warp: Any, x: float, y: float) -> tuple[float, float, float]:
    """Raw pixel of a local point, and the homogeneous third coordinate."""
    w = warp[2, 0] * x + warp[2, 1] * y + warp[2, 2]
    u = ((warp[0, 0] * x + warp[0, 1] * y + warp[0, 2]) / w - lens[2]) / lens[0]
    v = ((warp[1, 0] * x + warp[1, 1] * y + warp[1, 2]) / w - lens[3]) / lens[1]
    r2, uv2 = u * u + v * v, 2.0 * u * v
    radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    return (
        lens[0] * (u * radial + lens[6] * uv2 + lens[7] * (r2 + 2.0 * u * u)) + lens[2] + lens[9],
        lens[1] * (v * radial + lens[7] * uv2 + lens[6] * (r2 + 2.0 * v * v)) + lens[3] + lens[10],
        w,
    )


@_compiled
def _box(lens: Any, warp: Any, grid: Any, side: int, box: Any) -> bool:
    """Left, top, right, bottom in px of the warped corners of the square grid; False for a fold."""
    box[0], box[1], box[2], box[3] = np.inf, np.inf, -np.inf, -np.inf
    count = grid.shape[1]
    for i in (0, side - 1, count - side, count - 1):
        x, y, w = _pixel(lens, warp, grid[0, i], grid[1, i])
        if not w > 0.0 or not np.isfinite(x + y):
            return False
        box[0], box[1], box[2], box[3] = min(box[0], x), min(box[1], y), max(box[2], x), max(box[3], y)
    return True


@_compiled
def _cut(box: Any, shape: tuple[int, int], margin: int, cut: Any) -> None:
    """Columns and rows (left, top, right, bottom, the last two exclusive) of the box and a margin."""
    cut[0] = max(int(min(max(box[0], 0.0), shape[1] - 1.0)) - margin, 0)
    cut[1] = max(int(min(max(box[1], 0.0), shape[0] - 1.0)) - margin, 0)
    cut[2] = min(int(min(max(box[2], 0.0), shape[1] - 1.0)) + margin + 2, shape[1])
    cut[3] = min(int(min(max(box[3], 0.0), shape[0] - 1.0)) + margin + 2, shape[0])


@_compiled
def sample(image: Any, lens: Any, warps: Any, grid: Any, side: int, grey: Any) -> None:
    """Grey levels (m,n) of the picture at the warped grid; points outside take the nearest edge's."""
    box, cut = np.empty(4), np.empty(4, np.int64)
    for m in range(len(warps)):
        if not _box(lens, warps[m], grid, side, box):
            for i in range(grid.shape[1]):
                grey[m, i] = 0.0
            continue
        _cut(box, image.shape, MARGIN, cut)
        block = coefficients(image, cut[0], cut[1], cut[2], cut[3])
        for i in range(grid.shape[1]):
            x, y, _ = _pixel(lens, warps[m], grid[0, i], grid[1, i])
            grey[m, i] = _spline_at(block, x - cut[0], y - cut[1])


@_compiled
def _compose(warp: Any, change: Any, after: Any) -> bool:
    """Put the inverse of a step (8,) before the warp, in place; False where it folds. `after` is room."""
    a, b, c = 1.0 + change[0], change[1], change[2]
    d, e, f = change[3], 1.0 + change[4], change[5]
    g, h = change[6], change[7]
    for row in range(3):
        p, q, r = warp[row, 0], warp[row, 1], warp[row, 2]
        after[row, 0] = p * (e - f * h) + q * (f * g - d) + r * (d * h - e * g)
        after[row, 1] = p * (c * h - b) + q * (a - c * g) + r * (b * g - a * h)
        after[row, 2] = p * (b * f - c * e) + q * (c * d - a * f) + r * (a * e - b * d)
    if not a * (e - f * h) + b * (f * g - d) + c * (d * h - e * g) > 1e-3 or not abs(after[2, 2]) > 1e-9:
        return False
    last = after[2, 2]
    for row in range(3):
        for column in range(3):
            warp[row, column] = after[row, column] / last
    return True


@_compiled
def _whole(quarters: Any, k: int) -> float:
    """The sum of a patch's quarters."""
    value: float = quarters[0, k] + quarters[1, k] + quarters[2, k] + quarters[3, k]
    return value


# One long body with twelve arguments: numba compiles the loops over marks, steps and points as one function.
@_compiled
def lay(
    image: Any,
    lens: Any,
    grid: Any,
    side: int,
    grey: Any,
    step: Any,
    which: Any,
    scale: Any,
    warps: Any,
    correlation: Any,
    sums: Any,
    seen: Any,
) -> None:
    """Move the warps (m,3,3) until the patches lie on the picture, in place; correlation (m,), 0 for failed.

    One pass over the points gives all sums of a step: the rows of `step` are orthogonal to a constant and to
    the template, so that the sampled grey levels need no normalising first. They are kept by quarters of the
    patch: sums (m,4,10) with `step`, with the template and with 1, of normalised grey levels.
    seen: (m,n) grey levels of the last step.
    """
    box, cut, held = np.empty(4), np.empty(4, np.int64), np.empty(4)
    change, after = np.empty(8), np.empty((3, 3))
    quarter = np.empty((4, 10))
    count = grid.shape[1]
    half = side // 2
    height, width = image.shape
    for m in range(len(warps)):
        template, steps, warp = grey[which[m]], step[which[m]], warps[m]
        block = np.empty((0, 0))
        held[0], held[2] = np.inf, -np.inf  # where the block can be trusted: nowhere yet
        correlation[m] = 0.0
        for _ in range(MAX_ITERATIONS):
            if not _box(lens, warp, grid, side, box):
                break
            if box[0] < 0.0 or box[1] < 0.0 or box[2] > width - 1.0 or box[3] > height - 1.0:
                break
            if box[0] < held[0] or box[1] < held[1] or box[2] > held[2] or box[3] > held[3]:
                _cut(box, image.shape, MARGIN, cut)
                block = coefficients(image, cut[0], cut[1], cut[2], cut[3])
                held[0] = cut[0] + TRUSTED if cut[0] > 0 else 0.0
                held[1] = cut[1] + TRUSTED if cut[1] > 0 else 0.0
                held[2] = cut[2] - 1 - TRUSTED if cut[2] < width else width - 1.0
                held[3] = cut[3] - 1 - TRUSTED if cut[3] < height else height - 1.0
            power = 0.0
            for k in range(10):
                quarter[0, k] = quarter[1, k] = quarter[2, k] = quarter[3, k] = 0.0
            for row in range(side):
                for right in range(2):
                    part_sums = quarter[(2 if row >= half else 0) + right]
                    total, product = 0.0, 0.0
                    for i in range(row * side + right * half, row * side + (side if right else half)):
                        x, y, _ = _pixel(lens, warp, grid[0, i], grid[1, i])
                        value = _spline_at(block, x - cut[0], y - cut[1])
                        seen[m, i] = value
                        total += value
                        power += value * value
                        product += value * template[i]
                        for k in range(8):
                            part_sums[k] += steps[i, k] * value
                    part_sums[8] += product
                    part_sums[9] += total
            product, total = _whole(quarter, 8), _whole(quarter, 9)
            norm = np.sqrt(max(power - total * total / count, 1e-12))
            if not product > 0.0:
                break
            for k in range(8):
                change[k] = _whole(quarter, k) / norm
            if not _compose(warp, change, after):
                break
            if scale[m] * max(abs(change[2]), abs(change[5])) <= CONVERGED_PX:
                correlation[m] = product / norm
                for part in range(4):
                    for k in range(10):
                        sums[m, part, k] = quarter[part, k] / norm
                break
