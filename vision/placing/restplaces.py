"""Places of the finger's marks at rest, which nobody states, and the pose of the body in the frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from vision.camera import Array, Camera
from vision.film.video import Video
from vision.following.firstpictures import START_FRAMES, first_seen
from vision.following.markrotations import mean_seen
from vision.kinds import CodedMarker, TexturePatch
from vision.marks import Mark, frame_places, rows_of, with_role
from vision.perspective import heights, to_own_plane, viewpoint
from vision.placing.views import Seen
from vision.plane import homographies, to_plane

LEAST_APART_MM = 5.0  # markers of the clamp: nearer ones do not tell how the body is turned


@dataclass(frozen=True)
class BodyPose:
    """Where a body stands in the axes of the frame: its origin, and its turn from x towards z."""

    x_mm: float = 0.0
    z_mm: float = 0.0
    turn: float = 0.0  # rad

    def in_body(self, marks: Sequence[Mark]) -> list[Mark]:
        """The marks with those of the rig in the body's axes; all others are there already.

        >>> from vision.kinds import CodedMarker
        >>> mark = Mark("f1", CodedMarker(1, 5.0), (10.0, 11.5, 3.0), "frame")
        >>> BodyPose(x_mm=10.0, z_mm=-1.0, turn=np.pi / 2).in_body([mark])[0].position
        (4.0, 11.5, 0.0)
        """
        return [self._moved(mark) if mark.role in ("frame", "fixed") else mark for mark in marks]

    def _moved(self, mark: Mark) -> Mark:
        x, y, z = mark.position
        c, s, x, z = np.cos(self.turn), np.sin(self.turn), x - self.x_mm, z - self.z_mm
        return replace(mark, position=(round(float(c * x + s * z), 9), y, round(float(c * z - s * x), 9)))


def located(film: Video, camera: Camera, marks: Sequence[Mark], dictionary: str) -> list[Mark]:
    """The marks in the body's axes, by the corners of the coded ones in the film's first pictures: with the
    pose that marks of the clamp tell, and finger marks whose place is measured where they are seen there.

    A mark that is not seen keeps its NaN.
    """
    if not any(mark.measured or mark.role == "clamp" for mark in marks):
        return list(marks)
    coded = [p for p, mark in enumerate(marks) if isinstance(mark.kind, CodedMarker)]
    pictures = [image for _, _, image in islice(film.frames(), START_FRAMES)]
    warp = np.full((len(marks), 3, 3), np.nan)
    warp[coded] = first_seen(pictures, camera, [marks[p] for p in coded], dictionary)
    with np.errstate(invalid="ignore"):
        ideal = (warp[:, :2, 2] / warp[:, 2:, 2])[None]
    return _placed(list(marks), ideal, camera)[0]


def at_rest(seen: Seen, marks: Sequence[Mark], clamp_sd_mm: float) -> tuple[list[Mark], Array | None]:
    """The marks in the body's axes as the reference of the followed film shows them, and the covariance (3,3)
    of their pose (mm, mm, rad) where marks of the clamp tell it.

    clamp_sd_mm: how well their places on the body are known. They are fixed ones from then on.
    """
    placed, covariance = _placed(list(marks), seen.film.ideal[seen.film.reference], seen.camera, clamp_sd_mm)
    return [replace(m, role="fixed") if m.role == "clamp" else m for m in placed], covariance


def _placed(
    marks: list[Mark], ideal: Array, camera: Camera, clamp_sd_mm: float = 1.0
) -> tuple[list[Mark], Array | None]:
    """The marks in the body's axes, from ideal px (t,m,2) of all at rest."""
    covariance = None
    if clamp := with_role(marks, "clamp"):
        seen = [p for p in clamp if np.isfinite(ideal[:, p, 0]).any()]
        pose, covariance = pose_of(
            np.array([marks[p].position for p in seen])[:, [0, 2]] if seen else np.empty((0, 2)),
            places(marks, ideal, camera)[seen], clamp_sd_mm,
        )  # fmt: skip
        marks = pose.in_body(marks)
    place = places(marks, ideal, camera)
    return [_at(m, x, z) for m, (x, z) in zip(marks, place, strict=True)], covariance


def _at(mark: Mark, x: float, z: float) -> Mark:
    if isinstance(mark.kind, TexturePatch) and np.isnan(x):  # not looked for yet: where it was picked
        x, z = mark.kind.seen_mm
    return replace(mark, position=(float(x), mark.position[1], float(z))) if mark.measured else mark


def places(marks: Sequence[Mark], ideal: Array, camera: Camera) -> Array:
    """Mean places (m,2) mm of all marks, each in its own plane, from ideal px (t,m,2)."""
    frame = rows_of(marks)[0]
    homography = homographies(frame_places(marks), ideal[:, frame])
    view = viewpoint(camera, homography)
    return mean_seen(to_own_plane(to_plane(homography, ideal), heights(marks, frame), view))


def pose_of(body: Array, frame: Array, sd_mm: float) -> tuple[BodyPose, Array]:
    """The pose of a body of which places (n,2) mm in its own axes are seen at places (n,2) mm of the frame,
    and its covariance (3,3) in mm, mm and rad.   sd_mm: of each place on the body and axis.

    Least squares of a rigid motion (doi 10.1109/TPAMI.1987.4767965 in the plane). Raises ValueError for fewer
    than two places, and for places that are too near to each other.

    >>> body = np.array([[-5.0, 2.0], [-5.0, 18.0]])
    >>> pose, covariance = pose_of(body, body @ np.array([[0.8, 0.6], [-0.6, 0.8]]) + [1.0, -2.0], 0.1)
    >>> round(pose.x_mm, 6), round(pose.z_mm, 6), round(pose.turn, 6)
    (1.0, -2.0, 0.643501)
    >>> float(np.sqrt(covariance[2, 2]).round(6))  # rad: 0.1 mm at 8 mm, twice
    0.008839
    """
    if len(body) < 2 or np.ptp(body, axis=0).max() < LEAST_APART_MM:
        raise ValueError(
            f"{len(body)} markers with role \"clamp\" are seen, wanted two or more, {LEAST_APART_MM:g} mm "
            "apart or more: they tell where the finger stands; uncover them, add one, or state [pose] instead"
        )
    before, after = ((x - x.mean(axis=0)) @ [1, 1j] for x in (body, frame))
    turn = float(np.angle((before.conj() * after).sum()))
    c, s = np.cos(turn), np.sin(turn)
    x, z = frame.mean(axis=0) - body.mean(axis=0) @ np.array([[c, s], [-s, c]])
    rows = np.zeros((2 * len(body), 3))
    rows[::2, 0], rows[1::2, 1] = 1.0, 1.0
    rows[::2, 2], rows[1::2, 2] = -body[:, 1], body[:, 0]
    return BodyPose(float(x), float(z), turn), np.asarray(sd_mm**2 * np.linalg.inv(rows.T @ rows), float)
