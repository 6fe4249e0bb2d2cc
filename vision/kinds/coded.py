"""A marker that carries its own number: ArUco, AprilTag or a dictionary of one's own."""

from dataclasses import dataclass

import numpy as np

from vision.artwork import Artwork, dark_runs, sheet, shifted
from vision.dictionaries import bits_of
from vision.kinds.markkind import Texture

QUIET_CELLS = 1  # border round a marker that has to stay clear, in its cells


@dataclass(frozen=True)
class CodedMarker:
    """A marker by its number in the dictionary; size_mm is the side of the square with the code."""

    code: int
    size_mm: float
    shows_turn = True
    stretches = False

    def artwork(self, dictionary: str) -> Artwork:
        """The marker with its clear border."""
        dark = bits_of(self.code, dictionary) == 0
        cell = self.size_mm / len(dark)
        border = QUIET_CELLS * cell
        side = self.size_mm + 2.0 * border
        return sheet((side, side), rectangles=shifted(dark_runs(dark) * cell, border, border))

    def texture(self, texels_per_mm: float, dictionary: str) -> Texture:
        """The print with whole texels a cell, at least so many a mm."""
        bits = bits_of(self.code, dictionary)
        cells = len(bits)
        texels = int(np.ceil(texels_per_mm * self.size_mm / cells))
        paper = np.pad(np.asarray(bits, dtype=np.float64) / 255.0, QUIET_CELLS, constant_values=1.0)
        fine = np.asarray(np.kron(paper, np.ones((texels, texels))), dtype=np.float64)
        return Texture(fine, cells * texels / self.size_mm)
