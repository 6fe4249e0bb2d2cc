"""Displacement errors on drawn film against the sd that `vision.measure` states, by what marks do.

    python benchmarks/tracking/film_accuracy.py [--quick] [--seed N]

Prints, for a lossless and an H.264 film of a finger that bends, holds while it creeps, steps and rests:
rms error in micrometres and pixels, the stated sd, and the pull (error over stated sd with the reference's
noise; 1 is right), then the file sizes and the time a frame takes. Exits with 1 where a pull is not
within 0.7 to 1.4.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.tracking import studio

import numpy as np
from numpy.typing import NDArray

from vision import Camera, Displacements, Mark, Video, View, measure
from vision.drawing import synthetic
from vision.errors.staticnoise import CREEP, FAST, SHAKEN, states

Array = NDArray[np.float64]
DEPTH = 12.0  # mm
PX_PER_MM = 2600.0 / 420.0
FRAME = [(-30, 25), (55, 28), (140, 25), (-30, -65), (55, -70), (140, -65), (-38, -20), (148, -20)]
FIXED = [(10, 26), (100, 26), (-34, 2), (144, 2), (10, -68)]
FINGER = [(float(x), 0.0) for x in np.linspace(14, 108, 7)]
# Seconds and bend (1 is 83 degrees at the last mark): film A of the docs, holds that creep by 2 to 3 %, rests
# in which that recovers.
PROTOCOL = [
    (0, 0),
    (2, 0),
    (4, 0.6),
    (10, 0.62),
    (12, 1),
    (22, 1.03),
    (25, 0.03),
    (26, 0.018),
    (28, 0.008),
    (34, 0.001),
    (34.2, 0.8),
    (38.2, 0.82),
    (38.4, 0.02),
    (40, 0.008),
    (42.4, 0.003),
]
HOLDS = [(4, 10), (12, 22), (25, 34), (34.2, 38.2), (38.4, 42.4)]  # s


def laboratory() -> tuple[Camera, tuple[Array, Array], tuple[Mark, ...]]:
    """Camera, its pose, and 20 marks of 34 px in a picture of 1280 x 720."""
    camera = Camera(
        np.array([[2600.0, 0, 645], [0, 2602.0, 352], [0, 0, 1]]),
        np.array([-0.12, 0.03, 0.0008, -0.0005, 0.0]),
        (1280, 720),
    )
    marks = studio.tags(FRAME, FIXED, FINGER, size=5.5, y=DEPTH)
    return camera, studio.before([55.0, DEPTH, -20.0], 420.0, [3.0, 2.0, 0.0]), marks


def motion(marks: tuple[Mark, ...], seconds: float) -> tuple[Array, Array]:
    """Centres (t,p,3) mm and rotations (t,p) rad at 10 frames/s."""
    at = np.arange(round(seconds * 10)) / 10.0
    bend = np.maximum(0.0135 * np.interp(at, *np.array(PROTOCOL, dtype=float).T), 1e-9)
    place = np.tile([mark.position for mark in marks], (len(at), 1, 1)).astype(np.float64)
    turn = np.zeros(place.shape[:2])
    for p, mark in enumerate(marks):
        if mark.role == "finger":
            x = mark.position[0]
            place[:, p, 0], place[:, p, 2] = np.sin(bend * x) / bend, (np.cos(bend * x) - 1.0) / bend
            turn[:, p] = -bend * x
    return place, turn


def table(result: Displacements, place: Array) -> bool:
    """Prints the rows of one film; says whether every pull is right."""
    rows = [result.tracks.names.index(name) for name in result.names]
    error = (result.value - (place - place[0])[:, rows])[..., [0, 2]]
    shared = [k for k, n in enumerate(result.mode_names) if n.startswith(("reference:", "codec:", "static:"))]
    own = np.diagonal(result.covariance, axis1=2, axis2=3)
    variance = own + np.sum(result.modes[shared] ** 2, axis=0)
    sd = np.sqrt(variance)[..., [0, 2]]
    state = states(result.tracks.position[:, rows])
    fixed = np.array([role == "fixed" for role in result.roles])
    later = (np.arange(len(error)) > result.reference[-1])[:, None]
    good = True
    for name, chosen in (
        ("fixed", later & fixed),
        ("moving", state == FAST),
        ("creeping", state == CREEP),
        ("shaken", state == SHAKEN),
        ("at rest again", later & ~fixed & (state == 0) & (np.arange(len(error)) > 40)[:, None]),
    ):
        if np.count_nonzero(chosen) >= 50:
            rms, stated = np.sqrt(np.nanmean(error[chosen] ** 2)), np.sqrt(np.nanmean(sd[chosen] ** 2))
            pull = np.sqrt(np.nanmean((error[chosen] / sd[chosen]) ** 2))
            print(
                f"  {name:14s} rms {rms * 1e3:5.2f} um {rms * PX_PER_MM:6.4f} px   "
                f"stated {stated * 1e3:5.2f} um   pull {pull:5.2f}   {chosen.sum():5d} values"
            )
            good &= 0.7 < pull < 1.4
    for name, chosen in (("moving marks", ~fixed), ("fixed marks", fixed)):
        pulls, alone = means(result, error, shared, chosen)
        if len(pulls):
            pull, as_new = (np.sqrt(np.mean(x**2)) for x in (pulls, alone))
            print(f"  means of holds, {name:15s} {'':29s} pull {pull:5.2f}   {len(pulls):5d} values")
            print(f"  the same, were all errors new in every frame {'':15s} pull {as_new:5.2f}")
            good &= 0.6 < pull < 1.4
    return good


def means(result: Displacements, error: Array, shared: list[int], chosen: NDArray[np.bool_]) -> list[Array]:
    """Pulls (n,) of the means over holds of chosen marks (p,): as stated, and were every error new.

    error: (s,p,2) mm.   shared: which modes count.
    """
    lasts, static = result.noise.persistence, result.noise.sd[:, [0, 2]] ** 2
    own = np.diagonal(result.covariance, axis1=2, axis2=3)[..., [0, 2]]
    every = own + np.sum(result.modes[shared] ** 2, axis=0)[..., [0, 2]]
    pulls, alone = [np.empty(0)], [np.empty(0)]
    for start, stop in HOLDS:
        frames = np.flatnonzero((result.time >= start + 0.5) & (result.time < stop))
        if len(frames):
            seen = chosen & np.isfinite(error[frames][..., 0]).all(axis=0)
            mean = error[frames].mean(axis=0)
            new = np.maximum(own[frames].mean(axis=0) - static, 0.0) / len(frames)
            modes = (result.modes[shared][:, frames].mean(axis=1)[..., [0, 2]] ** 2).sum(axis=0)
            pulls.append((mean / np.sqrt(new + static * lasts.of_mean(len(frames)) + modes))[seen].ravel())
            alone.append((mean / np.sqrt(every[frames].mean(axis=0) / len(frames)))[seen].ravel())
    return [np.concatenate(pulls), np.concatenate(alone)]


def main() -> int:
    typed = options(__doc__, {"--seed": (1, "of the films")}, quick="12 s of film instead of 42, H.264 only")
    camera, pose, marks = laboratory()
    place, turn = motion(marks, 12.0 if typed.quick else 42.4)
    still = np.repeat(place[:1], 120 if typed.quick else 320, axis=0)
    good = True
    for codec in ("libx264",) if typed.quick else ("ffv1", "libx264"):
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / "film.mkv", Path(folder) / "static.mkv"]
            began = time.process_time()
            for path, centres, seed in zip(
                paths, (place, still), (typed.seed, typed.seed + 1000), strict=True
            ):
                turns = turn if centres is place else np.zeros(still.shape[:2])
                synthetic.film(
                    path,
                    camera=camera,
                    pose=pose,
                    marks=marks,
                    positions=centres,
                    rotations=turns,
                    seed=seed,
                    codec=codec,
                )
            count = len(place) + len(still)
            drawn, began = (time.process_time() - began) / count, time.process_time()
            result = measure([View(Video(paths[0]), Video(paths[1]), camera)], marks)
            took = (time.process_time() - began) / count
            size = [path.stat().st_size / 1e3 for path in paths]
        print(
            f"{codec}: {size[0] / len(place):.1f} and {size[1] / len(still):.1f} kB a frame (film, static); "
            f"CPU: drawn {drawn * 1e3:.0f} ms, measured {took * 1e3:.1f} ms"
        )
        good &= table(result, place)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
