"""How films are coded: as phones and video programs do it, and one film coded in such a way.

The numbers of the coding error were chosen on `FULL`. `HELD` are held out of that by name: other coders,
tunings, presets, key frames, passes, bits and sizes.
"""

import re
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av


@dataclass(frozen=True)
class Way:
    """How a film is coded."""

    codec: str
    options: dict[str, str]
    fps: int = 30
    note: bool = True
    rate: int = 0  # bits per second; 0 leaves it to the options
    form: str = "yuv420p"  # of the pixels
    zoom: float = 1.0  # sizes of the film and of what it shows
    passes: int = 1

    @property
    def name(self) -> str:
        told = ",".join(f"{k}={v}" for k, v in self.options.items())
        more = [f"{self.rate // 1000} kbit/s" * bool(self.rate), f"{self.fps}/s", "no note" * (not self.note),
                self.form * (self.form != "yuv420p"), f"{self.zoom:g} times the size" * (self.zoom != 1.0),
                f"{self.passes} passes" * (self.passes > 1)]  # fmt: skip
        return " ".join(word for word in [self.codec, told, *more] if word)


def by_crf(codec: str, crf: int, bf: int, *, fps: int = 30, note: bool = True) -> Way:
    """A constant rate factor in the encoder's default tuning, with so many B-frames."""
    if codec == "libx265":
        return Way(codec, {"crf": str(crf), "x265-params": f"bframes={bf}:log-level=error"}, fps, note)
    return Way(codec, {"crf": str(crf), "bf": str(bf)}, fps, note)


def phone(codec: str, rate: int, *, fps: int = 30, bf: int = 0) -> Way:
    """A bit rate, a key frame a second, and quick decisions, as coders in hardware take them."""
    if codec == "libx265":
        told = f"keyint={fps}:min-keyint={fps}:scenecut=0:bframes={bf}:log-level=error"
        return Way(codec, {"preset": "fast", "x265-params": told}, fps, False, rate)
    told = "mbtree=0:aq-mode=0:psy=0:weightp=0:scenecut=0"
    return Way(codec, {"preset": "fast", "g": str(fps), "bf": str(bf), "x264-params": told}, fps, False, rate)


QUICK = {
    "h264": [by_crf("libx264", 23, 3, note=False), by_crf("libx264", 18, 0)],
    "h265": [by_crf("libx265", 24, 3, note=False)],
    "phone": [phone("libx264", 2_000_000)],
}
FULL = {
    "h264": [
        by_crf("libx264", 18, 0), by_crf("libx264", 18, 3, note=False), by_crf("libx264", 23, 3),
        by_crf("libx264", 23, 0, note=False), by_crf("libx264", 28, 3, note=False), by_crf("libx264", 28, 0),
        by_crf("libx264", 23, 3, fps=60, note=False),
    ],
    "h265": [
        by_crf("libx265", 18, 4), by_crf("libx265", 18, 0, note=False), by_crf("libx265", 23, 4, note=False),
        by_crf("libx265", 23, 0), by_crf("libx265", 28, 4), by_crf("libx265", 28, 0, note=False),
        by_crf("libx265", 23, 4, fps=60, note=False),
    ],
    "phone": [
        phone("libx264", 2_000_000), phone("libx264", 4_000_000, fps=60), phone("libx265", 1_200_000),
        phone("libx265", 2_000_000, fps=60), phone("libx264", 3_000_000, bf=1),
    ],
}  # fmt: skip
HELD = [
    Way("libx264", {"crf": "20", "preset": "slow", "tune": "film"}),
    Way("libx264", {"crf": "22", "preset": "veryfast"}, note=False),
    Way("libx264", {"crf": "21", "tune": "grain"}, note=False),
    Way("libx264", {"crf": "25", "g": "12", "bf": "2"}),
    Way("libx264", {}, rate=1_500_000, passes=2),
    Way("libx264", {"crf": "22"}, form="yuv420p10le"),
    Way("libx264", {"crf": "21", "preset": "faster"}, zoom=0.75),
    Way("libx264", {"preset": "ultrafast", "tune": "zerolatency", "g": "15"}, rate=3_500_000),
    Way("libx265", {"crf": "21", "preset": "fast", "tune": "grain", "x265-params": "log-level=error"}),
    Way("libx265", {"crf": "26", "preset": "faster", "x265-params": "log-level=error"}, 30, False),
    Way("libx265", {"crf": "20", "preset": "fast", "x265-params": "log-level=error"}, form="yuv420p10le"),
    Way("mpeg4", {"g": "12", "bf": "2"}, rate=3_000_000),
    Way("mpeg2video", {"g": "15", "bf": "2"}, rate=6_000_000),
    Way("libvpx-vp9", {"crf": "30", "deadline": "realtime", "cpu-used": "6"}),
    Way("mjpeg", {"qmin": "3", "qmax": "3"}, form="yuvj420p"),
    Way("prores_ks", {"profile": "2"}, form="yuv422p10le"),
]  # fmt: skip


def coded(source: Path, target: Path, way: Way) -> Path:
    """The film coded that way; without the note, the text in which x264 and x265 tell their settings."""
    for number in range(1, way.passes + 1):
        _pass(source, target, way, number if way.passes > 1 else 0)
    if not way.note:
        content = target.read_bytes()
        told = rb"x26[45] (- core|\(build)[\x20-\x7e]*"
        target.write_bytes(re.sub(told, lambda found: b"x" * len(found.group()), content))
    return target


def _pass(source: Path, target: Path, way: Way, number: int) -> None:
    options = dict(way.options)
    if number:
        options["x264-params"] = f"pass={number}:stats={target.with_suffix('.stats')}"
    with av.open(str(source)) as given, av.open(str(target), "w") as container:
        of = given.streams.video[0]
        stream: Any = container.add_stream(way.codec, rate=way.fps, options=options)
        stream.width, stream.height, stream.pix_fmt = of.width, of.height, way.form
        stream.codec_context.time_base = Fraction(1, way.fps)
        stream.codec_context.thread_count = 2
        if way.rate:
            stream.bit_rate = way.rate
        for index, frame in enumerate(given.decode(video=0)):
            frame.pts, frame.time_base = index, Fraction(1, way.fps)
            frame.pict_type = av.video.frame.PictureType.NONE
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
