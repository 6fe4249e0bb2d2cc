"""Mistakes of strangers in how a film or a log was recorded, stored or copied: more for `mistakes`.

`MISTAKES` must be refused. `DOUBTFUL` may be right: they pass, with a sentence that names the doubt. `RIGHT`
pass.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from tests.strangers.planting import Plant, camera_with, every, filmed, painted, printed_twice, sagging
from tests.strangers.studio import FILM_START, FRAMES, RATE, SIZE, STILL, log_text, motion
from twin import files
from twin.targets import Array
from vision import Mark, Video
from vision.film.video import Writer

Row = tuple[float, float]
MOVED = np.array([6.0, 0.0, 2.0])  # mm, of the camera


def rows(change: Callable[[list[Row]], Sequence[Row]], head: str = "time_s,pressure_MPa") -> Plant:
    """The log with its rows (s, MPa) changed."""
    pairs = [line.split(",") for line in log_text().splitlines()[1:]]
    kept = change([(float(t), float(p)) for t, p in pairs])
    text = head + "\n" + "".join(f"{t:.2f},{p:.9g}\n" for t, p in kept)
    return lambda root: files.write_text(root / "raw" / "pressure.csv", text)


def offset(by: float, factor: float = 1.0, head: str = "time_s,pressure_MPa") -> Plant:
    """A gauge that reads so much more, in the unit of the heading."""
    return rows(lambda log: [(t, factor * p + by) for t, p in log], head)


def dropped(value: float) -> Plant:
    """A logger that writes a value in place of every seventh sample."""
    return rows(lambda log: [(t, value if k % 7 == 0 else p) for k, (t, p) in enumerate(log)])


def no_reading(log: list[Row]) -> list[Row]:
    """A logger that writes -0.999 now and then."""
    return [(t, -0.999 if k % 200 == 7 else p) for k, (t, p) in enumerate(log)]


def stopped(log: list[Row]) -> list[Row]:
    """A logger that repeats its last value from halfway up the ramp."""
    half = FILM_START + 2.6
    last = next(p for t, p in log if t >= half)
    return [(t, p if t < half else last) for t, p in log]


def picked(pick: Callable[[int], Sequence[int]], name: str = "film.mkv") -> Plant:
    """A film of other frames, at the same rate: slow motion, a film that has lost frames, a still picture."""

    def plant(root: Path) -> None:
        old, new = root / "raw" / name, root / "raw" / f"new-{name}"
        images = [np.asarray(image, np.uint8) for _, _, image in Video(old).frames()]
        with Writer(new, SIZE, fps=RATE, codec="ffv1", crf=0) as writer:
            for k in pick(len(images)):
                writer.add(images[k])
        new.replace(old)

    return plant


def glued(name: str, off: Sequence[float]) -> Plant:
    """Films of a finger whose marker is glued elsewhere by so many mm."""

    def place(marks: list[Mark], time: Array) -> Array:
        out = motion(marks, time)
        out[:, [mark.name for mark in marks].index(name)] += np.array(off)
        return out

    def plant(root: Path) -> None:
        filmed(place)(root)
        filmed(lambda marks, time: place(marks, 0 * time), name="static.mkv", frames=STILL)(root)

    return plant


def unevenly(marks: list[Mark], time: Array) -> Array:
    """A film of a varying frame rate, which an editor made constant."""
    return motion(marks, time + 0.3 * np.sin(2 * np.pi * time / 4.5))


def farther(root: Path) -> None:
    """A static film with everything at 0.85 of its size in the picture."""
    away = np.array([0.0, -75.0, 0.0])  # mm, of 420 mm
    filmed(lambda marks, time: motion(marks, 0 * time) + away, name="static.mkv", frames=STILL)(root)


def turned(degrees: float = 0.0, scale: float = 1.0, shift: float = 0.0) -> Plant:
    """A film whose picture is moved by so much from its thirtieth frame on."""
    width, height = SIZE
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, scale)
    matrix[:, 2] += shift

    def paint(k: int, grey: Array) -> Array:
        if k < 30:
            return grey
        moved = cv2.warpAffine(grey, matrix, SIZE, flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(moved, float)

    return painted(paint, "film.mkv")


def pumped(rate: float = 1.0) -> Plant:
    """A film and a log of two cycles, the film slowed down."""
    knots, course = [0.0, 2.7, 3.5, 4.3, 5.1, 5.9, 9.0], [0.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.0]

    def place(marks: list[Mark], time: Array) -> Array:
        rest, top = motion(marks, np.array([0.0, 9.0]))
        return rest + np.interp(time / rate, knots, course)[:, None, None] * (top - rest)

    def log(t: float) -> float:
        return 0.03 * float(np.interp(t - FILM_START, knots, course))

    def plant(root: Path) -> None:
        filmed(place, frames=round(6.7 * rate * RATE))(root)
        noise = np.random.default_rng(7)
        rows(lambda log_rows: [(t, log(t) + 1e-5 * noise.standard_normal()) for t, _ in log_rows])(root)

    return plant


MISTAKES: dict[str, tuple[Plant, str]] = {
    "a static film of one picture": (
        picked(lambda n: [0] * n, "static.mkv"), r"one picture in all 120 frames"
    ),
    "a film in slow motion": (pumped(1.7), r"the film seems to run 1\.[67]\d times as long as the test"),
    "a film of one ramp in slow motion": (
        picked(lambda n: [k for k in range(n) for _ in range(1 if k < 25 else 2)]),
        r"0\.[67]\d s after it .*its frame rate was changed",
    ),
    "a film speeded up": (pumped(0.75), r"the film seems to run 0\.7\d times as long as the test"),
    "a film speeded up into its rest": (pumped(0.6), r"the film seems to run 0\.6\d? times as long as the test"),
    "a film of one ramp at twice the rate": (
        filmed(lambda marks, time: motion(marks, 2.0 * time), frames=FRAMES // 2),
        r"not at rest between 0\.00 and 1\.80 s.* The film seems to run 0\.4\d times",
    ),
    "a clock that is off by 3 s": (
        camera_with(film_start_s=FILM_START - 3.0), r"at 14\.0 s .* 100 %.*correct film_start_s"
    ),
    "a clock that is off by 0.3 s": (
        camera_with(film_start_s=FILM_START - 0.3), r"0\.[23]\d s before the pressure .* correct film_start_s"
    ),
    "frames lost in the ramp": (
        picked(lambda n: [k for k in range(n) if not 24 <= k < 29]), r"s before .*frames were lost"
    ),
    "a frame rate made constant": (filmed(unevenly), r"its frame rate was changed or made constant"),
    "absolute pressure without a word": (
        offset(101.325, 1e3, "time_s,pressure_kPa"), r"never falls below 0\.1013 MPa.*absolute pressure"
    ),
    "a sign of the gauge": (offset(0.0, -1.0), r"falls to -0\.03 MPa .*turn its sign"),
    "a gap in the log": (
        rows(lambda log: [row for row in log if not 15.5 < row[0] < 17.5]),
        r"no sample between 15\.50 and 17\.50 s, while the pressure goes from .* to 0\.03 MPa",
    ),
    "zeros in the log": (dropped(0.0), r"16 samples lie far off their neighbours"),
    "-0.999 in the log": (
        rows(no_reading), r"exactly -0\.999 MPa in 7 of 1300 rows.*'no reading'; remove these rows"
    ),
    "times of the log rounded": (
        rows(lambda log: [(round(t, 1), p) for t, p in log]), r"seems to be rounded to 0\.1 s"
    ),
    "spikes in the log": (dropped(0.3), r"samples lie far off their neighbours"),
}  # fmt: skip

DOUBTFUL: dict[str, tuple[Plant, str]] = {
    "a clock that is off by 1 s": (
        camera_with(film_start_s=FILM_START + 1.0), r"does 1\.0 s earlier.*film_start_s right"
    ),
    "a clock that is late by 0.25 s": (
        camera_with(film_start_s=FILM_START + 0.25), r"finger moves 0\.2\d s later than the pressure"
    ),
    "a gauge that does not read zero": (offset(0.005), r"reads 0\.005 MPa while the finger rests"),
    "a logger that stops": (rows(stopped), r"repeats 0\.01\d* MPa from 16\.6"),
    "a static film of other light": (
        painted(lambda _, grey: 20 + 0.5 * grey, "static.mkv"), r"pixels of static.mkv change by"
    ),
    "a static film from farther away": (farther, r"markers are 0\.8\d times as large in static.mkv"),
    "an exposure step": (
        painted(lambda k, grey: grey if k < 30 else np.minimum(1.8 * grey, 255.0), "film.mkv"),
        r"7 markers look smaller than at rest.* 3 of them are fixed to the rig.*light or the camera changed",
    ),
    "a lamp that flickers": (
        painted(lambda k, grey: grey * (0.9 + 0.08 * np.sin(2.5 * k)), "film.mkv"),
        r"The light flickers: at rest the mean grey level of film.mkv changes by \d+(\.\d)? % from frame to frame",
    ),
    "a stabiliser": (
        turned(degrees=0.2, shift=1.0),
        r"frame markers move in the picture of film.mkv: by up to 1\.\d px at .*turned by up to 0\.2 .*a stabiliser",
    ),
    "a focus that breathes": (
        turned(scale=1.01), r"scaled by up to (1|0\.99) %\. A change of scale comes from focus"
    ),
    "the tip's marker printed twice": (
        printed_twice, r"'tip' is read in 0 of the 18 frames .* its id 23 is seen twice in 18 of them"
    ),
    "a tip glued 4 mm short": (glued("tip", (-4, 0, 0)), r"'tip' is seen at x = 106\.0, z = -?0\.0 mm"),
    "a middle glued 6 mm too far": (glued("middle", (6, 0, 0)), r"'middle' is seen at x = 60\.0"),
    "a middle glued 5 mm too high": (glued("middle", (0, 0, 5)), r"'middle' is seen at x = 54\.0, z = 5\.0"),
    "a rig 10 mm nearer than stated": (
        every(finger=False, place=lambda at: (at[0], at[1] + 10, at[2])), r"2\.4 % larger .* 10 mm nearer"
    ),
    "a finger 9 mm farther than stated": (
        every(rig=False, place=lambda at: (at[0], at[1] - 9, at[2])), r"2\.\d % larger .* about 9 mm nearer"
    ),
}  # fmt: skip

RIGHT: dict[str, Plant] = {
    "two cycles": pumped(),
    "white on black": painted(lambda _, grey: 255 - grey),
    "a camera upside down": painted(lambda _, grey: grey[::-1, ::-1]),
    "a coarse log": rows(lambda log: [(t, round(p, 3)) for t, p in log]),
    "a gauge that stops at zero": rows(lambda log: [(t, max(p, 0.0)) for t, p in log]),
    "a gap in the log at rest": rows(lambda log: [row for row in log if not 14.2 < row[0] < 15.6]),
    "a gauge that is off by half a percent": offset(0.00015),
    "a small sag": sagging(8.0),
    "a camera moved a little before the test": filmed(
        lambda marks, time: motion(marks, 0 * time) + MOVED, name="static.mkv", frames=STILL
    ),
}
