"""Truths by another engine, through the command line: does `twin diagnose` name what CalculiX has solved?

    python benchmarks/diagnosis/ccxdiagnosis.py --folder DIR [--only NAME ..] [--solve] [--list]

The short finger in 20-node bricks with reduced integration, two cells through every wall, on a lattice of its
own; the course and the edge's markers of P3 (of P4 where weight is hidden), noise of 0.03 mm. The targets go
through `twin init`, `calibrate`, `diagnose --json` and `add`. Every solve and every project is kept in DIR,
every row in `benchmarks/results/ccxdiagnosis.json`, so that the command goes on where it was stopped. In
`bare` nothing is hidden.
--solve: the solves alone, two minutes of one core for each of 30.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options, processor
from benchmarks.diagnosis.ccxbodies import BARE, NAMED, TRUTHS, Truth, bare_test, curves
from benchmarks.diagnosis.collected import Rows
from benchmarks.diagnosis.snapshots import SHORT
from benchmarks.diagnosis.trialbench import NAMES, Scene, Sight, in_verdict, seen_beside

import numpy as np
from scipy.interpolate import CubicSpline

from twin.project.targetwriting import write_targets
from twin.targets import Array, PointKind, TargetPoint, Targets, as_position
from twin.virtual.draws import Setup, measured
from twin.virtual.protocols import PROTOCOLS, TOP, Protocol

SEED, SETUP = 80_000, Setup(sd_mm=0.03, placement_sd_mm=0.02)
EDGE = [NAMES.index(name) for name in ("p1", "p3", "p5", "p6", "tip")]
END = "end"  # the tip, whose name is a node of the built-in finger
DIMENSIONS = f"[model.finger]\nlength_mm = {SHORT.length!r}\npleats = {SHORT.bellows}\n\n"
TWIN = (sys.executable, "-c", "from twin.main import start; start()")


@dataclass(frozen=True)
class Trial:
    """One truth as it is measured; its solves lie in a folder."""

    truth: Truth
    folder: Path

    @property
    def protocol(self) -> Protocol:
        """P4 where weight is hidden, which a single orientation tells from nothing; else P3."""
        return PROTOCOLS["P4" if self.truth.weighs else "P3"]

    @property
    def scene(self) -> Scene:
        """The same in the virtual laboratory."""
        return Scene(self.protocol, EDGE, SETUP, SEED + [t.name for t in TRUTHS].index(self.truth.name))

    def solved(self, truth: Truth) -> Array:
        """The curves (w, k, m, 3) mm of a truth at the markers."""
        return curves(truth, self.folder)[:, :, EDGE]

    @cached_property
    def u(self) -> Array:
        """True displacements (s, m, 3) mm."""
        return along(self.solved(self.truth), self.protocol)

    def targets(self) -> Targets:
        """One draw of what would be measured, at the truth's own nodes."""
        places = bare_test().points[EDGE]
        points = [
            TargetPoint(NAMES[k], PointKind.PLACE, None, as_position(at))
            for k, at in zip(EDGE, places, strict=True)
        ]
        slope = along(self.solved(self.truth), self.protocol, 1)
        found = measured(self.protocol, self.u, slope, points=points, setup=SETUP, seed=self.scene.seed)
        end = TargetPoint(END, PointKind.UNKNOWN, None, None)
        return replace(found, points=tuple(end if p.name == "tip" else p for p in found.points))

    def hidden(self) -> list[dict[str, Any]]:
        """Non-centralities of its parts, each alone and beside the other, by this engine's own changes."""
        sight, bare = Sight.of(self.scene), along(self.solved(BARE), self.protocol)
        parts = [NAMED[name] for name in self.truth.parts] or [self.truth]
        changes = [sight.left(along(self.solved(part), self.protocol) - bare) for part in parts]
        return [
            {"name": part.name, "sigmas": float(np.linalg.norm(z)), "beside": left}
            for part, z, left in zip(parts, changes, seen_beside(changes), strict=True)
        ]


