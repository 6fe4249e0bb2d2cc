"""Batches of fingers that differ: do the mesh and the solver follow what a user may state?

    python benchmarks/batches.py [--quick] [--json]

geometries: random dimensions of the built-in finger, as [model.finger] of twin.toml takes them. Each is meshed
by the default lattice and solved at the pressure at which its most strained place, by its first response, has
a strain of STRAIN. Of six the tip's motion is compared with its limit, to which the lattice divided by 1, 2
and 3 extrapolates. --quick: a few of them. Without it about half an hour of one core.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import _first  # noqa: F401
import numpy as np
from convergence import REFINEMENTS, SILICONE, extrapolate

from fe import Case, Finger, Lattice, Path, Solution, finger_case, solve
from fe.kernel.assembly import Geometry
from twin.project.dimensions import FingerTable

COUNT, QUICK = 60, 5
LIMITS, QUICK_LIMITS = 6, 1
SMALL = 2600  # nodes of the default mesh at most where it is divided by 3: 60 000 nodes, 4 GB
STRAIN = 0.4
FIRST = 1e-5  # MPa, at which the response is linear
BETWEEN = {  # mm, between which a dimension is drawn; what does not fit together is drawn anew
    "length_mm": (30.0, 140.0), "width_mm": (8.0, 34.0), "height_mm": (8.0, 30.0),
    "side_wall_mm": (1.0, 3.5), "bottom_wall_mm": (1.0, 4.0), "top_wall_mm": (1.0, 3.5),
    "base_cap_mm": (2.0, 8.0), "tip_cap_mm": (2.0, 8.0), "pleat_depth_mm": (0.0, 12.0),
    "side_pleat_depth_mm": (0.0, 5.0), "edge_radius_mm": (0.4, 2.0),
}  # fmt: skip
PLEATS = (1, 12)


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
    """What becomes of a geometry on the default lattice."""
    finger = table.finger
    case = finger_case(SILICONE, finger=finger)
    if broken := broken_mesh(case):
        return Tried(table, len(case.nodes), np.nan, np.nan, broken)
    pressure = scaled_pressure(case)
    found = solved(case, pressure)
    tip = motion(found, finger) if found.converged else np.nan
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
    gradient = np.einsum("eai,eqJa->eqiJ", u[case.connectivity], Geometry(case.nodes, case.connectivity, case.element).G)
    strain = (gradient + np.swapaxes(gradient, 2, 3)) / 2
    return FIRST * STRAIN / float(np.abs(np.linalg.eigvalsh(strain)).max())


def solved(case: Case, pressure: float) -> Solution:
    """The response to a pressure in MPa."""
    return solve(case, Path(np.array([0.0, 1.0]), np.array([0.0, pressure]), np.ones(1)))


def motion(found: Solution, finger: Finger) -> float:
    """How far the tip moves in mm."""
    return float(np.linalg.norm(found.at(np.array([finger.tip_node]))[0, 0]))
