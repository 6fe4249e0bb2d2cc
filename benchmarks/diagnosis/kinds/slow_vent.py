"""Another law of pressure_lag: slow vent."""

from dataclasses import replace

import numpy as np

from twin.effects.protocol import Test
from twin.virtual.hidden import Kind


def slow_vent(test: Test, size: float) -> Test:
    """A valve that vents with a lag of `size` s, and fills with a fifth of it."""
    path = test.path
    p, wanted, time = path.pressure.copy(), path.pressure, path.time
    for n in range(1, len(p)):
        dt = time[n] - time[n - 1]
        tau = max(size * (1.0 if wanted[n] < p[n - 1] else 0.2), 1e-6)
        behind = tau * (wanted[n] - wanted[n - 1]) / dt  # where the line ends up behind a steady ramp
        apart = p[n - 1] - wanted[n - 1] + behind
        apart = apart if abs(apart) > 1e-150 else 0.0  # of long ago; its decay would underflow
        p[n] = wanted[n] - behind + apart * np.exp(-dt / tau)
    return replace(test, path=replace(path, pressure=p))


KIND = Kind(
    name="slow_vent",
    physics="pressure_lag",
    law="other",
    unit="s",
    sizes=(0.4, 0.8),
    part="path",
    before=slow_vent,
)
