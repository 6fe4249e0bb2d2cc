"""The ways to synchronise film and pressure log, by their names in twin.toml."""

from collections.abc import Callable

from twin.gauge.lamp import ByLamp
from twin.gauge.onset import ByOnset
from twin.gauge.stamps import ByStamps
from twin.gauge.synchrony import Joining
from twin.project.config import CameraTable, PressureTable


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
