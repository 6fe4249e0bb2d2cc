"""The ways to synchronise film and pressure log, by their names in twin.toml: by stamps, by a lamp, by the
onset of motion."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.gauge.onset import ByOnset
from twin.gauge.pressurelog import Log
from twin.gauge.pressuretable import PressureTable
from twin.gauge.synchrony import Join, Joining, Motion
from twin.project.cameratables import CameraTable

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
    lamp_s, log_sd = (on_s, 0.0) if on_s is not None else log.flash()
    sd = float(np.hypot(onset_sd_s, log_sd))
    return Join(
        lamp_s - onset_s,
        sd,
        f"The lamp goes on {onset_s:.4f} s after the first frame: the film starts at {lamp_s - onset_s:.4f} "
        f"+- {sd:.4f} s of the log.",
    )


def _by_lamp(pressure: PressureTable, camera: CameraTable) -> ByLamp:
    assert pressure.flash_region is not None  # the configuration refuses join = "flash" without it
    return ByLamp(pressure.flash_region, pressure.flash_time_s)


WAYS: dict[str, Callable[[PressureTable, CameraTable], Joining]] = {
    "stamps": lambda pressure, camera: ByStamps(camera.film_start_s, pressure.sync_sd_s),
    "flash": _by_lamp,
    "onset": lambda pressure, camera: ByOnset(),
}


def joining_of(pressure: PressureTable, camera: CameraTable) -> Joining:
    """The way that twin.toml asks for."""
    return WAYS[pressure.join](pressure, camera)
