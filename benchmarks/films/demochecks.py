"""What a finished demo must show: the effect that is hidden, an error that falls to the noise, a report and a
recording.

    python benchmarks/films/demochecks.py PROJECT demo | quick [--overlay]

Prints what it found; the exit code is 1 where something is wrong. What is hidden stands in tests/data.
--overlay: the drawn model must lie where the film shows the finger, too. `.ci/run` runs it on both demos.
"""

import json
import os
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options

PLAIN = {"demo": 3.0, "quick": 2.0}  # of the noise: the error before is at least so large
FALLEN = 1.1  # and after at most
NOISE_MM = {"demo": (0.02, 0.08), "quick": (0.01, 0.04)}  # of each data set
OFF_PX = 2.0


def hidden(data: str) -> str:
    """The effect that is hidden in a data set."""
    path = ROOT / "tests" / "data" / f"{data}_truth.toml"
    return str(tomllib.loads(path.read_text(encoding="utf-8"))["effect"])


def wrong(said: Mapping[str, Any], data: str, *, least: float | None = None) -> list[str]:
    """What is wrong with the diagnosis of a data set. least: the error before, in noise sds, in place of
    PLAIN."""
    effect, (low, high) = hidden(data), NOISE_MM[data]
    plain = PLAIN[data] if least is None else least
    noise = said["noise_sd_mm"] or 0.0
    before, after = said["rms_before_mm"] or 0.0, said["rms_after_mm"]
    checks = (
        (said["named"] == [effect], f"named is {said['named']}, wanted [{effect!r}]"),
        (said["verdict"] == effect, f"the verdict is {said['verdict']!r}, wanted {effect!r}"),
        (before >= plain * noise, f"rms_before_mm is below {plain:g} noise sds"),
        (after is not None and after <= FALLEN * noise, f"rms_after_mm is above {FALLEN:g} noise sds"),
        (low <= noise <= high, f"noise_sd_mm is outside {low:g} .. {high:g} mm"),
    )
    return [sentence for holds, sentence in checks if not holds]


def missing(project: Path) -> list[str]:
    """What a finished project lacks."""
    names = ("review.rrd", "report.html")
    there = {name: any(p.stat().st_size > 0 for p in project.glob(f"runs/*/{name}")) for name in names}
    return [f"no {name} in the project" for name in names if not there[name]]


def main() -> None:
    typed = options(__doc__, {
        "project": {"type": Path},
        "data": {"choices": tuple(NOISE_MM)},
        "--overlay": "compare the drawn model with the film, too",
    })  # fmt: skip
    found = sorted(typed.project.glob("runs/*/diagnosis.json"))
    if not found:
        sys.exit(f"FAILED: {typed.project} has no diagnosis.json")
    said = json.loads(found[-1].read_text(encoding="utf-8"))
    print({key: said[key] for key in ("verdict", "named", "rms_before_mm", "rms_after_mm", "noise_sd_mm")})
    broken = [*wrong(said, typed.data), *missing(typed.project)]
    if typed.overlay:
        from benchmarks.batches.review import overlay_px

        off = overlay_px(typed.project)
        print("overlay against film, px:", off)
        if max(off["marker_95_px"], off["edge_95_px"]) >= OFF_PX:
            broken.append(f"the model is not drawn within {OFF_PX:g} px of where the film shows the finger")
    sys.exit("".join(f"FAILED: {sentence}\n" for sentence in broken) or None)


if __name__ == "__main__":
    main()
