"""Marker dictionaries: OpenCV's predefined ones by name."""

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

# Largest dictionary of each family, and the sizes of the smaller ones, which are its first words.
FAMILIES = (
    *((f"DICT_{bits}X{bits}_1000", (50, 100, 250, 1000)) for bits in (4, 5, 6, 7)),
    *((f"DICT_{name}", ()) for name in ("ARUCO_ORIGINAL", "ARUCO_MIP_36h12")),
    *((f"DICT_APRILTAG_{name}", ()) for name in ("16h5", "25h9", "36h10", "36h11")),
)


def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's predefined marker dictionary of that name; raises ValueError for a name it does not have."""
    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise ValueError(f"marker dictionary {name!r} is not known: use a name such as DICT_4X4_50")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def other_dictionary(images: Iterable[Image], tried: str) -> tuple[str, int] | None:
    """The other predefined dictionary that finds most markers in the images, and how many, if any does."""
    pictures = list(images)
    found: dict[str, list[int]] = {}
    for family, _ in FAMILIES:
        detector = cv2.aruco.ArucoDetector(dictionary_of(family))
        ids = [detector.detectMarkers(picture)[1] for picture in pictures]
        found[family] = [int(i) for some in ids if some is not None for i in np.asarray(some).reshape(-1)]
    best, sizes = max(FAMILIES, key=lambda f: len(found[f[0]]))
    if len(found[best]) < 2:  # the larger families decode a mark of anything: a lone one is no evidence
        return None
    enough = [best.replace("1000", str(size)) for size in sizes if max(found[best]) < size]
    name = enough[0] if enough else best
    return None if name == tried else (name, len(found[best]))
