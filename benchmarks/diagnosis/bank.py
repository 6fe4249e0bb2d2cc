"""What the fitted model's mesh says, tabulated once: `benchmarks/data/bank.npz`, for `reduced.ReducedModel`.

    python benchmarks/diagnosis/bank.py [--folder DIR] [--pack] [--again]

On the default lattice of the short finger, at all places for markers: load paths over reduced pressure
p / (C10 + C01) for several shares and totals in each direction of gravity; of every effect and stand-in that
changes the structure the derivatives to its amplitudes at nodes of its other parameters, and whole solves at
one size; of creep and Mullins softening what the history adds. Every array is saved as it is made; what the
file has is not made again (--again: all is), so that a new effect or stand-in takes its own solves alone.
About twenty minutes of one core for all.
"""

import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis.kindsbetween import BETWEEN
from benchmarks.diagnosis.snapshots import COURSE, POINTS, SHORT

import numpy as np

from calibrate import Parameter
from fe import Case, Lattice, Variation, solve
from fe import Path as Course
from fe.mesh.mirror import mirrored
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.effects.shape import WallThickness
from twin.effects.standins import stand_ins
from twin.gravity import G
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, mooney_rivlin
from twin.model.structure import base_case
from twin.targets import Array
from twin.virtual.hidden import KINDS
from twin.virtual.protocols import WAYS
from twin.virtual.truthsolves import DENSITY

FILE = ROOT / "benchmarks" / "data" / "bank.npz"
GRID: Array = np.concatenate([[-0.006], np.linspace(0.0, 1.0, 20) ** 1.3 * 0.17])  # p / (C10 + C01)
TOTALS: Array = np.array([0.22, 0.3, 0.45])  # MPa
SHARES: Array = 0.2 - 0.8 * np.cos(np.pi * (np.arange(7) + 0.5) / 7)  # from the least that is stable
MAIN = mooney_rivlin(0.214, 0.083)
LARGE = 0.2  # softening of the whole solves, and half of it
COUNT, FEWER = 12, 8  # levels of a load path, and of what an effect changes
NODES = {  # of parameters that are invisible at null
    "ballooning.place": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9),
    "ballooning.width": (3.0, 4.5, 6.5, 10.0, 20.0),
    "tube.place": (0.2, 0.4, 0.6, 0.8, 1.0),
    "hoop_reinforcement.angle": (0.0, 10.0, 25.0, 45.0),
    "creep.tau1": (0.4, 1.2, 3.5, 10.0, 30.0, 100.0),
    "mullins.m": (5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 2e-2),
    "mullins.beta": (0.0, 1.0),
}
LEFT_OUT = ("contact",)  # not smooth, and the short finger has no table


def fitted_case() -> Case:
    """The model's case: the default lattice of the short finger, as heavy as it was weighed."""
    return base_case(finger=SHORT, lattice=Lattice()).with_material(density=DENSITY)


def case_test(case: Case, points: Array = POINTS) -> Test:
    """A test of a case along the whole course."""
    return Test(case, COURSE, points, np.ones(len(points), bool))


def kind_of(effect: Effect, test: Test) -> str:
    """What an effect changes: `seen` or `path` alone, `creep`, `mullins`, the structure (`case`), or that by
    a `course` of its own."""
    p, entry = effect.amplitudes[0], entries(effect, test)[1][0]
    others = {q.name: q.null for q in effect.amplitudes}
    changed = effect.before(test, {**others, **entry, p.name: p.null + p.step / 8})
    if changed.perturbations:
        return "course"
    if changed.case is test.case or changed.slips:
        return "seen" if changed.path is test.path else "path"
    body, old = (next(iter(c.materials.values())) for c in (changed.case, test.case))
    if body.mullins:
        return "mullins"
    return "creep" if body.prony and replace(body, prony=()) == old else "case"


def entries(effect: Effect, test: Test) -> tuple[list[str], list[Theta]]:
    """The parameters without a null, and the nodes at which an effect is tabulated."""
    shape = [p for p in effect.parameters if p.null is None]
    if not shape:
        return [], [{}]
    at = [NODES.get(p.name, ()) or _spread(effect, p, test) for p in shape]
    return [p.name for p in shape], [dict(zip((p.name for p in shape), x, strict=True)) for x in product(*at)]


def _spread(effect: Effect, p: Parameter, test: Test) -> tuple[float, ...]:
    tried = sorted({float(e[p.name]) for e in effect.tries(test) if p.name in e})
    return tuple(tried) or (p.high,)


