"""Is a finger's inertia named where a virtual film has it, and nothing where it has not?

    python benchmarks/diagnosis/ringing.py [--films N] [--nothing N] [--seconds S] [--json]

Films of a finger of three bellows at 240 frames a second: a slow rise of the pressure, and two fast steps.
The truth is a reduced model with two vibrations on a mesh of 4 cells a bellow. Its statics are diagnosed: a
table of equilibria on a mesh of 3, as a program of somebody's (`twin.simulator`) with two constants. Hidden
by kind: `inertia` with a loss factor of 0.06 to 0.14; the same with 0.25 to 0.5 (`material_damping`), with a
drag of the square of the speed (`air_drag`), with more mass in the tip (`added_mass`), on a clamp that turns
(`soft_clamp`); and without inertia, a first-order `lag` of the line, or `nothing`.

in_set: share whose nearest names hold `inertia`, of a lag `pressure_lag`; named: that is the name alone;
false_alarms: share of films of nothing whose verdict is not `none needed`; misnamed: of a lag, share that has
`inertia` among its names; told_drag: of those with inertia, share whose damping is told to be a drag. Medians
of fits with inertia: hz, the frequency found over that of the statics' mesh with the finger's density at the
median pressure of the fast part; damping, and drag, as the effect has them. Films are made kind by kind in
turn, until --seconds of processor are spent. With 20 of each kind or more, all of them made,
benchmarks/results/ringing.json is written.
"""

import json
import os
import sys
import time
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis.ringingfilms import MODEL, Film, statics

import numpy as np

import twin
from twin.diagnosis.swing import is_drag

HIDDEN = ("inertia", "material_damping", "air_drag", "added_mass", "soft_clamp", "lag")
FILMS = 20  # of a kind
OUT = ROOT / "benchmarks" / "results" / "ringing.json"
E = twin.Parameter("E", 0.4, 3.0, "", start=1.0, typical=0.05)
MORE = twin.Parameter("more", -0.3, 0.3, "", start=0.0, typical=0.02)


def trial(kind: str, seed: int) -> dict[str, Any]:
    """The row of one film."""
    film, began = Film(kind, seed), time.process_time()
    data = film.targets
    found = twin.diagnose(twin.simulator(statics(MODEL), [E, MORE]), data).diagnosis
    near = {name for each in found.nearest for name in each.split(" + ")}
    wanted = {"lag": "pressure_lag"}.get(kind, "inertia")
    row = {
        "kind": kind, "seed": seed, "verdict": found.verdict, "grade": found.grade, "nearest": sorted(near),
        "in_set": wanted in near, "named": found.named == (wanted,), "inertia": "inertia" in near,
        "seconds": round(time.process_time() - began, 1),
    }  # fmt: skip
    if found.kept is not None and "inertia.hz" in (values := found.kept.values):
        pressure, top = np.median(film.course[1][3:]), film.course[1].max()
        stiff = values["E"] * (1 + values["more"] * pressure / 1e-2)
        hz = values["inertia.hz"] * (1 + values.get("inertia.faster", 0.0) * pressure / top)
        row |= {"hz": round(hz / statics(MODEL).hz(stiff, float(pressure)), 3),
                "damping": round(values["inertia.damping"], 4)}  # fmt: skip
        if "inertia.drag" in values:
            k = [p.name for p in found.kept.model.parameters].index("inertia.drag")
            sd = float(found.kept.fit.sd[k])
            row |= {"drag": round(values["inertia.drag"], 4), "drag_sd": round(sd, 4)}
    return row


def share(flags: list[bool]) -> float:
    """The share of those that are true."""
    return round(float(np.mean(flags)), 3)


def rates(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares and medians of the films of one kind."""
    out: dict[str, Any] = {"n": len(rows)}
    if rows[0]["kind"] == "nothing":
        return out | {"false_alarms": share([r["verdict"] != "none needed" for r in rows])}
    out |= {key: share([r[key] for r in rows]) for key in ("in_set", "named")}
    if rows[0]["kind"] == "lag":
        out["misnamed"] = share([r["inertia"] for r in rows])
    if swung := [r for r in rows if "hz" in r]:
        drags = [r for r in swung if "drag" in r and is_drag(r["damping"], r["drag"], r["drag_sd"])]
        out["told_drag"] = round(len(drags) / len(swung), 3)
    for key in ("hz", "damping", "drag"):
        if some := [r[key] for r in rows if key in r]:
            out[key] = round(float(np.median(some)), 3)
    return out


def main() -> None:
    """Make the films, print and keep what they give."""
    more = {
        "--films": (int, f"of each kind that is hidden, {FILMS} by default"),
        "--nothing": (int, "films without anything hidden, 100 by default"),
        "--seconds": (float, "of processor, after which no film is begun"),
    }
    typed = options(__doc__, more, json="one JSON line")
    films, nothing = typed.films or FILMS, 100 if typed.nothing is None else typed.nothing
    every = [(k, (kind, k)) for kind in HIDDEN for k in range(films)]
    every += [(k * films / max(nothing, 1), ("nothing", k)) for k in range(nothing)]
    rows: list[dict[str, Any]] = []
    for _, (kind, seed) in sorted(every, key=lambda row: row[0]):
        if time.process_time() > (typed.seconds or np.inf):
            break
        rows.append(trial(kind, seed))
        print(rows[-1], file=sys.stderr, flush=True)
    kinds = dict.fromkeys(r["kind"] for r in rows)
    result = {kind: rates([r for r in rows if r["kind"] == kind]) for kind in kinds}
    if films >= FILMS and len(rows) == len(every):
        command = f"python benchmarks/diagnosis/ringing.py --films {films} --nothing {nothing}"
        OUT.write_text(json.dumps({"command": command, "rates": result, "films": rows}, indent=1) + "\n")
    print(json.dumps(result, indent=None if typed.json else 1))


if __name__ == "__main__":
    main()
