"""A calibration whose candidates CalculiX solves: a small genetic run, killed and resumed, and what follows it."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from fe import Finger, Lattice, solve
from fe.deck.calculix import CalculiX
from fe.mesh.convert import converted
from tests.twin.conftest import plain_targets
from twin.bench.fits import fit_file
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.commands.diagnose import run_diagnose
from twin.judging.record import FitRecord
from twin.model.basemodel import base_test
from twin.model.structure import BuiltIn, base_case
from twin.project import files
from twin.project.config import CalibrateTable, Config, ModelTable, PointTable
from twin.project.folder import Project
from twin.project.targetwriting import write_targets
from twin.project.toml import dump
from twin.targets import relative

STUB = BuiltIn(
    Finger(length=10 + 100 / 9, bellows=1, tip_node=(10 + 100 / 9, 11.5, 0.0), middle_node=(4 + 50 / 9, 11.5, 0.0)),
    Lattice(per_bellow=2, ring=False, centred=False),
)
TRUE = {"C10": 0.2, "C01": 0.05}
SD = 2e-4  # mm, of the targets: the stub moves by tenths of a mm
CANDIDATES = 6 + 2 * 4  # population 6 with an elite of 2, 3 generations


@dataclass
class Silent:
    """A `say` that keeps the lines."""

    lines: list[str] = field(default_factory=list)

    def __call__(self, text: str, /) -> None:
        self.lines.append(text)

    def progress(self, stage: str, done: int, total: int, /) -> None:
        assert 0 <= done <= total, stage


def project_at(folder: Path, **model: object) -> Project:
    """A project whose targets are solved by this kernel in the elements of the other program."""
    case = base_case(finger=STUB.finger, lattice=STUB.lattice)
    targets = plain_targets()
    half = 0.5
    targets = replace(targets, pressure=half * targets.pressure, log_pressure=half * targets.log_pressure)
    test = base_test(targets, converted(case.with_material(**TRUE), "C3D20RH"))
    u = np.zeros_like(targets.value)
    u[:, test.moving] = solve(test.case, test.path).at(test.points[test.moving])
    value = relative(u, targets.reference, targets.rests) + SD * np.random.default_rng(1).normal(size=u.shape)
    covariance = np.tile(SD**2 * np.eye(3), (*u.shape[:2], 1, 1))
    folder.mkdir()
    config = Config(
        points=(PointTable(name="tip", node=4401), PointTable(name="middle", node=5848)),
        calibrate=CalibrateTable(population=6, generations=3),
        model=ModelTable(**model),  # type: ignore[arg-type]
    )
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", replace(targets, value=value, covariance=covariance))
    return Project.open(folder, builtin=STUB)


@pytest.fixture(scope="module")
def calibrated(
    tmp_path_factory: pytest.TempPathFactory, require: Callable[[str], None], one_process: None
) -> tuple[Project, Silent, list[int]]:
    """A project that CalculiX calibrated: interrupted in its tenth job, and run again; with the number of jobs
    of either run."""
    require("ccx")
    project, say, counts = project_at(tmp_path_factory.mktemp("engine") / "batch", engine="calculix"), Silent(), [0]
    own = CalculiX.run

    def counting(self: CalculiX, text: str, **where: Path) -> object:
        counts[-1] += 1
        if len(counts) == 1 and counts[0] == 10:
            raise KeyboardInterrupt
        return own(self, text, **where)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CalculiX, "run", counting)
        with pytest.raises(KeyboardInterrupt):
            run_calibrate(project, say)
        counts.append(0)
        run_calibrate(project, say)
    return project, say, counts


def test_the_genetic_algorithm_by_jobs_finds_the_constants(calibrated: tuple[Project, Silent, list[int]]) -> None:
    project, say, _ = calibrated
    record = files.read(FitRecord, fit_file(project))
    assert record.engine == "calculix"
    assert record.release.startswith("CalculiX 2")
    fit, total = record.fit, sum(TRUE.values())
    # the two engines in one element agree to 0.1 % of a displacement, and the noise leaves as much of the sum
    assert fit.theta.sum() == pytest.approx(total, rel=5e-3)
    assert any("The error of the mesh is not known" in line for line in say.lines)
