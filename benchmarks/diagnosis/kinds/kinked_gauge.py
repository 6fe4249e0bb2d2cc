"""Another law of pressure_gain: kinked gauge."""

from dataclasses import replace

import numpy as np

from twin.effects.protocol import Test
from twin.virtual.hidden import Kind


def kinked_gauge(test: Test, size: float) -> Test:
    """A gauge that reads right up to 60 % of the top, and above it too little by the share `size` of what is
    added."""
    p = test.path.pressure
    return replace(test, path=replace(test.path, pressure=p + size * np.maximum(p - 0.6 * p.max(), 0.0)))


KIND = Kind(
    name="kinked_gauge",
    physics="pressure_gain",
    law="other",
    unit="",
    sizes=(-0.35, 0.35),
    part="path",
    before=kinked_gauge,
)
