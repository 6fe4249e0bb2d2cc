"""Kills, a full disk and a limit of file sizes in every stage: does a project end with the same bits?

    python benchmarks/strangers_faults.py [--quick] [kills] [disk]

`kills_same`: kills -9 at random moments over all stages, of which each project ended with the bits of one
that was left alone: camera.json, tracks and targets of the demo film, and what calibrate to review find of a
short finger. `disk_same`: faults of the disk (no space, file too large) at one write after the other, after
which the project went on to the same bits; `disk_internal`: those that ended otherwise than in one sentence
that names the file; `disk_left`: drafts that they left.
"""

import argparse
import contextlib
import errno
import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import _first  # noqa: F401
import numpy as np

FOUND = ("camera.json", "fit.json", "diagnosis.json", "comparison.json", "tracks.npz", "candidates.npz")


FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 30.0), (12.0, 30.0), (12.4, 0.0), (22.0, 0.0))
NAMES, X = ("p1", "p2", "middle", "tip"), (9.556, 15.111, 4 + 50 / 3, 10 + 100 / 3)


def _make(folder: Path, cells: int) -> None:
    """A project of a short finger with targets of creeping silicone."""
    from fe import Lattice, Material
    from twin import virtual
    from twin.project.config import CalibrateTable, Config, DiagnoseTable, PointTable, ProjectTable
    from twin.project.targetfiles import write_targets
    from twin.project.toml import dump

    bench, (builtin, case) = virtual.Bench(film_hz=4.0, gauge_sd_MPa=3e-4, sd=0.005), _finger(cells)
    edge = np.array([(x, 11.5, 0.0) for x in X])
    rows = np.linalg.norm(case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    course = virtual.path(bench, protocol=FILM)
    truth = virtual.Truth(
        Material(0.214, 0.083, prony=((0.075, 1.2), (0.055, 3.5))),
        lattice=Lattice(per_bellow=2, centred=False), finger=builtin.finger,
    )  # fmt: skip
    u, slope = virtual.displacements(truth, course, case.nodes[rows])
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


def _finger(cells: int) -> Any:
    from fe import Finger, Lattice
    from twin.model.structure import BuiltIn, base_case

    end, middle = 10 + 100 / 3, 4 + 50 / 3
    finger = Finger(length=end, bellows=3, tip_node=(end, 11.5, 0.0), middle_node=(middle, 11.5, 0.0))
    lattice = Lattice(per_bellow=cells, ring=False, centred=False)
    return BuiltIn(finger, lattice), base_case(finger=finger, lattice=lattice)


# -- kill -9 -------------------------------------------------------------------------------------------------


def kills(quick: bool) -> dict[str, int]:
    """How many kills were survived without a change of a bit, of how many."""
    film, model = ((1, 2), (1, 4)) if quick else ((8, 5), (10, 6))  # projects, and kills of each
    parts = [_killed_often(_filmed, *film, seed=1), _killed_often(_modelled, *model, seed=2)]
    return {"kills": sum(p["kills"] for p in parts), "kills_same": sum(p["kills_same"] for p in parts)}


class _filmed:
    """`twin camera` and `twin measure` of the demo film."""

    @staticmethod
    def make(folder: Path) -> None:
        shutil.copytree(Path(__file__).resolve().parents[1] / "datasets" / "demo", folder)

    commands = (("camera",), ("measure",))


class _modelled:
    """`twin recalibrate` of targets of a short finger."""

    @staticmethod
    def make(folder: Path) -> None:
        _make(folder, 1)

    commands = (("recalibrate",),)


def _killed_often(part: Any, folders: int, times: int, *, seed: int) -> dict[str, int]:
    rng, killed, same = np.random.default_rng(seed), 0, 0
    with tempfile.TemporaryDirectory() as scratch:
        first = Path(scratch) / "first"
        part.make(first)
        whole = Path(shutil.copytree(first, first.with_name("whole")))
        start = time.monotonic()
        _finished(whole, part.commands)
        took, wanted = time.monotonic() - start, digests(whole)
        assert any("/" in name for name in wanted), "the run without a kill left nothing"
        for k in range(folders):
            folder = Path(shutil.copytree(first, first.with_name(f"killed{k}")))
            count = sum(_kill(folder, part.commands, float(s)) for s in rng.uniform(0.02, 0.9, times) * took)
            _finished(folder, part.commands)
            killed += count
            same += count * (digests(folder) == wanted)
    return {"kills": killed, "kills_same": same}


def _child(folder: Path, command: tuple[str, ...], *, limit: int = 0) -> subprocess.Popen[str]:
    how = [sys.executable, __file__, "--child", str(folder), str(limit), *command]
    return subprocess.Popen(
        how, start_new_session=True, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def _finished(folder: Path, commands: tuple[tuple[str, ...], ...]) -> None:
    for command in commands:
        child = _child(folder, command)
        _, said = child.communicate()
        if child.returncode:
            raise RuntimeError(f"{command[0]} ended with {child.returncode}: {said}")


def _kill(folder: Path, commands: tuple[tuple[str, ...], ...], after_s: float) -> bool:
    """Kill -9 the commands, one after the other, after a time; whether they were still at work."""
    end = time.monotonic() + after_s
    for command in commands:
        child = _child(folder, command)
        try:
            child.communicate(timeout=max(end - time.monotonic(), 0.02))
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.communicate()
            return True
    return False


def digests(folder: Path) -> dict[str, str]:
    """Digests of twin.toml, the targets and what the newest done run of every stage has found."""
    found = {}
    for run in sorted((folder / "runs").iterdir()):
        told = run / "run.json"
        if told.exists() and json.loads(told.read_text(encoding="utf-8"))["status"] == "done":
            there = [run / name for name in FOUND if (run / name).exists()]
            found |= {f"{run.name.partition('-')[2]}/{path.name}": _digest(path) for path in there}
    beside = [folder / "twin.toml", *sorted((folder / "targets").glob("targets.*"))]
    return found | {path.name: _digest(path) for path in beside}


def _digest(path: Path) -> str:
    if path.suffix != ".npz":  # whose container has the time in it
        return hashlib.sha256(path.read_bytes()).hexdigest()
    with np.load(path) as arrays:
        return hashlib.sha256(b"".join(arrays[n].tobytes() for n in sorted(arrays.files))).hexdigest()


# -- a full disk ---------------------------------------------------------------------------------------------


def disk(quick: bool) -> dict[str, int]:
    """How the short finger's project ends after faults of the disk at one write after the other."""
    faults, limits = (6, (3000,)) if quick else (60, (1000, 10_000, 100_000, 1_000_000))
    tally = {"disk_faults": 0, "disk_same": 0, "disk_internal": 0, "disk_left": 0}
    with tempfile.TemporaryDirectory() as scratch:
        first = Path(scratch) / "first"
        _make(first, 1)
        whole = Path(shutil.copytree(first, first.with_name("whole")))
        _run(whole, "recalibrate")
        folder = Path(shutil.copytree(first, first.with_name("faulty")))
        for number in range(1, faults + 1):
            tally["disk_faults"] += 1
            with _no_space(number) as met:
                try:
                    _run(folder, "recalibrate")
                except OSError as error:
                    tally["disk_internal"] += error.filename is None
                except Exception as error:
                    print(f"write {number}: {type(error).__name__}: {error}")
                    tally["disk_internal"] += 1
            tally["disk_left"] += len(drafts(folder))
            if not met:
                break
        for limit in limits:
            tally["disk_faults"] += 1
            child = _child(folder, ("recalibrate",), limit=limit)
            _, said = child.communicate()
            tally["disk_internal"] += child.returncode not in (0, 2) or "Traceback" in said
            tally["disk_left"] += len(drafts(folder))
        _run(folder, "recalibrate")
        tally["disk_same"] = tally["disk_faults"] * (digests(folder) == digests(whole))
    return tally


@contextlib.contextmanager
def _no_space(number: int) -> Iterator[list[int]]:
    """The disk is full at the write of that number; the list says whether it came so far."""
    from twin.project import files

    met: list[int] = []
    count, honest = [0], files._to_disk

    def full(path: Path) -> None:
        count[0] += 1
        if count[0] == number:
            met.append(number)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        honest(path)

    files._to_disk = full
    try:
        yield met
    finally:
        files._to_disk = honest


def drafts(folder: Path) -> list[Path]:
    """Files that a failed write has left: hidden ones other than the lock."""
    return [p for p in folder.rglob(".*") if p.name != ".lock"]


class _Silent:
    def __call__(self, text: str, /) -> None: ...

    def progress(self, stage: str, done: int, total: int, /) -> None: ...


def _run(folder: Path, command: str) -> None:
    """A command of a project; that of the short finger has its own mesh."""
    from twin.project.folder import Project
    from twin.stages.chain import stage_of
    from twin.stages.recalibrating import run_recalibrate

    mesh = _finger(1)[0] if command == "recalibrate" else None
    project = Project.open(folder, builtin=mesh)
    with project.lock(command):
        work = run_recalibrate if command == "recalibrate" else stage_of(command).run
        work(project, _Silent())


def _limited(folder: Path, limit: int, command: str) -> None:
    """A command as a process of its own, no file of which may be larger than so many bytes (0: any)."""
    from twin.console import guarded

    if limit:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    sys.exit(guarded(lambda: _run(folder, command), debug=False))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        _limited(Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--quick", action="store_true", help="6 kills and 7 faults")
    ask.add_argument("what", nargs="*", default=["kills", "disk"], help="kills, disk")
    told = ask.parse_args()
    parts = {"kills": kills, "disk": disk}
    print(json.dumps({k: v for name in told.what for k, v in parts[name](told.quick).items()}, indent=1))
