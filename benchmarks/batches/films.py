"""Does an effect found in some films foretell a film that no fit has seen?

    python benchmarks/batches/films.py [--quick] [--json]

Three films of one short finger, each on a clock of its own: a slow cycle with a hold, a fast one, and, held
out, one in two steps. The truth is solved with 20-node hexahedra on another lattice than the model's, and
creeps by the logarithm of time, where the model's creep is a Prony series. With --quick targets are drawn
from the truth, a film each, with noise of their own; without it the films are drawn, and `twin measure`
measures them. `twin calibrate` and `twin diagnose` follow. heldout_ratio: the error in the held-out film
before, over that with the named effect.
"""

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import whole
from benchmarks.diagnosis.snapshots import SHORT
from benchmarks.films import filmtrials
from benchmarks.films.make_demo import DEMO
from benchmarks.tracking.studio import write_log

import numpy as np

from fe import Path as Course
from twin.bodies.finger import FingerTable
from twin.chain import stage_of
from twin.console import Console
from twin.inputs.films import FilmTargets, joined
from twin.marktables import PointTable
from twin.project.cameratables import FilmTable
from twin.project.config import DiagnoseTable, ModelTable
from twin.project.folder import Project
from twin.project.record import SourceRecord
from twin.project.targetwriting import write_targets
from twin.project.toml import dump
from twin.targets import Array, PointKind, TargetPoint
from twin.virtual.draws import noisy_targets
from twin.virtual.hidden import KINDS
from twin.virtual.protocols import Bench, places
from twin.virtual.truthsolves import CHANGE, COUNT, displaced, on_surface, truth_case
from vision import Mark
from vision.drawing import synthetic
from vision.kinds import CodedMarker

SEED, SIZE = 3, 0.12  # share of the stiffness that is lost in the truth's law
TOP = 0.03  # MPa
HZ, LOG_HZ, REST = 4.0, 5.0, 2.0  # 1/s, 1/s, s
FILMS = {  # (s, share of the top pressure)
    "slow": ((0, 0), (2, 0), (8, 1), (16, 1), (22, 0), (26, 0)),
    "fast": ((0, 0), (2, 0), (3, 0.8), (10, 0.8), (11, 0), (16, 0)),
    "steps": ((0, 0), (2, 0), (4, 0.5), (9, 0.5), (11, 0.9), (17, 0.9), (18, 0), (22, 0)),
}
HELD_OUT = "steps"
BEGIN = 20.0  # s, of a film on the clock of its log
MARKED = ("p2", "p4", "tip")
SD_MM = {"slow": 0.01, "fast": 0.02, "steps": 0.015}
CANDIDATES = ("creep", "clamp", "pressure_lag", "pressure_gain", "wall_taper")


def course(name: str, *, begin: float = 0.0) -> Course:
    """The true pressure of a film, with its frames as output times, from `begin` s on."""
    corner, share = np.array(FILMS[name], float).T
    time = np.round(np.arange(0.0, corner[-1] + 0.5 / LOG_HZ, 1 / LOG_HZ), 6)
    frames = np.round(np.arange(0.2, corner[-1] - 0.2, 1 / HZ), 6)
    return Course(begin + time, TOP * np.interp(time, corner, share), begin + frames)


def points() -> tuple[TargetPoint, ...]:
    """The markers on the finger."""
    every = places(SHORT)
    return tuple(TargetPoint(n, PointKind.PLACE, None, every[n]) for n in MARKED)


def truth(name: str) -> tuple[Array, Array]:
    """True displacements (s, p, 3) mm of the markers in a film, and their slopes in mm per MPa."""
    case = truth_case(SHORT, CHANGE).with_material(density=0.0)
    where = on_surface(case, np.array([p.position for p in points()]))
    return displaced(case, course(name), where, ((KINDS["log_creep"], SIZE),), count=COUNT)


def virtual(name: str, number: int) -> FilmTargets:
    """The targets that would be measured in a film."""
    bench = Bench(ripple_MPa=0.0, gauge_sd_MPa=2e-5, sd=SD_MM[name], placement_sd_mm=0.02, scale_sd=5e-4)
    drawn = noisy_targets(*truth(name), course(name), points=points(), bench=bench, seed=SEED + number)
    anew = tuple(f"new {kind}" for kind in drawn.mode_names)  # glued and scaled anew for every film
    drawn = replace(drawn, mode_names=anew)
    return FilmTargets(name=name, log=f"{name}.csv", targets=drawn, held_out=name == HELD_OUT)


