"""What no library holds: settling."""

import numpy as np

from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Test
from twin.targets import Array
from twin.virtual.hidden import Kind


def settling(u: Array, test: Test, size: float) -> Array:
    """The finger turns in its holder by `size` rad in all, tip down, half of it within 40 s."""
    angle = size * (1 - 2.0 ** (-test.path.output / 40.0))
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    place = test.points + u
    x, z = place[..., 0], place[..., 2]
    turned = np.stack([c * x + s * z, place[..., 1], c * z - s * x], axis=-1)
    return np.where(np.asarray(test.moving)[:, None], turned - test.points, u)


KIND = Kind(
    name="settling",
    physics="",
    law="unknown",
    unit="rad",
    sizes=(-0.05, 0.05),
    part="picture",
    after=settling,
    mechanism=Mechanism.LOAD,
)
STAND_INS = ("drift", "play")
