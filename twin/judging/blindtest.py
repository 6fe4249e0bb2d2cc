"""What a fitted model is off from films that were held out of its fit."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from twin.judging.comparison import PLAUSIBLE
from twin.judging.judged import Judged
from twin.judging.record import UnseenFilm
from twin.targets import Targets


def unseen(judged: Judged, targets: Targets, films: Mapping[int, str]) -> tuple[UnseenFilm, ...]:
    """The error of a judged model in each block that is held out and was measured, by the errors that the
    model states; films: names by block."""
    seen = targets.held_out & targets.valid[:, ~targets.fixed].any(axis=(1, 2))
    blocks = np.unique(targets.block[seen])
    return tuple(_in_block(judged, targets, int(b), films.get(int(b), f"block {b}")) for b in blocks)


def _in_block(judged: Judged, targets: Targets, block: int, film: str) -> UnseenFilm:
    w = judged.errors.whitener(replace(targets, held_out=targets.block != block))
    residual = targets.value - judged.predicted
    raw, left = w.pick(residual)[w.valid], w.cleaned(residual, bound=PLAUSIBLE)[w.valid]
    return UnseenFilm(
        film=film,
        block=block,
        rms_mm=float(np.sqrt((left**2).mean())),
        raw_rms_mm=float(np.sqrt((raw**2).mean())),
        noise_sd_mm=w.noise_sd,
        values=w.count,
    )
