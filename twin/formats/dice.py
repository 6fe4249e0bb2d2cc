"""Read the results of DICe (Sandia's Digital Image Correlation Engine), one text file for each picture.

DICe_solution_NN.txt: lines of stars, then a header and one row a subset: SUBSET_ID, COORDINATE_X,
COORDINATE_Y px in the reference picture, DISPLACEMENT_X, DISPLACEMENT_Y px, SIGMA px (-1 where the subset
failed), and others (Turner 2015, SAND2015-10606 O). x points right and y down. A stereo solution has
MODEL_COORDINATES_X and MODEL_DISPLACEMENT_X in mm.
"""

from pathlib import Path

import numpy as np

from twin.formats.recorded import PIXEL, Recorded, in_order, numbers
from twin.targets import Array

FLAT = (("COORDINATE_X", "COORDINATE_Y"), ("DISPLACEMENT_X", "DISPLACEMENT_Y"))
STEREO = tuple(tuple(f"MODEL_{what}_{axis}" for axis in "XYZ") for what in ("COORDINATES", "DISPLACEMENT"))


def read_dice(path: Path, min_likelihood: float) -> Recorded:
    """The subsets of a folder of DICe solutions, in px, or in mm where it is stereo; failed ones not seen.

    ValueError where the files have other columns or other subsets.
    """
    files, frame, told = in_order(path, "DICe_solution_*.txt")
    tables = [_table(file) for file in files]
    stereo = set(STEREO[0] + STEREO[1]) <= tables[0].keys()
    labels = tables[0]["SUBSET_ID"]
    placed = [_placed(file, t, labels, stereo) for file, t in zip(files, tables, strict=True)]
    return Recorded(
        names=tuple(f"s{int(label)}" for label in labels), position=np.array([p for p, _ in placed]),
        unit="mm" if stereo else PIXEL, axes="" if stereo else "x,0,-y",
        frame=frame, missing=sum(failed for _, failed in placed),
        doubt="a negative SIGMA", remarks=told,
    )  # fmt: skip


def _table(path: Path) -> dict[str, Array]:
    """The columns of a solution by name; without a SUBSET_ID the rows are counted."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("***")]
    separator = "," if lines and "," in lines[0] else None
    rows = [line.split(separator) for line in lines]
    head = [cell.strip() for cell in rows[0]] if rows else []
    if "FRAME" in head:
        raise ValueError(
            f"{path}: is a result of tracking, one row for each frame; wanted that of a full-field analysis, "
            "one file for each picture"
        )
    missing = [name for name in (*FLAT[0], *FLAT[1], "SIGMA") if name not in head]
    if missing or len(rows) < 2:
        raise ValueError(
            f"{path}: column {missing[0] if missing else 'SIGMA'} is missing or has no rows: the header is "
            f"{','.join(head[:6])}; wanted COORDINATE_X, COORDINATE_Y, DISPLACEMENT_X, DISPLACEMENT_Y and "
            "SIGMA: add them to DICe's output_spec"
        )
    if any(len(row) != len(head) for row in rows):
        raise ValueError(f"{path}: a row has more or fewer cells than the header; wanted a whole file")
    table = {name: numbers([row[i] for row in rows[1:]], path=path, what=f"column {name}")
             for i, name in enumerate(head)}  # fmt: skip
    return {"SUBSET_ID": np.arange(len(rows) - 1.0)} | table


def _placed(path: Path, table: dict[str, Array], labels: Array, stereo: bool) -> tuple[Array, int]:
    """Positions (p,3) of the subsets in one picture, NaN where they failed, and how many did."""
    if not np.array_equal(table["SUBSET_ID"], labels):
        raise ValueError(
            f"{path}: its subsets are not those of the first file; wanted one analysis in the folder"
        )
    names = STEREO if stereo else FLAT
    positions = np.full((len(labels), 3), np.nan)
    for axis, (place, moved) in enumerate(zip(*names, strict=True)):
        positions[:, axis] = table[place] + table[moved]
    failed = ~(table["SIGMA"] >= 0)
    return np.where(failed[:, None], np.nan, positions), int(failed.sum())
