"""Read the CSV of 3-D points that Anipose writes into pose-3d.

One row a frame: NAME_x, NAME_y, NAME_z in the unit of the calibration board (mm), NAME_error px, NAME_ncams,
NAME_score for every point, then M_ij and center_i, which are applied already, and fnum (Karashchuk et al.
2021, doi 10.1016/j.celrep.2021.109730).
"""

from pathlib import Path

import numpy as np

from twin.csvtable import Sheet, read_sheet
from twin.formats.recorded import Recorded, numbers, plain_names
from twin.targets import Array

CAMERAS = 2  # a point that fewer have seen has no depth


def read_anipose(path: Path, min_likelihood: float) -> Recorded:
    """The points of an Anipose CSV in mm; with a low score, or seen by fewer than two cameras, not seen."""
    sheet = read_sheet(path, wanted="NAME_x,NAME_y,NAME_z,NAME_error,NAME_ncams,NAME_score,...,fnum")
    names = [name[:-2] for name in sheet.header if name.endswith("_x")]
    names = [name for name in names if f"{name}_ncams" in sheet.header]
    if not names or "fnum" not in sheet.header:
        raise ValueError(
            f"{path}: the header is {','.join(sheet.header[:6])}...; wanted NAME_x, NAME_y, NAME_z, "
            "NAME_ncams and NAME_score for each point, and fnum: a file of Anipose's folder pose-3d"
        )
    position = np.stack([_triples(sheet, path, name) for name in names], axis=1)
    score, cameras = (np.stack([_column(sheet, path, f"{n}_{what}") for n in names], axis=1)
                      for what in ("score", "ncams"))  # fmt: skip
    bad = ~((score >= min_likelihood) & (cameras >= CAMERAS)) & np.isfinite(position).all(axis=2)
    return Recorded(
        names=plain_names(path, names), position=np.where(bad[..., None], np.nan, position), unit="mm",
        frame=_column(sheet, path, "fnum"), missing=int(bad.sum()),
        doubt=f"a score below {min_likelihood:g} or fewer than {CAMERAS} cameras",
    )  # fmt: skip


def _triples(sheet: Sheet, path: Path, name: str) -> Array:
    """Positions (s,3) of a point."""
    return np.stack([_column(sheet, path, f"{name}_{axis}") for axis in "xyz"], axis=1)


def _column(sheet: Sheet, path: Path, name: str) -> Array:
    """A column (s,) of the sheet; NaN where it is empty."""
    return numbers(sheet.table((name,)).cells[name], path=path, what=f"column {name}")
