"""Truths that CalculiX solves: what is hidden in them, their decks, and their curves over pressure.

The mesh is none of the model's: 20-node bricks with reduced integration on a lattice of its own, with two
cells through every wall (with one, a refit leaves 0.08 mm rms of the truth's own error).
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

from benchmarks import ROOT
from benchmarks.diagnosis.snapshots import COURSE, POINTS, SHORT

import numpy as np

from fe import Case, Lattice, Material
from fe.case import Clamp
from fe.deck.calculix import CalculiX
from fe.deck.writer import deck
from twin.effects.protocol import Test
from twin.gravity import G
from twin.targets import Array
from twin.virtual.hidden import KINDS
from twin.virtual.protocols import TOP, WAYS
from twin.virtual.truthsolves import truth_case, truth_test

MESH = Lattice(per_bellow=6, wall=2, fillet=1, across=2, up=2, ring=False, centred=False)
CURVES = ROOT / "benchmarks" / "results" / "ccxcurves"
ELEMENT = "C3D20RH"  # for which CalculiX takes its C3D20R
SHEAR = 0.594  # MPa, as C10 = 0.214 and C01 = 0.083 have
STEPS = 10  # equal steps of pressure up to the top
Change = Callable[[Test], Test]


@dataclass(frozen=True)
class Truth:
    """A name, the effects of the library that name what is hidden (none: an unknown kind), what it changes,
    whether weight is hidden, and the truths that hide its parts alone."""

    name: str
    physics: tuple[str, ...]
    changes: tuple[Change, ...]
    weighs: bool = False
    parts: tuple[str, ...] = field(default=())

    @property
    def ways(self) -> tuple[tuple[float, float, float], ...]:
        """The directions of gravity in which it is solved; none without weight."""
        return WAYS if self.weighs else ((0.0, 0.0, 0.0),)

    def case(self) -> Case:
        """Its case."""
        test = bare_test()
        for change in self.changes:
            test = change(test)
        return test.case


def known(name: str, size: float) -> Change:
    """What a kind of `twin.virtual.hidden` changes."""
    return lambda test: replace(KINDS[name].before(test, size), path=test.path)


def of_law(**constants: object) -> Change:
    """Another law in place of the silicone's."""
    law = Material(**constants)  # type: ignore[arg-type]
    return lambda test: replace(
        test, case=replace(test.case, materials=dict.fromkeys(test.case.materials, law))
    )


def yeoh(c20: float) -> Change:
    """C10 and C20, and no C01."""
    return of_law(C10=SHEAR / 2, C20=c20)


def ogden(*alphas: float) -> Change:
    """Equal parts of these exponents."""
    return of_law(ogden=tuple((SHEAR / len(alphas), a) for a in alphas))


def gent(limit: float) -> Change:
    """Gent's law with this limit of I1 - 3, to third order, as CalculiX has no logarithm."""
    return of_law(C10=SHEAR / 2, C20=SHEAR / (4 * limit), C30=SHEAR / (6 * limit**2))


def blocked(factor: float) -> Change:
    """The second bellow of three is stiffer by a factor, as where glue has run into it."""

    def change(test: Test) -> Test:
        case = test.case
        ((body, material),) = case.materials.items()
        x = case.nodes[case.connectivity].mean(axis=1)[:, 0]
        inside = np.abs(x - SHORT.base_cap - 1.5 * SHORT.pitch) < 0.5 * SHORT.pitch
        sets = {**case.element_sets, body: np.flatnonzero(~inside), "blocked": np.flatnonzero(inside)}
        materials = {body: material, "blocked": material.stiffened(factor)}
        return replace(test, case=replace(case, element_sets=sets, materials=materials))

    return change


@lru_cache(maxsize=1)
def bare_test() -> Test:
    """The finger where nothing is hidden and nothing weighs, and the places for markers on it."""
    case = truth_case(SHORT, MESH, element=ELEMENT).with_material(density=0.0)
    return truth_test(case, COURSE, case.nodes[nearest(case, POINTS)])


def nearest(case: Case, points: Array) -> list[int]:
    """The rows (p,) of the nodes nearest to points (p, 3) mm."""
    return [int(np.linalg.norm(case.nodes - x, axis=1).argmin()) for x in points]


LAYER = "strain_limiting_layer"
BARE = Truth("bare", (), ())
SINGLE = (
    *(Truth(f"yeoh_{s:g}", ("stiffening",), (yeoh(s),)) for s in (0.05, 0.1, 0.2, 0.4)),
    *(Truth(f"ogden_{s:g}", ("stiffening",), (ogden(s),)) for s in (3.0, 5.0, 8.0)),
    Truth("ogden_4_-2", ("stiffening",), (ogden(4.0, -2.0),)),
    *(Truth(f"gent_{s:g}", ("stiffening",), (gent(s),)) for s in (0.5, 1.0, 2.0)),
    *(Truth(f"layer_{s:g}", (LAYER,), (known(LAYER, s),)) for s in (1, 2, 4)),
    *(Truth(f"clamp_{s:g}", ("clamp",), (known("clamp", s),)) for s in (4e-4, 8e-4, 1.6e-3)),
    *(Truth(f"core_{s:g}", ("eccentric_core",), (known("eccentric_core", s),)) for s in (-0.5, 0.3, 0.8)),
    *(Truth(f"spot_{s:g}", (), (known("soft_band", s),)) for s in (0.15, 0.3)),
    *(Truth(f"blocked_{s:g}", (), (blocked(s),)) for s in (3, 30)),
    Truth("weight_1.07", ("gravity",), (known("gravity", 1.07e-9),), True),
)
BOTH = (
    ("core_0.8", "layer_4"),
    ("core_-0.5", "clamp_0.0016"),
    ("yeoh_0.4", "core_0.8"),
)
NAMED = {t.name: t for t in SINGLE}


