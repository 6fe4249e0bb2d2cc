"""Does a newcomer come through? Every documented path, command by command, in folders of its own.

    python benchmarks/newcomers.py [--only PATH ..] [--json]

`sheet`: an own film before the printed sheet, from an empty folder to the targets, with how many characters
and coordinates are typed into twin.toml, and how far the tip is off in mm and in stated sds;
`film`: the quick recording, from its twin.toml to the report; `new batch`: the same rig again, by
`init --like`; `table`: displacements of an own finger in a CSV of decimal commas, with creep hidden;
`notebook`: the example of docs/python.md, run twice; `deck`: the calibrated finger as an Abaqus deck, made a
project again; `prediction`: what `predict` and `export` are asked; `own effect`: the example of
docs/own-effect.md. Of each: how many commands, how many were refused, and the processor's seconds.
`motion capture of an arm`: recordings of a real pneumatic arm, a file a pressure, from `$SOFTTWIN_DATA`.
`export_tip_error` is how far ccx and the model are apart at the tip, of its displacement (null without ccx).
About eight minutes.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks import ROOT
from benchmarks.chain import STAGES, TWIN, fresh
from benchmarks.commandline import options, processor
from benchmarks.kernel.arm import Arm
from benchmarks.tracking.own_film import SINKS, write_recordings

import numpy as np

from fe import Lattice, Material
from fe import Path as Course
from fe.engines.calculix import CalculiX
from fe.engines.writer import deck as deck_text
from twin import files, virtual
from twin.bench.fits import fit_file
from twin.bench.workbench import Workbench
from twin.bodies.finger import FingerTable
from twin.calibrated.predictions import WantedCourse, followed
from twin.judging.fitrecord import FitRecord
from twin.marktables import FrameTable
from twin.messages import Silent
from twin.project.config import Config
from twin.project.folder import Project, dataset
from twin.project.framesheet import with_sheet
from twin.project.toml import parse, with_key
from twin.targets import PointKind
from twin.validation import decoded, value_text

CREEP = ((0.06, 3.0),)  # hidden in the table: 6 % of the stiffness relax with 3 s
PRESSED = "10kPa"
RECORDINGS = Path(os.environ.get("SOFTTWIN_DATA", ROOT.parent / "shared" / "data")) / "pneumatic_arm"
BALLS = ("m5=100,-26.5,-9.6", "m6=100,0,-28.2", "m7=100,26.5,-9.6")  # mm, as a user reads them off the arm
SHEET, RULERS = "raw/frame.toml", (249.1, 160.5)  # mm, as a printer may have them that is off by 0.4 %
READ = [249.2, 160.4]  # as they are read
DIMENSIONS = {
    "length_mm": 112.0, "width_mm": 23.0, "height_mm": 20.0, "side_wall_mm": 2.0, "bottom_wall_mm": 2.5,
    "top_wall_mm": 2.7, "base_cap_mm": 10.0, "tip_cap_mm": 6.0, "pleats": 9, "pleat_depth_mm": 6.0,
    "side_pleat_depth_mm": 2.0,
}  # fmt: skip


@dataclass
class Walk:
    """A newcomer's way through one path: commands as they are typed, in a folder."""

    folder: Path
    typed: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    aside: float = 0.0  # s of the processor for what a newcomer does with hands: filming
    more: dict[str, float] = field(default_factory=dict)  # further figures of the path

    def twin(self, *words: str) -> None:
        """Type one command."""
        self._run(" ".join(("twin", *words)), [*TWIN, *words])

    def python(self, text: str, *, name: str) -> None:
        """Run a script."""
        (self.folder / name).write_text(text, encoding="utf-8")
        self._run(f"python {name}", [sys.executable, name])

    def _run(self, said: str, command: list[str]) -> None:
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        told = subprocess.run(command, cwd=self.folder, env=env, capture_output=True, text=True)
        self.typed.append(said)
        if told.returncode:
            self.refused.append(said)
            print(f"{said}: {told.stderr.strip()[-400:]}", file=sys.stderr, flush=True)


# -- the paths -----------------------------------------------------------------------------------------------


