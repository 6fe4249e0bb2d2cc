"""Element loops over quadrature points, compiled to machine code by numba.

A mesh has e elements of n nodes, q quadrature points and m pressure modes. Every loop runs over the elements
begin .. end - 1 and fills its output arrays; the law at a point is `fe.terms`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fe.element import Array, Flags, Integers
from fe.terms import (
    OGDEN,
    PAIRS,
    Point,
    energy,
    in_invariants,
    invariants,
    machine_code,
    new_point,
    ogden,
    part,
    softened,
    tangent,
)  # fmt: skip


class MeshArrays(NamedTuple):
    """Gradients G (e, q, 3, n) per mm; rest (e, q, 3, 3), F - 1 at zero displacement, empty without a
    precurvature; weights w (e, q) mm3; pressure modes psi (e, q, m); connectivity (e, n)."""

    G: Array
    rest: Array
    w: Array
    psi: Array
    connectivity: Integers


class Law(NamedTuple):
    """Constants c (e, k) of `Material.constants` and bulk moduli (e,) MPa."""

    c: Array
    bulk: Array


class FieldArrays(NamedTuple):
    """Displacements u (n, 3) mm and pressure modes p (e, m) MPa."""

    u: Array
    p: Array


class Changes(NamedTuple):
    """Changes of displacements u (v, n, 3) mm and of pressure modes p (v, e, m) MPa."""

    u: Array
    p: Array


class PointTangents(NamedTuple):
    """Tangents A (e, q, 6, 3, 3) MPa of the PAIRS of components, history stress included; volume (e, q, 3,
    3): derivative of J by F."""

    A: Array
    volume: Array


class HistoryArrays(NamedTuple):
    """Memory of a material: scale (e,) and history stress (e or 1, q, 3, 3) MPa. With Mullins softening, else
    empty: soft (e, 3) of amount, m, beta; peak (e, q), the largest energy so far; sides (e, q), where given,
    true on the unloading branch."""

    scale: Array
    stress: Array
    soft: Array
    peak: Array
    sides: Flags


class Balance(NamedTuple):
    """Element forces (e, n, 3) N and volume gaps (e, m) mm3."""

    force: Array
    gap: Array


class Tangent(NamedTuple):
    """Output arrays of a tangent.

    compliance (e, m, m) eliminates the pressure modes. coupling B (e, n, 3, m). The blocks (n, 6, n) of the
    PAIRS are added to `data` at their `places` (e, n, 6, n), diagonal ones by half; blocks of elements with
    slots (e,) >= 0 are stored in kept (k, n, 6, n).
    """

    compliance: Array
    coupling: Array
    places: NDArray[np.int32]
    data: Array
    slots: Integers
    kept: Array


class Work(NamedTuple):
    """Scratch of one element: flux (q, 3, 3), spread (q, 3, 3, m) and T (q, 3, 6, n) at its points, the
    tangent A (6, 3, 3) at a single point, and the blocks K (n, 6, n)."""

    flux: Array
    spread: Array
    T: Array
    A: Array
    K: Array


@part
def _deformed(G: Array, u: Array, rest: Array, e: int, q: int, F: Array) -> None:
    """F (3, 3) at one point from its gradients (3, n) and the element's displacements u (3, n)."""
    for i in range(3):
        for k in range(3):
            value = 0.0
            for a in range(G.shape[1]):
                value += u[i, a] * G[k, a]
            F[i, k] = value + (1.0 if i == k else 0.0)
    if len(rest) > 0:
        for i in range(3):
            for k in range(3):
                F[i, k] += rest[e, q, i, k]


@part
def _gathered(u: Array, nodes: Integers, out: Array) -> None:
    """The element's displacements, out (3, n)."""
    for a in range(len(nodes)):
        for i in range(3):
            out[i, a] = u[nodes[a], i]


@part
def _pressure(psi: Array, p: Array) -> float:
    value = 0.0
    for k in range(len(psi)):
        value += psi[k] * p[k]
    return value


@part
def _drop(past: HistoryArrays, W: float, e: int, q: int) -> tuple[float, float]:
    """Reduction of the stress scale by softening at a point of energy W, and its slope by W."""
    side = int(past.sides[e, q]) if len(past.sides) > 0 else -1
    return softened(W, past.soft[e], past.peak[e, q], side)


@part
def _total(point: Point, pressure: float, scale: float, S: Array) -> None:
    """P becomes scale P + F S + pressure a."""
    P, F, a = point.P, point.F, point.a
    for i in range(3):
        for k in range(3):
            FS = F[i, 0] * S[0, k] + F[i, 1] * S[1, k] + F[i, 2] * S[2, k]
            P[i, k] = scale * P[i, k] + FS + pressure * a[i, k]


