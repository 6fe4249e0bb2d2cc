"""A picture with every mark circled: found, missing, or of no stated mark."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.drawing.overlays import write_text

FOUND, MISSING, UNUSED = (115, 230, 60), (60, 60, 255), (0, 200, 255)


def circled(
    picture: Image,
    names: Sequence[str],
    centre: Array,
    radius_px: Array,
    found: NDArray[np.bool_],
    unused: Mapping[int, Array],
) -> NDArray[np.uint8]:
    """The grey picture (h,w) as (h,w,3), blue green red, with a circle and its name round each mark.

    centre: (p,2) raw px, NaN for one whose place is unknown.   radius_px: (p,).   found: (p,) green; else red,
    where it should be.   unused: places (2,) of marker ids that no mark has, in yellow.
    """
    drawn = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    unit = max(picture.shape[1] / 1280.0, 0.5)
    for p, name in enumerate(names):
        if np.isfinite(centre[p]).all():
            colour = FOUND if found[p] else MISSING
            label = name if found[p] else f"{name} not found"
            _ring(drawn, centre[p], float(radius_px[p]), label, colour, unit)
    usual = float(np.nanmedian(radius_px)) if np.isfinite(radius_px).any() else 20.0 * unit
    for code, place in unused.items():
        _ring(drawn, place, usual, f"id {code} of no mark", UNUSED, unit)
    legend = f"green: found ({int(found.sum())} of {len(names)}); red: not found; yellow: an id that is not stated"
    write_text(drawn, legend, np.array([8.0, drawn.shape[0] - 10.0]), unit, (255, 255, 255))
    return drawn


def _ring(
    drawn: NDArray[np.uint8], centre: Array, radius: float, label: str, colour: tuple[int, int, int], unit: float
) -> None:
    if not np.all(np.abs(centre) < 4.0 * max(drawn.shape)):
        return
    x, y = np.round(centre).astype(int)
    cv2.circle(drawn, (int(x), int(y)), max(round(radius), 3), colour, max(round(1.5 * unit), 1), cv2.LINE_AA)
    write_text(drawn, label, centre + (radius * 0.75, -radius * 0.75), unit, colour)
