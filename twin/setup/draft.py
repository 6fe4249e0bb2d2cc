"""What twin.toml will be made from: recordings as they are found, and what their user says of them. Each step
gives another draft, and nothing is written."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from twin.bodies.kinds import BODIES, BodyTable
from twin.gauge.pressurelog import read_log
from twin.gauge.pressuretable import PressureTable
from twin.inputs.foundrecordings import Recordings, recordings, with_clock
from twin.marktables import FrameTable, PoseTable
from twin.project.cameratables import BoardTable
from twin.project.config import Config
from twin.project.framesheet import SheetTable, read_sheet
from twin.project.toml import parse
from twin.targets import Array
from twin.validation import checked

if TYPE_CHECKING:
    from twin.inputs.looseframe import Measured

Role = Literal["frame", "fixed", "clamp", "finger", "ignore"]
ROLES: tuple[Role, ...] = get_args(Role)
SHEET = "raw/frame.toml"
BY_EYE_S = 0.05  # sd of a film's start that somebody has shifted by eye


@dataclass(frozen=True, kw_only=True)
class SetupDraft:
    """What twin.toml will be made from."""

    root: Path
    template: Config  # of a project that nobody has filled in
    stated: Config  # the former twin.toml, else the template; and what the user has said since
    is_former: bool  # whether there was one
    found: Recordings
    sheet: SheetTable | None = None  # the frame that lies in the folder
    loose: "Measured | str | None" = None  # places of loose markers, or why the pictures do not tell them
    roles: Mapping[int, Role] = field(default_factory=dict)  # of tags, by id, where the user has said them
    start_s: float | None = None  # of the film on the log's clock, as the user has shifted it
    board_measured: bool = False  # whether somebody has stated the side of a square

    @property
    def dimensions(self) -> BodyTable | None:
        """The dimensions of the body as they stand, None of a deck."""
        return self.stated.model.dimensions

    @property
    def has_printed_sheet(self) -> bool:
        """Whether the frame in the folder is one that was printed, not one that pictures have measured."""
        return self.sheet is not None and self.sheet.ruler_mm is not None

    @property
    def start(self) -> float | None:
        """When the film starts on the log's clock, s: as shifted, else as its motion tells."""
        return self.found.start_s if self.start_s is None else self.start_s

    @property
    def pose(self) -> PoseTable:
        """Where the body stands in the axes of the frame."""
        return self.stated.pose or PoseTable()


def draft_of(root: Path, template: Config) -> SetupDraft:
    """The draft of a folder: what lies there, and what a former twin.toml states. ValueError where that is
    not right, or is not of a film."""
    path = root / "twin.toml"
    former = parse(path.read_bytes(), name=path.name) if path.is_file() else None
    stated = former or template
    if not stated.cameras:
        raise ValueError(f"{path} has no [[cameras]]: its targets were measured elsewhere")
    table = stated.cameras[0]
    board = table.board or template.cameras[0].board
    assert board is not None
    form = (stated.pressure or PressureTable()).form
    found = recordings(root, dictionary=table.dictionary, board=board, form=form)
    measured = former is not None and found.board == table.board
    sheet = read_sheet(root / SHEET) if (root / SHEET).is_file() else None
    draft = SetupDraft(
        root=root, template=template, stated=stated, is_former=former is not None, found=found, sheet=sheet,
        board_measured=measured,
    )  # fmt: skip
    return with_loose(draft)


def with_loose(draft: SetupDraft) -> SetupDraft:
    """The draft with the places of loose markers, as pictures of rig and board together tell them; of a
    printed sheet none are wanted."""
    found = draft.found
    if draft.has_printed_sheet or not found.rig or found.film is None or found.board is None:
        return draft
    from twin.inputs.looseframe import measured

    try:
        return replace(draft, loose=measured(found.rig, found.board, found.film, found.dictionary))
    except ValueError as error:
        return replace(draft, loose=str(error))


def with_role(draft: SetupDraft, code: int, role: Role) -> SetupDraft:
    """The draft with another role of a tag."""
    return replace(draft, roles={**draft.roles, code: role})


def with_start(draft: SetupDraft, start_s: float | None) -> SetupDraft:
    """The draft with the film's start shifted by eye, s on the log's clock; None: as its motion tells."""
    return replace(draft, start_s=None if start_s is None else round(start_s, 3))


