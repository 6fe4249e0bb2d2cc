"""Which of the reference study's seven figures does one command make from two displacements, at what cost?

    python benchmarks/study.py [--json]

`twin study`, from the two displacements of datasets/study to the report, on a copy in a temporary folder:
about two minutes. `study_figures` counts the figures that are drawings in files of their own and stand in the
report; `study_cpu_s`: seconds of the processor.
"""

import json
import os
import shutil
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks.commandline import options, processor

from twin.chain import stage_of
from twin.console import Console
from twin.project.folder import Project, dataset

SVG = "{http://www.w3.org/2000/svg}svg"


def made() -> dict[str, bool]:
    """Figures by name, and whether each was made and is shown."""
    with tempfile.TemporaryDirectory() as folder:
        project = Project.open(shutil.copytree(dataset("study"), Path(folder) / "study"))
        told = stage_of("study").run(project, Console(as_json=True))
        report = project.newest("review", "report.html")
        text = report.read_text(encoding="utf-8") if report else ""
        run = project.root / "runs" / told["run"]
        return {name: _is_shown(run / name, text) for name in told["figures"]}


def study_figures() -> int:
    """How many of the figures were made."""
    return sum(made().values())


def _is_shown(file: Path, report: str) -> bool:
    """Whether a file holds a drawing with curves or bars that the report shows."""
    if not file.is_file():
        return False
    drawing = file.read_text(encoding="utf-8").strip()
    root = ElementTree.fromstring(drawing)
    return root.tag == SVG and len(list(root.iter())) > 50 and drawing in report


def main() -> None:
    """Print the figures by name, or how many there are as one JSON line."""
    typed = options(__doc__, json="one JSON line")
    began = processor()
    found = made()
    cost = {"study_figures": sum(found.values()), "study_cpu_s": round(processor() - began, 1)}
    if typed.json:
        print(json.dumps(cost))
        return
    print("| figure | made, and in the report |\n|---|---|")
    for name, shown in found.items():
        print(f"| {name} | {'yes' if shown else 'no'} |")
    print(f"\n{cost['study_figures']} figures, {cost['study_cpu_s']} s of the processor")


if __name__ == "__main__":
    main()
