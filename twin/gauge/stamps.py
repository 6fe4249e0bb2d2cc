"""Synchronise film and pressure log by a stated time of the film's first frame."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Join, Motion

if TYPE_CHECKING:
    from vision import Video


@dataclass(frozen=True)
class ByStamps:
    """Synchronised by what the user states: the first frame's time on the log's clock, and its sd."""

    start_s: float
    sd_s: float

    def join(self, film: "Video", log: Log, motion: Callable[[], Motion]) -> Join:
        """The join as stated."""
        return Join(self.start_s, self.sd_s, "")
