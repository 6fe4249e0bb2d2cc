"""Read a C3D file, the common format of motion capture: positions of markers in 3-D at a fixed rate.

Labels, unit and rate stand in POINT:LABELS, POINT:UNITS and POINT:RATE (the C3D file format, c3d.org); a
marker that was not seen has a negative residual, which ezc3d returns as NaN (doi 10.21105/joss.02911).
"""

from pathlib import Path

import numpy as np

from twin.formats.recorded import Recorded, plain_names


def read_c3d(path: Path, min_likelihood: float) -> Recorded:
    """The markers of a C3D file in its own unit, with times from 0; ValueError where it is none."""
    import ezc3d

    if not path.is_file():
        raise ValueError(f"{path}: no such file; wanted a C3D file")
    try:
        content = ezc3d.c3d(str(path))
    except (OSError, RuntimeError, ValueError) as error:
        raise ValueError(f"{path}: not a C3D file: {error}") from None
    point, labels = content["parameters"]["POINT"], content["parameters"]["POINT"]["LABELS"]["value"]
    xyz = np.moveaxis(np.asarray(content["data"]["points"], dtype=np.float64)[:3], 0, -1)  # (p,s,3)
    position = np.ascontiguousarray(np.swapaxes(xyz, 0, 1))
    if not position.size:
        raise ValueError(f"{path}: has no points; wanted the positions of markers")
    rate, start = float(point["RATE"]["value"][0]), int(content["header"]["points"]["first_frame"])
    return Recorded(
        names=plain_names(path, list(labels)[: position.shape[1]]), position=position,
        unit=(point["UNITS"]["value"] or ["mm"])[0], frame=start + np.arange(len(position), dtype=np.int64),
        time=np.arange(len(position)) / rate, missing=int(np.isnan(position[..., 0]).sum()),
        doubt="no position",
    )  # fmt: skip
