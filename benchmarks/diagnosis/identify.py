"""How often is the diagnosis right? Virtual trials on the short finger, with intervals.

    python benchmarks/diagnosis/identify.py [--quick] [--json] [--folder DIR] [--only GROUP ..] [--share K/N]
        [--workers N] [--cluster WHERE] [--to FILE]

Every trial hides something of a stated non-centrality in a truth of another mesh and element
(`snapshots.py` beside it), draws noise and markers, and runs `twin.diagnosis.procedure.diagnose` on a model
that looks its answers up in tables of the fitted mesh (`bank.py`). Groups `fresh ..` have seeds that no rule
was made on, `left out` the unknown kinds without the stand-ins of their kind, `later` the kinds
in the folder `kinds`. Results go to a file as they come (--folder), so that the command goes on where it was
stopped; those of another rule are run again. The table is written to `benchmarks/results/identify.json`.
--quick: a tenth of the trials, as many as four minutes hold, not written. A table states the commits of the
code that decided; --to writes one of the groups of --only.
"""

import json
import os
import platform
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import combinations
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis import bodyfilms
from benchmarks.diagnosis.laterkinds import KINDS_LATER, STAND_INS_LATER
from benchmarks.diagnosis.tally import CLEAR, summary
from benchmarks.diagnosis.trialbench import (
    EVERY,
    Scene,
    Sight,
    Spec,
    attempted,
    cosine,
    largest,
    rule,
    run,
)

import numpy as np

from twin.executors.clusters import on_cluster
from twin.executors.local import Processes, current, using
from twin.targets import Array
from twin.virtual.hidden import KINDS, Kind

TABLE = ROOT / "benchmarks" / "results" / "identify.json"
PLAIN = (10.0, 30.0, 100.0)  # sizes at which an effect ought to be named
FAINT = (3.0, 5.0)  # and at which it need not be: the foot of the power curve
GRAVITY = ("gravity",)
FORCES = ("force_up", "force_down", "force_side")
ALIKE = 0.95  # cosine of two effects that no data of a protocol tell apart
COUNTS = {"P5": 150, "P3": 60, "P1": 60}  # of each law
FRESH = 10**6  # what is added to the seeds that no rule was made on
QUICK_S = 240.0  # after which --quick begins no other trial
STAND_INS_OF = {  # of unknown kinds: kinds of stand-ins, whole names, or how they begin, with an underscore
    "force_up": ("outside force",),
    "force_down": ("outside force",),
    "force_side": ("outside force",),
    "soft_band": ("soft spot",),
    "leak": ("pressure course", "pressure_by_"),
    "backlash": ("pressure course", "pressure_by_"),
    "sliding": ("drift",),
    "barrel": ("camera",),
    "zoomed": ("camera",),
    "loose_clamp": ("play",),
    **STAND_INS_LATER,
}


def of_law(law: str, kinds: Mapping[str, Kind] = KINDS) -> list[str]:
    """The kinds of a law."""
    return [k.name for k in kinds.values() if k.law == law]


SAME, OTHER, UNKNOWN = map(of_law, ("same", "other", "unknown"))


