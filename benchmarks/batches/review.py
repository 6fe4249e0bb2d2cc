"""How far the model that is drawn over the demo's film lies from the film, in pixels.

    python benchmarks/batches/review.py [softtwin-demo]

needs the finished demo (`make demo`), whose review draws the model; `batches.py` makes it in a scratch folder
where there is none, which takes about ten minutes. Two distances: from each marker in the film to that of the
model, and from the edge of the finger's body there to that of the model's side face.
"""

import json
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np
from scipy.ndimage import map_coordinates

from twin.bench.fits import fresh
from twin.commands.demo import run_demo
from twin.console import Console
from twin.project.folder import Project
from twin.report.filmprojection import Footage, models_on_film
from twin.review.filmed import Filmed
from twin.review.states import Generations
from twin.targets import Array

DEMO = Path("softtwin-demo")
REACH, STEP = 8.0, 0.25  # px: how far from the model's edge the film's is looked for, and how finely
EVERY = 8  # frames
CONTRAST = 25.0  # grey levels between body and ground, at least
PLAIN = (45.0, 160.0)  # grey levels of body and ground: beyond lie markers


def review(quick: bool) -> dict[str, Any]:
    """The larger rms distance in px of the model drawn over the demo's film, all its distances, and the
    seconds that the demo's stages took."""
    del quick
    with finished_demo() as demo:
        off = overlay_px(demo)
        return {
            "overlay_px": max(off["marker_rms_px"], off["edge_rms_px"]),
            "overlay": off,
            "seconds_demo": seconds(demo),
        }


@contextmanager
def finished_demo() -> Iterator[Path]:
    """The folder of the finished demo: the one that is here, or one made for this."""
    with tempfile.TemporaryDirectory() as scratch:
        demo = DEMO if DEMO.is_dir() else Path(scratch) / DEMO.name
        if demo is not DEMO:
            run_demo(demo, lambda said: print(said, file=sys.stderr, flush=True))
        yield demo


def seconds(demo: Path) -> float:
    """The seconds that the newest finished run of each of its stages took."""
    runs = [json.loads(path.read_text()) for path in sorted(demo.glob("runs/*/run.json"))]
    return sum({run["kind"]: run["seconds"] for run in runs if run["status"] == "done"}.values())


def overlay_px(demo: Path = DEMO) -> dict[str, float]:
    """Distances in px between film and the model of now over the whole film: of the markers (rms, 95 %), of
    the body's edge (median, rms and 95 % of its size), and how many places of the edge were compared."""
    project = Project.open(demo)
    history = fresh(project, ("calibrate",), "generations.npz")
    if history is None:
        raise SystemExit(f"{demo}: it is not calibrated; run `make demo` first, or name another folder")
    targets, say = project.targets(), Console(as_json=False)
    filmed, why = models_on_film(project, targets, Generations.load(history), say)
    if filmed is None:
        raise SystemExit(f"{demo}: {why or 'it has no film'}")
    marker = np.linalg.norm(filmed.measured - filmed.models[-1].markers, axis=2)
    marker = marker[np.isfinite(marker)]
    off = np.abs(edge_px(filmed, Footage(project, filmed)))
    return {
        "marker_rms_px": float(np.sqrt((marker**2).mean())),
        "marker_95_px": float(np.quantile(marker, 0.95)),
        "edge_median_px": float(np.median(off)),
        "edge_rms_px": float(np.sqrt((off**2).mean())),
        "edge_95_px": float(np.quantile(off, 0.95)),
        "edge_places": float(len(off)),
    }


def edge_px(filmed: Filmed, footage: Footage) -> Array:
    """How far outside the model's edge the film's lies, px, in every eighth picture; signed."""
    at = {int(frame): k for k, frame in enumerate(filmed.frame) if k % EVERY == 0}
    found = [
        edge_off(picture.astype(float), filmed.models[-1].edge[at[index]])
        for index, _, picture in footage.film.frames()
        if index in at
    ]
    return np.concatenate(found)


def edge_off(picture: Array, edge: Array) -> Array:
    """How far outside a closed edge (k,2) px the border between dark body and ground lies in a picture (h,w).

    It is where the grey level along the edge's normal passes the middle between both sides. Places near
    markers and at the clamp, where there is no such border, are left out.
    """
    middle, along = 0.5 * (edge[1:] + edge[:-1]), np.diff(edge, axis=0)
    long = np.linalg.norm(along, axis=1)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)[long > 0] / long[long > 0, None]
    turn = np.sum(edge[:-1, 0] * edge[1:, 1] - edge[1:, 0] * edge[:-1, 1])  # its sign: which way it runs
    normal *= np.sign(turn)
    place = np.arange(-REACH, REACH + STEP, STEP)
    line = middle[long > 0, None] + place[:, None] * normal[:, None]
    grey = map_coordinates(picture, [line[..., 1], line[..., 0]], order=1, mode="nearest")
    inner, outer = grey[:, :4].mean(axis=1), grey[:, -4:].mean(axis=1)
    plain = (grey.min(axis=1) > PLAIN[0]) & (grey.max(axis=1) < PLAIN[1]) & (outer - inner > CONTRAST)
    beyond = grey[plain] > 0.5 * (inner + outer)[plain, None]
    return np.asarray(place[beyond.argmax(axis=1)] - 0.5 * STEP)


def main() -> None:
    demo = options(__doc__, {"demo": {"type": Path, "nargs": "?", "default": DEMO}}).demo
    for name, number in overlay_px(demo).items():
        print(f"{name}: {number:.3g}")


if __name__ == "__main__":
    main()
