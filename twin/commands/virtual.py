"""The command `twin virtual`: a project of an experiment that never was, its truth sealed beside it."""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from typer import Argument, Option

from twin import files
from twin.bodies.body import Body
from twin.bodies.finger import BuiltIn
from twin.commands.init import body_table, run_init
from twin.effects.protocol import Unsolvable
from twin.gravity import TONNE_PER_MM3
from twin.messages import Say, Silent
from twin.model.objects import RigidObject
from twin.model.structure import body_case
from twin.project import toml
from twin.project.targetfiles import write_targets
from twin.targets import Array, TargetPoint, Targets
from twin.virtual.draws import NOISE, Setup, at_nodes, measured, plainness
from twin.virtual.hidden import KINDS, Kind
from twin.virtual.protocols import PROTOCOLS, Protocol, places
from twin.virtual.truthsolves import (
    COUNT,
    DENSITY,
    SILICONE,
    displaced,
    on_surface,
    tangents,
    truth_case,
    truth_lattice,
)

ELEMENTS_OF_TRUTH = ("C3D20H", "C3D20RH", "C3D20", "C3D20R")


def run_virtual(
    folder: Annotated[Path, Argument(help="project folder to make")],
    say: Say,
    *,
    protocol: Annotated[str, Option(help="P1 (tip, one ramp) to P5 (three orientations), or fast")] = "P3",
    hide: Annotated[Sequence[str], Option(help="what the model lacks, NAME or NAME=SIZE; repeated")] = (),
    sigmas: Annotated[float | None, Option(
        help="size of what is hidden, in sds of the noise beside the constants")] = None,
    noise_mm: Annotated[float, Option(help="noise of a marker's position, 1 sd")] = 0.015,
    noise: Annotated[str, Option(help="white, or ar1: each value resembles the one before")] = "white",
    placement_mm: Annotated[float, Option(help="distance of a marker from its node, 1 sd")] = 0.1,
    element: Annotated[str, Option(help="Abaqus element of the truth")] = "C3D20H",
    body: Annotated[str, Option(help="kind, such as pneunet:chambers=3")] = "finger",
    object: Annotated[str, Option(help="what it meets: cylinder:d=20,x=50,z=-14")] = "",  # noqa: A002
    seed: Annotated[int, Option(help="seed of the noise")] = 0,
) -> dict[str, Any]:
    """A project folder with targets and twin.toml, and `FOLDER.truth.json` beside it.

    ValueError for what does not exist.
    """
    setup = Setup(sd_mm=noise_mm, noise=noise, placement_sd_mm=placement_mm)
    chosen, kinds = _protocol(protocol), [_kind(text) for text in hide]
    sealed = folder.with_name(f"{folder.name}.truth.json")
    if folder.exists() or sealed.exists():
        raise ValueError(
            f"{folder if folder.exists() else sealed} is there already and is never overwritten; "
            "name a folder that does not exist"
        )
    if element not in ELEMENTS_OF_TRUTH:
        raise ValueError(f"--element {element}: wanted one of {', '.join(ELEMENTS_OF_TRUTH)}")
    if noise not in NOISE:
        raise ValueError(f"--noise {noise}: wanted one of {', '.join(NOISE)}")
    if object and hide:
        raise ValueError(f"--object {object} and --hide {hide[0]}: the truth beside an object hides nothing "
                         "else; leave one out")  # fmt: skip
    say("Solving the truth on a mesh of its own ...")
    _, table = body_table(body)
    solid = BuiltIn() if table is None else table.body
    lattice = truth_lattice(solid)
    points, case = marked(chosen, solid), truth_case(solid, lattice, element=element)
    if case.pressurised is None:
        raise ValueError(f"--body {body}: it has no chamber, and every protocol is a test under pressure; "
                         "wanted finger, pneunet or tube")  # fmt: skip
    obstacle = RigidObject.of(object) if object else None
    if not chosen.weighed:
        case = case.with_material(density=0.0)
    case = case if obstacle is None else obstacle.beside(case)
    positions = np.array([p.position for p in points])
    on = on_surface(case, positions)
    bare, slope = displaced(case, chosen.course, on, count=COUNT)
    draw = measured(chosen, bare, slope, points=points, setup=setup, seed=seed)
    rows = {kind.name: _all(tangents(case, chosen.course, positions, kind), draw) for kind, _ in kinds}
    hidden = tuple((kind, _sized(kind, size, sigmas, rows[kind.name], draw, slope)) for kind, size in kinds)
    try:
        u, slope = displaced(case, chosen.course, on, hidden, count=COUNT) if hidden else (bare, slope)
    except Unsolvable as why:
        raise ValueError(f"--hide {' '.join(hide)}: {why}; hide less of it, or state fewer sigmas") from None
    targets = measured(chosen, u, slope, points=points, setup=setup, seed=seed)
    with tempfile.TemporaryDirectory() as scratch:
        write_targets(Path(scratch) / "targets", targets)
        density = DENSITY / TONNE_PER_MM3 if chosen.weighed else None
        run_init(folder, Silent(), targets=Path(scratch) / "targets", nodes=(), density_kg_m3=density,
                 body=body)  # fmt: skip
    known: dict[str, float | str] = {"wall_sd_mm": 0.0}  # the truth has exactly these walls
    _put(folder / "twin.toml", known | ({"object": object} if object else {}))
    change, felt = _all(u - bare, targets), _all(slope, targets)
    plain = {k.name: plainness(change, targets, _all(rows[k.name][:2], targets), felt) for k, _ in hidden[:1]}
    truth = {
        "protocol": chosen.name, "seed": seed, "element": element, "body": body, "object": object,
        "lattice": asdict(lattice),
        "constants_MPa": {"C10": SILICONE.C10, "C01": SILICONE.C01},
        "hidden": [
            {"name": k.name, "effect": k.physics or None, "law": k.law, "size": s, "unit": k.unit}
            for k, s in hidden
        ],
        "non_centrality": plain, "setup": asdict(setup),
    }  # fmt: skip
    files.write_text(sealed, json.dumps(truth, indent=1) + "\n")
    say(f"Wrote {folder / 'twin.toml'} and, not to be read before the diagnosis, {sealed.name} beside it.")
    say(f"Next: `twin calibrate --project {files.typed(folder)}`.")
    return {"stage": "virtual", "status": "done", "project": str(folder), "sealed": str(sealed)}


