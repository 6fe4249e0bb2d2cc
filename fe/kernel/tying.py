"""Displacements that follow others: surfaces tied to each other, and linear equations between nodes."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from fe.case import Case, Tie
from fe.element import Array, Element, Flags, Integers

CANDIDATES = 8  # faces nearest to a node by their middles, among which the nearest place is searched
SAMPLES = 5  # points of a face in each direction, from the nearest of which the search begins
CORRECTIONS = 12
NOTHING = 1e-9  # a weight
DEEPEST = 20  # followers of followers


@dataclass(frozen=True)
class Dependence:
    """Degrees of freedom (k,) that follow others: u[dofs] = weights @ u, weights (k, 3 n)."""

    dofs: Integers
    weights: sp.csr_matrix

    def followed(self, u: Array) -> Array:
        """Displacements (n, 3) mm in which those that follow do so."""
        out = u.copy()
        out.reshape(-1)[self.dofs] = self.weights @ u.ravel()
        return out


def slaves(case: Case, tie: Tie) -> tuple[Integers, Integers, Array, Array]:
    """The nodes (k,) of a tie's first surface that lie within its reach of the second and not on its nodes;
    the nodes (k, m) of the faces that they follow, their weights (k, m) and the places (k, 3) mm there."""
    faces = case.face_nodes(tie.master)
    own = np.setdiff1d(case.face_nodes(tie.slave), faces)
    corners = case.nodes[faces[:, list(case.element.corners)]]
    near = cKDTree(corners.mean(axis=1)).query(case.nodes[own], k=min(CANDIDATES, len(faces)))[1]
    near = near.reshape(len(own), -1)
    weights, places = _nearest(case.element, case.nodes[faces[near]], case.nodes[own])
    away = np.linalg.norm(places - case.nodes[own][:, None], axis=2)
    best, every = away.argmin(axis=1), np.arange(len(own))
    within = away[every, best] <= tie.reach
    chosen = every[within], best[within]
    return own[within], faces[near[chosen]], weights[chosen], places[chosen]


def _nearest(kind: Element, faces: Array, x: Array) -> tuple[Array, Array]:
    """Of places x (k, 3) the nearest ones (k, c, 3) on faces (k, c, m, 3), and the faces' shape functions (k,
    c, m) there: by Gauss-Newton's method, held inside the face."""
    line = np.linspace(0.0 if kind.simplex else -1.0, 1.0, SAMPLES)
    grid = kind.clipped_to_face(np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2))
    N = kind.on_face(grid)[0]
    away = np.linalg.norm(np.einsum("gm,kcmi->kcgi", N, faces) - x[:, None, None], axis=3)
    st = grid[away.argmin(axis=2)]  # (k, c, 2)
    shape = st.shape[:2]
    for _ in range(CORRECTIONS):
        N, dN = (a.reshape(*shape, *a.shape[1:]) for a in kind.on_face(st.reshape(-1, 2)))
        gap = x[:, None] - np.einsum("kcm,kcmi->kci", N, faces)
        slope = np.einsum("kcmj,kcmi->kcij", dN, faces)
        normal = np.einsum("kcij,kcil->kcjl", slope, slope)
        step = np.linalg.solve(normal, np.einsum("kcij,kci->kcj", slope, gap)[..., None])[..., 0]
        st = kind.clipped_to_face((st + np.clip(step, -0.5, 0.5)).reshape(-1, 2)).reshape(*shape, 2)
    N = kind.on_face(st.reshape(-1, 2))[0].reshape(*shape, -1)
    return np.where(np.abs(N) > NOTHING, N, 0.0), np.einsum("kcm,kcmi->kci", N, faces)


def dependence(case: Case) -> Dependence | None:
    """What follows in a case by its ties and equations, but for what supports or the clamp hold; None where
    nothing does. ValueError where nodes follow each other in a circle, or one has two to follow."""
    if not case.ties and not case.equations:
        return None
    size, held = 3 * len(case.nodes), case.supported
    held[case.clamped] = True
    rows, columns, values = list[Integers](), list[Integers](), list[Array]()
    for tie in case.ties:
        own, faces, weights, _ = slaves(case, tie)
        for d in range(3):
            rows.append(np.repeat(3 * own + d, faces.shape[1]))
            columns.append((3 * faces + d).ravel())
            values.append(weights.ravel())
    at = dict(zip(case.labels.tolist(), range(len(case.labels)), strict=True))
    for equation in case.equations:
        (label, component, factor), *others = equation.terms
        rows.append(np.full(len(others), 3 * at[label] + component))
        columns.append(np.array([3 * at[n] + d for n, d, _ in others], int))
        values.append(np.array([-f / factor for _, _, f in others]))
    if not rows:
        return None
    where, of, by = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
    return _resolved(where, of, by, held.ravel(), size)


def _resolved(rows: Integers, columns: Integers, values: Array, held: Flags, size: int) -> Dependence | None:
    """What follows, by what is free or held alone."""
    kept = ~held[rows] & (values != 0)
    dofs = np.unique(rows[~held[rows]])
    if not len(dofs):
        return None
    number = np.full(size, -1)
    number[dofs] = np.arange(len(dofs))
    weights = sp.csr_matrix(
        (values[kept], (number[rows[kept]], columns[kept])), shape=(len(dofs), size)
    )
    for _ in range(DEEPEST):
        again = np.flatnonzero(number[weights.indices] >= 0)
        if not len(again):
            return Dependence(dofs, weights)
        followers = sp.csr_matrix((size, size)) if not len(dofs) else _spread(dofs, weights, size)
        weights = (weights @ followers).tocsr()
        weights.eliminate_zeros()
    raise ValueError(
        "nodes of *TIE, *EQUATION or *MPC follow each other in a circle; wanted surfaces that are slave in "
        "one tie alone; exchange slave and master in one of them"
    )


def _spread(dofs: Integers, weights: sp.csr_matrix, size: int) -> sp.csr_matrix:
    """The matrix (size, size) that leaves what is free and replaces what follows."""
    free = np.ones(size)
    free[dofs] = 0.0
    place = sp.csr_matrix((np.ones(len(dofs)), (dofs, np.arange(len(dofs)))), shape=(size, len(dofs)))
    return (sp.diags(free) + place @ weights).tocsr()
