"""Make a project, check it and list its runs."""

import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from twin.project import files
from twin.project.config import (
    BoardTable,
    CalibrateTable,
    CameraTable,
    Config,
    FrameTable,
    MarkerTable,
    ModelTable,
    PointTable,
    PressureTable,
    ProjectTable,
)
from twin.project.folder import Project, Say, kind_of
from twin.project.targetfiles import read_targets
from twin.project.toml import dump
from twin.targets import PointKind, Targets

STUDY_NODES = {"tip": 4401, "middle": 5848}  # the built-in finger's, used where nobody states another
NEXT = ("calibrate", "compare", "diagnose", "review")


def run_init(
    folder: Path, say: Say, *, targets: Path | None, nodes: Sequence[str], deck: Path | None = None
) -> dict[str, Any]:
    """Make a folder with a complete twin.toml; `targets` (a folder) and `deck` are checked and copied.

    nodes: NAME=LABEL of the points; all of them where a deck takes the place of the built-in finger.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(
            f"{folder} is there already and is never overwritten; name a folder that does not exist"
        )
    labels = dict(_node(text) for text in nodes)
    known = STUDY_NODES if deck is None else {}
    own, files_of = (None, ()) if deck is None else _own_mesh(deck, labels, ask=targets is None)
    config = film_config(folder.resolve().name, known | labels) if targets is None else targets_config(
        folder.resolve().name, read_targets(targets, nodes=labels), known | labels)  # fmt: skip
    if own is not None:
        config = config.model_copy(update={"model": config.model.model_copy(update={"deck": own})})
    root = folder.resolve()
    draft = root.with_name(f".{root.name}.partial")
    shutil.rmtree(draft, ignore_errors=True)
    files.write_text(draft / "twin.toml", dump(config))
    if targets is None:
        (draft / "raw" / "boards").mkdir(parents=True)
    else:
        _copy_targets(targets, draft / "targets")
    for file in files_of:
        place = draft / "raw" / file.relative_to(files_of[0].parent)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(file, place)
    if root.is_dir():
        root.rmdir()
    os.rename(draft, root)
    say(f"init: wrote {folder / 'twin.toml'}; next: `twin check --project {folder}` says what it still needs")
    return {"stage": "init", "status": "done", "project": str(folder)}


def targets_config(name: str, targets: Targets, nodes: Mapping[str, int]) -> Config:
    """Return a configuration for targets measured elsewhere; ValueError names points without a node."""
    finger = [p for p in targets.points if p.kind in (PointKind.NODE, PointKind.UNKNOWN)]
    known = {p.name: nodes.get(p.name) if p.node is None else p.node for p in finger}
    missing = [name for name, node in known.items() if node is None]
    if missing:
        raise ValueError(f"the node of point {', '.join(missing)} is not known: state it, as in --node "
                         f"{missing[0]}=4401, or in targets.toml under [[points]]")  # fmt: skip
    points = tuple(PointTable(name=n, node=node) for n, node in known.items() if node is not None)
    if not points:
        raise ValueError("targets: all points are fixed markers; wanted at least one on the finger")
    objective = _objective(tuple(p.name for p in points))
    return Config(
        project=ProjectTable(name=name), points=points, calibrate=CalibrateTable(objective_points=objective),
        model=ModelTable(top_pressure_MPa=float(targets.pressure.max())),
    )  # fmt: skip


def _objective(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(n for n in STUDY_NODES if n in names) or names


def _own_mesh(deck: Path, nodes: Mapping[str, int], *, ask: bool) -> tuple[str, tuple[Path, ...]]:
    """Return where a deck goes in the project, and its files; ValueError where it is not right.

    ask: whether nodes have to be named, as no targets name them.
    """
    from fe.deck.reader import read_deck

    if not deck.is_file():
        raise ValueError(f"--deck {deck}: no such file; wanted an Abaqus input deck")
    if ask and not nodes:
        raise ValueError("--deck without --node: name the nodes of your points, as in --node tip=4401")
    found = read_deck(deck)
    for label in nodes.values():
        found.case.position(label)  # names what is wrong with an unknown node
    for file in found.files:
        if not file.resolve().is_relative_to(deck.resolve().parent):
            raise ValueError(f"{deck.name} includes {file}: wanted it in the deck's folder or below")
    return f"raw/{deck.name}", found.files


def film_config(name: str, nodes: Mapping[str, int] = STUDY_NODES) -> Config:
    """Return a configuration for one film, to be filled in: the values of a typical rig stand in it."""
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
        PointTable(name=point, node=node, marker=number, size_mm=6.0)
        for number, (point, node) in enumerate(nodes.items())
    )
    return Config(project=ProjectTable(name=name), cameras=(camera,), pressure=PressureTable(),
                  frame=FrameTable(markers=markers), points=points,
                  calibrate=CalibrateTable(objective_points=_objective(tuple(nodes))))  # fmt: skip


def run_list(project: Project, *, stderr: bool) -> dict[str, Any]:
    """Print the runs as a table on stdout or stderr, and return them."""
    from rich.console import Console
    from rich.table import Table

    table = Table("run", "status", "started", "took", "result")
    rows = [{"run": run.name} | _row(project.info(run)) for run in project.runs()]
    for row in rows:
        took = "" if row["seconds"] is None else f"{row['seconds']:.1f} s"
        table.add_row(row["run"], row["status"], row["started"], took, row["headline"])
    Console(stderr=stderr).print(table if rows else "no runs yet")
    return {"stage": "list", "runs": rows}


def _row(info: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "status": info["status"], "started": (info.get("started") or [""])[-1][:19],
        "seconds": info.get("seconds"),
        "headline": info.get("summary", {}).get("headline", ""),
    }  # fmt: skip


def run_check(project: Project, say: Say) -> dict[str, Any]:
    """Say what is missing and what comes next; ValueError at the first thing that is wrong."""
    say(f"check: twin.toml is right: {len(project.config.points)} points, effects "
        f"{', '.join(project.config.model.effects) or 'none'}")  # fmt: skip
    missing = _missing_files(project)
    if missing:
        raise ValueError(f"missing in {project.root}: {'; '.join(missing)}")
    step = _next(project)
    for line in _check_deck(project):
        say(f"check: {line}")
    if project.targets_folder.is_dir():
        targets = project.targets()
        _check_points(project, targets)
        say(f"check: targets: {len(targets.time)} steps, {len(targets.names)} points, "
            f"{int(targets.valid.sum())} valid components, noise model "
            f"{'yes' if targets.noise else 'none: diagnose cannot test'}")  # fmt: skip
    say(f"check: next: `twin {step}`")
    return {"stage": "check", "status": "done", "next": step}


def _check_deck(project: Project) -> tuple[str, ...]:
    """Return what is to be known of the project's own mesh; ValueError where it is not right."""
    if project.config.model.deck is None:
        return ()
    from twin.stages.workbench import structure_of

    structure = structure_of(project)
    for point in project.config.points:
        structure.case.position(point.node)
    return structure.remarks


