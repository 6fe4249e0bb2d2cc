"""Make a project folder: for a film or for targets measured elsewhere, of a body of the program or a deck."""

import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument, Option

from fe.mesh.finger import NAMED_NODES
from twin import files
from twin.bodies.kinds import BODIES, BodyTable
from twin.formats.catalogue import format_of, read_recorded
from twin.formats.meshgroups import MESHES, deck_of
from twin.formats.recorded import PIXEL, Recorded, plain
from twin.gauge.pressuretable import PressureTable
from twin.marktables import FrameTable, MarkerTable, PointTable
from twin.messages import Say
from twin.project.cameratables import BoardTable, CameraTable, RecordingTable
from twin.project.config import CalibrateTable, Config, ProjectTable, usual_objective
from twin.project.folder import Project, named_after
from twin.project.targetfiles import read_targets
from twin.project.toml import dump, write
from twin.tablemodel import NAMED
from twin.targets import PointKind, TargetPoint, Targets
from twin.validation import checked

if TYPE_CHECKING:
    from fe.deck.reader import Deck

TIP = (110.0, 11.5, 0.0)  # mm, of the finger whose dimensions are not stated


def run_init(
    folder: Annotated[Path, Argument(help="project folder to make")],
    say: Say,
    *,
    targets: Annotated[Path | None, Option(help="displacements measured elsewhere: file or folder")] = None,
    form: Annotated[str | None, Option("--format", help="format of that file: see docs/files.md")] = None,
    nodes: Annotated[Sequence[str], Option(
        "--node", help="point, NAME=node label or NAME=X,Y,Z in mm; repeated")] = (),
    finger: Annotated[Sequence[str], Option(help="a dimension, such as length_mm=80; once for each")] = (),
    body: Annotated[str, Option(help="kind, such as pneunet:chambers=4")] = "finger",
    sd_mm: Annotated[float | None, Option(help="sd of one position in another program's file, mm")] = None,
    still: Annotated[str, Option(help="instead: its rows at rest, 0-60,200-260, or holds")] = "",
    deck: Annotated[Path | None, Option(help="your own mesh: Abaqus (mm, N, MPa), Gmsh or VTK")] = None,
    pressure_set: Annotated[str, Option(help="of such a mesh: the group of faces under pressure")] = "",
    clamp_set: Annotated[str, Option(help="of such a mesh: the group of faces that is held")] = "",
    axes: Annotated[str, Option(help="of meshes and recordings: x, y, z, such as -x,z,y")] = "",
    unit: Annotated[str, Option(help="of such a mesh: its unit of length; else mm")] = "",
    like: Annotated[Path | None, Option(help="a batch on the same rig, or of the same silicone")] = None,
    pressure_from: Annotated[str, Option(help="name: --targets is a folder, a file a pressure")] = "",
    hold_out: Annotated[Sequence[str], Option(help="of these: part of a name that no fit may see")] = (),
    density_kg_m3: float | None = None,
) -> dict[str, Any]:
    """A folder with a complete twin.toml; targets and deck are checked and copied.

    Another program's file becomes targets by `twin measure`. density_kg_m3: of a silicone that was weighed.
    """
    if pressure_from:
        return _init_of_takes(
            folder, say, targets, pressure_from, nodes=nodes, hold_out=hold_out, axes=axes, sd_mm=sd_mm,
            deck=deck, body=body, finger=finger, density_kg_m3=density_kg_m3, unit=unit,
        )  # fmt: skip
    of_mesh = {"pressure_set": pressure_set, "clamp_set": clamp_set, "axes": axes, "unit": unit}
    if deck is not None and deck.suffix.lower() in MESHES:
        return _init_of_mesh(
            folder, say, deck, of_mesh, targets=targets, form=form, nodes=nodes, like=like,
            density_kg_m3=density_kg_m3, finger=finger, sd_mm=sd_mm, still=still,
        )  # fmt: skip
    of_recording = ("axes", "unit") if targets is not None else ()
    if wrong := {name: value for name, value in of_mesh.items() if value and name not in of_recording}:
        name, value = next(iter(wrong.items()))
        raise ValueError(
            f"--{name.replace('_', '-')} {value}: of a mesh of Gmsh or VTK, {', '.join(MESHES)}; a deck "
            "states pressure and clamp itself, by *DSLOAD and *BOUNDARY, has x along the finger, z up, and "
            "another unit than mm by ** units: m, N, s"
        )
    other = bool(finger) or body != "finger"
    if like is not None and not other:
        from twin.commands.initlike import run_init_like

        if targets or nodes or deck or form or sd_mm or still:
            raise ValueError("--like copies points and mesh of the former batch; leave out --targets, "
                             "--format, --node, --deck, --sd-mm and --still; or state --body, then the "
                             "silicone alone is that of the former")  # fmt: skip
        return run_init_like(folder, say, like=like)
    if form is not None and targets is None:
        raise ValueError("--format without --targets: name the file that the other program wrote")
    if deck is not None and (finger or body != "finger"):
        typed = f"--finger {finger[0]}" if finger else f"--body {body}"
        raise ValueError(f"{typed}: of a built-in body, whose place --deck takes; leave one out")
    node_points = {point.name: point for point in map(_point, nodes)}
    builtin_points = (
        {} if deck is not None else {n: PointTable(name=n, node=k) for n, k in NAMED_NODES.items()}
    )
    kind, shape = body_table(body, finger)
    own_deck = None if deck is None else _own_mesh(deck, node_points, ask=targets is None)
    name = named_after(folder)
    missing_keys: dict[str, str] = {}
    if targets is None:
        places = shape.body.places if shape else {}
        config = film_config(name, builtin_points | node_points, places.get("tip", TIP))
    elif form is None and (targets / "targets.csv").is_file() and not (axes or unit or hold_out):
        config = targets_config(name, _read(targets, node_points), builtin_points | node_points)
    else:
        config, missing_keys = import_config(
            name, targets, form, known=builtin_points, told=node_points, say=say, hold_out=hold_out,
            stated={"sd_mm": sd_mm, "still_steps": _still(still), "axes": axes or None, "unit": unit or None},
        )  # fmt: skip
    if (sd_mm is not None or still) and not config.imports:
        raise ValueError(
            f"{'--still' if still else '--sd-mm'} {still or sd_mm}: of another program's file; a folder of "
            "targets states its own under [noise] of targets.toml"
        )
    if not config.imports or own_deck is not None or shape:  # else its dimensions are still to be stated
        _check_points(config, own_deck, shape, say)
    model: dict[str, Any] = {"density_kg_m3": density_kg_m3, kind: shape}
    model |= {"deck": f"raw/{deck.name}"} if deck else {}
    model |= {} if kind == "finger" else {"body": kind}
    said: list[str] = []
    if like is not None:
        from twin.commands.initsilicone import of_silicone

        carried, said = of_silicone(Project.open(like))
        model |= {key: value for key, value in carried.items() if model.get(key) is None}
    model_keys = {key: value for key, value in model.items() if value is not None}
    config = config.model_copy(update={"model": config.model.model_copy(update=model_keys)})
    with files.whole_folder(folder.resolve()) as draft:
        write(draft / "twin.toml", dump(config))
        _fill(draft, config, targets, () if own_deck is None else own_deck.files)
    say(f"Wrote {folder / 'twin.toml'}.")
    for sentence in said:
        say(sentence)
    if own_deck is not None:
        from twin.commands.check import check_finger

        check_finger(Project.open(folder), say)  # its materials, how it is held, the shapes of its elements
    _say_next(folder, config, missing_keys, say)
    return {"stage": "init", "status": "done", "project": str(folder), "wanted": list(missing_keys)}


