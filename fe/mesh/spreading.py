"""A point force as equivalent nodal forces with equal resultant and moment."""

from dataclasses import dataclass

import numpy as np

from fe.case import Case
from fe.element import Array, Integers
from fe.mesh.mirror import AXIS, middle_plane, symmetry_support

RADIUS = 3.0  # mm around the place: a force on one node would dent the finer meshes the deeper
LEAST = 12  # nodes that share a force, or more
ON_PLANE = 1e-6  # mm
FAR = 2.0  # times RADIUS that a place may lie from the nearest node


@dataclass(frozen=True)
class Spread:
    """Nodes `rows` (k,) that carry a force, and their shares (k,); in a half model the shares of the half."""

    rows: Integers
    parts: Array

    def added(self, dead: Array, force: Array) -> Array:
        """Nodal forces (n, 3) N plus a force (3,) N."""
        out = dead.copy()
        out[self.rows] += self.parts[:, None] * force
        return out


def spread(case: Case, place: Array) -> Spread:
    """Shares of a force at a material point (3,) mm among the nodes within RADIUS.

    The shares are affine in the nodes' positions: the least ones with the whole force and no moment about the
    point. In a half model the images of its nodes count, and the point must lie on the plane of symmetry.
    ValueError where no node is near, or the point lies beside that plane.
    """
    away = np.linalg.norm(case.nodes - place, axis=1)
    if away.min() > FAR * RADIUS:
        raise ValueError(
            f"force at {np.round(place, 3).tolist()} mm: {away.min():.3g} mm from the nearest node; "
            "wanted a place on the model, mm, undeformed; correct its position"
        )
    held = symmetry_support(case)
    if held is not None and abs(place[AXIS] - middle_plane(case)) > ON_PLANE:
        raise ValueError(
            f"force at {np.round(place, 3).tolist()} mm of half a model: wanted a place on its plane of "
            "symmetry; solve the whole (`fe.mesh.mirror.mirrored`)"
        )
    images = np.ones(len(away)) if held is None else np.full(len(away), 2.0)
    if held is not None:
        images[case.node_sets[held.nodes]] = 1.0
    order = np.argsort(away, kind="stable")
    enough = away[order[min(int(np.searchsorted(np.cumsum(images[order]), LEAST)), len(order) - 1)]]
    rows = np.flatnonzero(away <= max(RADIUS, enough) * (1 + 1e-9))
    images = images[rows]
    axes = [i for i in range(3) if held is None or i != AXIS]
    affine = np.column_stack([np.ones(len(rows)), (case.nodes[rows] - place)[:, axes] / RADIUS])
    moments = np.append(1.0, np.zeros(len(axes)))
    parts = affine @ np.linalg.lstsq(affine.T @ (images[:, None] * affine), moments, rcond=None)[0]
    return Spread(rows, parts * images / (1.0 if held is None else 2.0))
