"""How far decks of others, as they are read, are from CalculiX: one small deck for each feature.

    python benchmarks/kernel/decks.py [--json] [--only WORD]

For each feature the largest difference of a node's displacement, over the largest displacement. CalculiX
solves the same deck; where it does not know the feature (parts, *NGEN, units), or its own element locks, the
same structure written without.
"""

import argparse
import json
import os
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.kernel.smalldecks import (
    HEX,
    MESH,
    RUBBER,
    VOID,
    X,
    Y,
    Z,
    in_chamber,
    lattice,
    meshed,
    rest,
    root,
)

import numpy as np

from fe.deck.reader import read_deck
from fe.engines.calculix import CalculiX
from fe.engines.engine import Embedded

Lines = tuple[tuple[float, ...], ...]
BAR: Lines = (tuple(2.0 * i for i in range(9)), (-2.0, 0.0, 2.0), (0.0, 2.0, 4.0))
BEND = "*DSLOAD\nCHAMBER, P, 0.0005"
# With hardly a bulk modulus: CalculiX integrates its C3D8 in full, Abaqus and softtwin its volume as a whole.
SLACK = "*HYPERELASTIC, NEO HOOKE\n0.1, 5000."
FINER: Lines = (tuple(16 / 9 * i for i in range(10)), (-2.0, -0.7, 0.7, 2.0), (0.0, 1.3, 2.7, 4.0))


@dataclass(frozen=True)
class Example:
    """A deck, what CalculiX solves in its place, in mm, and further files by name."""

    deck: str
    theirs: str = ""
    files: tuple[tuple[str, str], ...] = ()

    def write(self, folder: Path) -> Path:
        """Its files in a folder; the deck's path."""
        for name, text in (("deck.inp", self.deck), *self.files):
            (folder / name).write_text(_without_gaps(text), encoding="utf-8")
        return folder / "deck.inp"


def _without_gaps(text: str) -> str:
    return "".join(f"{line}\n" for line in text.splitlines() if line.strip())


def difference(example: Example) -> float:
    """The largest difference of both displacements at the nodes that they share, over CalculiX's largest.
    RuntimeError where one does not converge."""
    with tempfile.TemporaryDirectory() as folder:
        deck = read_deck(example.write(Path(folder)))
    ours = Embedded().solve(deck.case, deck.pressures[-1])
    theirs = CalculiX().run(_without_gaps(example.theirs or example.deck))
    if not ours.converged or not theirs.converged:
        raise RuntimeError(f"softtwin: {ours.reason}; CalculiX: {theirs.reason}")
    _, a, b = np.intersect1d(ours.labels, theirs.labels, return_indices=True)
    return float(np.abs(ours.u[a] - theirs.u[b]).max() / np.abs(theirs.u[b]).max())


# -- the mesh ----------------------------------------------------------------------------------------------


def bar(kind: str, *, lines: Lines = BAR, other: object = None) -> str:
    """A solid bar whose upper side is the surface CHAMBER."""
    mesh = lattice(kind, lines=lines, void=(), other=other)  # type: ignore[arg-type]
    return MESH.format(mesh=mesh.text, root=mesh.where(root), chamber=mesh.faces(_upper))


def _upper(corners: list[list[float]]) -> bool:
    return all(z == 4 for _, _, z in corners)


def of_elements() -> dict[str, Example]:
    """Types of elements, in a bar."""
    wedges, quadratic = bar("C3D15") + rest(load=BEND), bar("C3D20R", lines=FINER) + rest(load=BEND)
    same = {kind: Example(bar(kind) + rest(load=BEND)) for kind in ("C3D20R", "C3D4", "C3D10", "C3D15")}
    mixed = bar("C3D20R", other=("C3D15", lambda cell: cell[0] > 5))
    return same | {
        "C3D8": Example(bar("C3D8") + rest(SLACK, load=BEND)),
        "C3D8R": Example(bar("C3D8R", lines=FINER) + rest(load=BEND), quadratic),
        "C3D8I": Example(bar("C3D8I", lines=FINER) + rest(load=BEND), quadratic),
        "C3D6": Example(bar("C3D6") + rest(load=BEND), wedges),
        "C3D20R and C3D15": Example(mixed + rest(load=BEND)),
    }


