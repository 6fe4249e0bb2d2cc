"""How far is a model's response off, in units of the error that it states? Against whole solves.

    python benchmarks/diagnosis/response.py [--quick] [--json] [--only NAME ..]

For every effect: the response of the base model's solve and the effect's tangents, then with one whole solve
at random constants and sizes more; asked at random constants and sizes beside it. The pull is the root mean
square of what it is off over what it states, the first without that solve. Short finger (coarse mesh) and the
default one, on a film with holds and a way down. Written to `benchmarks/results/response.json`.
"""

import json
import os
import sys
import time
from dataclasses import replace
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.collected import RESULTS
from benchmarks.diagnosis.snapshots import SHORT

import numpy as np

from calibrate import Parameter
from fe import Finger, Lattice
from twin import virtual
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Effect, Unsolvable
from twin.model.basemodel import base_model
from twin.model.memo import KeptModel
from twin.model.response import Surrogate
from twin.model.structure import base_case
from twin.targets import Array

FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 30.0), (12.0, 30.0), (12.4, 0.0), (22.0, 0.0))  # s, kPa
WHOLE = ((0.0, 0.0), (2.0, 0.0), (4.0, 15.0), (12.0, 15.0), (12.4, 0.0), (22.0, 0.0))
CONSTANTS = np.array([0.214, 0.083])
DEFAULT = ("stiffening", "creep", "tube", "pressure_lag", "clamp")  # on the default finger
LEFT_OUT = ("contact", "gravity")  # not smooth; this film is in one direction
SPREAD, NEAR = 0.1, 0.3  # of the constants, 1 sd; and how far from the whole solve it is asked, as a share


def model_of(finger: Finger, lattice: Lattice, film: Any) -> KeptModel:
    """The base model of a film of five markers on a finger."""
    case = base_case(finger=finger, lattice=lattice)
    x = np.linspace(0.2, 1.0, 5) * finger.length
    edge = np.stack([x, np.full_like(x, 11.5), np.zeros_like(x)], axis=1)
    rows = np.linalg.norm(case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    points, bench = case.nodes[rows], virtual.Bench(film_hz=3.5)
    course = virtual.path(bench, protocol=film)
    still = np.zeros((len(course.output), len(points), 3))
    names = [f"p{k}" for k in range(len(points))]
    targets = virtual.noisy_targets(
        still, still, course, points=virtual.at_nodes(names, case.labels[rows], points), bench=bench, seed=0
    )
    model = base_model(targets, case)
    assert isinstance(model, KeptModel)
    return model


def drawn(p: Parameter, rng: np.random.Generator) -> float:
    """A plausible value of an effect's parameter."""
    low, high = p.plausible or (p.low, p.high)
    if p.null is not None and p.plausible is None:
        low, high = max(p.low, p.null - 3 * p.step), min(p.high, p.null + 3 * p.step)
    if p.null is None and low > 0 and high > 5 * low:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))


def pulls(base: KeptModel, e: Effect, rng: np.random.Generator) -> dict[str, Any]:
    """Of one effect: the pulls, the errors and the change by the effect (mm rms), and the seconds of both."""
    whole = base.with_effect(e)
    assert isinstance(whole, KeptModel)
    tried = e.tries(base.test)
    free = [p for p in e.parameters if p.null is None]
    entry = tried[int(rng.integers(len(tried)))]
    values = {p.name: drawn(p, rng) for p in e.amplitudes}
    values |= {p.name: entry.get(p.name, drawn(p, rng)) for p in free}
    own = CONSTANTS * np.exp(SPREAD * rng.standard_normal(2))
    there = whole.theta({"C10": own[0], "C01": own[1], **values})
    nulls = {p.name: float(p.null or 0.0) for p in e.amplitudes}
    nothing = whole.theta({"C10": CONSTANTS[0], "C01": CONSTANTS[1], **values, **nulls})
    beside = there + NEAR * rng.uniform(0.5, 1.0) * (nothing - there)
    beside[:2] *= np.exp(NEAR * SPREAD * rng.standard_normal(2))
    response = Surrogate.of(whole, base, CONSTANTS, base.tangents(CONSTANTS, [e]))
    began = time.process_time()
    whole.solved(there)
    solve = time.process_time() - began
    first = _off(response, whole, there)
    response = response.certified(there)
    second = _off(response, whole, beside)
    began = time.process_time()
    for _ in range(10):
        response.predict(beside)
    quick = (time.process_time() - began) / 10
    return {
        "pull_first": first[0], "off_first_mm": first[1], "stated_first_mm": first[2],
        "pull": second[0], "off_mm": second[1], "stated_mm": second[2],
        "added_mm": float(np.sqrt(np.mean((whole.solved(there).u - base.solved(CONSTANTS).u) ** 2))),
        "solve_s": solve, "answer_s": quick,
    }  # fmt: skip


