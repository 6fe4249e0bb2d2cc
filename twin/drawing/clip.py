"""Turns film and models into a short clip for a talk: the model before and after, side by side, as MP4."""

import io
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from twin import files
from twin.drawing.painting import Image, side_by_side, window
from twin.review.filmed import Filmed
from vision.film.video import Video

PANEL = 956  # px, width of a panel: two of them are a little less than 1920
LONGEST_S = 30.0  # longer films are shown faster
TICKS = 1000  # of the clip's clock, 1/s
CODING = {"crf": "20", "preset": "veryfast"}


def write_clip(path: Path, film: Video, filmed: Filmed) -> float:
    """Write `path` (MP4, H.264), atomically; returns how many times faster than the film it plays."""
    time = filmed.time_s - filmed.time_s[0]
    speed = max(float(time[-1]) / LONGEST_S, 1.0)
    clip = io.BytesIO()
    with av.open(clip, "w", format="mp4") as target:
        stream = target.add_stream(
            "libx264", rate=max(round(len(time) * speed / time[-1]), 1), options=CODING
        )
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, TICKS)
        for step, picture in _pictures(film, filmed):
            if not stream.codec_context.is_open:
                stream.width, stream.height = picture.shape[1], picture.shape[0]
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24").reformat(format="yuv420p")
            frame.pts, frame.time_base = round(TICKS * time[step] / speed), Fraction(1, TICKS)
            target.mux(stream.encode(frame))
        target.mux(stream.encode(None))
    files.write_bytes(path, clip.getvalue())
    return speed


def _pictures(film: Video, filmed: Filmed) -> Iterator[tuple[int, Image]]:
    """The pictures of the clip, of even size, each with its number among those that are shown."""
    where = window(filmed, list(range(len(filmed.frame))), width=PANEL)
    steps = {int(frame): k for k, frame in enumerate(filmed.frame)}
    for index, _, grey in film.frames():
        if index in steps:
            picture = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)
            both = side_by_side(picture, filmed, steps[index], where)
            height, width = (side // 2 * 2 for side in both.shape[:2])
            yield steps[index], np.ascontiguousarray(both[:height, :width])
