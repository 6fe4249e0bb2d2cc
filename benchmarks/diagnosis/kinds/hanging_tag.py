"""What no library holds: hanging tag."""

import numpy as np

from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Test
from twin.targets import Array
from twin.virtual.hidden import Kind


def hanging_tag(u: Array, test: Test, size: float) -> Array:
    """The last marker peels off as the finger is strained, and hangs down by `size` mm at the end."""
    path, row = test.path, int(np.flatnonzero(test.moving)[-1])
    strained = np.cumsum(path.pressure**2) / max(float((path.pressure**2).sum()), 1e-30)
    weight = path.outside_at(path.output)[:, :3]
    length = np.linalg.norm(weight, axis=1, keepdims=True)
    down = np.where(length > 0, weight / np.maximum(length, 1e-12), [0.0, 0.0, -1.0])
    out = u.copy()
    out[:, row] += size * np.interp(path.output, path.time, strained)[:, None] * down
    return out


KIND = Kind(
    name="hanging_tag",
    physics="",
    law="unknown",
    unit="mm",
    sizes=(0.25, 0.5),
    part="picture",
    after=hanging_tag,
    mechanism=Mechanism.PICTURE,
)
STAND_INS = ("slip",)
