"""Make a project folder: for a film or for targets measured elsewhere, of the built-in finger or a deck."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fe.mesh.finger import NAMED_NODES
from twin.inputs.foreign import Foreign, import_targets, source_of
from twin.project import files
from twin.project.config import (
    BoardTable,
    CalibrateTable,
    CameraTable,
    Config,
    FrameTable,
    MarkerTable,
    PointTable,
    PressureTable,
    ProjectTable,
)
from twin.project.folder import Say
from twin.project.targetfiles import read_targets
from twin.project.targetwriting import write_targets
from twin.project.toml import dump, write
from twin.targets import PointKind, Targets

if TYPE_CHECKING:
    from fe.deck.reader import Deck


def run_init(
    folder: Path, say: Say, *, targets: Path | None, nodes: Sequence[str], deck: Path | None = None,
    density_kg_m3: float | None = None, foreign: Foreign | None = None,
) -> dict[str, Any]:
    """Make a folder with a complete twin.toml; `targets` (a folder) and `deck` are checked and copied.

    nodes: NAME=LABEL or NAME=X,Y,Z (mm) of the points; all of them where a deck takes the place of the
    built-in finger.
    density_kg_m3: of a silicone that was weighed.   foreign: `targets` is a file of another program.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(
            f"{folder} is there already and is never overwritten; name a folder that does not exist"
        )
    told = {point.name: point for point in map(_point, nodes)}
    labels = {name: point.node for name, point in told.items() if point.node is not None}
    known = {} if deck is not None else {n: PointTable(name=n, node=k) for n, k in NAMED_NODES.items()}
    own = None if deck is None else _own_mesh(deck, told, ask=targets is None)
    files_of = () if own is None else own.files
    given, name = _given(targets, labels, foreign, say), folder.resolve().name
    config = (
        film_config(name, known | told) if given is None else targets_config(name, given, known | told)
    )
    _check_points(config, own, say)
    known_of_it = {"deck": f"raw/{deck.name}" if deck else None, "density_kg_m3": density_kg_m3}
    model = config.model.model_copy(update={k: v for k, v in known_of_it.items() if v is not None})
    config = config.model_copy(update={"model": model})
    root = folder.resolve()
    with files.whole_folder(root) as draft:
        write(draft / "twin.toml", dump(config))
        if targets is None or given is None:
            (draft / "raw" / "boards").mkdir(parents=True)
        elif foreign is not None:
            write_targets(draft / "targets", given, source=source_of(targets, foreign))
        else:
            _copy_targets(targets, draft / "targets")
        for file in files_of:
            place = draft / "raw" / file.relative_to(files_of[0].parent)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, place)
    say(f"Wrote {folder / 'twin.toml'}. Next: `twin check --project {folder}` says what is still missing.")
    return {"stage": "init", "status": "done", "project": str(folder)}


def _check_points(config: Config, deck: "Deck | None", say: Say) -> None:
    """Say where points of a deck lie that are stated in mm; ValueError where a point is at a node that is not
    there or not on the surface, or far from the deck's. The built-in finger's dimensions may still change."""
    from twin.bench.positions import check_points, placed
    from twin.model.structure import Structure, base_case, skin

    nodes = {point.node for point in config.points} - {None}
    if deck is not None:
        structure = Structure(deck.case, "", {}, skin(deck.case))
        for place in placed(config.points, structure, mirrored=len(config.cameras) == 1).values():
            say(place.sentence)
    elif nodes - set(NAMED_NODES.values()):  # those are there: no mesh need be made for them
        case = base_case()
        structure = Structure(case, "", {}, case.face_nodes("outside"))
    else:
        return
    check_points([point for point in config.points if point.node is not None], structure)


def _given(
    targets: Path | None, nodes: Mapping[str, int], foreign: Foreign | None, say: Say
) -> Targets | None:
    """The targets in a folder, or those of another program's file. ValueError where they are not right."""
    if targets is None:
        if foreign is not None:
            raise ValueError("--format without --targets: name the file that the other program wrote")
        return None
    if foreign is not None:
        return import_targets(targets, foreign, nodes=nodes, say=say)
    if targets.is_file():
        raise ValueError(
            f"--targets {targets} is a file: wanted a folder with targets.csv, or --format with the name of "
            "the program that wrote it"
        )
    return read_targets(targets, nodes=nodes)


