"""Which tags are the rig's, which are on the finger, and along which way the finger points."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from twin.inputs.foundrecordings import Tags, first
from twin.marktables import PointTable
from twin.project.framesheet import SheetTable
from twin.setup.draft import Role, SetupDraft, in_body
from twin.targets import Array


def roles_of(draft: SetupDraft, film: Tags, rig: Mapping[int, Role]) -> dict[int, Role]:
    """The role of every tag of the film: as the user says, else that of the rig's tags, by id. Of the others
    those that move, even a little in line with the rest, or that twin.toml has as points, are on the finger;
    those that stand still are nobody's."""
    stated = {point.marker for point in stated_points(draft)}
    own: dict[int, Role] = {
        code: "finger" if moves or code in stated else "ignore"
        for code, moves in zip(film.codes, film.moves | film.near, strict=True)
    }
    return {code: draft.roles.get(code) or rig.get(code) or own[code] for code in film.codes}


def choices_of(draft: SetupDraft, code: int, placed: set[int]) -> tuple[Role, ...]:
    """The roles that a tag can have. Those of the rig want a place: the tags in `placed` have one."""
    if code not in placed:
        return ("finger", "ignore")
    typed = code in {mark.marker for mark in typed_markers(draft)}
    return ("frame", "fixed", *(("clamp",) if typed else ()), "finger", "ignore")


def typed_markers(draft: SetupDraft) -> tuple[Any, ...]:
    """The frame markers that somebody typed, none where they are the template's."""
    markers = draft.stated.frame.markers
    return markers if markers != draft.template.frame.markers else ()


def stated_points(draft: SetupDraft) -> tuple[PointTable, ...]:
    """The points on the finger that somebody stated, none where they are the template's."""
    points = draft.stated.points
    return points if points != draft.template.points else ()


def on_finger(film: Tags, roles: Mapping[int, Role]) -> list[int]:
    """Rows of the film's tags that are on the finger."""
    return [k for k, code in enumerate(film.codes) if roles[code] == "finger"]


def side_of_finger(film: Tags, own: Sequence[int], sheet: SheetTable | None) -> Literal["right", "left"]:
    """The side to which the finger points.   own: rows of its tags."""
    return "right" if along(film, own, sheet) > 0 else "left"


def along(film: Tags, own: Sequence[int], sheet: SheetTable | None) -> float:
    """1 where the finger points to the right of the sheet, or of the film, else -1: from the tag that moves
    least to that which moves most.   own: rows of its tags."""
    places = {} if sheet is None else {mark.marker: mark.place_mm for mark in sheet.markers}
    if not len(own):
        return 1.0
    right = (places_of_tags(film, own, places) if places else first(film.centre)[list(own)])[:, 0]
    order = np.argsort(film.reach[list(own)])
    middle = 0.0 if places else 0.5 * float(np.nanmax(film.centre[..., 0]))
    return 1.0 if right[order[-1]] > (right[order[0]] if len(own) > 1 else middle) else -1.0


def places_of_tags(film: Tags, own: Sequence[int], places: Mapping[int, Any]) -> Array:
    """Places (n,2) mm of tags at rest, in the plane of others whose places are known."""
    from vision.plane import fit_homography, to_plane

    rest = first(film.centre)
    rig = [k for k, code in enumerate(film.codes) if code in places]
    to_px = fit_homography(np.array([places[film.codes[k]] for k in rig]), rest[rig])
    return to_plane(to_px[None], rest[None, list(own)])[0]


def points_on_finger(
    draft: SetupDraft, film: Tags, own: Sequence[int], rig: Sequence[Any]
) -> dict[int, PointTable]:
    """The finger's tags and dots by id, named along it; those that twin.toml had keep what it says of them,
    a dot by its place. Dots want the frame, which tells their places.

    own: rows of its tags.   rig: the frame markers that are seen.
    """
    from vision.plane import MIN_VISIBLE

    former = {point.marker: point for point in stated_points(draft) if point.marker is not None}
    spots = [(p, p.position_mm) for p in stated_points(draft) if p.marker is None and p.position_mm]
    has_frame = len(rig) >= MIN_VISIBLE
    own = [k for k in own if has_frame or film.codes[k] >= 0]
    if not len(own):
        return {}
    if not has_frame:  # in px, from the tag that is nearest to the clamp
        x = along(film, own, None) * first(film.centre)[list(own)][:, 0]
        place, size = np.stack([x - x.min(), np.zeros(len(own))], axis=1), np.full(len(own), np.nan)
    else:
        known = {m.marker: np.array(m.position_mm)[[0, 2]] for m in rig}
        place = in_body(draft.pose, places_of_tags(film, own, known))
        size = _sizes(film, own, rig)
    x = place[:, 0]
    tip = int(np.argmax(x))
    middle = int(np.argmin(np.abs(x - 0.5 * x[tip])))
    found = {}
    for rank, k in enumerate(np.argsort(x)):
        name = "tip" if k == tip else "middle" if k == middle else f"p{rank + 1}"
        code = film.codes[own[k]]  # where a tag sits, `twin measure` measures
        side = round(float(size[k]), 2) if np.isfinite(size[k]) else None
        if code >= 0:
            found[code] = former.get(code) or PointTable(name=name, marker=code, size_mm=side)
            continue
        at = round(float(x[k]), 2), float(rig[0].position_mm[1]), round(float(place[k, 1]), 2)
        near = [p for p, (a, _, b) in spots if np.hypot(a - at[0], b - at[2]) < size[k]]
        found[code] = near[0] if near else PointTable(name=name, position_mm=at, size_mm=side)
    return found


def _sizes(film: Tags, own: Sequence[int], rig: Sequence[Any]) -> Array:
    """Sides (n,) mm of tags and diameters of dots, beside those of the rig."""
    def side(rows: Sequence[int]) -> Array:
        quads = first(film.quads.reshape(*film.quads.shape[:2], 8)).reshape(-1, 4, 2)[list(rows)]
        return np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=2).mean(axis=1)

    sizes = {mark.marker: mark.size_mm for mark in rig}
    rows = [k for k, code in enumerate(film.codes) if code in sizes]
    return side(own) * np.median(np.array([sizes[film.codes[k]] for k in rows]) / side(rows))
