"""One distorted element against FElupe, an independent code: the condensed nodal forces at a random state."""

from collections.abc import Callable

import numpy as np
import pytest

from fe import Case, Material
from fe.assembly import Constants, Kernel, State
from fe.element import HEX27, Array

felupe = pytest.importorskip("felupe")

# FElupe's local order of the 27 nodes, from its own element's points
ORDER = np.array([1, 3, 9]) @ (np.array(felupe.TriQuadraticHexahedron().points, int).T + 1)


def transposed_inverse(F: Array) -> Array:
    """F^-T for F (3, 3, q, e)."""
    return felupe.math.transpose(felupe.math.inv(F))


def rivlin(F: Array, J: Array, C01: float) -> Array:
    """FElupe has no closed-form C01 term: P = tau F^-T, tau = dev 2 C01 (I1 b - b b) with the isochoric b."""
    b = felupe.math.dot(F, felupe.math.transpose(F)) * J ** (-2 / 3)
    tau = 2 * C01 * (felupe.math.trace(b) * b - felupe.math.dot(b, b))
    return felupe.math.dot(felupe.math.dev(tau), transposed_inverse(F))


def test_one_element_against_felupe(cube: Callable[..., Case]) -> None:
    material = Material(C10=0.2, C01=0.1, bulk_ratio=50.0)
    case = cube((1, 1, 1), shift=0.12, seed=30, material=material)
    rng = np.random.default_rng(31)
    u = rng.uniform(-0.06, 0.06, case.nodes.shape)
    cells = case.connectivity[:, ORDER]
    mesh = felupe.Mesh(case.nodes, cells, "hexahedron27")
    rule = felupe.GaussLegendre(order=2, dim=3)
    region = felupe.Region(mesh, felupe.TriQuadraticHexahedron(), rule)
    field = felupe.FieldContainer([felupe.Field(region, dim=3, values=u.copy())])
    F = field.extract()[0]  # (3, 3, q, e)
    J = felupe.math.det(F)
    # the pressure, projected on 1, x, y, z by FElupe's volumes: q = sum psi (int psi psi)^-1 int K (J - 1)
    # psi
    dV = region.dV[:, 0]
    N = HEX27.shape(rule.points)[0]
    x = N @ case.nodes[case.connectivity[0]]
    psi = np.concatenate([np.ones((len(x), 1)), x], axis=1)
    modes = np.linalg.solve(psi.T @ (dV[:, None] * psi), psi.T @ (dV * material.bulk * (J[:, 0] - 1)))
    q = (psi @ modes)[:, None]
    neo_hooke = felupe.NeoHooke(mu=2 * material.C10, bulk=0.0).gradient([F, None])[0]
    P = neo_hooke + rivlin(F, J, material.C01) + q * J * transposed_inverse(F)
    theirs = felupe.IntegralForm([P], field, region.dV).assemble().toarray().reshape(-1, 3)
    kernel, c = Kernel(case), Constants.of(case)
    none = State(u, np.zeros((1, 4)))
    _, gap = kernel.residual(none, c, 0.0, None, kernel.geometry)
    p = (np.linalg.inv(kernel.geometry.mass / material.bulk) @ gap[..., None])[..., 0]
    ours, _ = kernel.residual(State(u, p), c, 0.0, None, kernel.geometry)
    assert np.abs(ours).max() > 0.01  # N
    np.testing.assert_allclose(ours, theirs, atol=1e-10)
