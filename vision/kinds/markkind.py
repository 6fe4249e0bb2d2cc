"""What every kind of mark tells of itself."""

from typing import NamedTuple, Protocol

from vision.artwork import Artwork
from vision.camera import Array


class Texture(NamedTuple):
    """A mark as it is printed, in texels, with its clear border."""

    paper: Array  # (k,k) 1 white, 0 black
    per_mm: float  # texels


class MarkKind(Protocol):
    """A kind of mark, with its size."""

    @property
    def size_mm(self) -> float:
        """Side or diameter in mm."""
        ...

    @property
    def shows_turn(self) -> bool:
        """Whether its picture tells how it is turned and how large it looks."""
        ...

    @property
    def stretches(self) -> bool:
        """Whether it grows with the skin that it is on, so that its size tells nothing of its distance."""
        ...

    def artwork(self, dictionary: str) -> Artwork:
        """The sheet to print. Raises ValueError for a kind that is not printed."""
        ...

    def texture(self, texels_per_mm: float, dictionary: str) -> Texture:
        """The print with about so many texels a mm. Raises ValueError for a kind that is not printed."""
        ...
