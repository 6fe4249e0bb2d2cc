"""Kills, interrupts, a full disk and limits of file sizes in every stage: does a project end the same?

`kills_same`: kills -9 at random moments over all stages, of which each project ended with the bits of one
that was left alone: camera, tracks, budget and targets of a drawn film, and what calibrate to review find of
a short finger; `kills_stages` says how many fell in which stage. 100 kills take half an hour on one core.
What was counted so far stands in kills.json of a temporary folder after every kill. `interrupts_same`: the same for
Ctrl-C, to the whole group of processes as a terminal gives it; `interrupts_traceback`: those that were
answered with a traceback, or with another exit code than 130.
`disk_same`: faults of the disk in camera, measure, review (with its clip) and recalibrate, after which the
project went on to the same bits: no space at one write after the other, and a file that may not grow, where
no writer is spared. `disk_internal`: faults that ended otherwise than in one sentence that names a file;
`disk_left`: drafts that they left; `disk_half`: files under their own name that end in the middle.
"""

import contextlib
import errno
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.strangers.projects import KINDS, Command, digests, drafts, finish, halves, run, under_way

ROOT = Path(__file__).resolve().parents[2]
KILLS = {"film": 40, "model": 60}
LATEST = 0.4  # of a kill, as a share of the time of a run without one
MOST = 8  # kills of one project
TALLY = Path(tempfile.gettempdir())


