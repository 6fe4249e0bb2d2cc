"""What the measuring chain errs by on the demo film, against the tags' true places.

    python benchmarks/demo_errors.py [PROJECT]

PROJECT: a copy of the demo in which `twin measure` has run, by default softtwin-demo. Prints chi2 of the
whitened errors, and along the smooth courses in which missing physics is looked for: that is near its number
of courses where what many frames share is rightly stated. The truth is that of `benchmarks/make_demo.py`.
"""

import argparse
from pathlib import Path

import _first  # noqa: F401
import make_demo
import numpy as np
from scipy.special import chdtrc

from twin.diagnosis.comparison import smooth_functions
from twin.diagnosis.whitening import whitener
from twin.project.targetfiles import read_targets


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("project", type=Path, nargs="?", default=Path("softtwin-demo"))
    t = read_targets(parser.parse_args().project / "targets")
    chance = make_demo.drawn(np.random.default_rng(make_demo.SEED))
    place, _ = make_demo.placed(make_demo.marks_of(), chance, make_demo.motion())
    true, names = np.zeros_like(t.value), make_demo.NAMES
    rows = [t.names.index(name) for name in names]
    own = place[:, : len(names)]
    true[:, rows] = (own - own[t.reference].mean(axis=0)) / (1 + chance.scale_error)
    nothing = np.zeros((0, *t.value.shape))
    w = whitener(t, prediction_modes=nothing, gauge=np.zeros_like(t.value), points=~t.fixed)
    z = w.whiten(t.value - true)
    courses = np.linalg.qr(smooth_functions(t, w)).Q
    smooth, count = float(((courses.T @ z) ** 2).sum()), courses.shape[1]
    print(f"all: chi2 {z @ z:.0f} of {w.count}")
    print(f"smooth courses: chi2 {smooth:.0f} of {count}, p {chdtrc(count, smooth):.2g}")
    error = (t.value - true)[:, rows][..., [0, 2]] * 1e3
    for name, rms in zip(names, np.sqrt(np.nanmean(error**2, axis=0)), strict=True):
        print(f"  {name:8s} rms {rms[0]:5.2f} um in x, {rms[1]:5.2f} um in z")


if __name__ == "__main__":
    main()
