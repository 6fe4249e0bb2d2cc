"""What no library holds: stiff wall."""

from dataclasses import replace

import numpy as np

from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Test
from twin.virtual.hidden import Kind


def stiff_wall(test: Test, size: float) -> Test:
    """One side of the finger is stiffer by the share `size`: the halves were cast from two batches of
    silicone, and glued."""
    case = test.case
    (body, material), = case.materials.items()  # fmt: skip
    side = case.nodes[case.connectivity].mean(axis=1)[:, 1] > 0.0
    hard = replace(material, C10=material.C10 * (1 + size), C01=material.C01 * (1 + size))
    sets = {**case.element_sets, body: np.flatnonzero(~side), "hard_side": np.flatnonzero(side)}
    return replace(test, case=replace(case, element_sets=sets, materials={body: material, "hard_side": hard}))


KIND = Kind(
    name="stiff_wall",
    physics="",
    law="unknown",
    unit="",
    sizes=(0.25, 0.5, 0.75, 1.0),
    part="static",
    before=stiff_wall,
    whole=True,
    mechanism=Mechanism.BODY,
)
STAND_INS = ("twist", "soft spot", "force_aside_")
