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
    """Lines of a deck for a case's obstacle: fixed bricks, whose faces S2 form its surface, and a contact
    pair (surface to surface) with the case's stiffness. ValueError for an obstacle on a spring.

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
    """Two unit vectors (3,) normal to n (3,) and to each other, right-handed with it."""
    tangent = np.cross(n, np.eye(3)[np.abs(n).argmin()])
    tangent /= np.linalg.norm(tangent)
    return tangent, np.cross(n, tangent)


def _plate(plane: Flat, middle: Array, size: float) -> Array:
    s, t = _beside(plane.out)
    middle = middle - plane.height(middle) * plane.out
    ends = REACH * size * np.array([-1.0, 1.0])
    return np.asarray(middle + ends[:, None, None] * s + ends[None, :, None] * t)


def _cylinder(rod: Round, middle: Array, size: float) -> Array:
    a = np.asarray(rod.axis, float) / np.linalg.norm(rod.axis)  # type: ignore[arg-type]
    s, t = _beside(a)
    turn, c = np.linspace(0, 2 * np.pi, RING + 1)[:, None, None], np.asarray(rod.centre, float)
    along = ((middle - c) @ a + LENGTH * size * np.array([-1.0, 1.0]))[None, :, None] * a
    return np.asarray(c + along + rod.radius * (np.cos(turn) * s + np.sin(turn) * t))


def _sphere(ball: Round) -> list[Array]:
    t = np.tan(np.linspace(-np.pi / 4, np.pi / 4, PATCH + 1))
    out = []
    for n in (*np.eye(3), *-np.eye(3)):
        u, v = _beside(n)
        x = n + t[:, None, None] * u + t[None, :, None] * v
        out.append(np.asarray(ball.centre) + ball.radius * x / np.linalg.norm(x, axis=-1, keepdims=True))
    return out
