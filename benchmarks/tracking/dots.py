"""Plain dots followed through a drawn film: displacement error against the Cramer-Rao bound.

    python benchmarks/tracking/dots.py [--quick] [--json]

22 dots of 8, 12 and 20 px among 6 coded frame markers, in the scene of markers.py: at rest, then moving by
8 px. The bound is that of an ellipse (5), gain and offset, plus that of the mean of the reference.
"""

import os
import sys
from dataclasses import replace
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import whole
from benchmarks.tracking import printeddots
from benchmarks.tracking.markers import REFERENCE, Scene, Trial, bound, displacement, film, scene, tracked

import numpy as np

from vision import Mark
from vision.kinds import PlainDot
from vision.marks import dots_of

SIZES = (8, 12, 20)  # px, diameter
FRAME = (0, 3, 6, 21, 24, 27)


def dotted(size_px: float, moving: int, seed: int) -> Scene:
    """The scene with dots in place of all markers but six, which rest."""
    s = scene(size_px, moving, seed)
    large = scene(40.0, 1, seed).marks
    marks = tuple(
        large[i] if i in FRAME else Mark(m.name, PlainDot(m.size_mm), m.position, "finger")
        for i, m in enumerate(s.marks)
    )
    place, turn = s.place.copy(), s.turn.copy()
    for i in FRAME:
        place[:, i], turn[:, i] = marks[i].position, 0.0
    return replace(s, marks=marks, place=place, turn=turn)


def trial(size_px: float, moving: int, seed: int, every: int = 1) -> Trial:
    """One film of dots of one size; the bound is that of every n-th mark."""
    s = dotted(size_px, moving, seed)
    _, followed = tracked(s, film(s, seed))
    dots = dots_of(s.marks)
    error = (displacement(followed.ideal) - displacement(s.ideal()))[:, dots]
    stated = followed.covariance[REFERENCE:] + np.nanmean(followed.covariance[:REFERENCE], axis=0) / REFERENCE
    sd = np.sqrt(np.diagonal(stated[:, dots], axis1=2, axis2=3))
    kept = [k for k, p in enumerate(range(0, len(s.marks), every)) if p in dots]
    at = (np.array([REFERENCE]), np.array([0]))
    total = (bound(s, at[0], every) + bound(s, at[1], every) / REFERENCE)[:, kept]
    limit = np.sqrt(np.diagonal(total, axis1=2, axis2=3))
    return Trial(error, sd, limit, int(np.isnan(error[..., 0]).sum()))


def figures(quick: bool) -> dict[str, Any]:
    """`dot_rms_px`, `dot_crb_ratio` and `dot_pull_sd` by diameter in px."""
    print("| dot / px | rms / px | bound / px | ratio | pull sd | +- | lost |\n|---|---|---|---|---|---|---|")
    trials = {}
    for size in SIZES:
        t = trials[str(size)] = trial(size, 12 if quick else 60, size, every=4 if quick else 1)
        limit = np.sqrt(np.mean(t.bound**2))
        told = f"{t.ratio:.2f} | {t.pull:.2f} | {100 * t.about:.0f} %"
        print(f"| {size} | {t.rms:.4f} | {limit:.4f} | {told} | {t.lost} |", flush=True)
    return printeddots.figures(quick) | {
        "dot_rms_px": {size: round(t.rms, 5) for size, t in trials.items()},
        "dot_rms_se_px": {size: round(t.rms * t.about, 5) for size, t in trials.items()},
        "dot_crb_ratio": {size: round(t.ratio, 3) for size, t in trials.items()},
        "dot_pull_sd": {size: round(t.pull, 3) for size, t in trials.items()},
    }


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="12 moving frames instead of 60"))