def along(case: Case, share: float, total: float, *, count: int = COUNT) -> Array:
    """Load paths (w, k, p, 3) mm over GRID in each direction of gravity."""
    case, out = case.with_material(**MOONEY_RIVLIN.at(total, (share,)).named), []
    for way in WAYS:
        p = GRID * total
        found = solve(case, Course(p, p, p, gravity=G * np.array(way)), count=count)
        if not found.converged:
            raise Unsolvable(found.reason)
        out.append(found.at(POINTS))
    return np.array(out)


Row = tuple[Effect, Theta, str]  # an effect, the values of its other parameters, and the amplitude


def rows_of(effect: Effect, test: Test) -> list[Row]:
    """The rows of an effect's table."""
    return [(effect, e, p.name) for e in entries(effect, test)[1] for p in effect.amplitudes]


def slopes(case: Case, rows: Sequence[Row]) -> Array:
    """Derivatives (v, w, k, p, 3) of the load paths to amplitudes at null, at the main constants."""
    case, p, out = case.with_material(**MAIN.named), GRID * MAIN.scale, []
    for way in WAYS:
        course = Course(p, p, p, gravity=G * np.array(way))
        test = Test(case, course, POINTS, np.ones(len(POINTS), bool))
        found = solve(case, course, count=FEWER, variations=[_direction(test, *row) for row in rows])
        if not found.converged:
            raise Unsolvable(found.reason)
        out.append(found.variations_at(POINTS))
    return np.moveaxis(np.array(out), 0, 1)


def _direction(test: Test, effect: Effect, entry: Theta, name: str) -> Variation:
    p = next(p for p in effect.amplitudes if p.name == name)
    h = 1e-3 * p.step
    null = {q.name: q.null for q in effect.amplitudes}
    if effect.name == "mullins":  # below no softening it means nothing
        a, b = effect.before(test, {**null, **entry, name: 2 * h}), test
    else:
        a, b = (effect.before(test, {**null, **entry, name: p.null + s * h}) for s in (1, -1))
    one, other = (t.perturbations[0].plus if t.perturbations else t.case for t in (a, b))
    return Variation((one, a.path), (other, b.path), h)


def at_size(case: Case, effect: Effect, entry: Theta, name: str, size: float) -> Array:
    """Load paths with an effect of a size, at the main constants."""
    null = {q.name: q.null for q in effect.amplitudes}
    changed = effect.before(case_test(case.with_material(**MAIN.named)), {**null, **entry, name: size})
    return along(changed.case, MAIN.shape[0], MAIN.scale, count=FEWER)


def course(case: Case, effect: Effect | None, theta: Theta) -> Array:
    """Displacements (s, p, 3) mm along the whole course at the main constants."""
    test = case_test(case.with_material(**MAIN.named))
    test = effect.before(test, theta) if effect else test
    found = solve(test.case, test.path, count=COUNT)
    if not found.converged:
        raise Unsolvable(found.reason)
    return found.at(POINTS)


def softening(case: Case, rows: Sequence[Row]) -> Array:
    """Derivatives (v, s, p, 3) of the displacements along the whole course to a softening, at none."""
    test = case_test(case.with_material(**MAIN.named))
    found = solve(test.case, test.path, count=COUNT, variations=[_direction(test, *row) for row in rows])
    return found.variations_at(POINTS)


def sizes(effect: Effect, name: str) -> tuple[float, ...]:
    """Sizes at which whole solves are made: those of the hidden truths, else a few typical steps."""
    p = next(p for p in effect.amplitudes if p.name == name)
    if effect.label.endswith(":wide"):
        return ()  # to first order, too
    kind = (KINDS | BETWEEN).get(effect.name)
    if effect.name == "tube" and name == effect.amplitudes[0].name:
        return (0.1,)
    if kind is not None and name == effect.amplitudes[0].name and kind.part == "static":
        return tuple(s for s in kind.sizes if len(kind.sizes) < 4 or abs(s) == max(kind.sizes))
    if getattr(effect, "kind", "") or effect.amplitudes[0].name != name:
        return ()  # to first order
    return (2 * p.step,)


