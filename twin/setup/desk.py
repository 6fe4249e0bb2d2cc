"""What the page holds: a draft, what is selected or dragged in its picture, and what was last written. Every
event gives another desk."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.gauge.synchrony import LagFit
from twin.inputs.foundrecordings import Tags
from twin.messages import Lines
from twin.setup.draft import Role, SetupDraft, in_body, in_frame, with_role
from twin.setup.outline import (
    Drag,
    PlaneView,
    contour_of,
    dragged,
    handle_at,
    handles_of,
    sight_of,
    stretched,
)
from twin.setup.proposal import Proposal, proposed, write_proposal
from twin.setup.svglayers import called, outline_svg, tag_at, tags_svg, unit_of_picture
from twin.targets import Array

if TYPE_CHECKING:  # vision takes a second to import
    from vision import Camera

Check = Callable[..., None]  # says what is known of a project; ValueError where it is not right
NEAR = 1.6  # units of the picture: within which a handle is taken


@dataclass(frozen=True, kw_only=True)
class Desk:
    """A draft on the page. Everything but `draft`, `camera` and what the mouse holds follows from them."""

    draft: SetupDraft
    width: int  # px of the film's pictures
    proposal: Proposal
    contour: Array | None = field(default=None, compare=False)  # (n,2) mm, in the body's axes
    camera: "Camera | None" = None
    selected: int | None = None  # id of a tag
    drag: Drag | None = None
    fault: str = ""  # why the last step was not done

    @property
    def sight(self) -> PlaneView | None:
        """How the picture shows the plane of the frame."""
        return sight_of(self.proposal, self.camera)

    @property
    def has_outline(self) -> bool:
        """Whether the outline can be laid over the picture."""
        return self.sight is not None and self.contour is not None

    @property
    def svg(self) -> str:
        """Tags and outline over the picture."""
        film, sight = self.draft.found.film, self.sight
        if film is None:
            return ""
        drawn = ""
        if sight is not None and self.contour is not None:
            held = None if self.drag is None else self.drag.handle
            drawn = outline_svg(
                in_frame(self.draft.pose, self.contour), handles_of(self.draft, self.contour), sight,
                width=self.width, held=held,
            )  # fmt: skip
        roles, names = self.proposal.roles, self.proposal.names
        return drawn + tags_svg(film, roles, names, width=self.width, selected=self.selected)


def numbers_of(desk: Desk) -> dict[str, Any]:
    """Where the body stands, its dimensions, and what is measured with a ruler, by the keys of twin.toml."""
    draft, board = desk.draft, desk.draft.found.board
    own = {} if draft.dimensions is None else draft.dimensions.model_dump()
    pose = draft.pose.model_dump(include={"x_mm", "z_mm", "turn_deg"})
    across, upright = draft.stated.frame.ruler_mm or (None, None)
    sides = {} if board is None else {"square_mm": board.square_mm, "marker_mm": board.marker_mm}
    return {**own, **pose, **sides, "across": across, "upright": upright}


def desk_of(draft: SetupDraft, *, width: int) -> Desk:
    """The desk with a draft on it."""
    return _with_contour(Desk(draft=draft, width=width, proposal=proposed(draft)))


def changed(desk: Desk, step: Callable[[SetupDraft], SetupDraft]) -> Desk:
    """The desk after a step; as it was, with the reason, where the step cannot be."""
    try:
        draft = step(desk.draft)
        after = replace(desk, draft=draft, proposal=proposed(draft), fault="")
    except ValueError as error:
        return replace(desk, fault=str(error))
    same = draft.stated.model == desk.draft.stated.model
    return after if same else _with_contour(after)


def _with_contour(desk: Desk) -> Desk:
    try:
        return replace(desk, contour=contour_of(desk.draft))
    except ValueError as error:
        return replace(desk, contour=None, fault=str(error))


def pressed(desk: Desk, pixel: Array) -> Desk:
    """The desk after the mouse is pressed at a pixel (2,): a handle is held, or else a tag is selected."""
    film, sight = desk.draft.found.film, desk.sight
    if film is None:
        return desk
    handles = {} if desk.contour is None else handles_of(desk.draft, desk.contour)
    near = NEAR * unit_of_picture(desk.width)
    handle = None if sight is None else handle_at(handles, sight, pixel, within_px=near)
    tag = tag_at(film, pixel)
    if handle is None and tag is None and sight is not None and _inside(desk, sight, pixel):
        handle = "move"
    if handle is not None and sight is not None:
        return replace(desk, drag=Drag(handle, sight.mm(pixel[None])[0], desk.draft), fault="")
    return replace(desk, selected=tag, fault="")


def _inside(desk: Desk, sight: PlaneView, pixel: Array) -> bool:
    """Whether a pixel (2,) lies on the outline's face."""
    import cv2

    if desk.contour is None:
        return False
    x, z = in_body(desk.draft.pose, sight.mm(pixel[None]))[0].tolist()
    return cv2.pointPolygonTest(desk.contour.astype(np.float32), (x, z), False) > 0


