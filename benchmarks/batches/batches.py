"""Batches of fingers that differ: figures of what is done with them, from their dimensions to the review.

    python benchmarks/batches/batches.py [--quick] [--only PART ...] [--json]

geometries: random dimensions of the built-in finger, as [model.finger] of twin.toml takes them. Each is
meshed by the lattice that follows from them, and solved at the pressure at which its most strained place, by
its first response, has a strain of STRAIN. Of the first six whose mesh divided by 3 has 100 000 nodes,
the tip's motion is compared with its limit, to which that lattice, divided by 1, 2 and 3, extrapolates; where
the three show no order, with that of the finest.
drift: `drift.py`. kills: of `twin recalibrate`, `tests/strangers/kills.py`. review: `review.py`, on the demo.
--quick: a few of each. Without it the geometries alone take about half an hour of one core.
"""

import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.batches.drift import drift
from benchmarks.batches.review import review
from benchmarks.commandline import parts
from benchmarks.kernel.convergence import REFINEMENTS, SILICONE, extrapolate

import numpy as np

from fe import Case, Finger, Lattice, Path, Solution, finger_case, solve
from fe.kernel.assembly import Geometry
from tests.strangers.kills import recalibrations
from twin.bodies.finger import FingerTable
from twin.model.structure import BuiltIn

SEED = 1
COUNT, QUICK = 54, 6
LIMITS, QUICK_LIMITS = 6, 1
SMALL, QUICK_SMALL = 4500, 2700  # nodes at most of a lattice that is then divided by 3
STRAIN = 0.4
FIRST = 1e-5  # MPa, at which the response is linear
BETWEEN = {  # mm, between which a dimension is drawn; what does not fit together is drawn anew
    "length_mm": (30.0, 120.0), "width_mm": (8.0, 34.0), "height_mm": (8.0, 30.0),
    "side_wall_mm": (1.0, 3.5), "bottom_wall_mm": (1.0, 4.0), "top_wall_mm": (1.0, 3.5),
    "base_cap_mm": (2.0, 8.0), "tip_cap_mm": (2.0, 8.0), "pleat_depth_mm": (0.0, 12.0),
    "side_pleat_depth_mm": (0.0, 5.0), "edge_radius_mm": (0.4, 2.0),
}  # fmt: skip
PLEATS = (1, 6)


@dataclass(frozen=True)
class Tried:
    """One geometry: its dimensions, nodes, the pressure in MPa, the tip's motion there in mm, and why it
    failed ("" where it was solved)."""

    table: FingerTable
    nodes: int
    pressure: float
    tip: float
    reason: str


def tables(seed: int) -> Iterator[FingerTable]:
    """Random dimensions that fit together, without end."""
    rng = np.random.default_rng(seed)
    while True:
        sizes = {name: round(float(rng.uniform(*ends)), 2) for name, ends in BETWEEN.items()}
        pleats = int(rng.integers(*PLEATS, endpoint=True))
        profile: Any = str(rng.choice(["round", "flat"]))
        try:
            yield FingerTable(**sizes, pleats=pleats, pleat_profile=profile)
        except ValueError:  # what the user is told in a sentence
            continue


def tried(table: FingerTable) -> Tried:
    """What becomes of a geometry on the lattice that follows from it."""
    own = BuiltIn.of(table.finger)
    case = finger_case(SILICONE, finger=own.finger, lattice=own.lattice)
    if broken := broken_mesh(case):
        return Tried(table, len(case.nodes), np.nan, np.nan, broken)
    pressure = scaled_pressure(case)
    found = solved(case, pressure)
    tip = motion(found, own.finger) if found.converged else np.nan
    return Tried(table, len(case.nodes), pressure, tip, "" if found.converged else found.reason)


def broken_mesh(case: Case) -> str:
    """Why a mesh is not valid: a Jacobian that is not positive, or a chamber that is not closed; else ""."""
    if not (Geometry(case.nodes, case.connectivity, case.element).weight > 0).all():
        return "a Jacobian is not positive"
    return "" if closed(case) else "the chamber is not closed"