def with_log(draft: SetupDraft, *, column: str | None, unit: str | None, top_kPa: float | None) -> SetupDraft:
    """The draft with the log read by another column, in another unit. ValueError where that cannot be."""
    said: dict[str, Any] = {"column": column, "unit": unit, "top_kPa": top_kPa}
    pressure = (draft.stated.pressure or PressureTable()).model_copy(update=said)
    if not draft.found.tables:
        raise ValueError("no table lies in the folder, so there is no pressure log to read")
    path = draft.root / pressure.file
    path = path if path in draft.found.tables else draft.found.tables[0]
    path = path if draft.found.log is None else draft.found.log.path
    log = read_log(path, time_shift_s=0.0, form=pressure.form)
    found = with_clock(replace(draft.found, log=log, of_log=()))
    stated = draft.stated.model_copy(update={"pressure": pressure})
    return replace(draft, stated=stated, found=found, start_s=None)


def with_board(draft: SetupDraft, *, square_mm: float, marker_mm: float | None) -> SetupDraft:
    """The draft with the measured sides of a square and of a marker of the board. ValueError where they do
    not go together.

    A marker that is not measured anew keeps its share of the square, which the pictures tell.
    """
    board = draft.found.board
    if board is None:
        raise ValueError("no pictures of a board are found, so it has no square to measure")
    if marker_mm == board.marker_mm and marker_mm is not None:
        marker_mm = round(marker_mm * square_mm / board.square_mm, 3)
    sides = {"square_mm": square_mm, "marker_mm": marker_mm}
    own = checked(BoardTable, board.model_dump() | sides, name="[cameras.board]")
    return with_loose(replace(draft, found=replace(draft.found, board=own), board_measured=True))


def with_rulers(draft: SetupDraft, *, across: float, upright: float) -> SetupDraft:
    """The draft with what both rulers of the printed sheet measure, mm."""
    said = FrameTable(sheet=SHEET, finger=draft.stated.frame.finger, y_mm=None)
    former = draft.stated.frame if draft.stated.frame.sheet else said
    keys = former.model_dump(exclude={"markers"}) | {"ruler_mm": (across, upright)}
    return _stating(draft, frame=checked(FrameTable, keys, name="[frame]"))


def with_axes(draft: SetupDraft, axes: Sequence[int]) -> SetupDraft:
    """The draft with two ids of loose markers: the one at x = 0, z = 0, and one that is level with it."""
    if axes[0] == axes[1]:
        raise ValueError(f"axes = {list(axes)}: wanted two markers, at x = 0, z = 0 and level with it")
    return _stating(draft, frame=draft.stated.frame.model_copy(update={"axes": tuple(axes)}))


def with_dimension(draft: SetupDraft, key: str, value: float | str) -> SetupDraft:
    """The draft with another dimension of the body. ValueError where it does not go with the others."""
    if draft.dimensions is None:
        raise ValueError(f"{key}: a deck has its own dimensions")
    return with_dimensions(draft, {key: value})


def with_dimensions(draft: SetupDraft, values: Mapping[str, float | str]) -> SetupDraft:
    """The draft with other dimensions of the body, none of a deck. ValueError where they do not go
    together."""
    model, own = draft.stated.model, draft.dimensions
    if own is None:
        return draft
    table = checked(BODIES[model.kind], {**own.model_dump(), **values}, name=f"[model.{model.kind}]")
    return _stating(draft, model=model.model_copy(update={model.kind: table}))


def with_body(draft: SetupDraft, kind: str) -> SetupDraft:
    """The draft with another kind of body, of usual dimensions."""
    model = draft.stated.model
    keys: dict[str, Any] = {model.kind: None, "body": kind, kind: BODIES[kind]()}
    return _stating(draft, model=model.model_copy(update=keys))


def with_pose(draft: SetupDraft, pose: PoseTable | None) -> SetupDraft:
    """The draft with the body standing elsewhere in the axes of the frame; None: at their origin."""
    return _stating(draft, pose=pose)


def in_frame(pose: PoseTable, places: Array) -> Array:
    """Places (n,2) mm of the body, in the axes of the frame."""
    c, s = math.cos(math.radians(pose.turn_deg)), math.sin(math.radians(pose.turn_deg))
    return np.asarray(places @ np.array([[c, s], [-s, c]]) + (pose.x_mm, pose.z_mm))


def in_body(pose: PoseTable, places: Array) -> Array:
    """Places (n,2) mm of the frame, in the axes of the body."""
    c, s = math.cos(math.radians(pose.turn_deg)), math.sin(math.radians(pose.turn_deg))
    return np.asarray((places - (pose.x_mm, pose.z_mm)) @ np.array([[c, -s], [s, c]]))


def _stating(draft: SetupDraft, **tables: Any) -> SetupDraft:
    return replace(draft, stated=draft.stated.model_copy(update=tables))
