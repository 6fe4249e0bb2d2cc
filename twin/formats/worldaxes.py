"""Turn positions along a file's axes into positions along the world's."""

import re

import numpy as np

from twin.targets import Array

WANTED = (
    "wanted the file's axes that point along the finger, across it and up, such as x,0,-y for a picture (0: "
    "not seen) or y,-x,z"
)


def turned(position: Array, axes: str) -> Array:
    """Positions (s,p,3) along x (along the finger), y (across), z (up); NaN along an axis that was not seen.

    axes: the file's axis for each of them, with its sign, or 0. ValueError where they are no frame, or a
    mirror image of one.
    """
    terms = [term.strip().lower() for term in axes.split(",")]
    if len(terms) != 3 or not all(re.fullmatch(r"0|[+-]?[xyz]", term) for term in terms):
        raise ValueError(f"--axes {axes!r}: {WANTED}")
    seen = [term[-1] for term in terms if term != "0"]
    if len(set(seen)) != len(seen) or not seen:
        raise ValueError(f"--axes {axes!r}: an axis stands twice, or none does; {WANTED}")
    rows = np.array([_row(term) for term in terms])
    if "0" not in terms and np.linalg.det(rows) < 0:
        raise ValueError(f"--axes {axes!r} is a mirror image: wanted right-handed axes; turn one sign around")
    found = np.full_like(position, np.nan)
    for axis, row in enumerate(rows):
        if row.any():
            own = int(np.argmax(np.abs(row)))
            found[..., axis] = row[own] * position[..., own]
    return found


def _row(term: str) -> Array:
    """The row (3,) of the rotation of one term."""
    row = np.zeros(3)
    if term != "0":
        row["xyz".index(term[-1])] = -1.0 if term.startswith("-") else 1.0
    return row
