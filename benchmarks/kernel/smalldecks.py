"""Small Abaqus decks, each with one feature of decks that others write, and the same structure for CalculiX.

A hollow block, clamped at x = 0, of 42 cells, or a solid bar: elements, nodes and faces by the cells of a
lattice. No code of the packages makes them: node orders and faces are those of the Abaqus manual.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

Cell = tuple[int, int, int]
Point = tuple[int, int, int]

X, Y, Z = (0.0, 2.0, 6.0, 10.0, 14.0, 16.0), (-4.0, -2.0, 2.0, 4.0), (0.0, 2.0, 4.0, 5.0)
VOID = {(1, 1, 1), (2, 1, 1), (3, 1, 1)}
HEX = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
       (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
       (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]  # fmt: skip
HEX_FACES = ("1234", "5876", "1562", "2673", "3784", "4851")
TET_FACES = ("123", "142", "243", "341")
WEDGE_FACES = ("123", "465", "1254", "2365", "3146")
TET_MIDDLES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
WEDGE_MIDDLES = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
SIX = ("1237", "1347", "1487", "1857", "1567", "1627")
TWO = ("124568", "234678")
SOFT = "*HYPERELASTIC, NEO HOOKE\n0.1, 3."  # MPa; K is 3.3 times the shear modulus: nothing locks
RUBBER = "*HYPERELASTIC, MOONEY-RIVLIN\n0.18, 0.06, 0.02"  # K is 200 times the shear modulus


@dataclass
class Mesh:
    """Elements (type, points of the half lattice), each with its cell, of a lattice of lines x, y, z in mm;
    first: what is added to all labels."""

    lines: tuple[tuple[float, ...], ...] = (X, Y, Z)
    first: int = 0
    elements: list[tuple[str, list[Point], Cell]] = field(default_factory=list)

    def place(self, point: Point) -> list[float]:
        """Of a point of the half lattice, mm."""
        return [(line[n // 2] + line[(n + 1) // 2]) / 2 for line, n in zip(self.lines, point, strict=True)]

    def label(self, point: Point) -> int:
        """Of its node: no other point's."""
        a, b, c = point
        return self.first + 1 + a + 20 * b + 400 * c

    @property
    def points(self) -> list[Point]:
        """Those that have a node."""
        return sorted({p for _, points, _ in self.elements for p in points}, key=self.label)

    def where(self, inside: Callable[[list[float]], bool]) -> str:
        """The labels of nodes by their places, as data lines."""
        found = [self.label(p) for p in self.points if inside(self.place(p))]
        return "\n".join(", ".join(map(str, found[k : k + 8])) for k in range(0, len(found), 8))

    @property
    def nodes(self) -> str:
        """The data lines of *NODE."""
        rows = ((self.label(p), ", ".join(f"{x:.8g}" for x in self.place(p))) for p in self.points)
        return "\n".join(f"{label}, {place}" for label, place in rows)

    @property
    def text(self) -> str:
        """*NODE with the set ALL, and *ELEMENT with the set BODY."""
        lines = ["*NODE, NSET=ALL", self.nodes]
        for own in dict.fromkeys(k for k, _, _ in self.elements):
            lines.append(f"*ELEMENT, TYPE={own}, ELSET=BODY")
            for number, (found, points, _) in enumerate(self.elements, start=self.first + 1):
                row = [str(number), *(str(self.label(p)) for p in points)]
                if found == own:
                    cut = 11 if len(row) > 12 else len(row)
                    lines += [", ".join(row[:cut]) + "," * (cut < len(row)), ", ".join(row[cut:])]
        return "\n".join(lines)

    def faces(self, chosen: Callable[[list[list[float]]], bool]) -> str:
        """The data lines of *SURFACE: the faces on the skin whose corners' places are chosen."""
        every: dict[frozenset[Point], list[str]] = {}
        for number, (_, points, _) in enumerate(self.elements, start=self.first + 1):
            own = {4: TET_FACES, 10: TET_FACES, 6: WEDGE_FACES, 15: WEDGE_FACES}.get(len(points), HEX_FACES)
            for f, digits in enumerate(own, start=1):
                corners = frozenset(points[int(d) - 1] for d in digits)
                every.setdefault(corners, []).append(f"{number}, S{f}")
        skin = ((corners, own[0]) for corners, own in every.items() if len(own) == 1)
        return "\n".join(row for corners, row in skin if chosen([self.place(p) for p in corners]))


def lattice(
    kind: str, *, lines: tuple[tuple[float, ...], ...] = (X, Y, Z), void: Iterable[Cell] = VOID,
    first: int = 0, other: tuple[str, Callable[[Cell], bool]] | None = None,
) -> Mesh:  # fmt: skip
    """A mesh of elements `kind` in all cells but `void`, or of another type in the cells that it names."""
    mesh, gone = Mesh(lines, first), set(void)
    for i in range(len(lines[0]) - 1):
        for j in range(len(lines[1]) - 1):
            for k in range(len(lines[2]) - 1):
                if (i, j, k) in gone:
                    continue
                own = other[0] if other and other[1]((i, j, k)) else kind
                at = [(2 * i + a, 2 * j + b, 2 * k + c) for a, b, c in HEX]
                mesh.elements += [(own, points, (i, j, k)) for points in _points(own, at)]
    return mesh


def _points(kind: str, at: list[Point]) -> list[list[Point]]:
    """The nodes of the elements of a type that fill a cell."""
    if kind.startswith("C3D20"):
        return [at]
    if kind.startswith("C3D8"):
        return [at[:8]]
    wedge = kind.startswith(("C3D6", "C3D15"))
    middles = WEDGE_MIDDLES if wedge else TET_MIDDLES
    out = []
    for digits in TWO if wedge else SIX:
        c = [at[int(d) - 1] for d in digits]
        more = [tuple((x + y) // 2 for x, y in zip(c[a], c[b], strict=True)) for a, b in middles]
        out.append([*c, *more] if kind.startswith(("C3D10", "C3D15")) else c)
    return out  # type: ignore[return-value]


def in_chamber(corners: list[list[float]]) -> bool:
    """Whether a face on the skin is the chamber's."""
    return all(2 <= x <= 14 and -2 <= y <= 2 and 2 <= z <= 4 for x, y, z in corners)


def root(x: list[float]) -> bool:
    """Whether a node is held."""
    return x[0] == 0


MESH = """\
{mesh}
*NSET, NSET=ROOT
{root}
*SURFACE, NAME=CHAMBER, TYPE=ELEMENT
{chamber}
"""
REST = """\
*SOLID SECTION, ELSET=BODY, MATERIAL=RUBBER
*MATERIAL, NAME=RUBBER
{law}
{joints}
*BOUNDARY
ROOT, 1, 3
{held}
*STEP, NLGEOM=YES, INC=500
*STATIC
0.25, 1., 1e-05, 0.25
{load}
*NODE FILE
U
*END STEP
"""


def meshed(mesh: Mesh) -> str:
    """The mesh of a hollow block as text."""
    return MESH.format(mesh=mesh.text, root=mesh.where(root), chamber=mesh.faces(in_chamber))


LOAD = "*DSLOAD\nCHAMBER, P, 0.03"


def rest(law: str = SOFT, *, joints: str = "", held: str = "", load: str = LOAD) -> str:
    """Section, material, supports and step."""
    return REST.format(law=law, joints=joints, held=held, load=load)
