"""What a fitted model is off from films that were held out of its fit."""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from twin.judging.comparison import PLAUSIBLE
from twin.judging.judged import Judged
from twin.targets import Targets


@dataclass(frozen=True, kw_only=True)
class Unseen:
    """The error of a model in a block that it was not fitted to, rms in mm: without errors that many values
    share, each at most PLAUSIBLE sds, and with them; and the noise of one value, mm."""

    block: int
    rms_mm: float
    raw_rms_mm: float
    noise_sd_mm: float
    values: int

    def to_dict(self) -> dict[str, Any]:
        """One row of `held_out` in comparison.json."""
        return asdict(self)


def unseen(judged: Judged, targets: Targets) -> tuple[Unseen, ...]:
    """The error of a judged model in each block that is held out, by the errors that the model states."""
    blocks = np.unique(targets.block[targets.held_out])
    return tuple(_in_block(judged, targets, int(block)) for block in blocks)


def _in_block(judged: Judged, targets: Targets, block: int) -> Unseen:
    w = judged.errors.whitener(replace(targets, held_out=targets.block != block))
    residual = targets.value - judged.predicted
    raw, left = w.pick(residual)[w.valid], w.cleaned(residual, bound=PLAUSIBLE)[w.valid]
    return Unseen(
        block=block,
        rms_mm=float(np.sqrt((left**2).mean())),
        raw_rms_mm=float(np.sqrt((raw**2).mean())),
        noise_sd_mm=w.noise_sd,
        values=w.count,
    )
