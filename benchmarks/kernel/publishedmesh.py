"""A mesh that others published, from `twin init --deck` to a fit, where the true constants are known.

    python benchmarks/kernel/publishedmesh.py --mesh M.vtk --clamp-set xmin --axes=-x,-z,-y --at 115,0,-30

`twin init`, `look`, `calibrate` and `compare` run on the mesh, whose options are those of `twin init`. The
film is drawn from the same body with every element halved twice, 64 times as many. It says how far the
constants are from the truth, in their sds, the rms of the residual beside what is expected, and its p.
"""

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options, told

import numpy as np

from fe import Path as Course
from fe import solve
from fe.deck.reader import read_deck
from fe.mesh.refine import refined
from twin import virtual
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.commands.init import run_init
from twin.commands.look import run_look
from twin.messages import Silent
from twin.project.folder import Project
from twin.project.targetwriting import write_targets
from twin.virtual.truthsolves import SILICONE

CORNERS = ((0.0, 0.0), (2.0, 0.0), (4.0, 12.0), (8.0, 12.0))  # (s, kPa)
LEVELS = 6
SMALL = (("population = 30", "population = 12"), ("generations = 20", "generations = 3"))


def film(deck: Path, points: list[str], folder: Path) -> None:
    """Targets of the truth on the finest mesh."""
    case = read_deck(deck).case
    law = replace(SILICONE, density=0.0)
    truth = refined(refined(replace(case, materials=dict.fromkeys(case.materials, law))))
    bench = virtual.Bench(film_hz=2.0, gauge_sd_MPa=1e-4, sd=0.015, placement_sd_mm=0.02)
    course: Course = virtual.path(bench, protocol=CORNERS)
    places = np.array([[float(v) for v in text.split(",")] for text in points])
    rows = [int(np.linalg.norm(case.nodes - x, axis=1).argmin()) for x in places]
    at, response = case.nodes[rows], solve(truth, course, count=LEVELS)
    named = virtual.at_nodes([f"p{k}" for k in range(len(rows))], case.labels[rows], at)
    write_targets(folder, virtual.noisy_targets(
        response.at(at), response.per_pressure(at), course, points=named, bench=bench, seed=1,
    ))  # fmt: skip


def figures(typed: Any, folder: Path) -> dict[str, Any]:
    """What the fit of the mesh says of the truth."""
    own = {"deck": typed.mesh, "clamp_set": typed.clamp_set, "axes": typed.axes}
    named = [f"p{k}={text}" for k, text in enumerate(typed.at)]
    run_init(folder / "shape", Silent(), nodes=named, **own)
    run_look(Project.open(folder / "shape"), Silent())
    film(folder / "shape" / "raw" / f"{typed.mesh.stem}.inp", typed.at, folder / "targets")
    run_init(folder / "batch", Silent(), nodes=named, targets=folder / "targets", **own)
    toml = folder / "batch" / "twin.toml"
    text = toml.read_text(encoding="utf-8")
    for old, new in SMALL:  # least squares end the search
        text = text.replace(old, new)
    toml.write_text(text, encoding="utf-8")
    project = Project.open(folder / "batch")
    rows = run_calibrate(project, Silent())["fit"]["parameters"]
    found = run_compare(project, Silent())
    truth = {"C10": SILICONE.C10, "C01": SILICONE.C01}
    return {
        "off_sd": {n: (r["value"] - truth[n]) / r["sd"] if r["sd"] else None for n, r in rows.items()},
        "constants_MPa": {n: row["value"] for n, row in rows.items()},
        "p_value": found["p_value"], "rms_mm": found["raw_rms_mm"], "expected_mm": found["expected_mm"],
    }  # fmt: skip


if __name__ == "__main__":
    typed = options(__doc__, {
        "--mesh": {"type": Path, "required": True, "help": "a mesh of Gmsh or VTK"},
        "--clamp-set": ("", "the faces that are held"),
        "--axes": ("", "which of its axes are x, y and z"),
        "--at": {"action": "append", "required": True, "help": "X,Y,Z of a marker, mm; repeated"},
        "--folder": (Path, "where the projects are kept"),
    }, json="one JSON line")  # fmt: skip
    with tempfile.TemporaryDirectory() as scratch:
        told(figures(typed, typed.folder or Path(scratch)), typed.json)
