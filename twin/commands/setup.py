"""Write twin.toml from a folder of recordings: films, tags, board, log and clock are found, not typed."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument, Option

from twin import files
from twin.bodies.kinds import BODIES
from twin.commands.init import film_config
from twin.inputs.foundrecordings import Recordings, Tags, first, pattern_of, recordings
from twin.marktables import FrameTable, MarkerTable, PointTable
from twin.messages import Say
from twin.project.cameratables import CameraTable
from twin.project.config import Config, usual_objective
from twin.project.folder import named_after
from twin.project.framesheet import SheetTable, markers_of, read_sheet
from twin.project.toml import dump, parse, write
from twin.targets import Array

if TYPE_CHECKING:
    from collections.abc import Sequence

SHEET = "raw/frame.toml"


def run_setup(
    folder: Annotated[Path, Argument(help="folder with film, board pictures and log")],
    say: Say,
    *,
    yes: Annotated[bool, Option("--yes", help="write twin.toml; else only say what is found")] = False,
) -> dict[str, Any]:
    """twin.toml with what a folder of recordings shows; what it cannot decide is said. A former one keeps
    its [model] and all that no recording tells, and is kept as twin-0001.toml."""
    from vision.plane import MIN_VISIBLE

    root = folder.resolve()
    if not root.is_dir():
        raise ValueError(f"{folder}: no such folder; wanted the one with the recordings")
    path = root / "twin.toml"
    former = parse(path.read_bytes(), name=path.name) if path.is_file() else None
    stated = former or film_config(named_after(root))
    if not stated.cameras:
        raise ValueError(f"{path} has no [[cameras]]: its targets were measured elsewhere")
    table = stated.cameras[0]
    assert table.board is not None or former is not None
    board = table.board or film_config("batch").cameras[0].board
    assert board is not None
    found = recordings(root, dictionary=table.dictionary, board=board)
    config, sheet, unclear = _config(root, stated, found)
    for line in _said(root, config, found):
        say(line)
    wanted = [*found.open, *unclear, *_dimensions(former)]
    if found.board is not None and (former is None or found.board != former.cameras[0].board):
        wanted.append("square_mm and marker_mm under [cameras.board]: measure the side of a square, mm.")
    if wanted:
        say("Not decided; correct it in twin.toml:" if yes else "Not decided:")
    for line in wanted:
        say(f"  {line}")
    result = {"stage": "setup", "status": "done", "project": str(folder), "wanted": wanted}
    if not yes:
        say("Nothing is written: add --yes.")
        return result
    if found.film is not None and config.frame.sheet is None and len(config.frame.markers) < MIN_VISIBLE:
        raise ValueError(
            "nothing tells where the rig is, so twin.toml is not written: wanted a printed sheet beside the "
            "finger (`twin print --frame a4`), 8 to 20 pictures of the rig's markers and the board together, "
            "or [[frame.markers]] with position_mm"
        )
    text = dump(config)
    parse(text.encode(), name=path.name)  # before anything is written
    if sheet is not None:
        _keep(root / SHEET, say)
        files.write_text(root / SHEET, sheet.text())
    _keep(path, say)
    write(path, text)
    say(f"Wrote {folder / 'twin.toml'}. Next: `twin check --project {files.typed(folder)}`.")
    return result


def _keep(path: Path, say: Say) -> None:
    """Give a file that is there another name, such as twin-0001.toml; make its folder where it is not."""
    path.parent.mkdir(exist_ok=True)
    number = 1
    while (kept := path.with_name(f"{path.stem}-{number:04d}{path.suffix}")).exists():
        number += 1
    if path.is_file():
        path.rename(kept)
        say(f"The former {path.name} is kept as {kept.name}.")


def _config(root: Path, stated: Config, found: Recordings) -> tuple[Config, SheetTable | None, list[str]]:
    """The configuration of what is found, a frame that is measured anew, and sentences on what is open."""
    table, pressure = stated.cameras[0], stated.pressure

    def shown(path: Path) -> str:
        return path.relative_to(root).as_posix()

    keys: dict[str, Any] = {"dictionary": found.dictionary, "board": found.board or table.board}
    keys |= {k: shown(t.path) for k, t in (("film", found.film), ("static", found.static)) if t}
    keys |= {"boards": found.boards, "camera_file": None} if found.boards else {}
    keys |= {} if found.start_s is None else {"film_start_s": round(found.start_s, 3), "static_start_s": None}
    if pressure is not None and found.log is not None:
        join = {} if found.start_s is None else {"join": "onset"}
        pressure = pressure.model_copy(update={"file": shown(found.log.path), **join})
    config = stated.model_copy(update={"cameras": (table.model_copy(update=keys),), "pressure": pressure})
    if found.film is None:
        return config, None, []
    frame, sheet, new, unclear = _frame(root, config, found, found.film)
    config = config.model_copy(update={"frame": frame})
    points, more = _marks(config, sheet, found.film)
    calibrate = config.calibrate
    if not {point.name for point in points}.issuperset(calibrate.objective_points):
        calibrate = calibrate.model_copy(update={"objective_points": usual_objective(points)})
    config = config.model_copy(update={"points": points, "calibrate": calibrate})
    return config, sheet if new else None, [*unclear, *more]


def _frame(
    root: Path, config: Config, found: Recordings, film: Tags
) -> tuple[FrameTable, SheetTable | None, bool, list[str]]:
    """[frame], its sheet, whether that is measured anew, and what is open: the printed sheet where there is
    one, else loose markers from pictures of the rig, else what is typed."""
    seen = tuple(mark for mark in _typed(config) if mark.marker in film.codes)
    frame, path = config.frame.model_copy(update={"markers": seen}), root / SHEET
    sheet = read_sheet(path) if path.is_file() else None
    if found.rig and (sheet is None or sheet.ruler_mm is None):
        try:
            sheet, unclear = _loose(config, found, film)
        except ValueError as error:
            return frame, None, False, [f"Pictures of the rig: {error}."]
        new = FrameTable(
            sheet=SHEET, pictures=pattern_of(root, found.rig), axes=frame.axes, finger=_side(film, None),
            y_mm=frame.y_mm if frame.sheet else None,
        )  # fmt: skip
        return new, sheet, True, unclear
    if sheet is None:
        return frame, None, False, []
    ruler = frame.ruler_mm if frame.sheet else None
    unclear = [] if ruler else ["ruler_mm under [frame]: measure both rulers of the sheet, across, upright."]
    stated = frame.y_mm if frame.sheet else None
    side = _side(film, sheet)
    return FrameTable(sheet=SHEET, ruler_mm=ruler, finger=side, y_mm=stated), sheet, False, unclear


def _typed(config: Config) -> tuple[MarkerTable, ...]:
    """The frame markers that somebody typed, none where they are the template's."""
    return config.frame.markers if config.frame.markers != film_config("batch").frame.markers else ()


