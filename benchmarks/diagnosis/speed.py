"""What the solves of a diagnosis cost: cold and warm, without and with a memory, derivatives by the dozen.

    python benchmarks/diagnosis/speed.py [--quick] [--json]

One run on the default finger along two cycles at two rates with holds; every figure is processor time on one
thread, and its ratio to a cold base solve with its two derivatives. A neighbour is 2 % off in C10 and 5 % in
the creep, and begins from the solved state to first order. --quick takes a finger of three bellows (about a
minute of the processor).
"""

import json
import os
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np

from fe import Case, Finger, Lattice, Material, Path, Solution, Variation, finger_case, solve
from fe.element import Flags, Integers

SILICONE = Material(C10=0.214, C01=0.083)
SHORT = Finger(
    length=10 + 100 / 3, bellows=3, tip_node=(10 + 100 / 3, 11.5, 0.0), middle_node=(4 + 50 / 3, 11.5, 0.0)
)
CORNERS = (  # s, kPa
    (0.0, 0.0), (2.0, 0.0), (4.0, 18.0), (10.0, 18.0), (12.0, 30.0), (22.0, 30.0), (25.0, 0.0), (34.0, 0.0),
    (34.2, 24.0), (38.2, 24.0), (38.4, 0.0), (42.4, 0.0),
)  # fmt: skip
CREEP = (0.1, 2.0)  # g, tau s
NEIGHBOUR = {"C10": 1.02, "g": 1.05, "tau": 1.05}
TIMES = (0.6, 1.2, 2.5, 5.0, 10.0, 20.0)  # s, the grid of creep
WIDTHS = (5e-4, 2e-3, 8e-3, 3e-2)  # MPa, that of softening
BANDS = 5  # soft spots along the finger, and twice as many forces

Law = Callable[[float], Case]


def course() -> Path:
    """Two cycles at two rates with holds, a log of 50 Hz, seen at 10 Hz."""
    corner, kpa = np.array(CORNERS).T
    log = np.linspace(0.0, corner[-1], round(50 * corner[-1]) + 1)
    return Path(log, 1e-3 * np.interp(log, corner, kpa), np.arange(0.0, corner[-1], 0.1))


def creeping(case: Case, g: float, tau: float) -> Case:
    """The case with one Prony term."""
    return case.with_material(prony=((g, tau),))


def softening(case: Case, m: float, amount: float) -> Case:
    """The case with Mullins softening."""
    return case.with_material(mullins=(amount, m, 0.0))


def pulled(case: Case, nodes: Integers, axis: int, force: float) -> Case:
    """The case with a dead force in N on some nodes."""
    return replace(
        case,
        node_sets={**case.node_sets, "pulled": nodes},
        forces={**case.forces, "pulled": force * np.eye(3)[axis]},
    )


def spotted(case: Case, inside: Flags, change: float) -> Case:
    """The case with some elements softer by a share."""
    (name, silicone), rows = next(iter(case.materials.items())), np.arange(len(case.connectivity))
    soft = replace(silicone, C10=(1 - change) * silicone.C10, C01=(1 - change) * silicone.C01)
    return replace(
        case,
        element_sets={name: rows[~inside], "spot": rows[inside]},
        materials={name: silicone, "spot": soft},
    )


def along(path: Path, law: Law, at: float, h: float) -> Variation:
    """The direction of a parameter of a case."""
    return Variation((law(at + h), path), (law(at - h), path), h)


def constants(case: Case, path: Path) -> list[Variation]:
    """The directions of C10 and C01."""
    silicone = next(iter(case.materials.values()))
    return [
        along(path, lambda x, name=name: case.with_material(**{name: x}), getattr(silicone, name), 2e-8)  # type: ignore[misc]
        for name in ("C10", "C01")
    ]


def with_creep(case: Case, path: Path, g: float, tau: float) -> list[Variation]:
    """The directions of C10, C01, g and tau of a creeping case."""
    own = [along(path, lambda x: creeping(case, x, tau), g, 2e-8)]
    return constants(case, path) + own + [along(path, lambda x: creeping(case, g, x), tau, 1e-6)]