def tasks(effects: Sequence[Effect]) -> dict[str, partial[Array]]:
    """Every array by its name."""
    case = fitted_case()
    whole, test = mirrored(case), case_test(case)
    found: dict[str, partial[Array]] = {}
    for i, j in product(range(len(TOTALS)), range(len(SHARES))):
        found[f"base@{i}@{j}"] = partial(along, case, float(SHARES[j]), float(TOTALS[i]))
    found["course"] = partial(course, case, None, {})
    found["plain"] = partial(along, case, MAIN.shape[0], MAIN.scale, count=FEWER)
    creep, soft = effect("creep"), effect("mullins:2")
    for k, entry in enumerate(entries(creep, test)[1]):
        found[f"creep@{k}"] = partial(course, case, creep, {**entry, "creep.g1": 0.05})
    found["mullins"] = partial(softening, case, [(soft, e, "mullins.softening") for e in softenings()])
    for k, entry in enumerate(softenings()):
        found[f"mullins@{k}"] = partial(course, case, soft, {**entry, "mullins.softening": LARGE})
        found[f"mullins@{k}@half"] = partial(course, case, soft, {**entry, "mullins.softening": LARGE / 2})
    structural = [e for e in effects if kind_of(e, test) in ("case", "course")]
    for e in structural:
        own = whole if e.breaks_symmetry(test) else case
        found[f"slopes@{_file(e)}"] = partial(slopes, own, rows_of(e, test))
    for e in structural:
        own, rows = whole if e.breaks_symmetry(test) else case, rows_of(e, test)
        for k, (_, entry, name) in enumerate(rows):
            far = abs(entry.get("ballooning.place", 0.5) - 0.5) > 0.15
            far |= entry.get("ballooning.width", 5.0) not in (4.5, 5.0, 6.5)
            for size in () if far else sizes(e, name):
                found[f"size@{_file(e)}@{k}@{size:g}"] = partial(at_size, own, e, entry, name, size)
    return found


def _file(e: Effect) -> str:
    return e.label.replace(":", "_")


def softenings() -> list[Theta]:
    """The nodes at which softening is tabulated."""
    return [{"mullins.m": m, "mullins.beta": b} for m in NODES["mullins.m"] for b in NODES["mullins.beta"]]


def tabulated() -> list[Effect]:
    """The effects and stand-ins that have a table, each in its widest law."""
    own = [e for e in all_effects() if e.name not in LEFT_OUT]
    out: list[Effect] = [e.laws()[-1] for e in own]
    families = [w for e in own if (w := e.wide()) is not None]
    return [*out, WallThickness(), *families, *stand_ins(case_test(fitted_case()))]


def packed() -> dict[str, Array]:
    """The arrays of the file, none where there is no file or it was made at other nodes."""
    if not FILE.exists():
        return {}
    with np.load(FILE) as data:
        found = {name: data[name] for name in data.files}
    return found if np.array_equal(found.get("nodes", ()), nodes()) else {}


def nodes() -> Array:
    """All numbers at which arrays are made, in one row."""
    others = (x for name in sorted(NODES) for x in NODES[name])
    return np.array([*GRID, *TOTALS, *SHARES, *MAIN.named.values(), LARGE, *others], np.float32)


def complete(arrays: Mapping[str, Array], name: str, rows: int | None) -> bool:
    """Whether arrays have one of a name, with as many rows as its effect has."""
    return name in arrays and rows in (None, len(arrays[name]))


def main() -> int:
    typed = options(__doc__, {
        "--folder": (Path(tempfile.gettempdir()) / "softtwin-bank", "where solves are kept"),
        "--pack": "write what is made into one file",
        "--again": "make what the file has, too",
    })  # fmt: skip
    typed.folder.mkdir(parents=True, exist_ok=True)
    wanted, kept = tasks(tabulated()), {} if typed.again else packed()
    for name, make in wanted.items():
        path = typed.folder / f"{name}.npy"
        rows = len(make.args[1]) if name.startswith("slopes@") else None
        if path.exists() or complete(kept, name, rows):
            continue
        began = time.process_time()
        try:
            array = make()
        except (Unsolvable, ValueError) as error:
            print(f"{name}: {error}", flush=True)
            continue
        scratch = path.with_suffix(".part.npy")
        np.save(scratch, array.astype(np.float32))
        scratch.replace(path)
        print(f"{name}: {time.process_time() - began:.1f} s of CPU", flush=True)
    if typed.pack:
        FILE.parent.mkdir(exist_ok=True)
        made = {p.stem: np.load(p) for p in sorted(typed.folder.glob("*.npy"))}
        arrays = {name: array for name, array in (kept | made).items() if name in wanted}
        arrays["nodes"] = nodes()
        np.savez_compressed(FILE, allow_pickle=False, **arrays)
        print(f"{FILE}: {len(arrays)} arrays, {FILE.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
