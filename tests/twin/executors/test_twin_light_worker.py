"""What a worker imports needs neither films nor viewers: docs/cluster.md installs it without them."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
HEAVY = ("rerun", "pyvista", "vtk", "vtkmodules", "cv2", "av", "skimage")
OF_WORKER = ("twin.executors.daskcluster", "twin.model.loadpaths", "twin.model.discretisation", "fe")


def test_a_workers_modules_load_without_films_and_viewers() -> None:
    code = f"import sys\nsys.modules.update(dict.fromkeys({HEAVY!r}))\nimport {', '.join(OF_WORKER)}"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
