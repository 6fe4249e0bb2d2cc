"""Small structures that several tests solve."""

from collections.abc import Callable

import numpy as np
import pytest

from fe import Block, Case, Finger, Lattice, Material, Support, finger_case

SILICONE = Material(C10=0.214, C01=0.083)
SHORT = Finger(
    length=10 + 100 / 3, bellows=3, tip_node=(10 + 100 / 3, 11.5, 0.0), middle_node=(4 + 50 / 3, 11.5, 0.0)
)
STUB = Finger(
    length=10 + 100 / 9, bellows=1, tip_node=(10 + 100 / 9, 11.5, 0.0), middle_node=(4 + 50 / 9, 11.5, 0.0)
)
COARSE = Lattice(per_bellow=2, ring=False, centred=False)


def brick(
    divisions: tuple[int, int, int],
    *,
    material: Material = SILICONE,
    supports: tuple[Support, ...] = (),
    shift: float = 0.0,
    seed: int = 0,
    pressurised: str | None = None,
) -> Case:
    """A unit cube of hexahedra, every node moved at random by up to `shift` of an element's size.

    Node sets x0, x1, y0, ... z1 and boundary; surfaces of the same names, and `skin`, all of them.
    """
    n = 2 * np.array(divisions) + 1
    k, j, i = np.meshgrid(*(np.arange(m) for m in n[::-1]), indexing="ij")
    index = np.stack([i, j, k], axis=-1).reshape(-1, 3)
    nodes = index / (n - 1.0)
    local = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]
    cell = np.stack(np.meshgrid(*(np.arange(d) for d in divisions[::-1]), indexing="ij"), axis=-1).reshape(
        -1, 3
    )[:, ::-1]
    connectivity = (2 * cell[:, None] + local) @ np.array([1, n[0], n[0] * n[1]])
    sets, surfaces = {}, {}
    for axis in range(3):
        for side in range(2):
            name = "xyz"[axis] + str(side)
            sets[name] = np.flatnonzero(index[:, axis] == side * (n[axis] - 1))
            rows = np.flatnonzero(cell[:, axis] == side * (divisions[axis] - 1))
            surfaces[name] = np.stack([rows, np.full_like(rows, 2 * axis + side)], axis=1)
    sets["boundary"] = np.unique(np.concatenate(list(sets.values())))
    surfaces["skin"] = np.concatenate(list(surfaces.values()))
    rng = np.random.default_rng(seed)
    nodes = nodes + shift * rng.uniform(-1, 1, nodes.shape) / np.array(divisions)
    return Case(
        nodes=nodes,
        labels=np.arange(1, len(nodes) + 1),
        blocks=(Block("hex27", connectivity),),
        node_sets=sets,
        element_sets={"body": np.arange(len(connectivity))},
        surfaces=surfaces,
        materials={"body": material},
        supports=supports,
        pressurised=pressurised,
    )


@pytest.fixture(scope="session")
def cube() -> Callable[..., Case]:
    """`cube((1, 1, 1), shift=0.1, ...)`: see `brick`."""
    return brick


@pytest.fixture(scope="session")
def silicone() -> Material:
    """The constants of the reference study."""
    return SILICONE


@pytest.fixture(scope="session")
def short() -> Case:
    """A finger of three bellows on a coarse mesh: some 1000 nodes, everything the long one has."""
    return finger_case(SILICONE, finger=SHORT, lattice=COARSE)


@pytest.fixture(scope="session")
def stub() -> Case:
    """A finger of one bellow, for derivatives along histories: 0.4 of the nodes of `short`."""
    return finger_case(SILICONE, finger=STUB, lattice=COARSE)


@pytest.fixture(scope="session")
def short_finger() -> Finger:
    """The geometry of `short`."""
    return SHORT
