"""A printed calibration board: what every kind of it can do."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vision.artwork import Artwork
from vision.camera import Array, Image

MIN_CORNERS = 8  # that make a picture of a board count
_KINDS: dict[str, type["Board"]] = {}


@dataclass(frozen=True)
class BoardView:
    """Points of a board in one picture."""

    points: Array  # (n,3) mm on the board
    pixels: Array  # (n,2) raw px
    outlines: tuple[Array, ...] = ()  # (n) of (k,2) raw px, of circles

    def __len__(self) -> int:
        return len(self.pixels)


NOTHING = BoardView(np.empty((0, 3)), np.empty((0, 2)))


class Print(NamedTuple):
    """A printed board, in texels."""

    paper: Array  # (h,w) 1 white, 0 black
    origin: float  # texels, x and y of the board's point (0, 0)
    per_mm: float  # texels


class Reading(NamedTuple):
    """Another way to read a print, and a sentence where it is the right one."""

    board: "Board"
    text: str
    asks: bool  # whether the user should state it so


def flipped(picture: Image) -> Image:
    """The picture (h,w) as a mirror shows it, left for right."""
    return np.ascontiguousarray(picture[:, ::-1])


@dataclass(frozen=True, kw_only=True)
class Board(ABC):
    """A printed board, flat, with one size of square.

    A kind states its name (`class Chessboard(Board, kind="chessboard")`) and the methods below.
    """

    kind: ClassVar[str]
    shows: ClassVar[str] = "corners"  # what is found on it
    joins_cameras: ClassVar[bool] = True  # whether points of one picture are found again in another

    columns: int
    rows: int
    square_mm: float
    inverted: bool = False  # white printed on black
    mirrored: bool = False  # printed mirrored, or a film that is seen from behind

    def __init_subclass__(cls, *, kind: str, **rest: Any) -> None:
        super().__init_subclass__(**rest)
        cls.kind = kind
        _KINDS[kind] = cls

    @staticmethod
    def of(kind: str, **stated: Any) -> "Board":
        """The board of a kind, from the fields that this kind has.

        Raises ValueError for a kind that does not exist.

        >>> from vision.boards import chessboard
        >>> board = Board.of("chessboard", columns=3, rows=2, square_mm=20.0)
        >>> board.points[:4].tolist()
        [[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [40.0, 0.0, 0.0], [0.0, 20.0, 0.0]]
        """
        if kind not in _KINDS:
            raise ValueError(f"board kind {kind!r} is not known: use one of {', '.join(_KINDS)}")
        names = {field.name for field in fields(_KINDS[kind])}
        return _KINDS[kind](**{name: value for name, value in stated.items() if name in names})

    @staticmethod
    def kinds() -> dict[str, type["Board"]]:
        """All kinds by their names."""
        return dict(_KINDS)

    @property
    def points(self) -> Array:
        """Places (n,3) mm of the board's corners or circles, row by row."""
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        return np.stack([column, row, np.zeros(len(row))], axis=1) * self.square_mm

    def find(self, picture: Image) -> BoardView:
        """Points of the board in a picture (h,w), black on white; `NOTHING` where it is not seen.

        On a mirrored board the points are those of the print: x runs to the left.
        """
        if not self.mirrored:
            return self.look(picture)
        seen, last = self.look(flipped(picture)), picture.shape[1] - 1.0
        outlines = tuple(outline * (-1.0, 1.0) + (last, 0.0) for outline in seen.outlines)
        return BoardView(seen.points * (-1.0, 1.0, 1.0), seen.pixels * (-1.0, 1.0) + (last, 0.0), outlines)

    @abstractmethod
    def look(self, picture: Image) -> BoardView:
        """Points of a board that is not mirrored."""

    @abstractmethod
    def artwork(self) -> Artwork:
        """The sheet to print, with a clear border."""

    @abstractmethod
    def print_of(self, texels: float) -> Print:
        """The print with `texels` texels a square or a few more."""

    def other_readings(self) -> list[Reading]:
        """The same print, counted or drawn otherwise."""
        return []

    def advice(self, pictures: Sequence[Image], needed: int) -> str:
        """Advice where too few pictures show the board, as the end of a sentence.

        wanted: number of pictures that must show it.
        """
        return ": check kind, columns and rows, and photograph the whole board sharply" + self.doubt(pictures)

    def doubt(self, pictures: Sequence[Image]) -> str:
        """Evidence for another kind of board, as the end of a sentence; "" where there is none."""
        return ""

    def usable(self, pictures: Sequence[Image]) -> int:
        """Number of pictures that show at least 8 points."""
        return sum(len(self.find(picture)) >= MIN_CORNERS for picture in pictures)

    def black_on_white(self, picture: Image) -> Image:
        """The picture as `find` wants it."""
        return np.asarray(255 - picture, dtype=np.uint8) if self.inverted else picture
