"""What no library holds: tight thread."""

from dataclasses import replace

import numpy as np

from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Test
from twin.targets import Array
from twin.virtual.hidden import Kind


def tight_thread(test: Test, size: float) -> Test:
    """A thread over the crests pulls the first and the last bellow together with `size` N."""
    case = test.case
    high = case.nodes[:, 2] > 0.8 * case.nodes[:, 2].max()
    share, sets, forces = case.nodes[:, 0] / case.nodes[:, 0].max(), {}, {}
    for name, low, top, sign in (("thread_base", 0.1, 0.3, 1.0), ("thread_tip", 0.7, 0.9, -1.0)):
        sets[name] = np.flatnonzero(high & (share > low) & (share < top))
        forces[name] = test.share * sign * size * np.array([1.0, 0.0, 0.0])
    return replace(
        test,
        case=replace(case, node_sets={**case.node_sets, **sets}, forces={**case.forces, **forces}),
    )


def taut(x: Array) -> Array:
    """How much of its force a thread has that is slack up to 40 % of the top pressure, at shares x (s,)."""
    return np.clip((x - 0.4) / 0.6, 0.0, 1.0)


KIND = Kind(
    name="tight_thread",
    physics="",
    law="unknown",
    unit="N",
    sizes=(0.2, 0.4, 0.8, 1.2),
    part="static",
    before=tight_thread,
    along=taut,
    mechanism=Mechanism.LOAD,
)
STAND_INS = ("outside force", "fold")
