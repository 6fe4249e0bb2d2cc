"""Trials through the film: a hidden truth is drawn as a film, measured by `twin measure`, and diagnosed.

    python benchmarks/films/filmtrials.py --folder DIR [--count 20]

Camera, boards and tags are those of the demo, but every tag trembles, so that the mesh of the tables is good
enough; the finger is the short one in P3, with four markers. Projects lie in DIR until they are measured.
Rows go to `benchmarks/results/film.json` as they come, so that the command goes on where it was stopped;
`identify.py` takes them into its table. About six minutes of one core for each.
"""

import os
import shutil
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.collected import Rows
from benchmarks.diagnosis.fullruns import Quiet
from benchmarks.diagnosis.snapshots import POINTS, SHORT
from benchmarks.diagnosis.trialbench import (
    NAMES,
    START,
    Scene,
    Sight,
    Spec,
    beside,
    candidates,
    sized,
    told,
    worth,
)
from benchmarks.diagnosis.truthbook import displaced
from benchmarks.films.make_demo import DEMO
from benchmarks.tracking import studio

import numpy as np

from fe import Path as Course
from twin.bodies.finger import FingerTable
from twin.chain import stage_of
from twin.diagnosis.procedure import diagnose
from twin.gauge.pressuretable import PressureTable
from twin.marktables import FrameTable, PointTable
from twin.project.cameratables import CameraTable, MeasureTable
from twin.project.config import CalibrateTable, Config, ModelTable, ProjectTable
from twin.project.folder import Project
from twin.project.toml import dump
from twin.targets import Array, PointKind, TargetPoint, Targets
from twin.virtual.draws import Setup
from twin.virtual.hidden import KINDS
from twin.virtual.protocols import PROTOCOLS, Protocol
from vision import Mark
from vision.drawing import synthetic
from vision.kinds import CodedMarker

KINDS_FILMED = ("pressure_lag", "wall_taper", "eccentric_core", "tube", "pressure_offset", "two_volumes",
                "stepped_wall", "ballooning", "strain_limiting_layer", "tilted_core")  # fmt: skip
SIZES = (60.0, 30.0)  # non-centralities, by the noise of the trials without a film
HZ, STATIC, STEPS, LOG_HZ = 10.0, 320, 90, 50.0
TAG = 5.5  # mm
ROWS = [NAMES.index(name) for name in ("p1", "p3", "p5", "tip")]  # far enough apart for such tags
BLUR_PX, NOISE_GREY = 1.0, 6.0
TREMBLE_MM = 0.014  # of each tag on the finger, sd from frame to frame; the films' own noise is about 0.004


@dataclass(frozen=True)
class Filmed(Protocol):
    """P3 at every frame of a film."""

    @property
    def steps(self) -> Array:
        """Times (s,) s of the frames."""
        return np.round(np.arange(0.0, 49.0, 1 / HZ), 6)

    @property
    def course(self) -> Course:
        """As P3's, as finely as the film's log is read: a lag shorter than the steps between is told."""
        plain = super().course
        time = np.round(np.arange(0.0, plain.time[-1] + 0.5 / LOG_HZ, 1 / LOG_HZ), 6)
        pressure = np.interp(time, plain.time, plain.pressure)
        return replace(plain, time=time, pressure=pressure, gravity=np.zeros((len(time), 3)))


P3 = PROTOCOLS["P3"]
FILM = Filmed("P3", P3.recordings, P3.ramp, P3.along, P3.off_axis, P3.fixed)


def marks_of(rows: list[int]) -> tuple[Mark, ...]:
    """All tags: those of the finger at its places, frame and fixed ones as in the demo."""
    own = [
        Mark(NAMES[k], CodedMarker(n, TAG), tuple(map(float, POINTS[k])), "finger")
        for n, k in enumerate(rows)
    ]  # type: ignore[arg-type]
    return (*own, *(m for m in DEMO.marks if m.role != "finger"))


