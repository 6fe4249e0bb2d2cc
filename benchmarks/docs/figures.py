"""Writes the figures of the demo into README.md and docs/, or compares them with a run.

    python benchmarks/docs/figures.py [softtwin-demo]            writes what the project has
    python benchmarks/docs/figures.py [softtwin-demo] --check    compares; names figure, found, wanted

A figure is a piece of a page with # for each number, and the places of these numbers in the newest runs of
the project: `kind/file:key.key`, with `#2` for the second number of a sentence; a row of a ranking is named
by its law. Figures may differ by 5 %, or by half of their last digit. Minutes are those of two idle cores:
they are not compared, as a busy machine takes any time, and written where they differ by a factor of 4.
"""

import json
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options

import numpy as np

NUMBER = r"-?\d[\d,]*(?:\.\d+)?"
TOLERANCE, BUSY = 0.05, 4.0  # of a figure; factor of a time, on a busy machine
COMPARE, DIAGNOSIS, ADDED = "compare/comparison.json:", "diagnose/diagnosis.json:", "add/fit.json:"
CALIBRATED, BEFORE, AFTER = "calibrate/fit.json:", "rms_before_mm", "rms_after_mm"
RANKED = "diagnose/diagnosis.json:ranking."


@dataclass(frozen=True)
class Figure:
    """A piece of a page with # for each number, and where a project holds them."""

    page: str
    text: str
    places: tuple[str, ...]

    @property
    def pattern(self) -> re.Pattern[str]:
        """The piece, over any line breaks, with a group for each number."""
        words = (re.escape(word).replace(r"\#", f"({NUMBER})") for word in self.text.split())
        return re.compile(r"\s+".join(words))


def _intervals(name: str) -> tuple[str, ...]:
    of = f"{ADDED}intervals.{name}"
    return (f"{ADDED}parameters.{name}.value", f"{of}.low", f"{of}.high")