def closed(case: Case) -> bool:
    """Whether every edge of the chamber's faces belongs to two of them, but for those on y = 0.

    The faces of a half model end on its plane of symmetry, where each edge belongs to one.
    """
    corners = case.face_nodes("chamber")[:, list(case.element.corners)]
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    on_plane = (np.abs(case.nodes[edges, 1]) < 1e-9).all(axis=1)
    return bool(len(edges) and (count == np.where(on_plane, 1, 2)).all())


def scaled_pressure(case: Case) -> float:
    """The pressure in MPa at which the largest strain of the first response is STRAIN."""
    u = solved(case, FIRST).curves[0].u[-1]
    slopes = Geometry(case.nodes, case.connectivity, case.element).G
    gradient = np.einsum("eai,eqJa->eqiJ", u[case.connectivity], slopes)
    strain = (gradient + np.swapaxes(gradient, 2, 3)) / 2
    return FIRST * STRAIN / float(np.abs(np.linalg.eigvalsh(strain)).max())


def solved(case: Case, pressure: float) -> Solution:
    """The response to a pressure in MPa."""
    return solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, pressure]), np.ones(1)))


def motion(found: Solution, finger: Finger) -> float:
    """How far the tip moves in mm."""
    return float(np.linalg.norm(found.at(np.array([finger.tip_node]))[0, 0]))


# -- the limit -----------------------------------------------------------------------------------------------


def settling(finger: Finger) -> Lattice:
    """The lattice whose divisions show an order: cells not centred on the pleats, one through a wall."""
    return replace(BuiltIn.of(finger).lattice, centred=False, wall=1, up=1, fillet=1)


def limit(finger: Finger, pressure: float) -> float:
    """The limit of the tip's motion in mm at a pressure in MPa; without an order that of the finest mesh."""
    every = []
    for n in REFINEMENTS:
        case = finger_case(SILICONE, finger=finger, lattice=replace(settling(finger), refine=n))
        every.append(motion(solved(case, pressure), finger))
    found = extrapolate((every[0], every[1], every[2]))[1]
    return found if np.isfinite(found) else every[-1]


def limits(rows: list[Tried], *, count: int, most: int) -> dict[int, float]:
    """The relative error of the tip's motion, by row, of the first `count` solved with a mesh of at most
    `most` nodes to divide."""
    errors: dict[int, float] = {}
    for k, row in enumerate(rows):
        finger = row.table.finger
        if len(errors) == count or row.reason:
            continue
        if len(finger_case(SILICONE, finger=finger, lattice=settling(finger)).nodes) <= most:
            errors[k] = row.tip / limit(finger, row.pressure) - 1
            print(f"geometry {k}: mesh error {errors[k]:+.2%}", file=sys.stderr, flush=True)
    return errors


# -- parts ---------------------------------------------------------------------------------------------------


def geometries(quick: bool) -> dict[str, Any]:
    """How many random geometries were tried and solved, and the largest mesh error of those compared."""
    rows = []
    for k, table in enumerate(islice(tables(SEED), QUICK if quick else COUNT)):
        rows.append(tried(table))
        said = f"geometry {k}: {rows[-1].nodes} nodes, {rows[-1].reason or 'solved'}"
        print(said, file=sys.stderr, flush=True)
    errors = limits(rows, count=QUICK_LIMITS if quick else LIMITS, most=QUICK_SMALL if quick else SMALL)
    return {
        "geometries_tried": len(rows),
        "geometries_solved": sum(not row.reason for row in rows),
        "geometries_compared": len(errors),
        "mesh_error_max": max((abs(e) for e in errors.values()), default=None),
        "mesh_errors": [round(e, 5) for e in errors.values()],
        "geometries_failed": [{"reason": row.reason, **row.table.model_dump()} for row in rows if row.reason],
    }


PARTS: dict[str, Callable[[bool], dict[str, Any]]] = {
    "geometries": geometries,
    "drift": drift,
    "review": review,
    "kills": recalibrations,
}


if __name__ == "__main__":
    sys.exit(parts(__doc__, PARTS, quick="a few of each"))
