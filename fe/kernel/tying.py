"""Dependent displacements: surfaces tied to each other, and linear equations between nodes."""

from dataclasses import dataclass

import numpy as np
import scipy
import scipy.sparse as sp

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
        """Displacements (n, 3) mm with the dependent ones updated."""
        out = u.copy()
        out.reshape(-1)[self.dofs] = self.weights @ u.ravel()
        return out


def slaves(case: Case, tie: Tie) -> tuple[Integers, Integers, Array, Array]:
    """Nodes (k,) of a tie's slave surface within its reach of the master and not on its nodes; node rows (k,
    m) of the master faces, their weights (k, m) and the closest points (k, 3) mm."""
    faces = case.face_nodes(tie.master)
    nodes = np.setdiff1d(case.face_nodes(tie.slave), faces)
    corners = case.nodes[faces[:, list(case.element.corners)]]
    tree = scipy.spatial.cKDTree(corners.mean(axis=1))
    near = tree.query(case.nodes[nodes], k=min(CANDIDATES, len(faces)))[1]
    near = near.reshape(len(nodes), -1)
    weights, places = _nearest(case.element, case.nodes[faces[near]], case.nodes[nodes])
    away = np.linalg.norm(places - case.nodes[nodes][:, None], axis=2)
    best, every = away.argmin(axis=1), np.arange(len(nodes))
    within = away[every, best] <= tie.reach
    chosen = every[within], best[within]
    return nodes[within], faces[near[chosen]], weights[chosen], places[chosen]


def _nearest(kind: Element, faces: Array, x: Array) -> tuple[Array, Array]:
    """Closest points (k, c, 3) to x (k, 3) on faces (k, c, m, 3), and shape functions (k, c, m) there, by
    Gauss-Newton, clipped to the face."""
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
    """Dependent displacements by a case's ties and equations, except where supports or the clamp hold them;
    None if there are none. ValueError where nodes depend on each other in a circle."""
    if not case.ties and not case.equations:
        return None
    size, held = 3 * len(case.nodes), case.supported
    held[case.clamped] = True
    rows, columns, values = list[Integers](), list[Integers](), list[Array]()
    for tie in case.ties:
        nodes, faces, weights, _ = slaves(case, tie)
        for d in range(3):
            rows.append(np.repeat(3 * nodes + d, faces.shape[1]))
            columns.append((3 * faces + d).ravel())
            values.append(weights.ravel())
    row_of = dict(zip(case.labels.tolist(), range(len(case.labels)), strict=True))
    for equation in case.equations:
        (label, component, factor), *others = equation.terms
        rows.append(np.full(len(others), 3 * row_of[label] + component))
        columns.append(np.array([3 * row_of[n] + d for n, d, _ in others], int))
        values.append(np.array([-f / factor for _, _, f in others]))
    if not rows:
        return None
    where, of, by = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
    return _resolved(where, of, by, held.ravel(), size)


def _resolved(rows: Integers, columns: Integers, values: Array, held: Flags, size: int) -> Dependence | None:
    """Dependent displacements in terms of independent or held ones."""
    free = ~held[rows] & (values != 0)
    dofs = np.unique(rows[~held[rows]])
    if not len(dofs):
        return None
    number = np.full(size, -1)
    number[dofs] = np.arange(len(dofs))
    weights = sp.csr_matrix(
        (values[free], (number[rows[free]], columns[free])), shape=(len(dofs), size)
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
    """Matrix (size, size): identity on independent displacements, `weights` on dependent ones."""
    free = np.ones(size)
    free[dofs] = 0.0
    place = sp.csr_matrix((np.ones(len(dofs)), (dofs, np.arange(len(dofs)))), shape=(size, len(dofs)))
    return (sp.diags(free) + place @ weights).tocsr()
