"""What twin.toml says beforehand: priors, errors of Student's t, and many starts, through the stages."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import Finger, Lattice, solve
from fe.mesh.convert import converted
from tests.twin.conftest import Lines, plain_targets
from twin.bench.fits import fit_file, newest_fit
from twin.bench.workbench import Workbench
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.commands.diagnose import run_diagnose
from twin.commands.explain import run_explain
from twin.commands.posterior import run_posterior
from twin.judging.record import ComparisonRecord, FitRecord
from twin.model.basemodel import base_test
from twin.model.structure import BuiltIn, base_case
from twin.project import files
from twin.project.config import CalibrateTable, Config, PointTable
from twin.project.folder import Project
from twin.project.targetwriting import write_targets
from twin.project.toml import dump
from twin.targets import Targets, relative

STUB = BuiltIn(
    Finger(length=10 + 100 / 9, bellows=1, tip_node=(10 + 100 / 9, 11.5, 0.0), middle_node=(4 + 50 / 9, 11.5, 0.0)),
    Lattice(per_bellow=2, ring=False, centred=False),
)
SD = 2e-3  # mm, of the targets: the stub moves by tenths of a mm
OUTLIERS = ((6, 0, 2), (9, 1, 2), (12, 1, 0), (15, 0, 0), (18, 0, 2), (20, 1, 2))  # step, point, component


def targets_of(*, outliers: bool = False) -> Targets:
    """Noisy targets of a finger of one bellow, made of other elements than the model."""
    case, log = base_case(finger=STUB.finger, lattice=STUB.lattice), plain_targets()
    time = np.linspace(0.0, 9.0, 25)
    pressure, one = np.interp(time, log.log_time, log.log_pressure), np.ones((25, 3))
    t = plain_targets(
        time=time, pressure=pressure, block=np.zeros(25, np.int64), value=np.zeros((25, 3, 3)),
        covariance=np.tile(SD**2 * np.eye(3), (25, 3, 1, 1)), valid=np.ones((25, 3, 3), bool),
        held_out=np.zeros(25, bool), modes=np.zeros((0, 25, 3, 3)), pressure_sd=0 * time,
    )
    test = base_test(t, converted(case.with_material(C10=0.2, C01=0.05), "C3D20RH"))
    u = np.zeros_like(t.value)
    u[:, test.moving] = solve(test.case, test.path).at(test.points[test.moving])
    value = relative(u, t.reference, t.rests) + SD * np.random.default_rng(1).normal(size=u.shape)
    for at in OUTLIERS if outliers else ():
        value[at] += 0.2  # 100 sd
    return replace(t, value=value)


def project_at(folder: Path, targets: Targets, **calibrate: object) -> Project:
    folder.mkdir()
    points = (PointTable(name="tip", node=4401), PointTable(name="middle", node=5848))
    own = CalibrateTable(population=6, generations=2, **calibrate)  # type: ignore[arg-type]
    (folder / "twin.toml").write_text(dump(Config(points=points, calibrate=own)), encoding="utf-8")
    write_targets(folder / "targets", targets)
    return Project.open(folder, builtin=STUB)


if __name__ == "__main__":
    import tempfile, sys, time
    t0 = time.process_time()
    ok, bad = targets_of(), targets_of(outliers=True)
    print("targets", time.process_time() - t0, ok.value.shape)
    for name, t, how in (("plain", ok, {}), ("plain-bad", bad, {}), ("t", ok, {"loss": "student-t"}), ("t-bad", bad, {"loss": "student-t"}),
                    ("prior", ok, {"priors": {"C10": (0.25, 0.01), "C10+C01": (0.26, 0.01), "creep.g1": (0.1, 0.1)}})):
        folder = Path(tempfile.mkdtemp()) / name
        say = Lines()
        t0 = time.process_time()
        p = project_at(folder, t, **how)
        run_calibrate(p, say, starts=6 if name == "plain" else 0)
        r = files.read(FitRecord, fit_file(p))
        print("=====", name, time.process_time() - t0)
        print("\n".join(say.lines))
        print({k: (round(v.value, 5), v.sd) for k, v in r.parameters.items()}, r.chi2, r.degrees_of_freedom, r.adequate, r.intervals)
        print(r.said, r.down_weighted[:2], r.starts[:2], r.priors[:1])