def own_config(marks: tuple[Mark, ...]) -> Any:
    """The twin.toml of the three films."""
    names = {p.name: p for p in points()}
    made = filmtrials.config(marks)
    table = FingerTable(length_mm=SHORT.length, pleats=SHORT.bellows)
    own = tuple(
        PointTable(name=m.name, position_mm=names[m.name].position, marker=m.kind.code, size_mm=m.size_mm)
        for m in marks if m.role == "finger"
    )  # fmt: skip
    films = tuple(
        FilmTable(
            name=n, file=f"raw/{n}.mp4", pressure=f"raw/{n}.csv", film_start_s=BEGIN, held_out=n == HELD_OUT
        )
        for n in FILMS
    )
    camera = made.cameras[0].model_copy(
        update={"film": films[0].file, "film_start_s": BEGIN, "static_start_s": None}
    )
    return made.model_copy(
        update={
            "points": own, "cameras": (camera,), "films": films, "model": ModelTable(finger=table),
            "calibrate": made.calibrate.model_copy(update={"objective_points": ("tip", "p4")}),
            "diagnose": DiagnoseTable(candidates=CANDIDATES),
        }
    )  # fmt: skip


def all_marks() -> tuple[Mark, ...]:
    """The tags on the finger, and those on the rig of the demo."""
    own = [Mark(p.name, CodedMarker(k, 4.0), p.position, "finger") for k, p in enumerate(points())]
    return (*own, *(m for m in DEMO.marks if m.role != "finger"))


def shoot(folder: Path) -> None:
    """Draw the films, one static film, the boards and a log for each film."""
    rng, marks, raw = np.random.default_rng(SEED), all_marks(), folder / "raw"
    DEMO.write_boards(raw / "boards", rng)
    still = np.array([m.position for m in marks], float)
    _film(raw / "static.mp4", marks, np.tile(still, (filmtrials.STATIC, 1, 1)), SEED)
    for k, name in enumerate(FILMS):
        u, _ = truth(name)
        placed = np.tile(still, (len(u), 1, 1))
        placed[:, : u.shape[1]] += u
        _film(raw / f"{name}.mp4", marks, placed, SEED + 1 + k)
        time = np.arange(0.0, BEGIN + FILMS[name][-1][0] + 5.0, 0.02)
        corner, share = np.array(FILMS[name], float).T
        begin = BEGIN - course(name).output[0]  # the first frame is taken BEGIN s after the log began
        read = TOP * np.interp(time - begin, corner, share) + 2e-5 * rng.standard_normal(len(time))
        write_log(raw / f"{name}.csv", time, read)


def _film(path: Path, marks: tuple[Mark, ...], placed: Array, seed: int) -> None:
    lens, pose = DEMO.look.camera()
    synthetic.film(
        path, camera=lens, pose=pose, marks=marks, positions=placed, rotations=np.zeros(placed.shape[:2]),
        fps=HZ, blur_px=filmtrials.BLUR_PX, noise_grey=filmtrials.NOISE_GREY, seed=seed,
    )  # fmt: skip


def films(quick: bool) -> dict[str, Any]:
    """How much the named effect lowers the error in a film that no fit has seen, the effects named,
    and whether films were drawn."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "raw" / "boards").mkdir(parents=True)
        made = own_config(all_marks())
        if quick:
            targets, rows = joined([virtual(film, k) for k, film in enumerate(FILMS)])
            write_targets(folder / "targets", targets, source=SourceRecord(films=tuple(rows)))
            made = made.model_copy(update={"cameras": (), "films": (), "pressure": None})
        else:
            shoot(folder)
        (folder / "twin.toml").write_text(dump(made), encoding="utf-8")
        stages = ("calibrate", "diagnose") if quick else ("camera", "measure", "calibrate", "diagnose")
        for stage in stages:
            found = stage_of(stage).run(Project.open(folder), Console(as_json=True))
    (row,) = found["held_out"]
    return {
        "heldout_ratio": row["ratio"], "heldout_before_mm": row["before"]["rms_mm"],
        "heldout_after_mm": row["after"]["rms_mm"] if row["after"] else None,
        "heldout_noise_mm": row["before"]["noise_sd_mm"], "heldout_named": found["named"],
        "heldout_from": "targets drawn from a truth" if quick else "films drawn from a truth",
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(whole(__doc__, films, quick="targets in place of films"))
