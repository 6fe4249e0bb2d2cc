"""A virtual film of a short finger that bends onto a cylinder: what is fitted with and without the object.

    python benchmarks/diagnosis/objectfilm.py [--json] [--folder FOLDER]

The truth is solved on another mesh in other elements (C3D20H), beside the cylinder. Its project is calibrated
and compared with the object in the model, and once more without it, where `twin diagnose` says what is
missing.
"""

import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options, told

from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.commands.diagnose import run_diagnose
from twin.commands.virtual import run_virtual
from twin.messages import Silent
from twin.project.folder import Project

FINGER, THING = "finger:length_mm=43.3,pleats=3", "cylinder:d=20,x=38,z=-12"
SMALL = (("population = 30", "population = 12"), ("generations = 20", "generations = 3"))


def film(folder: Path, *, seed: int = 0) -> tuple[Project, Project, dict[str, float]]:
    """A project whose model has the object, one whose model has not, and the true constants in MPa."""
    beside = folder / "beside"
    run_virtual(beside, Silent(), protocol="P2", hide=[], sigmas=None, placement_mm=0.02, body=FINGER,
                object=THING, seed=seed)  # fmt: skip
    text = (beside / "twin.toml").read_text(encoding="utf-8")
    for old, new in SMALL:  # least squares end the search
        text = text.replace(old, new)
    (beside / "twin.toml").write_text(text, encoding="utf-8")
    shutil.copytree(beside, folder / "alone")
    left = [line for line in text.splitlines() if not line.startswith("object = ")]
    (folder / "alone" / "twin.toml").write_text("\n".join(left), encoding="utf-8")
    truth = json.loads((folder / "beside.truth.json").read_text(encoding="utf-8"))["constants_MPa"]
    return Project.open(beside), Project.open(folder / "alone"), truth


def fitted(project: Project, truth: dict[str, float]) -> dict[str, Any]:
    """How far each constant is from the truth, in its sds; p of the fit; rms of the residual in mm."""
    rows = run_calibrate(project, Silent())["fit"]["parameters"]
    off = {n: (row["value"] - truth[n]) / row["sd"] if row["sd"] else None for n, row in rows.items()}
    found = run_compare(project, Silent())
    return {"off_sd": off, "p_value": found["p_value"], "rms_mm": found["raw_rms_mm"]}


def figures(folder: Path) -> dict[str, Any]:
    """`beside` and `alone` as `fitted` has them, and what the diagnosis of `alone` says."""
    beside, alone, truth = film(folder)
    found = {"beside": fitted(beside, truth)}
    print(found, file=sys.stderr, flush=True)
    found["alone"] = fitted(alone, truth)
    print(found, file=sys.stderr, flush=True)
    return {**found, "diagnosis": run_diagnose(alone, Silent())["verdict"]}


if __name__ == "__main__":
    typed = options(__doc__, {"--folder": (Path, "where the projects are kept")}, json="one JSON line")
    with tempfile.TemporaryDirectory() as scratch:
        told(figures(typed.folder or Path(scratch)), typed.json)
