"""Decks as published soft actuators have them: parts, a paper layer by *TIE, a mesh in a file of its own.

    python benchmarks/kernel/actuatordecks.py FOLDER

`bellows`: C3D10H and Yeoh rubber, a paper layer of S4R on nodes of its own, glued by *TIE, the mesh by
*INCLUDE; `twolayers`: two parts of C3D20RH, the lower one stiffer, joined by *TIE, in metres and pascals.
"""

import os
import sys
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.kernel.smalldecks import Mesh, lattice, root

X = (0.0, 6.0, 12.0, 15.0, 21.0, 24.0, 30.0, 33.0, 39.0, 45.0)  # mm, walls of 3 mm between chambers
Y, Z = (-8.0, -5.0, 5.0, 8.0), (0.0, 3.0, 6.0, 12.0, 14.0)
CHAMBERS = {(i, 1, k) for i in (1, 3, 5, 7) for k in (1, 2)} | {(i, 1, 1) for i in range(1, 8)}
TIP, MIDDLE = (45.0, 8.0, 0.0), (24.0, 8.0, 0.0)  # mm


def _inside(corners: list[list[float]]) -> bool:
    return all(6 <= x <= 39 and -5 <= y <= 5 and 3 <= z <= 12 for x, y, z in corners)


def _floor(corners: list[list[float]]) -> bool:
    return all(z == 0 for _, _, z in corners)


def bellows() -> dict[str, str]:
    """A row of chambers over a channel with a paper layer below: files by name, the deck first."""
    mesh = lattice("C3D10H", lines=(X, Y, Z), void=CHAMBERS)
    rows = list[str]()
    paper = {(x, y): 1 + i + 20 * j for i, x in enumerate(X) for j, y in enumerate(Y)}
    for i in range(len(X) - 1):
        for j in range(len(Y) - 1):
            corners = [(X[a], Y[b]) for a, b in ((i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j))]
            rows.append(f"{len(rows) + 1}, {', '.join(str(paper[c]) for c in corners)}")
    nodes = "\n".join(f"{n}, {x}, {y}, 0." for (x, y), n in paper.items())
    sheet = "\n".join(rows)
    deck = f"""*HEADING
 row of chambers over a channel, paper below
*PARAMETER
thickness = 0.1
load = 2 * 0.01
*PART, NAME=Body
*INCLUDE, INPUT=body.inp
*SOLID SECTION, ELSET=Body, MATERIAL=Ecoflex
,
*END PART
*PART, NAME=Paper
*NODE
{nodes}
*ELEMENT, TYPE=S4R, ELSET=Set-1
{sheet}
*SURFACE, NAME=Glued, TYPE=ELEMENT
Set-1, SPOS
*SHELL SECTION, ELSET=Set-1, MATERIAL=Paper
<thickness>, 5
*END PART
*ASSEMBLY, NAME=Assembly
*INSTANCE, NAME=Body-1, PART=Body
*END INSTANCE
*INSTANCE, NAME=Paper-1, PART=Paper
*END INSTANCE
*NSET, NSET=Set-1, INSTANCE=Body-1
Body-1.Root
*TIE, NAME=Glue, ADJUST=YES
Paper-1.Glued, Body-1.Floor
*END ASSEMBLY
*MATERIAL, NAME=Ecoflex
*DENSITY
1.07e-09,
*HYPERELASTIC, YEOH
0.11, 0.02, 0., 0.01, 0., 0.
*MATERIAL, NAME=Paper
*ELASTIC
6500., 0.2
*AMPLITUDE, NAME=Ramp
0., 0., 1., 1.
*STEP, NAME=Inflate, NLGEOM=YES, INC=1000
*STATIC
0.01, 1., 1e-08, 0.05
*BOUNDARY
Set-1, ENCASTRE
*DSLOAD, AMPLITUDE=Ramp
Body-1.Chamber, P, <load>
*OUTPUT, FIELD, VARIABLE=PRESELECT
*END STEP
"""
    return {"bellows.inp": deck, "body.inp": _part(mesh)}


