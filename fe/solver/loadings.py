"""A problem and its neighbours under each gravity, set of pulls and shares of the pressure along a path."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe.case import Case
from fe.element import Array, Integers
from fe.mesh.mirror import AXIS, middle_plane, symmetry_support
from fe.path import Path
from fe.solver.newton import Problem
from fe.solver.sensitivity import Differenced


@dataclass(frozen=True)
class Loadings:
    """Distinct loadings of a path: problems (g,) and their neighbours by every parameter; of_run (r,):
    loading of each stretch of constant gravity, pulls and shares."""

    path: Path
    problems: tuple[Problem, ...]
    varied: tuple[tuple[Differenced, ...], ...]
    of_run: Integers

    @staticmethod
    def of(
        problem: Problem, path: Path, varied: Sequence[Differenced], paths: Sequence[tuple[Path, Path]]
    ) -> "Loadings":
        """Loadings of a problem without weight and pulls, without duplicates. paths: paths of the varied
        neighbours."""
        starts = np.append(0, path.turns + 1)
        has_weight = any(q.has_weight for q in (problem, *(q for v in varied for q in (v.plus, v.minus))))
        if not has_weight and not path.pulls.any() and not path.chambers:
            return Loadings(path, (problem,), (tuple(varied),), np.zeros(len(starts), np.int64))
        every = [path, *(w for pair in paths for w in pair)]
        rows = np.concatenate([w.outside_of(starts) for w in every], axis=1)  # (r, size (1 + 2 v))
        size = rows.shape[1] // len(every)
        _, index, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        ways = [rows[k].reshape(-1, size) for k in index]
        return Loadings(
            path,
            tuple(_under(problem, g[0], path) for g in ways),
            tuple(
                tuple(
                    Differenced(_under(v.plus, a, path), _under(v.minus, b, path), v.step)
                    for v, a, b in zip(varied, g[1::2], g[2::2], strict=True)
                )
                for g in ways
            ),
            inverse.reshape(-1),
        )

    def everyone(self, *, without: Collection[int] = ()) -> list[Problem]:
        """All problems and neighbours, except the neighbours by the parameters numbered in `without`."""
        varied = [d for v in self.varied for n, d in enumerate(v) if n not in without]
        return [*self.problems, *(q for d in varied for q in (d.plus, d.minus))]

    def at(self, time: Array) -> Integers:
        """Loading numbers (k,) at times (k,) s."""
        return self.of_run[self.path.run(time)]

    def only(self, number: int) -> "Loadings":
        """A single loading for the whole path."""
        return Loadings(
            self.path, (self.problems[number],), (self.varied[number],), np.zeros_like(self.of_run)
        )


def _under(q: Problem, outside: Array, path: Path) -> Problem:
    """The problem under a row (3 + 3 h + c,) of gravity, pulls and shares at the places and chambers of a
    path."""
    row = path.under(outside)
    q = q.under(row["gravity"])
    for place, pull in zip(path.places, row["pulls"], strict=True):
        q = replace(q, dead=spread(q.case, place).added(q.dead, pull)) if pull.any() else q
    return q.with_shares(dict(zip(path.chambers, row["shares"].tolist(), strict=True)))


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