def _child(folder: Path, kind: str, command: Command, *, limit: int = 0) -> subprocess.Popen[str]:
    """A command as a process, no file of which may be larger than so many bytes (0: any)."""
    how = [sys.executable, "-m", "tests.strangers.kills", str(folder), kind, str(limit), *command]
    return subprocess.Popen(
        how, cwd=ROOT, start_new_session=True, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def _as_child(folder: Path, kind: str, limit: int, command: Command) -> None:
    """The command line itself, on the mesh of that kind of project; first it says that it begins."""
    from twin.main import start
    from twin.project.folder import Project

    own, mesh = Project.open.__func__, KINDS[kind].mesh()  # type: ignore[attr-defined]
    Project.open = classmethod(lambda cls, root, builtin=None, **how: own(cls, root, builtin=mesh, **how))
    if limit:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    sys.argv = ["twin", *command, "--project", str(folder)]
    print("up", flush=True)
    start()


# -- kill -9 -------------------------------------------------------------------------------------------------


@dataclass
class Tally:
    """What was counted so far, in a file that an interrupted benchmark leaves."""

    name: str  # kills, or interrupts
    path: Path
    kills: int = 0
    same: int = 0
    ended: int = 0  # kills of projects that have ended: the others are not judged yet
    badly: int = 0  # interrupts that were answered with a traceback
    stages: Counter[str] = field(default_factory=Counter)

    def figures(self) -> dict[str, Any]:
        found: dict[str, Any] = {"": self.kills, "_judged": self.ended, "_same": self.same}
        found |= {"_traceback": self.badly} if self.name == "interrupts" else {}
        stages = {"_stages": dict(sorted(self.stages.items()))}
        return {self.name + name: value for name, value in (found | stages).items()}

    def tell(self, text: str) -> None:
        print(f"{text}; {self.same} of {self.ended} the same", file=sys.stderr, flush=True)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text(json.dumps(self.figures(), indent=1) + "\n", encoding="utf-8")


def kills(quick: bool, *, count: int | None = None, tally: Path = TALLY) -> dict[str, Any]:
    """How many kills were survived without a change of a bit, of how many."""
    wanted = count or (6 if quick else sum(KILLS.values()))
    return _both(wanted, Tally("kills", tally / "kills.json"), signal.SIGKILL)


def interrupts(quick: bool, *, count: int | None = None, tally: Path = TALLY) -> dict[str, Any]:
    """The same for Ctrl-C, and how many had another answer than a sentence and exit code 130."""
    return _both(count or (6 if quick else 20), Tally("interrupts", tally / "interrupts.json"), signal.SIGINT)


def recalibrations(quick: bool) -> dict[str, Any]:
    """The same for kills of `twin recalibrate` alone, from the films to the report."""
    told = Tally("kills", TALLY / "recalibrations.json")
    _ended_often("batch", 3 if quick else 20, told, how=signal.SIGKILL, seed=4)
    return told.figures()


def _both(wanted: int, told: Tally, how: signal.Signals) -> dict[str, Any]:
    print(f"counted so far: {told.path}", file=sys.stderr)
    film = round(wanted * KILLS["film"] / sum(KILLS.values()))
    _ended_often("film", film, told, how=how, seed=1)
    _ended_often("model", wanted - film, told, how=how, seed=2)
    return told.figures()


def _ended_often(kind: str, count: int, told: Tally, *, how: signal.Signals, seed: int) -> None:
    """End commands of projects of this kind so often in all, and see how each project ends."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as scratch:
        first = Path(scratch) / "first"
        KINDS[kind].make(first)
        whole = Path(shutil.copytree(first, first.with_name("whole")))
        start = time.monotonic()
        _finished(whole, kind)
        took, wanted = time.monotonic() - start, digests(whole)
        assert any("/" in name for name in wanted), "the run without a kill left nothing"
        while count > 0:
            folder = Path(shutil.copytree(first, first.with_name(f"ended{count}")))
            own, most = 0, min(count, MOST)
            while own < most and _end(folder, kind, took * float(rng.uniform(0.0, LATEST)), told, how):
                own += 1
            _finished(folder, kind)
            apart = _apart(digests(folder), wanted)
            told.ended, told.same, count = told.ended + own, told.same + own * (not apart), count - own
            told.tell(f"{own} of one project{apart}")
            shutil.rmtree(folder)


def _apart(found: dict[str, str], wanted: dict[str, str]) -> str:
    """What is not the same, as the end of a sentence; empty where all is."""
    names = [name for name in {**found, **wanted} if found.get(name) != wanted.get(name)]
    return f", NOT the same: {', '.join(names)}" if names else ""


def _finished(folder: Path, kind: str) -> None:
    for command in KINDS[kind].commands:
        child = _child(folder, kind, command)
        _, said = child.communicate()
        if child.returncode:
            raise RuntimeError(f"{command[0]} ended with {child.returncode}: {said}")


def _end(folder: Path, kind: str, after_s: float, told: Tally, how: signal.Signals) -> bool:
    """End the commands, one after the other, after a time; whether they were still at work."""
    end = time.monotonic() + after_s
    for command in KINDS[kind].commands:
        child = _child(folder, kind, command)
        assert child.stdout is not None
        child.stdout.readline()  # it is up
        try:
            child.communicate(timeout=max(end - time.monotonic(), 0.001))
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, how)
            _, said = child.communicate()
            if how is signal.SIGINT and child.returncode == 0:
                continue  # it had just ended
            _count(folder, kind, child, said, told, how)
            return True
    return False


def _count(
    folder: Path, kind: str, child: subprocess.Popen[str], said: str, told: Tally, how: signal.Signals
) -> None:
    where = under_way(folder)
    told.kills += 1
    told.stages[where] += 1
    # the last moments of a process, after Python's own handlers, are the system's: -SIGINT, 130 in a shell
    if how is signal.SIGINT and (child.returncode not in (130, -how) or "Traceback" in said):
        told.badly += 1
        print(f"exit code {child.returncode}: {said}", file=sys.stderr)
    told.tell(f"{told.name} {told.kills}: {kind}, {where}")


# -- a full disk ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Faulty:
    """A command in which the disk fails, after others that are done, with limits of file sizes in bytes."""

    kind: str
    before: tuple[Command, ...]
    command: Command
    limits: tuple[int, ...]


FAULTY = (
    Faulty("film", (), ("camera",), (1000, 2300)),
    Faulty("film", (("camera",),), ("measure",), (20_000, 1_000_000, 450_000, 60_000)),
    Faulty("film", (("camera",), ("measure",), ("calibrate",)), ("review", "--clip"),
           (100_000, 500_000, 20_000, 1_000_000, 2_000_000)),
    Faulty("model", (), ("recalibrate",), (3000, 1000, 10_000, 100_000, 1_000_000)),
)  # fmt: skip
FAULTS, FEW = 60, 3  # writes at which the disk is full, one after the other; those of a quick run


def disk(quick: bool) -> dict[str, Any]:
    """How projects end after faults of the disk in one stage after the other."""
    tally: Counter[str] = Counter(dict.fromkeys(("faults", "same", "internal", "left", "half"), 0))
    with tempfile.TemporaryDirectory() as scratch:
        for kind in {faulty.kind for faulty in FAULTY}:
            KINDS[kind].make(Path(scratch) / kind)
        for place, faulty in enumerate(FAULTY):
            own = _faulty(faulty, Path(scratch) / faulty.kind, Path(scratch) / str(place), quick)
            print(f"{' '.join(faulty.command)}: {dict(own)}", file=sys.stderr, flush=True)
            tally.update(own)
    return {f"disk_{name}": count for name, count in tally.items()}


def _faulty(faulty: Faulty, first: Path, scratch: Path, quick: bool) -> Counter[str]:
    """One command of one project with one fault after the other, and then left alone."""
    whole, folder = (Path(shutil.copytree(first, scratch / name)) for name in ("whole", "faulty"))
    tally: Counter[str] = Counter()
    finish(whole, faulty.kind, (*faulty.before, faulty.command))
    finish(folder, faulty.kind, faulty.before)
    for number in range(1, (FEW if quick else FAULTS) + 1):
        with _no_space(number) as met:
            tally["internal"] += not _named(folder, faulty)
        if not met:
            break
        tally.update(faults=1, left=len(drafts(folder)), half=len(halves(folder)))
    for limit in faulty.limits[: 1 if quick else None]:
        child = _child(folder, faulty.kind, faulty.command, limit=limit)
        _, said = child.communicate()
        internal = child.returncode not in (0, 2) or "Traceback" in said
        if internal or (child.returncode == 2 and str(tempfile.gettempdir()) not in said):
            print(f"limit {limit}: {child.returncode} {said}", file=sys.stderr)
        tally.update(faults=1, internal=internal, left=len(drafts(folder)), half=len(halves(folder)))
    finish(folder, faulty.kind, (faulty.command,))
    apart = _apart(digests(folder), digests(whole))
    if apart:
        print(f"{' '.join(faulty.command)}{apart}", file=sys.stderr, flush=True)
    tally["same"] = tally["faults"] * (not apart)
    return tally


def _named(folder: Path, faulty: Faulty) -> bool:
    """Whether the command ended well, or in a fault of the disk that names its file."""
    try:
        run(folder, faulty.kind, faulty.command)
    except OSError as error:
        return error.filename is not None
    except Exception as error:
        print(f"{faulty.command}: {type(error).__name__}: {error}", file=sys.stderr)
        return False
    return True


@contextlib.contextmanager
def _no_space(number: int) -> Iterator[list[int]]:
    """The disk is full at the write of that number; the list says whether it came so far."""
    from twin import files

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


if __name__ == "__main__":
    _as_child(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), tuple(sys.argv[4:]))
