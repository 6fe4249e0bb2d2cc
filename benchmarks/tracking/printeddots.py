"""Printed dots of 5 to 60 px radius and diameter: how many are found, and how they repeat.

    python benchmarks/tracking/printeddots.py [--quick] [--json]

A print's rim is rough: 0.24 px rms at a radius of 9 px, 0.44 px at 49 px, measured on photographs of printed
dots. Each drawn dot has its own rim; a second picture of it, with other noise and shifted by a part of a
pixel, shows how it repeats.
"""

import os
import sys
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import whole

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from vision.camera import Array, Camera
from vision.following.dots import find_dots

RADII = (2.5, 3.0, 4.0, 6.0, 9.0, 13.0, 18.0, 25.0, 34.0, 49.0, 60.0)  # px
FINE = 4  # samples along a pixel
INK, PAPER = 40.0, 200.0  # grey levels


def rim(radius: float, rng: np.random.Generator) -> Array:
    """Radii (721,) px of a printed rim, at even angles from 0 to 360 degrees."""
    angle, order = np.linspace(0.0, 2.0 * np.pi, 721), np.arange(3, max(8, int(2.0 * radius)))
    wave = rng.standard_normal((2, len(order))) / order**0.7
    rough = wave[0] @ np.cos(np.outer(order, angle)) + wave[1] @ np.sin(np.outer(order, angle))
    return np.asarray(radius + rough * (0.2 + 0.005 * radius) / rough.std())


def photograph(
    edge: Array, centre: Array, side: int, rng: np.random.Generator, *, covered: float = 0.0
) -> NDArray[np.uint8]:
    """Picture (side,side) of a dot with this rim; `covered` radii of it are hidden from the right."""
    y, x = (np.mgrid[: side * FINE, : side * FINE] + 0.5) / FINE - 0.5
    angle = np.arctan2(y - centre[1], x - centre[0]) % (2.0 * np.pi)
    dark = np.hypot(x - centre[0], y - centre[1]) < np.interp(angle, np.linspace(0.0, 2.0 * np.pi, 721), edge)
    share = dark.reshape(side, FINE, side, FINE).mean(axis=(1, 3))
    grey = gaussian_filter(PAPER - (PAPER - INK) * share, 0.8)
    if covered:
        grey[:, int(centre[0] + (1.0 - covered) * edge.mean() + 1.0) :] = PAPER
    return np.clip(np.rint(grey + 2.0 * rng.standard_normal(grey.shape)), 0, 255).astype(np.uint8)


def look(picture: NDArray[np.uint8], radius: float, guess: Array) -> Array | None:
    """Centre (2,) px of the one dot that is found, else None."""
    camera = Camera(np.diag([1000.0, 1000.0, 1.0]), np.zeros(5), (picture.shape[1], picture.shape[0]))
    found = find_dots(picture, camera, guess, np.full(2, radius), search=max(radius, 3.0), dark=True)
    return found[0].centre if len(found) == 1 else None


def trial(radius: float, count: int, seed: int) -> tuple[int, list[Array]]:
    """How many of `count` dots are found, and the errors (2,) px of their shifts between two pictures."""
    rng, shifts, seen = np.random.default_rng(seed), [], 0
    side = 2 * int(1.7 * radius + 8.0)
    for _ in range(count):
        edge = rim(radius, rng)
        places = [0.5 * side + rng.uniform(-0.5, 0.5, 2) for _ in range(2)]
        found = [look(photograph(edge, at, side, rng), radius, np.round(at)) for at in places]
        seen += found[0] is not None
        if found[0] is not None and found[1] is not None:
            shifts.append((found[1] - found[0]) - (places[1] - places[0]))
    return seen, shifts


def figures(quick: bool) -> dict[str, Any]:
    """`dots_found`, the share of dots of all sizes; `dots_repeat_px`, rms of their shifts."""
    print("| radius / px | found | of | repeats within / px |\n|---|---|---|---|")
    seen = total = 0
    every: list[Array] = []
    for k, radius in enumerate(RADII):
        count = (6 if radius < 20.0 else 3) * (1 if quick else 6)
        found, shifts = trial(radius, count, k)
        seen, total, every = seen + found, total + count, every + shifts
        rms = f"{np.sqrt(np.mean(np.square(shifts))):.3f}" if shifts else "-"
        print(f"| {radius:g} | {found} | {count} | {rms} |", flush=True)
    repeat = round(float(np.sqrt(np.mean(np.square(every)))), 4) if every else None
    return {"dots_found": round(seen / total, 4), "dots_repeat_px": repeat}


if __name__ == "__main__":
    sys.exit(whole(__doc__, figures, quick="a sixth of the dots"))
