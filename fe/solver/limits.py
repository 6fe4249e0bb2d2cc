"""Limits of a path of equilibria: large stretch, self-penetration, limit points."""

import numpy as np
import scipy

from fe.case import Case
from fe.element import Array, Flags, Integers
from fe.solver.newton import Problem, Step

STRETCH = 3.0  # laws fitted to silicones are extrapolated beyond
# Of its pressure, how near the last equilibrium must lie to the limit point that its slopes foretell.
STEEP = 0.05
SHALLOW = 0.1  # of an edge: triangles are flat, and faces that touch give way a little


def largest_stretch(problem: Problem, u: Array) -> tuple[float, Array]:
    """Largest principal stretch at a quadrature point under displacements u (n, 3) mm, and the undeformed
    centre (3,) mm of its element."""
    kernel = problem.kernel
    F = np.eye(3) + np.einsum("eqIa,eai->eqiI", problem.geometry.G, u[kernel.connectivity], optimize=True)
    C = np.swapaxes(F, 2, 3) @ F
    largest = np.sqrt(np.linalg.eigvalsh(C)[..., -1].max(axis=1))
    e = int(largest.argmax())
    return float(largest[e]), problem.case.nodes[kernel.connectivity[e]].mean(axis=0)


def crossing(case: Case, u: Array) -> Array | None:
    """Undeformed position (3,) mm where the surface penetrates itself under displacements u (n, 3) mm, or
    None.

    Every face is divided into flat triangles; an edge that goes through a triangle with which it shares no
    node is a crossing (Moller & Trumbore 1997, doi 10.1080/10867651.1997.10487468). Pleats of a half model
    that cross its plane of symmetry are not detected. Where surfaces may touch each other, a penetration by
    less than SHALLOW is contact.
    """
    x, triangles = case.nodes + u, _triangles(case)
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    middle, centre = x[edges].mean(axis=1), x[triangles].mean(axis=1)
    half = np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1) / 2
    radius = np.linalg.norm(x[triangles] - centre[:, None], axis=2).max(axis=1)
    near = scipy.spatial.cKDTree(centre).query_ball_point(middle, half + radius.max(), return_sorted=False)
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
    """Triangles (t, 3) of all free faces outside planes of symmetry, by the corners of a face, and its centre
    node where it has one."""
    element, rows = case.element, case.connectivity
    faces = rows[:, element.faces].reshape(-1, element.faces.shape[1])
    _, index, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    skin = faces[index[count == 1]]
    for s in case.supports:
        if s.value is None and len(s.components) == 1:
            skin = skin[~np.isin(skin, case.node_sets[s.nodes]).all(axis=1)]
    corners = skin[:, list(element.corners)]
    if skin.shape[1] == 9:  # round the centre, over the middles of the edges
        ring = skin[:, [0, 1, 2, 5, 8, 7, 6, 3]]
        parts = [np.stack([ring[:, k], ring[:, k - 7], skin[:, 4]], axis=1) for k in range(8)]
    elif corners.shape[1] == 4:
        parts = [corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]
    else:
        parts = [corners]
    return np.concatenate(parts)


def _pierced(edge: Array, triangle: Array) -> Flags:
    """True (k,) where edges (k, 2, 3) intersect triangles (k, 3, 3)."""
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
    """Penetration (k,) of edges (k, 2, 3) through the plane of triangles (k, 3, 3), as a share of the edge's
    length: the smaller of its two ends."""
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    away = np.abs(np.einsum("kai,ki->ka", edge - triangle[:, :1], normal)).min(axis=1)
    return np.asarray(away / np.linalg.norm(normal, axis=1) / np.linalg.norm(edge[:, 1] - edge[:, 0], axis=1))


def causes_of_stop(step: Step, u: Array, pressure: Array, slope: Array) -> str:
    """Causes why a path stopped, judged by its last equilibrium; "" if none is seen.

    step: its factorised tangent; u (n, 3) mm: the last displacements; pressure (k,) MPa and slope (k,) mm per
    MPa: the largest slope of each of the last levels. Near a limit point 1 / slope^2 falls linearly to zero.
    """
    problem, causes = step.problem, []
    stretch, place = largest_stretch(problem, u)
    if stretch > STRETCH:
        causes.append(f"stretch {stretch:.2f} at {_at(place)} (material laws hold to {STRETCH:g})")
    crossed = crossing(problem.case, u)
    if crossed is not None:
        causes.append(f"self-contact: walls pass through each other at {_at(crossed)}")
    if step.negative:
        eigenvalues = f"{step.negative} negative eigenvalues of the tangent"
        causes.append(f"limit point: the structure snaps ({eigenvalues})")
    elif len(pressure) > 1:
        (p, q), (a, b) = pressure[-2:], slope[-2:] ** -2.0
        top = q + b * (q - p) / (a - b) if a > b else np.inf
        if top - q < STEEP * q:
            causes.append(f"limit point: the structure carries at most {top:.4g} MPa")
    return "; ".join(causes)


def _at(place: Array) -> str:
    return "x {:.1f}, y {:.1f}, z {:.1f} mm".format(*place)
