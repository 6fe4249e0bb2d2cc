"""Do the 95 % intervals of `twin predict` hold what was not filmed? Virtual films, with an effect or none.

    python benchmarks/foretelling.py [--quick] [--json] [--count N] [--workers N]

Every film hides something in a truth of another mesh and element (`diagnosis/snapshots.py`), by the library's
law or another, or nothing. What `twin diagnose` names is added, right or wrong, and the model foretells the
part of the course that it has not seen, by the code of `twin predict`: `rate`, a fast cycle after a slow one;
`orientation`, the finger hanging, where it was filmed upright and upside down; `beyond`, the top of the
pressure, where it was tested to 70 %. A pull is (true - foretold) / sd, of U1 and U3 of the markers along the
finger; `tip` is that of the tip's U3 at the highest pressure alone, one number a film. Where no model fits
there is no interval: such films are counted as silent. Models answer from tables (`diagnosis/reduced.py`).
Rows go to `benchmarks/results/foretelling.json` as they come; about five minutes of one core. --quick: a
tenth of the films, not written.
"""

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.collected import Rows
from benchmarks.diagnosis.identify import OTHER, SAME
from benchmarks.diagnosis.trialbench import (
    EVERY,
    START,
    Scene,
    Sight,
    Spec,
    beside,
    candidates,
    judged_of,
    rule,
    sized,
)

import numpy as np

from twin.bench.predicting import NORMAL, with_errors
from twin.diagnosis.procedure import diagnose
from twin.effects.protocol import Unsolvable
from twin.executors.local import Processes
from twin.judging.intervals import fit_record
from twin.targets import Array, Targets
from twin.virtual.protocols import CORNERS, TOP

ROWS = Rows("foretelling")
WANTED = (0.92, 0.97)
SIGMAS = 30.0  # of what is hidden
SEEN = 0.7  # of the top pressure, in `beyond`
ASKED = 0.25  # of the top pressure, from which on displacements are asked for
SLOW_S = next(t for t, share in CORNERS[4:] if share == 0.0)  # s, the end of the slow cycle
PROTOCOL = {"rate": "P3", "orientation": "P5", "beyond": "P3"}
SILENT = ("gravity", "marker_slip")  # no effect of the finger in P3; a marker that slips moves no finger


@dataclass(frozen=True)
class Film:
    """A film: what is foretold, what is hidden (nothing: ""), and its seed."""

    ask: str
    kind: str
    seed: int

    @property
    def key(self) -> str:
        """What names its row."""
        return f"{self.ask}/{self.kind or 'nothing'}/{self.seed}"


