"""A model at its parameters -> the modes of its own discretisation error, from history-free solves on finer
meshes.

The mesh is refined in one direction at a time (bellows, walls, section) and in two together; the change of
the
prediction on each is one mode, 1 sd. One more mesh, finer in every direction and of the other topology,
measures what
the modes do not carry; that remainder enters as small smooth modes of every marker and axis.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from fe import Finger, Lattice, Path, finger_case, solve
from fe.case import digest
from twin.model import Model
from twin.targets import Array

SAMPLES = 40  # pressures at which a finer mesh's response is sampled
COUNT = 7  # levels of its curve; the base mesh is solved on the same, so that their error cancels
# The check mesh is not the limit. Tried on one truth on a still finer mesh: 2.5 times what it shows was too
# little for an adequate fit, 5 times was enough.
SAFETY = 5.0
SMOOTH = (0.5, 1, 2, 3)  # powers of pressure of the remainder's modes


@dataclass(frozen=True)
class Discretisation:
    """modes (q, s, p, 3) mm, 1 sd each, with names; check (s, p, 3) mm: the change on the mesh that tests
    them;
    remainder_mm: rms of what they leave of it (NaN before it is measured)."""

    modes: Array
    names: tuple[str, ...]
    check: Array
    remainder_mm: float = float("nan")
    spread: Array | None = None  # (q, d): what each mode shifts the base model's parameters by


def finer(lattice: Lattice) -> dict[str, Lattice]:
    """The refined lattices; the last is finer in every direction and of the other topology."""
    bellow = max(lattice.per_bellow + 1, round(1.5 * lattice.per_bellow))
    section = replace(lattice, fillet=2 * lattice.fillet, across=2 * lattice.across, up=2 * lattice.up)
    return {
        "bellows": replace(lattice, per_bellow=bellow),
        "walls": replace(lattice, wall=2 * lattice.wall),
        "section": section,
        "bellows and walls": replace(lattice, per_bellow=bellow, wall=2 * lattice.wall),
        "check": replace(
            section, per_bellow=bellow, wall=2 * lattice.wall, fillet=lattice.fillet, ring=not lattice.ring
        ),
    }


def discretisation(
    model: Model,
    theta: Array,
    *,
    finger: Finger,
    lattice: Lattice,
    keep: Callable[[str, Callable[[], Array]], Array] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Discretisation:
    """The modes of a model of the bellows finger at theta; its remainder is yet to be measured (NaN).

    keep(key, make): returns the array stored under a digest, or makes and stores it. progress(stage, done,
    total).
    """
    test = model.put(model.named(theta))
    q = model.solution(theta).pressure
    material = replace(test.case.materials["body"], prony=())
    points, meshes = test.points[test.moving], finer(lattice)
    grid = np.linspace(0.0, max(float(q.max()), 1e-6), SAMPLES)
    u = {}
    for k, (name, mesh) in enumerate({"base": lattice, **meshes}.items()):
        if progress:
            progress("discretisation error", k, len(meshes) + 1)

        def make(mesh: Lattice = mesh) -> Array:
            case = replace(finger_case(material, finger=finger, lattice=mesh), forces=test.case.forces)
            return solve(case, Path(grid, grid, grid), count=COUNT).at(points)

        key = digest("discretisation", finger, mesh, material, points, grid, COUNT)
        u[name] = keep(key, make) if keep else make()
    modes = np.zeros((len(meshes), len(q), len(test.points), 3))
    for k, name in enumerate(meshes):
        change = _at(grid, u[name] - u["base"], q)
        modes[k][:, test.moving] = change - change[model.reference].mean(axis=0)
    names = tuple(f"discretisation:{name}" for name in meshes)
    return Discretisation(modes[:-1], names[:-1], modes[-1])


def _at(grid: Array, values: Array, q: Array) -> Array:
    return CubicSpline(grid, values, axis=0)(np.clip(q, grid[0], grid[-1]))


def with_remainder(
    mesh: Discretisation, size: float, pressure: Array, moving: Any, reference: Any
) -> Discretisation:
    """The modes and, for what they do not carry, smooth modes of `size` mm for every moving marker and
    axis."""
    x = np.clip(pressure / max(float(pressure.max()), 1e-12), 0.0, None)
    smooth = []
    for point in np.flatnonzero(moving):
        for axis in range(3):
            for power in SMOOTH:
                mode = np.zeros(mesh.modes.shape[1:])
                mode[:, point, axis] = SAFETY * size * x**power
                smooth.append(mode - mode[reference].mean(axis=0))
    names = (*mesh.names, *("discretisation:remainder",) * len(smooth))
    modes = np.concatenate([mesh.modes, np.array(smooth)])
    return replace(mesh, modes=modes, names=names, remainder_mm=size)
