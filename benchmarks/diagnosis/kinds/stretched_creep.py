"""Another law of creep: stretched creep."""

from dataclasses import replace

import numpy as np

from twin.effects.protocol import Test
from twin.virtual.hidden import Kind


def stretched_creep(test: Test, size: float) -> Test:
    """Relaxation of the share `size` by exp(-sqrt(t / 6 s)), whose spectrum of times is known in closed form:
    sqrt(x) exp(-x / 4) over log x, with x = tau / 6 s."""
    tau = np.logspace(-1, 2, 7)
    weight = np.sqrt(tau / 6.0) * np.exp(-tau / 24.0)
    series = tuple((float(size * g), float(t)) for g, t in zip(weight / weight.sum(), tau, strict=True))
    return replace(test, case=test.case.with_material(prony=series))


KIND = Kind(
    name="stretched_creep",
    physics="creep",
    law="other",
    unit="",
    sizes=(0.1, 0.15, 0.2),
    part="history",
    before=stretched_creep,
)
