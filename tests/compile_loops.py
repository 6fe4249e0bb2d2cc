"""Calls every compiled loop once, so that numba's cache on the disk holds them all.

Two test workers that start on a fresh checkout would otherwise both compile the same loops.
"""

from dataclasses import replace

import numpy as np

from fe import Finger, Lattice, Material, Path, Variation, finger_case, solve
from fe.kernel.selfcontact import SelfFaces
from fe.mesh.inner import closing
from vision.following.registration import NO_LENS, local_grid, patches, register, templates


def solve_with_memory() -> None:
    """A coarse finger of one bellow that creeps and softens, with a derivative."""
    material = Material(0.2, 0.1, prony=((0.1, 1.0),), mullins=(2.0, 1e-3, 0.1))
    case = finger_case(material, finger=Finger(bellows=1), lattice=Lattice(per_bellow=2))
    time = np.array([0.0, 1.0, 2.0])
    path = Path(time, np.array([0.0, 2e-3, 1e-3]), time)
    stiffer = replace(case, materials={k: replace(m, C10=0.21) for k, m in case.materials.items()})
    solve(case, path, variations=[Variation((stiffer, path), (case, path), 0.01)])
    plain = case.with_material(prony=(), mullins=None)
    solve(plain, path)
    folded = closing(plain)  # its walls at once pushed through each other
    SelfFaces(folded).force(folded.nodes * [0.0, 1.0, 1.0])


def register_a_patch() -> None:
    """A smooth patch laid on its own picture, from a fraction of a pixel away."""
    y, x = np.mgrid[0.0:60.0, 0.0:60.0]
    picture = (127 + 60 * np.sin(x / 5) * np.cos(y / 6)).astype(np.uint8)
    warp = np.array([[[10.0, 0.0, 30.0], [0.0, 10.0, 30.0], [0.0, 0.0, 1.0]]])
    grid = local_grid(15, 1.0)
    reference = templates(patches(picture, NO_LENS, warp, grid), grid)
    start = warp + np.array([[0.0, 0.0, 0.3], [0.0, 0.0, 0.2], [0.0, 0.0, 0.0]])
    register(picture, NO_LENS, reference, start, np.array([10.0]), np.array([0]))


if __name__ == "__main__":
    solve_with_memory()
    register_a_patch()
