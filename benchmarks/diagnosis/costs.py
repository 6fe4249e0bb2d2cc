"""What a project's stages have solved, and the processor's seconds that they took, from its log.

    python benchmarks/diagnosis/costs.py [--project FOLDER] [--json]

Of the newest run of each stage: whole solves by kind, columns of tangents, and seconds of processor of the
stage. Written to `benchmarks/results/costs.json`, which `identify.py` takes into its table.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.collected import RESULTS

from twin import effort
from twin.project.folder import Project

STAGES = ("calibrate", "diagnose", "add")
PARTS = (effort.COLUMNS, effort.FINER, effort.PATHS, effort.PLANNED)  # which are no whole solves of the model


def costs(project: Project) -> dict[str, dict[str, Any]]:
    """By stage: whole solves and all kinds of them, and seconds of processor."""
    newest = {run.kind: run for run in map(project.info, project.runs()) if run.status == "done"}
    stages = {name: newest[name] for name in STAGES if name in newest}
    whole = {
        name: sum(row.n for kind, row in run.solves.items() if kind not in PARTS)
        for name, run in stages.items()
    }
    return {
        "solves": whole,
        "cpu_s": {name: round(run.cpu_s, 1) for name, run in stages.items() if run.cpu_s is not None},
        "by_kind": {
            name: {kind: [row.n, round(row.cpu_s, 1)] for kind, row in run.solves.items()}
            for name, run in stages.items()
        },
    }


def main() -> int:
    typed = options(
        __doc__,
        {"--project": (Path("softtwin-demo"), "a project that is diagnosed")},
        json="print it on one line",
    )
    found = costs(Project.open(typed.project))
    (RESULTS / "costs.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=None if typed.json else 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
