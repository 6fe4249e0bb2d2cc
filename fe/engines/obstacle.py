"""A rigid obstacle in an Abaqus deck: held bricks under its surface, and the contact pair."""

import numpy as np

from fe.case import Case, Contact
from fe.element import Array, Integers
from fe.kernel.contact import off_the_clamp
from fe.obstacles import Flat, Round

REACH, DEPTH = 3.0, 0.2  # of the structure's size: half of a plate, and its thickness
LENGTH = 0.7  # of the structure's size: half of a cylinder; with long thin faces CalculiX is slow
RING, PATCH = 72, 18  # bricks around a cylinder and along the edge of each of a sphere's patches: 5 degrees
HOLLOW = 0.5  # of the radius, inside which a round obstacle is empty
MOST_BRICKS = 10_000


def touched(case: Case, contact: Contact) -> list[str]:
    """The lines of a case's obstacle as held bricks, S2 their outer faces, and of what happens between the
    two surfaces (surface to surface, the same stiffness). ValueError for one on a spring.

    After the coefficient of friction stands the stick slope (MPa/mm), for CalculiX; Abaqus, which takes that
    place for a slip rate, sees one coefficient for all rates and sets a slope of its own.
    """
    if contact.spring is not None:
        raise ValueError("an obstacle on a spring: a deck holds a fixed one only; leave out its spring")
    nodes, bricks = _bricks(case, contact.obstacle)
    labels, elements = int(case.labels.max()) + 1 + np.arange(len(nodes)), len(case.connectivity) + 1
    touching = case.surfaces[contact.surface][off_the_clamp(case, contact.surface)]
    rubs = ["*FRICTION", f"{contact.friction:.10g}, {contact.stiffness:.10g}"] if contact.friction else []
    return [
        "*NODE, NSET=OBSTACLE_NODES",
        *(f"{k}, {x:.10g}, {y:.10g}, {z:.10g}" for k, (x, y, z) in zip(labels, nodes, strict=True)),
        "*ELEMENT, TYPE=C3D8, ELSET=OBSTACLE",
        *(f"{elements + k}, {', '.join(map(str, labels[row]))}" for k, row in enumerate(bricks)),
        *("*MATERIAL, NAME=OBSTACLE", "*ELASTIC", "1000., 0.3"),
        *("*SOLID SECTION, ELSET=OBSTACLE, MATERIAL=OBSTACLE", "*BOUNDARY", "OBSTACLE_NODES, 1, 3"),
        *("*SURFACE, NAME=OBSTACLE_SKIN, TYPE=ELEMENT", "OBSTACLE, S2"),
        *("*SURFACE, NAME=TOUCHING, TYPE=ELEMENT", *(f"{e + 1}, S{f + 1}" for e, f in touching)),
        "*SURFACE INTERACTION, NAME=TOUCH",
        *("*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{contact.stiffness:.10g},", *rubs),
        *("*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE", "TOUCHING, OBSTACLE_SKIN"),
    ]


def _bricks(case: Case, obstacle: Flat | Round) -> tuple[Array, Integers]:
    """Nodes (k, 3) mm and bricks (b, 8) of an obstacle, the last four nodes of each on its surface."""
    middle, size = case.nodes.mean(axis=0), float(np.ptp(case.nodes, axis=0).max())
    if isinstance(obstacle, Flat):
        skins = [_plate(obstacle, middle, size)]
        cores = [skins[0] - DEPTH * size * obstacle.out]
    else:
        c = np.asarray(obstacle.centre, float)
        skins = _sphere(obstacle) if obstacle.axis is None else [_cylinder(obstacle, middle, size)]
        cores = [x - (1 - HOLLOW) * (x - c) @ obstacle.across for x in skins]
    corners = np.concatenate([_between(*pair) for pair in zip(cores, skins, strict=True)])
    nodes, rows = np.unique(np.round(corners.reshape(-1, 3), 9), axis=0, return_inverse=True)
    return nodes, rows.reshape(-1, 8)


def _between(core: Array, skin: Array) -> Array:
    """The corners (b, 8, 3) of bricks between two grids (m, n, 3), counter-clockwise from outside."""
    sides = [x[i : len(x) - 1 + i, j : x.shape[1] - 1 + j] for x in (core, skin)
             for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]  # fmt: skip
    return np.stack(sides, axis=2).reshape(-1, 8, 3)


def _beside(n: Array) -> tuple[Array, Array]:
    """Two ways across a way n (3,) of length 1, the three right-handed."""
    first = np.cross(n, np.eye(3)[np.abs(n).argmin()])
    first /= np.linalg.norm(first)
    return first, np.cross(n, first)


def _plate(plane: Flat, middle: Array, size: float) -> Array:
    first, second = _beside(plane.out)
    middle = middle - plane.height(middle) * plane.out
    ends = REACH * size * np.array([-1.0, 1.0])
    return np.asarray(middle + ends[:, None, None] * first + ends[None, :, None] * second)


def _cylinder(rod: Round, middle: Array, size: float) -> Array:
    a = np.asarray(rod.axis, float) / np.linalg.norm(rod.axis)  # type: ignore[arg-type]
    first, second = _beside(a)
    turn, c = np.linspace(0, 2 * np.pi, RING + 1)[:, None, None], np.asarray(rod.centre, float)
    along = ((middle - c) @ a + LENGTH * size * np.array([-1.0, 1.0]))[None, :, None] * a
    return np.asarray(c + along + rod.radius * (np.cos(turn) * first + np.sin(turn) * second))


def _sphere(ball: Round) -> list[Array]:
    t = np.tan(np.linspace(-np.pi / 4, np.pi / 4, PATCH + 1))
    out = []
    for n in (*np.eye(3), *-np.eye(3)):
        first, second = _beside(n)
        x = n + t[:, None, None] * first + t[None, :, None] * second
        out.append(np.asarray(ball.centre) + ball.radius * x / np.linalg.norm(x, axis=-1, keepdims=True))
    return out