def films(count: int) -> list[Film]:
    """So many films, a third of them without an effect; all questions and kinds in turn."""
    kinds = [n for n in (*SAME, *OTHER) if EVERY[n].physics not in SILENT]
    out = []
    for k in range(count):
        ask = tuple(PROTOCOL)[k % len(PROTOCOL)]
        turn = k // len(PROTOCOL)
        kind = "" if turn % 3 == 0 else kinds[(turn - turn // 3 - 1) % len(kinds)]
        out.append(Film(ask, kind, 800_000 + k))
    return out


def foretold(film: Film) -> dict[str, Any]:
    """The row of a film: the share of intervals that hold, the rms of the pulls, and the tip's pull."""
    kinds = (film.kind,) if film.kind else ()
    spec = Spec("foretelling", PROTOCOL[film.ask], kinds, SIGMAS, "white", film.seed)
    scene, rng = Scene.of(spec), np.random.default_rng([film.seed, 11])
    hidden = tuple((EVERY[n], sized(Sight.of(scene), EVERY[n], SIGMAS, rng)[0]) for n in spec.kinds)
    own = scene.targets(hidden)
    asked, targets = _asked(film.ask, scene, own)
    model = scene.model(targets)
    row = {"key": film.key, "ask": film.ask, "kind": film.kind, "rule": rule()}
    try:
        said = diagnose(model, candidates(), targets, seed=film.seed, start=START,
                        beside=beside(model, ()), plan=False)  # fmt: skip
    except Unsolvable as error:
        return row | {"named": [], "held": None, "why": str(error)}
    judged = judged_of(said)
    record = fit_record(judged.fit, judged.comparison, law_error=judged.errors.law)
    row |= {"named": list(said.named), "adequate": record.adequate}
    if not record.adequate:
        return row | {"held": None}
    u, factors = with_errors(judged.model, record, targets, own, beyond=film.ask == "beyond")
    sd, m = np.sqrt((factors**2).sum(axis=0)), len(scene.rows)
    true = scene.true(hidden)[:, :m]  # what shows in the picture alone moves fixed markers, too
    true = true - true[judged.model.reference].mean(axis=0)
    pull = ((true - u[:, :m]) / sd[:, :m])[asked][:, : scene.protocol.along, ::2]
    tip = _tip(own.pressure[asked], pull[:, -1, 1])
    half = NORMAL * float(np.median(sd[asked][:, scene.protocol.along - 1, 2]))
    held, rms = float((np.abs(pull) <= NORMAL).mean()), float(np.sqrt((pull**2).mean()))
    return row | {"held": held, "pull_rms": rms, "tip": tip, "half_mm": half}


def _asked(ask: str, scene: Scene, own: Targets) -> tuple[Array, Targets]:
    """Which steps (s,) are foretold, and the targets without them."""
    high = own.pressure > ASKED * TOP
    if ask == "orientation":
        return high & (own.block == scene.protocol.held_out), own  # no fit sees it
    hidden = own.time > SLOW_S if ask == "rate" else own.pressure > SEEN * TOP
    return high & hidden, replace(own, valid=own.valid & ~hidden[:, None, None])


def _tip(pressure: Array, pull: Array) -> float:
    return float(pull[int(np.argmax(pressure))])


def attempted(film: Film) -> dict[str, Any]:
    """As `foretold`; a film that breaks is a row too, and no hit."""
    try:
        return foretold(film)
    except Exception as error:
        row = {"key": film.key, "ask": film.ask, "kind": film.kind, "named": [], "rule": rule()}
        why = f"failed: {type(error).__name__}: {error}"
        return row | {"held": 0.0, "pull_rms": np.inf, "tip": np.inf, "half_mm": 0.0, "why": why}


def told(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The figures of rows: films, those without an interval, shares of intervals that hold, of all
    displacements and of the tip's alone with its 95 % interval, and the root mean square of the pulls."""
    spoken = [row for row in rows if row["held"] is not None]
    if not spoken:
        return {"films": len(rows), "silent": len(rows)}
    return {
        "films": len(rows),
        "silent": len(rows) - len(spoken),
        "coverage": float(np.mean([row["held"] for row in spoken])),
        "tip": float(np.mean([abs(row["tip"]) <= NORMAL for row in spoken])),
        "pull_rms": float(np.sqrt(np.mean([row["pull_rms"] ** 2 for row in spoken]))),
        "half_mm": float(np.median([row["half_mm"] for row in spoken])),
    }


def table(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The figures of all rows, with an effect and without, of each question."""
    some = {"all": rows, "nothing hidden": [r for r in rows if not r["kind"]]}
    some |= {"an effect": [r for r in rows if r["kind"]]}
    some |= {ask: [r for r in rows if r["ask"] == ask] for ask in PROTOCOL}
    return {name: told(own) for name, own in some.items() if own}


def main() -> int:
    """Print the table; the exit code is 1 where the coverage is not within WANTED."""
    more = {"--count": (240, "films"), "--workers": (1, "processes")}
    typed = options(__doc__, more, quick="a tenth of them", json="one JSON line")
    wanted = films(typed.count)[:: 10 if typed.quick else 1]
    if typed.quick:
        rows = [attempted(film) for film in wanted]
    else:
        had = {row["key"] for row in ROWS.every()}
        tasks = [partial(attempted, film) for film in wanted if film.key not in had]
        for _, row in Processes(typed.workers).ended(tasks):
            ROWS.add(row)
            print(f"{row['key']}: {told([row])}", file=sys.stderr, flush=True)
        rows = [row for row in ROWS.every() if row["key"] in {f.key for f in wanted}]
    found = table(rows)
    if typed.json:
        print(json.dumps({"coverage_predict": found["all"]["coverage"], "foretelling": found}))
        return 0
    for name, own in found.items():
        print(f"{name:16s} " + "  ".join(f"{k} {v:.3g}" for k, v in own.items()))
    return int(not WANTED[0] <= found["all"]["coverage"] <= WANTED[1])


if __name__ == "__main__":
    sys.exit(main())