def targets_config(name: str, targets: Targets, stated: Mapping[str, PointTable]) -> Config:
    """A configuration for targets measured elsewhere; ValueError names points without a place."""
    finger = [p for p in targets.points if p.kind in (PointKind.NODE, PointKind.UNKNOWN)]
    known = {
        p.name: stated.get(p.name) if p.node is None else _named(p.name, p.node) for p in finger
    }
    missing = [name for name, point in known.items() if point is None]
    if missing:
        raise ValueError(f"the place of point {', '.join(missing)} is not known: state it, as in --node "
                         f"{missing[0]}=110,11.5,0 (x, y, z in mm) or --node {missing[0]}=4401 (the label of "
                         "a node), or in targets.toml under [[points]]")  # fmt: skip
    points = tuple(point for point in known.values() if point is not None)
    if not points:
        raise ValueError("targets: all points are fixed markers; wanted at least one on the finger")
    objective = _objective(tuple(p.name for p in points))
    return Config(
        project=ProjectTable(name=name), points=points, calibrate=CalibrateTable(objective_points=objective)
    )


def _named(name: str, node: int) -> PointTable:
    try:
        return PointTable(name=name, node=node)
    except ValueError:
        raise ValueError(
            f"targets: point {name!r}: wanted a name of letters, digits and _ . + - alone; rename it in "
            "targets.csv and targets.toml"
        ) from None


def _objective(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(n for n in NAMED_NODES if n in names) or names


def _own_mesh(deck: Path, told: Mapping[str, PointTable], *, ask: bool) -> "Deck":
    """A deck as it was read; ValueError where it is not right.   ask: whether points have to be named, as no
    targets name them."""
    from twin.model.structure import sound_deck

    if not deck.is_file():
        raise ValueError(f"--deck {deck}: no such file; wanted an Abaqus input deck")
    if ask and not told:
        raise ValueError(
            "--deck without --node: name your points, as in --node tip=4401, or --node tip=110,11.5,0 in mm"
        )
    return sound_deck(deck)


def film_config(name: str, stated: Mapping[str, PointTable] | None = None) -> Config:
    """A configuration for one film, to be filled in: the values of a typical rig stand in it.

    stated: the points by name; by default tip and middle of the built-in finger.
    """
    known = stated or {point: PointTable(name=point, node=node) for point, node in NAMED_NODES.items()}
    rig = [(x, z) for z in (12.0, -75.0) for x in (-20.0, 15.0, 50.0, 85.0, 120.0)]
    markers = tuple(
        MarkerTable(marker=20 + i, name=f"R{i + 1:02d}", role="fixed" if i % 5 in (1, 3) else "frame",
                    position_mm=(x, 12.0, z), size_mm=8.0)
        for i, (x, z) in enumerate(rig)
    )  # fmt: skip
    camera = CameraTable(
        name="side", film="raw/film.mp4", static="raw/static.mp4", boards="raw/boards/*.png",
        board=BoardTable(columns=9, rows=6, square_mm=15.0, marker_mm=11.0),
    )  # fmt: skip
    points = tuple(
        point.model_copy(update={"marker": number, "size_mm": 6.0})
        for number, point in enumerate(known.values())
    )
    return Config(project=ProjectTable(name=name), cameras=(camera,), pressure=PressureTable(),
                  frame=FrameTable(markers=markers), points=points,
                  calibrate=CalibrateTable(objective_points=_objective(tuple(known))))  # fmt: skip


def _point(text: str) -> PointTable:
    """The point that NAME=LABEL or NAME=X,Y,Z states."""
    name, _, place = text.partition("=")
    try:
        if name and place.isdigit():
            return PointTable(name=name, node=int(place))
        x, y, z = (float(part) for part in place.split(","))
        return PointTable(name=name, position_mm=(x, y, z))
    except ValueError:
        raise ValueError(
            f"--node {text!r}: wanted NAME=LABEL, such as tip=4401, or NAME=X,Y,Z in mm, such as "
            "tip=110,11.5,0"
        ) from None


def _copy_targets(source: Path, target: Path) -> None:
    target.mkdir()
    for name in ("targets.csv", "targets.toml", "targets.npz", "pressure.csv"):
        if (source / name).is_file():
            shutil.copy2(source / name, target / name)
