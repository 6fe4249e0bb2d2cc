"""Against FElupe, an independent code: forces of one distorted element, a whole finger, and one that is
free of stress where it is curved, under pressure."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material, Path, finger_case, solve
from fe.element import HEX27, Array
from fe.engines.engine import Embedded
from fe.kernel.assembly import ElementConstants, Kernel, State
from fe.mesh.convert import converted

felupe = pytest.importorskip("felupe")

from tests.fe.felupe_model import ORDER, MooneyRivlin, solved  # noqa: E402


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
    kernel, c = Kernel(case), ElementConstants.of(case)
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


@dataclass(frozen=True)
class Grown:
    """FElupe's law of Fe = F Fg^-1, where Fg^-1 (3, q, e) is diagonal and of volume 1."""

    law: Any
    inverse: Array

    @property
    def x(self) -> Any:
        return self.law.x

    def gradient(self, x: Any) -> Any:
        P, *rest = self.law.gradient([x[0] * self.inverse, *x[1:]])
        return [P * self.inverse, *rest]

    def hessian(self, x: Any) -> Any:
        (A,) = self.law.hessian([x[0] * self.inverse, *x[1:]])
        return [A * self.inverse[:, None, None] * self.inverse]


def curved(case: Case, pressure: float, curvature: float) -> Array:
    """FElupe's displacements (n, 3) mm of a neo-Hookean half finger of C3D20R, the eigenstrain by hand."""
    mesh = felupe.Mesh(case.nodes, case.connectivity, "hexahedron20")
    region = felupe.RegionQuadraticHexahedron(mesh, quadrature=felupe.GaussLegendre(order=1, dim=3))
    field = felupe.FieldContainer([felupe.Field(region, dim=3)])
    z = felupe.Field(region, dim=3, values=case.nodes).interpolate()[2]
    stretch = 1 + curvature * (z - (region.dV * z).sum() / region.dV.sum())
    inverse = np.stack([1 / stretch, np.sqrt(stretch), np.sqrt(stretch)])
    material = case.materials["body"]
    solid = felupe.SolidBody(Grown(felupe.NeoHooke(mu=material.shear, bulk=material.bulk), inverse), field)

    def on(rows: Array) -> Array:
        return np.isin(np.arange(len(case.nodes)), rows)

    assert case.pressurised
    assert case.clamp
    chamber = felupe.RegionQuadraticHexahedronBoundary(
        mesh,
        mask=on(case.face_nodes(case.pressurised)),
        quadrature=felupe.GaussLegendreBoundary(order=1, dim=3),
    )
    push = felupe.SolidBodyPressure(felupe.FieldContainer([felupe.Field(chamber, dim=3)]))
    held = {
        "clamp": felupe.Boundary(field[0], mask=on(case.node_sets[case.clamp.nodes])),
        "symmetry": felupe.Boundary(field[0], mask=on(case.node_sets["symmetry"]), skip=(1, 0, 1)),
    }
    ramp = {push: pressure * np.linspace(0, 1, 4)}
    felupe.Job(steps=[felupe.Step([solid, push], ramp=ramp, boundaries=held)]).evaluate(verbose=0, tol=1e-7)
    return np.asarray(field[0].values, float)


def test_a_curved_finger_under_pressure_against_felupe(short_finger: Finger) -> None:
    # displacements alone carry FElupe's volume, which Newton's method follows up to some 100 mu
    soft, lattice = Material(C10=0.297, bulk_ratio=50.0), Lattice(per_bellow=1, ring=False, centred=False)
    case = converted(finger_case(soft, finger=short_finger, lattice=lattice), "C3D20R")
    bare, ours = (Embedded().solve(replace(case, precurvature=k), 0.015) for k in (0.0, 1e-3))
    theirs = curved(case, 0.015, 1e-3)
    effect = np.abs(ours.u - bare.u).max()
    assert effect > 0.5  # mm
    # both are converged far below this: the same mesh, quadrature and law
    assert np.abs(ours.u - theirs).max() < 1e-6 * effect