@machine_code
def isochoric(mesh: MeshArrays, u: Array, c: Array, begin: int, end: int, S: Array) -> None:
    """Isochoric second Piola-Kirchhoff stress S (e, q, 3, 3) MPa at displacements u (n, 3) mm."""
    ue, point, none = np.empty((3, mesh.connectivity.shape[1])), new_point(), np.empty((0, 3, 3))
    a, P = point.a, point.P
    for e in range(begin, end):
        _gathered(u, mesh.connectivity[e], ue)
        for q in range(mesh.G.shape[1]):
            _deformed(mesh.G[e, q], ue, mesh.rest, e, q, point.F)
            J, I1, I2 = invariants(point)
            in_invariants(point, J, I1, I2, c[e])
            if c.shape[1] > OGDEN:
                ogden(point, J, 1.0, c[e], none)
            for i in range(3):
                for k in range(3):
                    S[e, q, i, k] = a[0, i] * P[0, k] + a[1, i] * P[1, k] + a[2, i] * P[2, k]


@machine_code
def isochoric_changes(
    mesh: MeshArrays, u: Array, c: Array, du: Array, begin: int, end: int, dS: Array, dW: Array
) -> None:
    """Changes of the isochoric stress dS (v, e, q, 3, 3) MPa and of the energy dW (v, e, q) of the law at
    displacements u (n, 3) mm, along changes du (v, n, 3) mm of them."""
    n = mesh.connectivity.shape[1]
    ue, de, point = np.empty((3, n)), np.empty((len(du), 3, n)), new_point()
    A, S, H, dP = np.empty((6, 3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    F, a, P = point.F, point.a, point.P
    for e in range(begin, end):
        _gathered(u, mesh.connectivity[e], ue)
        for v in range(len(du)):
            _gathered(du[v], mesh.connectivity[e], de[v])
        for q in range(mesh.G.shape[1]):
            G = mesh.G[e, q]
            _deformed(G, ue, mesh.rest, e, q, F)
            J, I1, I2 = invariants(point)
            w1, w2, w11 = in_invariants(point, J, I1, I2, c[e])
            tangent(point, I1, I2, w1, w2, w11, 0.0, A)
            if c.shape[1] > OGDEN:
                ogden(point, J, 1.0, c[e], A)
            for i in range(3):
                for k in range(3):
                    S[i, k] = a[0, i] * P[0, k] + a[1, i] * P[1, k] + a[2, i] * P[2, k]
            for v in range(len(du)):
                work = 0.0
                for i in range(3):
                    for k in range(3):
                        value = 0.0
                        for b in range(n):
                            value += de[v, i, b] * G[k, b]
                        H[i, k] = value
                        work += P[i, k] * value
                dW[v, e, q] = work
                for i in range(3):
                    for k in range(3):
                        dP[i, k] = -(H[i, 0] * S[0, k] + H[i, 1] * S[1, k] + H[i, 2] * S[2, k])
                for pair in range(6):
                    i, j = PAIRS[pair]
                    for k in range(3):
                        for m in range(3):
                            dP[i, k] += A[pair, k, m] * H[j, m]
                            if i != j:
                                dP[j, m] += A[pair, k, m] * H[i, k]
                for i in range(3):
                    for k in range(3):
                        dS[v, e, q, i, k] = a[0, i] * dP[0, k] + a[1, i] * dP[1, k] + a[2, i] * dP[2, k]


@machine_code
def history_stress(terms: Array, now: Array, decay: Array, viscous: Array, out: Array) -> None:
    """Fill out (e, k): the sum of the decayed Prony terms (m, e, k), less `viscous` (e,) times the last
    stress now (e, k)."""
    for e in range(len(out)):
        for k in range(out.shape[1]):
            value = -viscous[e] * now[e, k]
            for m in range(len(terms)):
                value += decay[m, e] * terms[m, e, k]
            out[e, k] = value


@machine_code
def relaxed(terms: Array, now: Array, stress: Array, decay: Array, weight: Array, out: Array) -> None:
    """Fill out (m, e, k), the Prony terms after a step: decayed terms (m, e, k), plus `weight` (m, e) times
    the stress increment, stress - now (e, k)."""
    for m in range(len(out)):
        for e in range(out.shape[1]):
            for k in range(out.shape[2]):
                out[m, e, k] = decay[m, e] * terms[m, e, k] + weight[m, e] * (stress[e, k] - now[e, k])


@machine_code
def energies(mesh: MeshArrays, u: Array, c: Array, begin: int, end: int, W: Array) -> None:
    """Isochoric energy W (e, q) N mm/mm3 of the law at displacements u (n, 3) mm."""
    ue, point = np.empty((3, mesh.connectivity.shape[1])), new_point()
    for e in range(begin, end):
        _gathered(u, mesh.connectivity[e], ue)
        for q in range(mesh.G.shape[1]):
            _deformed(mesh.G[e, q], ue, mesh.rest, e, q, point.F)
            J, I1, I2 = invariants(point)
            W[e, q] = energy(point, J, I1, I2, c[e])


@machine_code
def internal(mesh: MeshArrays, u: Array, S: Array, begin: int, end: int, force: Array) -> None:
    """Element forces (e, n, 3) N of a second Piola-Kirchhoff stress S (e, q, 3, 3) MPa."""
    points, n = mesh.G.shape[1], mesh.G.shape[3]
    ue, F, flux = np.empty((3, n)), np.empty((3, 3)), np.empty((points, 3, 3))
    for e in range(begin, end):
        _gathered(u, mesh.connectivity[e], ue)
        for q in range(points):
            _deformed(mesh.G[e, q], ue, mesh.rest, e, q, F)
            for i in range(3):
                for k in range(3):
                    FS = F[i, 0] * S[e, q, 0, k] + F[i, 1] * S[e, q, 1, k] + F[i, 2] * S[e, q, 2, k]
                    flux[q, k, i] = mesh.w[e, q] * FS
        np.dot(mesh.G[e].reshape(3 * points, n).T, flux.reshape(3 * points, 3), force[e])


@machine_code
def residual(
    mesh: MeshArrays, law: Law, fields: FieldArrays, past: HistoryArrays, begin: int, end: int, out: Balance
) -> None:
    """Fill the element forces and volume gaps."""
    points, n, modes = mesh.G.shape[1], mesh.G.shape[3], mesh.psi.shape[2]
    ue, point, flux = np.empty((3, n)), new_point(), np.empty((points, 3, 3))
    none = np.empty((0, 3, 3))
    for e in range(begin, end):
        _gathered(fields.u, mesh.connectivity[e], ue)
        for k in range(modes):
            out.gap[e, k] = 0.0
        for q in range(points):
            _deformed(mesh.G[e, q], ue, mesh.rest, e, q, point.F)
            J, I1, I2 = invariants(point)
            in_invariants(point, J, I1, I2, law.c[e])
            if law.c.shape[1] > OGDEN:
                ogden(point, J, 1.0, law.c[e], none)
            s, w, pressure = past.scale[e], mesh.w[e, q], _pressure(mesh.psi[e, q], fields.p[e])
            if len(past.soft) > 0:
                s -= _drop(past, energy(point, J, I1, I2, law.c[e]), e, q)[0]
            _total(point, J * pressure, s, past.stress[e % len(past.stress), q])
            for k in range(modes):
                out.gap[e, k] += w * (J - 1.0 - pressure / law.bulk[e]) * mesh.psi[e, q, k]
            for i in range(3):
                for k in range(3):
                    flux[q, k, i] = w * point.P[i, k]
        np.dot(mesh.G[e].reshape(3 * points, n).T, flux.reshape(3 * points, 3), out.force[e])


@machine_code
def _stiffened(P: Array, slope: float, A: Array) -> None:
    """Add the softening term of the tangent A (6, 3, 3): `slope` of the scale by the energy, times the dyad
    of P, the gradient of the energy."""
    for pair in range(6):
        i, j = PAIRS[pair]
        for p in range(3):
            for q in range(3):
                A[pair, p, q] += slope * P[i, p] * P[j, q]


@part
def _stiffness_at(
    law: Law, past: HistoryArrays, point: Point, pressure: float, e: int, q: int, A: Array
) -> float:
    """J at one point; fills its stress, and the tangent A (6, 3, 3) without the history stress."""
    c = law.c[e]
    J, I1, I2 = invariants(point)
    w1, w2, w11 = in_invariants(point, J, I1, I2, c)
    s, slope = past.scale[e], 0.0
    if len(past.soft) > 0:
        drop, slope = _drop(past, energy(point, J, I1, I2, c), e, q)
        s -= drop
    tangent(point, I1, I2, s * w1, s * w2, s * w11, J * pressure, A)
    if len(c) > OGDEN:
        ogden(point, J, s, c, A)
    if slope != 0.0:
        _stiffened(point.P, slope, A)
    _total(point, J * pressure, s, past.stress[e % len(past.stress), q])
    return J


@part
def _spread(mesh: MeshArrays, point: Point, S: Array, J: float, e: int, q: int, work: Work) -> None:
    """Puts a point's stress, volume gradient and tangent, with the history stress S (3, 3), into an element's
    scratch."""
    w, G, A = mesh.w[e, q], mesh.G[e, q], work.A
    for i in range(3):
        for k in range(3):
            work.flux[q, k, i] = w * point.P[i, k]
            for r in range(mesh.psi.shape[2]):
                work.spread[q, k, i, r] = w * J * point.a[i, k] * mesh.psi[e, q, r]
    for k in range(3):
        for pair in range(6):
            same = w if pair < 3 else 0.0  # the history stress couples a component with itself
            t0 = w * A[pair, k, 0] + same * S[k, 0]
            t1 = w * A[pair, k, 1] + same * S[k, 1]
            t2 = w * A[pair, k, 2] + same * S[k, 2]
            for b in range(G.shape[1]):
                work.T[q, k, pair, b] = t0 * G[0, b] + t1 * G[1, b] + t2 * G[2, b]


@part
def _condense(C: Array, B: Array, gap: Array, force: Array) -> None:
    """Add the eliminated pressure modes, of compliance C (m, m), to an element's force (n, 3)."""
    modes = len(gap)
    for r in range(modes):
        eliminated = 0.0
        for k in range(modes):
            eliminated += C[r, k] * gap[k]
        for b in range(len(force)):
            for j in range(3):
                force[b, j] += B[b, j, r] * eliminated


@part
def _assemble(e: int, out: Tangent, rows: Array, CB: Array, K: Array) -> None:
    """Eliminate an element's modes from its blocks K (n, 6, n) and add them to the matrix; rows (3, m, n) and
    CB (3, m) are scratch."""
    B, C, stored = out.coupling[e], out.compliance[e], out.slots[e] >= 0
    n, modes = len(B), len(C)
    for b in range(n):
        for j in range(3):
            for r in range(modes):
                rows[j, r, b] = B[b, j, r]
    for d in range(n):
        for i in range(3):
            for r in range(modes):
                value = 0.0
                for k in range(modes):
                    value += B[d, i, k] * C[k, r]
                CB[i, r] = value
        for pair in range(6):
            i, j = PAIRS[pair]
            half = d if pair < 3 else 0
            start = 0 if stored else half
            if modes == 4:  # at once, or the row is read and written four times
                x0, x1, x2, x3 = CB[i, 0], CB[i, 1], CB[i, 2], CB[i, 3]
                for b in range(start, n):
                    K[d, pair, b] += (
                        x0 * rows[j, 0, b] + x1 * rows[j, 1, b] + x2 * rows[j, 2, b] + x3 * rows[j, 3, b]
                    )
            else:
                for r in range(modes):
                    for b in range(start, n):
                        K[d, pair, b] += CB[i, r] * rows[j, r, b]
            for b in range(half, n):
                out.data[out.places[e, d, pair, b]] += K[d, pair, b]
    if stored:  # one by one: for an array set as a whole numba compiles seconds more, its error messages
        slot = out.slots[e]
        for d in range(n):
            for pair in range(6):
                for b in range(n):
                    out.kept[slot, d, pair, b] = K[d, pair, b]


@machine_code
def linearise(
    mesh: MeshArrays, law: Law, fields: FieldArrays, past: HistoryArrays,
    begin: int, end: int, out: Balance, to: Tangent,
) -> None:
    """Fill the condensed element forces, the volume gaps and the tangent."""
    points, n, modes = mesh.G.shape[1], mesh.G.shape[3], mesh.psi.shape[2]
    ue, point, rows, CB = np.empty((3, n)), new_point(), np.empty((3, modes, n)), np.empty((3, modes))
    work = Work(
        np.empty((points, 3, 3)), np.empty((points, 3, 3, modes)), np.empty((points, 3, 6, n)),
        np.empty((6, 3, 3)), np.empty((n, 6, n)),
    )  # fmt: skip
    for e in range(begin, end):
        _gathered(fields.u, mesh.connectivity[e], ue)
        for k in range(modes):
            out.gap[e, k] = 0.0
        for q in range(points):
            pressure = _pressure(mesh.psi[e, q], fields.p[e])
            _deformed(mesh.G[e, q], ue, mesh.rest, e, q, point.F)
            J = _stiffness_at(law, past, point, pressure, e, q, work.A)
            for k in range(modes):
                out.gap[e, k] += mesh.w[e, q] * (J - 1.0 - pressure / law.bulk[e]) * mesh.psi[e, q, k]
            _spread(mesh, point, past.stress[e % len(past.stress), q], J, e, q, work)
        G = mesh.G[e].reshape(3 * points, n).T
        np.dot(G, work.flux.reshape(3 * points, 3), out.force[e])
        np.dot(G, work.T.reshape(3 * points, 6 * n), work.K.reshape(n, 6 * n))
        np.dot(G, work.spread.reshape(3 * points, 3 * modes), to.coupling[e].reshape(n, 3 * modes))
        _condense(to.compliance[e], to.coupling[e], out.gap[e], out.force[e])
        _assemble(e, to, rows, CB, work.K)


@machine_code
def at_points(
    mesh: MeshArrays, law: Law, fields: FieldArrays, past: HistoryArrays, begin: int, end: int,
    out: PointTangents,
) -> None:
    """Fills the tangents of points."""
    ue, point = np.empty((3, mesh.connectivity.shape[1])), new_point()
    for e in range(begin, end):
        _gathered(fields.u, mesh.connectivity[e], ue)
        for q in range(mesh.G.shape[1]):
            pressure, S = _pressure(mesh.psi[e, q], fields.p[e]), past.stress[e % len(past.stress), q]
            _deformed(mesh.G[e, q], ue, mesh.rest, e, q, point.F)
            J = _stiffness_at(law, past, point, pressure, e, q, out.A[e, q])
            for i in range(3):
                for k in range(3):
                    out.volume[e, q, i, k] = J * point.a[i, k]
                    for pair in range(3):  # the history stress couples a component with itself
                        out.A[e, q, pair, i, k] += S[i, k]


@machine_code
def along(
    mesh: MeshArrays, bulk: Array, tangents: PointTangents, change: Changes,
    begin: int, end: int, out: Balance,
) -> None:
    """Fill force (e, n, 3 v) and gap (v, e, m), the directional derivatives of the balance along v changes.
    """
    points, n, modes, count = mesh.G.shape[1], mesh.G.shape[3], mesh.psi.shape[2], len(change.u)
    de, flux, dP = np.empty((n, 3 * count)), np.empty((3 * points, 3 * count)), np.empty((3, 3))
    for e in range(begin, end):
        for v in range(count):
            for r in range(modes):
                out.gap[v, e, r] = 0.0
            for b in range(n):
                for i in range(3):
                    de[b, 3 * v + i] = change.u[v, mesh.connectivity[e, b], i]
        G = mesh.G[e].reshape(3 * points, n)
        H = np.dot(G, de)  # dF, of component i along k in row 3 q + k, column 3 v + i
        for q in range(points):
            w, psi, A, Ja = mesh.w[e, q], mesh.psi[e, q], tangents.A[e, q], tangents.volume[e, q]
            for v in range(count):
                rise, volume = _pressure(psi, change.p[v, e]), 0.0
                for i in range(3):
                    for k in range(3):
                        dP[i, k] = Ja[i, k] * rise
                        volume += Ja[i, k] * H[3 * q + k, 3 * v + i]
                for pair in range(6):
                    i, j = PAIRS[pair]
                    for k in range(3):
                        for m in range(3):
                            dP[i, k] += A[pair, k, m] * H[3 * q + m, 3 * v + j]
                            if i != j:
                                dP[j, m] += A[pair, k, m] * H[3 * q + k, 3 * v + i]
                for r in range(modes):
                    out.gap[v, e, r] += w * (volume - rise / bulk[e]) * psi[r]
                for i in range(3):
                    for k in range(3):
                        flux[3 * q + k, 3 * v + i] = w * dP[i, k]
        np.dot(G.T, flux, out.force[e])


@machine_code
def places(
    indptr: Integers, indices: Integers, rows: Integers, columns: Integers, mirrored: bool, out: Integers
) -> None:
    """Fills out (e, a, b): see `Pattern.places`."""
    for e in range(len(rows)):
        for a in range(rows.shape[1]):
            for b in range(columns.shape[1]):
                r, c = rows[e, a], columns[e, b]
                if mirrored and r > c:
                    r, c = c, r
                if r < 0 or r > c:
                    out[e, a, b] = len(indices)
                    continue
                low, high = indptr[r], indptr[r + 1]
                while low < high:
                    middle = (low + high) // 2
                    if indices[middle] < c:
                        low = middle + 1
                    else:
                        high = middle
                out[e, a, b] = low


@machine_code
def scatter_add(place: Integers, values: Array, out: Array) -> None:
    """out[place] += values, both flat."""
    for k in range(len(values)):
        out[place[k]] += values[k]
