"""The whole structure of a half model that is symmetric about a plane."""

from dataclasses import replace

import numpy as np

from fe.case import Block, Case, Contact, Support
from fe.element import Array, Element, Integers

AXIS = 1  # y, across which halves are symmetric
_FLIP = np.where(np.arange(3) == AXIS, -1.0, 1.0)
_SAME = 1e-6  # of the structure's size: nodes that near to a plane lie on it


def symmetry_support(case: Case) -> Support | None:
    """The support that models the symmetry plane: it holds component U2 alone, at all nodes of a plane across
    y which bounds the structure; None if there is none."""
    along = case.nodes[:, AXIS]
    near = _SAME * float(np.ptp(case.nodes, axis=0).max())
    for s in case.supports:
        rows = case.node_sets[s.nodes]
        if s.components != (AXIS,) or s.value is not None or not len(rows):
            continue
        gap = along - along[rows[0]]
        bounds = gap.min() > -near or gap.max() < near
        if bounds and np.array_equal(np.sort(rows), np.flatnonzero(np.abs(gap) < near)):
            return s
    return None


def middle_plane(case: Case) -> float:
    """Coordinate y in mm of a half model's plane of symmetry, or of the middle of a whole model."""
    held, along = symmetry_support(case), case.nodes[:, AXIS]
    return float(along[case.node_sets[held.nodes][0]] if held else (along.min() + along.max()) / 2)


def mirrored(case: Case) -> Case:
    """The whole structure of a half model that is supported by its plane of symmetry across y.

    Nodes of the half keep their rows and labels; images come after them. Every set holds both halves; forces
    and prescribed displacements are doubled, an obstacle's spring is twice as stiff, and the clamp's
    compliance is halved. ValueError where there is no such plane.

    >>> from fe import Lattice, Material, finger_case
    >>> case = finger_case(Material(C10=0.1), lattice=Lattice(per_bellow=1))
    >>> whole = mirrored(case)
    >>> len(whole.connectivity) == 2 * len(case.connectivity), symmetry_support(whole) is None
    (True, True)
    """
    held = symmetry_support(case)
    if held is None:
        raise ValueError(
            "a half model without a plane of symmetry across y: wanted a support of "
            "U2 alone on all nodes of the plane that bounds it; add it, or give the whole model"
        )
    count, size = len(case.nodes), len(case.connectivity)
    on = case.node_sets[held.nodes]
    off = np.setdiff1d(np.arange(count), on)
    image = np.arange(count)
    image[off] = count + np.arange(len(off))
    opposite = case.nodes[off] * _FLIP
    opposite[:, AXIS] += 2 * case.nodes[on[0], AXIS]
    order, faces = _reflected(case.element)
    sets = {name: _both(rows, image) for name, rows in case.node_sets.items()}
    forces: dict[str, Array] = {}
    growing: dict[str, Array] = {}
    for forces_of_half, twice in ((case.forces, forces), (case.growing, growing)):
        for name, force in forces_of_half.items():
            for end, rows, turned in (("half", case.node_sets[name], force), ("image", None, force * _FLIP)):
                sets[f"{name}_{end}"] = image[case.node_sets[name]] if rows is None else rows
                twice[f"{name}_{end}"] = np.asarray(turned, float)
    return replace(
        case,
        nodes=np.concatenate([case.nodes, opposite]),
        labels=np.concatenate([case.labels, case.labels.max() + 1 + np.arange(len(off))]),
        blocks=(*case.blocks, *(Block(b.type, image[b.connectivity[:, order]]) for b in case.blocks)),
        node_sets=sets,
        element_sets={name: np.concatenate([e, e + size]) for name, e in case.element_sets.items()},
        surfaces={
            name: np.concatenate([f, np.stack([f[:, 0] + size, faces[f[:, 1]]], axis=1)])
            for name, f in case.surfaces.items()
        },
        supports=tuple(_support(s, case, image) for s in case.supports if s is not held),
        clamp=case.clamp and replace(case.clamp, compliance=case.clamp.compliance / 2),
        forces=forces,
        growing=growing,
        contact=case.contact and _doubled(case.contact),
    )


def _doubled(contact: Contact) -> Contact:
    """The contact of the whole model: its spring is twice as stiff."""
    spring = contact.spring and replace(contact.spring, stiffness=2 * contact.spring.stiffness)
    return replace(contact, spring=spring)


def _both(rows: Integers, image: Integers) -> Integers:
    """Rows of a set, followed by the rows of its mirror image that are not in it."""
    return np.concatenate([rows, np.setdiff1d(image[rows], rows)])


def _support(s: Support, case: Case, image: Integers) -> Support:
    """The support on both halves."""
    if s.value is None:
        return s
    rows = case.node_sets[s.nodes]
    value = dict(zip(image[rows].tolist(), s.value * _FLIP, strict=True))
    extra = [value[int(k)] for k in np.setdiff1d(image[rows], rows)]
    return replace(s, value=np.concatenate([s.value, np.array(extra).reshape(-1, 3)]))


def images(half: Case, fields: Array) -> Array:
    """Vectors (..., n, 3) at the nodes of a half model, with their mirror images at those of `mirrored`."""
    held = symmetry_support(half)
    assert held is not None
    off = np.setdiff1d(np.arange(len(half.nodes)), half.node_sets[held.nodes])
    return np.concatenate([fields, fields[..., off, :] * _FLIP], axis=-2)


def modes_of_images(element: Element, p: Array) -> Array:
    """Pressure modes (..., e, m) of elements, followed by those of their mirror images."""
    if element.modes == "linear":  # 1, x, y, z
        other = p * np.append(1.0, _FLIP)
    elif element.modes == "constant":
        other = p
    else:
        local = element.points if element.modes == "points" else element.local[: p.shape[-1]]
        other = p[..., _order(local, element)]
    return np.concatenate([p, other], axis=-2)


def _order(local: Array, element: Element) -> Integers:
    """Where each of some local coordinates (k, 3) of an element lies in its mirror image."""
    image = local.copy()
    if element.simplex:
        image[:, [0, 1]] = image[:, [1, 0]]
    else:
        image[:, 0] *= -1
    return np.array([int(np.abs(local - x).sum(axis=1).argmin()) for x in image])


def _reflected(element: Element) -> tuple[Integers, Integers]:
    """Order of an element's nodes in its mirror image, with positive volume, and the face number of each face
    there."""
    order = _order(element.local, element)
    images = [{int(np.flatnonzero(order == a)[0]) for a in face} for face in element.faces]
    return order, np.array([[set(f.tolist()) for f in element.faces].index(s) for s in images])
