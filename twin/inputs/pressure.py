"""What the pressure log says while the film runs: what is odd in it, and the noise of the gauge."""

from twin.gauge.logfaults import check_signal, rest_remark
from twin.gauge.pressurelog import GaugeNoise, Log, check_covers, gauge_noise
from twin.inputs.cameras import camera_table
from twin.project.folder import Project
from twin.targets import Array


def said_of_log(project: Project, film: Array, log: Log, start_s: float) -> tuple[str, ...]:
    """Sentences on what is odd in the log during the film (t,) s; ValueError where its pressures are
    wrong."""
    rest = rest_remark(log, start=start_s, rest_s=project.config.measure.reference_s)
    return (*check_signal(log, start=start_s, end=start_s + film[-1] - film[0]), *filter(None, (rest,)))


def gauge_of(project: Project, film: Array, static: Array, log: Log, start_s: float) -> GaugeNoise:
    """The gauge noise during the static film, or in the film's first rest if its time is unknown. ValueError
    where the log does not cover the films.

    film, static: (t,) s on their own clocks.   start_s: of the film on the log's clock.
    """
    table, rest_s = camera_table(project), project.config.measure.reference_s
    check_covers(log, film - film[0] + start_s, what="film", key="film_start_s")
    if table.static_start_s is None:
        return gauge_noise(log, start=start_s, end=start_s + rest_s)
    time = static - static[0] + table.static_start_s
    check_covers(log, time, what="static film", key="static_start_s")
    return gauge_noise(log, start=float(time[0]), end=float(time[-1]))
