"""Against FElupe, an independent code: condensed forces of one distorted element, and a whole finger."""

import sys
from collections.abc import Callable
from pathlib import Path as File

import numpy as np
import pytest

from fe import Case, Material, Path, solve
from fe.assembly import Constants, Kernel, State
from fe.convert import converted
from fe.element import HEX27

felupe = pytest.importorskip("felupe")
sys.path.append(str(File(__file__).resolve().parents[2] / "benchmarks"))

from felupe_model import ORDER, MooneyRivlin, solved  # noqa: E402


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
    P = MooneyRivlin(material).gradient([F, None])[0]
    P = P + q * J * felupe.math.transpose(felupe.math.inv(F))
    theirs = felupe.IntegralForm([P], field, region.dV).assemble().toarray().reshape(-1, 3)
    kernel, c = Kernel(case), Constants.of(case)
    none = State(u, np.zeros((1, 4)))
    _, gap = kernel.residual(none, c, 0.0, None, kernel.geometry)
    p = (np.linalg.inv(kernel.geometry.mass / material.bulk) @ gap[..., None])[..., 0]
    ours, _ = kernel.residual(State(u, p), c, 0.0, None, kernel.geometry)
    assert np.abs(ours).max() > 0.01  # N
    np.testing.assert_allclose(ours, theirs, atol=1e-10)


def test_a_finger_against_felupe(short: Case) -> None:
    # the same discrete problem: three fields whose volume ratio and pressure are constant in each element
    case, pressure = converted(short, "C3D8"), 0.02
    ours = solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, pressure]), np.array([1.0])))
    theirs = solved(case, pressure, steps=4)
    assert np.abs(theirs.u).max() > 1.0  # mm
    # Newton's last correction is below 1e-7 of the size of 43 mm, and what it leaves its square
    np.testing.assert_allclose(ours.fields([0])[0], theirs.u, atol=1e-8)
