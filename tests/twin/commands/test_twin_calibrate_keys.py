"""What [calibrate] of twin.toml states, through a whole calibration: priors, loss, bounds, held constants, starts."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.messages import Lines
from tests.twin.commands.test_twin_engine_chain import STUB, project_at
from twin import files
from twin.bench.fits import fit_file
from twin.commands.calibrate import run_calibrate
from twin.commands.review import run_review
from twin.judging.fitrecord import FitRecord
from twin.project.folder import Project
from twin.project.targetfiles import write_targets

pytestmark = pytest.mark.slow
SD = 0.01  # mm, of the targets: the correction by finer meshes is no whole number of scales
GROSS = 20 * SD  # by which two values are wrong
Calibrated = Callable[..., tuple[FitRecord, Lines, Project]]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """A project, in `gross` the same targets with two gross errors; what its meshes give has been solved."""
    found = project_at(tmp_path_factory.mktemp("keys") / "batch")
    exact = found.targets()
    covariance = np.tile(SD**2 * np.eye(3), (*exact.value.shape[:2], 1, 1))
    value = exact.value + SD * np.random.default_rng(2).normal(size=exact.value.shape)
    targets = replace(exact, value=value, covariance=covariance)
    shutil.rmtree(found.root / "targets")
    write_targets(found.root / "targets", targets)
    value = targets.value.copy()
    value[4, 0, 2] += GROSS
    value[5, 1, 0] -= GROSS
    write_targets(found.root / "gross", replace(targets, value=value))
    run_calibrate(found, Lines())
    return found


@pytest.fixture
def calibrated(project: Project, tmp_path: Path) -> Calibrated:
    """`calibrated(keys, model, gross=, starts=)`: what a calibration with these lines under [calibrate] and under
    [model] leaves and says."""

    def run(keys: str = "", model: str = "", *, gross: bool = False, **how: int) -> tuple[FitRecord, Lines, Project]:
        root = tmp_path / f"batch-{len(list(tmp_path.iterdir()))}"
        shutil.copytree(project.root, root, ignore=shutil.ignore_patterns("runs"))
        if gross:
            shutil.rmtree(root / "targets")
            (root / "gross").rename(root / "targets")
        text = (root / "twin.toml").read_text(encoding="utf-8")
        for table, lines in (("calibrate", keys), ("model", model)):
            for line in filter(None, lines.split("\n")):
                key = line.partition(" =")[0]
                text, count = re.subn(rf"(?m)(^\[{table}\]\n(?:(?!\[).*\n)*?)(?:# )?{re.escape(key)} =.*$", rf"\g<1>{line}", text)
                assert count == 1, line
        (root / "twin.toml").write_text(text, encoding="utf-8")
        opened, say = Project.open(root, builtin=STUB), Lines()
        run_calibrate(opened, say, **how)
        return files.read(FitRecord, fit_file(opened)), say, opened

    return run


def test_a_prior_pulls_by_its_sd_and_is_told(calibrated: Calibrated) -> None:
    free, _, _ = calibrated()
    # ten times as sure as the data, 1 sd of theirs away
    sd = float(np.sqrt(np.ones(2) @ free.fit.covariance @ np.ones(2)))
    wanted = free.fit.theta.sum() + sd
    found, say, project = calibrated(f'priors = {{"C10+C01" = [{wanted}, {0.1 * sd}]}}')
    assert found.fit.theta.sum() == pytest.approx(wanted, abs=0.3 * sd)
    (row,) = found.priors
    assert row.name == "C10+C01"
    assert (row.mean, row.sd) == (pytest.approx(wanted), pytest.approx(0.1 * sd))
    assert any(row.sentence in line for line in say.lines)
    run_review(project, say)
    report = project.newest("review", "report.html")
    assert report is not None
    assert "C10+C01" in report.read_text(encoding="utf-8")


def test_gross_errors_pull_least_squares_and_not_student_t(calibrated: Calibrated) -> None:
    pulled, _, _ = calibrated(gross=True)
    robust, say, _ = calibrated('loss = "student-t"', gross=True)
    free, _, _ = calibrated()
    off = [abs(found.fit.theta.sum() - free.fit.theta.sum()) for found in (pulled, robust)]
    assert off[1] < 0.2 * off[0]
    assert {(row.point, row.component) for row in robust.down_weighted[:2]} == {("tip", "U3"), ("middle", "U1")}
    assert all(row.weight < 0.05 for row in robust.down_weighted[:2])
    assert not pulled.down_weighted
    assert any("tip" in line and "weight" in line for line in say.lines)


def test_what_is_held_stays_and_what_is_bounded_ends_there(calibrated: Calibrated) -> None:
    free, _, _ = calibrated()
    held, _, _ = calibrated(model="fixed = {C01 = 0.05}")
    assert list(held.parameters) == ["C10"]
    # the sum is what these data know, to 1 % over the shares
    assert held.parameters["C10"].value + 0.05 == pytest.approx(free.fit.theta.sum(), rel=0.02)
    most = 0.95 * free.fit.theta.sum()
    narrow, say, _ = calibrated(f"bounds = {{C10 = [0.01, {most - 0.02}], C01 = [0.005, 0.02]}}")
    assert set(narrow.at_bound) == {"C10", "C01"}
    assert any("bound" in line for line in say.lines)


def test_several_starts_are_drawn_and_counted(calibrated: Calibrated) -> None:
    found, say, project = calibrated(starts=5)
    assert len(found.starts) >= 5
    assert sorted(row.chi2 for row in found.starts if row.chi2 is not None)[0] == found.starts[0].chi2
    assert project.newest("calibrate", "starts.png")
    assert any("start" in line for line in say.lines)
