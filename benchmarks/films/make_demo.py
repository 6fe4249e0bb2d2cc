"""Makes datasets/demo: a film, a static film, board pictures and a pressure log of a finger that creeps.

    python benchmarks/films/make_demo.py [--to FOLDER]    the data set, and its truth in tests/data

The truth is solved on a finer mesh than the model's, its cells elsewhere, and holds three terms of creep.
`recording.py` draws it.
"""

import os
import sys
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.films.recording import (
    Boards,
    Clock,
    Drawn,
    Look,
    Motion,
    Recording,
    Rig,
    course_lines,
    drawn_lines,
    small_enough,
)

import numpy as np

from fe import Case, Finger, Material, finger_case
from twin import virtual
from twin.marktables import PointTable
from twin.project.config import Config, ModelTable
from twin.targets import Array
from vision.boards.charuco import CharucoBoard

TRUTH = Material(0.214, 0.083, prony=((0.017, 1.6), (0.017, 2.5), (0.006, 15.0)))
BENCH = virtual.Bench()
LIMIT_MB = 12.0
# The finger's markers sit on nodes of the flat lower edge of the side face y = 11.5 mm, as far as the tip.
STATIONS = (12, 22, 32, 42, 52, 64)  # in 1/72 of the bellows' 100 mm; 42 is the node 5848
NAMES = ("p1", "p2", "p3", "middle", "p5", "p6", "tip")


def marked_points() -> Array:
    """Undeformed places (7, 3) mm of the finger's markers, those of NAMES."""
    x = np.append(4.0 + np.array(STATIONS) * 100.0 / 72.0, 110.0)
    return np.stack([x, np.full_like(x, 11.5), np.zeros_like(x)], axis=1)


def nodes_of(case: Case) -> np.ndarray:
    """Labels (7,) of the nodes of a model under the markers; ValueError where one has no node."""
    gap = np.linalg.norm(case.nodes[:, None] - marked_points(), axis=2)
    if gap.min(axis=0).max() > 1e-6:
        raise ValueError(f"a finger tag lies {gap.min(axis=0).max():g} mm from every node; wanted a node")
    return case.labels[gap.argmin(axis=0)]


DEMO = Recording(
    seed=20240,
    bench=BENCH,
    course=virtual.path(BENCH),
    places=dict(zip(NAMES, marked_points(), strict=True)),
    look=Look(size=(1280, 720), middle=(645.0, 352.0), px_per_mm=6.3, looks_at=(55.0, 11.5, -19.0)),
    rig=Rig(
        frame=((-37, 29), (24, 31), (86, 31), (147, 29), (-37, -20), (147, -18), (-37, -67), (20, -67),
               (147, -67)),
        fixed=((55, 31), (-28, 4), (128, 10), (28, -40), (122, -64)),  # clear of the finger's way
        clamp=((0.0, 24.0), (-16.0, 24.0), (-16.0, -9.0), (0.0, -9.0)),
        y=11.5,
    ),
    boards=Boards(
        board=CharucoBoard(columns=8, rows=6, square_mm=16.0, marker_mm=12.0), reach=(42.0, 24.0)
    ),
    clock=Clock(static_start=0.5, film_start=35.0, log_end=78.0),
)  # fmt: skip


def truth() -> Case:
    """The finger that is filmed, on cells that are not the model's."""
    return virtual.truth_case(Finger(), virtual.LATTICE, material=TRUTH, element=None)


def motion() -> Motion:
    """The truth's motion."""
    return DEMO.motion(truth(), lambda points: virtual.displaced(truth(), virtual.path(BENCH), points))


def config() -> Config:
    """The twin.toml that a user who made this test would write."""
    labels = dict(zip(NAMES, nodes_of(finger_case(TRUTH)).tolist()))
    points = [
        PointTable(name=m.name, node=labels[m.name], marker=m.kind.code, size_mm=m.size_mm)
        for m in DEMO.marks if m.role == "finger"
    ]  # fmt: skip
    return DEMO.config("demo", ModelTable(wall_sd_mm=0.0), points)


def truth_text(chance: Drawn) -> str:
    """The truth as TOML: what the demo's chain must not see, and what its tests compare with."""
    prony = ", ".join(f"[{g}, {tau}]" for g, tau in TRUTH.prony)
    lines = [
        "# The hidden truth of datasets/demo, by benchmarks/films/make_demo.py. Units: mm, MPa, s, rad.",
        f"seed = {DEMO.seed}",
        'effect = "creep"',
        f"C10 = {TRUTH.C10}",
        f"C01 = {TRUTH.C01}",
        f"prony = [{prony}]  # shares and times, s",
        f'lattice = "{virtual.LATTICE}"',
        *course_lines(virtual.FILM_A, BENCH),
        *drawn_lines(DEMO, chance),
    ]
    return "\n".join(lines) + "\n"


def make(folder: Path) -> bool:
    """Writes the data set into a folder and its truth into tests/data; says whether it is small enough."""
    chance = DEMO.write(folder, config(), motion())
    (ROOT / "tests" / "data" / "demo_truth.toml").write_text(truth_text(chance), encoding="utf-8")
    return small_enough(folder, LIMIT_MB)


def main() -> int:
    typed = options(__doc__, {"--to": (ROOT / "datasets" / "demo", "folder")})
    return 0 if make(typed.to) else 1


if __name__ == "__main__":
    sys.exit(main())
