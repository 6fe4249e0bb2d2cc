"""A true motion in a protocol -> the targets that `twin measure` would give of it, with noise from a seed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.targets import Array, TargetPoint, Targets
from twin.virtual.filming import Bench, noisy_targets
from twin.virtual.protocols import Protocol

NOISE = {"white": 0.0, "ar1": 0.6}  # correlation of a marker's noise from step to step


@dataclass(frozen=True, kw_only=True)
class Setup:
    """How well it is measured: picture noise `sd_mm` a marker and axis, of which kind (a name of NOISE),
    gauge
    noise, and how far a marker may sit from its place."""

    sd_mm: float = 0.015
    noise: str = "white"
    gauge_sd_MPa: float = 2e-5
    placement_sd_mm: float = 0.1
    scale_sd: float = 5e-4

    @property
    def bench(self) -> Bench:
        """The measuring side."""
        return Bench(
            ripple_MPa=0.0, gauge_sd_MPa=self.gauge_sd_MPa, sd=self.sd_mm, rho=NOISE[self.noise],
            placement_sd_mm=self.placement_sd_mm, scale_sd=self.scale_sd,
        )  # fmt: skip


def measured(
    protocol: Protocol,
    u: Array,
    slope: Array,
    *,
    points: Sequence[TargetPoint],
    setup: Setup,
    seed: int,
) -> Targets:
    """Targets of true displacements (s, p, 3) mm of a protocol's points (p,) and their slopes dU/dp (s, p, 3)
    mm per MPa; the last of several recordings is held out."""
    drawn = noisy_targets(
        u, slope, protocol.course, points=points, bench=setup.bench, seed=seed, fixed=protocol.fixed
    )
    held = np.zeros(len(u), bool) if protocol.held_out is None else protocol.block == protocol.held_out
    gravity = protocol.ways if protocol.weighed else None
    return replace(drawn, block=protocol.block, held_out=held, gravity=gravity)