def _init_of_mesh(
    folder: Path, say: Say, mesh: Path, options: Mapping[str, str], **stated: Any
) -> dict[str, Any]:
    """Result of `run_init` with the deck that a mesh with groups makes."""
    from twin.laws.mooneyrivlin import NOMINAL

    if not mesh.is_file():
        raise ValueError(f"--deck {mesh}: no such file; wanted an Abaqus input deck, or a mesh with groups")
    rubber = NOMINAL.material
    text = deck_of(mesh, constants=(rubber.C10, rubber.C01), **options)
    with tempfile.TemporaryDirectory() as scratch:
        deck_file = Path(scratch) / f"{mesh.stem}.inp"
        deck_file.write_text(text, encoding="utf-8")
        done = run_init(folder, say, deck=deck_file, **stated)
    say(f"raw/{deck_file.name} is the deck made of {mesh.name}: state other materials and loads there.")
    return done


def _init_of_takes(
    folder: Path, say: Say, targets: Path | None, pressure_from: str, *, nodes: Sequence[str],
    hold_out: Sequence[str], axes: str, sd_mm: float | None, deck: Path | None, body: str,
    finger: Sequence[str], density_kg_m3: float | None, unit: str,
) -> dict[str, Any]:  # fmt: skip
    """Result of `run_init` with the targets of a folder of recordings, one a pressure."""
    from twin.bodies.finger import BuiltIn
    from twin.formats.takes import takes_targets
    from twin.model.structure import body_case, skin
    from twin.project.targetfiles import write_targets

    if pressure_from != "name":
        raise ValueError(f"--pressure-from {pressure_from}: wanted name")
    if targets is None or not targets.is_dir():
        raise ValueError(f"--targets {targets}: wanted a folder of recordings, a file a pressure")
    if sd_mm is None:
        raise ValueError("--pressure-from name without --sd-mm: wanted the sd of one position, mm")
    points = [_point(node) for node in nodes]
    if not points or any(point.position_mm is None for point in points):
        raise ValueError("--pressure-from name: wanted --node NAME=X,Y,Z in mm for the markers on the body")
    if deck is not None:
        case = _own_mesh(deck, {}, ask=False).case
        outside = skin(case)
    else:
        shape = body_table(body, finger)[1]
        own = shape.body if shape else BuiltIn()
        case = body_case(own, own.lattice)
        outside = case.face_nodes("outside")
    places = {plain(point.name): np.array(point.position_mm) for point in points}
    found, table, remarks = takes_targets(
        targets, places, case=case, outside=outside, sd_mm=sd_mm, axes=axes, unit=unit,
        held_out=hold_out,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as scratch:
        write_targets(Path(scratch) / "targets", found)
        done = run_init(
            folder, say, targets=Path(scratch) / "targets", deck=deck, body=body, finger=finger,
            nodes=[_typed(point) for point in table.values()],
            density_kg_m3=density_kg_m3,
        )  # fmt: skip
    shutil.copytree(targets, folder / "raw" / "recordings")
    for sentence in remarks:
        say(sentence)
    return done


def _read(targets: Path, node_points: Mapping[str, PointTable]) -> Targets:
    """The targets of a folder, at the nodes that were named."""
    return read_targets(
        targets, nodes={n: point.node for n, point in node_points.items() if point.node is not None}
    )


def _fill(draft: Path, config: Config, targets: Path | None, deck: Sequence[Path]) -> None:
    """Copy targets, another program's file and deck into a project; one for a film gets empty folders."""
    if targets is None:
        (draft / "raw" / "boards").mkdir(parents=True)
    elif not config.imports:
        _copy_targets(targets, draft / "targets")
    else:
        place = draft / "raw" / targets.name
        place.parent.mkdir()
        shutil.copytree(targets, place) if targets.is_dir() else shutil.copy2(targets, place)
    for file in deck:
        place = draft / "raw" / file.relative_to(deck[0].parent)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(file, place)


def _say_next(folder: Path, config: Config, missing_keys: Mapping[str, str], say: Say) -> None:
    """Say what the user has to state in twin.toml, and the next command."""
    if not config.imports:
        say(f"Next: `twin check --project {files.typed(folder)}` says what is still missing.")
        return
    if missing_keys:
        say(f"{config.imports[0].file} does not say all. State under [import] of twin.toml:")
    for key, what in missing_keys.items():
        say(f"  {key}: {what}.")
    say(f"Next: `twin measure --project {files.typed(folder)}` makes the targets of it.")


def import_config(
    name: str, targets: Path, form: str | None, *, known: Mapping[str, PointTable],
    told: Mapping[str, PointTable], say: Say, stated: Mapping[str, Any], hold_out: Sequence[str] = (),
) -> tuple[Config, dict[str, str]]:
    """A configuration for another program's file, or a folder of its recordings, and the keys of [import]
    that are still to be stated, each with what it has to say. ValueError where the file is not right, or has
    no point whose place is stated.

    known: the points that the file may have.   told: those that it must have.   stated: keys of [import].
    hold_out: parts of the names of recordings that no fit may see.
    """
    from twin.formats.supplied import still_wanted

    recordings = recordings_in(targets, form) or {targets: None}
    form = form or format_of(next(iter(recordings)))
    recorded = read_recorded(next(iter(recordings)), form)
    told = {plain(p.name): p.model_copy(update={"name": plain(p.name)}) for p in told.values()}
    listed = ", ".join(recorded.names[:12])
    if missing := [p for p in told if p not in recorded.names]:
        raise ValueError(f"--node {missing[0]}: not in the file, which has {listed}; correct the name")
    points = tuple(p for p in ({**known, **told}).values() if p.name in recorded.names)
    if not points:
        raise ValueError(
            f"no point has a place on the finger; wanted --node NAME=LABEL or --node NAME=X,Y,Z in mm for "
            f"those that do: the file has {listed}"
        )
    if lost := [part for part in hold_out if not any(part in path.name for path in recordings)]:
        files_of = ", ".join(path.name for path in recordings)
        raise ValueError(f"--hold-out {lost[0]}: in no file's name; wanted a part of one of {files_of}")
    stated = {**stated, "axes": stated.get("axes") or recorded.axes or None, "format": form}
    tables = tuple(
        checked(RecordingTable, {
            **stated, "name": plain(path.stem), "file": _raw(path, targets),
            "log": log and _raw(log, targets), "held_out": any(part in path.name for part in hold_out),
        }, name="--targets, --format, --sd-mm, --still, --axes, --unit")
        for path, log in recordings.items()
    )  # fmt: skip
    objective = usual_objective(points)
    config = Config(
        project=ProjectTable(name=name), points=points, calibrate=CalibrateTable(objective_points=objective)
    )
    _say_across(recorded, tables[0], points, say)
    config = config.model_copy(update={"imports": tables})
    config.check()
    return config, still_wanted(recorded, tables[0])


def _raw(path: Path, targets: Path) -> str:
    """Where a file lies in the project, that is or lies in what --targets names."""
    return (Path("raw") / targets.name / path.relative_to(targets)).as_posix()


def recordings_in(folder: Path, form: str | None) -> dict[Path, Path | None]:
    """The recordings in a folder, a file each, with the log of each where the folder has one: of `arm 1.c3d`
    arm 1 log.csv, or ... pressure.csv. None for a file, and for a folder that is one recording."""
    kinds = {"c3d": ".c3d", "csv": ".csv", "anipose": ".csv", "deeplabcut": ".csv"}
    suffix = kinds.get(form or ("c3d" if any(folder.glob("*.c3d")) else ""))
    if not folder.is_dir() or suffix is None:
        return {}
    every = sorted(f for f in folder.iterdir() if f.suffix.lower() in (suffix, ".csv"))
    is_log = re.compile(r"(?i)(.+?)[ _-]*(?:log|pressure)")
    logs = {f: match[1] for f in every if (match := is_log.fullmatch(f.stem))}
    found = [f for f in every if f not in logs and f.suffix.lower() == suffix]
    return {f: next((log for log, stem in logs.items() if stem == f.stem), None) for f in found}


def _say_across(recorded: Recorded, table: RecordingTable, points: Sequence[PointTable], say: Say) -> None:
    """Say where the points move across, as where a picture's height is taken for y."""
    from twin.formats.supplied import across_doubt, mm_per_unit, turned

    if not table.axes or recorded.unit == PIXEL or not (recorded.unit or table.unit):
        return
    place = turned(recorded.position * mm_per_unit(recorded, table), table.axes)
    named = [p for p, one in enumerate(recorded.names) if one in {point.name for point in points}]
    if doubt := across_doubt((place - place[0])[:, named], table.axes):
        say(doubt)


def _still(text: str) -> str | list[list[int]] | None:
    """Value of still_steps in twin.toml, None without one."""
    if not text or text == "holds":
        return text or None
    ranges = [re.fullmatch(r"\s*(\d+)-(\d+)\s*", part) for part in text.split(",")]
    if not all(ranges):
        raise ValueError(f"--still {text!r}: wanted holds, or first and last rows such as 0-60,200-260")
    return [[int(match[1]), int(match[2])] for match in ranges if match]


def body_table(body: str, finger: Sequence[str] = ()) -> tuple[str, BodyTable | None]:
    """The kind of body that KIND or KIND:KEY=VALUE,KEY=VALUE states, and its dimensions; None of a finger if
    none are stated. ValueError where there is no such body, or a dimension is not right.

    finger: dimensions KEY=VALUE of the finger, stated beside it.

    >>> kind, table = body_table("pneunet:chambers=4")
    >>> kind, table.chambers
    ('pneunet', 4)
    """
    kind, _, rest = body.partition(":")
    if kind not in BODIES:
        raise ValueError(f"--body {body}: wanted one of {', '.join(BODIES)}; your own mesh is --deck FILE")
    if finger and kind != "finger":
        raise ValueError(
            f"--finger {finger[0]}: of a bellows finger, and the body is {kind}; wanted its dimensions as in "
            f"--body {kind}:KEY=VALUE"
        )
    option, dimensions = (
        ("--finger", finger) if finger else (f"--body {kind}", rest.split(",") if rest else ())
    )
    if not dimensions:
        return kind, None if kind == "finger" else BODIES[kind]()
    values: dict[str, Any] = {}
    for text in dimensions:
        key, _, value = text.partition("=")
        if not key or not value:
            raise ValueError(f"{option} {text!r}: wanted KEY=VALUE of [model.{kind}], such as length_mm=80")
        try:
            values[key] = int(value) if value.isdigit() else float(value)
        except ValueError:
            values[key] = value
    return kind, checked(BODIES[kind], values, name=option)


def _check_points(config: Config, deck: "Deck | None", shape: BodyTable | None, say: Say) -> None:
    """Say where points lie that are stated in mm. ValueError where one is at a node that is not there or not
    on the surface, or far from it. Dimensions of the built-in finger that are not stated may still change."""
    from twin.bodies.finger import BuiltIn
    from twin.calibrated.positions import check_points, on_both_sides, placed
    from twin.model.structure import Structure, body_case, skin

    nodes, mirrored = {point.node for point in config.points} - {None}, len(config.cameras) == 1
    if deck is not None:
        structure = Structure(deck.case, "", {}, skin(deck.case))
    elif shape or nodes - set(NAMED_NODES.values()):  # those are there: no mesh need be made for them
        body = shape.body if shape else BuiltIn()
        case = body_case(body, body.lattice)
        structure = Structure(case, "", {}, case.face_nodes("outside"), body=body)
    else:
        return
    structure = on_both_sides(structure, config.points, mirrored=mirrored)
    if deck is not None or shape:
        for place in placed(config.points, structure, mirrored=mirrored).values():
            if shape:  # of a deck they are said with what else there is to say of it
                say(place.sentence)
    check_points(config.points, structure, mirrored=mirrored)


def targets_config(name: str, targets: Targets, stated: Mapping[str, PointTable]) -> Config:
    """A configuration for targets measured elsewhere; ValueError names points without a place."""
    from twin.study.generations import moving_component

    finger = [p for p in targets.points if p.kind is not PointKind.FIXED]
    off = {name: point for name, point in stated.items() if point.standoff_mm}
    points_of = {p.name: off.get(p.name) or _named(p) or stated.get(p.name) for p in finger}
    missing = [name for name, point in points_of.items() if point is None]
    if missing:
        raise ValueError(f"the place of point {', '.join(missing)} is not known: state it, as in --node "
                         f"{missing[0]}=110,11.5,0 (x, y, z in mm) or --node {missing[0]}=4401 (the label of "
                         "a node), or in targets.toml under [[points]]")  # fmt: skip
    points = tuple(point for point in points_of.values() if point is not None)
    if not points:
        raise ValueError("targets: all points are fixed markers; wanted at least one on the finger")
    objective = usual_objective(points)
    component: Any = 1 + moving_component(targets, objective)
    calibrate = CalibrateTable(objective_points=objective, objective_component=component)
    return Config(project=ProjectTable(name=name), points=points, calibrate=calibrate)


def _named(point: TargetPoint) -> PointTable | None:
    """The point as the targets have it, at its node or place; None where they do not say."""
    if point.node is None and point.position is None:
        return None
    try:
        if point.node is not None:
            return PointTable(name=point.name, node=point.node)
        return PointTable(name=point.name, position_mm=point.position)
    except ValueError:
        raise ValueError(
            f"targets: point {point.name!r}: wanted {NAMED}; rename it in targets.csv and targets.toml"
        ) from None


def _own_mesh(deck: Path, node_points: Mapping[str, PointTable], *, ask: bool) -> "Deck":
    """The mesh of a deck; ValueError where it is not right.   ask: points have to be named, as no targets
    name them."""
    from twin.model.structure import sound_deck

    if not deck.is_file():
        raise ValueError(f"--deck {deck}: no such file; wanted an Abaqus input deck")
    if ask and not node_points:
        raise ValueError(
            "--deck without --node: name your points, as in --node tip=4401, or --node tip=110,11.5,0 in mm"
        )
    return sound_deck(deck)


def film_config(
    name: str, stated: Mapping[str, PointTable] | None = None, tip: tuple[float, float, float] = TIP
) -> Config:
    """A configuration for one film, to be filled in: the values of a typical rig stand in it.

    stated: the points by name; by default tip and middle of the built-in finger.   tip: place of the body's
    tip, mm, around which the rig is.
    """
    named = stated or {point: PointTable(name=point, node=node) for point, node in NAMED_NODES.items()}
    length, y, z = tip
    stations = np.linspace(-20.0, length + 10.0, 5).round(1).tolist()
    rig = [(x, z + up) for up in (12.0, -75.0) for x in stations]
    markers = tuple(
        MarkerTable(marker=20 + i, name=f"R{i + 1:02d}", role="fixed" if i % 5 in (1, 3) else "frame",
                    position_mm=(x, y + 0.5, z), size_mm=8.0)
        for i, (x, z) in enumerate(rig)
    )  # fmt: skip
    camera = CameraTable(
        name="side", film="raw/film.mp4", static="raw/static.mp4", boards="raw/boards/*.png",
        board=BoardTable(columns=9, rows=6, square_mm=15.0, marker_mm=11.0),
    )  # fmt: skip
    points = tuple(
        point.model_copy(update={"marker": number, "size_mm": 6.0})
        for number, point in enumerate(named.values())
    )
    return Config(project=ProjectTable(name=name), cameras=(camera,), pressure=PressureTable(),
                  frame=FrameTable(markers=markers), points=points,
                  calibrate=CalibrateTable(objective_points=usual_objective(points)))  # fmt: skip


def _typed(point: PointTable) -> str:
    """The point as `_point` reads it."""
    assert point.position_mm is not None
    off = [] if point.standoff_mm is None else [round(point.standoff_mm, 3)]
    return f"{point.name}={','.join(repr(round(x, 4)) for x in [*point.position_mm, *off])}"


def _point(text: str) -> PointTable:
    """The point that NAME=LABEL, NAME=X,Y,Z or NAME=X,Y,Z,STANDOFF states."""
    name, _, place = text.rpartition("=")
    name = name and plain(name)
    try:
        if name and place.isdigit():
            return PointTable(name=name, node=int(place))
        x, y, z, *off = (float(part) for part in place.split(","))
        if len(off) < 2:
            return PointTable(name=name, position_mm=(x, y, z), standoff_mm=off[0] if off else None)
    except ValueError:
        pass
    raise ValueError(
        f"--node {text!r}: wanted NAME=LABEL, such as tip=4401, or NAME=X,Y,Z in mm, such as tip=110,11.5,0; "
        "of a marker that stands off the surface a fourth number, how far"
    )


def _copy_targets(source: Path, target: Path) -> None:
    target.mkdir()
    for name in ("targets.csv", "targets.toml", "targets.npz", "pressure.csv"):
        if (source / name).is_file():
            shutil.copy2(source / name, target / name)
