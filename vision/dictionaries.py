"""Marker dictionaries: OpenCV's predefined ones by name, the AprilTag families among them, and own ones."""

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Image
from vision.opencvfile import read_opencv

FILES = (".yml", ".yaml", ".xml", ".json")
# Largest dictionary of each family, and the sizes of the smaller ones, which are its first words.
FAMILIES = (
    *((f"DICT_{bits}X{bits}_1000", (50, 100, 250, 1000)) for bits in (4, 5, 6, 7)),
    *((f"DICT_{name}", ()) for name in ("ARUCO_ORIGINAL", "ARUCO_MIP_36h12")),
    *((f"DICT_APRILTAG_{name}", ()) for name in ("16h5", "25h9", "36h10", "36h11")),
)


def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """A marker dictionary: OpenCV's predefined one of that name, or the one in a file.

    name: "DICT_4X4_50", "DICT_APRILTAG_36h11", ..., or the path of a file as OpenCV writes it, with
    nmarkers, markersize, maxCorrectionBits and marker_0, ... of zeros and ones (.yml, .xml, .json).
    Raises ValueError for a name that OpenCV does not have and for a file that is none.

    >>> len(dictionary_of("DICT_APRILTAG_36h11").bytesList)
    587
    """
    if Path(name).suffix.lower() in FILES:
        return _from_file(name)
    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise ValueError(
            f"marker dictionary {name!r} is not known: use a name such as DICT_4X4_50 or a file such as "
            "raw/dictionary.yml"
        )
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def bits_of(marker: int, dictionary: str) -> NDArray[np.uint8]:
    """Cells (n,n) of a marker with its black border, 0 black and 255 white.

    Raises ValueError for an id that the dictionary does not have.

    >>> (bits_of(0, "DICT_4X4_50") == 255).astype(int)
    array([[0, 0, 0, 0, 0, 0],
           [0, 1, 0, 1, 1, 0],
           [0, 0, 1, 0, 1, 0],
           [0, 0, 0, 1, 1, 0],
           [0, 0, 0, 1, 0, 0],
           [0, 0, 0, 0, 0, 0]])
    """
    words = dictionary_of(dictionary)
    if not 0 <= marker < len(words.bytesList):
        raise ValueError(
            f"marker {marker} is not in {dictionary}: it has ids 0 to {len(words.bytesList) - 1}"
        )
    return np.asarray(words.generateImageMarker(marker, words.markerSize + 2), dtype=np.uint8)


@lru_cache(maxsize=8)
def _from_file(name: str) -> cv2.aruco.Dictionary:
    if not Path(name).exists():
        raise ValueError(f"marker dictionary {name} does not exist: give the path of an OpenCV YAML file")
    tree = read_opencv(Path(name), what="marker dictionary")
    count, side = (tree.get(key) for key in ("nmarkers", "markersize"))
    corrected = tree.get("maxCorrectionBits", 0)  # as OpenCV reads a file without it
    for key, value, low, high in (("nmarkers", count, 1, 100_000), ("markersize", side, 3, 16)):
        if not isinstance(value, int) or not low <= value <= high:
            raise ValueError(
                f"marker dictionary {name}: {key} = {value!r}; wanted {low} to {high}, and marker_0, ..."
            )
    assert isinstance(count, int)  # checked
    assert isinstance(side, int)
    if not isinstance(corrected, int) or not 0 <= corrected <= side * side // 2:
        raise ValueError(
            f"marker dictionary {name}: maxCorrectionBits = {corrected!r}; wanted 0 to {side * side // 2}"
        )
    words = [tree.get(f"marker_{k}") for k in range(count)]
    for k, word in enumerate(words):
        if not isinstance(word, str) or len(word) != side * side or set(word) - {"0", "1"}:
            raise ValueError(
                f"marker dictionary {name}: marker_{k} = {str(word)[:40]!r}; wanted {side * side} bits, 0 or "
                "1, in quotes"
            )
    bits = [np.array(list(str(word)), dtype=np.uint8).reshape(side, side) for word in words]
    stacked = np.concatenate([cv2.aruco.Dictionary.getByteListFromBits(square) for square in bits])
    return cv2.aruco.Dictionary(stacked, side, corrected)


def other_dictionary(images: Iterable[Image], tried: str) -> tuple[str, int] | None:
    """The other predefined dictionary that finds most markers in the images, and how many, if any does."""
    pictures = list(images)
    seen: dict[str, list[int]] = {}
    for family, _ in FAMILIES:
        detector = cv2.aruco.ArucoDetector(dictionary_of(family))
        ids = [detector.detectMarkers(picture)[1] for picture in pictures]
        seen[family] = [int(i) for part in ids if part is not None for i in np.asarray(part).reshape(-1)]
    best, sizes = max(FAMILIES, key=lambda f: len(seen[f[0]]))
    if len(seen[best]) < 2:  # the larger families decode a mark of anything: a lone one is no evidence
        return None
    enough = [best.replace("1000", str(size)) for size in sizes if max(seen[best]) < size]
    name = enough[0] if enough else best
    return None if name == tried else (name, len(seen[best]))
