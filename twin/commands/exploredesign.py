"""`twin explore --export FILE`: a design of runs for a program that is not of softtwin, as a table."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calibrate import Parameter
from twin import files
from twin.bench.explorationranges import range_of
from twin.effects.phrases import listed
from twin.foreign.runtable import LEAST, design, table_of
from twin.messages import Say


def export_design(over: Sequence[str], path: Path, say: Say, *, runs: int, seed: int) -> dict[str, Any]:
    """A table of runs over ranges NAME=LOW:HIGH, whatever the names: nothing is solved. ValueError for too
    few runs, and where the file is there."""
    ranges = dict(range_of(text) for text in over)
    if not ranges or len(ranges) < len(over):
        raise ValueError("--over: wanted the parameters of your program, each once, such as --over E=0.1:0.3")
    if runs < (least := LEAST * len(ranges) + 1):
        raise ValueError(f"--runs {runs}: wanted {least} or more for {len(ranges)} parameters")
    if path.exists():
        raise ValueError(f"--export {path}: it is there already; wanted a new file")
    parameters = [Parameter(name, *ends) for name, ends in ranges.items()]
    files.write_text(path, table_of(design(parameters, runs, seed=seed)).csv(digits=12))
    say(f"Wrote {path}: {runs} runs over {listed(list(ranges))}. Make each with your program, and write a "
        "table with a row a run and step: run, then tip_x_mm, tip_z_mm and so on.")  # fmt: skip
    say("twin.foreign.runtable.read_runs takes both tables for your program: docs/python.md.")
    return {"stage": "explore", "file": str(path), "runs": runs}
