"""Synchronise film and pressure log by a lamp that goes on in the film."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Join, Motion

if TYPE_CHECKING:
    from vision import Video


@dataclass(frozen=True)
class ByLamp:
    """Synchronised by a lamp in a region (x, y, width, height) px of the film.

    on_s: time on the log's clock at which it goes on, s; None: the log's column flash tells.
    """

    region: tuple[int, int, int, int]
    on_s: float | None

    def join(self, film: "Video", log: Log, motion: Callable[[], Motion]) -> Join:
        """The join by the frame in which the lamp goes on. ValueError where no lamp goes on."""
        from vision.film.flash import flash_onset

        onset, sd = flash_onset(film, self.region)
        return lamp_join(onset - float(film.time[0]), sd, log, on_s=self.on_s)


def lamp_join(onset_s: float, onset_sd_s: float, log: Log, *, on_s: float | None) -> Join:
    """The join by a lamp that goes on `onset_s` +- `onset_sd_s` after the first frame.

    on_s: s on the log's clock, or None: the log's column flash tells (0 before, 1 from then on).
    """
    at, log_sd = (on_s, 0.0) if on_s is not None else log.flash()
    sd = float(np.hypot(onset_sd_s, log_sd))
    return Join(
        at - onset_s,
        sd,
        f"The lamp goes on {onset_s:.4f} s after the first frame: the film starts at {at - onset_s:.4f} +- "
        f"{sd:.4f} s of the log.",
    )
