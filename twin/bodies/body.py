"""The protocol of a kind of actuator: mesh, finer meshes, places for markers, and the drawing of its
dimensions."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from twin.tablemodel import TableModel

if TYPE_CHECKING:  # the finite elements are loaded by whoever needs them
    from fe import Case, Material

Place = tuple[float, float, float]  # x, y, z in mm
GAP = 0.045  # of the drawn length: from the body to the first line of a dimension, and from line to line
TIP, MIDDLE = "tip", "middle"
MIDWAY = 0.55  # of the length from the clamp: the middle node


@dataclass(frozen=True)
class Arrow:
    """A dimension: its text, between which two points, and how far beside them its line lies, mm."""

    text: str
    start: tuple[float, float]
    end: tuple[float, float]
    off: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Sketch:
    """The dimensions of a body as arrows: from the side (x, z), in the cut along the middle (x, z), and in
    the cut across (y, z), which is at x = left on its left half and at x = right on its right one.

    names: what the two halves of the cut across show, "" where both show the same. note: what no arrow shows.
    """

    side: tuple[Arrow, ...]
    along: tuple[Arrow, ...]
    across: tuple[Arrow, ...]
    left: float
    right: float
    names: str = ""
    note: str = ""


class Body(Protocol):
    """A kind of actuator with its dimensions. x runs along it from the clamp, y across, z up from its lowest
    place; it is symmetric about y = 0, and bends to -z under pressure.

    Every case is the half y >= 0: node sets clamp, symmetry and tip_face, surfaces chamber (the pressurised
    one, where there is a chamber) and outside. The nodes that `fe.mesh.finger.NAMED_NODES` labels are its tip
    and its middle.
    """

    @property
    def kind(self) -> str:
        """Its name in twin.toml: body = "tube"."""
        ...

    @property
    def bends_down(self) -> bool:
        """Whether it always bends to -z: others may lie or bend in any way."""
        ...

    @property
    def lattice(self) -> Any:
        """The division that its dimensions ask for: a frozen dataclass whose `refine` divides every cell in
        each direction."""
        ...

    def case(self, lattice: Any, material: "Material") -> "Case":
        """The case of the half on a lattice."""
        ...

    def finer(self, lattice: Any) -> Mapping[str, Any]:
        """Lattices whose solutions tell the error of this one: each finer in one way, the last, `check`, in
        every way."""
        ...

    def key(self, lattice: Any) -> str:
        """A fingerprint of dimensions and lattice."""
        ...

    @property
    def inner(self) -> tuple[str, ...]:
        """The dimensions in mm, as twin.toml names them, that change nothing but the chamber: no camera sees
        them."""
        ...

    def larger(self, dimension: str, mm: float) -> "Body":
        """The body with one of them larger by mm."""
        ...

    @property
    def places(self) -> Mapping[str, Place]:
        """Places for markers by name, mm: p1, p2 .. along its lower side, `tip`, and off1 .. above them."""
        ...

    @property
    def sketch(self) -> Sketch:
        """Its dimensions, to be drawn."""
        ...

    @property
    def remedy(self) -> str:
        """The change of dimensions that helps where its mesh folds, in words."""
        ...


@dataclass(frozen=True, kw_only=True)
class Cells:
    """The division of a body: cells along it (of a chamber, or of all of it), across and up its section,
    across each wall, and along each end cap; `refine` divides all of them.

    >>> Cells(along=4, across=2, up=3, refine=2).counts
    (8, 4, 6, 2, 4)
    """

    along: int
    across: int
    up: int
    wall: int = 1
    caps: int = 2
    refine: int = 1

    @property
    def counts(self) -> tuple[int, int, int, int, int]:
        """Cells along, across, up, across a wall and along a cap, divided."""
        n = self.refine
        return n * self.along, n * self.across, n * self.up, n * self.wall, n * self.caps


class CellTable(TableModel):
    """Dimensions of a body that is divided by `Cells`."""

    inner: ClassVar[tuple[str, ...]] = ()  # dimensions of the chamber alone

    def larger(self, dimension: str, mm: float) -> Self:
        """The body with one of its dimensions larger by mm."""
        return self.model_copy(update={dimension: getattr(self, dimension) + mm})

    def key(self, lattice: Cells) -> str:
        """A fingerprint of dimensions and lattice."""
        from fe.case import digest

        return digest(self, lattice)

    def finer(self, lattice: Cells) -> Mapping[str, Cells]:
        """Finer cells along, across the walls, in the section, and, as `check`, in every direction."""
        along, caps = _more(lattice.along), _more(lattice.caps)
        across, up = _more(lattice.across), _more(lattice.up)
        wall = _more(lattice.wall)
        return {
            "cells along": replace(lattice, along=along, caps=caps),
            "walls": replace(lattice, wall=wall),
            "section": replace(lattice, across=across, up=up),
            "check": replace(lattice, along=along, caps=caps, wall=wall, across=across, up=up),
        }


def _more(count: int) -> int:
    return max(count + 1, round(1.5 * count))


def edge_places(length: float, y: float, z: float) -> dict[str, Place]:
    """Six places p1 .. p6 along a line at y and z, from 0.3 to 0.9 of the length, and the tip at its end.

    >>> edge_places(100.0, 11.5, 0.0)["p1"], edge_places(100.0, 11.5, 0.0)["tip"]
    ((30.0, 11.5, 0.0), (100.0, 11.5, 0.0))
    """
    places = {f"p{k + 1}": (float(x), y, z) for k, x in enumerate(np.linspace(0.3, 0.9, 6) * length)}
    return places | {TIP: (length, y, z)}


def marks(length: float, y: float, z: float) -> dict[int, Place]:
    """The places of the labelled nodes, tip and middle, on a line at y and z."""
    from fe.mesh.finger import NAMED_NODES

    stations = {TIP: length, MIDDLE: MIDWAY * length}
    return {NAMED_NODES[name]: (x, y, z) for name, x in stations.items()}
