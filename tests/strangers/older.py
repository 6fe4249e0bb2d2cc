"""A finished project of a former release (tests/data/old_project, on the raw files of the quick data set), opened
where all libraries have other versions than it was made with.

`old_stale`: its runs that count as stale; `old_done_again`: commands that do again what is done; `old_overlay`: 1
where the models can be drawn over its film.
"""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from tests.strangers.planted import Lines
from twin.bench.fits import stale
from twin.commands.camera import run_camera
from twin.commands.measure import run_measure
from twin.project import folder, record
from twin.project.folder import Project, dataset
from twin.report.filmprojection import _why_not

OLD = Path(__file__).resolve().parents[1] / "data" / "old_project"
NEWER = {"pydantic": "9.9.1", "opencv-contrib-python-headless": "9.9.2", "numpy": "9.9.3", "softtwin": "9.9.4"}


@contextmanager
def opened(place: Path) -> Iterator[Project]:
    """A copy of the project below a folder, with newer libraries and the figures' formats of then."""
    shutil.copytree(OLD, place / "old")
    shutil.copytree(dataset("quick") / "raw", place / "old" / "raw")
    newer = {**folder.versions(), **NEWER}
    with mock.patch.object(folder, "versions", return_value=newer), mock.patch.object(record, "FORMATS", {}):
        yield Project.open(place / "old")


def figures() -> dict[str, int]:
    """`old_stale`, `old_done_again` and `old_overlay`."""
    with tempfile.TemporaryDirectory() as place, opened(Path(place)) as old:
        out_of_date = [run.name for run in old.runs() if stale(old, run)]
        results = [run_camera(old, Lines()), run_measure(old, Lines(), budget=True)]
        return {
            "old_stale": len(out_of_date),
            "old_done_again": sum(result["status"] != "skipped" for result in results),
            "old_overlay": int(_why_not(old) == ""),
        }
