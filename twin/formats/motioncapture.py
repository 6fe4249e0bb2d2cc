"""Read a C3D file, the common format of motion capture: positions of markers in 3-D at a fixed rate.

Labels, unit and rate stand in POINT:LABELS, POINT:UNITS and POINT:RATE (the C3D file format, c3d.org); a
marker that was not seen has a negative residual, which ezc3d returns as NaN (doi 10.21105/joss.02911).
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from twin import files
from twin.formats.recorded import Recorded, plain_names
from twin.targets import Array

MOST_S = 60.0  # of the child that reads a file
READ = """
import sys, ezc3d, numpy as np
content = ezc3d.c3d(sys.argv[1])
point = content["parameters"]["POINT"]
np.savez(sys.argv[2], points=content["data"]["points"], labels=np.array(point["LABELS"]["value"], dtype="U"),
         units=np.array(point["UNITS"]["value"], dtype="U"), rate=float(point["RATE"]["value"][0]))
"""


def read_c3d(path: Path, min_likelihood: float) -> Recorded:
    """The markers of a C3D file in its own unit, with times from 0; ValueError where it is none."""
    if not path.is_file():
        raise ValueError(f"{path}: no such file; wanted a C3D file")
    points, labels, units, rate = _content(path)
    position = np.ascontiguousarray(np.moveaxis(points[:3], 0, -1).swapaxes(0, 1))  # (s,p,3)
    if not position.size:
        raise ValueError(f"{path}: has no points; wanted the positions of markers")
    if not (np.isfinite(rate) and rate > 0.0):
        raise ValueError(f"{path}: POINT:RATE is {rate:g}; wanted the frames in a second, above 0")
    position[np.all(position == 0.0, axis=2)] = np.nan  # a lost marker, whatever its residual
    return Recorded(
        names=plain_names(path, labels[: position.shape[1]]), position=position, unit=(units or ["mm"])[0],
        frame=np.arange(float(len(position))), time=np.arange(len(position)) / rate,
        missing=int(np.isnan(position[..., 0]).sum()), doubt="no position, or exactly 0, 0, 0",
    )  # fmt: skip


def _content(path: Path) -> tuple[Array, list[str], list[str], float]:
    """Points (4,p,s), labels, unit and rate of a C3D file, read in a child: damaged files kill the reader."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "content.npz"
        command = [sys.executable, "-P", "-c", READ, str(path), str(result)]
        try:
            child = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=MOST_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise ValueError(f"{path}: not read within {MOST_S:.0f} s; wanted a whole C3D file") from None
        if child.returncode:
            why = child.stderr.strip().splitlines()[-1:] or [f"its reader died, signal {-child.returncode}"]
            raise ValueError(f"{path}: not a C3D file: {why[0]}; export it again")
        content = files.read_npz(result, "points", "labels", "units", "rate")
    return content["points"], content["labels"].tolist(), content["units"].tolist(), float(content["rate"])
