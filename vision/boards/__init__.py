"""Printed calibration boards: a kind is one file that knows its points, its picture and its print.

Read `board` first: it says what every kind can do, and `Board.of` makes the kind of a given name. Then read a
kind: `charuco`, `chessboard`, `circles` (plain and coded). `corners` refines corners to a few hundredths of a
pixel, `dotgrid` finds dots and the rows and columns that they are in. A new kind is one more file, imported
here.
"""

from vision.boards import charuco, chessboard, circles  # each registers its kinds

__all__ = ["charuco", "chessboard", "circles"]
