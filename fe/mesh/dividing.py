"""The lattice of cells for a finger's dimensions: as fine for its shape as the default is for the default
finger.

The default lattice is the cheapest within 2 % of the limit on the default finger
(docs/records/meshes.md). Six things make it too coarse on another one: long pleats or thin tops, steep
pleat walls, pleats much deeper in the middle than at the sides, flat walls that bulge like plates, thick
walls, and a chamber so short that its ends and corners count. `benchmarks/batches/batches.py` measures what
is left on random fingers.
"""

from dataclasses import replace

import numpy as np

from fe.mesh.finger import Finger, Lattice

CELL = 5.6  # top walls that a pleat is long, at most, where the default number of cells does
STEEPER = 4 / 3  # more cells along a pleat with flat crests, or sheared between middle and side
SHEARED = 0.5  # pitches that pleats are deeper in the middle than at the sides, at most, where one cell does
CELLS = 72  # along the chamber at most, where more than the default number of cells a pleat would do
CORRUGATED = 2.5  # top walls that pleats are deep, where they hold the top from bulging
SPAN = 0.85  # half the chamber's width over its height, at most, where one cell in the middle does
SHORT = 4.0  # heights that the chamber is long, at least, where its ends need no cells of their own
THICK = 0.2  # wall over half the width or over the height, at most, where one cell across it does


def lattice_of(finger: Finger) -> Lattice:
    """Lattice of cells for a finger; the default one for the default finger.

    >>> lattice_of(Finger()) == Lattice()
    True
    >>> lattice_of(Finger(side=5.0)).wall  # thick walls
    2
    """
    base = Lattice()
    half, height = finger.width / 2, finger.height
    thick = max(finger.side / half, finger.bottom / height, finger.top / height) > THICK
    short = finger.pitch * finger.bellows < SHORT * height
    sheared = _sheared(finger)
    return replace(
        base,
        per_bellow=_along(finger, base.per_bellow),
        across=_across(finger) + short,
        up=base.up + short,
        fillet=base.fillet + sheared,
        caps=base.caps + short,
        wall=2 if thick or short else base.wall,
    )


def _along(finger: Finger, least: int) -> int:
    """Cells along a pleat."""
    steep = STEEPER if finger.flatness or _sheared(finger) else 1.0
    cells = least * max(finger.pitch / (CELL * finger.top), 1.0) * steep
    return max(least, min(int(np.ceil(cells)), CELLS // finger.bellows))


def _across(finger: Finger) -> int:
    """Cells across the middle of half the chamber."""
    half = finger.width / 2 - finger.side
    high = finger.height - finger.top - finger.bottom
    plates = 1 if 2 * finger.pleat >= CORRUGATED * finger.top else 2
    return max(plates, int(np.ceil(half / (SPAN * high))))


def _sheared(finger: Finger) -> bool:
    """True if the crests fall off so steeply towards the sides that they shear the top wall."""
    return 2 * finger.pleat - finger.side_pleat > SHEARED * finger.pitch