def sheet(walk: Walk) -> None:
    """An own film before the printed sheet, up to its displacements."""
    root = walk.folder / "my-film"
    walk.twin("init", "my-film")
    walk.twin("print", "--frame", "a4", "-p", "my-film")
    began = processor()
    printed = with_sheet(with_frame(root, FrameTable(sheet=SHEET, ruler_mm=RULERS, finger="left")), root)
    rng = np.random.default_rng(4)
    glued = [m.model_copy(update={"position_mm": (x + rng.normal(0, 0.1), y, z + rng.normal(0, 0.1))})
             for m in printed.frame.markers for x, y, z in [m.position_mm]]  # fmt: skip
    write_recordings(root / "raw", glued)
    walk.aside += processor() - began
    walk.twin("setup", "my-film", "--yes")
    walk.more |= typed_in(root, {"ruler_mm": READ, **DIMENSIONS})
    for command in ("check", "camera", "measure"):
        walk.twin(command, "-p", "my-film")
    walk.more |= tip_error_of(root)


def with_frame(root: Path, frame: FrameTable) -> Config:
    """The configuration of a project with another frame."""
    config = parse((root / "twin.toml").read_bytes(), name="twin.toml")
    return config.model_copy(update={"frame": frame})


def typed_in(root: Path, values: dict[str, Any]) -> dict[str, float]:
    """Values typed over those of a twin.toml, whose commented lines are made to count; how many characters
    and coordinates that were."""
    path = root / "twin.toml"
    text = path.read_text(encoding="utf-8").replace("# [model.finger]", "[model.finger]", 1)
    for key, value in values.items():
        line = f"{key} = {value_text(value)}  "
        text, count = re.subn(rf"^(# )?{key} = [^#\n]*", line, text, count=1, flags=re.M)
        assert count, key
    path.write_text(text, encoding="utf-8")
    return {"characters": sum(len(value_text(v)) for v in values.values()),
            "coordinates": sum(key in ("position_mm", "seen_mm") for key in values)}  # fmt: skip


def tip_error_of(root: Path) -> dict[str, float]:
    """How far the tip's displacement at the end of the film is off, mm, and in sds as stated."""
    if not (root / "targets").is_dir():
        return {}
    targets = Project.open(root).targets()
    row = targets.names.index("tip")
    off = targets.value[-1, row, [0, 2]] - SINKS[-1]
    shared = (targets.modes[:, -1, row][:, [0, 2]] ** 2).sum(axis=0)
    sd = np.sqrt(np.diag(targets.covariance[-1, row])[[0, 2]] + shared)
    return {"tip_error_mm": round(float(np.linalg.norm(off)), 4),
            "tip_error_sd": round(float(np.sqrt(np.mean((off / sd) ** 2))), 2)}  # fmt: skip


def film(walk: Walk) -> None:
    """From the films to the report."""
    fresh(dataset("quick"), walk.folder / "batch-07")
    walk.twin("check", "-p", "batch-07")
    for stage in STAGES:
        walk.twin(stage, "-p", "batch-07")


def new_batch(walk: Walk) -> None:
    """The same rig again."""
    walk.twin("init", "batch-08", "--like", "batch-07")
    shutil.copytree(walk.folder / "batch-07" / "raw", walk.folder / "batch-08" / "raw", dirs_exist_ok=True)
    walk.twin("recalibrate", "-p", "batch-08")
    walk.twin("compare", "batch-07", "batch-08")


def table(walk: Walk) -> None:
    """Displacements of an own finger, from another program."""
    walk.twin(*own_table(walk.folder))
    for command in ("check", "measure", "calibrate", "compare", "diagnose", "add"):
        walk.twin(command, "-p", "my-own")


