"""A case -> its displacements by FElupe, a code of other people: a witness for tests.

Displacement, pressure and volume ratio are three fields, the last two of each element's own: constant in
C3D8, tri-linear (eight modes) in hex27, where this project's kernel has four.
"""

import time
from dataclasses import dataclass

import felupe
import numpy as np

from fe import Case, Material
from fe.element import Array, Integers

try:
    from pypardiso import spsolve
except ImportError:  # MKL is not available on this platform
    from scipy.sparse.linalg import spsolve

NAMES = {"hex27": "hexahedron27", "C3D8": "hexahedron"}
# FElupe's local order of hex27: from the points of its own element
ORDER = np.array([1, 3, 9]) @ (np.array(felupe.TriQuadraticHexahedron().points, int).T + 1)
CLOSE = 1e-9  # residual over reactions


@dataclass(frozen=True)
class Found:
    """Displacements (n, 3) mm, Newton's iterations, and seconds."""

    u: Array
    iterations: int
    seconds: float


class MooneyRivlin(felupe.ConstitutiveMaterial):  # type: ignore[misc]
    """C10 (J^-2/3 I1 - 3) by FElupe's own law, and C01 (J^-4/3 I2 - 3), which it has not in closed form.

    With a = F^-T, g = dI2/dF = 2 (I1 F - F C) and j = J^-4/3: P = C01 j (g - 4/3 I2 a).
    """

    def __init__(self, material: Material) -> None:
        self.first = felupe.NeoHooke(mu=2 * material.C10, bulk=0.0)
        self.C01, self.x = material.C01, [np.eye(3), np.zeros(0)]

    def _kinematics(self, F: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
        a = np.asarray(felupe.math.transpose(felupe.math.inv(F)))
        C = np.einsum("kiqe,kjqe->ijqe", F, F)
        I1 = np.trace(C)
        I2 = (I1**2 - (C**2).sum((0, 1))) / 2
        g = 2 * (I1 * F - np.einsum("ikqe,kjqe->ijqe", F, C))
        return a, C, I1, I2, g, self.C01 * felupe.math.det(F) ** (-4 / 3)

    def gradient(self, x: list[Array]) -> list[Array]:
        """First Piola-Kirchhoff stress (3, 3, q, e) MPa."""
        a, _, _, I2, g, j = self._kinematics(x[0])
        return [self.first.gradient([x[0], None])[0] + j * (g - 4 / 3 * I2 * a), x[-1]]

    def hessian(self, x: list[Array]) -> list[Array]:
        """Its derivative (3, 3, 3, 3, q, e) to F, MPa."""
        F, one = x[0], np.eye(3)
        a, C, I1, I2, g, j = self._kinematics(F)

        def product(form: str, *parts: Array) -> Array:
            return np.asarray(np.einsum(form, *parts, optimize=True))

        dg = 4 * product("iJqe,kLqe->iJkLqe", F, F) - 2 * product("iLqe,kJqe->iJkLqe", F, F)
        b = product("iMqe,kMqe->ikqe", F, F)
        dg -= 2 * product("ik,LJqe->iJkLqe", one, C) + 2 * product("ikqe,JL->iJkLqe", b, one)
        dg += 2 * I1 * product("ik,JL->iJkL", one, one)[..., None, None]
        ag = product("iJqe,kLqe->iJkLqe", a, g)
        A = dg - 4 / 3 * (ag + product("iJkLqe->kLiJqe", ag))
        A += 16 / 9 * I2 * product("iJqe,kLqe->iJkLqe", a, a)
        A += 4 / 3 * I2 * product("iLqe,kJqe->iJkLqe", a, a)
        return [self.first.hessian([F, None])[0] + j * A]


def solved(case: Case, pressure: float, *, steps: int = 8) -> Found:
    """The displacements of a case of one material, held at zero, under a follower pressure in MPa that is put
    on in equal steps. ValueError where FElupe's Newton's method does not converge."""
    (material,) = case.materials.values()
    kind, quadratic = NAMES[case.element.name], case.element.name == "hex27"
    cells = case.connectivity[:, ORDER] if quadratic else case.connectivity
    mesh = felupe.Mesh(case.nodes, cells, kind)
    region = (felupe.RegionTriQuadraticHexahedron if quadratic else felupe.RegionHexahedron)(mesh)
    around = felupe.RegionTriQuadraticHexahedronBoundary if quadratic else felupe.RegionHexahedronBoundary
    field = felupe.FieldsMixed(region, n=3)
    solid = felupe.SolidBody(felupe.NearlyIncompressible(MooneyRivlin(material), bulk=material.bulk), field)
    inner = np.isin(np.arange(len(case.nodes)), case.face_nodes(str(case.pressurised)))
    load = felupe.SolidBodyPressure(felupe.FieldContainer([felupe.Field(around(mesh, mask=inner), dim=3)]))
    fixed = held(case)
    free = np.setdiff1d(np.arange(sum(field.fieldsizes)), fixed)
    count, start = 0, time.perf_counter()
    for part in np.linspace(0, pressure, steps + 1)[1:]:
        load.update(part)
        found = felupe.newtonraphson(
            field, items=[solid, load], dof0=fixed, dof1=free, ext0=np.zeros(len(fixed)),
            solver=spsolve, verbose=0, tol=CLOSE, maxiter=20,
        )  # fmt: skip
        field, count = found.x, count + found.iterations
    return Found(np.asarray(field[0].values), count, time.perf_counter() - start)


def held(case: Case) -> Integers:
    """The numbers of the degrees of freedom that a case holds at zero."""
    flags = np.zeros((len(case.nodes), 3), bool)
    if case.clamp:
        flags[case.node_sets[case.clamp.nodes]] = True
    for s in case.supports:
        flags[np.ix_(case.node_sets[s.nodes], np.array(s.components))] = True
    return np.flatnonzero(flags)
