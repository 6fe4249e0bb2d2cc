"""The twin.toml that a draft proposes: what is found, in words, what nobody has decided, and its writing."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from twin import files
from twin.inputs.foundrecordings import Tags
from twin.messages import Say
from twin.project.config import Config, usual_objective
from twin.project.folder import Project
from twin.project.framesheet import on_sheet
from twin.project.toml import dump, parse
from twin.setup.draft import BY_EYE_S, SHEET, Role, SetupDraft
from twin.setup.rigframe import RigFrame, rig_frame
from twin.setup.tagroles import choices_of, on_finger, points_on_finger, roles_of
from twin.validation import decoded

DIMENSIONS = (
    "[model.finger]: length, width, height, walls and pleats of your finger, mm, or another body; "
    "`twin look` draws what stands there."
)
SQUARE = "square_mm and marker_mm under [cameras.board]: measure the side of a square, mm."
NOWHERE = (
    "nothing tells where the rig is, so twin.toml is not written: wanted a printed sheet beside the "
    "finger (`twin print --frame a4`), 8 to 20 pictures of the rig's markers and the board together, "
    "or [[frame.markers]] with position_mm"
)


@dataclass(frozen=True)
class Proposal:
    """A configuration, and how it was made."""

    draft: SetupDraft
    config: Config
    frame: RigFrame | None  # None without a film
    roles: dict[int, Role]  # of all tags of the film, by id
    unclear: tuple[str, ...]
    names: Mapping[int, str] = field(default_factory=dict)  # of the finger's tags, by id

    @property
    def text(self) -> str:
        """The twin.toml, every key explained. ValueError where it, or the markers of its sheet, are not
        right."""
        text = dump(self.config)
        self._placed(parse(text.encode(), name="twin.toml"))
        return text

    def _placed(self, config: Config) -> Config:
        """A configuration with the markers of the sheet in their places."""
        sheet = None if self.frame is None else self.frame.sheet
        return config if sheet is None else on_sheet(config, sheet)

    @property
    def texts(self) -> dict[Path, str]:
        """The files that are to be written, the frame before twin.toml. ValueError where they are not
        right."""
        frame, root, own = self.frame, self.draft.root, {}
        if frame is not None and frame.sheet is not None and frame.is_new:
            own[root / SHEET] = frame.sheet.text()
        return own | {root / "twin.toml": self.text}

    @property
    def is_written(self) -> bool:
        """Whether the files have all of this."""
        try:
            return all(has_text(path, text) for path, text in self.texts.items())
        except ValueError:
            return False

    @property
    def project(self) -> Project:
        """The project as it would be, the markers of its sheet in their places. ValueError where that cannot
        be."""
        config = parse(self.text.encode(), name="twin.toml")
        return Project(self.draft.root, self._placed(config))

    def choices(self, code: int) -> tuple[Role, ...]:
        """The roles that a tag can have."""
        return choices_of(self.draft, code, set(self.frame.placed) if self.frame else set())

    @property
    def wanted(self) -> list[str]:
        """Sentences on what no recording tells and nobody has stated."""
        draft, found = self.draft, self.draft.found
        clock = found.of_clock if draft.start_s is None else ()
        lines = [*found.missing, *found.of_log, *clock, *self.unclear]
        lines += [] if is_body_stated(draft) else [DIMENSIONS]
        return lines + ([SQUARE] if found.board is not None and not draft.board_measured else [])


def proposed(draft: SetupDraft) -> Proposal:
    """The configuration of what is found and said."""
    config, film = _recorded(draft), draft.found.film
    if film is None:
        return Proposal(draft, config, None, {}, ())
    frame = rig_frame(draft, film)
    config = config.model_copy(update={"frame": frame.table})
    roles = roles_of(draft, film, frame.rig)
    own = points_on_finger(draft, film, on_finger(film, roles), frame.markers(config, film))
    points = tuple(own.values()) or draft.stated.points
    calibrate = config.calibrate
    if not {point.name for point in points}.issuperset(calibrate.objective_points):
        calibrate = calibrate.model_copy(update={"objective_points": usual_objective(points)})
    config = config.model_copy(update={"points": points, "calibrate": calibrate})
    names = {code: point.name for code, point in own.items()}
    return Proposal(draft, config, frame, roles, (*frame.unclear, *_nobodys(draft, film, roles)), names)


def _recorded(draft: SetupDraft) -> Config:
    """The configuration with the recordings' files, board, log and clock."""
    found, stated = draft.found, draft.stated
    table, pressure = stated.cameras[0], stated.pressure
    shown = {k: t.path.relative_to(draft.root).as_posix()
             for k, t in (("film", found.film), ("static", found.static)) if t}  # fmt: skip
    keys: dict[str, Any] = {"dictionary": found.dictionary, "board": found.board or table.board, **shown}
    keys |= {"boards": found.boards, "camera_file": None} if found.boards else {}
    keys |= {} if draft.start is None else {"film_start_s": round(draft.start, 3), "static_start_s": None}
    if pressure is not None and found.log is not None:
        clock: dict[str, Any] = {} if draft.start is None else {"join": "onset"}
        clock |= {} if draft.start_s is None else {"join": "stamps", "sync_sd_s": BY_EYE_S}
        log = found.log.path.relative_to(draft.root).as_posix()
        pressure = pressure.model_copy(update={"file": log, **clock})
    return stated.model_copy(update={"cameras": (table.model_copy(update=keys),), "pressure": pressure})