def _loose(config: Config, found: Recordings, film: Tags) -> tuple[SheetTable, list[str]]:
    """The frame that pictures of the rig tell, and sentences on typed places that are odd, or on its axes."""
    from twin.inputs.looseframe import measured, sheet_in_typed, sheet_of

    assert found.board is not None  # the rig's pictures show it
    seen = measured(found.rig, found.board, film, found.dictionary)
    if typed := _typed(config):
        sheet, odd = sheet_in_typed(
            seen, film, typed, sd_mm=config.measure.frame_sd_mm, along=_along(film, None)
        )
        return sheet, [*seen.remarks, *odd]
    root = min(_movers(film, set(seen.codes)), key=lambda k: float(film.reach[k]), default=0)
    sheet = sheet_of(seen, film, axes=config.frame.axes, near=first(film.centre)[root])
    if config.frame.axes is not None:
        return sheet, list(seen.remarks)
    origin = min(sheet.markers, key=lambda m: abs(m.place_mm[0]) + abs(m.place_mm[1])).marker
    return sheet, [*seen.remarks, (
        "axes under [frame]: ids of the marker at the clamp's front and the finger's bottom, x = 0, z = 0, "
        f"and of one level with it. Now marker {origin} is at x = 0, z = 0, and the film's rows are level."
    )]  # fmt: skip


def _marks(config: Config, sheet: SheetTable | None, film: Tags) -> tuple[tuple[PointTable, ...], list[str]]:
    """The finger's points: tags that move and are not on the rig; and a sentence on what is neither."""
    placed = config.frame.markers if sheet is None else markers_of(sheet, config)
    seen = tuple(mark for mark in placed if mark.marker in film.codes)
    of_rig = {mark.marker for mark in seen if mark.marker is not None}
    loose = [code for k, code in enumerate(film.codes) if not film.moves[k] and code not in of_rig]
    unclear = [] if not loose else [
        f"Tags {', '.join(map(str, loose))} stand still: where they are nobody knows. They are left out; on "
        "the rig they want a printed sheet, pictures of the board among them, or [[frame.markers]]."
    ]  # fmt: skip
    return _points(config, film, _movers(film, of_rig), seen), unclear


