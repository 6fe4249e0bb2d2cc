"""Places in a mesh whose walls are not as drawn."""

from dataclasses import replace

import numpy as np

from fe import Lattice, Material, finger_case
from fe.mesh.inner import inside
from fe.mesh.points import interpolation
from tests.fe.conftest import SHORT


def test_every_node_is_found_where_walls_are_bent() -> None:
    """Newton's method from the centre of an element with a bent wall may end outside it, at another root."""
    case = finger_case(Material(C10=0.1), finger=SHORT, lattice=Lattice(per_bellow=1))
    inner = inside(case)
    x = inner.position[:, 0]
    thinner = -0.8 * ((x - x.min()) / np.ptp(x) - 0.5)[:, None] * inner.normal * [0.0, 1.0, 1.0]
    case = replace(case, nodes=case.nodes + inner.spread(thinner))
    np.testing.assert_allclose(interpolation(case, case.nodes) @ case.nodes, case.nodes, atol=1e-9)
