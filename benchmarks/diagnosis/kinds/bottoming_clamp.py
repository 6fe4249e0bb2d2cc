"""Another law of clamp: bottoming clamp."""

import numpy as np

from twin.targets import Array
from twin.virtual.hidden import Kind, known


def bottoming(x: Array) -> Array:
    """The secant compliance, over that at rest, of a clamp that saturates as a gasket is pressed flat,
    at shares x (s,) of the top pressure."""
    held = np.maximum(np.abs(x), 1e-6) / 0.4
    return np.asarray(np.tanh(held) / held, float)


KIND = Kind(
    name="bottoming_clamp",
    physics="clamp",
    law="other",
    unit="rad/(N mm)",
    sizes=(3e-3, 6e-3, 12e-3),
    part="static",
    before=known("clamp", "clamp.compliance"),
    along=bottoming,
)
