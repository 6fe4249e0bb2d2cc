"""What every way to synchronise film and pressure log gives and takes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from twin.gauge.pressurelog import Log
from twin.targets import Array

if TYPE_CHECKING:  # vision takes a second to import: only the stages that measure pay for it
    from vision import Video


@dataclass(frozen=True)
class Join:
    """When the film's first frame was taken on the log's clock, how well that is known, and what to say."""

    start_s: float
    sd_s: float
    remark: str  # one sentence or none


@dataclass(frozen=True)
class Motion:
    """How far the finger has moved at evenly spaced times of the film."""

    time: Array  # (s,) s from the first frame
    mm: Array  # (s,) NaN where nothing is seen
    noise_mm: float  # its sd


class Joining(Protocol):
    """A way to synchronise film and pressure log: one class for each `join` of twin.toml."""

    def join(self, film: "Video", log: Log, motion: Callable[[], Motion]) -> Join:
        """When the film's first frame was taken on the log's clock.

        motion: measures the film, which takes long: a way that needs no displacements does not call it.
        """
