"""Another law of eccentric_core: sagging core."""

from dataclasses import replace

import numpy as np

from fe.mesh.inner import inside
from twin.effects.protocol import Test
from twin.virtual.hidden import Kind


def sagging_core(test: Test, size: float) -> Test:
    """A core that is held at both ends and lies higher by `size` mm in the middle: it sagged, or was bent."""
    inner = inside(test.case)
    x = inner.position[:, 0]
    share = (x - x.min()) / np.ptp(x)
    moved = np.zeros((len(inner.rows), 3))
    moved[:, 2] = 4 * size * share * (1 - share)
    return replace(test, case=replace(test.case, nodes=test.case.nodes + inner.spread(moved)))


KIND = Kind(
    name="sagging_core",
    physics="eccentric_core",
    law="other",
    unit="mm",
    sizes=(-1.2, -0.8, -0.3, 0.3, 0.8, 1.2),
    part="static",
    before=sagging_core,
)