def moved(desk: Desk, pixel: Array) -> Desk:
    """The desk while what the mouse holds is at a pixel (2,)."""
    drag, sight = desk.drag, desk.sight
    if drag is None or sight is None or desk.contour is None:
        return desk
    try:
        draft = dragged(drag, sight.mm(pixel[None])[0])
    except ValueError as error:
        return replace(desk, fault=str(error))
    contour = stretched(desk.contour, desk.draft, draft)
    return replace(desk, draft=draft, proposal=proposed(draft), contour=contour, fault="")


def released(desk: Desk) -> Desk:
    """The desk after the mouse is let go: the outline is that of the model again."""
    return desk if desk.drag is None else _with_contour(replace(desk, drag=None))


def with_tag_role(desk: Desk, role: Role) -> Desk:
    """The desk after the selected tag gets a role; with the reason where it cannot have that."""
    code = desk.selected
    if code is None:
        return desk
    if role not in desk.proposal.choices(code):
        why = (f"{called(code)} cannot be {role}: where it is on the rig nobody knows; wanted a printed "
               "sheet, pictures of the board among the rig's tags, or its position_mm under "
               "[[frame.markers]]")  # fmt: skip
        return replace(desk, fault=why)
    return changed(desk, lambda draft: with_role(draft, code, role))


def written(desk: Desk, say: Any) -> Desk:
    """The desk after twin.toml is written; with the reason where it is not."""
    try:
        write_proposal(desk.proposal, say)
    except (ValueError, OSError) as error:
        return replace(desk, fault=f"not written: {error}")
    return replace(desk, fault="")


def with_camera(desk: Desk, camera: "Camera | None") -> Desk:
    """The desk with the lens known."""
    return replace(desk, camera=camera)


def lens_of_board(proposal: Proposal) -> "Camera | None":
    """The camera that the board's pictures tell, None where they tell none."""
    from twin.inputs.cameras import lens_of

    try:
        project = proposal.project
        return lens_of(project, project.config.cameras[0])
    except (ValueError, OSError):
        return None


def checked_lines(proposal: Proposal, check: Check) -> tuple[list[str], str]:
    """What `twin check` says of the project as it would be, and what is wrong, "" where nothing is. Nothing
    is written."""
    lines = Lines()
    try:
        check(proposal.project, lines, draws=False)
    except (ValueError, OSError) as error:
        return lines.lines, " ".join(str(error).split())
    return lines.lines, ""


# -- the clocks ----------------------------------------------------------------------------------------------


def course_of(film: Tags) -> tuple[Array, Array]:
    """Times (k,) s of the film's frames that were looked at, and the motion (k,) px of its tags."""
    motion = film.motion()
    return motion.time, motion.mm


def explained_at(draft: SetupDraft, start_s: float) -> float | None:
    """Share of the finger's motion that the pressure explains where the film starts at a time of the log;
    None without either."""
    found = draft.found
    if found.film is None or found.log is None:
        return None
    time, px = course_of(found.film)
    seen = np.isfinite(px)
    if seen.sum() < 8 or not np.ptp(found.log.pressure) > 0:
        return None
    return LagFit(time[seen], px[seen], found.log.time, found.log.pressure, creep=True).explained(start_s)
