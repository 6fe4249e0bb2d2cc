"""Coding of a film, as its own packets tell it: coder, B-frames, key frames, bytes of every frame.

Encoders may leave a note of their settings in the file. Phones leave none, so none is read.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

LOSSLESS = ("ffv1", "huffyuv", "ffvhuff", "utvideo", "png", "rawvideo", "qtrle")
NAMES = {"h264": "H.264", "hevc": "H.265", "mjpeg": "JPEG pictures"}
OLDER = ("mpeg1video", "mpeg2video", "mpeg4", "h263", "msmpeg4v2", "msmpeg4", "wmv1", "wmv2")
MOST_B = 16  # what x264 and x265 take
LIVE_S = 2.0  # between key frames of a film coded while it is taken: docs/records/error-numbers.md
SPARSE = 250  # frames from key frame to key frame where a film shows no two: what x264 and x265 take
AVX_512 = 13  # OpenCV's number for processors that have it
# x264 weighs what later frames refer to; with AVX-512 it reads memory there that nobody wrote, and codes the
# same pictures differently. AVX2 gives what AVX-512 gives otherwise, as fast.
SAME_BITS = "asm=avx2" if cv2.checkHardwareSupport(AVX_512) else ""


@dataclass(frozen=True)
class Coding:
    """Coding of a film; frames in the order they are shown."""

    codec: str  # as FFmpeg calls its decoder
    size: NDArray[np.intp]  # (t,) bytes
    key: NDArray[np.bool_]  # (t,) drawn anew, without the frames before
    between: int  # B-frames in a row, at most
    fps: float  # 1/s, the usual rate
    grain: bool = False  # whether it kept the camera's noise, as its pictures tell
    simple: bool = False  # coded with few means, see `is_simple`

    @property
    def lossless(self) -> bool:
        """True if every frame is as the camera gave it."""
        return self.codec in LOSSLESS

    @property
    def every(self) -> int:
        """Usual number of frames from key frame to key frame."""
        keys = np.flatnonzero(self.key)
        return int(np.median(np.diff(keys))) if len(keys) > 1 else SPARSE

    @property
    def live(self) -> bool:
        """True if key frames stand in even steps of 2 s or less: coded while it was filmed, as phones do."""
        steps = np.diff(np.flatnonzero(self.key))
        return len(steps) > 0 and int(np.ptp(steps)) <= 1 and self.every <= LIVE_S * self.fps + 1

    def options(self, level: float) -> tuple[str, dict[str, str]]:
        """Encoder that codes like this one, and its options at a constant rate factor.

        Other codecs than H.265 are taken for H.264, which errs alike at the same number of bytes. Who codes
        while filming cannot look ahead and does not weigh what the eye sees.
        """
        preset = "ultrafast" if self.simple else "fast" if self.live else "medium"
        common = {"crf": f"{level:.2f}", "preset": preset}
        if self.codec == "hevc":
            x265 = f"bframes={self.between}:keyint={self.every}:log-level=error"
            plain = ":scenecut=0" if self.live else ""
            return "libx265", {**common, "x265-params": x265 + plain}
        plain = "scenecut=0:mbtree=0:aq-mode=0:psy=0:weightp=0" if self.live else SAME_BITS
        x264 = {"bf": str(self.between), "g": str(self.every), "x264-params": plain}
        tune = {"tune": "grain"} if self.grain and not self.live else {}
        return "libx264", {**common, **tune, **x264}

    def described(self) -> str:
        """One clause for the user: coder, B-frames, key frames, size of a frame."""
        keys = int(self.key.sum())
        often = "all key frames" if self.key.all() else f"{keys} key frame{'s' * (keys != 1)}"
        between = f"up to {self.between} B-frames in a row" if self.between else "no B-frames"
        return (
            f"{NAMES.get(self.codec, self.codec)}, {often} in {len(self.key)} frames, {between}, "
            f"{self.size.mean() / 1e3:.3g} kB a frame"
        )


def is_simple(codec: str, profile: str | None) -> bool:
    """True for a coder with few means: H.264 in its Baseline profile, as of webcams, or an older kind.

    At the same bytes these err about twice as much in what moves; x264 in haste errs as they do.
    """
    return codec in OLDER or (codec == "h264" and "Baseline" in (profile or ""))


def longest_between(stamps: Sequence[int]) -> int:
    """B-frames in a row, at most, from the display times of the packets in the file's order.

    A packet that is shown before one that stands in front of it is a B-frame, which refers to later frames.

    >>> longest_between([0, 3, 1, 2, 6, 4, 5])  # the frames shown as 1 and 2 refer to 3
    2
    """
    newest, run, longest = -np.inf, 0, 0
    for stamp in stamps:
        run = run + 1 if stamp < newest else 0
        newest, longest = max(newest, stamp), max(longest, run)
    return min(longest, MOST_B)
