"""Read the CSV that DeepLabCut writes for an analysed video: pixels, with a likelihood for each point.

Header rows scorer, bodyparts, coords, with `individuals` between where a project has several animals; below
them one row a frame: its number, then x, y, likelihood of every point (Nath et al. 2019, doi
10.1038/s41596-019-0176-0). x points right and y down in the picture.
"""

import csv
from pathlib import Path

import numpy as np

from twin.formats.recorded import PIXEL, Recorded, numbers, plain_names

LEVELS = ("scorer", "individuals", "bodyparts", "coords")
COORDS = ["x", "y", "likelihood"]


def read_deeplabcut(path: Path, min_likelihood: float) -> Recorded:
    """The points of a DeepLabCut CSV in px; a likelihood below `min_likelihood` is not seen.

    ValueError where the header is another, as in a file of hand labels.
    """
    head, rows = _rows(path)
    points = _points(path, head)
    cells = np.array([numbers(row[1:], path=path, what=f"frame {row[0]}") for row in rows])
    cells = cells.reshape(len(rows), len(points), 3)
    unlikely = np.isfinite(cells[..., 0]) & ~(cells[..., 2] >= min_likelihood)
    position = np.full((*cells.shape[:2], 3), np.nan)
    position[..., :2] = np.where(unlikely[..., None], np.nan, cells[..., :2])
    return Recorded(
        names=plain_names(path, points), position=position, unit=PIXEL, axes="x,0,-y",
        frame=np.array([float(row[0]) for row in rows]),
        missing=int(unlikely.sum()), doubt=f"a likelihood below {min_likelihood:g}",
    )  # fmt: skip


def _rows(path: Path) -> tuple[dict[str, list[str]], list[list[str]]]:
    """The header's levels by name, and the rows of the frames."""
    try:
        lines = [row for row in csv.reader(path.read_text(encoding="utf-8-sig").splitlines()) if row]
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read as text: {error}") from None
    head = {row[0]: row[1:] for row in lines[:4] if row[0] in LEVELS}
    rows = [row for row in lines if row[0] not in LEVELS]
    if not {"bodyparts", "coords"} <= head.keys() or not rows:
        start = ",".join(lines[0][:3]) if lines else "nothing"
        raise ValueError(
            f"{path}: begins with {start!r}; wanted DeepLabCut's rows scorer, bodyparts and coords and one "
            "row for each frame below them"
        )
    for row in rows:
        if len(row) - 1 != len(head["coords"]) or not row[0].replace(".", "", 1).isdigit():
            raise ValueError(
                f"{path}: row {','.join(row[:2])!r} has {len(row) - 1} values; wanted a frame's number and "
                f"{len(head['coords'])} values, as `deeplabcut.analyze_videos(save_as_csv=True)` writes them"
            )
    return head, rows


def _points(path: Path, head: dict[str, list[str]]) -> list[str]:
    """The names (p,) of the points: the body part, with its animal before it where there are several."""
    if head["coords"][:3] == ["x", "y", "z"]:
        raise ValueError(
            f"{path}: is a file of DeepLabCut in 3-D, whose unit it does not say; wanted a plain CSV with "
            "the unit in the headings, such as tip_x_mm,tip_y_mm,tip_z_mm, or the file of one camera"
        )
    if len(head["coords"]) % 3 or head["coords"] != COORDS * (len(head["coords"]) // 3):
        raise ValueError(
            f"{path}: coords are {','.join(head['coords'][:4])}...; wanted x,y,likelihood for each point: "
            "labels made by hand have no likelihood, take the analysed video"
        )
    parts = head["bodyparts"][::3]
    animals = head.get("individuals", [""] * len(head["coords"]))[::3]
    several = len(set(animals)) > 1
    return [f"{animal}_{part}" if several else part for animal, part in zip(animals, parts, strict=True)]
