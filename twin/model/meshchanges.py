"""The changes by finer meshes, decomposed: change of stiffness, change of shape, and the remainder.

A finer mesh is mostly softer or stiffer as a whole, which the fitted constants take up; the rest of its
change is another shape, which no constant takes up. What the finest mesh shows beside all others tells how
much a next mesh would still show.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from fe.element import Integers
from twin.targets import Array

# What remains after the correction, 1 sd: of the root sum of squares of all changes of stiffness, and of the
# rest of each. Measured on truths by other meshes and elements
# (docs/records/meshes.md): their stiffness is off by -3.0 to 1.2 %,
# where the changes sum up to 3.6 %.
STIFFNESS = 0.5
SHAPE = 0.5
POWERS = (1, 2, 3)  # of pressure, of the error of a single point, as large as what is left


@dataclass(frozen=True)
class MeshChanges:
    """Responses (g, k, m, 3) mm of m points at k pressures under g gravities, and what finer meshes change.

    names (n,): the meshes, the last finer in every direction; changes (n, g, k, m, 3); grid (k,) MPa.
    inside: so many of the pressures, the lowest, are compared.
    """

    names: tuple[str, ...]
    grid: Array
    base: Array
    changes: Array
    inside: int

    @cached_property
    def softer(self) -> Array:
        """Displacements (g, k, m, 3) mm that a softer silicone adds, to first order, for a fall of the scale
        by itself: as much as more pressure does, and a larger sag."""
        slope = scipy.interpolate.CubicSpline(self.grid, self.base, axis=1)(self.grid, 1)
        return np.asarray(slope * self.grid[:, None, None] + self.base[:, :1], float)

    @cached_property
    def softness(self) -> Array:
        """The part (n,) of the scale by which each mesh is softer."""
        softer, rows = self._compared(self.softer), self._compared(self.changes)
        return np.asarray((rows @ softer.T).ravel() / max(float((softer**2).sum()), 1e-12))

    @cached_property
    def shapes(self) -> Array:
        """The changes (n, g, k, m, 3) mm without their softness."""
        return self.changes - self.softness[:, None, None, None, None] * self.softer

    @cached_property
    def left(self) -> float:
        """Root mean square in mm of the change to the finest mesh beside all other changes and a softness. A
        deck has its finest mesh twice: it does not count beside itself."""
        others = [x for x in self.changes[:-1] if not np.array_equal(x, self.changes[-1])]
        rows = np.concatenate([self._compared(x) for x in (self.softer, *others)])
        check = self._compared(self.changes[-1])[0]
        remainder = check - rows.T @ np.linalg.lstsq(rows.T, check, rcond=1e-10)[0]
        return float(np.sqrt((remainder**2).mean()))

    @property
    def apart(self) -> float:
        """By how much of the scale the meshes differ, the root of the sum of squares."""
        return float(np.linalg.norm(self.softness))

    @property
    def modes(self) -> Array:
        """Modes (q, g, k, m, 3) mm, 1 sd each, of the error that remains on the finest mesh."""
        soft = STIFFNESS * self.apart * self.softer
        return np.concatenate([soft[None], SHAPE * self.shapes, self._smooth])

    @property
    def mode_names(self) -> tuple[str, ...]:
        """The names (q,) of the modes."""
        return ("stiffness", *self.names, *("remainder",) * (len(POWERS) * self.base[0, 0].size))

    @property
    def _smooth(self) -> Array:
        """An error of every point and axis on its own, smooth over pressure."""
        count, size = len(self.grid), self.base[0, 0].size
        x = self.left * np.power.outer(self.grid / self.grid[self.inside - 1], POWERS)  # (k, powers)
        each = np.einsum("kp,ab->apkb", x, np.eye(size))  # of the points' axes a
        fields = each.reshape(-1, 1, count, *self.base.shape[2:])
        return np.broadcast_to(fields, (len(fields), *self.base.shape))

    def _compared(self, fields: Array) -> Array:
        """Fields (.., g, k, m, 3) as rows (n, v) of what is compared."""
        rows = fields if fields.ndim == 5 else fields[None]
        return rows[:, :, : self.inside].reshape(len(rows), -1)


@dataclass(frozen=True)
class Curves:
    """Values over pressure under each gravity: cubic splines, straight beyond their ends."""

    spline: "scipy.interpolate.CubicSpline"

    @staticmethod
    def through(grid: Array, values: Array) -> "Curves":
        """The curves through values (k, n, g, ...) at pressures (k,) MPa."""
        return Curves(scipy.interpolate.CubicSpline(grid, values, axis=0))

    def at(self, q: Array, rows: Integers) -> tuple[Array, Array]:
        """Values and their derivatives per MPa (s, n, ...) at pressures (s,) MPa, under gravities (s,)."""
        x, c = self.spline.x, self.spline.c
        inside = np.clip(q, x[0], x[-1])
        k = np.clip(np.searchsorted(x, inside, side="right") - 1, 0, len(x) - 2)
        cubic, quadratic, linear, value = np.moveaxis(c[:, k, :, rows], 1, 0)
        h, beyond = (d.reshape(-1, *(1,) * (c.ndim - 3)) for d in (inside - x[k], q - inside))
        slope = (3 * cubic * h + 2 * quadratic) * h + linear
        return ((cubic * h + quadratic) * h + linear) * h + value + beyond * slope, slope
