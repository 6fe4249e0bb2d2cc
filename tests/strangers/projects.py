"""Small projects in which faults are planted: two with drawn films, one with targets of a short finger."""

import hashlib
import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import av
import cv2
import numpy as np
from rerun.chunk import RrdReader

if TYPE_CHECKING:
    from twin.model.structure import BuiltIn

Command = tuple[str, ...]  # a stage, and its options

FOUND = (
    "camera.json", "budget.csv", "fit.json", "diagnosis.json", "comparison.json", "tracks.npz",
    "candidates.npz", "deformed-0000.vtu",
)  # fmt: skip
DROOP_MM, STATIC = 8.5, 260  # of the drawn finger's tip; frames: a part of 250 is kept when it is followed


@dataclass(frozen=True)
class Kind:
    """A kind of project: how it is made, on which mesh, and the commands that do all of it."""

    make: Callable[[Path], None]
    mesh: "Callable[[], BuiltIn]"
    commands: tuple[Command, ...]


def run(folder: Path, kind: str, command: Command) -> None:
    """A command of a project of that kind, in this process."""
    from twin.chain import stage_of
    from twin.commands.recalibrate import run_recalibrate
    from twin.project.folder import Project

    project = Project.open(folder, builtin=KINDS[kind].mesh())
    options = {option.removeprefix("--"): True for option in command[1:]}
    work: Any = run_recalibrate if command[0] == "recalibrate" else stage_of(command[0]).run
    with project.lock(command[0]):
        work(project, _Silent(), **options)


class _Silent:
    def __call__(self, text: str, /) -> None: ...

    def progress(self, stage: str, done: int, total: int, /) -> None: ...


# -- what a project has found --------------------------------------------------------------------------------


def digests(folder: Path) -> dict[str, str]:
    """Digests of twin.toml, the targets and what the newest done run of every stage has found."""
    found = {}
    for run in _in_order(folder):
        told = run / "run.json"
        if told.exists() and json.loads(told.read_text(encoding="utf-8"))["status"] == "done":
            there = [run / name for name in FOUND if (run / name).exists()]
            found |= {f"{run.name.partition('-')[2]}/{path.name}": _digest(path) for path in there}
    beside = [folder / "twin.toml", *sorted((folder / "targets").glob("targets.*"))]
    return found | {path.name: _digest(path) for path in beside}


def _in_order(folder: Path) -> list[Path]:
    return sorted((folder / "runs").glob("*-*"), key=lambda run: int(run.name.partition("-")[0]))


def _digest(path: Path) -> str:
    if path.suffix != ".npz":  # whose container has the time in it
        return hashlib.sha256(path.read_bytes()).hexdigest()
    with np.load(path) as arrays:
        return hashlib.sha256(b"".join(arrays[n].tobytes() for n in sorted(arrays.files))).hexdigest()


def under_way(folder: Path) -> str:
    """The stage that a kill has left."""
    told = [run for run in _in_order(folder) if (run / "run.json").exists()] if folder.exists() else []
    if told and json.loads((told[-1] / "run.json").read_text(encoding="utf-8"))["status"] == "running":
        return told[-1].name.partition("-")[2]
    return "between stages"


def drafts(folder: Path) -> list[Path]:
    """Files that a failed write has left: hidden ones other than the lock."""
    return [path for path in folder.rglob(".*") if path.name != ".lock"]


def halves(folder: Path) -> list[Path]:
    """Files of the runs that stand under their name and cannot be read to their end."""
    return [path for path in sorted((folder / "runs").rglob("*.*")) if path.is_file() and not _whole(path)]


def _whole(path: Path) -> bool:
    try:
        return READ.get(path.suffix, lambda _: True)(path)
    except (OSError, ValueError, RuntimeError, zipfile.BadZipFile):
        return False


def _film(path: Path) -> bool:
    with av.open(path) as film:
        return film.streams.video[0].frames == sum(1 for _ in film.decode(video=0))


def _ends(end: bytes) -> Callable[[Path], bool]:
    return lambda path: path.read_bytes().rstrip().endswith(end)


