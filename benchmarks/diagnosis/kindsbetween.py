"""Hidden differences between two castings, beside the effects that `twin.virtual.hidden` has: the silicone's
constants, and the thickness of all walls."""

from dataclasses import replace

import numpy as np

from fe.mesh.inner import inside
from twin.effects.protocol import Test
from twin.virtual.hidden import Kind


def harder(test: Test, size: float) -> Test:
    """All moduli larger by the share `size`: another cure."""
    path = test.path
    factor = np.ones(len(path.time)) if path.stiffness is None else path.stiffness
    return replace(test, path=replace(path, stiffness=factor * (1 + size)))


def other_share(test: Test, size: float) -> Test:
    """C01 larger by `size` MPa and C10 smaller by as much: another silicone."""
    old = next(iter(test.case.materials.values()))
    return replace(test, case=test.case.with_material(C10=old.C10 - size, C01=old.C01 + size))


def thicker(test: Test, size: float) -> Test:
    """All walls thicker by `size` mm."""
    return _walls(test, size, 0.0)


def swollen_core(test: Test, size: float) -> Test:
    """Walls thicker by `size` mm on average, by a third more in the middle and less at the ends."""
    return _walls(test, size, 1 / 3)


def _walls(test: Test, size: float, uneven: float) -> Test:
    inner = inside(test.case)
    x = inner.position[:, 0]
    share = (x - x.min()) / np.ptp(x)
    amount = size * (1 - uneven * np.cos(2 * np.pi * share))
    moved = inner.spread(amount[:, None] * inner.normal * [0.0, 1.0, 1.0])
    return replace(test, case=replace(test.case, nodes=test.case.nodes + moved))


MODULUS, CONSTANTS, WALL = (
    "modulus",
    "constants",
    "wall_thickness",
)  # as `twin.batches.differences` has them
BETWEEN = {
    k.name: k
    for k in (
        Kind(name="harder", physics=MODULUS, law="same", unit="", sizes=(-0.25, 0.25), part="path",
             before=harder),
        Kind(name="other_share", physics=CONSTANTS, law="same", unit="MPa", sizes=(-0.06, 0.06),
             part="static", before=other_share),
        Kind(name=WALL, physics=WALL, law="same", unit="mm", sizes=(-0.25, -0.1, 0.1, 0.25), part="static",
             before=thicker),
        Kind(name="swollen_core", physics=WALL, law="other", unit="mm", sizes=(-0.25, -0.1, 0.1, 0.25),
             part="static", before=swollen_core),
    )
}  # fmt: skip