def of_words() -> dict[str, Example]:
    """What a deck writes in another way."""
    plain = meshed(lattice("C3D20R"))
    whole = plain + rest()
    half = "*AMPLITUDE, NAME=RAMP\n0., 0., 1., 0.5\n"
    parameters = "*PARAMETER\nstiff = 0.05\nC10 = 2 * stiff\np = 0.06 / 2**1\n"
    law, load = "*HYPERELASTIC, NEO HOOKE\n<C10>, 3.", "*DSLOAD\nCHAMBER, P, <p>"
    return {
        "*PARAMETER": Example(parameters + plain + rest(law, load=load), whole),
        "*INCLUDE": Example("*INCLUDE, INPUT=mesh.inc\n" + rest(), whole, (("mesh.inc", plain),)),
        "*AMPLITUDE": Example(half + plain + rest(load="*DSLOAD, AMPLITUDE=RAMP\nCHAMBER, P, 0.06")),
        "*NGEN, *NFILL, *ELGEN": _generated(),
        "units m, N": _in_metres(plain),
        "*PART, *INSTANCE": _instances(),
    }


def _generated() -> Example:
    """A bar of 8 x 2 x 2 C3D8, of two elements and eight nodes of which keywords make the others."""
    mesh = lattice("C3D8", lines=BAR, void=())
    edges = [(0, b, c) for c in (0, 4) for b in (0, 4)]
    corners = [(a, b, c) for _, b, c in edges for a in (0, 16)]
    nodes = [f"{mesh.label(p)}, {', '.join(map(str, mesh.place(p)))}" for p in corners]
    lines = [f"{mesh.label((0, b, c))}, {mesh.label((16, b, c))}, 2" for _, b, c in edges]
    names = ("FRONT0", "BACK0", "FRONT1", "BACK1")
    ngen = "".join(f"*NGEN, NSET={n}\n{row}\n" for n, row in zip(names, lines, strict=True))
    nfill = "*NFILL, NSET=FLOOR\nFRONT0, BACK0, 2, 40\n*NFILL, NSET=ROOF\nFRONT1, BACK1, 2, 40\n"
    nfill += "*NFILL, NSET=ALL\nFLOOR, ROOF, 2, 800\n"
    first = ", ".join(str(mesh.label(p)) for p in mesh.elements[0][1])
    elgen = f"*ELEMENT, TYPE=C3D8, ELSET=BODY\n1, {first}\n*ELGEN, ELSET=BODY\n"
    elgen += "1, 8, 2, 4, 2, 40, 2, 2, 800, 1\n"
    held, top = mesh.where(root), mesh.faces(_upper)
    text = "*NODE\n" + "\n".join(nodes) + "\n" + ngen + nfill + elgen
    ours = f"{text}*NSET, NSET=ROOT\n{held}\n*SURFACE, NAME=CHAMBER, TYPE=ELEMENT\n{top}\n"
    return Example(ours + rest(SLACK, load=BEND), bar("C3D8") + rest(SLACK, load=BEND))


def _in_metres(plain: str) -> Example:
    def metres(row: re.Match[str]) -> str:
        label, *x = row[0].split(",")
        return ", ".join([label, *(f"{float(v) / 1000:.9g}" for v in x)])

    head, _, tail = plain.partition("*ELEMENT")
    nodes = re.sub(r"^\d+,.*$", metres, head, flags=re.MULTILINE)
    law = "*HYPERELASTIC, NEO HOOKE\n0.1e6, 3.e-6"
    deck = "** units: m, N, s\n" + nodes + "*ELEMENT" + tail + rest(law, load="*DSLOAD\nCHAMBER, P, 0.03e6")
    return Example(deck, plain + rest())


def _two(kind: str, lower: Lines, first: int) -> tuple[str, str]:
    """A hollow block of two meshes that meet at z = 2, the lower one a slab, and the tie between them."""
    slab = lattice(kind, lines=(*lower, (0.0, 2.0)), void=(), first=first)
    block = lattice(kind, lines=(X, Y, Z[1:]), void={(i, 1, 0) for i, _, _ in VOID})

    def at(level: float) -> Callable[[list[list[float]]], bool]:
        return lambda corners: all(z == level for _, _, z in corners)

    inner, outer = slab.faces(at(2.0)).splitlines(), block.faces(at(2.0))
    under = slab.faces(lambda c: at(2.0)(c) and all(2 <= x <= 14 and -2 <= y <= 2 for x, y, _ in c))
    text = f"{block.text}\n{slab.text}\n*NSET, NSET=ROOT\n{block.where(root)}\n{slab.where(root)}\n"
    text += f"*SURFACE, NAME=CHAMBER, TYPE=ELEMENT\n{block.faces(in_chamber)}\n{under}\n"
    text += "*SURFACE, NAME=UPPER, TYPE=ELEMENT\n" + outer + "\n"
    text += "*SURFACE, NAME=LOWER, TYPE=ELEMENT\n" + "\n".join(inner) + "\n"
    return text, "*TIE, NAME=JOINT, POSITION TOLERANCE=0.1\nUPPER, LOWER"


