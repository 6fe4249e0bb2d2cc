"""Self-contact of a whole skin."""

from dataclasses import replace

import numpy as np

from fe.case import Case, SelfContact
from fe.mesh.refine import free_faces

SKIN = "skin"


def closing(case: Case) -> Case:
    """The case with self-contact: the pressurised faces cannot pass through each other, nor can the other
    free faces (the surface SKIN), except in planes of symmetry and at the clamp."""
    faces, width = free_faces(case), len(case.element.faces)
    nodes = np.take_along_axis(case.connectivity[faces[:, 0]], case.element.faces[faces[:, 1]], axis=1)
    held = case.supported
    held[case.clamped] = True
    apart = ~np.any(np.all(held[nodes], axis=1), axis=1)
    inner = case.surfaces[case.pressurised] if case.pressurised else np.empty((0, 2), np.int64)
    apart &= ~np.isin(faces @ [width, 1], inner @ [width, 1])
    pairs = [SelfContact(SKIN, SKIN)]
    if case.pressurised:
        pairs.append(SelfContact(case.pressurised, case.pressurised))
    return replace(case, surfaces={**case.surfaces, SKIN: faces[apart]}, self_contact=tuple(pairs))
