"""The model's outline over the film's first picture, and the handles by which it is moved, turned and made
longer or higher."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from twin.inputs.foundrecordings import first
from twin.project.folder import Project
from twin.setup.draft import SetupDraft, in_body, in_frame, with_dimension, with_dimensions, with_pose
from twin.setup.proposal import Proposal, proposed
from twin.targets import Array

if TYPE_CHECKING:  # vision takes a second to import
    from vision import Camera

Handle = Literal["move", "turn", "length_mm", "height_mm"]
BEYOND = 0.15  # of the outline's length, from the tip to the handle that turns it
STEP_MM = 0.1  # of a dimension that is dragged


@dataclass(frozen=True)
class PlaneView:
    """The plane of the frame, seen in the film's first picture."""

    homography: Array  # (3,3) mm to ideal px
    camera: "Camera | None" = None  # None: the lens is not known, and left out

    def px(self, places: Array) -> Array:
        """Pixels (n,2) of places (n,2) mm, x and z."""
        ideal = _mapped(self.homography, places)
        return ideal if self.camera is None else self.camera.distort(ideal)

    def mm(self, pixels: Array) -> Array:
        """Places (n,2) mm, x and z, of pixels (n,2)."""
        ideal = pixels if self.camera is None else self.camera.undistort(pixels)
        return _mapped(np.asarray(np.linalg.inv(self.homography), np.float64), ideal)


def _mapped(homography: Array, points: Array) -> Array:
    mapped = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def sight_of(proposal: Proposal, camera: "Camera | None" = None) -> PlaneView | None:
    """How the film's first picture shows the plane of the frame; None where fewer than four of its markers
    are seen, or all on one line."""
    from vision.plane import MIN_VISIBLE, homographies

    film, frame = proposal.draft.found.film, proposal.frame
    marks = () if film is None or frame is None else frame.markers(proposal.config, film)
    marks = tuple(mark for mark in marks if mark.role != "clamp")
    if film is None or len(marks) < MIN_VISIBLE:
        return None
    seen = first(film.centre)[[film.codes.index(mark.marker or 0) for mark in marks]]
    places = np.array([mark.position_mm for mark in marks])[:, [0, 2]]
    homography = homographies(places, (seen if camera is None else camera.undistort(seen))[None])[0]
    return PlaneView(homography, camera) if np.isfinite(homography[0, 0]) else None


def contour_of(draft: SetupDraft) -> Array:
    """The outline (n,2) mm of the body as stated, x and z in its own axes, closed. ValueError for a deck that
    is not there or not right."""
    from fe.element import triangles
    from twin.bench.workbench import structure_of
    from twin.drawing.painting import edge_rows

    structure = structure_of(Project(draft.root, draft.stated))
    nodes = structure.case.nodes
    return np.asarray(nodes[edge_rows(nodes, triangles(structure.outside))][:, [0, 2]])


def handles_of(draft: SetupDraft, contour: Array) -> dict[Handle, Array]:
    """Places (2,) mm of the handles in the axes of the frame; of a dimension that the body does not have,
    none.   contour (n,2) mm, in the body's axes."""
    (x0, z0), (x1, z1) = contour.min(axis=0), contour.max(axis=0)
    own: dict[Handle, tuple[float, float]] = {
        "move": (x0, (z0 + z1) / 2), "turn": (x1 + BEYOND * (x1 - x0), (z0 + z1) / 2),
        "length_mm": (x1, (z0 + z1) / 2), "height_mm": ((x0 + x1) / 2, z1),
    }  # fmt: skip
    has = set(type(draft.dimensions).model_fields) if draft.dimensions is not None else set()
    shown = {k: v for k, v in own.items() if k in ("move", "turn") or k in has}
    places = in_frame(draft.pose, np.array(list(shown.values())))
    return dict(zip(shown, places, strict=True))


def handle_at(
    handles: Mapping[Handle, Array], sight: PlaneView, pixel: Array, *, within_px: float
) -> Handle | None:
    """The handle at a pixel (2,), the nearest of several."""
    if not handles:
        return None
    away = np.linalg.norm(sight.px(np.array(list(handles.values()))) - pixel, axis=1)
    return list(handles)[int(away.argmin())] if away.min() <= within_px else None


@dataclass(frozen=True)
class Drag:
    """A handle that is held: where it was taken, and the draft then."""

    handle: Handle
    start: Array  # (2,) mm, in the axes of the frame
    draft: SetupDraft


def dragged(drag: Drag, to: Array) -> SetupDraft:
    """The draft with the held handle at a place (2,) mm of the frame. ValueError for a dimension that cannot
    be."""
    pose = drag.draft.pose
    if drag.handle == "move":
        x, z = np.round(np.array([pose.x_mm, pose.z_mm]) + to - drag.start, 2)
        return with_pose(drag.draft, pose.model_copy(update={"x_mm": float(x), "z_mm": float(z)}))
    if drag.handle == "turn":
        (x0, z0), (x1, z1) = drag.start - (pose.x_mm, pose.z_mm), to - (pose.x_mm, pose.z_mm)
        more = math.degrees(math.atan2(x0 * z1 - z0 * x1, x0 * x1 + z0 * z1))
        turn = (pose.turn_deg + more + 180.0) % 360.0 - 180.0
        return with_pose(drag.draft, pose.model_copy(update={"turn_deg": round(turn, 2)}))
    axis = 0 if drag.handle == "length_mm" else 1
    change = (in_body(pose, to[None]) - in_body(pose, drag.start[None]))[0, axis]
    value = getattr(drag.draft.dimensions, drag.handle) + float(change)
    return with_dimension(drag.draft, drag.handle, round(round(value / STEP_MM) * STEP_MM, 3))


def snapped(draft: SetupDraft, camera: "Camera | None") -> SetupDraft:
    """The draft with the body where the edges of the finger are seen at rest, and with the dimensions that
    these show to be others. ValueError where too little is seen. `twin measure` then tells the place again,
    with its sd."""
    from twin.inputs.outlines import LEAST_MM, OFF, seen_outline
    from vision import Video

    film = draft.found.film
    if film is None or camera is None:
        raise ValueError("the lens is not known yet: wanted pictures of the board, and a moment to read them")
    near = with_pose(draft, draft.pose.model_copy(update={"source": "outline"}))
    project = proposed(near).project
    found = seen_outline(project, project.config.cameras[0], Video(film.path), camera).found
    place = {"x_mm": round(found.pose.x_mm, 3), "z_mm": round(found.pose.z_mm, 3),
             "turn_deg": round(math.degrees(found.pose.turn), 3)}  # fmt: skip
    there = with_pose(near, near.pose.model_copy(update=place))
    others = (size for size in found.sizes if size.shown and abs(size.off) > max(OFF * size.sd, LEAST_MM))
    sizes = {size.name: size.off for size in others}
    own = {} if draft.dimensions is None else draft.dimensions.model_dump(include=set(sizes))
    changed: dict[str, float] = {key: round(value + sizes[key], 2) for key, value in own.items()}
    waves = getattr(draft.dimensions, "waves", None)
    if waves and found.counted:
        changed[waves[0]] = found.counted
    return with_dimensions(there, changed)


def stretched(contour: Array, before: SetupDraft, after: SetupDraft) -> Array:
    """The outline (n,2) mm as another length and height make it, before the body is meshed anew."""
    ratio = [
        getattr(after.dimensions, key, 1.0) / getattr(before.dimensions, key, 1.0)
        for key in ("length_mm", "height_mm")
    ]
    return np.asarray(contour * ratio)