def _instances() -> Example:
    """Two parts, the second of which is moved into its place."""
    text, tie = _two("C3D20R", (X, Y), 10000)
    slab = lattice("C3D20R", lines=(X, Y, (10.0, 12.0)), void=())
    block = lattice("C3D20R", lines=(X, Y, Z[1:]), void={(i, 1, 0) for i, _, _ in VOID})
    parts = ""
    for name, mesh, level in (("BLOCK", block, 2.0), ("SLAB", slab, 12.0)):
        own = mesh.faces(lambda c: all(z == level for _, _, z in c))  # noqa: B023
        parts += f"*PART, NAME={name}\n{mesh.text}\n*NSET, NSET=SET-1\n{mesh.where(root)}\n"
        parts += f"*SURFACE, NAME=JOINT, TYPE=ELEMENT\n{own}\n"
        parts += "*SOLID SECTION, ELSET=BODY, MATERIAL=RUBBER\n,\n*END PART\n"
    under = slab.faces(
        lambda c: all(z == 12 and 2 <= x <= 14 and -2 <= y <= 2 for x, y, z in c)
    )
    rows = [f"BLOCK-1.{row}" for row in block.faces(in_chamber).splitlines()]
    rows += [f"SLAB-1.{row}" for row in under.splitlines()]
    chamber = "\n".join(rows)
    deck = f"""{parts}*ASSEMBLY, NAME=A
*INSTANCE, NAME=BLOCK-1, PART=BLOCK
*END INSTANCE
*INSTANCE, NAME=SLAB-1, PART=SLAB
0., 0., -10.
*END INSTANCE
*NSET, NSET=ROOT
BLOCK-1.SET-1, SLAB-1.SET-1
*SURFACE, NAME=CHAMBER, TYPE=ELEMENT
{chamber}
*TIE, NAME=J
BLOCK-1.JOINT, SLAB-1.JOINT
*END ASSEMBLY
"""
    ours = deck + rest().replace("*SOLID SECTION, ELSET=BODY, MATERIAL=RUBBER\n", "")
    return Example(ours, text + rest(joints=tie))


# -- laws --------------------------------------------------------------------------------------------------

LAWS = {
    "NEO HOOKE": "*HYPERELASTIC, NEO HOOKE\n0.24, 0.02",
    "MOONEY-RIVLIN": RUBBER,
    "YEOH": "*HYPERELASTIC, YEOH\n0.2, 0.06, 0.01, 0.02, 0., 0.",
    "OGDEN, N=1": "*HYPERELASTIC, OGDEN, N=1\n0.4, 2.6, 0.02",
    "OGDEN, N=2": "*HYPERELASTIC, OGDEN, N=2\n0.4, 2.6, 0.05, -2., 0.02, 0.",
    "OGDEN, N=3": "*HYPERELASTIC, OGDEN, N=3\n0.3, 1.3, 0.1, 4., 0.02, -2., 0.02, 0.\n0.",
    "POLYNOMIAL, N=1": "*HYPERELASTIC, POLYNOMIAL, N=1\n0.18, 0.06, 0.02",
    "REDUCED POLYNOMIAL, N=2": "*HYPERELASTIC, REDUCED POLYNOMIAL, N=2\n0.2, 0.06, 0.02, 0.",
    "REDUCED POLYNOMIAL, N=3": "*HYPERELASTIC, REDUCED POLYNOMIAL, N=3\n0.2, 0.06, 0.01, 0.02, 0., 0.",
}


def of_laws() -> dict[str, Example]:
    """Every *HYPERELASTIC, and *ELASTIC."""
    plain, load = meshed(lattice("C3D20R")), "*DSLOAD\nCHAMBER, P, 0.05"
    found = {f"*HYPERELASTIC, {name}": Example(plain + rest(law, load=load)) for name, law in LAWS.items()}
    stiff = plain + rest("*ELASTIC\n1000., 0.3", load="*DSLOAD\nCHAMBER, P, 0.5")
    return found | {"*ELASTIC": Example(stiff)}


