"""Chambers in a row that touch each other under pressure, in this kernel and in CalculiX."""

from dataclasses import replace

from benchmarks.kernel.convergence import SILICONE

import numpy as np

from fe import Block, Case, Clamp, Path, Support, solve
from fe.case import SelfContact
from fe.element import Array, Flags, Integers
from fe.engines.calculix import CalculiX
from fe.engines.writer import deck
from fe.mesh.convert import converted

TOUCH = 0.02  # MPa, of the two chambers
STIFFNESS = 20.0  # 1/mm
BASE, END, WALL, CAVITY, GAP = 2.0, 1.0, 1.0, 4.0, 1.0  # mm along x
HALF_WIDTH, SIDE, CHANNEL = 8.0, 1.5, 1.5  # mm across; the channel's half width
FLOOR, SLOT, CEILING, HEIGHT = 2.0, 5.0, 14.0, 15.5  # mm up: of the chambers, of the gaps, of all
ROOF = 3.5  # mm, the channel's


def grid(*parts: tuple[float, int]) -> Array:
    """Cell boundaries in mm from lengths and how often each is divided."""
    out = [0.0]
    for length, n in parts:
        out += list(out[-1] + length * np.arange(1, n + 1) / n)
    return np.array(out)


def row(chambers: int, *, fine: int = 2) -> Case:
    """The half of chambers in a row over a channel, clamped at x = 0; fine: cells along a cavity.

    Surfaces chamber, outside, and for every gap left0, right0, left1, ..: the walls that face each other.
    """
    one = [(WALL, 1), (CAVITY, fine), (WALL, 1)]
    x = grid((BASE, 1), *[part for k in range(chambers) for part in ([(GAP, 1)] * (k > 0) + one)], (END, 1))
    y = grid((CHANNEL, 1), (HALF_WIDTH - SIDE - CHANNEL, fine + 1), (SIDE, 1))
    walls = (CEILING - SLOT, 2 * fine), (HEIGHT - CEILING, 1)
    z = grid((FLOOR, 1), (ROOF - FLOOR, 1), (SLOT - ROOF, 1), *walls)
    X, Y, Z = np.meshgrid(*((v[1:] + v[:-1]) / 2 for v in (x, y, z)), indexing="ij")
    pitch, inside = 2 * WALL + CAVITY + GAP, (x[-1] - END > X) & (X > BASE)
    s = (X - BASE) % pitch
    cavity = inside & (s > WALL) & (s < WALL + CAVITY) & (Y < HALF_WIDTH - SIDE) & (Z > FLOOR) & (Z < CEILING)
    along = (X > BASE + WALL) & (x[-1] - END - WALL > X)
    void = cavity | (along & (Y < CHANNEL) & (Z > FLOOR) & (Z < ROOF))
    return _assembled((x, y, z), ~(void | (inside & (s > 2 * WALL + CAVITY) & (Z > SLOT))), void)


def _assembled(lines: tuple[Array, ...], solid: Flags, void: Flags) -> Case:
    """The case of the solid cells of a grid; void: those of the chamber."""
    places = [np.sort(np.concatenate([v, (v[1:] + v[:-1]) / 2])) for v in lines]
    nodes = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 3)
    local = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]
    cell = np.argwhere(solid)
    index = np.moveaxis(2 * cell[:, None] + local, -1, 0)
    number = np.ravel_multi_index(tuple(index), [len(v) for v in places])
    used, rows = np.unique(number, return_inverse=True)
    nodes, kind = nodes[used], np.pad(np.where(solid, 1, np.where(void, 2, 0)), 1)
    surfaces: dict[str, list[Integers]] = {"chamber": [], "outside": []}
    for face, (axis, side) in enumerate((a, s) for a in range(3) for s in (-1, 1)):
        beside = cell + 1
        beside[:, axis] += side
        hidden = (cell[:, axis] == 0) & (face in (0, 2))  # the clamp, the plane of symmetry
        for name, what in (("chamber", 2), ("outside", 0)):
            e = np.flatnonzero((kind[tuple(beside.T)] == what) & ~hidden)
            surfaces[name].append(np.stack([e, np.full_like(e, face)], axis=1))
    case = Case(
        nodes, labels=np.arange(1, len(nodes) + 1), blocks=(Block("hex27", rows.reshape(-1, 27)),),
        node_sets={"root": np.flatnonzero(nodes[:, 0] == 0), "symmetry": np.flatnonzero(nodes[:, 1] == 0)},
        element_sets={"body": np.arange(len(cell))},
        surfaces={k: np.concatenate(v) for k, v in surfaces.items()},
        materials={"body": SILICONE}, supports=(Support("symmetry", (1,)),), clamp=Clamp("root", (0.0, 0.0)),
        pressurised="chamber",
    )  # fmt: skip
    return replace(case, surfaces={**case.surfaces, **_facing(case, float(lines[0][-1]))})


def _facing(case: Case, length: float) -> dict[str, Integers]:
    """The two walls of every gap."""
    faces, x = case.surfaces["outside"], case.nodes[case.face_nodes("outside")].mean(axis=1)[:, 0]
    out = {}
    for n in range(1_000):
        left = BASE + 2 * WALL + CAVITY + n * (2 * WALL + CAVITY + GAP)
        if left > length - END - WALL:
            break
        for name, place, face in (("left", left, 1), ("right", left + GAP, 0)):
            out[f"{name}{n}"] = faces[(np.abs(x - place) < 1e-9) & (faces[:, 1] == face)]
    return out


def paired(case: Case) -> Case:
    """The row whose facing walls may touch each other, gap by gap."""
    count = sum(name.startswith("left") for name in case.surfaces)
    return replace(
        case, self_contact=tuple(SelfContact(f"left{n}", f"right{n}", STIFFNESS) for n in range(count))
    )


def against_ccx() -> dict[str, float]:
    """Largest difference of two coarse chambers of C3D20R between this kernel and ccx, with the same pairs of
    surfaces and the same stiffness: over the largest displacement, and over what contact changes."""
    case = converted(paired(row(2, fine=1)), "C3D20R")
    theirs = CalculiX().run(deck(case, TOUCH))
    course = Path(np.array([0.0, 1.0]), np.array([0.0, TOUCH]), np.ones(1))
    both = [solve(c, course) for c in (case, replace(case, self_contact=()))]
    assert theirs.converged
    assert all(solution.converged for solution in both)
    ours, free = (solution.fields([0])[0] for solution in both)
    off = np.abs(ours - np.array([theirs.at(n) for n in case.labels])).max()
    return {"self_contact_ccx": float(off / np.abs(ours).max()), "self_contact_effect": float(off / np.abs(ours - free).max())}