DRAWN = "docs/pictures/drawn.txt"  # what the pictures show; only `pictures.py` writes it, as it draws them
README, DECIDES = "README.md", "docs/how-it-decides.md"
SENTENCE = f"{CALIBRATED}identifiability"
WHERE = f"{COMPARE}where"
EVIDENCE = (f"{RANKED}creep:2.evidence", f"{RANKED}creep.evidence")
CHANGE = (
    "The model misses the film by # mm. A right model would miss it by # to # mm (95 %). "
    "With creep:2 it misses it by # mm."
)
CHANGED = tuple(
    DIAGNOSIS + key
    for key in ("raw_rms_before_mm", "expected_low_mm", "expected_high_mm", "raw_rms_after_mm")
)
DRAWN_ERRORS = (DIAGNOSIS + BEFORE, DIAGNOSIS + AFTER, f"{DIAGNOSIS}noise_sd_mm")
FIGURES = (
    Figure(README, "in about # minutes on two cores", ("minutes:",)),
    Figure(README, "the best of # candidates has # mm RMS", ("count:", "best:")),
    Figure(README, "C10 + C01 = # MPa, share C01/(C10 + C01) = #, correlation #.",
           tuple(f"{SENTENCE}#{k}" for k in (1, 2, 3))),
    Figure(README, "The model does not fit. The model misses the film by # mm. A right model would miss it "
           "by # to # mm (95 %). It fails most at marker tip (# mm, # times its noise), in U3, at # to # kPa",
           tuple(f"{WHERE}#{k}" for k in (1, 2, 3, 5, 6, 7, 8))),  # the fourth is 95 %
    Figure(README, "at rest were off by # sd", (f"{WHERE}#9",)),
    Figure(README, f"the place of creep:2. {CHANGE}", CHANGED),
    Figure(README, f"and compare. {CHANGE}",
           (f"{COMPARE}raw_rms_mm", *(f"add/comparison.json:{key}"
                                      for key in ("expected_low_mm", "expected_high_mm", "raw_rms_mm")))),
    Figure(README, "C10 = # MPa (95 %: # to #), C01 = # MPa (95 %: # to #)",
           _intervals("C10") + _intervals("C01")),
    Figure(README, "creep.g1 = # (95 %: # to #), creep.tau1 = # s (95 %: # to #)",
           _intervals("creep.g1") + _intervals("creep.tau1")),
    Figure(README, "creep.g2 = # (95 %: # to #), creep.tau2 = # s (95 %: # to #)",
           _intervals("creep.g2") + _intervals("creep.tau2")),
    Figure("docs/concepts.md", "In the demo creep has a score of # and an evidence of #",
           (f"{RANKED}creep.z", f"{RANKED}creep:2.evidence")),
    Figure(DECIDES, "# static frames", ("measure/run.json:summary.static_frames",)),
    Figure(DECIDES, "rest, p = #", (f"{DIAGNOSIS}frame.p_value",)),
    Figure(DECIDES, "C10 = #, C01 = # MPa: their sum",
           (f"{CALIBRATED}parameters.C10.value", f"{CALIBRATED}parameters.C01.value")),
    Figure(DECIDES, "chi2 is # for # degrees", (f"{COMPARE}chi2", f"{COMPARE}degrees_of_freedom")),
    Figure(DECIDES, "creep # sd, pressure_lag # sd, time_shift # sd, tube # sd",
           tuple(f"{RANKED}{law}.z" for law in ("creep", "pressure_lag", "time_shift", "tube"))),
    Figure(DECIDES, "adequate, p = #", (f"{DIAGNOSIS}p_value_after",)),
    Figure(DECIDES, "creep:2 has #, creep #", EVIDENCE),
    Figure(DECIDES, CHANGE, CHANGED),
    Figure(DECIDES, "from # to # sd where each cycle",
           (f"{DIAGNOSIS}evidence.held_out.before_sd", f"{DIAGNOSIS}evidence.held_out.after_sd")),
    Figure(DECIDES, "C10 = #, C01 = # MPa with creep",
           (f"{ADDED}parameters.C10.value", f"{ADDED}parameters.C01.value")),
    *(Figure("docs/your-own-test.md", f"| `twin {kind}` | # min |", (f"minutes:{kind}",))
      for kind in ("calibrate", "diagnose")),
    Figure(DRAWN, "report: from # to # mm, noise # mm", DRAWN_ERRORS),
    Figure(DRAWN, "review: from # to # mm, noise # mm", DRAWN_ERRORS),
    Figure(DRAWN, "overlay: # steps", ("measure/run.json:summary.steps",)),
)  # fmt: skip


def value(project: Path, place: str) -> float:
    """The number at a place: of a run's file, or counted from it."""
    file, _, keys = place.partition(":")
    if file in COUNTED:
        return COUNTED[file](project, keys)
    kind, _, name = file.partition("/")
    keys, _, nth = keys.partition("#")
    found = json.loads((newest(project, kind) / name).read_text(encoding="utf-8"))
    found = _at(found, keys)
    return float(_numbers(found)[int(nth) - 1]) if nth else float(found)


def _at(found: Any, keys: str) -> Any:
    """What stands under `a.b.c`; a key may hold points itself, such as creep.g1."""
    if not keys:
        return found
    if isinstance(found, list):
        first, _, rest = keys.partition(".")
        rows = {str(k): row for k, row in enumerate(found)} | {row.get("law"): row for row in found}
        if first not in rows:
            raise SystemExit(f"ranking: no {first!r} in it; correct FIGURES of figures.py, or diagnose again")
        return _at(rows[first], rest)
    name = max((key for key in found if f"{keys}.".startswith(f"{key}.")), key=len)
    return _at(found[name], keys[len(name) + 1 :])


def _numbers(sentence: str) -> list[str]:
    """The numbers of a sentence; those in names, such as C10, are none."""
    return re.findall(rf"(?<![\w.-]){NUMBER}(?![\w])", sentence)


