"""Models painted over pictures of the film, two side by side: a still, or a short clip for a talk as MP4. The
edge of a model is the outer contour of its mesh that a camera beside it sees."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from twin import files
from twin.review.filmed import Filmed
from twin.review.states import Array, Integers
from vision.film.video import Video

Image = NDArray[np.uint8]
# blue, green, red, as OpenCV orders them; the same colours as in the review
BEFORE, AFTER = (40, 135, 245), (255, 185, 70)
ERROR, SEEN, PAPER, INK, MUTED = (90, 76, 238), (150, 230, 60), (255, 255, 255), (51, 39, 29), (115, 103, 92)
SHIFT = 4  # bits of a pixel that are drawn
ROOM = 0.08  # of the finger's size, left free around it
CAPTION = 0.075  # of a panel's width, the height of the two lines above it
FONT = cv2.FONT_HERSHEY_DUPLEX


@dataclass(frozen=True)
class Window:
    """A part of the film, and how many times larger it is shown."""

    low: Array  # (2,) px, its corner
    size: tuple[int, int]  # px of the film
    zoom: float

    @property
    def shape(self) -> tuple[int, int]:
        """Width and height of a panel in px, both even as films need them."""
        return (2 * round(self.size[0] * self.zoom / 2), 2 * round(self.size[1] * self.zoom / 2))

    def cut(self, picture: Image) -> Image:
        """Section of a picture inside the window, at the scale of the panel."""
        x, y = self.low.astype(int)
        part = picture[y : y + self.size[1], x : x + self.size[0]]
        interpolation = cv2.INTER_CUBIC if self.zoom > 1 else cv2.INTER_AREA
        return np.asarray(cv2.resize(part, self.shape, interpolation=interpolation), np.uint8)

    def places(self, pixels: Array) -> Array:
        """Panel coordinates of film pixels (..., 2); both count from the centres of pixels."""
        scale = np.array(self.shape) / self.size
        return np.asarray((pixels - self.low + 0.5) * scale - 0.5)


def window(filmed: Filmed, steps: Sequence[int], *, width: int) -> Window:
    """Section of the film that holds the finger in the pictures of all steps, drawn `width` px wide."""
    pixels = [field[steps] for t in filmed.shown for field in (t.edge, t.markers)]
    every = np.concatenate([x.reshape(-1, 2) for x in (*pixels, filmed.measured[steps])])
    every = every[np.isfinite(every).all(axis=1)]
    room = ROOM * float(np.ptp(every, axis=0).max())
    low = np.maximum(np.floor(every.min(axis=0) - room), 0)
    high = np.minimum(np.ceil(every.max(axis=0) + room), filmed.size)
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    return Window(low, size, width / size[0])


def side_by_side(picture: Image, filmed: Filmed, step: int, where: Window) -> Image:
    """Film (h,w,3) with the model before effects were added, beside the film with the present model."""
    panels = []
    for number, colour in zip(filmed.numbers, (BEFORE, AFTER)):
        panel = _panel(where.cut(picture), filmed, number, step, where, colour)
        panels.append(panel)
    gap = np.full((panels[0].shape[0], 2 * round(0.005 * where.shape[0]) + 2, 3), 255, np.uint8)
    row = [part for panel in panels for part in (gap, panel)][1:]
    return np.asarray(np.concatenate(row, axis=1), np.uint8)


def still(picture: Image, filmed: Filmed, *, width: int = 760) -> bytes:
    """PNG of the worst moment of the film, its frame given (h,w,3)."""
    step = filmed.worst
    both = side_by_side(picture, filmed, step, window(filmed, [step], width=width))
    return bytes(cv2.imencode(".png", both)[1])


def _panel(
    picture: Image, filmed: Filmed, number: int, step: int, where: Window, colour: tuple[int, int, int]
) -> Image:
    """One model over the film, below its caption."""
    model, unit = filmed.models[number], where.shape[0] / 760
    thick = max(round(1.6 * unit), 1)
    edge = where.places(model.edge[step])
    if np.isfinite(edge).all():
        cv2.polylines(picture, [_fixed(edge)], False, colour, thick, cv2.LINE_AA, SHIFT)
    seen, foot = where.places(filmed.measured[step]), where.places(model.markers[step])
    for a, b in zip(foot, seen, strict=True):
        if np.isfinite([a, b]).all():
            tip = a + filmed.magnified * (b - a)
            _arrow(picture, a, tip, unit)
            cv2.circle(picture, _pair(b), round(3.2 * unit * 2**SHIFT), SEEN, -1, cv2.LINE_AA, SHIFT)
    error = float(np.sqrt(np.nanmean(filmed.error_mm[number][step] ** 2)))
    head = f"Model: {model.label}"
    below = f"{filmed.time_s[step]:.1f} s: markers {error:.2f} mm off"
    below += f" (red: {filmed.magnified} times as long; green: film)"
    return np.concatenate([_caption(where.shape[0], head, below, colour), picture])


def _arrow(picture: Image, foot: Array, tip: Array, unit: float) -> None:
    length = float(np.linalg.norm(tip - foot))
    head = min(8.0 * unit / max(length, 1e-9), 0.6)
    cv2.arrowedLine(
        picture, _pair(foot), _pair(tip), ERROR, max(round(2 * unit), 1), cv2.LINE_AA, SHIFT, head
    )


def _caption(width: int, head: str, below: str, colour: tuple[int, int, int]) -> Image:
    """Two lines of text on white, the first with a stroke in the model's colour."""
    height = 2 * round(CAPTION * width / 2)
    band = np.full((height, width, 3), 255, np.uint8)
    unit = width / 760
    cv2.line(band, (round(4 * unit), round(18 * unit)), (round(34 * unit), round(18 * unit)), colour,
             max(round(4 * unit), 1), cv2.LINE_AA)  # fmt: skip
    for text, x, y, size, ink in ((head, 44, 24, 0.62, INK), (below, 4, 48, 0.5, MUTED)):
        place = (round(x * unit), round(y * unit))
        cv2.putText(band, text, place, FONT, size * unit, ink, 1, cv2.LINE_AA)
    return band