def specs() -> list[Spec]:
    """All trials, those of every group spread evenly, so that a part of them is a fair part."""
    groups: list[list[Spec]] = []
    for protocol, count in COUNTS.items():
        for law, names in (("same", SAME), ("other", OTHER)):
            seen = seen_in(protocol, [n for n in names if protocol == "P5" or n not in GRAVITY])
            groups.append(_trials(f"{protocol} {law}", protocol, seen, PLAIN, count))
            if protocol == "P5":
                groups.append(_trials(f"{protocol} {law}", protocol, seen, FAINT, 2 * len(seen), first=5000))
                groups.append(_trials(f"fresh {law}", protocol, seen, PLAIN, 100, first=1000 + FRESH))
    groups.append([Spec("white", "P5", (), 0.0, "white", 10_000 + s) for s in range(400)])
    groups.append([Spec("ar1", "P5", (), 0.0, "ar1", 20_000 + s) for s in range(400)])
    groups.append(_trials("unknown", "P5", UNKNOWN, PLAIN, 20 * len(UNKNOWN), first=30_000))
    left = _trials("left out", "P5", UNKNOWN, PLAIN, 10 * len(UNKNOWN), first=30_000)
    groups.append(without_stand_ins(left))
    groups.append(_trials("fresh unknown", "P5", UNKNOWN, PLAIN, 10 * len(UNKNOWN), first=30_000 + FRESH))
    groups += [_pairs("pairs", 120, 40_000, 5), _pairs("fresh pairs", 40, 40_000 + FRESH, 6)]
    return spread([*groups, *later(), *bodyfilms.films()])


def later() -> list[list[Spec]]:
    """The groups of the kinds that were written after the rule was frozen."""
    names, unknown = list(KINDS_LATER), of_law("unknown", KINDS_LATER)
    all_ = _trials("later", "P5", names, PLAIN, 12 * len(names), first=50_000 + FRESH)
    left = [s for s in all_ if s.kinds[0] in unknown]
    return [all_, without_stand_ins([replace(s, group="later left out") for s in left])]


def spread(groups: Iterable[Sequence[Spec]]) -> list[Spec]:
    """All trials in one list, those of every group as evenly as can be."""
    some = [g for g in groups if g]
    total = max(map(len, some), default=0)
    placed = [(k * total / len(g), j, spec) for j, g in enumerate(some) for k, spec in enumerate(g)]
    return [spec for _, _, spec in sorted(placed, key=lambda row: row[:2])]


def without_stand_ins(trials: Iterable[Spec]) -> list[Spec]:
    """The trials without the stand-ins of the kind that is hidden."""
    return [replace(s, without=(*s.without, *STAND_INS_OF[s.kinds[0]])) for s in trials]


def seen_in(protocol: str, names: Sequence[str]) -> list[str]:
    """The kinds that a protocol can show plainly at their largest size."""
    several = [n for n in names if n != "marker_slip" or _sight(protocol).scene.protocol.along > 1]
    return [n for n in several if np.linalg.norm(_largest(protocol, n)) >= CLEAR]


@cache
def _sight(protocol: str) -> Sight:
    return Sight.of(Scene.of(Spec("", protocol, (), 0.0, "white", 2)))


@cache
def _largest(protocol: str, name: str) -> Array:
    return largest(_sight(protocol), EVERY[name])


