"""Consistent mass of a structure, and of what is attached to it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from fe.case import Case
from fe.element import Array, Element, gauss
from fe.mesh.mirror import symmetry_support
from fe.solver.loadings import spread


@dataclass(frozen=True)
class Attached:
    """A mass in tonne fixed to a material point `place` (3,) mm, undeformed: a marker, a weight.

    way (3,): direction along which alone it moves with the structure, of any length; None for all. A weight
    that hangs on a long thread follows along the thread and stays behind across it.
    """

    place: Array
    mass: float
    way: Array | None = None


def rule(element: Element) -> tuple[Array, Array]:
    """Points (k, 3) and weights (k,) that integrate products of an element's shape functions exactly where
    its edges are straight.

    The rule of the stiffness is too coarse for them in C3D20R and C3D10: the mass would be singular. In
    tetrahedra it is the conical product of Gauss rules (Stroud 1971, Approximate Calculation of Multiple
    Integrals).

    >>> from fe.element import ELEMENTS
    >>> round(float(rule(ELEMENTS["C3D10"])[1].sum()), 12)
    0.166666666667
    """
    if not element.simplex:
        return gauss(3, 3)
    points, weights = gauss(3, 4)
    a, b, c = ((points + 1) / 2).T
    return np.stack([a, (1 - a) * b, (1 - a) * (1 - b) * c], 1), weights / 8 * (1 - a) ** 2 * (1 - b)


def element_masses(case: Case) -> Array:
    """Masses (e, m, m) in tonne between the m nodes of every element, the same along x, y and z: the integral
    of density N_a N_b. ValueError for densities that are not positive."""
    density = case.per_element("density")
    if not (density > 0).all():
        name = next(k for k, m in case.materials.items() if not m.density > 0)
        raise ValueError(
            f"density of {name!r} {case.materials[name].density:g} tonne/mm3: wanted a positive one, as "
            "vibrations need the mass; state it (silicone has about 1.07e-9)"
        )
    points, weights = rule(case.element)
    N, dN = case.element.shape(points)
    jacobian = np.einsum("eai,qaJ->eqiJ", case.nodes[case.connectivity], dN, optimize=True)
    weight = density[:, None] * np.linalg.det(jacobian) * weights
    return np.asarray(np.einsum("eq,qa,qb->eab", weight, N, N, optimize=True))


def mass_matrix(
    case: Case, attached: Sequence[Attached] = (), *, components: Sequence[int] = (0, 1, 2)
) -> sp.csr_matrix:
    """Consistent mass (3 n, 3 n) in tonne: the integral of density N_a N_b over the volume at rest, and what
    is attached.

    The mass of a volume does not change as it deforms, so that one matrix serves every state; it has no
    entries for pressure modes. components: directions in which an attached mass moves. In a half model an
    attached mass lies on the plane of symmetry, and half of it counts. ValueError for densities that are not
    positive, and for an attached place that `fe.solver.loadings.spread` refuses.
    """
    block, rows, size = element_masses(case), case.connectivity, len(case.nodes)
    r, c = np.broadcast_arrays(rows[:, :, None], rows[:, None])
    nodal = sp.csr_matrix((block.ravel(), (r.ravel(), c.ravel())), shape=(size, size))
    out = sp.kron(nodal, sp.eye(3), format="csr")
    for one in attached:
        out = out + _of_attached(case, one, components)
    return sp.csr_matrix(out)


def _of_attached(case: Case, one: Attached, components: Sequence[int]) -> sp.csr_matrix:
    """Mass (3 n, 3 n) in tonne of a mass that moves as the mean of the nodes around its place."""
    nodes, share = spread(case, np.asarray(one.place, float)), 1.0 if symmetry_support(case) is None else 0.5
    mean = nodes.parts / nodes.parts.sum()
    ways = np.eye(3) if one.way is None else np.atleast_2d(one.way) / np.linalg.norm(one.way)
    moving = np.zeros(3)
    moving[list(components)] = 1.0
    out = sp.csr_matrix((3 * len(case.nodes),) * 2)
    for way in ways * moving:
        columns = (3 * nodes.rows[:, None] + np.arange(3)).ravel()
        values = (mean[:, None] * way).ravel()
        row = sp.csr_matrix((values, (np.zeros_like(columns), columns)), shape=(1, out.shape[0]))
        out = out + share * one.mass * (row.T @ row)
    return out
