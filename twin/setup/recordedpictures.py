"""What a page shows of the recordings: first pictures, headings of the log, and a chart of log and motion."""

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from twin.csvtable import read_sheet
from twin.inputs.foundrecordings import Recordings, is_film
from twin.setup.desk import course_of
from twin.setup.draft import SetupDraft

if TYPE_CHECKING:  # vision takes a second to import
    from vision.camera import Image

PRESSURE, MOTION = "#0072b2", "#d55e00"
MOST = 1500  # samples of the log that are drawn


def first_picture(found: Recordings) -> "Image | None":
    """The first picture (h,w) of the test film, None without one."""
    return None if found.film is None else _first_of(found.film.path)


def _first_of(path: Path) -> "Image":
    from vision import Video

    return next(iter(Video(path).chosen([0])))[2]


def recorded_pictures(draft: SetupDraft) -> "list[tuple[str, Image]]":
    """Names of the recordings, each with its first picture (h,w)."""
    found, shown = draft.found, []
    for what, film in (("test", found.film), ("at rest", found.static)):
        if film is not None:
            shown.append((f"{what}: {film.path.name}, {film.frames} frames", _first_of(film.path)))
    boards = [] if found.boards is None else sorted(draft.root.glob(found.boards))
    groups = (("board", boards), ("rig and board", found.rig))
    return shown + [_group(what, paths) for what, paths in groups if paths]


def _group(what: str, paths: Sequence[Path]) -> "tuple[str, Image]":
    """The name of some pictures, or of a film, and the first picture (h,w)."""
    from vision.film.series import bits_of_pictures, read_picture

    if is_film(paths):
        return f"{what}: {paths[0].name}", _first_of(paths[0])
    picture = read_picture(paths[0], bits_of_pictures(paths))
    return f"{what}: {paths[0].parent.name}/, {len(paths)} pictures", picture


def as_url(picture: "Image", *, wide: int | None = None) -> str:
    """A picture (h,w) as a URL of itself, at most so many px wide."""
    drawn: Any = picture
    if wide is not None and picture.shape[1] > wide:
        high = round(picture.shape[0] * wide / picture.shape[1])
        drawn = cv2.resize(picture, (wide, high), interpolation=cv2.INTER_AREA)
    coded = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    return "data:image/jpeg;base64," + base64.b64encode(bytes(coded)).decode()


def said_of_log(found: Recordings) -> str:
    """A sentence on column, unit and range of the log, to be confirmed; why it cannot be read, where it
    cannot."""
    if found.log is None:
        return " ".join(found.of_log)
    low, high = (round(1e3 * float(p), 1) + 0.0 for p in (found.log.pressure.min(), found.log.pressure.max()))
    return (f"{found.log.path.name}: {found.log.source}, {low:g} to {high:g} kPa, "
            f"{np.ptp(found.log.time):.1f} s long. Is that what the gauge showed?")  # fmt: skip


def headings_of_log(found: Recordings) -> list[str]:
    """The headings of the log's file, none where they cannot be read."""
    path = found.log.path if found.log is not None else found.tables[0]
    try:
        return [name for name in read_sheet(path, wanted="time_s,pressure_MPa").header if name]
    except (ValueError, OSError):
        return []


def clock_chart(draft: SetupDraft) -> dict[str, Any]:
    """A chart of log and motion on one clock, in the manner of ECharts; a film whose start is open stands at
    the beginning."""
    found = draft.found
    assert found.log is not None
    assert found.film is not None
    time, px = course_of(found.film)
    start = float(found.log.time[0]) if draft.start is None else draft.start
    every = max(len(found.log.time) // MOST, 1)
    log = np.column_stack([found.log.time, 1e3 * found.log.pressure])[::every]
    motion = np.column_stack([time + start, px])[np.isfinite(px)]
    line = {"type": "line", "showSymbol": False}
    clock = {"type": "value", "name": "s of the log", "nameLocation": "middle", "nameGap": 24}
    ends = {"min": round(float(found.log.time[0])), "max": round(float(found.log.time[-1]))}
    names = ("pressure, kPa", "motion of the tags, px")
    return {
        "animation": False,
        "grid": {"left": 45, "right": 45, "top": 45, "bottom": 40},
        "legend": {"data": list(names), "top": 0},
        "xAxis": clock | ends,
        "yAxis": [{"type": "value", "name": "kPa"},
                  {"type": "value", "name": "px", "splitLine": {"show": False}}],
        "series": [
            line | {"name": names[0], "data": log.round(4).tolist(), "color": PRESSURE},
            line | {"name": names[1], "data": motion.round(3).tolist(), "color": MOTION, "yAxisIndex": 1,
                    "showSymbol": True, "symbolSize": 5},
        ],
    }  # fmt: skip
