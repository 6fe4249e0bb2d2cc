"""Every element type: what its shape functions, faces, quadrature and pressure modes must satisfy."""

import numpy as np
import pytest

from fe.element import ELEMENTS, FACES, HEX27, Element, gauss

RNG = np.random.default_rng(1)
TYPES = pytest.mark.parametrize("kind", ELEMENTS.values(), ids=ELEMENTS)


def inner(kind: Element, count: int) -> np.ndarray:
    """Local points (count, 3) inside an element."""
    if kind.simplex:
        return RNG.dirichlet(np.ones(4), count)[:, 1:]
    return RNG.uniform(-1, 1, (count, 3))


def quadratic(x: np.ndarray) -> np.ndarray:
    return 1 + x[:, 0] - 2 * x[:, 1] + x[:, 0] * x[:, 2] - 3 * x[:, 1] ** 2


@TYPES
def test_each_shape_function_is_one_at_its_node_and_zero_at_the_others(kind: Element) -> None:
    np.testing.assert_allclose(kind.shape(kind.local)[0], np.eye(len(kind.local)), atol=1e-15)


@TYPES
def test_shape_functions_sum_to_one_and_reproduce_polynomials(kind: Element) -> None:
    xi = inner(kind, 20)
    N, dN = kind.shape(xi)
    np.testing.assert_allclose(N.sum(1), 1, atol=1e-14)  # rounding of 27 terms
    np.testing.assert_allclose(dN.sum(1), 0, atol=1e-14)
    np.testing.assert_allclose(N @ kind.local, xi, atol=1e-14)
    if len(kind.local) > 8:
        np.testing.assert_allclose(N @ quadratic(kind.local), quadratic(xi), atol=1e-13)


@TYPES
def test_gradients_are_the_differences_of_the_values(kind: Element) -> None:
    xi, h = inner(kind, 20), 1e-5
    _, dN = kind.shape(xi)
    for d, e in enumerate(np.eye(3) * h):
        # error h^2 times a third derivative, and rounding / h
        differences = (kind.shape(xi + e)[0] - kind.shape(xi - e)[0]) / (2 * h)
        np.testing.assert_allclose(differences, dN[:, :, d], atol=1e-9)


@TYPES
def test_faces_close_around_the_volume_and_their_normals_point_out(kind: Element) -> None:
    N, dN = kind.on_face(kind.face_points)
    flux = 0.0
    for rows in kind.faces:
        X = kind.local[rows]
        s, t = (dN[:, :, d] @ X for d in range(2))
        flux += float((kind.face_weights * (N @ X * np.cross(s, t)).sum(1)).sum()) / 3
        np.testing.assert_allclose(kind.shape(N @ X)[0][:, rows], N, atol=1e-13)  # the trace of the cell
        assert ((np.cross(s, t) @ (X.mean(0) - kind.local.mean(0))) > 0).all()
    assert flux == pytest.approx(kind.weights.sum(), abs=1e-13)
    assert len(np.unique(np.sort(kind.faces, axis=1), axis=0)) == len(kind.faces)


@TYPES
def test_face_gradients_are_the_differences_of_the_values(kind: Element) -> None:
    st, h = RNG.dirichlet(np.ones(3), 7)[:, 1:], 1e-5
    _, dN = kind.on_face(st)
    for d, e in enumerate(np.eye(2) * h):
        differences = (kind.on_face(st + e)[0] - kind.on_face(st - e)[0]) / (2 * h)
        np.testing.assert_allclose(differences, dN[:, :, d], atol=1e-9)


@TYPES
def test_the_quadrature_integrates_quadratics(kind: Element) -> None:
    size = 1 / 6 if kind.simplex else 8.0
    second = 1 / 60 if kind.simplex else 8 / 3
    assert kind.weights.sum() == pytest.approx(size)
    if len(kind.local) > 4:  # of a linear tetrahedron nothing varies
        np.testing.assert_allclose(kind.weights @ kind.points**2, second)


@TYPES
def test_pressure_modes_hold_a_constant_and_are_independent(kind: Element) -> None:
    psi = kind.pressure_modes(kind.points[None])[0]
    assert np.linalg.matrix_rank(psi) == psi.shape[1]
    one = np.linalg.lstsq(psi, np.ones(len(psi)), rcond=None)[0]
    np.testing.assert_allclose(psi @ one, 1, atol=1e-14)


def test_a_point_is_inside_or_outside() -> None:
    tet = ELEMENTS["C3D10"]
    assert tet.inside(np.full(3, 0.3)) < 0 < tet.inside(np.full(3, 0.35))
    assert HEX27.inside(np.full(3, 0.9)) < 0 < HEX27.inside(np.array([0.0, 0.0, -1.1]))


def test_faces_of_hex27_run_along_the_lattice() -> None:
    np.testing.assert_array_equal(FACES[5], np.arange(18, 27))


def test_the_quadrature_is_exact_up_to_degree_five_and_not_six() -> None:
    for dimensions in (2, 3):
        x, w = gauss(dimensions)
        for axis in range(dimensions):
            moments = [w @ x[:, axis] ** k / w.sum() for k in range(7)]
            np.testing.assert_allclose(moments[:6], [1, 0, 1 / 3, 0, 1 / 5, 0], atol=1e-15)
            assert abs(moments[6] - 1 / 7) > 0.01
