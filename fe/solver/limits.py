"""Why a path of equilibria ends: stretch, walls that pass through each other, a limit point."""

import numpy as np
from scipy.spatial import cKDTree

from fe.case import Case
from fe.element import Array, Flags, Integers
from fe.solver.newton import Problem, Step

STRETCH = 3.0  # laws fitted to silicones are extrapolated beyond
# Of its pressure, how near the last equilibrium must lie to the limit point that its slopes foretell.
STEEP = 0.05
SHALLOW = 0.1  # of an edge: triangles are flat, and faces that touch give way a little


def largest_stretch(problem: Problem, u: Array) -> tuple[float, Array]:
    """The largest principal stretch at a quadrature point under displacements u (n, 3) mm, and the
    undeformed centre (3,) mm of its element."""
    kernel = problem.kernel
    F = np.eye(3) + np.einsum("eqIa,eai->eqiI", problem.geometry.G, u[kernel.connectivity], optimize=True)
    C = np.swapaxes(F, 2, 3) @ F
    largest = np.sqrt(np.linalg.eigvalsh(C)[..., -1].max(axis=1))
    e = int(largest.argmax())
    return float(largest[e]), problem.case.nodes[kernel.connectivity[e]].mean(axis=0)


def crossing(case: Case, u: Array) -> Array | None:
    """An undeformed place (3,) mm where the surface passes through itself under displacements u (n, 3) mm, or
    nothing.

    Every face is divided into flat triangles; an edge that goes through a triangle with which it shares no
    node is a crossing (Moller & Trumbore 1997, doi 10.1080/10867651.1997.10487468). Pleats of a half model
    that cross its plane of symmetry are not looked for. Where surfaces may touch each other, what goes
    through by less than SHALLOW is contact.
    """
    x, triangles = case.nodes + u, _triangles(case)
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    middle, centre = x[edges].mean(axis=1), x[triangles].mean(axis=1)
    half = np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1) / 2
    radius = np.linalg.norm(x[triangles] - centre[:, None], axis=2).max(axis=1)
    near = cKDTree(centre).query_ball_point(middle, half + radius.max(), return_sorted=False)
    e = np.repeat(np.arange(len(edges)), [len(n) for n in near])
    t = np.concatenate([np.asarray(n, np.int64) for n in near])
    close = np.linalg.norm(middle[e] - centre[t], axis=1) <= half[e] + radius[t]
    e, t = e[close], t[close]
    apart = ~(edges[e][:, :, None] == triangles[t][:, None]).any(axis=(1, 2))
    e, t = e[apart], t[apart]
    hit = _pierced(x[edges[e]], x[triangles[t]])
    if case.self_contact:
        hit &= _beyond(x[edges[e]], x[triangles[t]]) > SHALLOW
    return case.nodes[edges[e[hit][0]]].mean(axis=0) if hit.any() else None


def _triangles(case: Case) -> Integers:
    """The triangles (t, 3) of all faces of one element alone that do not lie in a plane of symmetry; the
    corners of a face, and its centre where it has one."""
    element, rows = case.element, case.connectivity
    faces = rows[:, element.faces].reshape(-1, element.faces.shape[1])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    own = faces[first[count == 1]]
    for s in case.supports:
        if s.value is None and len(s.components) == 1:
            own = own[~np.isin(own, case.node_sets[s.nodes]).all(axis=1)]
    corners = own[:, list(element.corners)]
    if own.shape[1] == 9:  # round the centre, over the middles of the edges
        ring = own[:, [0, 1, 2, 5, 8, 7, 6, 3]]
        parts = [np.stack([ring[:, k], ring[:, k - 7], own[:, 4]], axis=1) for k in range(8)]
    elif corners.shape[1] == 4:
        parts = [corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]
    else:
        parts = [corners]
    return np.concatenate(parts)


def _pierced(edge: Array, triangle: Array) -> Flags:
    """Whether edges (k, 2, 3) go through triangles (k, 3, 3)."""
    along = edge[:, 1] - edge[:, 0]
    a, b = triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]
    normal, start = np.cross(along, b), edge[:, 0] - triangle[:, 0]
    det = np.einsum("ki,ki->k", a, normal)
    safe = np.where(np.abs(det) > 1e-14, det, np.inf)  # parallel: no crossing
    side = np.cross(start, a)
    r = np.einsum("ki,ki->k", start, normal) / safe
    s = np.einsum("ki,ki->k", along, side) / safe
    place = np.einsum("ki,ki->k", b, side) / safe
    inside = (r > 0) & (s > 0) & (r + s < 1) & (place > 0) & (place < 1)
    return np.asarray(inside & np.isfinite(safe))


def _beyond(edge: Array, triangle: Array) -> Array:
    """How far (k,), of their lengths, edges (k, 2, 3) go beyond the plane of triangles (k, 3, 3), on the side
    where they do less so."""
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    away = np.abs(np.einsum("kai,ki->ka", edge - triangle[:, :1], normal)).min(axis=1)
    return np.asarray(away / np.linalg.norm(normal, axis=1) / np.linalg.norm(edge[:, 1] - edge[:, 0], axis=1))


def why(step: Step, u: Array, pressure: Array, slope: Array) -> str:
    """What the last equilibrium of a path that stopped says about the cause, or nothing.

    step: its factorised tangent; u (n, 3) mm: the last displacements; pressure (k,) MPa and slope (k,)
    mm per MPa: the largest slope of each of the last levels. Where a limit point is near, 1 / slope^2 falls
    linearly to zero there.
    """
    problem, said = step.problem, []
    stretch, place = largest_stretch(problem, u)
    if stretch > STRETCH:
        said.append(f"stretch {stretch:.2f} at {_at(place)} (material laws hold to {STRETCH:g})")
    crossed = crossing(problem.case, u)
    if crossed is not None:
        said.append(f"self-contact: walls pass through each other at {_at(crossed)}")
    if step.negative:
        said.append(f"limit point: the structure snaps ({step.negative} negative eigenvalues of the tangent)")
    elif len(pressure) > 1:
        (p, q), (a, b) = pressure[-2:], slope[-2:] ** -2.0
        top = q + b * (q - p) / (a - b) if a > b else np.inf
        if top - q < STEEP * q:
            said.append(f"limit point: the structure carries at most {top:.4g} MPa")
    return "; ".join(said)


def _at(place: Array) -> str:
    return "x {:.1f}, y {:.1f}, z {:.1f} mm".format(*place)
