"""Trials of `identify.py` again with whole finite-element solves, through the command line, and whether they
agree.

    python benchmarks/diagnosis/fullruns.py --folder DIR [--count 20]

The targets of a trial in P3 go into a project folder of the short finger; `twin calibrate`, `diagnose` and,
where one effect is named, `add` run on it. A trial agrees where both name the same effects. The rows of
results lie in DIR beside those of `identify.py`, which takes them into its table. Two to four minutes of one
core for each.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.bank import fitted_case
from benchmarks.diagnosis.identify import OTHER, SAME, UNKNOWN, seen_in
from benchmarks.diagnosis.snapshots import POINTS, SHORT
from benchmarks.diagnosis.trialbench import NAMES, TIP, Scene, Spec, run, sized

import numpy as np

from fe import Lattice
from twin.chain import stage_of
from twin.commands.init import run_init
from twin.model.structure import BuiltIn
from twin.project.folder import Project
from twin.project.targetwriting import write_targets
from twin.targets import Targets, as_position, at_node
from twin.virtual.hidden import KINDS

OWN = BuiltIn(SHORT, Lattice())


class Quiet:
    """A `say` that says nothing."""

    def __call__(self, text: str, /) -> None:
        del text

    def progress(self, stage: str, done: int, total: int, /) -> None:
        del stage, done, total


def specs(count: int) -> list[Spec]:
    """So many trials: nothing hidden, the library's laws, others, and unknown kinds in turn."""
    kinds = [(), *((n,) for n in seen_in("P3", SAME)), *((n,) for n in seen_in("P3", OTHER))]
    kinds += [(n,) for n in UNKNOWN if n not in ("force_side",)]
    order = np.random.default_rng(3).permutation(len(kinds))
    chosen = [kinds[order[k % len(order)]] for k in range(count)]
    return [
        Spec("full_fe", "P3", names, 30.0 if names else 0.0, "white", 70_000 + k)
        for k, names in enumerate(chosen)
    ]


def targets_of(spec: Spec) -> Targets:
    """The targets of a trial, the tip at its node."""
    scene, rng = Scene.of(spec), np.random.default_rng([spec.seed, 11])
    hidden = tuple((KINDS[n], sized(scene, KINDS[n], spec.sigmas, rng)[0]) for n in spec.kinds)
    found, case = scene.targets(hidden), fitted_case()
    at = int(np.linalg.norm(case.nodes - POINTS[TIP], axis=1).argmin())
    tip = at_node("tip", int(case.labels[at]), as_position(case.nodes[at]))
    return replace(found, points=tuple(tip if p.name == NAMES[TIP] else p for p in found.points))


def opened(folder: Path) -> Callable[[str], dict[str, Any]]:
    """What runs a command on the project of a folder, and gives what `--json` prints."""

    def command(name: str, /, **options: Any) -> dict[str, Any]:
        project = Project.open(folder, builtin=OWN)
        with project.lock(name):
            return stage_of(name).run(project, Quiet(), **options)

    return command


def trial(spec: Spec, folder: Path) -> dict[str, Any]:
    """One trial both ways."""
    reduced, began = run(spec), time.process_time()
    if not folder.exists():
        write_targets(folder.with_name(folder.name + "-targets"), targets_of(spec))
        run_init(folder, Quiet(), targets=folder.with_name(folder.name + "-targets"), nodes=())
    command = opened(folder)
    command("calibrate")
    said = command("diagnose")
    if len(said["named"]) == 1 and "cannot" not in said["verdict"]:
        command("add", name=None)
    names = list(dict.fromkeys([*said["named"], *(n for tie in said["ties"] for n in tie)]))
    row = {
        "key": spec.key, "group": "full_fe", "protocol": "P3", "kinds": list(spec.kinds),
        "physics": reduced["physics"],
        "wanted": spec.sigmas, "hidden": reduced["hidden"], "verdict": said["verdict"], "names": names,
        "named": said["named"], "reduced": reduced["verdict"], "reduced_names": reduced["names"],
    }  # fmt: skip
    row["agree"] = set(names[:1]) <= set(reduced["names"]) and set(reduced["names"][:1]) <= set(names)
    return row | {"full_seconds": time.process_time() - began}


def main() -> int:
    typed = options(__doc__, {
        "--folder": {"type": Path, "required": True},
        "--count": (20, "trials"),
    })  # fmt: skip
    file = typed.folder / "full_fe.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    have = len(file.read_text(encoding="utf-8").splitlines()) if file.exists() else 0
    for number, spec in enumerate(specs(typed.count)[have:], start=have):
        row = trial(spec, typed.folder / f"full-{number:02d}")
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")
        print(f"{spec.key:50s} {row['full_seconds']:5.0f} s  {row['verdict']} | {row['reduced']}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
