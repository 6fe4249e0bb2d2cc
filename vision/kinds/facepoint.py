"""A part of a speckled face that is followed like a mark."""

from dataclasses import dataclass

from vision.artwork import Artwork
from vision.kinds.markkind import Texture


@dataclass(frozen=True)
class FacePoint:
    """A square of speckles, its side size_mm; it turns and stretches with the face."""

    size_mm: float
    shows_turn = True
    stretches = True

    def artwork(self, dictionary: str) -> Artwork:
        """Nothing: raises ValueError."""
        raise ValueError("a point of the speckled face is not printed: spray the speckles on")

    def texture(self, texels_per_mm: float, dictionary: str) -> Texture:
        """Nothing: raises ValueError."""
        raise ValueError("a point of the speckled face is not drawn as a mark: draw the face")