def _put(path: Path, known: Mapping[str, float | str]) -> None:
    """State in the table [model] of a twin.toml what is known of the finger."""
    config = toml.parse(path.read_bytes(), name=path.name)
    model = config.model.model_copy(update=known)
    files.write_text(path, toml.dump(config.model_copy(update={"model": model})))


def _protocol(name: str) -> Protocol:
    if name not in PROTOCOLS:
        raise ValueError(f"--protocol {name}: wanted one of {', '.join(PROTOCOLS)}")
    return PROTOCOLS[name]


def _kind(text: str) -> tuple[Kind, float | None]:
    name, _, size = text.partition("=")
    if name not in KINDS:
        raise ValueError(f"--hide {name}: wanted one of {', '.join(KINDS)}")
    try:
        return KINDS[name], float(size) if size else None
    except ValueError:
        raise ValueError(f"--hide {text}: wanted NAME=SIZE, such as creep=0.05") from None


def marked(protocol: Protocol, body: Body) -> tuple[TargetPoint, ...]:
    """The markers of a protocol, each on the nearest node of a body."""
    case, place_of = body_case(body, body.lattice), places(body)
    edge, off = [n for n in place_of if n.startswith("p")], [n for n in place_of if n.startswith("off")]
    names = [*edge[1 : protocol.along], "tip", *off[: protocol.off_axis]]
    positions = np.array([place_of[name] for name in names])
    near = np.linalg.norm(case.nodes[:, None] - positions, axis=2).argmin(axis=0)
    return at_nodes(names, case.labels[near], case.nodes[near])


def _all(rows: Array, targets: Targets) -> Array:
    """Values (.., p, 3) of the markers on the finger, and 0 of the fixed ones."""
    out = np.zeros((*rows.shape[:-2], len(targets.points), 3))
    out[..., : rows.shape[-2], :] = rows
    return out


def _sized(
    kind: Kind, size: float | None, sigmas: float | None, rows: Array, targets: Targets, slope: Array
) -> float:
    """The size that was asked for, or that with a non-centrality, to first order."""
    if size is not None:
        return size
    if sigmas is None:
        raise ValueError(f"--hide {kind.name}: wanted a size, {kind.name}=SIZE, or --sigmas")
    per_unit = plainness(rows[2], targets, rows[:2], _all(slope, targets))
    return sigmas / max(per_unit, 1e-12)
