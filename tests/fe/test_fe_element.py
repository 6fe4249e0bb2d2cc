"""The 27-node hexahedron: what its shape functions, faces and quadrature must satisfy."""

import numpy as np

from fe.element import FACES, face_shape, gauss, shape

RNG = np.random.default_rng(1)
LOCAL = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]


def test_each_shape_function_is_one_at_its_node_and_zero_at_the_others() -> None:
    np.testing.assert_array_equal(shape(LOCAL)[0], np.eye(27))


def test_shape_functions_sum_to_one_and_reproduce_quadratics() -> None:
    xi = RNG.uniform(-1, 1, (20, 3))
    N, dN = shape(xi)

    def f(x: np.ndarray) -> np.ndarray:
        return 1 + x[:, 0] ** 2 * x[:, 1] ** 2 - 3 * x[:, 2] ** 2 * x[:, 1] + x[:, 0]

    np.testing.assert_allclose(N.sum(1), 1, atol=1e-14)  # rounding of 27 terms
    np.testing.assert_allclose(dN.sum(1), 0, atol=1e-14)
    np.testing.assert_allclose(N @ f(LOCAL), f(xi), atol=1e-13)


def test_gradients_are_the_differences_of_the_values() -> None:
    xi, h = RNG.uniform(-1, 1, (20, 3)), 1e-5
    _, dN = shape(xi)
    for d, e in enumerate(np.eye(3) * h):
        # quadratic in each coordinate: central differences are exact up to rounding / h
        np.testing.assert_allclose((shape(xi + e)[0] - shape(xi - e)[0]) / (2 * h), dN[:, :, d], atol=1e-10)


def test_a_face_is_the_trace_of_the_cell_and_its_normal_points_out() -> None:
    st = RNG.uniform(-1, 1, (7, 2))
    N, dN = face_shape(st)
    for rows in FACES:
        corners = LOCAL[rows]
        outward = corners.mean(0)
        normal = np.cross(*(np.einsum("qa,ai->qi", dN[:, :, d], corners) for d in range(2)))
        np.testing.assert_allclose(normal, np.broadcast_to(outward, normal.shape), atol=1e-13)
        trace = shape(N @ corners)[0]
        np.testing.assert_allclose(trace[:, rows], N, atol=1e-13)
    assert len(np.unique(np.sort(FACES, axis=1), axis=0)) == 6


def test_face_gradients_are_the_differences_of_the_values() -> None:
    st, h = RNG.uniform(-1, 1, (7, 2)), 1e-5
    _, dN = face_shape(st)
    for d, e in enumerate(np.eye(2) * h):
        np.testing.assert_allclose(
            (face_shape(st + e)[0] - face_shape(st - e)[0]) / (2 * h), dN[:, :, d], atol=1e-10
        )


def test_the_quadrature_is_exact_up_to_degree_five_and_not_six() -> None:
    for dimensions in (2, 3):
        x, w = gauss(dimensions)
        for axis in range(dimensions):
            moments = [w @ x[:, axis] ** k / w.sum() for k in range(7)]
            np.testing.assert_allclose(moments[:6], [1, 0, 1 / 3, 0, 1 / 5, 0], atol=1e-15)
            assert abs(moments[6] - 1 / 7) > 0.01
