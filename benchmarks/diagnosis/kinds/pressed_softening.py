"""Another law of mullins: pressed softening."""

from dataclasses import replace

import numpy as np

from twin.effects.protocol import Test
from twin.virtual.hidden import Kind


def pressed_softening(test: Test, size: float) -> Test:
    """A finger that is softer as a whole below its largest pressure so far: by up to `size`, exponentially in
    the distance to it."""
    path = test.path
    top = max(float(path.pressure.max()), 1e-12)
    below = (np.maximum.accumulate(path.pressure) - path.pressure) / top
    factor = 1 - size * -np.expm1(-below / 0.4)
    return replace(test, path=replace(path, stiffness=factor))


KIND = Kind(
    name="pressed_softening",
    physics="mullins",
    law="other",
    unit="",
    sizes=(0.125, 0.25),
    part="path",
    before=pressed_softening,
)