def _part(mesh: Mesh) -> str:
    text = mesh.text.replace("ELSET=BODY", "ELSET=Body")
    surfaces = (("Chamber", mesh.faces(_inside)), ("Floor", mesh.faces(_floor)))
    text += f"\n*NSET, NSET=Root\n{mesh.where(root)}\n"
    text += "".join(f"*SURFACE, NAME={name}, TYPE=ELEMENT\n{faces}\n" for name, faces in surfaces)
    return "".join(f"{line}\n" for line in text.splitlines() if line.strip())


def two_layers() -> dict[str, str]:
    """The same chambers without floor on a stiffer slab with another mesh, in metres and pascals."""
    upper = lattice("C3D20RH", lines=(X, Y, Z[1:]), void={(i, j, k - 1) for i, j, k in CHAMBERS})
    slab = lattice("C3D20RH", lines=((0.0, 6.0, 13.5, 22.5, 31.5, 39.0, 45.0), Y, Z[:2]), void=())

    def below(corners: list[list[float]]) -> bool:
        return all(z == 3 and 6 <= x <= 39 and -5 <= y <= 5 for x, y, z in corners)

    parts, rows = "", [f"Upper-1.{row}" for row in upper.faces(_inside).splitlines()]
    rows += [f"Slab-1.{row}" for row in slab.faces(below).splitlines()]
    for name, mesh in (("Upper", upper), ("Slab", slab)):
        joint = mesh.faces(lambda c: all(z == 3 for _, _, z in c))
        nodes = "\n".join(
            f"{mesh.label(p)}, {', '.join(f'{x / 1000:.9g}' for x in mesh.place(p))}" for p in mesh.points
        )
        elements = mesh.text.partition("*ELEMENT")[2]
        parts += f"*PART, NAME={name}\n*NODE\n{nodes}\n*ELEMENT{elements}\n"
        parts += f"*NSET, NSET=Root\n{mesh.where(root)}\n*SURFACE, NAME=Joint, TYPE=ELEMENT\n{joint}\n"
        parts += f"*SOLID SECTION, ELSET=BODY, MATERIAL={name}\n,\n*END PART\n"
    chamber = "\n".join(rows)
    deck = f"""*HEADING
** units: m, N, s
{parts}*ASSEMBLY, NAME=Assembly
*INSTANCE, NAME=Upper-1, PART=Upper
*END INSTANCE
*INSTANCE, NAME=Slab-1, PART=Slab
*END INSTANCE
*NSET, NSET=Clamp
Upper-1.Root, Slab-1.Root
*SURFACE, NAME=Chamber, TYPE=ELEMENT
{chamber}
*TIE, NAME=Joint, POSITION TOLERANCE=0.0001
Upper-1.Joint, Slab-1.Joint
*END ASSEMBLY
*MATERIAL, NAME=Upper
*HYPERELASTIC, NEO HOOKE
0.11e6, 0.
*MATERIAL, NAME=Slab
*HYPERELASTIC, NEO HOOKE
0.6e6, 0.
*BOUNDARY
Clamp, ENCASTRE
*STEP, NAME=Inflate, NLGEOM=YES
*STATIC
0.1, 1.
*DSLOAD
Chamber, P, 15e3
*END STEP
"""
    return {"twolayers.inp": "".join(f"{x}\n" for x in deck.splitlines() if x.strip())}


def write(folder: Path) -> dict[str, Path]:
    """Both decks in a folder of each; the path of each deck."""
    out = {}
    for name, files in (("bellows", bellows()), ("twolayers", two_layers())):
        (folder / name).mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            (folder / name / file).write_text(text, encoding="utf-8")
        out[name] = folder / name / f"{name}.inp"
    return out


if __name__ == "__main__":
    for made in write(Path(sys.argv[1])).values():
        print(made)