def _movers(film: Tags, rig: set[int]) -> list[int]:
    """Rows of the tags that move and are not on the rig."""
    return [k for k, code in enumerate(film.codes) if film.moves[k] and code not in rig]


def _side(film: Tags, sheet: SheetTable | None) -> Any:
    """The side to which the finger points."""
    return "right" if _along(film, sheet) > 0 else "left"


def _along(film: Tags, sheet: SheetTable | None) -> float:
    """1 where the finger points to the right of the sheet, or of the film, else -1: from the moving tag that
    moves least to that which moves most."""
    places = {} if sheet is None else {mark.marker: mark.place_mm for mark in sheet.markers}
    own = _movers(film, set(places))
    if not own:
        return 1.0
    right = (_places(film, own, places) if places else first(film.centre)[own])[:, 0]
    order = np.argsort(film.reach[own])
    middle = 0.0 if places else 0.5 * float(np.nanmax(film.centre[..., 0]))
    return 1.0 if right[order[-1]] > (right[order[0]] if len(own) > 1 else middle) else -1.0


def _places(film: Tags, own: "Sequence[int]", places: dict[int, Any]) -> Array:
    """Places (n,2) mm of tags at rest, in the plane of others whose places are known."""
    from vision.plane import fit_homography, to_plane

    rest = first(film.centre)
    rig = [k for k, code in enumerate(film.codes) if code in places]
    to_px = fit_homography(np.array([places[film.codes[k]] for k in rig]), rest[rig])
    return to_plane(to_px[None], rest[None, list(own)])[0]


def _points(config: Config, film: Tags, own: "Sequence[int]", rig: Any) -> tuple[PointTable, ...]:
    """The finger's tags, named along it; those that twin.toml had keep what it says of them."""
    from vision.plane import MIN_VISIBLE

    stated = config.points if config.points != film_config("batch").points else ()  # the template's
    former = {point.marker: point for point in stated if point.marker is not None}
    if not own:
        return config.points
    if len(rig) < MIN_VISIBLE:  # in px, from the tag that is nearest to the clamp
        right = _along(film, None) * first(film.centre)[own][:, 0]
        x, size = right - right.min(), np.full(len(own), np.nan)
    else:
        x = _places(film, own, {mark.marker: np.array(mark.position_mm)[[0, 2]] for mark in rig})[:, 0]
        size = _sizes(film, own, rig)
    tip = int(np.argmax(x))
    middle = int(np.argmin(np.abs(x - 0.5 * x[tip])))
    points = []
    for rank, k in enumerate(np.argsort(x)):
        name = "tip" if k == tip else "middle" if k == middle else f"p{rank + 1}"
        code = film.codes[own[k]]  # where it sits, `twin measure` measures
        side = round(float(size[k]), 2) if np.isfinite(size[k]) else None
        new = PointTable(name=name, marker=code, size_mm=side)
        points.append(former.get(code) or new)
    return tuple(points)


def _sizes(film: Tags, own: "Sequence[int]", rig: Any) -> Array:
    """Sides (n,) mm of tags, beside those of the rig."""
    def side(rows: "Sequence[int]") -> Array:
        quads = first(film.quads.reshape(*film.quads.shape[:2], 8)).reshape(-1, 4, 2)[list(rows)]
        return np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=2).mean(axis=1)

    sizes = {mark.marker: mark.size_mm for mark in rig}
    rows = [k for k, code in enumerate(film.codes) if code in sizes]
    return side(own) * np.median(np.array([sizes[film.codes[k]] for k in rows]) / side(rows))


def _said(root: Path, config: Config, found: Recordings) -> list[str]:
    """What is found, one sentence each."""
    table: CameraTable = config.cameras[0]
    lines = []
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
        names = ", ".join(f"{point.name} (id {point.marker})" for point in config.points)
        lines.append(f"Points on the finger: {names}.")
    return lines


def _dimensions(former: Config | None) -> list[str]:
    """A sentence where nobody has stated the body's dimensions."""
    model = None if former is None else former.model
    if model is not None and (model.kind == "deck" or model.dimensions != BODIES[model.kind]()):
        return []
    return ["[model.finger]: length, width, height, walls and pleats of your finger, mm, or another body; "
            "`twin look` draws what stands there."]  # fmt: skip