def _trials(
    group: str, protocol: str, names: Sequence[str], sizes: Sequence[float], count: int, *, first: int = 1000
) -> list[Spec]:
    """So many trials of a group, kinds and sizes in turn."""
    out = []
    for k in range(count):
        name = names[k % len(names)]
        size = sizes[(k // len(names) + k) % len(sizes)]
        noise = "white" if k % 2 else "ar1"
        without = ("tube",) if name in FORCES else ()
        out.append(Spec(group, protocol, (name,), size, noise, first + k, without))
    return out


def _pairs(group: str, count: int, first: int, seed: int) -> list[Spec]:
    """Pairs of effects of which neither does the other's work: where their changes, beside the constants,
    have a cosine below ALIKE, and each is clear beside the other at the size that is asked for."""
    rng, out = np.random.default_rng(seed), []
    able = [n for n in seen_in("P5", SAME) if n not in ("gravity", "clamp")]
    both = {frozenset(pair): cosine(*(_largest("P5", n) for n in pair)) for pair in combinations(able, 2)}
    while len(out) < count:
        pair = tuple(able[k] for k in rng.choice(len(able), 2, replace=False))
        sigmas, alike = (30.0, 100.0)[len(out) % 2], both[frozenset(pair)]
        least = min(sigmas, *(float(np.linalg.norm(_largest("P5", n))) for n in pair))
        if alike < ALIKE and least * np.sqrt(1 - alike**2) >= CLEAR:
            out.append(Spec(group, "P5", pair, sigmas, "white", first + len(out)))
    return out


def done(folder: Path) -> list[dict[str, Any]]:
    """The results in a folder by today's rule, one a line of its files; a line that was cut off is none."""
    rows = []
    for file in sorted(folder.glob("*.jsonl")):
        for line in file.read_text(encoding="utf-8").splitlines():
            if line.endswith("}"):
                rows.append(json.loads(line))
    return [row for row in rows if row.get("rule") == rule()]


def how(spec: Spec) -> Callable[[Spec], dict[str, Any]]:
    """What runs a trial: of another body whole solves, else the tables of the short finger."""
    return bodyfilms.run if spec.group.startswith(bodyfilms.GROUP) else run


def ran(todo: Sequence[Spec], file: Path, *, until: float, tell: bool) -> Iterable[dict[str, Any]]:
    """The rows of trials as they end, each written to a file; none is waited for after `until`."""
    with file.open("a", encoding="utf-8") as out:
        for k, (_, row) in enumerate(current().ended([partial(attempted, s, how(s)) for s in todo])):
            out.write(json.dumps(row) + "\n")
            out.flush()
            if tell:
                print(f"{k + 1:5d} {row['key']:58s} {row['seconds']:5.1f} s  {row['verdict']}", flush=True)
            yield row
            if time.perf_counter() > until:
                return


def main() -> int:
    began = time.perf_counter()
    typed = options(__doc__, {
        "--folder": (Path(tempfile.gettempdir()) / "softtwin-identify", "where results are kept"),
        "--only": {"nargs": "*", "default": (), "help": "groups, such as 'P5 same'"},
        "--share": ("1/1", "which part of the trials to run: 1/2, 2/2"),
        "--workers": (1, "processes"),
        "--cluster": (str, "instead: tcp://HOST:8786, scheduler.json, slurm.toml"),
        "--to": (str, "a file for the table of a part of the groups"),
        "--table": "run nothing; make the table of what is there",
    }, quick="a tenth of the trials; nothing is written", json="print the table as JSON")  # fmt: skip
    folder: Path = typed.folder
    folder.mkdir(parents=True, exist_ok=True)
    part, parts = map(int, typed.share.split("/"))
    wanted = [s for s in specs() if not typed.only or s.group in typed.only]
    wanted = wanted[:: 10 if typed.quick else 1]
    rows = done(folder)
    have = {row["key"] for row in rows}
    todo = [] if typed.table else [s for s in wanted[part - 1 :: parts] if s.key not in have]
    name = f"{part}of{parts}-{'-'.join(typed.only) or 'all'}.jsonl".replace(" ", "_")
    until = began + QUICK_S if typed.quick else np.inf
    with using(Processes(typed.workers)), on_cluster(typed.cluster or "", _said):
        rows += ran(todo, folder / name, until=until, tell=not typed.json)
    table = tabulated(wanted, rows)
    table["seconds"]["of_this_run"] = time.perf_counter() - began
    if typed.to or not (typed.quick or typed.only):
        file = Path(typed.to) if typed.to else TABLE
        file.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(table, indent=None if typed.json else 1))
    return 0


def _said(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def tabulated(wanted: Sequence[Spec], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The table of the trials that were wanted."""
    keys = {s.key for s in wanted}
    own = {row["key"]: row for row in rows if row["key"] in keys}
    table = summary(list(own.values()))
    table["planned"] = len(wanted)
    table["commits"] = dict(Counter(row.get("commit", "") for row in own.values()))
    table["commit"] = " ".join(table["commits"])
    table["rules"] = dict(Counter(row["rule"] for row in own.values()))
    table["versions"] = {"python": platform.python_version(), "numpy": np.__version__}
    return table


if __name__ == "__main__":
    sys.exit(main())