# -- sheets, joints, loads ---------------------------------------------------------------------------------

PAPER = "*MATERIAL, NAME=PAPER\n*ELASTIC\n100., 0.3"


def _sheet(kind: str, solid: str, section: str, *, tied: bool = False) -> Example:
    """A sheet under the hollow block, on the solid's nodes or on nodes of its own that are tied to them."""
    mesh = lattice(solid)
    label = {p: mesh.label(p) + (20000 if tied else 0) for p in mesh.points}
    rows, corners = [], {"S8R": 8, "M3D8": 8, "S3": 3, "M3D3": 3}.get(kind, 4)
    for i, j in sorted({(i, j) for _, _, (i, j, k) in mesh.elements if k == 0}):
        points = [(2 * i + a, 2 * j + b, c) for a, b, c in HEX]
        floor = [points[int(d) - 1] for d in "1432"]
        if corners == 8:
            floor += [points[k] for k in (11, 10, 9, 8)]
        for part in ([floor[:3], [floor[0], *floor[2:4]]] if corners == 3 else [floor]):
            rows.append(f"{5001 + len(rows)}, {', '.join(str(label[p]) for p in part)}")
    own = sorted({int(n) for row in rows for n in row.split(",")[1:]})
    places = {label[p]: mesh.place(p) for p in mesh.points}
    text = meshed(mesh)
    if tied:
        text += "*NODE\n" + "".join(f"{n}, {', '.join(map(str, places[n]))}\n" for n in own)
        floor_faces = mesh.faces(lambda c: all(z == 0 for _, _, z in c))
        text += f"*SURFACE, NAME=FLOOR, TYPE=ELEMENT\n{floor_faces}\n"
    sheet = "\n".join(rows)
    text += f"*ELEMENT, TYPE={kind}, ELSET=PAPER\n{sheet}\n"
    text += f"{section}, ELSET=PAPER, MATERIAL=PAPER\n0.05,\n{PAPER}\n"
    if tied:
        text += "*SURFACE, NAME=SHEET, TYPE=ELEMENT\nPAPER, SPOS\n"
    return Example(text + rest(joints="*TIE, NAME=GLUE\nSHEET, FLOOR" if tied else ""))


def of_joints() -> dict[str, Example]:
    """Sheets, ties, equations, rigid joints and pressures."""
    shared = _sheet("M3D8", "C3D20R", "*MEMBRANE SECTION")
    tied = replace(_sheet("S8R", "C3D20R", "*SHELL SECTION", tied=True), theirs=shared.deck)
    linear = _sheet("M3D3", "C3D4", "*MEMBRANE SECTION")
    corners = replace(_sheet("S4R", "C3D20R", "*SHELL SECTION", tied=True), theirs=shared.deck)
    same, joint = _two("C3D20R", (X, Y), 10000)
    finer: Lines = ((0.0, 3.0, 5.0, 8.0, 11.0, 13.0, 16.0), (-4.0, -3.0, -1.0, 1.0, 3.0, 4.0))
    return {
        "*MEMBRANE SECTION, M3D8": shared,
        "*SHELL SECTION, S8R": _sheet("S8R", "C3D20R", "*SHELL SECTION"),
        "*SHELL SECTION, S8R by *TIE": tied,
        "*SHELL SECTION, S4R by *TIE": corners,
        "*MEMBRANE SECTION, M3D3": linear,
        "*SHELL SECTION, S3": replace(_sheet("S3", "C3D4", "*SHELL SECTION"), theirs=linear.deck),
        "*TIE, nodes that coincide": Example(same + rest(joints=joint)),
        "*TIE, other nodes": _tied_otherwise(finer),
        **_equations(),
        "two pressures": _two_pressures(),
    }


def _tied_otherwise(lower: Lines) -> Example:
    """A solid bar of two meshes whose nodes differ where they meet."""
    slab = lattice("C3D20R", lines=(*lower, (0.0, 2.0)), void=(), first=10000)
    upper = lattice("C3D20R", lines=(BAR[0], (-4.0, -2.0, 0.0, 2.0, 4.0), (2.0, 4.0)), void=())
    text = f"{upper.text}\n{slab.text}\n*NSET, NSET=ROOT\n{upper.where(root)}\n{slab.where(root)}\n"
    for name, faces in (
        ("CHAMBER", upper.faces(_upper)),
        ("UPPER", upper.faces(lambda c: all(z == 2 for _, _, z in c))),
        ("LOWER", slab.faces(lambda c: all(z == 2 for _, _, z in c))),
    ):
        text += f"*SURFACE, NAME={name}, TYPE=ELEMENT\n{faces}\n"
    return Example(text + rest(joints="*TIE, NAME=JOINT, POSITION TOLERANCE=0.1\nUPPER, LOWER", load=BEND))


