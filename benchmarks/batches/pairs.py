"""What two castings differ in: how often the nearest set of `twin compare A B` holds it, in virtual pairs.

    python benchmarks/batches/pairs.py [--quick] [--json] [--to FILE] [--workers N]

A pair is two films of the short finger (P5, or P3 without weight) with noise, markers and a gauge of their
own. Truths are of another mesh and element, as in `benchmarks/diagnosis/identify.py`; the second finger
differs by one thing: constants, walls, an effect that both have or that the first does not have, the gauge or
the camera, in the library's law or another. The first film is fitted, the second asked. A difference counts
where it is 8 sd or more beside what the first fit left uncertain. Some five seconds of one core a pair.
--quick: a quarter of them, not written.
"""

import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis.kindsbetween import BETWEEN
from benchmarks.diagnosis.tally import CLEAR, rate
from benchmarks.diagnosis.trialbench import START, Scene, Spec, candidates, commit

import numpy as np

from twin.batches.differences import SecondFilm, differing
from twin.effects.library import effect
from twin.effects.shape import WallThickness
from twin.executors.local import Processes, current, using
from twin.judging.judged import judge
from twin.targets import Array
from twin.virtual.hidden import KINDS

TABLE = ROOT / "benchmarks" / "results" / "pairs.json"
EVERY = KINDS | BETWEEN
SIZES = (0.3, 0.6, 1.0)  # of the largest size of a kind
ONE = (  # kinds by which the second finger alone differs
    "harder", "wall_thickness", "swollen_core", "other_share", "creep", "pressure_gain", "camera_scale",
    "eccentric_core", "wall_taper", "clamp", "pressure_offset", "camera_rotation", "precurvature",
    "pressure_lag", "strain_limiting_layer", "hoop_reinforcement", "log_creep", "tilted_core", "bent_gauge",
    "half_layer", "camera_tilt", "time_shift", "mullins", "tube",
)  # fmt: skip
BOTH = {"creep": 0.03, "clamp": 4e-4, "wall_taper": 0.3}  # in both fingers, more of it in the second


@dataclass(frozen=True)
class Pair:
    """A pair: its protocol, the kind that the second finger differs in, its size over the largest (0: none),
    how much of it the first one has, and the seed."""

    protocol: str
    kind: str
    size: float
    first: float
    seed: int

    @property
    def key(self) -> str:
        """What names it."""
        return f"{self.protocol}/{self.kind}/{self.size:g}/{self.first:g}/{self.seed}"


def pairs() -> list[Pair]:
    """All pairs: of P5, of P3, of an effect that both have, and of fingers that are alike."""
    out = []
    for k, name in enumerate(ONE):
        out.append(Pair("P5", name, SIZES[k % 3], 0.0, 100 + k))
        out.append(Pair("P5", name, -SIZES[(k + 1) % 3], 0.0, 200 + k))
        if k < 12:
            out.append(Pair("P3", name, SIZES[(k + 2) % 3], 0.0, 300 + k))
    out += [
        Pair("P5", name, size, first, 400 + k)
        for k, (name, first) in enumerate(BOTH.items())
        for size in SIZES
    ]
    return [*out, *(Pair("P5", "harder", 0.0, 0.0, 500 + k) for k in range(12))]


