"""Kinds of marks: marker with a code, plain dot, natural texture, point of a speckled face.

Their ways through a film stand in `vision.following`.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from vision.artwork import Artwork, dark_runs, sheet, shifted
from vision.camera import Array
from vision.dictionaries import bits_of

QUIET_CELLS = 1  # clear border round a marker, in its cells
PAPER = 1.6  # side of the clear square round a dot, in its diameters


class Texture(NamedTuple):
    """A printed mark with its clear border, in texels."""

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
        """True if its picture tells how it is turned and how large it looks."""
        ...

    @property
    def stretches(self) -> bool:
        """True if it grows with the skin that it is on: its size tells nothing of its distance."""
        ...

    def artwork(self, dictionary: str) -> Artwork:
        """The sheet to print. Raises ValueError for a kind that is not printed."""
        ...

    def texture(self, texels_per_mm: float, dictionary: str) -> Texture:
        """The print with about `texels_per_mm`. Raises ValueError for a kind that is not printed."""
        ...


@dataclass(frozen=True)
class CodedMarker:
    """A marker by its number in the dictionary; size_mm is the side of the square with the code.

    >>> CodedMarker(3, 12.0).artwork("DICT_4X4_50").width  # mm, with the clear border
    16.0
    """

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
        """The print with whole texels a cell, at least `texels_per_mm` a mm."""
        bits = bits_of(self.code, dictionary)
        cells = len(bits)
        texels = int(np.ceil(texels_per_mm * self.size_mm / cells))
        paper = np.pad(np.asarray(bits, dtype=np.float64) / 255.0, QUIET_CELLS, constant_values=1.0)
        fine = np.asarray(np.kron(paper, np.ones((texels, texels))), dtype=np.float64)
        return Texture(fine, cells * texels / self.size_mm)


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
        """The print with `texels_per_mm` texels a mm, its edge one texel wide."""
        side = int(np.ceil(PAPER * self.size_mm * texels_per_mm))
        offset = np.arange(side) - 0.5 * (side - 1)
        edge = np.hypot(offset[:, None], offset[None]) - 0.5 * self.size_mm * texels_per_mm
        return Texture(np.asarray(np.clip(edge + 0.5, 0.0, 1.0), dtype=np.float64), texels_per_mm)


class _Unprinted:
    """A kind of mark that is neither printed nor drawn; it turns and stretches with the surface."""

    shows_turn = True
    stretches = True
    refusal = ""  # the sentence for those who would print it

    def artwork(self, dictionary: str) -> Artwork:
        """Raises ValueError: there is no sheet."""
        raise ValueError(self.refusal)

    def texture(self, texels_per_mm: float, dictionary: str) -> Texture:
        """Raises ValueError: it is a part of the face's picture."""
        raise ValueError(f"{self.refusal}; to draw a film, draw the face")


@dataclass(frozen=True)
class TexturePatch(_Unprinted):
    """A square of texture, its side size_mm, by where the frame marks see it in the film's first picture.

    It is registered like a coded marker, to its own mean picture at rest; it turns and stretches with the
    surface. Once lost it is found again only near where it was: nothing tells it from others.
    """

    size_mm: float
    seen_mm: tuple[float, float]  # mm, x and z of its middle in the frame marks' plane
    refusal = "a natural feature is not printed: it is on the finger already"


@dataclass(frozen=True)
class FacePoint(_Unprinted):
    """A square of speckles, its side size_mm; it turns and stretches with the face."""

    size_mm: float
    refusal = "a point of the speckled face is not printed: spray the speckles on"