def shoot(folder: Path, u: Array, rows: list[int], seed: int) -> None:
    """Write film, static film, boards, pressure log and twin.toml of a motion (t, m, 3) mm."""
    rng, marks, raw = np.random.default_rng(seed), marks_of(rows), folder / "raw"
    raw.mkdir(parents=True)
    DEMO.write_boards(raw / "boards", rng)
    placed = np.tile([m.position for m in marks], (len(u), 1, 1)).astype(float)
    offset = 0.1 * rng.standard_normal((len(rows), 2))
    x = POINTS[rows][:, 0]
    gradient = np.gradient(u, x, axis=1) if len(set(x)) == len(x) else np.zeros_like(u)
    turn = np.arctan2(gradient[..., 2], 1 + gradient[..., 0])
    c, s = np.cos(turn), np.sin(turn)
    placed[:, : len(rows)] += u
    placed[:, : len(rows), 0] += c * offset[:, 0] - s * offset[:, 1]
    placed[:, : len(rows), 2] += s * offset[:, 0] + c * offset[:, 1]
    turns = np.zeros(placed.shape[:2])
    turns[:, : len(rows)] = turn
    lens, pose = DEMO.look.camera()
    for name, frames, k in (("film.mp4", np.arange(len(u)), 1), ("static.mp4", np.zeros(STATIC, int), 2)):
        trembling = placed[frames]
        trembling[:, : len(rows), ::2] += TREMBLE_MM * rng.standard_normal((len(frames), len(rows), 2))
        synthetic.film(raw / name, camera=lens, pose=pose, marks=marks, positions=trembling,
                       rotations=turns[frames], fps=HZ, blur_px=BLUR_PX,
                       noise_grey=NOISE_GREY, seed=10 * seed + k)  # fmt: skip
    time_s = np.arange(0.0, DEMO.clock.film_start + 52.0, 1 / LOG_HZ)
    course = FILM.course
    true = np.interp(time_s - DEMO.clock.film_start, course.time, course.pressure, left=0.0, right=0.0)
    read = true + 2e-5 * rng.standard_normal(len(time_s))
    studio.write_log(raw / "pressure.csv", time_s, read)
    (folder / "twin.toml").write_text(dump(config(marks)), encoding="utf-8")


def config(marks: tuple[Mark, ...]) -> Config:
    """The twin.toml of a film."""
    points = tuple(
        PointTable(name=m.name, position_mm=m.position, marker=m.kind.code, size_mm=m.size_mm)
        for m in marks
        if m.role == "finger"
    )
    short = FingerTable(length_mm=SHORT.length, pleats=SHORT.bellows)
    side = CameraTable(
        name="side", film="raw/film.mp4", static="raw/static.mp4", boards="raw/boards/*.jpg",
        film_start_s=DEMO.clock.film_start, static_start_s=DEMO.clock.static_start,
        board=studio.board_table(DEMO.boards.board),
    )  # fmt: skip
    return Config(
        project=ProjectTable(name="trial"), model=ModelTable(finger=short), cameras=(side,),
        pressure=PressureTable(),
        measure=MeasureTable(placement_sd_mm=0.1, scale_sd=0.001, steps=STEPS),
        frame=FrameTable(markers=studio.still_tables(marks)), points=points,
        calibrate=CalibrateTable(objective_points=(points[0].name,)), )  # fmt: skip


def spec_of(number: int) -> Spec:
    """What is filmed: kinds in turn, the second time smaller."""
    turn, k = divmod(number, len(KINDS_FILMED))
    return Spec("film", "P3", (KINDS_FILMED[k],), SIZES[turn % len(SIZES)], "white", 60_000 + number)


def seen(folder: Path) -> Targets:
    """The targets that `twin camera` and `twin measure` make of a film, at the places of the tables."""
    for stage in ("camera", "measure"):
        stage_of(stage).run(Project.open(folder), Quiet())
    targets = Project.open(folder).targets()
    points = tuple(
        TargetPoint(p.name, PointKind.PLACE, None, tuple(map(float, POINTS[NAMES.index(p.name)])))
        if p.name in NAMES else p
        for p in targets.points
    )  # fmt: skip
    return replace(targets, points=points)


def trial(folder: Path, spec: Spec) -> dict[str, Any]:
    """One film, measured and diagnosed."""
    began, kind, drawn = time.process_time(), KINDS[spec.kinds[0]], replace(Scene.of(spec), rows=ROWS)
    scene = Scene(FILM, drawn.rows, Setup(sd_mm=0.01), spec.seed, DEMO.clock.film_start)
    size, z = sized(Sight.of(drawn), kind, spec.sigmas, np.random.default_rng(spec.seed))
    hidden = ((kind, size),)
    shutil.rmtree(folder, ignore_errors=True)  # of a film that was not finished
    shoot(folder, displaced(FILM, hidden, scene.rows), scene.rows, spec.seed)
    targets = seen(folder)
    model = scene.model(targets)
    said = diagnose(model, candidates(), targets, seed=spec.seed, start=START, beside=beside(model, ()),
                    plan=False)  # fmt: skip
    row = told(spec, [(kind, size, z)]) | worth(said, scene, hidden, targets)
    shutil.rmtree(folder)  # 0.3 GB
    return row | {"seconds": time.process_time() - began}


def main() -> int:
    typed = options(__doc__, {
        "--folder": {"type": Path, "required": True},
        "--count": (20, "films"),
    })  # fmt: skip
    kept = Rows("film")
    for number in range(typed.count):
        spec = spec_of(number)
        if not kept.has(spec.key):
            row = trial(typed.folder / f"film-{number:02d}", spec)
            kept.add(row)
            print(f"{spec.kinds[0]:24s} {row['seconds']:6.0f} s  {row['verdict']}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