def _missing_files(project: Project) -> list[str]:
    """Return what twin.toml names and is not there; a film is not asked for once its targets are there."""
    deck = project.config.model.deck
    if deck is not None and not project.path(deck).is_file():
        return [f"{deck} (model.deck)"]
    if project.targets_folder.is_dir():
        return []
    if not project.config.cameras or project.config.pressure is None:
        return ["targets/targets.csv (there is no [[cameras]] to measure them with)"]
    missing = []
    for camera in project.config.cameras:
        named = {"cameras.film": camera.film, "cameras.static": camera.static}
        missing += [f"{path} ({key})" for key, path in named.items() if not any(project.root.glob(path))]
        calibration = camera.camera_file or camera.boards or ""
        key = "camera_file" if camera.camera_file else "boards"
        missing += [] if any(project.root.glob(calibration)) else [f"{calibration} (cameras.{key})"]
    log = project.config.pressure.file
    return missing if project.path(log).is_file() else [*missing, f"{log} (pressure.file)"]


def _check_points(project: Project, targets: Targets) -> None:
    """Raise ValueError where twin.toml and the targets do not name the same points."""
    unknown = [p.name for p in targets.points if p.kind is PointKind.UNKNOWN]
    if unknown:
        raise ValueError(f"targets point {unknown[0]!r} has no node: add it to [[points]] in twin.toml")
    for name in project.config.calibrate.objective_points:
        if name not in targets.names:
            raise ValueError(
                f"calibrate.objective_points = {name!r}: targets have {', '.join(targets.names)}"
            )


def _next(project: Project) -> str:
    """Return the first stage without a done run."""
    done = {kind_of(run) for run in project.runs() if project.info(run)["status"] == "done"}
    stages: Iterable[str] = NEXT if project.targets_folder.is_dir() else ("camera", "measure", *NEXT)
    return next((stage for stage in stages if stage not in done), "list")


def _node(text: str) -> tuple[str, int]:
    name, _, label = text.partition("=")
    if not name or not label.isdigit():
        raise ValueError(f"--node {text!r}: wanted NAME=LABEL, such as tip=4401")
    return name, int(label)


def _copy_targets(source: Path, target: Path) -> None:
    target.mkdir()
    for name in ("targets.csv", "targets.toml", "targets.npz", "pressure.csv"):
        if (source / name).is_file():
            shutil.copy2(source / name, target / name)