def _fixed(places: Array) -> NDArray[np.int32]:
    return np.asarray(np.round(places * 2**SHIFT), np.int32)


def _pair(place: Array) -> tuple[int, int]:
    x, y = _fixed(place)
    return int(x), int(y)


DRAWN = 4000  # px along the longest side, of the picture in which the contour is found
MARGIN = 2  # drawn px round the body
NEAR = 1.5  # drawn px from the contour, within which a node lies on it


def edge_rows(nodes: Array, triangles: Integers) -> NDArray[np.intp]:
    """Rows (k,) of the nodes along the outer contour of a skin at rest, closed: the last is the first.

    nodes (n,3) mm; triangles (t,3) of its skin.   The contour is that of all triangles seen along y. Where
    several nodes lie on one place of it, as along the underside, the nearest to the camera counts: largest y.
    These are material points, so that the edge follows the finger as it bends.
    """
    used = np.unique(triangles)
    flat = nodes[:, [0, 2]]
    scale = DRAWN / float(np.ptp(flat[used], axis=0).max())
    drawn = (flat - flat[used].min(axis=0)) * scale + MARGIN
    contour = _contour(drawn[triangles])
    along, off = _on_contour(drawn[used], contour)
    chosen = off < NEAR
    rows, along = used[chosen], along[chosen]
    order = np.argsort(along)
    groups = np.split(order, np.flatnonzero(np.diff(along[order]) > 2 * NEAR) + 1)
    edge = [rows[group[np.argmax(nodes[rows[group], 1])]] for group in groups]
    return np.array([*edge, edge[0]])


def _contour(corners: Array) -> Array:
    """The longest outer contour (m,2) of filled triangles (t,3,2), all in drawn px."""
    width, height = np.ceil(corners.max(axis=(0, 1))).astype(int) + MARGIN + 1
    mask = np.zeros((height, width), np.uint8)
    for triangle in np.round(corners * 2**SHIFT).astype(np.int32):
        cv2.fillConvexPoly(mask, triangle, 255, cv2.LINE_8, SHIFT)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(max(contours, key=cv2.contourArea)[:, 0], np.float64)


def _on_contour(points: Array, contour: Array) -> tuple[Array, Array]:
    """Arc length of points (n, 2) along a contour (m, 2) of neighbouring pixels, and their distance from it.
    """
    neighbours = scipy.spatial.cKDTree(contour).query(points)
    off, nearest = np.asarray(neighbours[0], np.float64), np.asarray(neighbours[1], np.intp)
    steps = np.linalg.norm(np.diff(contour, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])[nearest], off


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
