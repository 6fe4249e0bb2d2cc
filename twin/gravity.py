"""Gravity: its size, its direction in a recording, and what the weight of a structure asks of its model.

Gravity is an acceleration (3,) in mm/s2 in world axes. The targets state a direction for each block (one
recording in one orientation); `of_targets` makes the course that a path needs, `ways` lists the different
gravities that act on its steps.
"""

import numpy as np

from fe import Case, Path
from fe.element import Integers
from fe.mesh.mirror import mirrored, symmetry_support
from twin.targets import Array, Targets

G = 9810.0  # mm/s2
TONNE_PER_MM3 = 1e-12  # of one kg/m3
ACROSS = 1e-6  # of gravity's size: a smaller part across the plane of symmetry is rounding


def density(kg_m3: float) -> float:
    """A density in tonne/mm3 from one in kg/m3."""
    return TONNE_PER_MM3 * kg_m3


def of_targets(targets: Targets) -> Array:
    """Gravity (3,) or (t, 3) mm/s2 at the times of the pressure log: that of the block whose steps are
    nearest; zero where the targets state none."""
    if targets.gravity is None:
        return np.zeros(3)
    last = np.flatnonzero(np.diff(targets.block))
    switch = (targets.time[last] + targets.time[last + 1]) / 2
    return G * targets.gravity[np.searchsorted(switch, targets.log_time)]


def ways(case: Case, path: Path) -> tuple[Array, Integers]:
    """The different gravities (g, 3) mm/s2 that act on a path's output steps, and which of them (s,) on each;
    zero alone where nothing in the case has a density."""
    every = path.gravity_at(path.output) * is_heavy(case)
    found, number = np.unique(every, axis=0, return_inverse=True)
    return found, number.reshape(-1)


def is_heavy(case: Case) -> bool:
    """Whether any material of a case has a density."""
    return any(m.density for m in case.materials.values())


def is_across(gravity: Array) -> bool:
    """Whether a gravity (3,) has a part across the plane y = 0."""
    return bool(abs(gravity[1]) > ACROSS * np.linalg.norm(gravity))


def pulls_across(path: Path) -> bool:
    """Whether the gravity of a path has a part across the plane y = 0 at any time."""
    return any(is_across(g) for g in np.atleast_2d(path.gravity))


def under(case: Case, gravity: Array) -> Case:
    """The case to be solved in a gravity (3,): the whole mesh where weight pulls across the plane of a half,
    else the case itself."""
    halved = is_heavy(case) and is_across(gravity) and symmetry_support(case) is not None
    return mirrored(case) if halved else case