def newest(project: Path, kind: str) -> Path:
    """The newest run of a kind."""
    found = sorted(project.glob(f"runs/*-{kind}"))
    if not found:
        raise SystemExit(f"{project}: no run of {kind} in it; run `make demo` first, or name another folder")
    return found[-1]


def _minutes(project: Path, kind: str) -> float:
    """What a run, or all of them, took, in minutes."""
    runs = [newest(project, kind)] if kind else list(project.glob("runs/*"))
    seconds = sum(json.loads((run / "run.json").read_text(encoding="utf-8"))["seconds"] for run in runs)
    return float(seconds) / 60


@cache
def _candidates(project: Path) -> np.ndarray:
    with np.load(newest(project, "calibrate") / "candidates.npz") as arrays:
        return np.asarray(arrays["rms_mm"])


COUNTED: dict[str, Callable[[Path, str], float]] = {
    "minutes": _minutes,
    "count": lambda project, _: float(len(_candidates(project))),
    "best": lambda project, _: float(_candidates(project).min()),
}


def drawn(project: Path, name: str) -> None:
    """Write beside the demo's pictures which figures they show: a later run tells whether they are old."""
    text = (ROOT / DRAWN).read_text(encoding="utf-8")
    for figure in FIGURES:
        if figure.page == DRAWN and figure.text.startswith(f"{name}:"):
            text = written(text, figure, [value(project, place) for place in figure.places])
    (ROOT / DRAWN).write_text(text, encoding="utf-8")


def fits(found: str, wanted: float) -> bool:
    """Whether a figure of the docs is that of the project."""
    number = float(found.replace(",", ""))
    decimals = len(found.partition(".")[2])
    return abs(number - wanted) <= max(TOLERANCE * abs(wanted), 0.5001 * 10.0**-decimals)


def wrong(text: str, figure: Figure, wanted: Sequence[float]) -> list[str]:
    """A sentence for each number of a figure that is not the wanted one."""
    match = figure.pattern.search(text)
    if match is None:
        return [f"{figure.page}: no {figure.text!r} in it; correct the page, or FIGURES of figures.py"]
    return [
        f"{figure.page}: {figure.text!r} has {found}, wanted {want:.6g} ({place})"
        for found, want, place in zip(match.groups(), wanted, figure.places, strict=True)
        if not place.startswith("minutes") and not fits(found, want)
    ]


def written(text: str, figure: Figure, wanted: Sequence[float]) -> str:
    """The page with a figure's numbers as wanted, with the decimals they have; times that fit stay."""
    match = figure.pattern.search(text)
    assert match is not None, figure
    for k in range(len(wanted), 0, -1):
        found, want = match[k], wanted[k - 1]
        if figure.places[k - 1].startswith("minutes") and 1 / BUSY <= float(found) / want <= BUSY:
            continue
        new = f"{want:{',' if ',' in found else ''}.{len(found.partition('.')[2])}f}"
        text = text[: match.start(k)] + new + text[match.end(k) :]
    return text


def main() -> None:
    project = {"type": Path, "nargs": "?", "default": Path("softtwin-demo")}
    given = options(__doc__, {"project": project, "--check": "compare, and write nothing"})
    broken: list[str] = []
    for figure in FIGURES:
        page = ROOT / figure.page
        text = page.read_text(encoding="utf-8")
        wanted = [value(given.project, place) for place in figure.places]
        if given.check or figure.page == DRAWN or figure.pattern.search(text) is None:
            broken += wrong(text, figure, wanted)
        else:
            page.write_text(written(text, figure, wanted), encoding="utf-8")
    if broken:
        raise SystemExit("\n".join(f"FAILED: {sentence}" for sentence in broken))
    print(f"{sum(len(f.places) for f in FIGURES)} figures of README.md and docs/ are as in {given.project}")


if __name__ == "__main__":
    main()