def along(curves: Array, protocol: Protocol, derivative: int = 0) -> Array:
    """Values (s, m, 3), or their slopes by pressure, of curves (w, k, m, 3) over equal steps of pressure,
    along the course of a protocol."""
    p = protocol.course.at_output()
    way = protocol.block if len(curves) > 1 else np.zeros(len(p), np.int64)
    grid, out = TOP * np.linspace(0, 1, curves.shape[1]), np.empty((len(p), *curves.shape[2:]))
    for k, curve in enumerate(curves):
        out[way == k] = CubicSpline(grid, curve)(p[way == k], derivative)
    return out


def twin(command: str, *words: str) -> dict[str, Any]:
    """What a command prints as JSON; RuntimeError with its own words where it fails."""
    done = subprocess.run(
        [*TWIN, command, *words, "--json"],
        capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"twin {command}: {done.stderr.strip()[-500:]}")
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def project(trial: Trial, folder: Path) -> None:
    """Make the project of a trial by `twin init`, with the dimensions of the short finger; one that was made
    goes on where it was stopped."""
    toml = folder / "twin.toml"
    if toml.exists() and DIMENSIONS in toml.read_text(encoding="utf-8"):
        return
    targets = folder.with_name(f"{folder.name}-targets")
    for old in (folder, targets):
        shutil.rmtree(old, ignore_errors=True)
    write_targets(targets, trial.targets())
    x, y, z = bare_test().points[EDGE[-1]]
    twin("init", str(folder), "--targets", str(targets), "--node", f"{END}={x:.9g},{y:.9g},{z:.9g}")
    text = toml.read_text(encoding="utf-8")
    toml.write_text(text.replace("[calibrate]", f"{DIMENSIONS}[calibrate]", 1), encoding="utf-8")


def row(trial: Trial, folder: Path) -> dict[str, Any]:
    """One trial, from solves to verdict."""
    truth = trial.truth
    hidden = trial.hidden()
    project(trial, folder)
    cache, shared = folder / "cache", folder.parent / "cache"
    if shared.exists() and not cache.exists():
        shutil.copytree(shared, cache)
    began = processor()
    twin("calibrate", "--project", str(folder))
    shutil.copytree(cache, shared, dirs_exist_ok=True)
    middle = processor()
    said = twin("diagnose", "--project", str(folder))
    seconds = {"calibrate": middle - began, "diagnose": processor() - middle}
    return {
        "key": truth.name, "group": "ccx", "protocol": trial.protocol.name, "kinds": [truth.name],
        "physics": list(truth.physics) or [""], "hidden": hidden, "verdict": said["verdict"],
        "named": said["named"], "ties": said["ties"], "names": in_verdict(said),
        "seconds": sum(seconds.values()), "stages": seconds, "add": added(said, folder),
    }  # fmt: skip


def added(said: dict[str, Any], folder: Path) -> str:
    """What `twin add` makes of a verdict: `added`, its own words where it refuses, or nothing to add."""
    if not said["named"]:
        return ""
    try:
        twin("add", "--project", str(folder))
    except RuntimeError as error:
        return str(error)
    return "added"


def chosen(names: Sequence[str]) -> list[Truth]:
    """The truths of these names, all of them where there is none."""
    if unknown := set(names) - {t.name for t in TRUTHS}:
        raise SystemExit(f"--only {min(unknown)}: wanted some of {', '.join(t.name for t in TRUTHS)}")
    return [t for t in TRUTHS if not names or t.name in names]


def main() -> int:
    typed = options(__doc__, {
        "--folder": {"type": Path, "required": True},
        "--only": {"nargs": "*", "default": [], "help": "names of truths"},
        "--solve": "solve what is not solved, and no more",
        "--list": "names of the truths",
    })  # fmt: skip
    kept, truths = Rows("ccxdiagnosis"), chosen(typed.only)
    if typed.list:
        print("\n".join(t.name for t in truths))
        return 0
    for truth in dict.fromkeys((BARE, *truths)):
        began = processor()
        curves(truth, typed.folder / "solves")
        if (spent := processor() - began) > 1:
            print(f"{truth.name:28s} solved in {spent / 60:.1f} min", flush=True)
    for truth in () if typed.solve else truths:
        if not kept.has(truth.name):
            found = row(Trial(truth, typed.folder / "solves"), typed.folder / truth.name)
            kept.add(found)
            told = f"{found['seconds'] / 60:5.1f} min, {found['hidden'][0]['sigmas']:4.0f} sd"
            print(f"{truth.name:28s} {told}  {found['verdict']}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
