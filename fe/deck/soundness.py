"""Checks of a user's mesh: elements with distinct nodes and positive Jacobians; one supported body of a
plausible size, with a closed chamber. Each fault raises a ValueError that says what was wanted."""

import numpy as np
import scipy
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from fe.case import Case
from fe.deck.units import LENGTHS
from fe.element import Array, Integers
from fe.kernel.pressure import PressureFaces
from fe.kernel.tying import dependence
from fe.mesh.refine import free_faces

SMALLEST_MM, LARGEST_MM = 5.0, 2000.0  # of a soft finger's longest side
SAME = 1e-6  # of the longest side: nodes nearer to each other are one place
FOLDED = 0.2  # of an element's largest Jacobian: a quadratic one may be a little below 0 at a sharp corner
HELD = 1e-6  # least singular value over the largest, below which a motion is free
MOTIONS = ("along x", "along y", "along z", "about x", "about y", "about z")


def check_collapsed(case: Case, numbers: Integers, file: str) -> None:
    """ValueError unless every element, number (e,), has as many nodes as its kind."""
    nodes = np.sort(case.connectivity, axis=1)
    same = nodes[:, 1:] == nodes[:, :-1]
    bad = np.flatnonzero(same.any(axis=1))
    if not len(bad):
        return
    worst = bad[0]
    label = case.labels[nodes[worst, 1:][same[worst]][0]]
    raise ValueError(
        f"{file}: element {numbers[worst]} has node {label} more than once: it is collapsed, as are "
        f"{len(bad)} of {len(nodes)} elements; wanted {nodes.shape[1]} different nodes; mesh that place with "
        "other elements"
    )


def check_turned(case: Case, numbers: Integers, file: str) -> None:
    """ValueError unless the Jacobian is positive at all integration points, and nowhere near -FOLDED of its
    largest at the nodes; numbers (e,) of the elements."""
    inside, at_nodes = jacobians(case), jacobians(case, local=case.element.local)
    folded = at_nodes.min(axis=1) < -FOLDED * np.abs(at_nodes).max(axis=1)
    least = np.where(folded, at_nodes.min(axis=1), inside.min(axis=1))
    bad = folded | (least <= 0.0)
    if not bad.any():
        return
    worst = int(np.flatnonzero(bad)[0])
    raise ValueError(
        f"{file}: element {numbers[worst]} has a Jacobian of {least[worst]:.3g} mm3: it is turned inside "
        f"out, folded or flat, as are {int(bad.sum())} of {len(bad)} elements; wanted nodes in Abaqus's "
        "order, and no node beyond its neighbours; mend the mesh"
    )


def jacobians(case: Case, *, local: Array | None = None) -> Array:
    """Jacobian determinants (e, q) mm3 of all elements at local points (q, 3), by default the integration
    points."""
    X = case.nodes[case.connectivity]
    dN = (case.element.at_points if local is None else case.element.shape(local))[1]
    return np.asarray(np.linalg.det(np.einsum("eai,qaJ->eqiJ", X, dN, optimize=True)))


def check_body(case: Case, file: str) -> None:
    """ValueError where the structure has not the size of a finger, or where it is not one body that is held
    and that the pressure fills."""
    for check in (_check_size, _check_places, _check_held, _check_chamber):
        check(case, file)


def _check_size(case: Case, file: str) -> None:
    longest = float(np.ptp(case.nodes, axis=0).max())
    if SMALLEST_MM <= longest <= LARGEST_MM:
        return
    likely = [u for u in ("m", "cm", "in", "um") if 20.0 <= LENGTHS[u] * longest <= 500.0]
    hint = (
        f"; are they in {' or '.join(likely)}? Say so: ** units: {likely[0]}, N, s in a deck, --unit "
        f"{likely[0]} with a mesh of Gmsh or VTK"
        if likely
        else ""
    )
    raise ValueError(
        f"{file}: the mesh is {longest:.4g} mm long: wanted coordinates in mm, {SMALLEST_MM:g} to "
        f"{LARGEST_MM:g} mm for a finger{hint}"
    )


def _check_places(case: Case, file: str) -> None:
    """No two nodes at one place: there the mesh would be cut."""
    near = SAME * float(np.ptp(case.nodes, axis=0).max())
    pairs = scipy.spatial.cKDTree(case.nodes).query_pairs(near, output_type="ndarray")
    if len(pairs):
        a, b = case.labels[pairs[0]]
        x, y, z = case.nodes[pairs[0][0]]
        raise ValueError(
            f"{file}: nodes {a} and {b} lie at one place, ({x:.4g}, {y:.4g}, {z:.4g}) mm, and so do "
            f"{len(pairs)} pairs in all: the mesh is cut there; wanted one node at a place; merge them in "
            "your preprocessor"
        )


