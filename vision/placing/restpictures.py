"""The picture of a finger at rest as its camera sees it, in the plane of the frame marks."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from vision.camera import Array, Camera
from vision.errors.sharederrors import Stated
from vision.film.video import Video
from vision.following.edges import edge_places
from vision.following.firstpictures import first_seen
from vision.following.markrotations import mean_seen
from vision.following.reference import reference_frames
from vision.marks import Mark, frame_places, rows_of
from vision.perspective import Viewpoint
from vision.placing.planeerrors import principal
from vision.placing.restplaces import BodyPose
from vision.placing.silhouettes import BodySurface, Silhouette, on_plane, silhouette
from vision.plane import MIN_VISIBLE, plane_of

STEP_PX = 0.25  # along a normal
HELD_MM = 2.0  # from where it is clamped the outline is not looked for
PICTURES = 12  # of the rest
HALF_PX = 5.0  # room for an edge


@dataclass(frozen=True)
class RestPicture:
    """The picture of a finger at rest, and what is known of the rig."""

    picture: Array  # (h,w), mean of the rest
    camera: Camera
    marks: Sequence[Mark]
    ideal: Array  # (f,2) px of the frame marks
    frame_mm: float
    scale: float
    height_mm: float
    edge_mm: float  # how far what is seen as edge may lie from the model's, each side of the body alike


def picture_at_rest(
    film: Video,
    camera: Camera,
    marks: Sequence[Mark],
    *,
    dictionary: str,
    reference_s: float,
    stated: Stated,
    edge_mm: float,
) -> RestPicture:
    """The mean picture of a film's rest, with its frame marks by their corners; edge_mm as of `RestPicture`.

    Raises ValueError where too few of them are seen.
    """
    frame, _ = rows_of(marks)
    chosen = reference_frames(film, reference_s)
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), PICTURES)).astype(int)]
    pictures = [picture for _, _, picture in film.chosen(chosen)]
    sought = [marks[p] for p in frame]
    seen = np.array([first_seen([picture], camera, sought, dictionary)[:, :, 2] for picture in pictures])
    with np.errstate(invalid="ignore"):
        ideal = mean_seen(seen[..., :2] / seen[..., 2:])
    there = np.isfinite(ideal[:, 0])
    if there.sum() < MIN_VISIBLE:
        raise ValueError(
            f"{film.path.name}: {int(there.sum())} frame markers are read at rest, "
            f"wanted {MIN_VISIBLE} or more"
        )
    kept = [marks[p] for p, found in zip(frame, there, strict=True) if found]
    return RestPicture(
        np.mean(pictures, axis=0), camera, kept, ideal[there], stated.frame_mm, stated.scale,
        stated.height_mm, edge_mm,
    )  # fmt: skip


class RestSight:
    """The picture at rest, in the plane of the frame marks."""

    def __init__(self, rest: RestPicture) -> None:
        self.rest = rest
        nominal = frame_places(rest.marks)
        self.plane = plane_of(nominal, rest.ideal[None])
        self.place, self.steps = _seen_from(rest, nominal)
        self.view = self.view_of(np.zeros(len(self.steps)))
        self.plane_mm = float(np.mean([m.position[1] for m in rest.marks if m.role == "frame"]))
        ends = self.pixels(nominal.mean(axis=0) + np.array([[0.0, 0.0], [1.0, 0.0]]))
        self.px_per_mm = float(np.linalg.norm(ends[1] - ends[0]))

    def with_picture(self, picture: Array) -> "RestSight":
        """The same rig in another picture (h,w)."""
        other = copy(self)
        other.rest = replace(self.rest, picture=picture)
        return other

    def pixels(self, place: Array) -> Array:
        """Raw pixels (...,2) of places (...,2) mm."""
        homography = self.plane.homography[0]
        mapped = place @ homography[:, :2].T + homography[:, 2]
        return self.rest.camera.distort(mapped[..., :2] / mapped[..., 2:])

    def grey(self, place: Array) -> Array:
        """Grey levels (...) at places (...,2) mm, of the nearest pixel outside the picture."""
        x, y = np.moveaxis(self.pixels(place), -1, 0)
        grey = scipy.ndimage.map_coordinates(self.rest.picture, [y, x], order=1, mode="nearest")
        return np.asarray(grey, float)

    def view_of(self, amplitude: Array) -> Viewpoint:
        """From where the camera looks, off the likeliest place by amplitudes (r,) of the errors of that."""
        x = self.place + amplitude @ self.steps
        centre = -np.asarray(cv2.Rodrigues(x[:3])[0]).T @ x[3:]
        return Viewpoint(centre[[0, 2]], float(centre[1]))

    def far_side(self, solid: BodySurface) -> float:
        """Half of what the far side of a body moves in mm, 1 sd, as the camera looks from elsewhere: which
        side is the outer one may turn over, and no slope of the outline tells that."""
        views = [self.view_of(amplitude).foot - self.view.foot for amplitude in np.eye(len(self.steps))]
        tilt = float(np.sqrt(np.square(views).sum() / 2.0)) / abs(self.view.distance)
        return 0.5 * tilt * float(np.ptp(solid.faces[..., 1]))

    def flat(self, points: Array, pose: BodyPose, view: Viewpoint | None = None) -> Array:
        """Places (...,2) mm in the plane of points (...,3) mm of a body that stands so."""
        return on_plane(points, pose, view or self.view, self.plane_mm)

    def outline(self, solid: BodySurface, pose: BodyPose, view: Viewpoint | None = None) -> Silhouette:
        """The outline of a solid that stands so, in the picture and where nothing clamps it."""
        line = silhouette(self.flat(solid.faces, pose, view))
        pixel, margin = self.pixels(line.place), 2.0 * self.px_per_mm
        free: NDArray[np.bool_] = np.all(
            (pixel > margin) & (pixel < np.array(self.rest.camera.size) - margin), axis=1
        )
        if len(solid.held):
            held = self.flat(solid.held, pose, view)
            free &= np.array([np.linalg.norm(held - x, axis=1).min() > HELD_MM for x in line.place])
        return line[free]

    def edges(self, line: Silhouette, sign: float, reach: float, ahead: Array) -> Array:
        """How far outside an outline the film's edge is (k,) mm, within `reach` of `ahead` (k,) mm."""
        step = STEP_PX / self.px_per_mm
        far = max(reach, HALF_PX / self.px_per_mm) + HALF_PX / self.px_per_mm
        along = np.arange(-far, far + step / 2, step)
        middle = line.place + ahead[:, None] * line.normal
        grey = self.grey(middle[:, None] + along[:, None] * line.normal[:, None])
        return ahead + edge_places(grey, STEP_PX, sign) * step - far


def _seen_from(rest: RestPicture, nominal: Array) -> tuple[Array, Array]:
    """Turn and shift (6,) of a camera of known lens that sees the frame marks at nominal places (f,2) mm, and
    errors (r,6) of these, 1 sd each. (A homography's eight numbers tell that less well than these six.)"""
    places, pixels = np.insert(nominal, 1, 0.0, axis=1), np.ascontiguousarray(rest.ideal)
    none = np.zeros(5)
    _, turn, shift = cv2.solvePnP(places, pixels, rest.camera.matrix, none, flags=cv2.SOLVEPNP_ITERATIVE)
    seen, slope = cv2.projectPoints(places, turn, shift, rest.camera.matrix, none)[:2]
    px_per_mm = rest.camera.matrix[0, 0] / float(shift[2, 0])
    free = max(2 * len(nominal) - 6, 1)
    misfit = float(np.sqrt(((np.asarray(seen).reshape(-1, 2) - pixels) ** 2).sum() / free))
    sd = max(rest.frame_mm * px_per_mm, misfit)
    covariance = sd**2 * np.linalg.pinv(slope[:, :6].T @ slope[:, :6])
    return np.concatenate([turn.ravel(), shift.ravel()]), principal(covariance)
