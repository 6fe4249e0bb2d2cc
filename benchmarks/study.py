"""What does a calibration of the reference study's problem cost, and is it the same wherever it runs?

    python benchmarks/study.py [--quick] [--json] [--only study bits coverage methods]

`study`: `twin study`, from the two displacements of datasets/study to the report, on a copy in a temporary
folder. `seconds` of the processor are those of its `calibrate`: 562 candidates, the best of every generation
solved whole; `study_cpu_s` those of all. `figures` counts the drawings in files of their own that stand in
the report. `ccx_hours`: as many solves by CalculiX, of the seconds of docs/records/engines.md.
`bits`: load paths by every executor, and with a worker of the cluster killed: are they equal to the bit?
`coverage`: 95 % intervals by profile and posterior that hold the truth (`knowing.py`; --quick: 30 trials).
`methods`: other ways to the constants, as `studymethods.py` has measured them.
"""

import base64
import json
import os
import re
import shutil
import signal
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks import knowing
from benchmarks.clusters import load_paths
from benchmarks.commandline import parts, processor
from benchmarks.diagnosis.collected import RESULTS
from benchmarks.diagnosis.snapshots import POINTS, SHORT

from fe import Lattice
from twin.chain import stage_of
from twin.console import Console
from twin.executors.chosen import current, using
from twin.executors.clusters import on_cluster
from twin.executors.local import Processes, Serial
from twin.executors.protocol import gathered
from twin.model.structure import of_finger
from twin.project.folder import Project, dataset

IMAGE = re.compile(r'src="data:image/svg\+xml;base64,([^"]+)"')
SVG = "{http://www.w3.org/2000/svg}svg"
CANDIDATES = 562
CCX_S = 130.0  # of one solve of the default finger by CalculiX, docs/records/engines.md
PATHS = 4


def study(quick: bool) -> Mapping[str, Any]:
    """The study's figures, and its cost."""
    began = processor()
    with _studied() as (project, told):
        shown = _shown(project, told)
        calibrated = project.newest("calibrate", "run.json")
        assert calibrated is not None
        seconds = json.loads(calibrated.read_text(encoding="utf-8"))["cpu_s"]
        row = json.loads((project.root / "runs" / told["run"] / "study.json").read_text(encoding="utf-8"))
    return {
        "seconds": seconds, "study_cpu_s": round(processor() - began, 1), "figures": sum(shown.values()),
        "not_shown": [name for name, there in shown.items() if not there], "rms_mm": row["final"]["rms_mm"],
        "ccx_hours": CANDIDATES * CCX_S / 3600,
    }  # fmt: skip


def study_figures() -> int:
    """How many of the figures were made."""
    with _studied() as (project, told):
        return sum(_shown(project, told).values())


@contextmanager
def _studied() -> Iterator[tuple[Project, dict[str, Any]]]:
    with tempfile.TemporaryDirectory() as folder:
        project = Project.open(shutil.copytree(dataset("study"), Path(folder) / "study"))
        yield project, stage_of("study").run(project, Console(as_json=True))


def _shown(project: Project, told: dict[str, Any]) -> dict[str, bool]:
    """Figures by name, and whether each was made and is shown."""
    report = project.newest("review", "report.html")
    text = report.read_text(encoding="utf-8") if report else ""
    drawn = {base64.b64decode(found).decode("utf-8").strip() for found in IMAGE.findall(text)}
    run = project.root / "runs" / told["run"]
    return {name: _is_shown(run / name, drawn) for name in told["figures"]}


def _is_shown(file: Path, report: Collection[str]) -> bool:
    """Whether a file holds a drawing with curves or bars that is among those of the report."""
    if not file.is_file():
        return False
    drawing = file.read_text(encoding="utf-8").strip()
    root = ElementTree.fromstring(drawing)
    return root.tag == SVG and len(list(root.iter())) > 50 and drawing in report


def bits(quick: bool) -> Mapping[str, Any]:
    """Whether each executor gives the bits of this process."""
    tasks = load_paths(of_finger(SHORT, Lattice(per_bellow=2, centred=False)), POINTS, PATHS)

    def made(each: Callable[[], None] = lambda: None) -> list[bytes]:
        found = []
        for result in gathered(current(), tasks):
            found.append(result.tobytes())
            each()
        return found

    with using(Serial()):
        wanted = made()
    equal = {}
    with using(Processes()):
        equal["local processes"] = made() == wanted
    for workers in (1, 2):
        with _loopback(workers):
            equal[f"dask, {workers} workers"] = made() == wanted
    with _loopback(2) as pids:
        killed = made(lambda: os.kill(pids.pop(), signal.SIGKILL) if len(pids) > 1 else None)
        equal["dask, a worker killed"] = killed == wanted
    return {"same_bits": equal}


@contextmanager
def _loopback(workers: int) -> Iterator[list[int]]:
    """Workers of dask on this machine, by their process numbers."""
    from distributed import LocalCluster

    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        on_cluster(cluster.scheduler_address, lambda text: print(text, flush=True)),
    ):
        yield [worker.pid for worker in cluster.workers.values()]


def methods(quick: bool) -> Mapping[str, Any]:
    """The kept table of methods."""
    found = json.loads((RESULTS / "studymethods.json").read_text(encoding="utf-8"))
    return {"methods": found["methods"]}


PARTS = {"study": study, "bits": bits, "coverage": knowing.figures, "methods": methods}

if __name__ == "__main__":
    sys.exit(parts(__doc__, PARTS, quick="30 trials of coverage"))
