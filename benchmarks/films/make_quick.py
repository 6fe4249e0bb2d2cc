"""Makes datasets/quick: eight seconds of film of a short finger whose walls taper, and what belongs to it.

    python benchmarks/films/make_quick.py [--to FOLDER]    the data set, and its truth in tests/data
    python benchmarks/films/make_quick.py --seeds 6        what the stages say to other films of that truth

The truth is solved with 20-node hexahedra on a finer mesh than the model's, its cells elsewhere. Its walls
taper along a sine, those of the model's effect along a line. `recording.py` draws it. With --seeds every film
has its own noise, tags and scale, and nothing is kept; the exit code is 1 where the effect is not named
alone, for an error above the noise that falls to 1.1 of it.
"""

import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.films.demochecks import wrong
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

from fe import Case, Lattice
from fe.mesh.inner import inside
from twin import virtual
from twin.bodies.finger import FingerTable
from twin.chain import stage_of
from twin.console import Console
from twin.effects.protocol import Test
from twin.marktables import PointTable
from twin.project.config import Config, ModelTable
from twin.project.folder import Project
from twin.virtual.hidden import Kind
from twin.virtual.truthsolves import SILICONE
from vision.boards.charuco import CharucoBoard

# Short, but its chamber is four heights long and its walls are thin, so that the default lattice divides it.
TABLE = FingerTable(
    length_mm=70.0, width_mm=20.0, height_mm=15.0, side_wall_mm=1.9, top_wall_mm=2.7, pleats=4,
    pleat_depth_mm=6.8, side_pleat_depth_mm=2.0,
)  # fmt: skip
LATTICE = Lattice(per_bellow=9, wall=2, across=2, up=2, centred=False)
SIZE = -0.6  # mm, by which the walls get thicker from base to tip
CORNERS: virtual.Corners = (  # s, kPa
    (0.0, 0.0), (1.2, 0.0), (2.8, 18.0), (3.6, 18.0), (4.8, 30.0), (5.8, 30.0), (7.0, 0.0), (8.0, 0.0)
)  # fmt: skip
REST_S = 1.0
BENCH = virtual.Bench(gauge_sd_MPa=1e-4, static_frames=120, placement_sd_mm=0.1)
LIMIT_MB = 2.0
Y = TABLE.width_mm / 2
X = {"p1": 18.0, "p2": 30.0, "middle": TABLE.finger.middle_node[0], "p4": 55.0, "tip": TABLE.length_mm}
QUICK = Recording(
    seed=31,
    bench=BENCH,
    course=virtual.path(BENCH, protocol=CORNERS),
    places={name: np.array([x, Y, 0.0]) for name, x in X.items()},
    look=Look(
        size=(640, 360), middle=(323.0, 178.0), px_per_mm=5.0, looks_at=(32.0, Y, -8.0)
    ),
    rig=Rig(
        frame=((-21, 20), (14, 22), (50, 22), (87, 20), (-23, -34), (14, -36), (50, -36), (87, -34)),
        fixed=((32, 22), (-23, -8), (87, 4), (32, -36)),  # clear of the finger's way
        clamp=((0.0, 18.0), (-14.0, 18.0), (-14.0, -6.0), (0.0, -6.0)),
        y=Y,
        tag_mm=5.0,
    ),
    boards=Boards(
        board=CharucoBoard(columns=7, rows=5, square_mm=8.0, marker_mm=6.0), reach=(38.0, 18.0), count=9
    ),
    clock=Clock(static_start=0.5, film_start=14.0, log_end=23.0),
)


def curved_taper(test: Test, size: float) -> Test:
    """Walls that are thicker by `size` mm at the tip than at the base, along half a sine."""
    inner = inside(test.case)
    x = inner.position[:, 0]
    share = (x - x.min()) / np.ptp(x)
    thicker = 0.5 * size * np.sin(np.pi * (share - 0.5))
    nodes = test.case.nodes + inner.spread(thicker[:, None] * inner.normal * [0.0, 1.0, 1.0])
    return replace(test, case=replace(test.case, nodes=nodes))


HIDDEN = Kind(
    name="curved_taper", physics="wall_taper", law="other", unit="mm", sizes=(SIZE,), part="static",
    before=curved_taper,
)  # fmt: skip


def truth() -> Case:
    """The finger that is filmed, as it was drawn."""
    return virtual.truth_case(TABLE.finger, LATTICE, material=replace(SILICONE, density=0.0))


def motion() -> Motion:
    """The motion of the finger as it is."""
    case = truth()
    displaced = partial(virtual.displaced, case, QUICK.course, hidden=((HIDDEN, SIZE),))
    return QUICK.motion(case, displaced)


def config() -> Config:
    """The twin.toml that a user who made this test would write."""
    points = [
        PointTable(name=m.name, position_mm=m.position, marker=m.kind.code, size_mm=m.size_mm)
        for m in QUICK.marks if m.role == "finger"
    ]  # fmt: skip
    return QUICK.config("quick", ModelTable(finger=TABLE, wall_sd_mm=0.0), points, reference_s=REST_S)


def truth_text(chance: Drawn) -> str:
    """The truth as TOML: what the stages must not see, and what tests compare with."""
    lines = [
        "# The hidden truth of datasets/quick, by benchmarks/films/make_quick.py. Units: mm, MPa, s, rad.",
        f"seed = {QUICK.seed}",
        f'effect = "{HIDDEN.physics}"',
        f"C10 = {SILICONE.C10}",
        f"C01 = {SILICONE.C01}",
        f"thicker_mm = {SIZE}  # the walls, from base to tip, along half a sine",
        f'lattice = "{LATTICE}"',
        *course_lines(CORNERS, BENCH),
        *drawn_lines(QUICK, chance),
    ]
    return "\n".join(lines) + "\n"


def make(folder: Path) -> bool:
    """Writes the data set into a folder and its truth into tests/data; says whether it is small enough."""
    chance = QUICK.write(folder, config(), motion())
    (ROOT / "tests" / "data" / "quick_truth.toml").write_text(truth_text(chance), encoding="utf-8")
    return small_enough(folder, LIMIT_MB)


def tried(seeds: Sequence[int]) -> int:
    """The number of films, one a seed, of which a stage says something else than what is hidden; prints a row
    for each."""
    moved, bad = motion(), 0
    for seed in seeds:
        began = time.process_time()
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            replace(QUICK, seed=seed).write(folder, config(), moved)
            for stage in ("camera", "measure", "calibrate", "diagnose"):
                said = stage_of(stage).run(Project.open(folder), Console(as_json=True))
        broken = wrong(said, "quick", least=1.0)
        bad += bool(broken)
        print(f"{seed:5d} {said['rms_before_mm']:.3f} -> {said['rms_after_mm'] or np.nan:.3f} mm, noise "
              f"{said['noise_sd_mm'] or np.nan:.3f} mm, {time.process_time() - began:.0f} s: "
              f"{said['verdict']} {broken}", flush=True)  # fmt: skip
    return bad


def main() -> int:
    typed = options(__doc__, {
        "--to": (ROOT / "datasets" / "quick", "folder"),
        "--seeds": (0, "draw and diagnose so many other films, keep nothing"),
    })  # fmt: skip
    if typed.seeds:
        return 1 if tried(range(1, 1 + typed.seeds)) else 0
    return 0 if make(typed.to) else 1


if __name__ == "__main__":
    sys.exit(main())
