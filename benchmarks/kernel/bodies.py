"""Random geometries of every kind of body, meshed and solved, and closed forms and CalculiX for some of them.

    python benchmarks/kernel/bodies.py [--quick] [--json] [--only closed calculix bodies]
        [--kinds finger pneunet tube bar] [--count 30] [--errors 30]

bodies: `count` draws of dimensions of each kind. Each is meshed on the lattice that its dimensions ask for,
and loaded by LOAD (C10 + C01) times its thinnest wall over its chamber's largest side; a bar by its weight.
The error of its mesh is how far the tip of the finest lattice, `check`, ends from its own, as a share of the
largest displacement anywhere; those whose walls touch do not count, as contact is left out.
closed: a bar's sag against Timoshenko's beam, a tube's stretch against Lame's. calculix: a PneuNet in 20-node
hexahedra of its own and of CalculiX, on one mesh.
--quick: three draws of each kind.
"""

import json
import os
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from fe import Case, Material, Path, Solution, solve
from fe.deck.soundness import jacobians
from fe.engines.calculix import CalculiX
from fe.mesh.convert import converted
from fe.mesh.elementshapes import quality
from fe.mesh.finger import NAMED_NODES
from fe.mesh.points import nearest
from twin.bodies.body import Body
from twin.bodies.kinds import BODIES, BodyTable

SILICONE = Material(0.214, 0.083, density=1.07e-9)
LOAD = 0.5  # of C10 + C01, times wall over side
G = 9810.0  # mm/s2
TIP = "tip"

Array = NDArray[np.float64]
Numbers = np.random.Generator


def pneunet(r: Numbers) -> dict[str, Any]:
    """Drawn dimensions of a PneuNet."""
    return {
        "chambers": int(r.integers(1, 4)), "chamber_length_mm": r.uniform(4, 12),
        "chamber_wall_mm": r.uniform(1, 2.5), "gap_mm": r.uniform(1.5, 4), "width_mm": r.uniform(14, 28),
        "height_mm": r.uniform(14, 26), "side_wall_mm": r.uniform(1.2, 3), "top_wall_mm": r.uniform(1.2, 3),
        "bottom_wall_mm": r.uniform(1.5, 4), "channel_width_mm": r.uniform(2, 8),
        "channel_height_mm": r.uniform(1.5, 3), "channel_roof_mm": r.uniform(1.5, 3),
        "sheet_N_per_mm": float(r.choice([0.0, r.uniform(1, 100)])),
    }  # fmt: skip


def tube(r: Numbers) -> dict[str, Any]:
    """Drawn dimensions of a tube."""
    width, wall = r.uniform(8, 24), r.uniform(1, 3)
    height = width * r.uniform(0.7, 1.4)
    return {
        "section": str(r.choice(["round", "rectangular"])), "length_mm": r.uniform(40, 120),
        "width_mm": width, "height_mm": height,
        "chamber_width_mm": width - 2 * wall * r.uniform(0.8, 1.3),
        "chamber_height_mm": height - 2 * wall, "offset_mm": wall * r.uniform(-0.6, 0.6),
        "edge_radius_mm": r.uniform(0.5, 2), "fibre_N_per_mm": float(r.choice([0.0, r.uniform(1, 50)])),
    }  # fmt: skip


def bar(r: Numbers) -> dict[str, Any]:
    """Drawn dimensions of a bar."""
    width = r.uniform(8, 30)
    return {"length_mm": width * r.uniform(2, 8), "width_mm": width, "height_mm": width * r.uniform(0.4, 1.6)}


def finger(r: Numbers) -> dict[str, Any]:
    """Drawn dimensions of a bellows finger."""
    return {
        "pleats": int(r.integers(1, 4)), "length_mm": r.uniform(30, 50), "width_mm": r.uniform(16, 28),
        "height_mm": r.uniform(14, 24), "side_wall_mm": r.uniform(1.5, 2.5),
        "top_wall_mm": r.uniform(1.5, 2.5), "bottom_wall_mm": r.uniform(1.5, 3.5),
        "pleat_depth_mm": r.uniform(2, 7), "side_pleat_depth_mm": r.uniform(0, 3),
        "edge_radius_mm": r.uniform(0.6, 1.2),
    }  # fmt: skip