def asked(pair: Pair) -> dict[str, Any]:
    """The row of results of a pair."""
    began, kind = time.process_time(), EVERY[pair.kind]
    spec = Spec("pairs", pair.protocol, (), 0.0, "white", pair.seed)
    one = Scene.of(spec)
    other = replace(one, seed=pair.seed + 10_000)
    low, high = kind.range
    size = pair.size * (high if pair.size > 0 or low == 0.0 else -low) * (1 if low else np.sign(pair.size))
    hidden = ((kind, pair.first),) if pair.first else ()
    more = ((kind, pair.first + size * (1.0 if not pair.first else 0.5)),) if pair.size else hidden
    have = [effect(kind.physics)] if pair.first else []
    fit = _fitted(one, hidden, have)
    targets = other.targets(more)
    model = other.model(targets)
    for e in have:
        model = model.with_effect(e)  # type: ignore[assignment]
    values, covariance = fit.values, fit.fit.covariance
    effects = (*candidates(), WallThickness())
    found = differing(model, values, covariance, targets, effects)
    asks = SecondFilm.of(model, values, covariance, targets)
    z = asks.whitener.whiten(
        _moved(other, more, targets.value.shape) - _moved(other, hidden, targets.value.shape)
    )
    return {
        "key": pair.key, "commit": commit(), "physics": kind.physics if pair.size else "", "law": kind.law,
        "sigmas": float(np.linalg.norm(z)), "proven": found.proven, "adequate": found.before.adequate,
        "nearest": [d.name for d in found.nearest], "words": [d.words for d in found.nearest],
        "ranking": [[d.name, round(d.evidence, 1), d.adequate] for d in found.ranking],
        "seconds": time.process_time() - began,
    }  # fmt: skip


def _fitted(scene: Scene, hidden: Any, have: Sequence[Any]) -> Any:
    """The first film's fit, with the effects that its model has."""
    targets = scene.targets(hidden)
    model, start = scene.model(targets), dict(zip(("C10", "C01"), START, strict=True))
    for e in have:
        model = model.with_effect(e)  # type: ignore[assignment]
        start |= {
            p.name: p.null + p.step if p.null is not None else (p.low * p.high) ** 0.5 for p in e.parameters
        }
    return judge(model, targets, starts=model.theta(start))


def _moved(scene: Scene, hidden: Any, shape: tuple[int, ...]) -> Array:
    """True displacements (s, p, 3) mm relative to the reference, 0 of fixed markers."""
    u, out = scene.true(hidden), np.zeros(shape)
    u = u[:, : len(scene.rows)]
    out[:, : u.shape[1]] = u - u[scene.targets(()).reference].mean(axis=0)
    return out


def told(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The table of rows: of clear differences how often the nearest set holds it, and it is first; of fingers
    that are alike how often one is told."""
    own = [r for r in rows if r["physics"] and r["sigmas"] >= CLEAR]
    alike = [r for r in rows if not r["physics"]]
    in_nearest = [r["physics"] in r["nearest"] for r in own]
    names = [len(r["nearest"]) for r in own if r["nearest"]]
    first = [r["nearest"][:1] == [r["physics"]] for r in own]
    of_law: dict[str, list[bool]] = {}
    for row, hit in zip(own, in_nearest, strict=True):
        of_law.setdefault(row["law"], []).append(hit)
    return {
        "n": len(own), "in_nearest": rate(in_nearest), "first": rate(first),
        "by_law": {law: rate(hits) for law, hits in of_law.items()},
        "names": float(np.mean(names)) if names else None,
        "alike": rate([r["proven"] for r in alike]), "too_faint": len(rows) - len(own) - len(alike),
        "missed": {r["key"]: r["ranking"][:3] for r, hit in zip(own, in_nearest, strict=True) if not hit},
        "seconds": float(np.median([r["seconds"] for r in rows])) if rows else None, "commit": commit(),
    }  # fmt: skip


def main() -> int:
    more = {"--to": (str, "a file for the table"), "--workers": (1, "processes")}
    typed = options(__doc__, more, quick="a quarter of the pairs; nothing is written", json="as JSON")
    todo, rows = pairs()[:: 4 if typed.quick else 1], []
    with using(Processes(typed.workers)):
        for _, row in current().ended([partial(asked, pair) for pair in todo]):
            rows.append(row)
            if not typed.json:
                about = f"{row['key']:40s} {row['sigmas']:7.1f} sd {row['seconds']:5.1f} s"
                print(f"{about}  {', '.join(row['nearest'])}", flush=True)
    table = told(rows)
    if typed.to or not typed.quick:
        Path(typed.to or TABLE).write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(table, indent=None if typed.json else 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
