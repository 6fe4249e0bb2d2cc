"""A natural feature: a square of the surface's own texture, or of a painted spot, without a code."""

from dataclasses import dataclass

from vision.artwork import Artwork
from vision.kinds.markkind import Texture


@dataclass(frozen=True)
class TexturePatch:
    """A square of texture, its side size_mm, by where the frame marks see it in the film's first picture.

    It is registered like a coded marker, to its own mean picture at rest; it turns and stretches with the
    surface. Once lost it is found again only near where it was: nothing tells it from others.
    """

    size_mm: float
    seen_mm: tuple[float, float]  # mm, x and z of its middle in the frame marks' plane
    shows_turn = True
    stretches = True

    def artwork(self, dictionary: str) -> Artwork:
        """Nothing: raises ValueError."""
        raise ValueError("a natural feature is not printed: it is on the finger already")

    def texture(self, texels_per_mm: float, dictionary: str) -> Texture:
        """Nothing: raises ValueError."""
        raise ValueError("a natural feature is not drawn as a mark: draw the face")
