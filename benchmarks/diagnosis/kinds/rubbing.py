"""What no library holds: rubbing."""

from dataclasses import replace

import numpy as np

from fe.mesh.points import nearest
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Test
from twin.virtual.hidden import Kind


def rubbing(test: Test, size: float) -> Test:
    """The tip's face rubs along a wall before it: a force of `size` N against its motion, and none while it
    rests."""
    path, nodes = test.path, test.case.nodes
    way = np.sign(np.round(np.diff(path.pressure, prepend=path.pressure[0]), 9))
    tip = [nearest(test.case, np.array([nodes[:, 0].max(), 0.0, z])) for z in (4.0, 8.0, 12.0)]
    pulls = np.zeros((len(way), len(tip), 3))
    pulls[:, :, 2] = test.share * size / len(tip) * way[:, None]  # it bends down as it is filled
    return replace(test, path=replace(path, places=np.array(tip), pulls=pulls))


KIND = Kind(
    name="rubbing",
    physics="",
    law="unknown",
    unit="N",
    sizes=(0.08, 0.16),
    part="history",
    before=rubbing,
    mechanism=Mechanism.LOAD,
)
STAND_INS = ("friction",)
