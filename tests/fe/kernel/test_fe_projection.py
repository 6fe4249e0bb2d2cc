"""The foot of a point on a curved face, against minimisation of the distance."""

import numpy as np
import pytest
from scipy.optimize import minimize

from fe.element import ELEMENTS, Array, Element
from fe.kernel.projection import EDGE, Candidates, nearest, polynomials, powers

Foot = tuple[int, Array, float]
FACES = ELEMENTS["hex27"], ELEMENTS["C3D10"]


def curved(element: Element, amount: float, seed: int) -> Array:
    """Polynomial (9, 3) of a face of side 2 about the origin with normal near z, each node moved at random."""
    half = (0.0, 0.5, 1.0) if element.simplex else (-1.0, 0.0, 1.0)
    st = np.array([(s, t) for s in half for t in half if not element.simplex or s + t <= 1])
    order = np.abs(element.on_face(st)[0]).argmax(axis=0)  # the place of each node
    s, t = st[order].T
    flat = np.column_stack([s + 0.4 * t, t, np.zeros(len(order))])  # askew: s and t are not at right angles
    return polynomials(element) @ (flat + amount * np.random.default_rng(seed).uniform(-1, 1, flat.shape))


def foot(element: Element, P: Array, y: Array, touch: float = 2.0) -> Foot:
    """The face in contact with a point (3,), or -1, the coordinates of the foot, and the depth."""
    one = np.zeros(1, np.int64)
    near = Candidates(
        one, y.reshape(1, 1, 3), np.array([[[0.0, 0.0, -1.0]]]), np.array([[[0.0, 0.0, 9.0]]]),
        np.array([0, 1]), one,
    )  # fmt: skip
    ball = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 9.0, 9.0]])  # leaves nothing out
    which, st, depth = np.zeros((1, 1), np.int64), np.zeros((1, 1, 2)), np.zeros((1, 1))
    nearest(near, ball, P[None], P[None], element.simplex, touch, which, st, depth)
    return int(which[0, 0]), st[0, 0], float(depth[0, 0])


def at(P: Array, st: Array) -> tuple[Array, Array]:
    """A point (3,) of the face, and the unit normal (3,) there."""
    x, by_s, by_t = (powers(st[:1], st[1:])[:3] @ P)[:, 0]
    n = np.cross(by_s, by_t)
    return x, n / np.linalg.norm(n)


@pytest.mark.parametrize("element", FACES, ids=lambda e: e.name)
@pytest.mark.parametrize("seed", range(12))
def test_a_point_on_a_normal_has_its_foot_there(element: Element, seed: int) -> None:
    P, rng = curved(element, 0.03 if element.simplex else 0.1, seed), np.random.default_rng(seed)
    for height in (-0.3, -0.1, 0.0, 0.2, 0.4, 1.2):
        st = rng.uniform(0.05, 0.45, 2) if element.simplex else rng.uniform(-0.9, 0.9, 2)
        x, n = at(P, st)
        which, found, depth = foot(element, P, x + height * n)
        least = minimize(lambda q, y=x + height * n: float(((at(P, q)[0] - y) ** 2).sum()), st, tol=1e-14)
        assert which == 0
        np.testing.assert_allclose(found, least.x, atol=1e-5)
        np.testing.assert_allclose(found, st, atol=1e-9)  # the centre of curvature is further away
        np.testing.assert_allclose(depth, -height, atol=1e-9)


@pytest.mark.parametrize("element", FACES, ids=lambda e: e.name)
def test_a_face_serves_a_little_beyond_its_edges(element: Element) -> None:
    P = curved(element, 0.0, 0)
    low = 0.0 if element.simplex else -1.0
    length = 0.5 if element.simplex else 1.0
    for beyond, serves in ((0.9, True), (1.1, False)):
        out = beyond * EDGE * length
        places = [(low - out, 0.3), (0.3, low - out)]
        places += [(0.5 + out / 2, 0.5 + out / 2)] if element.simplex else [(1 + out, 0.3), (0.3, 1 + out)]
        for s, t in places:
            assert (foot(element, P, np.array([s + 0.4 * t, t, -0.1]))[0] == 0) == serves, (s, t)
