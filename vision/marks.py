"""Marks: what is glued where, and where a picture shows it, to a few hundredths of a pixel."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.camera import Array, Image
from vision.dictionaries import dictionary_of
from vision.kinds import CodedMarker, MarkKind, PlainDot, TexturePatch

ROLES = ("frame", "fixed", "clamp", "finger")
FEW = 4  # markers, below which the picture may be one of inverted markers
# Of OpenCV's detector, for small markers: noise near the threshold joins no edges, cells are read from their
# middles, and the white border may end at the picture's edge.
CLOSELY = {"adaptiveThreshConstant": 15.0, "perspectiveRemovePixelPerCell": 8,
           "perspectiveRemoveIgnoredMarginPerCell": 0.2, "minDistanceToBorder": 1}  # fmt: skip


@dataclass(frozen=True)
class Mark:
    """A mark: kind, place and role."""

    name: str
    kind: MarkKind  # `CodedMarker(code, size_mm)`, `PlainDot(size_mm)`, `TexturePatch(size_mm, ...)`
    position: tuple[float, float, float]  # mm, nominal centre at rest, world frame
    # "frame" carries the homography, "fixed" is data with u = 0, "clamp" is one whose place on the body is
    # stated, "finger" moves
    role: str
    group: str = ""  # marks of one group are off their places alike, as the points of one face are
    measured: bool = False  # x and z of its position are what the film at rest shows, NaN until then

    @property
    def size_mm(self) -> float:
        """Side or diameter of what is glued, mm."""
        return self.kind.size_mm

    @property
    def owner(self) -> str:
        """Name of the errors of its place."""
        return self.group or self.name


def rows_of(marks: Sequence[Mark]) -> tuple[list[int], list[int]]:
    """Rows of the frame marks and of all others, which are given out.

    >>> from vision.kinds import CodedMarker
    >>> marks = [Mark(f"m{i}", CodedMarker(i, 9.0), (0.0, 0.0, 0.0), role) for i, role in enumerate(ROLES)]
    >>> rows_of(marks)
    ([0], [1, 2, 3])
    >>> codes_of(marks)
    {0: 0, 1: 1, 2: 2, 3: 3}
    """
    frame = with_role(marks, "frame")
    return frame, [p for p in range(len(marks)) if p not in frame]


def with_role(marks: Sequence[Mark], role: str) -> list[int]:
    """Rows of the marks with a role."""
    return [p for p, mark in enumerate(marks) if mark.role == role]


def frame_places(marks: Sequence[Mark]) -> Array:
    """Nominal places (f,2) mm, x and z, of the frame marks."""
    return np.array([mark.position for mark in marks if mark.role == "frame"])[:, [0, 2]]


def codes_of(marks: Sequence[Mark]) -> dict[int, int]:
    """Row of every coded marker, and its code."""
    return {p: mark.kind.code for p, mark in enumerate(marks) if isinstance(mark.kind, CodedMarker)}


def dots_of(marks: Sequence[Mark]) -> list[int]:
    """Rows of the plain dots."""
    return [p for p, mark in enumerate(marks) if isinstance(mark.kind, PlainDot)]


def patches_of(marks: Sequence[Mark]) -> dict[int, TexturePatch]:
    """Row of every natural feature, and its kind."""
    return {p: mark.kind for p, mark in enumerate(marks) if isinstance(mark.kind, TexturePatch)}


def registered_of(marks: Sequence[Mark]) -> list[int]:
    """Rows of the marks that are followed by registration: coded ones and natural features."""
    return sorted([*codes_of(marks), *patches_of(marks)])


def check_names(marks: Sequence[Mark]) -> None:
    """Raises ValueError for marks that share a name or an id, or have an unknown role or no size."""
    for what, values in (("name", [m.name for m in marks]), ("marker", list(codes_of(marks).values()))):
        twice = [v for i, v in enumerate(values) if v in values[:i]]
        if twice:
            raise ValueError(f"{what} {twice[0]!r} is given to two markers: give each its own")
    for mark in marks:
        if mark.role not in ROLES:
            raise ValueError(f"marker {mark.name!r} has role {mark.role!r}: use one of {', '.join(ROLES)}")
        if not mark.size_mm > 0:
            raise ValueError(
                f"marker {mark.name!r} has size {mark.size_mm} mm: give the side of its black square "
                "or the diameter of the dot"
            )


def detect(image: Image, dictionary: str) -> tuple[dict[int, Array], set[int]]:
    """Corners (4,2) raw px of each marker seen once, and the ids that are seen more often.

    >>> import numpy as np
    >>> from vision.dictionaries import bits_of
    >>> picture = np.full((120, 120), 200, np.uint8)
    >>> picture[30:90, 30:90] = np.kron(bits_of(7, "DICT_4X4_50") // 255, np.full((10, 10), 200, np.uint8))
    >>> corners, several = detect(picture, "DICT_4X4_50")
    >>> {code: quad.round().tolist() for code, quad in corners.items()}
    {7: [[30.0, 30.0], [89.0, 30.0], [89.0, 89.0], [30.0, 89.0]]}
    """
    return _once(detect_all(image, dictionary))


def detect_all(image: Image, dictionary: str) -> list[tuple[int, Array]]:
    """Ids and corners (4,2) raw px of all markers, an id once for every time that it is seen.

    Where hardly any black marker on white is seen, white ones on black are looked for too. (OpenCV's
    detectInvertedMarker sees some of both, but loses one in twenty.)
    """
    seen = _detect(image, dictionary)
    if len(seen) >= FEW:
        return seen
    return max(seen, _detect(np.asarray(255 - image, dtype=np.uint8), dictionary), key=len)


def detect_wanted(image: Image, dictionary: str, ids: Collection[int]) -> tuple[dict[int, Array], set[int]]:
    """Markers as from `detect`, with a closer look, which takes as long again, where an id is not seen.

    Of drawn markers of 19 to 36 px the first look misses 9 %, both together 1.4 %.
    """
    quads, several = detect(image, dictionary)
    if missing := set(ids) - set(quads) - several:
        closer = _once(_detect(image, dictionary, **CLOSELY))[0]
        quads |= {name: quad for name, quad in closer.items() if name in missing}
    return quads, several


def _detect(image: Image, dictionary: str, **more: float) -> list[tuple[int, Array]]:
    """Ids and corners (4,2) raw px of all black markers on white; more: parameters of OpenCV's detector."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = 3
    parameters.relativeCornerRefinmentWinSize = 1.0
    # The default gate grows with the picture: 29 px at 4K. 12 px sides are found at any size.
    parameters.minMarkerPerimeterRate = 4.0 * 12.0 / max(image.shape)
    for name, value in more.items():
        setattr(parameters, name, value)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary_of(dictionary), parameters).detectMarkers(image)
    names = [] if ids is None else [int(i) for i in np.asarray(ids).reshape(-1)]
    quads = [np.asarray(quad, dtype=np.float64).reshape(4, 2) for quad in corners]
    return list(zip(names, quads, strict=True))