def static(case: Case, path: Path) -> list[Variation]:
    """The directions of forces and of soft spots at some places along the finger."""
    x, out = case.nodes[:, 0], []
    middle = case.nodes[case.connectivity, 0].mean(axis=1)
    for place in np.linspace(0.1, 0.9, BANDS) * x.max():
        near = np.flatnonzero(np.abs(x - place) < x.max() / 20)
        out += [along(path, partial(pulled, case, near, axis), 0.0, 1e-4) for axis in (0, 2)]
        out.append(along(path, partial(spotted, case, np.abs(middle - place) < x.max() / 10), 0.0, 0.01))
    return out


def grids(case: Case, path: Path) -> list[Variation]:
    """The directions towards creep and softening, at every entry of their grids, over a typical step."""
    creep = [along(path, lambda g, tau=tau: creeping(case, g, tau), 0.01, 0.01) for tau in TIMES]  # type: ignore[misc]
    return creep + [along(path, partial(softening, case, m), 0.05, 0.05) for m in WIDTHS]


def clocked(work: Callable[[], Any]) -> tuple[Any, float]:
    """The result of a call and its processor time in s."""
    start = time.process_time()
    found = work()
    return found, time.process_time() - start


def measured(case: Case) -> dict[str, dict[str, float]]:
    """Seconds and factorisations of every kind of solve."""
    path, rows = course(), {}
    points = np.stack([case.position(4401), case.position(5848)])

    def row(
        name: str, of: Case, variations: Sequence[Variation], *, start: Solution | None = None
    ) -> Solution:
        def work() -> Solution:
            found = solve(of, path, start=start, variations=variations)
            found.variations_at(points)
            return found

        found, seconds = clocked(work)
        if not found.converged:
            raise RuntimeError(f"{name}: {found.reason}")
        rows[name] = {"seconds": seconds, "factorisations": found.iterations, "columns": len(variations)}
        return found

    g, tau = CREEP
    other = case.with_material(C10=NEIGHBOUR["C10"] * SILICONE.C10)
    change = (NEIGHBOUR["C10"] - 1) * SILICONE.C10, (NEIGHBOUR["g"] - 1) * g, (NEIGHBOUR["tau"] - 1) * tau
    base = row("cold base", case, constants(case, path))
    row("warm base", other, constants(other, path), start=base.ahead(np.array([change[0], 0.0])))
    creep = row("cold creep", creeping(case, g, tau), with_creep(case, path, g, tau))
    near = g + change[1], tau + change[2]
    ahead = creep.ahead(np.array([change[0], 0.0, change[1], change[2]]))
    row("warm creep", creeping(other, *near), with_creep(other, path, *near), start=ahead)
    row("cold softening", softening(case, 2e-3, 0.2), [])
    row("all static tangents", case, static(case, path), start=base)
    row("all history grids", case, grids(case, path), start=base)
    return rows


def main() -> None:
    """Print the table."""
    typed = options(__doc__, quick="a finger of three bellows", json="one JSON line")
    case = finger_case(SILICONE, finger=SHORT) if typed.quick else finger_case(SILICONE)
    solve_all_loops()
    rows = measured(case)
    for found in rows.values():
        found["ratio"] = found["seconds"] / rows["cold base"]["seconds"]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    if typed.json:
        print(json.dumps({"nodes": len(case.nodes), "peak_GB": peak, "rows": rows}))
        return
    print("| solve | columns | factorisations | s | over a cold base |\n|---|---|---|---|---|")
    for name, r in rows.items():
        print(f"| {name} | {r['columns']} | {r['factorisations']} | {r['seconds']:.2f} | {r['ratio']:.2f} |")
    print(f"\n{len(case.nodes)} nodes, at most {peak:.2f} GB")


def solve_all_loops() -> None:
    """Compile the loops before anything is clocked."""
    case = finger_case(SILICONE, finger=Finger(bellows=1), lattice=Lattice(per_bellow=2))
    seconds = np.array([0.0, 1.0, 2.0])
    way = Path(seconds, np.array([0.0, 1e-3, 5e-4]), seconds)
    both = creeping(softening(case, 2e-3, 0.1), 0.1, 1.0)
    solve(both, way, variations=with_creep(both, way, 0.1, 1.0))
    solve(case, way, variations=grids(case, way)).variations_at(case.position(4401)[None])


if __name__ == "__main__":
    main()
