"""Paints the models over pictures of the film: two side by side, as a still or as frames of a clip."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.review.filmed import Filmed
from twin.review.states import Array

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