DRAWN: dict[str, Callable[[Numbers], dict[str, Any]]] = {
    "finger": finger, "pneunet": pneunet, "tube": tube, "bar": bar
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One geometry: why it was not solved, or nothing; how far its tip moves, mm; how far that of the finest
    lattice ends from it, as a share of the largest displacement; whether walls touch; its largest ratio of
    edges and smallest ratio of Jacobians."""

    kind: str
    reason: str
    tip_mm: float
    mesh_error: float
    touches: bool
    edges: float
    jacobian: float


def draws(kind: str, count: int, *, seed: int = 0) -> Iterable[BodyTable]:
    """So many tables of dimensions that fit together."""
    r, found = np.random.default_rng([seed, list(BODIES).index(kind)]), 0
    while found < count:
        try:
            table = BODIES[kind].model_validate(DRAWN[kind](r))
        except ValidationError:
            continue
        found += 1
        yield table


def pressure_of(table: BodyTable) -> float:
    """A moderate pressure in MPa for dimensions: the thinner the walls, the lower; 0 of a bar."""
    own, kind = table.model_dump(), table.body.kind
    if kind == "bar":
        return 0.0
    if kind == "tube":
        sides = (own["width_mm"] - own["chamber_width_mm"], own["height_mm"] - own["chamber_height_mm"])
        wall = min(sides) / 2 - (abs(own["offset_mm"]) if sides[1] <= sides[0] else 0.0)
        side = max(own["chamber_width_mm"], own["chamber_height_mm"])
    else:
        wall = min(own[k] for k in own if k.endswith("_wall_mm"))
        side = max(own["width_mm"], own["height_mm"])
    return LOAD * (SILICONE.C10 + SILICONE.C01) * wall / side


def moved(case: Case, body: Body, pressure: float) -> tuple[Solution, Array]:
    """A solution, and the displacement (3,) mm of its tip."""
    p, down = np.array([0.0, pressure]), np.array([0.0, 0.0, 0.0 if pressure else -G])
    found = solve(case, Path(np.arange(2.0), p, np.array([1.0]), gravity=down))
    if not found.converged:
        return found, np.full(3, np.nan)
    return found, found.at(nearest(case, np.array(body.places[TIP]))[None])[0, 0]


def measured(kind: str, table: BodyTable, *, fine: bool = True) -> Row:
    """The row of one geometry; fine: with the error of its mesh, which takes five times as long."""
    body = table.body
    case = body.case(body.lattice, SILICONE)
    ratio, edges, _, _ = quality(case)
    shape = float(edges.values.max()), float(ratio.values.min())
    if jacobians(case).min() <= 0:
        return Row(kind, "the mesh folds", np.nan, np.nan, False, *shape)
    pressure = pressure_of(table)
    found, tip = moved(case, body, pressure)
    error = np.nan
    if fine and found.converged:
        _, other = moved(body.case(body.finer(body.lattice)["check"], SILICONE), body, pressure)
        error = float(np.linalg.norm(tip - other) / np.linalg.norm(found.fields([0])[0], axis=1).max())
    size = float(np.linalg.norm(tip))
    return Row(kind, "" if found.converged else found.reason, size, error, bool(found.crossed), *shape)


def bodies(
    count: int, kinds: Iterable[str] = tuple(BODIES), *, errors: int | None = None
) -> dict[str, dict[str, float]]:
    """{kind: tried, solved, meshes, mesh_error_max and _median, touching, edges_max, jacobian_min} over draws
    of each kind; errors: of how many, the first, the error of the mesh is found, by default of all."""
    out = {}
    for kind in kinds:
        fine = count if errors is None else errors
        rows = [measured(kind, table, fine=k < fine) for k, table in enumerate(draws(kind, count))]
        solved = [row for row in rows if not row.reason]
        own = np.array([row.mesh_error for row in solved if not row.touches])
        known = own[np.isfinite(own)]
        out[kind] = {
            "tried": len(rows), "solved": len(solved),
            "meshes": len(known), "mesh_error_max": float(known.max()),
            "mesh_error_median": float(np.median(known)),
            "touching": sum(row.touches for row in solved),
            "edges_max": max(row.edges for row in rows), "jacobian_min": min(row.jacobian for row in rows),
        }  # fmt: skip
        print(kind, out[kind], flush=True, file=sys.stderr)
    return out


# -- closed forms --------------------------------------------------------------------------------------------


def bar_against_beam() -> float:
    """The share by which a slender bar's sag under its own weight, made so small that it stays straight,
    differs from Timoshenko's beam: w L^4 / (8 E I) + w L^2 / (2 k G A), k = 5/6."""
    table = BODIES["bar"].model_validate({"length_mm": 200.0, "width_mm": 8.0, "height_mm": 10.0})
    body, few = table.body, 1e-3
    case = body.case(body.lattice, SILICONE)
    found = solve(case, Path(np.arange(2.0), np.zeros(2), np.ones(1), gravity=np.array([0, 0, -few * G])))
    sag = -float(found.at(np.array([[200.0, 0.0, 5.0]]))[0, 0, 2])
    shear = 2 * (SILICONE.C10 + SILICONE.C01)
    w, area, second = few * G * SILICONE.density * 80.0, 80.0, 8.0 * 10.0**3 / 12
    beam = w * 200.0**4 / (8 * 3 * shear * second) + w * 200.0**2 / (2 * 5 / 6 * shear * area)
    return abs(sag / beam - 1)


def tube_against_lame() -> float:
    """The share by which the radius of a round tube's chamber grows otherwise, far from its ends, at a small
    pressure than Lame's thick wall that is closed by end caps: incompressible, E = 3 mu, no axial strain,
    u = p a^2 b^2 / (2 mu a (b^2 - a^2))."""
    a, b, pressure = 4.5, 8.0, 1e-4
    body = BODIES["tube"].model_validate(
        {"length_mm": 120.0, "chamber_width_mm": 2 * a, "chamber_height_mm": 2 * a, "offset_mm": 0.0}
    ).body
    case = body.case(body.lattice, SILICONE)
    p = np.array([0.0, pressure])
    found = solve(case, Path(np.arange(2.0), p, np.ones(1)))
    grows = float(found.at(nearest(case, np.array([60.0, a, b]))[None])[0, 0, 1])
    shear = 2 * (SILICONE.C10 + SILICONE.C01)
    return abs(grows / (pressure * a * b**2 / (2 * shear * (b**2 - a**2))) - 1)


# -- another program -----------------------------------------------------------------------------------------


def pneunet_against_calculix() -> dict[str, float]:
    """The shares by which the tip of a small PneuNet moves otherwise in CalculiX's C3D20R: here in the same
    element on the same mesh, in the project's own element on that mesh, and on the finest lattice."""
    table, pressure = BODIES["pneunet"].model_validate({"chambers": 2, "base_cap_mm": 6.0}), 0.012
    body = table.body
    case = body.case(body.lattice, SILICONE)
    found = CalculiX().solve(case, pressure)
    tip = found.at(NAMED_NODES[TIP])
    cases = {
        "same element": converted(case, "C3D20RH"),
        "own element": case,
        "own element, finest": body.case(body.finer(body.lattice)["check"], SILICONE),
    }
    size = float(np.linalg.norm(tip))
    ends = {name: moved(own, body, pressure)[1] for name, own in cases.items()}
    return {name: float(np.linalg.norm(u - tip)) / size for name, u in ends.items()}


def main() -> int:
    every = ("closed", "calculix", "bodies")
    typed = options(__doc__, {
        "--only": {"nargs": "+", "choices": every, "default": every, "help": "these alone"},
        "--count": (30, "geometries of each kind"),
        "--errors": (30, "of how many of them the error of the mesh is found"),
        "--kinds": {"nargs": "+", "choices": tuple(BODIES), "default": tuple(BODIES), "help": "these alone"},
    }, quick="three geometries of each kind", json="one JSON line")  # fmt: skip
    out: dict[str, Any] = {}
    if "closed" in typed.only:
        out |= {"bar_against_beam": bar_against_beam(), "tube_against_lame": tube_against_lame()}
    if "calculix" in typed.only:
        out["pneunet_against_calculix"] = pneunet_against_calculix()
    if "bodies" in typed.only:
        out["bodies"] = bodies(3 if typed.quick else typed.count, typed.kinds, errors=typed.errors)
    print(json.dumps(out) if typed.json else json.dumps(out, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
