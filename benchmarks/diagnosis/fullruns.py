"""Trials of `identify.py` again with whole finite-element solves, through the command line, and whether they
agree.

    python benchmarks/diagnosis/fullruns.py --folder DIR [--protocols P3 P5] [--finger short] [--count 20]

The targets of a trial go into a project folder of the short finger; `twin calibrate`, `diagnose` and, where
something is named, `add` run on it. A trial agrees where whole solves and tables name the same on the same
targets. With --finger default the same is hidden, as plainly, in the default finger, by
`twin virtual`: other targets, for which there are no tables; what agrees are verdicts on alike trials, and
the truth is scored beside it. Rows go to `benchmarks/results/full_fe.json` as they come, so that the command
goes on where it was stopped.
"""

import json
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options, processor
from benchmarks.diagnosis.bank import fitted_case
from benchmarks.diagnosis.collected import Rows
from benchmarks.diagnosis.identify import OTHER, SAME, UNKNOWN, seen_in
from benchmarks.diagnosis.snapshots import POINTS, SHORT
from benchmarks.diagnosis.tally import named
from benchmarks.diagnosis.trialbench import EVERY, NAMES, TIP, Scene, Sight, Spec, run, sized

import numpy as np

from fe import Lattice
from twin.chain import stage_of
from twin.commands.init import run_init
from twin.commands.virtual import run_virtual
from twin.gravity import TONNE_PER_MM3
from twin.model.structure import BuiltIn
from twin.project.folder import Project
from twin.project.targetwriting import write_targets
from twin.targets import Targets, as_position, at_node
from twin.virtual.truthsolves import DENSITY

OWN = BuiltIn(SHORT, Lattice())


class Quiet:
    """A `say` that says nothing."""

    def __call__(self, text: str, /) -> None:
        del text

    def progress(self, stage: str, done: int, total: int, /) -> None:
        del stage, done, total


def specs(protocol: str, count: int) -> list[Spec]:
    """So many trials: nothing hidden, the library's laws, others, and unknown kinds in turn."""
    own = [n for n in (*SAME, *OTHER) if protocol == "P5" or n != "gravity"]
    kinds = [(), *((n,) for n in seen_in(protocol, own))]
    kinds += [(n,) for n in UNKNOWN if protocol == "P5" or n != "force_side"]
    order, first = np.random.default_rng(3).permutation(len(kinds)), 70_000 + 1000 * (protocol == "P5")
    chosen = [kinds[order[k % len(order)]] for k in range(count)]
    return [
        Spec("full_fe", protocol, names, 30.0 if names else 0.0, "white", first + k)
        for k, names in enumerate(chosen)
    ]


def targets_of(spec: Spec) -> Targets:
    """The targets of a trial, the tip at its node."""
    scene, rng = Scene.of(spec), np.random.default_rng([spec.seed, 11])
    sight = Sight.of(scene)
    hidden = tuple((EVERY[n], sized(sight, EVERY[n], spec.sigmas, rng)[0]) for n in spec.kinds)
    found, case = scene.targets(hidden), fitted_case()
    at = int(np.linalg.norm(case.nodes - POINTS[TIP], axis=1).argmin())
    tip = at_node("tip", int(case.labels[at]), as_position(case.nodes[at]))
    return replace(found, points=tuple(tip if p.name == NAMES[TIP] else p for p in found.points))


def opened(folder: Path, own: BuiltIn | None = OWN) -> Callable[..., dict[str, Any]]:
    """What runs a command on the project of a folder, and gives what `--json` prints."""

    def command(name: str, /, **options: Any) -> dict[str, Any]:
        project = Project.open(folder, builtin=own) if own else Project.open(folder)
        with project.lock(name):
            return stage_of(name).run(project, Quiet(), **options)

    return command


def made(spec: Spec, folder: Path, finger: str) -> None:
    """Make the project of a trial, where it is not there."""
    if folder.exists():
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    if finger == "default":
        folder.with_name(f"{folder.name}.truth.json").unlink(missing_ok=True)
        run_virtual(folder, Quiet(), protocol=spec.protocol, hide=spec.kinds, sigmas=spec.sigmas or None,
                    noise=spec.noise, placement_mm=0.02, seed=spec.seed)  # fmt: skip
        return
    targets = folder.with_name(f"{folder.name}-targets")
    if not targets.exists():
        write_targets(targets, targets_of(spec))
    density = DENSITY / TONNE_PER_MM3 if spec.protocol == "P5" else None
    run_init(folder, Quiet(), targets=targets, density_kg_m3=density)


def trial(spec: Spec, folder: Path, finger: str) -> dict[str, Any]:
    """One trial both ways; the tables know the short finger alone."""
    reduced, began = run(spec), processor()
    made(spec, folder, finger)
    command = opened(folder, OWN if finger == "short" else None)
    prepared = processor()
    command("calibrate")
    calibrated = processor()
    said = command("diagnose")
    diagnosed = processor()
    if said["named"] and "cannot" not in said["verdict"]:
        command("add")
    cost = np.diff([began, prepared, calibrated, diagnosed, processor()])
    names = list(dict.fromkeys([*said["named"], *(n for tie in said["ties"] for n in tie)]))
    row = {key: reduced[key] for key in ("kinds", "physics", "laws", "wanted", "hidden")} | {
        "key": key_of(spec, finger), "group": "full_fe", "finger": finger, "protocol": spec.protocol,
        "verdict": said["verdict"], "names": names, "named": said["named"], "ties": said["ties"],
        "reduced": reduced["verdict"], "reduced_names": reduced["names"], "full_seconds": float(cost.sum()),
        "seconds": dict(zip(("made", "calibrate", "diagnose", "add"), map(float, cost), strict=True)),
    }  # fmt: skip
    if finger == "default":
        row["hidden"] = sealed(folder)
    return row | {"agree": agree(row, reduced)}


def sealed(folder: Path) -> list[dict[str, Any]]:
    """What `twin virtual` has hidden."""
    truth = json.loads(folder.with_name(f"{folder.name}.truth.json").read_text(encoding="utf-8"))
    plain = truth["non_centrality"]
    return [
        {"name": h["name"], "size": h["size"], "sigmas": plain.get(h["name"], 0.0)} for h in truth["hidden"]
    ]


def agree(full: dict[str, Any], reduced: dict[str, Any]) -> bool:
    """Whether two verdicts name the same; where neither names anything, whether they say the same."""
    if named(full) or named(reduced):
        return named(full) == named(reduced)
    return bool(full["verdict"].partition(":")[0] == reduced["verdict"].partition(":")[0])


def key_of(spec: Spec, finger: str) -> str:
    """What names a trial in the file of results."""
    return f"{finger}/{spec.key}"


def main() -> int:
    typed = options(__doc__, {
        "--folder": {"type": Path, "required": True},
        "--protocols": {"nargs": "+", "default": ("P3", "P5"), "choices": ("P3", "P5")},
        "--finger": {"default": "short", "choices": ("short", "default"), "help": "which finger"},
        "--count": (20, "trials of each protocol"),
    })  # fmt: skip
    kept = Rows("full_fe")
    for protocol in typed.protocols:
        for number, spec in enumerate(specs(protocol, typed.count)):
            if kept.has(key_of(spec, typed.finger)):
                continue
            row = trial(spec, typed.folder / f"{typed.finger}-{protocol}-{number:02d}", typed.finger)
            kept.add(row)
            same = f"{row['full_seconds'] / 60:5.1f} min, {'same' if row['agree'] else 'other'}"
            print(f"{spec.key:50s} {same}: {row['verdict']} | {row['reduced']}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
