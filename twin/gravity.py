"""Gravity, loads and shares of the pressure in a recording, and the parts of a symmetric model they need.

Gravity is an acceleration (3,) in mm/s2 in world axes. The targets state a direction for each block (one
recording in one orientation), what hangs on the finger in it, and which of several chambers carry the
pressure; `of_targets`, `pulls_of` and `shares_of` make the courses that a path needs, `ways` lists the
different ones that act on its steps.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fe import Case, Path
from fe.element import Integers
from fe.mesh.mirror import AXIS, middle_plane, mirrored, symmetry_support
from twin.targets import Array, Load, Targets

G = 9810.0  # mm/s2
TONNE_PER_MM3 = 1e-12  # of one kg/m3
ACROSS = 1e-6  # of gravity's size: a smaller part across the plane of symmetry is rounding
ON_PLANE = 1e-6  # mm


def density(kg_m3: float) -> float:
    """A density in tonne/mm3 from one in kg/m3.

    >>> density(1070.0)
    1.07e-09
    """
    return TONNE_PER_MM3 * kg_m3


def with_density(case: Case, kg_m3: float | None) -> Case:
    """The case whose materials all have a density: their own, or the given one where they have none."""
    bare = [name for name, m in case.materials.items() if not m.density]
    if bare and kg_m3 is None:
        raise ValueError(
            f"density of the silicone ({', '.join(bare)}): not stated, and frequencies need its mass; add "
            "density_kg_m3 under [model] of twin.toml (then the model has weight, and twin calibrate runs "
            "again), or type --density 1070 (kg/m3) here"
        )
    typed = density(kg_m3 or 0.0)
    given = {name: replace(m, density=m.density or typed) for name, m in case.materials.items()}
    return replace(case, materials=given)


def of_targets(targets: Targets) -> Array:
    """Gravity (3,) or (t, 3) mm/s2 at the times of the pressure log: of the block whose steps are
    nearest; zero where the targets state none."""
    if targets.gravity is None:
        return np.zeros(3)
    return G * targets.gravity[_block_of_log(targets)] * _acting(targets)[:, None]


def pulls_of(targets: Targets, position: Callable[[int], Array]) -> tuple[Array, Array]:
    """The places (h, 3) mm at which loads of the targets pull, and their forces (t, h, 3) N at the times of
    the pressure log. position(label) is that of a node. ValueError for a weight without gravity."""
    points = {point.name: point for point in targets.points}
    positions = [
        points[load.at].place(position) if isinstance(load.at, str) else np.array(load.at)
        for load in targets.loads
    ]
    if not positions:
        return np.zeros((0, 3)), np.zeros((0, 3))
    places, which = np.unique(np.array(positions), axis=0, return_inverse=True)
    force = np.zeros((int(targets.block[-1]) + 1, len(places), 3))
    for load, k in zip(targets.loads, which.reshape(-1), strict=True):
        force[load.block, k] += force_of(load, targets)
    return places, force[_block_of_log(targets)] * _acting(targets)[:, None, None]


def unmoved(targets: Targets, case: Case) -> str:
    """Fault of targets in which nothing that moves a case differs from the rest they are relative to:
    pressure, weight, loads; "" without one. ValueError as `pulls_of`."""
    if case.forces or case.growing or any(s.value is not None for s in case.supports):
        return ""
    weight = of_targets(targets) if is_heavy(case) else np.zeros(3)
    courses = targets.log_pressure, np.atleast_2d(weight), pulls_of(targets, case.position)[1]
    rest = _block_of_log(targets) * bool(targets.rests.any())
    for course in (x for x in courses if len(x) == len(rest)):
        if any(np.ptp(course[rest == r], axis=0).any() for r in np.unique(rest)):
            return ""
    return (
        f"nothing moves the body: its pressure is {1e3 * targets.log_pressure[0]:.3g} kPa in all steps, its "
        "weight and its loads are those of its rest; wanted a pressure that changes, one [reference] for "
        "blocks of other loads, or density_kg_m3 or loads with released = true"
    )


def shares_of(targets: Targets, case: Case) -> tuple[tuple[str, ...], Array]:
    """The surfaces (c,) that the targets state shares of the pressure of, and these (t, c) at the times of
    the pressure log. ValueError for a surface that the case does not put under pressure."""
    if not targets.shares:
        return (), np.zeros(0)
    faces = case.surfaces[case.pressurised].tolist() if case.pressurised else []
    loaded = {
        name for name, region in case.surfaces.items()
        if name != case.pressurised and len(region) and all(face in faces for face in region.tolist())
    }  # fmt: skip
    for name in targets.shares:
        if name not in loaded:
            choices = ", ".join(sorted(loaded)) or "a deck with a pressure on each of several surfaces"
            raise ValueError(
                f"pressure_shares: the model has no pressure on a surface {name!r}; wanted {choices}"
            )
    every = np.stack(list(targets.shares.values()), axis=1)
    return tuple(targets.shares), every[_block_of_log(targets)]


def force_of(load: Load, targets: Targets) -> Array:
    """The force (3,) N of a load. ValueError for a weight in a block whose gravity nobody states."""
    if load.weight_g is None:
        return np.array(load.force)
    if targets.gravity is None:
        raise ValueError(
            f"targets.toml: block {load.block} has a weight of {load.weight_g:g} g, which pulls along "
            "gravity; wanted its direction: add gravity = [0.0, 0.0, -1.0] to every block, or under [model] "
            "in twin.toml"
        )
    return np.asarray(1e-6 * load.weight_g * G * targets.gravity[load.block])


def _acting(targets: Targets) -> Array:
    """1 at the times (t,) of the pressure log, 0 in the rest of a block that is released after it."""
    out, block = np.ones(len(targets.log_time)), _block_of_log(targets)
    for b in targets.released:
        rest = targets.reference[targets.block[targets.reference] == b]
        out[(block == b) & (targets.log_time <= targets.time[rest].max())] = 0.0
    return out


def _block_of_log(targets: Targets) -> Integers:
    """The block (t,) of each time of the pressure log: of the nearest step."""
    last = np.flatnonzero(np.diff(targets.block))
    switch = (targets.time[last] + targets.time[last + 1]) / 2
    return np.searchsorted(switch, targets.log_time)


def ways(case: Case, path: Path) -> tuple[Array, Integers]:
    """The different gravities in mm/s2, pulls in N and shares of the pressure (g, 3 + 3 h + c) that act on a
    path's output steps, and which of them (s,) on each; gravity is zero where nothing in the case has a
    density."""
    every = path.outside_at(path.output)
    every[:, :3] *= is_heavy(case)
    distinct, number = np.unique(every, axis=0, return_inverse=True)
    return distinct, number.reshape(-1)


def is_heavy(case: Case) -> bool:
    """True where any material of a case has a density."""
    return any(m.density for m in case.materials.values())


def is_across(gravity: Array) -> bool:
    """True for a gravity (3,) with a part across the plane y = 0.

    >>> is_across(np.array([0.0, 9810.0, 0.0])), is_across(np.array([0.0, 0.0, -9810.0]))
    (True, False)
    """
    return bool(abs(gravity[1]) > ACROSS * np.linalg.norm(gravity))


def pulls_across(path: Path) -> bool:
    """True where the gravity of a path has a part across the plane y = 0 at any time."""
    return any(is_across(g) for g in np.atleast_2d(path.gravity))


def hangs_aside(case: Case, path: Path) -> bool:
    """True where a load of a path pulls across the plane of symmetry, or beside it, at any time."""
    pulls = path.pulls if path.pulls.ndim == 3 else path.pulls[None]
    aside = np.abs(path.places[:, AXIS] - middle_plane(case)) > ON_PLANE
    return bool((pulls[..., AXIS] != 0).any() or (pulls != 0).any(axis=(0, 2))[aside].any())


def under(case: Case, path: Path) -> Case:
    """The case to be solved along a path: the whole mesh where weight or a load pulls across the plane of a
    half, else the case itself."""
    across = (is_heavy(case) and pulls_across(path)) or hangs_aside(case, path)
    return mirrored(case) if across and symmetry_support(case) is not None else case