def _once(seen: list[tuple[int, Array]]) -> tuple[dict[int, Array], set[int]]:
    names = [name for name, _ in seen]
    return {name: quad for name, quad in seen if names.count(name) == 1}, {
        n for n in names if names.count(n) > 1
    }


def corner_warp(corners: Array) -> Array:
    """Warp (3,3) that takes the local square to the corners (4,2) ideal px, in ArUco's order."""
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float32)
    offset = corners.mean(axis=0)  # single precision: keep the numbers small
    warp = np.asarray(
        cv2.getPerspectiveTransform(square, (corners - offset).astype(np.float32)), dtype=np.float64
    )
    shift = np.eye(3)
    shift[:2, 2] = offset
    return np.asarray(shift @ warp)


def dot_warp(centre: Array, radius: float) -> Array:
    """Warp (3,3) of a dot: its centre in ideal px and its radius, no rotation."""
    return np.array([[radius, 0.0, centre[0]], [0.0, radius, centre[1]], [0.0, 0.0, 1.0]])


def linear_at_centre(warp: Array) -> Array:
    """Linear maps (...,2,2), px per local unit, of warps (...,3,3) at the origin.

    Perspective counts: times the distance from the picture's corner it is as large as the rest.
    """
    return np.asarray(warp[..., :2, :2] - warp[..., :2, 2:] * warp[..., 2:, :2])


def px_per_unit(warp: Array) -> Array:
    """Pixels per local unit (p,) at the origin of warps (p,3,3)."""
    linear = linear_at_centre(warp)
    return np.sqrt(np.abs(linear[..., 0, 0] * linear[..., 1, 1] - linear[..., 0, 1] * linear[..., 1, 0]))