def together(a: Truth, b: Truth) -> Truth:
    """Two truths at once."""
    parts, physics = (a.name, b.name), (*a.physics, *b.physics)
    return Truth("+".join(parts), physics, (*a.changes, *b.changes), parts=parts)


TRUTHS = (BARE, *SINGLE, *(together(NAMED[a], NAMED[b]) for a, b in BOTH))


# -- solves --------------------------------------------------------------------------------------------------


def curves(truth: Truth, folder: Path) -> Array:
    """Displacements (w, k, p, 3) mm of the places at k equal steps of pressure from 0 to the top, in each of
    its directions of gravity. Solved in the folder, and kept with a digest of their decks in CURVES.
    RuntimeError where there is no equilibrium."""
    decks = [stepwise(truth.case(), G * np.array(way)) for way in truth.ways]
    digest, kept = sha256("".join(decks).encode()).hexdigest(), CURVES / f"{truth.name}.json"
    if kept.exists():
        found = json.loads(kept.read_text(encoding="utf-8"))
        if found["deck"] == digest:
            return np.array(found["u_mm"])
    u = [solved(text, folder / f"{truth.name}@{number}") for number, text in enumerate(decks)]
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps({"deck": digest, "u_mm": np.round(u, 7).tolist()}) + "\n", encoding="utf-8")
    return np.array(u)


def solved(text: str, folder: Path) -> Array:
    """The curve (k, p, 3) mm of one deck by CalculiX, its files in a folder."""
    found = CalculiX(folder=folder).run(text)
    if not found.converged:
        raise RuntimeError(f"{folder.name}: {found.reason}")
    labels, u = displacements(folder / "job.frd")
    order = np.argsort(labels)
    case = bare_test().case
    rows = order[np.searchsorted(labels, case.labels[nearest(case, POINTS)], sorter=order)]
    rest = u[-STEPS - 1][rows] if text.count("*STEP,") > 1 else np.zeros((len(rows), 3))
    for large in folder.glob("job.*"):
        large.unlink()
    return np.array([rest, *(x[rows] for x in u[-STEPS:])])


def stepwise(case: Case, gravity: Array) -> str:
    """The deck of a case: its weight first, then the pressure, told at equal steps."""
    hinge = case.clamp if case.clamp and case.clamp.compliance else None
    case = on_a_body(case, hinge) if hinge else case
    head, step = deck(case, TOP, kind=ELEMENT, gravity=gravity).split("*STEP", 1)
    head += hinged(case, hinge) if hinge else ""
    head += f"*TIME POINTS, NAME=TOLD, GENERATE\n{1 / STEPS:g}, 1., {1 / STEPS:g}\n"
    pressed = without("*DLOAD", step).replace("*NODE FILE", "*NODE FILE, TIME POINTS=TOLD")
    weighed = without("*DSLOAD", step).replace("*NODE FILE", "*NODE FILE, FREQUENCY=1000")
    return f"{head}*STEP{weighed}*STEP{pressed}" if np.any(gravity) else f"{head}*STEP{pressed}"


def without(keyword: str, step: str) -> str:
    """A step without a keyword and its one line of data."""
    before, found, after = step.partition(f"{keyword}\n")
    return before + after.partition("\n")[2] if found else step


BODY, TURN = 900_001, 900_002  # nodes of the hinge: where it is, and its turn


def on_a_body(case: Case, hinge: Clamp) -> Case:
    """The case whose clamped nodes no support holds, as a rigid body takes them."""
    taken = case.node_sets[hinge.nodes]
    sets = {
        name: np.setdiff1d(rows, taken) if name != hinge.nodes else rows
        for name, rows in case.node_sets.items()
    }
    return replace(case, node_sets=sets, clamp=None)


def hinged(case: Case, hinge: Clamp) -> str:
    """A rigid body of the clamped nodes on a hinge with a spring about y."""
    x, z = hinge.centre
    return "\n".join([
        "*NODE", f"{BODY}, {x:.10g}, 0., {z:.10g}", f"{TURN}, {x:.10g}, 0., {z:.10g}",
        f"*RIGID BODY, NSET={hinge.nodes.upper()}, REF NODE={BODY}, ROT NODE={TURN}",
        f"*ELEMENT, TYPE=SPRING1, ELSET=HINGE\n{len(case.connectivity) + 10_000}, {TURN}",
        f"*SPRING, ELSET=HINGE\n2\n{1 / hinge.compliance:.9e}",  # CalculiX reads no whole number here
        "*BOUNDARY", f"{BODY}, 1, 3", f"{TURN}, 1, 1", f"{TURN}, 3, 3", "",
    ])  # fmt: skip


def displacements(path: Path) -> tuple[Array, list[Array]]:
    """Node labels (n,) and the displacements (n, 3) mm of every output of a result file (.frd)."""
    found: list[list[str]] = []
    inside = False
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        if line.startswith(" -4"):
            inside = line.startswith(" -4  DISP")
            found += [[]] if inside else []
        elif line.startswith(" -3"):
            inside = False
        elif inside and line.startswith(" -1"):
            found[-1].append(line)
    labels = np.array([int(r[3:13]) for r in found[0]])
    return labels, [np.array([_row(line) for line in block]) for block in found]


def _row(line: str) -> list[float]:
    return [float(line[13 + 12 * k : 25 + 12 * k]) for k in range(3)]
