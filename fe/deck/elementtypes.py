"""The element that stands for each Abaqus type of a deck, and the single type of a case's elements."""

from collections.abc import Callable, Iterable

from fe.mesh.tetrahedra import SOLIDS

# What Abaqus has against locking or hourglasses is its own: here a richer element serves instead.
RICHER = {"C3D8R": "C3D8H", "C3D8RH": "C3D8H", "C3D8I": "C3D8H", "C3D8IH": "C3D8H"}
SAME = {f"C3D10{letters}": "C3D10H" for letters in ("M", "MH", "HS", "I")}
# As alike as two types can be: the first has the nodes of the others, and the better rule.
FAMILIES = (
    ("C3D20RH", "C3D20R"), ("C3D20H", "C3D20"), ("C3D20H", "C3D20", "C3D20RH", "C3D20R"), ("C3D8H", "C3D8"),
    ("C3D10H", "C3D10"), ("C3D4H", "C3D4"),
)  # fmt: skip
TETRAHEDRA = "C3D10H"
KINDS = {kind: solid.corners + len(solid.edges) for kind, solid in SOLIDS.items()}
KINDS |= {kind: KINDS[other] for kind, other in (RICHER | SAME).items()}  # and their nodes
SHEETS = {
    "S3": 3, "S3R": 3, "S4": 4, "S4R": 4, "S4R5": 4, "S8R": 8, "S8R5": 8, "STRI3": 3, "STRI65": 6, "S6": 6,
    "S8": 8, "M3D3": 3, "M3D4": 4, "M3D4R": 4, "M3D6": 6, "M3D8": 8, "M3D8R": 8,
}  # fmt: skip


def nodes_of(kind: str) -> int | None:
    """Number of nodes of an element type; None for a type that is not supported.

    >>> nodes_of("C3D20RH"), nodes_of("S4R"), nodes_of("C3D27")
    (20, 4, None)
    """
    return (KINDS | SHEETS).get(kind)


def read_as(kind: str) -> str:
    """The element type that replaces a type of the deck.

    >>> read_as("C3D10M")
    'C3D10H'
    """
    return (RICHER | SAME).get(kind, kind)


def one_type(types: Iterable[str], remark: Callable[[str], None]) -> tuple[str, bool]:
    """The element type that replaces all `types` of a mesh, and True if its elements become 27-node ones.
    `remark` receives a sentence about every replacement."""
    distinct = set(types)
    richer = distinct & set(RICHER)
    for kind in sorted(distinct & set(SAME)):
        remark(f"Elements {kind} are read as {SAME[kind]}.")
    kinds = {read_as(kind) for kind in distinct}
    if len(kinds) == 1:
        (kind,) = kinds
        return (kind, bool(richer)) if not kind.startswith(WEDGES) else (TETRAHEDRA, False)
    for family, *others in FAMILIES:
        if kinds <= {family, *others}:
            if len({k.rstrip("H") for k in kinds}) > 1:
                remark(f"Elements of the types {', '.join(sorted(kinds))} are all read as {family}.")
            return family, bool(richer)
    return TETRAHEDRA, False


WEDGES = ("C3D6", "C3D15")


def divides(types: Iterable[str]) -> bool:
    """True if elements of these types are divided into tetrahedra: wedges, and meshes of mixed shapes.

    >>> divides(["C3D8H", "C3D4"]), divides(["C3D8H", "C3D8"])
    (True, False)
    """
    return one_type(types, lambda _: None)[0] == TETRAHEDRA and not {read_as(k) for k in types} <= {
        "C3D10", TETRAHEDRA,
    }  # fmt: skip