def _check_held(case: Case, file: str) -> None:
    """ValueError unless supports hold every part of the mesh against all six rigid motions, and leave some
    node free."""
    if case.supported.all():
        raise ValueError(
            f"{file}: all {len(case.nodes)} nodes are held, so nothing can move; wanted *BOUNDARY on the "
            "nodes of the clamp alone, as in `Root, 1, 3`"
        )
    n, cells = len(case.nodes), case.connectivity
    rows = np.repeat(np.arange(len(cells)), cells.shape[1])
    follower, leader = _followers(case)
    start, end = np.append(cells[rows, 0], follower), np.append(cells.ravel(), leader)
    graph = sp.coo_matrix((np.ones(len(start)), (start, end)), shape=(n, n))
    count, part = connected_components(graph, directed=False)
    for k in range(count):
        free = _free_motion(case, np.flatnonzero(part == k))
        if free:
            x, y, z = case.nodes[part == k].mean(axis=0)
            near = f"the part of the mesh near ({x:.4g}, {y:.4g}, {z:.4g}) mm"
            which = "the finger" if count == 1 else near
            merge = "" if count == 1 else ", or join it to the others"
            raise ValueError(
                f"{file}: nothing holds {which} against a rigid motion {free}; wanted *BOUNDARY on the nodes "
                f"of the clamp, as in `Root, 1, 3`{merge}"
            )


def _followers(case: Case) -> tuple[Integers, Integers]:
    """Pairs of node rows (k,), (k,): a dependent node, and a node on which it depends."""
    tied = dependence(case)
    if tied is None:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    entries = tied.weights.tocoo()
    return tied.dofs[entries.row] // 3, entries.col.astype(np.int64) // 3


def _free_motion(case: Case, rows: Integers) -> str:
    """The rigid motion that supports leave to some nodes, "" where they leave none."""
    centre = case.nodes[rows].mean(axis=0)
    size = float(np.ptp(case.nodes[rows], axis=0).max())
    node, component = np.nonzero(case.supported[rows])
    x = (case.nodes[rows][node] - centre) / size
    turned = np.stack([np.cross(axis, x) for axis in np.eye(3)], axis=2)  # (k, component, axis)
    held = np.concatenate([np.eye(3)[component], turned[np.arange(len(x)), component]], axis=1)
    _, values, motions = np.linalg.svd(np.concatenate([held, np.zeros((6, 6))]), full_matrices=False)
    if values[-1] > HELD * max(values[0], 1.0):
        return ""
    return MOTIONS[int(np.abs(motions[-1]).argmax())]


def _check_chamber(case: Case, file: str) -> None:
    """The pressure must act on the skin, on surfaces that enclose a space, and from its inside; those with a
    pressure of their own each enclose one."""
    if case.pressurised is None:
        return
    skin = {tuple(row) for row in free_faces(case).tolist()}
    shares = dict[float, list[str]]()
    for surface, share in (case.shares or {case.pressurised: 1.0}).items():
        shares.setdefault(share, []).append(surface)
    for surfaces in shares.values():
        faces = np.concatenate([case.surfaces[surface] for surface in surfaces])
        _check_space(case, "+".join(surfaces), faces, skin, file)


def _check_space(
    case: Case, surface: str, faces: Integers, skin: set[tuple[int, ...]], file: str
) -> None:
    """ValueError unless the faces (f, 2) of one pressure enclose a space, and it acts from inside."""
    buried = [row for row in faces.tolist() if tuple(row) not in skin]
    name = f"the pressurised surface {surface!r}"
    if not len(faces):
        raise ValueError(f"{file}: {name} has no faces; wanted those of the chamber")
    if buried:
        x, y, z = case.nodes[case.connectivity[buried[0][0]]].mean(axis=0)
        raise ValueError(
            f"{file}: {name} has {len(buried)} faces that lie inside the material, one near ({x:.4g}, "
            f"{y:.4g}, {z:.4g}) mm; wanted faces on the skin of the chamber; correct the numbers of the faces"
        )
    pressed = PressureFaces(case.nodes_of_faces(faces), case.element, len(case.nodes))
    force = pressed.force(case.nodes)
    if not np.abs(force[~case.supported]).max(initial=0.0) > HELD * np.abs(force).max():
        raise ValueError(
            f"{file}: {name} is held wherever the pressure acts on it, so nothing moves; wanted the faces of "
            "the chamber, or *BOUNDARY on the nodes of the clamp alone"
        )
    edges = pressed.open_edges(case.nodes, ~case.supported.reshape(-1))
    edges = edges[~np.isin(edges, _joints(case)).all(axis=1)]  # there another mesh goes on
    if len(edges):
        x, y, z = case.nodes[edges[0]].mean(axis=0)
        raise ValueError(
            f"{file}: {name} is open: {len(edges)} edges belong to one face alone, one near ({x:.4g}, "
            f"{y:.4g}, {z:.4g}) mm; wanted a chamber that is closed, but for clamped nodes and planes of "
            "symmetry; add the faces that are missing"
        )
    if _volume(case, pressed) < 0.0:
        raise ValueError(
            f"{file}: the pressure acts on {name} from outside; wanted the faces of the chamber, "
            "which it fills"
        )


def _joints(case: Case) -> Integers:
    """The nodes of all surfaces that are tied to each other."""
    rows = [case.face_nodes(name).ravel() for tie in case.ties for name in (tie.slave, tie.master)]
    return np.unique(np.concatenate(rows)) if rows else np.empty(0, np.int64)


def _volume(case: Case, pressed: PressureFaces) -> float:
    """The volume (mm3) that the pressure fills, below 0 where it lies around the body; 0 where the surface
    ends in several planes, between which it cannot be told."""
    ends = np.unique(pressed.edges)
    origin = case.nodes[ends].mean(axis=0) if len(ends) else case.nodes.mean(axis=0)
    if len(ends) and np.linalg.svd(case.nodes[ends] - origin, compute_uv=False)[-1] > 1e-3:
        return 0.0
    return float((pressed.force(case.nodes) * (case.nodes - origin)).sum()) / 3
