"""What the measuring chain errs by on the demo film, against the tags' true places.

    python benchmarks/films/demo_errors.py [PROJECT]
    python benchmarks/films/demo_errors.py FOLDER --draw SEED [--lossless]

PROJECT: a copy of the demo in which `twin measure` has run, by default softtwin-demo. Prints chi2 of the
whitened errors, and along the smooth courses in which missing physics is looked for: that is near its number
of courses where what many frames share is rightly stated. The truth is that of `make_demo.py`. The fixed
markers need none: they do not move.

--draw makes FOLDER a copy of the demo whose films have other noise of the camera; --lossless codes them
without loss, so that what the codec does can be told from the rest of the chain.
"""

import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.films.make_demo import DEMO, motion

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from twin.judging.comparison import smooth_functions
from twin.judging.whitening import whitener
from twin.project.targetfiles import read_targets
from twin.targets import Targets
from vision.drawing import synthetic

TRUTH = DEMO.seed  # of the tags' offsets and the scale, whatever the films' noise


def draw(folder: Path, seed: int, *, lossless: bool) -> None:
    """Makes the folder a copy of the demo with films of another seed."""
    shutil.copytree(ROOT / "datasets" / "demo", folder)
    film, raw = synthetic.film, folder / "raw"

    def coded(path: Path, **look: Any) -> None:
        if lossless:
            path, look = path.with_suffix(".mkv"), {**look, "codec": "ffv1"}
        film(path, **look)

    with patch.object(synthetic, "film", coded):
        chance = DEMO.drawn(np.random.default_rng(TRUTH))
        replace(DEMO, seed=seed).write_films(raw, chance, motion())
    if lossless:
        for name in ("film.mp4", "static.mp4"):
            (raw / name).unlink()
        text = (folder / "twin.toml").read_text(encoding="utf-8").replace(".mp4", ".mkv")
        (folder / "twin.toml").write_text(text, encoding="utf-8")


def main() -> None:
    typed = options(__doc__, {
        "project": {"type": Path, "nargs": "?", "default": Path("softtwin-demo")},
        "--draw": (int, "seed: make a copy of the demo with other noise"),
        "--lossless": "with --draw: films without loss",
    })  # fmt: skip
    if typed.draw is not None:
        draw(typed.project, typed.draw, lossless=typed.lossless)
        return
    t = read_targets(typed.project / "targets")
    fixed_markers(t)
    finger_markers(t)


def fixed_markers(t: Targets) -> None:
    """Prints chi2 of the fixed markers, which do not move."""
    still = np.zeros_like(t.value)
    w = whitener(t, prediction_modes=still[None][:0], gauge=still, points=t.fixed)
    z = w.whiten(t.value)
    smooth, count = along(smooth_functions(t, w), z)
    print(f"fixed markers: chi2 {z @ z:.0f} of {w.count}")
    print(f"  smooth courses: chi2 {smooth:.0f} of {count}, p {chdtrc(count, smooth):.2g}")


def along(functions: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[float, int]:
    """Chi2 of z (n,) along functions (n,b), and their number."""
    courses = np.linalg.qr(functions).Q
    return float(((courses.T @ z) ** 2).sum()), courses.shape[1]


def finger_markers(t: Targets) -> None:
    """Prints chi2 of the finger's markers against the truth, and their errors."""
    chance = DEMO.drawn(np.random.default_rng(TRUTH))
    place, _ = DEMO.placed(chance, motion())
    true, names = np.zeros_like(t.value), list(DEMO.places)
    rows = [t.names.index(name) for name in names]
    own = place[:, : len(names)]
    true[:, rows] = (own - own[t.reference].mean(axis=0)) / (1 + chance.scale_error)
    nothing = np.zeros((0, *t.value.shape))
    w = whitener(t, prediction_modes=nothing, gauge=np.zeros_like(t.value), points=~t.fixed)
    z = w.whiten(t.value - true)
    smooth, count = along(smooth_functions(t, w), z)
    print(f"finger: chi2 {z @ z:.0f} of {w.count}")
    print(f"  smooth courses: chi2 {smooth:.0f} of {count}, p {chdtrc(count, smooth):.2g}")
    error = (t.value - true)[:, rows][..., [0, 2]] * 1e3
    for name, rms in zip(names, np.sqrt(np.nanmean(error**2, axis=0)), strict=True):
        print(f"  {name:8s} rms {rms[0]:5.2f} um in x, {rms[1]:5.2f} um in z")


if __name__ == "__main__":
    main()
