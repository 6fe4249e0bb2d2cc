"""A bar that bends down on an inclined plane, slides and comes back, against a beam's equations by SciPy."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from fe import Case, Path, Support, solve
from fe.case import Contact
from fe.element import Array
from fe.kernel.contact import SMOOTH
from fe.obstacles import Flat
from tests.fe.conftest import SILICONE

Cube = Callable[..., Case]
LENGTH, HEIGHT, WIDTH = 20.0, 1.0, 0.5  # mm; the width is that of a half
SLOPE, TIP = 1.0, -1.5  # rad; mm under the rest of the lower edge of the tip is the plane there
STIFF = 0.02  # MPa/mm
TOP = 2e-4  # MPa
ALONG, UP = np.array([np.cos(SLOPE), np.sin(SLOPE)]), np.array([-np.sin(SLOPE), np.cos(SLOPE)])
DISTANCE = float(UP @ [LENGTH, TIP])


@dataclass
class Beam:
    """Geometrically exact, of axial, shear and bending stiffness, in the plane of x and z.

    State along it: x, z, rotation, force (2,), moment, the latter from the part beyond. Its lower fibre is
    pushed by the plane and held by friction, its upper one pressed by p. A slip's anchor is the coordinate
    along the plane at which a place of the lower fibre would be without traction.
    """

    friction: float

    def __post_init__(self) -> None:
        self.s = LENGTH * (1 - (1 - np.linspace(0, 1, 241)) ** 1.6)
        self.E = 6 * (SILICONE.C10 + SILICONE.C01)
        self.y = np.zeros((6, len(self.s)))
        self.y[0], self.y[1] = self.s, HEIGHT / 2
        self.anchor = self._lower(self.y) @ ALONG

    @staticmethod
    def _axes(y: Array) -> tuple[Array, Array]:
        c, s = np.cos(y[2]), np.sin(y[2])
        return np.stack([c, s], axis=1), np.stack([-s, c], axis=1)

    def _lower(self, y: Array) -> Array:
        return y[:2].T - HEIGHT / 2 * self._axes(y)[1]

    def _slip(self, y: Array, anchor: Array) -> tuple[Array, Array]:
        """Depth that pushes, and the elastic slip."""
        lower = self._lower(y)
        d = np.clip(DISTANCE - lower @ UP + SMOOTH / 2, 0.0, None)
        depth = np.where(d < SMOOTH, d**2 / (2 * SMOOTH), d - SMOOTH / 2)
        return depth, np.clip(lower @ ALONG - anchor, -self.friction * depth, self.friction * depth)

    def _slope(self, s: Array, y: Array, p: float) -> Array:
        t, d = self._axes(y)
        area = WIDTH * HEIGHT
        F, M = y[3:5].T, y[5]
        stretch, shear = 1 + (F * t).sum(1) / (self.E * area), (F * d).sum(1) / (self.E / 3 * 5 / 6 * area)
        turn = M / (self.E * area * HEIGHT**2 / 12)
        r = stretch[:, None] * t + shear[:, None] * d
        upper = r - HEIGHT / 2 * turn[:, None] * t  # the upper fibre's tangent
        depth, slip = self._slip(y, np.interp(s, self.s, self.anchor))
        below = STIFF * WIDTH * (depth[:, None] * UP - slip[:, None] * ALONG)
        above = p * WIDTH * np.stack([upper[:, 1], -upper[:, 0]], axis=1)
        bend = -_cross(r, F) + HEIGHT / 2 * (_cross(d, below) - _cross(d, above))
        return np.vstack([r.T, turn, -(below + above).T, bend])

    def pressed(self, pressures: Sequence[float]) -> Array:
        """Displacements (2,) mm of the axis at the tip and the middle, after the last of these pressures."""

        def ends(a: Array, b: Array) -> Array:
            return np.array([a[0], a[1] - HEIGHT / 2, a[2], b[3], b[4], b[5]])

        for p in pressures:
            found = solve_bvp(
                lambda s, y, p=p: self._slope(s, y, p), ends, self.s, self.y, tol=1e-5, max_nodes=20_000
            )
            assert found.success, found.message
            self.y = found.sol(self.s)
            self.anchor = self._lower(self.y) @ ALONG - self._slip(self.y, self.anchor)[1]
        return np.array([found.sol(x)[:2] - [x, HEIGHT / 2] for x in (LENGTH, LENGTH / 2)])


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def solid(cube: Cube, friction: float) -> Case:
    """The same bar of solid elements, smaller towards the tip, on rollers at x0."""
    held = (Support("x0", (0,)), Support("y0", (1,)), Support("root", (2,)))
    case = cube((24, 1, 2), supports=held, pressurised="z1")
    x, y, z = case.nodes.T
    root = np.flatnonzero((x == 0) & (z == 0.5))
    return replace(
        case,
        nodes=np.stack([LENGTH * (1 - (1 - x) ** 1.6), WIDTH * y, HEIGHT * z], axis=1),
        node_sets={**case.node_sets, "root": root},
        contact=Contact("z0", Flat((UP[0], 0.0, UP[1]), DISTANCE), STIFF, friction),
    )


@pytest.mark.slow
def test_a_bar_that_bends_touches_and_slides_back_is_as_its_beam(cube: Cube) -> None:
    path = Path(np.array([0.0, 1.0, 2.0]), np.array([0.0, TOP, 0.7 * TOP]), np.array([1.0, 2.0]))
    places = np.array([[LENGTH, 0.0, HEIGHT / 2], [LENGTH / 2, 0.0, HEIGHT / 2]])
    ours, theirs = [], []
    for friction in (0.0, 0.5):
        found, beam = solve(solid(cube, friction), path), Beam(friction)
        assert found.reason == "converged"
        ours.append(found.at(places)[:, :, [0, 2]])
        up, down = (TOP * np.linspace(a, b, 33)[1:] for a, b in ((0.0, 1.0), (1.0, 0.7)))
        theirs.append(np.stack([beam.pressed(up), beam.pressed(down)]))
    # a beam's own error, with and without friction: 0.3 % of 3.1 mm
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=0.01)
    effect, wanted = ours[1] - ours[0], theirs[1] - theirs[0]
    for mine, other, size in zip(effect, wanted, (0.5, 0.25), strict=True):
        assert np.abs(other).max() > size  # mm: sliding on; sliding back, of another sign in proportion
        np.testing.assert_allclose(mine, other, rtol=0, atol=0.02 * np.abs(other).max())
