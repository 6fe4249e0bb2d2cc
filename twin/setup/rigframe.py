"""Where the rig is: the printed sheet, loose markers that pictures have measured, or typed places."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.inputs.foundrecordings import Tags, first, pattern_of
from twin.marktables import FrameTable, MarkerTable
from twin.project.config import Config
from twin.project.framesheet import SheetMarker, SheetTable, markers_of
from twin.setup.draft import SHEET, Role, SetupDraft
from twin.setup.tagroles import along, on_finger, roles_of, side_of_finger, typed_markers

if TYPE_CHECKING:
    from twin.inputs.looseframe import Measured

RULERS = "ruler_mm under [frame]: measure both rulers of the sheet, across, upright."


@dataclass(frozen=True)
class RigFrame:
    """[frame], and how the rig's tags were placed."""

    table: FrameTable
    sheet: SheetTable | None = None
    is_new: bool = False  # whether the sheet is to be written
    unclear: tuple[str, ...] = ()
    placed: frozenset[int] = frozenset()  # ids of the tags that have a place on the rig, whatever their role

    @property
    def rig(self) -> dict[int, Role]:
        """The roles of the rig's tags, by id."""
        marks: Sequence[SheetMarker | MarkerTable] = self.sheet.markers if self.sheet else self.table.markers
        return {mark.marker: mark.role for mark in marks if mark.marker is not None}

    def markers(self, config: Config, film: Tags) -> tuple[MarkerTable, ...]:
        """The rig's markers that the film shows, in the axes of the frame."""
        placed = self.table.markers if self.sheet is None else markers_of(self.sheet, config)
        return tuple(mark for mark in placed if mark.marker in film.codes)


def rig_frame(draft: SetupDraft, film: Tags) -> RigFrame:
    """The frame of a draft: the printed sheet where there is one, else loose markers, else typed places."""
    if draft.found.rig and not draft.has_printed_sheet:
        return _loose(draft, film)
    return _typed(draft, film) if draft.sheet is None else _printed(draft, film, draft.sheet)


def _printed(draft: SetupDraft, film: Tags, sheet: SheetTable) -> RigFrame:
    """The frame of a printed sheet; it is to be written where its tags get other roles."""
    frame, own = draft.stated.frame, _with_roles(sheet, draft.roles)
    ruler = frame.ruler_mm if frame.sheet else None
    table = FrameTable(
        sheet=SHEET, ruler_mm=ruler, finger=side_of_finger(film, _own(draft, film, own), own),
        y_mm=frame.y_mm if frame.sheet else None,
    )  # fmt: skip
    return RigFrame(table, own, own != sheet, () if ruler else (RULERS,), _ids(sheet))


def _typed(draft: SetupDraft, film: Tags, *, unclear: tuple[str, ...] = ()) -> RigFrame:
    """The frame of typed places, of the tags that the film shows."""
    seen = [mark for mark in typed_markers(draft) if mark.marker in film.codes]
    roles = [draft.roles.get(mark.marker) or mark.role for mark in seen]
    markers = tuple(
        mark.model_copy(update={"role": role})
        for mark, role in zip(seen, roles, strict=True) if role in ("frame", "fixed", "clamp")
    )  # fmt: skip
    table = draft.stated.frame.model_copy(update={"markers": markers})
    return RigFrame(table, unclear=unclear, placed=frozenset(mark.marker for mark in seen))


def _loose(draft: SetupDraft, film: Tags) -> RigFrame:
    """The frame that pictures of rig and board together tell; that of typed places where they do not."""
    frame = draft.stated.frame
    try:
        if isinstance(draft.loose, str) or draft.loose is None:
            raise ValueError(draft.loose)
        sheet, unclear = _measured(draft, film, draft.loose)
    except ValueError as error:
        return _typed(draft, film, unclear=(f"Pictures of the rig: {error}.",))
    table = FrameTable(
        sheet=SHEET, pictures=pattern_of(draft.root, draft.found.rig), axes=frame.axes,
        finger=side_of_finger(film, _own(draft, film, sheet), None), y_mm=frame.y_mm if frame.sheet else None,
    )  # fmt: skip
    return RigFrame(table, _with_roles(sheet, draft.roles), True, tuple(unclear), _ids(sheet))


def _measured(draft: SetupDraft, film: Tags, seen: "Measured") -> tuple[SheetTable, list[str]]:
    """The frame of loose markers, and sentences on typed places that are odd, or on its axes."""
    from twin.inputs.looseframe import sheet_in_typed, sheet_of

    config, rig = draft.stated, dict.fromkeys(seen.codes, "fixed")
    own = on_finger(film, roles_of(draft, film, rig))  # type: ignore[arg-type]
    if typed := typed_markers(draft):
        sheet, odd = sheet_in_typed(
            seen, film, typed, sd_mm=config.measure.frame_sd_mm, along=along(film, own, None)
        )
        return sheet, [*seen.remarks, *odd]
    root = min(own, key=lambda k: float(film.reach[k]), default=0)
    sheet = sheet_of(seen, film, axes=config.frame.axes, near=first(film.centre)[root])
    if config.frame.axes is not None:
        return sheet, list(seen.remarks)
    origin = min(sheet.markers, key=lambda m: float(np.abs(m.place_mm).sum())).marker
    return sheet, [*seen.remarks, (
        "axes under [frame]: ids of the marker at the clamp's front and the finger's bottom, x = 0, z = 0, "
        f"and of one level with it. Now marker {origin} is at x = 0, z = 0, and the film's rows are level."
    )]  # fmt: skip


def _own(draft: SetupDraft, film: Tags, sheet: SheetTable) -> list[int]:
    """Rows of the tags on the finger, beside those of a sheet."""
    return on_finger(film, roles_of(draft, film, {mark.marker: mark.role for mark in sheet.markers}))


def _with_roles(sheet: SheetTable, roles: Mapping[int, Role]) -> SheetTable:
    """The sheet with the roles that the user has given, without the tags that are to be left out."""
    said = [(mark, roles.get(mark.marker) or mark.role) for mark in sheet.markers]
    kept = tuple(m.model_copy(update={"role": role}) for m, role in said if role in ("frame", "fixed"))
    return sheet.model_copy(update={"markers": kept})


def _ids(sheet: SheetTable) -> frozenset[int]:
    return frozenset(mark.marker for mark in sheet.markers)
