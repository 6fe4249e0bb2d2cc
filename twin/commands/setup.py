"""Write twin.toml from a folder of recordings: films, tags, board, log and clock are found, not typed."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument, Option

from twin import files
from twin.bodies.kinds import BODIES
from twin.commands.init import film_config
from twin.inputs.foundrecordings import Recordings, Tags, first, recordings
from twin.marktables import FrameTable, PointTable
from twin.messages import Say
from twin.project.cameratables import CameraTable
from twin.project.config import Config, usual_objective
from twin.project.folder import named_after
from twin.project.framesheet import markers_of, read_sheet
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
    config, unclear = _config(root, stated, found)
    for line in _said(root, config, found):
        say(line)
    wanted = [*found.open, *unclear, *_dimensions(former)]
    if wanted:
        say("Not decided; correct it in twin.toml:" if yes else "Not decided:")
    for line in wanted:
        say(f"  {line}")
    result = {"stage": "setup", "status": "done", "project": str(folder), "wanted": wanted}
    if not yes:
        say("Nothing is written: add --yes.")
        return result
    if path.is_file():
        kept = _kept(root)
        path.rename(kept)
        say(f"The former twin.toml is kept as {kept.name}.")
    write(path, dump(config))
    say(f"Wrote {folder / 'twin.toml'}. Next: `twin check --project {files.typed(folder)}`.")
    return result


def _kept(root: Path) -> Path:
    number = 1
    while (path := root / f"twin-{number:04d}.toml").exists():
        number += 1
    return path


def _config(root: Path, stated: Config, found: Recordings) -> tuple[Config, list[str]]:
    """The configuration of what is found, and sentences on what it leaves open."""
    table, pressure = stated.cameras[0], stated.pressure
    unclear: list[str] = []

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
        return config, unclear
    frame, points, unclear = _marks(root, config, found.film)
    known = {point.name for point in points}
    calibrate = config.calibrate
    if not known.issuperset(calibrate.objective_points):
        calibrate = calibrate.model_copy(update={"objective_points": usual_objective(points)})
    return config.model_copy(update={"frame": frame, "points": points, "calibrate": calibrate}), unclear


def _marks(root: Path, config: Config, film: Tags) -> tuple[FrameTable, tuple[PointTable, ...], list[str]]:
    """The tables of the rig and of the finger: tags of the sheet, or those that twin.toml places, are the
    rig, the others that move are the finger."""
    frame, unclear = config.frame, []
    if (root / SHEET).is_file():
        of_sheet = {mark.marker for mark in read_sheet(root / SHEET).markers}
        ruler = frame.ruler_mm if frame.sheet else None
        side = _points_to(root, film, of_sheet)
        frame = FrameTable(sheet=SHEET, ruler_mm=ruler, finger=side, y_mm=frame.y_mm if frame.sheet else None)
        if ruler is None:
            unclear.append("ruler_mm under [frame]: measure both rulers of the sheet, across and upright.")
    placed = frame.markers
    if frame.sheet is not None:
        placed = markers_of(read_sheet(root / frame.sheet), config.model_copy(update={"frame": frame}))
    seen = tuple(mark for mark in placed if mark.marker in film.codes)
    if frame.sheet is None:
        frame = frame.model_copy(update={"markers": seen})
    of_rig = {mark.marker for mark in seen}
    loose = [code for k, code in enumerate(film.codes) if not film.moves[k] and code not in of_rig]
    if loose:
        unclear.append(
            f"Tags {', '.join(map(str, loose))} stand still: where they are nobody knows. They are left out; "
            "on the rig they want [[frame.markers]] with position_mm, or a printed sheet."
        )
    own = [k for k, code in enumerate(film.codes) if film.moves[k] and code not in of_rig]
    return frame, _points(config, film, own, seen), unclear


def _points_to(root: Path, film: Tags, rig: set[int]) -> Any:
    """The side to which the finger points on the sheet: from the moving tag that moves least to that which
    moves most."""
    places = {mark.marker: mark.place_mm for mark in read_sheet(root / SHEET).markers}
    own = [k for k, code in enumerate(film.codes) if film.moves[k] and code not in rig]
    if not own:
        return "right"
    right = _places(film, own, places)[:, 0]
    order = np.argsort(film.reach[own])
    return "right" if right[order[-1]] - (right[order[0]] if len(own) > 1 else 0.0) > 0 else "left"


def _places(film: Tags, own: "Sequence[int]", places: dict[int, Any]) -> Array:
    """Places (n,2) mm of tags at rest, in the plane of others whose places are known."""
    from vision.plane import fit_homography, to_plane

    rest = first(film.centre)
    rig = [k for k, code in enumerate(film.codes) if code in places]
    to_px = fit_homography(np.array([places[film.codes[k]] for k in rig]), rest[rig])
    return to_plane(to_px[None], rest[None, list(own)])[0]


def _points(config: Config, film: Tags, own: "Sequence[int]", rig: Any) -> tuple[PointTable, ...]:
    """The finger's tags, named along it; those that twin.toml had keep what it says of them."""
    stated = config.points if config.points != film_config("batch").points else ()  # the template's
    former = {point.marker: point for point in stated if point.marker is not None}
    if not own or len(rig) < 4:
        return config.points
    place = _places(film, own, {mark.marker: np.array(mark.position_mm)[[0, 2]] for mark in rig})
    x, y = place[:, 0], rig[0].position_mm[1]
    tip = int(np.argmax(x))
    middle = int(np.argmin(np.abs(x - 0.5 * x[tip])))
    size = _sizes(film, own, rig)
    points = []
    for rank, k in enumerate(np.argsort(x)):
        name = "tip" if k == tip else "middle" if k == middle else f"p{rank + 1}"
        code, at = film.codes[own[k]], (round(float(x[k]), 2), y, round(float(place[k, 1]), 2))
        new = PointTable(name=name, marker=code, size_mm=round(float(size[k]), 2), position_mm=at)
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
    if config.frame.sheet is not None:
        lines.append(f"Frame: the sheet {config.frame.sheet}, finger to the {config.frame.finger}.")
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