def own_table(folder: Path) -> list[str]:
    """The words of `twin init` for the displacements of an own finger, whose file is written to a folder."""
    own = FingerTable(length_mm=44.0, pleats=3)
    silicone, mesh = Material(0.214, 0.083, prony=CREEP), Lattice(per_bellow=6, wall=2, centred=False)
    truth = virtual.truth_case(own.finger, mesh, material=silicone, element=None)
    t = np.arange(0.0, 34.0, 0.8)
    p = np.interp(t, [0.0, 2.0, 8.0, 20.0, 26.0, 34.0], [0.0, 0.0, 0.03, 0.03, 0.0, 0.0])
    at = {"tip": (44.0, 11.5, 0.0), "mid": (30.0, 11.5, 0.0), "q": (15.0, 11.5, 0.0)}
    u = virtual.displaced(truth, Course(t, p, t), np.array(list(at.values())))[0]
    x = np.array(list(at.values())) + u - u[0] + np.random.default_rng(0).normal(0.0, 0.02, u.shape)
    lines = ["time_s;pressure_bar;" + ";".join(f"{name}_{axis}_mm" for name in at for axis in "xz")]
    for k, place in enumerate(x):
        row = [t[k], 10 * p[k], *place[:, [0, 2]].ravel()]
        lines.append(";".join(f"{value:.4f}".replace(".", ",") for value in row))
    (folder / "own.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    nodes = [word for name, place in at.items() for word in ("--node", f"{name}={','.join(map(str, place))}")]
    finger = ("--finger", "length_mm=44", "--finger", "pleats=3")
    return ["init", "my-own", "--targets", "own.csv", *finger, "--sd-mm", "0.02", *nodes]


def motion_capture(walk: Walk) -> None:
    """Recordings of a pneumatic arm, a file a pressure, with balls off its skin; all but three held out."""
    (walk.folder / "arm.inp").write_text(deck_text(Arm(cells=(4, 1, 1)).case(), 0.01), encoding="utf-8")
    files_of_arm = sorted(file.name for file in RECORDINGS.glob("*.csv"))
    others = [file for file in files_of_arm if not any(f"{mbar}mbar" in file for mbar in (100, 200, 300))]
    held = [word for file in others for word in ("--hold-out", file)]
    nodes = [word for node in BALLS for word in ("--node", node)]
    walk.twin("init", "my-arm", "--targets", str(RECORDINGS), "--pressure-from", "name", "--sd-mm", "0.05",
              "--axes=x,-y,-z", "--deck", "arm.inp", *nodes, *held)  # fmt: skip
    for command in ("look", "check", "calibrate", "compare", "diagnose"):
        walk.twin(command, "-p", "my-arm")
    walk.twin("predict", "-p", "my-arm", "--pressure", "15kPa")


def notebook(walk: Walk) -> None:
    """The example of docs/python.md on a finished project, twice."""
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    example = re.search(r"^```python\n(.*?)^```$", page, re.S | re.M)
    assert example is not None
    own = example[1].replace("my-batch", "batch-07")
    body = "".join(f"    {line}\n" for line in own.splitlines())
    for _ in range(2):
        walk.python(f'if __name__ == "__main__":\n{body}', name="notebook.py")


def deck(walk: Walk) -> None:
    """The calibrated finger as a deck, and a project of a deck with the displacements of the film."""
    walk.twin("export", "abaqus", "--pressure", PRESSED, "-p", "batch-07")
    made = Project.open(walk.folder / "batch-07").newest("export", "finger.inp")
    if made is None:
        return
    shutil.copy(made, walk.folder / "finger.inp")
    bench = Workbench.of(Project.open(walk.folder / "batch-07"))
    names = [point.name for point in bench.targets.points if point.kind is not PointKind.FIXED]
    own = {n: ",".join(f"{v:.6g}" for v in at(bench, n)) for n in names}
    nodes = [word for n in own for word in ("--node", f"{n}={own[n]}")]
    walk.twin("init", "my-deck", "--deck", "finger.inp", "--targets", "batch-07/targets", *nodes)
    walk.twin("look", "-p", "my-deck")
    walk.twin("check", "-p", "my-deck")


def prediction(walk: Walk) -> None:
    """What a calibrated twin is asked."""
    held = ("--pressure", PRESSED, "--pressure", "25kPa", "--at", "tip", "--at", "x=40")
    walk.twin("predict", "-p", "batch-07", *held)
    walk.twin("predict", "-p", "batch-07", "--pressure", PRESSED, "--blocked")
    walk.twin("predict", "-p", "batch-07", "--inverse", "tip.U3=-5")
    walk.twin("predict", "-p", "batch-07", "--course", "batch-07/raw/pressure.csv", "--at", "tip")
    for form in ("json", "csv"):
        walk.twin("export", form, "-p", "batch-07")


def own_effect(walk: Walk) -> None:
    """The cable of docs/own-effect.md."""
    page = (ROOT / "docs" / "own-effect.md").read_text(encoding="utf-8")
    text = re.search(r"^```python\n(.*?)^```$", page, re.S | re.M)
    assert text is not None
    folder = walk.folder / "batch-07"
    (folder / "effects").mkdir(exist_ok=True)
    (folder / "effects" / "cable.py").write_text(text[1], encoding="utf-8")
    toml = folder / "twin.toml"
    named = with_key(decoded(toml.read_bytes()), "model", "effect_files", ["effects/cable.py"])
    toml.write_text(named, encoding="utf-8")
    walk.twin("trust", "-p", "batch-07")
    walk.twin("explain", "cable", "-p", "batch-07")
    walk.twin("add", "cable", "-p", "batch-07")
    walk.twin("drop", "cable", "-p", "batch-07")


PATHS: dict[str, Callable[[Walk], None]] = {
    "sheet": sheet, "film": film, "new batch": new_batch, "table": table, "notebook": notebook, "deck": deck,
    "prediction": prediction, "own effect": own_effect, "motion capture of an arm": motion_capture,
}  # fmt: skip

ALONE = {"sheet", "table", "motion capture of an arm"}  # need no film measured before them


# -- figures beside -----------------------------------------------------------------------------------------


def tip_error(folder: Path) -> float | None:
    """By how much ccx on the exported deck and the model on its own mesh differ at the tip, of its
    displacement; None without ccx."""
    engine = CalculiX()
    if shutil.which(engine.executable) is None:
        return None
    walk = Walk(folder)
    walk.twin("export", "calculix", "-p", "batch-07")  # at the highest pressure of the film
    project = Project.open(folder / "batch-07")
    made = project.newest("export", "finger.inp")
    if made is None or walk.refused:
        return None
    solved = engine.run(made.read_text(encoding="utf-8"))
    bench, record = Workbench.of(project), files.read(FitRecord, fit_file(project))
    course = WantedCourse.held(float(bench.targets.log_pressure.max()), ramp_s=2.0, hold_s=2.0)
    own, model = followed(bench, record, [course], {}, Silent())
    away = np.linalg.norm(bench.case.nodes - at(bench, "tip"), axis=1)
    row = int(np.where(np.isin(bench.case.labels, solved.labels), away, np.inf).argmin())
    here = model.on_mesh(None).solution(record.fit.theta).fields([len(own.time) - 1])[0][row]
    there = solved.at(int(bench.case.labels[row]))
    return float(np.linalg.norm(there - here) / np.linalg.norm(here))


def at(bench: Workbench, name: str) -> Any:
    """The place (3,) mm of a point on the finger at rest."""
    return bench.targets.places(bench.case.position)[bench.targets.names.index(name)]


def main() -> int:
    """Print the table; the exit code is 1 where a command was refused."""
    named = {"nargs": "+", "choices": list(PATHS), "default": list(PATHS), "help": "these, after the film"}
    typed = options(__doc__, {"--only": named}, json="one JSON line")
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        first = ["film"] if set(typed.only) - ALONE else []
        for name in dict.fromkeys([*first, *typed.only]):
            began, walk = processor(), Walk(Path(folder))
            PATHS[name](walk)
            spent = round(processor() - began - walk.aside, 1)
            counts = {"commands": len(walk.typed), "refused": len(walk.refused), "cpu_s": spent}
            found[name] = {**counts, **walk.more}
            print(f"{name}: {found[name]}", file=sys.stderr, flush=True)
        error = tip_error(Path(folder)) if "film" in found else None
    if typed.json:
        print(json.dumps({"paths": found, "export_tip_error": error}))
    else:
        print(f"{'path':24s} commands  refused   cpu_s")
        for name, row in found.items():
            print(f"{name:24s} {row['commands']:8d} {row['refused']:8d} {row['cpu_s']:7.1f}")
        print(f"export_tip_error: {error}")
    return int(any(row["refused"] for row in found.values()))


if __name__ == "__main__":
    sys.exit(main())