def _off(response: Surrogate, whole: KeptModel, theta: Array) -> tuple[float, float, float]:
    """The pull, what the response is off and what it states, mm rms."""
    if not response.reaches(theta):
        raise Unsolvable("out of reach")
    u, sd = response.answer(theta)
    off, stated = (float(np.sqrt(np.mean(x**2))) for x in (whole.solved(theta).u - u, sd))
    return off / stated, off, stated


def rows_of(finger: str, names: list[str], draws: int, seed: int) -> list[dict[str, Any]]:
    """The rows of a finger."""
    short = finger == "short"
    model = model_of(SHORT, Lattice(per_bellow=2, centred=False, ring=False), FILM) if short else model_of(
        Finger(), Lattice(), WHOLE
    )
    out = []
    for name in names:
        rng, e = np.random.default_rng([seed, len(name), *name.encode()]), effect(name)
        for k in range(draws):
            base = replace(model)  # with nothing in its memory: no draw may know what another has solved
            try:
                row = pulls(base, e, rng)
            except Unsolvable as why:
                print(f"{finger} {name}: {why}", file=sys.stderr)
                continue
            out.append({"finger": finger, "effect": name, "draw": k, **row})
            print(f"{finger} {name:22s} first {row['pull_first']:5.2f} ({row['off_first_mm']:.4f} mm)  "
                  f"then {row['pull']:5.2f} ({row['off_mm']:.4f} mm, of {row['added_mm']:.3f})",
                  file=sys.stderr, flush=True)  # fmt: skip
    return out


def pooled(rows: list[dict[str, Any]], key: str) -> float | None:
    """The root mean square of the rows' pulls."""
    found = [row[key] for row in rows if np.isfinite(row[key])]
    return float(np.sqrt(np.mean(np.square(found)))) if found else None


def main() -> int:
    typed = options(
        __doc__,
        {
            "--seed": (8, "of the draws; WORSE was chosen on 7"),
            "--only": {"nargs": "*", "default": (), "help": "these effects alone"},
        },
        quick="the short finger alone, one draw of each effect; not written",
        json="print it on one line",
    )
    names = [e.name for e in all_effects() if e.name not in LEFT_OUT and e.smooth]
    names = [n for n in names if not typed.only or n in typed.only]
    rows = rows_of("short", names, 1 if typed.quick else 3, typed.seed)
    if not typed.quick:
        rows += rows_of("default", [n for n in DEFAULT if n in names], 1, typed.seed)
    found = {
        "response_pull": pooled(rows, "pull"),
        "first_pull": pooled(rows, "pull_first"),
        "n": len(rows),
        "off_mm": float(np.median([r["off_mm"] for r in rows])),
        "off_first_mm": float(np.median([r["off_first_mm"] for r in rows])),
        "answer_ms": 1e3 * float(np.median([r["answer_s"] for r in rows])),
        "solve_over_answer": float(np.median([r["solve_s"] / r["answer_s"] for r in rows])),
        "rows": rows,
    }
    if not (typed.quick or typed.only):
        (RESULTS / "response.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    found = found if typed.json else {k: v for k, v in found.items() if k != "rows"}
    print(json.dumps(found, indent=None if typed.json else 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
