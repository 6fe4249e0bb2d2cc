"""Trials on other bodies than the short finger, by whole solves: `twin virtual`, `twin calibrate` and `twin
diagnose` of one film, as a user runs them."""

import json
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.diagnosis.trialbench import Spec, in_verdict, told

from twin.commands.calibrate import run_calibrate
from twin.commands.diagnose import run_diagnose
from twin.commands.virtual import run_virtual
from twin.messages import Silent
from twin.project.folder import Project

GROUP = "bodies"  # and which body
BODIES = {  # as `twin virtual --body` takes them; they bend by 3 and 8 mm
    "tube": "tube:length_mm=140,offset_mm=1.2,chamber_width_mm=12,chamber_height_mm=12",
    "pneunet": "pneunet:chambers=3",
}
KINDS_OF_BODIES = (  # that a film without weight can show, on any body with a chamber
    "creep", "camera_scale", "log_creep", "pressure_lag", "two_volumes", "wall_taper", "stiffening",
    "warming", "camera_rotation", "tilted_core", "compressibility", "time_shift", "bent_gauge", "mullins",
    "precurvature", "gent", "thermal", "pressure_offset", "camera_breathing", "drifting_zero",
)  # fmt: skip
SIGMAS = (10.0, 30.0)  # non-centralities of what is hidden


def films() -> list[list[Spec]]:
    """The trials of each body, every kind once."""
    return [
        [
            Spec(f"{GROUP} {body}", "P3", (kind,), SIGMAS[(k + b) % 2], "white", 70_000 + 100 * b + k)
            for k, kind in enumerate(KINDS_OF_BODIES)
        ]
        for b, body in enumerate(BODIES)
    ]


def run(spec: Spec) -> dict[str, Any]:
    """The row of results of a film."""
    began, body = time.process_time(), BODIES[spec.group.partition(" ")[2]]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "film"
        run_virtual(folder, Silent(), protocol=spec.protocol, hide=spec.kinds, sigmas=spec.sigmas,
                    noise=spec.noise, body=body, seed=spec.seed)  # fmt: skip
        truth = json.loads(folder.with_name("film.truth.json").read_text(encoding="utf-8"))
        prepared = time.process_time()
        project = Project.open(folder)
        run_calibrate(project, Silent())
        said = run_diagnose(project, Silent())
    size_of = truth["non_centrality"]
    hidden = [{"name": h["name"], "size": h["size"], "sigmas": size_of[h["name"]]} for h in truth["hidden"]]
    kept = ("verdict", "sentence", "named", "law", "ties", "adequate", "grade", "nearest", "mechanisms")
    return told(spec, ()) | {key: said[key] for key in kept} | {
        "hidden": hidden, "names": in_verdict(said), "prepared": prepared - began,
        "seconds": time.process_time() - prepared,
    }  # fmt: skip
