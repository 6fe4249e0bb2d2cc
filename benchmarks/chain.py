"""What each stage of a project costs: seconds of the processor, from the film to the report.

    python benchmarks/chain.py [--project softtwin-demo] [--against COMMIT] [--json]

Each stage runs once more, as a process of its own, in a temporary copy of what was recorded and written by
hand (twin.toml, raw/), with the effects that were added taken out; without --project of datasets/demo, which
takes the time of `make demo`. `cpu_s` counts the processes that a stage starts. What run.json of the project
has under `seconds` is time by the clock on the wall, waiting for a busy machine included; it stands beside as
`wall_s`, null where a stage never ran there. With --against the same stages of another commit run in turn
with these, on its own datasets/demo, after all of them have once been compiled: `ratio` is this over that.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks import ROOT
from benchmarks.commandline import options, processor

from twin.project.folder import Project, dataset
from twin.project.toml import with_effects

STAGES = ("camera", "measure", "calibrate", "compare", "diagnose", "add", "review")
TWIN = (sys.executable, "-c", "from twin.main import start; start()")


def fresh(source: Path, folder: Path) -> None:
    """Makes the folder a copy of a project in which no stage has run, and no effect is added."""
    shutil.copytree(source, folder, ignore=shutil.ignore_patterns("runs", "targets", ".*", "demo.json"))
    toml = folder / "twin.toml"
    toml.write_text(with_effects(toml.read_text(encoding="utf-8"), []), encoding="utf-8")


def cost(folder: Path, stage: str, root: Path = ROOT) -> float | None:
    """Seconds of the processor that a stage of the code in `root` takes; None where it ends with an error,
    which is told."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])}
    env["PYTHONDONTWRITEBYTECODE"] = ""  # as of a user: else each stage compiles its packages again
    began = processor()
    told = subprocess.run([*TWIN, stage, "-p", str(folder)], env=env, capture_output=True, text=True)
    if told.returncode:
        print(f"{stage} ended with {told.returncode}: {told.stderr}", file=sys.stderr)
        return None
    spent = round(processor() - began, 1)
    print(f"{stage}: {spent} s{'' if root == ROOT else ' before'}", file=sys.stderr, flush=True)
    return spent


def in_turn(source: Path, commit: str, scratch: Path) -> tuple[dict[str, float | None], ...]:
    """Seconds of the processor by stage: of this code, and of a commit's, each stage after the other's."""
    other = scratch / "code"
    subprocess.run(["git", "-C", ROOT, "worktree", "add", "--quiet", "--detach", other, commit], check=True)
    try:
        was = other / dataset("demo").relative_to(ROOT)
        fresh(was, scratch / "compiled")
        for stage in STAGES:
            cost(scratch / "compiled", stage, other)
        fresh(source, scratch / "project")
        fresh(was, scratch / "before")
        both = [(cost(scratch / "project", s), cost(scratch / "before", s, other)) for s in STAGES]
    finally:
        subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", other], check=True)
    now, before = zip(*both, strict=True)
    return dict(zip(STAGES, now, strict=True)), dict(zip(STAGES, before, strict=True))


def on_the_wall(source: Path, stage: str) -> float | None:
    """Seconds by the clock of the newest finished run of a stage, of its run.json."""
    if not (source / "runs").is_dir():
        return None
    path = Project.open(source).newest(stage, "run.json")
    seconds: float | None = json.loads(path.read_text(encoding="utf-8"))["seconds"] if path else None
    return seconds


def main() -> int:
    """Print the table; the exit code is 1 where a stage failed."""
    more = {"--project": (dataset("demo"), "a finished project"), "--against": (str, "a commit")}
    typed, before = options(__doc__, more, json="one JSON line"), dict[str, float | None]()
    with tempfile.TemporaryDirectory() as scratch:
        if typed.against:
            spent, before = in_turn(typed.project, typed.against, Path(scratch))
        else:
            fresh(typed.project, Path(scratch) / "project")
            spent = {stage: cost(Path(scratch) / "project", stage) for stage in STAGES}
    found: dict[str, Any] = {"cpu_s": spent, "wall_s": {s: on_the_wall(typed.project, s) for s in STAGES}}
    if before:
        ratio = {s: round(t / before[s], 2) if (t := spent[s]) and before[s] else None for s in STAGES}
        found |= {"before_s": before, "ratio": ratio}
    if typed.json:
        print(json.dumps(found))
    else:
        columns = {"s of the processor": "cpu_s", "s on the wall, of run.json": "wall_s"}
        columns |= {"s before": "before_s", "ratio": "ratio"} if before else {}
        print("| stage | " + " | ".join(columns) + " |\n|---" + len(columns) * "|---" + "|")
        for stage in STAGES:
            print(f"| {stage} | " + " | ".join(str(found[c][stage] or "") for c in columns.values()) + " |")
    return int(None in spent.values())


if __name__ == "__main__":
    sys.exit(main())
