"""A round dot without a code, dark on light or light on dark."""

from dataclasses import dataclass

import numpy as np

from vision.artwork import Artwork, sheet
from vision.kinds.markkind import Texture

PAPER = 1.6  # side of the clear square round a dot, in its diameters


@dataclass(frozen=True)
class PlainDot:
    """A dot; size_mm is its diameter. It does not show how it is turned."""

    size_mm: float
    shows_turn = False
    stretches = False

    def artwork(self, dictionary: str) -> Artwork:
        """The dot in its clear square."""
        side = PAPER * self.size_mm
        circle = np.array([[side / 2.0, side / 2.0, self.size_mm / 2.0]])
        return sheet((side, side), circles=circle)

    def texture(self, texels_per_mm: float, dictionary: str) -> Texture:
        """The print with so many texels a mm, its edge one texel wide."""
        side = int(np.ceil(PAPER * self.size_mm * texels_per_mm))
        offset = np.arange(side) - 0.5 * (side - 1)
        edge = np.hypot(offset[:, None], offset[None]) - 0.5 * self.size_mm * texels_per_mm
        return Texture(np.asarray(np.clip(edge + 0.5, 0.0, 1.0), dtype=np.float64), texels_per_mm)