def _nobodys(draft: SetupDraft, film: Tags, roles: dict[int, Role]) -> list[str]:
    """A sentence on tags that stand still and have no place, unless the user has left them out."""
    loose = [c for c in film.codes if c >= 0 and roles[c] == "ignore" and c not in draft.roles]
    return [] if not loose else [
        f"Tags {', '.join(map(str, loose))} stand still: where they are nobody knows. They are left out; on "
        "the rig they want a printed sheet, pictures of the board among them, or [[frame.markers]]."
    ]  # fmt: skip


def is_body_stated(draft: SetupDraft) -> bool:
    """Whether somebody has stated the body's dimensions."""
    model = draft.stated.model
    return model.kind == "deck" or getattr(model, model.kind) is not None


def said_of(proposal: Proposal) -> list[str]:
    """What is found, one sentence each."""
    found, config = proposal.draft.found, proposal.config
    table, lines = config.cameras[0], []
    if (film := found.film) is not None:
        lines.append(f"Test film: {table.film}, {int((~film.moves).sum())} tags stand still and "
                     f"{int(film.moves.sum())} move, by up to {np.nanmax(film.reach):.0f} px.")  # fmt: skip
    if found.static is not None:
        lines.append(f"Static film: {table.static}, {found.static.frames} frames.")
    if found.boards and (board := found.board) is not None:
        lines.append(f"Board: {found.boards}, {board.kind} of {board.columns} x {board.rows}.")
    if found.log is not None:
        lines.append(f"Log: {found.log.path.name}, {found.log.source}.")
    if found.start_s is not None:
        lines.append(f"Clock: the film starts at about {found.start_s:.1f} s of the log; `twin measure` "
                     "fits that to all its motion.")  # fmt: skip
    if (frame := config.frame).sheet is not None:
        what = f"loose markers, from {frame.pictures}" if frame.pictures else f"the sheet {frame.sheet}"
        lines.append(f"Frame: {what}, finger to the {frame.finger}.")
    if found.film is not None:
        ids = ("dot" if point.marker is None else f"id {point.marker}" for point in config.points)
        names = ", ".join(f"{p.name} ({which})" for p, which in zip(config.points, ids, strict=True))
        lines.append(f"Points on the finger: {names}.")
    return lines


def write_proposal(proposal: Proposal, say: Say) -> None:
    """Write twin.toml, and raw/frame.toml where the frame is new; former ones are kept under other names.
    ValueError, and nothing is written, where twin.toml would not be right."""
    from vision.plane import MIN_VISIBLE

    frame = proposal.frame
    if frame is not None and frame.sheet is None and len(frame.table.markers) < MIN_VISIBLE:
        raise ValueError(NOWHERE)
    for path, text in proposal.texts.items():
        if not has_text(path, text):
            kept_aside(path, say)
            files.write_text(path, text)


def has_text(path: Path, text: str) -> bool:
    """Whether a file is there and has this text."""
    return path.is_file() and decoded(path.read_bytes()) == text


def kept_aside(path: Path, say: Say) -> None:
    """Give a file that is there another name, such as twin-0001.toml; make its folder where it is not."""
    path.parent.mkdir(exist_ok=True)
    number = 1
    while (kept := path.with_name(f"{path.stem}-{number:04d}{path.suffix}")).exists():
        number += 1
    if path.is_file():
        path.rename(kept)
        say(f"The former {path.name} is kept as {kept.name}.")
