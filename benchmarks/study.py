"""How many of the reference study's seven figures does one command make from its two displacements?

    python benchmarks/study.py

`twin study` on a copy of datasets/study in a temporary folder, about two minutes.
"""

import os
import shutil
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
import benchmarks  # noqa: F401

from twin.chain import stage_of
from twin.console import Console
from twin.project.folder import Project, dataset

SVG = "{http://www.w3.org/2000/svg}svg"


def study_figures() -> int:
    """Number of figures that were made: files of their own that are drawings, and stand in the report."""
    with tempfile.TemporaryDirectory() as folder:
        project = Project.open(shutil.copytree(dataset("study"), Path(folder) / "study"))
        made = stage_of("study").run(project, Console(as_json=True))
        report = project.newest("review", "report.html")
        text = report.read_text(encoding="utf-8") if report else ""
        files = [project.root / "runs" / made["run"] / name for name in made["figures"]]
        return sum(_is_shown(file, text) for file in files)


def _is_shown(file: Path, report: str) -> bool:
    """Whether a file holds a drawing with curves or bars that the report shows."""
    if not file.is_file():
        return False
    drawing = file.read_text(encoding="utf-8").strip()
    root = ElementTree.fromstring(drawing)
    return root.tag == SVG and len(list(root.iter())) > 50 and drawing in report


if __name__ == "__main__":
    print(f"{study_figures()} figures")