def _equations() -> dict[str, Example]:
    """The tip of a hollow block that stays plane, and clamps by rigid joints."""
    mesh = lattice("C3D20R")
    tip = [mesh.label(p) for p in mesh.points if mesh.place(p)[0] == 16]
    plain, first = meshed(mesh), tip[0]
    rows = "".join(f"*EQUATION\n2\n{n}, 1, 1., {first}, 1, -1.\n" for n in tip[1:])
    pinned = f"*MPC\nTIE, TIP, {first}"
    apart = "".join(f"*EQUATION\n2\n{n}, {d}, 1., {first}, {d}, -1.\n" for n in tip[1:] for d in (1, 2, 3))
    sets = "*NSET, NSET=TIP\n" + "\n".join(f"{n}," for n in tip) + "\n"
    rest_of_tip = "*NSET, NSET=TIP\n" + "\n".join(f"{n}," for n in tip[1:]) + "\n"
    reference = "*NODE\n90001, -5., 0., 0.\n"
    clamp = "90001, 1, 6"
    ends = mesh.faces(lambda c: all(x == 16 for x, _, _ in c))
    end = f"*NODE\n90002, 16., 0., 3.\n*SURFACE, NAME=END, TYPE=ELEMENT\n{ends}\n"
    moved = "*COUPLING, CONSTRAINT NAME=C, REF NODE=90002, SURFACE=END\n*KINEMATIC\n1, 3"
    free = rest().replace("ROOT, 1, 3\n", "")
    return {
        "*EQUATION": Example(plain + rest(joints=rows)),
        "*MPC, TIE": Example(plain + rest_of_tip + rest(joints=pinned), plain + rest(joints=apart)),
        "*MPC, BEAM": Example(
            plain + reference + free.replace("*BOUNDARY\n", f"*MPC\nBEAM, ROOT, 90001\n*BOUNDARY\n{clamp}\n"),
            plain + rest(),
        ),
        "*RIGID BODY": Example(
            plain + reference + free.replace(
                "*BOUNDARY\n", f"*RIGID BODY, TIE NSET=ROOT, REF NODE=90001\n*BOUNDARY\n{clamp}\n"
            ),
            plain + rest(),
        ),
        "*KINEMATIC": Example(
            plain + end + rest(joints=moved, held="90002, 4, 6\n90002, 3, 3, -0.5"),
            plain + sets + rest(joints="".join(
                f"*EQUATION\n2\n{n}, {d}, 1., {first}, {d}, -1.\n" for n in tip[1:] for d in (1, 2)
            ), held="TIP, 3, 3, -0.5"),
        ),
    }


def _two_pressures() -> Example:
    """Two chambers, one with half of the other's pressure."""
    mesh = lattice("C3D20R", void={(1, 1, 1), (3, 1, 1)})
    text = MESH.format(mesh=mesh.text, root=mesh.where(root), chamber=mesh.faces(
        lambda c: in_chamber(c) and all(x <= 6 for x, _, _ in c)
    ))  # fmt: skip
    second = mesh.faces(lambda c: in_chamber(c) and all(x >= 10 for x, _, _ in c))
    text += f"*SURFACE, NAME=SECOND, TYPE=ELEMENT\n{second}\n"
    return Example(text + rest(load="*DSLOAD\nCHAMBER, P, 0.06\nSECOND, P, 0.03"))


def examples() -> dict[str, Example]:
    """All features by name."""
    return of_words() | of_laws() | of_elements() | of_joints()


def differences(only: str = "") -> dict[str, float]:
    """For each feature how far the deck as it is read is from CalculiX, of the largest displacement."""
    return {name: difference(example) for name, example in examples().items() if only.lower() in name.lower()}


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only", default="", help="features whose name holds this word")
    given = parser.parse_args()
    if given.json:
        print(json.dumps({"decks": differences(given.only)}, indent=1))
        return
    print("| feature of the deck | difference to CalculiX |\n|---|---|")
    for name, example in examples().items():
        if given.only.lower() in name.lower():
            print(f"| `{name}` | {100 * difference(example):.2g} % |", flush=True)


if __name__ == "__main__":
    main()
