"""The whole structure of a half model that is symmetric about a plane."""

from dataclasses import replace

import numpy as np

from fe.case import Block, Case, Contact, Support
from fe.element import Array, Element, Integers

AXIS = 1  # y, across which halves are symmetric
_SAME = 1e-6  # of the structure's size: nodes that near to a plane lie on it


def symmetry_support(case: Case) -> Support | None:
    """The support that stands for the other half: it holds component U2 alone, of all nodes of a plane
    across y which bounds the structure; None where there is none."""
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
    """Where y of the plane is in mm that a half model is symmetric about, or of the middle of a whole one."""
    held, along = symmetry_support(case), case.nodes[:, AXIS]
    return float(along[case.node_sets[held.nodes][0]] if held else (along.min() + along.max()) / 2)


def mirrored(case: Case) -> Case:
    """The whole structure of a half model that is supported by its plane of symmetry across y.

    Nodes of the half keep their rows and labels; images come after them. Every set holds both halves; forces
    and prescribed displacements are there twice, an obstacle's spring is twice as stiff, and a clamp is as
    compliant to the moment of the whole as it was to twice that of the half. ValueError where there is no
    such plane.
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
    flip = np.ones(3)
    flip[AXIS] = -1.0
    other = case.nodes[off] * flip
    other[:, AXIS] += 2 * case.nodes[on[0], AXIS]
    order, faces = _reflected(case.element)
    sets = {name: _both(rows, image) for name, rows in case.node_sets.items()}
    forces: dict[str, Array] = {}
    growing: dict[str, Array] = {}
    for given, twice in ((case.forces, forces), (case.growing, growing)):
        for name, force in given.items():
            for end, rows, turned in (("half", case.node_sets[name], force), ("image", None, force * flip)):
                sets[f"{name}_{end}"] = image[case.node_sets[name]] if rows is None else rows
                twice[f"{name}_{end}"] = np.asarray(turned, float)
    return replace(
        case,
        nodes=np.concatenate([case.nodes, other]),
        labels=np.concatenate([case.labels, case.labels.max() + 1 + np.arange(len(off))]),
        blocks=(*case.blocks, *(Block(b.type, image[b.connectivity[:, order]]) for b in case.blocks)),
        node_sets=sets,
        element_sets={name: np.concatenate([e, e + size]) for name, e in case.element_sets.items()},
        surfaces={
            name: np.concatenate([f, np.stack([f[:, 0] + size, faces[f[:, 1]]], axis=1)])
            for name, f in case.surfaces.items()
        },
        supports=tuple(_support(s, case, image, flip) for s in case.supports if s is not held),
        clamp=case.clamp and replace(case.clamp, compliance=case.clamp.compliance / 2),
        forces=forces,
        growing=growing,
        contact=case.contact and _doubled(case.contact),
    )


def _doubled(contact: Contact) -> Contact:
    """The contact of the whole: of a spring there was half."""
    spring = contact.spring and replace(contact.spring, stiffness=2 * contact.spring.stiffness)
    return replace(contact, spring=spring)


def _both(rows: Integers, image: Integers) -> Integers:
    """The rows of a set and those of its image that are not in it."""
    return np.concatenate([rows, np.setdiff1d(image[rows], rows)])


def _support(s: Support, case: Case, image: Integers, flip: Array) -> Support:
    """The support on both halves."""
    if s.value is None:
        return s
    rows = case.node_sets[s.nodes]
    value = dict(zip(image[rows].tolist(), s.value * flip, strict=True))
    extra = [value[int(k)] for k in np.setdiff1d(image[rows], rows)]
    return replace(s, value=np.concatenate([s.value, np.array(extra).reshape(-1, 3)]))


def _reflected(element: Element) -> tuple[Integers, Integers]:
    """The order of an element's nodes in its mirror image, which must not be inside out, and the number that
    each face has there."""
    local = element.local.copy()
    if element.simplex:
        local[:, [0, 1]] = local[:, [1, 0]]
    else:
        local[:, 0] *= -1
    order = np.array([int(np.abs(element.local - x).sum(axis=1).argmin()) for x in local])
    found = [{int(np.flatnonzero(order == a)[0]) for a in face} for face in element.faces]
    return order, np.array([[set(f.tolist()) for f in element.faces].index(s) for s in found])