READ: dict[str, Callable[[Path], bool]] = {
    ".json": lambda path: json.loads(path.read_text(encoding="utf-8")) is not None,
    ".npz": lambda path: zipfile.ZipFile(path).testzip() is None,
    ".png": lambda path: cv2.imread(str(path)) is not None,
    ".rrd": lambda path: sum(1 for _ in RrdReader(str(path)).stream()) > 0,
    ".mp4": _film,
    ".vtu": _ends(b"</VTKFile>"),
    ".html": _ends(b"</html>"),
}


# -- the kinds ----------------------------------------------------------------------------------------------


def _batch(folder: Path) -> None:
    """Films, boards and log of a small finger."""
    from benchmarks.batches import make_batch

    make_batch.write(folder, make_batch.FIRST)


def _filmed(folder: Path) -> None:
    """The same of one that bends as a beam does: nothing is solved for it."""
    from benchmarks.batches import make_batch

    make_batch.write(folder, replace(make_batch.FIRST, droop_mm=DROOP_MM, static_frames=STATIC))


def _filmed_mesh() -> "BuiltIn":
    from benchmarks.batches import make_batch

    from fe import Lattice
    from twin.model.structure import BuiltIn

    return BuiltIn(make_batch.FIRST.finger, Lattice(per_bellow=2, wall=1, up=1, centred=False))


PROTOCOL = ((0.0, 0.0), (2.0, 0.0), (4.0, 30.0), (12.0, 30.0), (12.4, 0.0), (22.0, 0.0))
NAMES, X = ("p1", "p2", "middle", "tip"), (9.556, 15.111, 4 + 50 / 3, 10 + 100 / 3)


def _short(folder: Path) -> None:
    """Targets of a short finger of creeping silicone."""
    from fe import Lattice, Material
    from twin import virtual
    from twin.marktables import PointTable
    from twin.model.structure import base_case
    from twin.project.config import CalibrateTable, Config, DiagnoseTable, ProjectTable
    from twin.project.targetfiles import write_targets
    from twin.project.toml import dump

    bench, mesh = virtual.Bench(film_hz=4.0, gauge_sd_MPa=3e-4, sd=0.005), _short_mesh()
    case = base_case(finger=mesh.finger, lattice=mesh.lattice)
    edge = np.array([(x, 11.5, 0.0) for x in X])
    rows = np.linalg.norm(case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    course = virtual.path(bench, protocol=PROTOCOL)
    material = Material(0.214, 0.083, prony=((0.075, 1.2), (0.055, 3.5)))
    truth = virtual.truth_case(
        mesh.finger, Lattice(per_bellow=2, centred=False), material=material, element=None
    )
    u, slope = virtual.displaced(truth, course, case.nodes[rows])
    points = virtual.at_nodes(NAMES, case.labels[rows], case.nodes[rows])
    config = Config(
        project=ProjectTable(name="short"),
        points=tuple(PointTable(name=n, node=int(k)) for n, k in zip(NAMES, case.labels[rows])),
        calibrate=CalibrateTable(population=8, generations=4),
        diagnose=DiagnoseTable(candidates=("creep", "camera_scale")),
    )
    folder.mkdir()
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(
        folder / "targets", virtual.noisy_targets(u, slope, course, points=points, bench=bench, seed=1)
    )


def _short_mesh() -> "BuiltIn":
    """Two cells a pleat: on one the diagnosis names nothing, and nothing is added."""
    from fe import Finger, Lattice
    from twin.model.structure import BuiltIn

    end, middle = 10 + 100 / 3, 4 + 50 / 3
    finger = Finger(length=end, bellows=3, tip_node=(end, 11.5, 0.0), middle_node=(middle, 11.5, 0.0))
    return BuiltIn(finger, Lattice(per_bellow=2, ring=False, centred=False))


KINDS = {
    "film": Kind(_filmed, _filmed_mesh, (("camera",), ("measure",))),
    "batch": Kind(_batch, _filmed_mesh, (("recalibrate",),)),
    "model": Kind(_short, _short_mesh, (("recalibrate",),)),
}


def finish(folder: Path, kind: str, commands: Sequence[Command]) -> None:
    """All these commands, one after the other, in this process."""
    for command in commands:
        run(folder, kind, command)
