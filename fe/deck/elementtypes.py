"""The element that each Abaqus type of a deck is read as, and the one type that a case has."""

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
    """How many nodes an element of that type has; None where it cannot be read."""
    return (KINDS | SHEETS).get(kind)


def read_as(kind: str) -> str:
    """The type that stands for that of a deck."""
    return (RICHER | SAME).get(kind, kind)


def one_type(found: Iterable[str], remark: Callable[[str], None]) -> tuple[str, bool]:
    """The one type that the types found become, and whether its elements become richer ones. Sentences say
    what changes."""
    own = set(found)
    richer = own & set(RICHER)
    for kind in sorted(own & set(SAME)):
        remark(f"Elements {kind} are read as {SAME[kind]}.")
    kinds = {read_as(kind) for kind in own}
    if len(kinds) == 1:
        (kind,) = kinds
        return (kind, bool(richer)) if not kind.startswith(WEDGES) else (TETRAHEDRA, False)
    for first, *others in FAMILIES:
        if kinds <= {first, *others}:
            if len({k.rstrip("H") for k in kinds}) > 1:
                remark(f"Elements of the types {', '.join(sorted(kinds))} are all read as {first}.")
            return first, bool(richer)
    return TETRAHEDRA, False


WEDGES = ("C3D6", "C3D15")


def divides(found: Iterable[str]) -> bool:
    """Whether elements of these types become tetrahedra: wedges, and shapes that are mixed."""
    return one_type(found, lambda _: None)[0] == TETRAHEDRA and not {read_as(k) for k in found} <= {
        "C3D10", TETRAHEDRA,
    }  # fmt: skip
