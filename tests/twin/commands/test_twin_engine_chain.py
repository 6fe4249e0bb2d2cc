"""A calibration whose candidates CalculiX solves: a small genetic run, killed and resumed, and what follows it."""

import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fe import Finger, Lattice, solve
from fe.engines import writer
from fe.engines.abaqus import Abaqus
from fe.engines.calculix import CalculiX
from fe.engines.engine import EngineResult
from fe.mesh.convert import converted
from tests.messages import Lines, saying
from tests.twin.conftest import plain_targets
from twin import files
from twin.bench.engines import engine_of, together_of
from twin.bench.fits import fit_file
from twin.commands.add import run_add
from twin.commands.calibrate import run_calibrate
from twin.commands.check import run_check
from twin.commands.compare import run_compare
from twin.commands.diagnose import run_diagnose
from twin.commands.explain import run_explain
from twin.commands.predict import run_predict
from twin.commands.profile import run_profile
from twin.commands.review import run_review
from twin.commands.study import run_study
from twin.executors.local import Processes, using
from twin.judging.fitrecord import FitRecord
from twin.marktables import PointTable
from twin.model import enginejobs
from twin.model.keptmodel import base_test
from twin.model.structure import BuiltIn, base_case
from twin.project.config import CalibrateTable, Config, ModelTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.project.toml import dump
from twin.study.generations import evaluations
from twin.targets import relative

STUB = BuiltIn(
    Finger(length=10 + 100 / 9, bellows=1, tip_node=(10 + 100 / 9, 11.5, 0.0), middle_node=(4 + 50 / 9, 11.5, 0.0)),
    Lattice(per_bellow=2, ring=False, centred=False),
)
TRUE = {"C10": 0.2, "C01": 0.05}
SD = 2e-4  # mm, of the targets: the stub moves by tenths of a mm
CANDIDATES = evaluations(4, 2)
BEFORE = 5  # jobs, of which 4 are the first generation, until the run is interrupted


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
        calibrate=CalibrateTable(population=4, generations=2),
        model=ModelTable(**model),  # type: ignore[arg-type]
    )
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", replace(targets, value=value, covariance=covariance))
    return Project.open(folder, builtin=STUB)


@dataclass(frozen=True)
class Calibrated:
    """A project that CalculiX calibrated: interrupted in its second generation, and run again; the decks of either."""

    project: Project
    say: Lines
    first: list[str]
    second: list[str]


@pytest.fixture(autouse=True, scope="module")
def few_levels() -> Iterator[None]:
    """Jobs of a few pressures: the stub moves by tenths of a mm, which bends no curve."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(enginejobs, "LEVELS", 4)
        patch.setattr(writer, "FIRST_INCREMENT", 0.25)
        patch.setattr(writer, "LARGEST_INCREMENT", 0.25)
        yield


@pytest.fixture(scope="module")
def calibrated(
    tmp_path_factory: pytest.TempPathFactory, require: Callable[[str], None]
) -> Calibrated:
    require("ccx")
    project = project_at(tmp_path_factory.mktemp("engine") / "batch", engine="calculix")
    made, own = Calibrated(project, Lines(), [], []), CalculiX.run

    def interrupted(self: CalculiX, text: str, **where: Path) -> EngineResult:
        if len(made.first) == BEFORE:
            raise KeyboardInterrupt
        made.first.append(text)
        return own(self, text, **where)

    def counted(self: CalculiX, text: str, **where: Path) -> EngineResult:
        made.second.append(text)
        return own(self, text, **where)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CalculiX, "run", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_calibrate(project, made.say)
        patch.setattr(CalculiX, "run", counted)
        run_calibrate(project, made.say)
    return made


def candidates(project: Project) -> dict[str, np.ndarray]:
    path = project.newest("calibrate", "candidates.npz")
    assert path is not None
    return files.read_npz(path, "x", "rms_mm")


def test_the_genetic_algorithm_by_jobs_finds_the_constants(calibrated: Calibrated) -> None:
    record, say = files.read(FitRecord, fit_file(calibrated.project)), calibrated.say
    assert record.engine == "calculix"
    assert record.release.startswith("CalculiX 2")
    # the two engines agree to 0.1 % of a displacement in one element; noise leaves less of the sum
    assert record.fit.theta.sum() == pytest.approx(sum(TRUE.values()), rel=3e-3)
    unknown = [line for line in say.lines if "The error of the mesh is not known" in line]
    assert any("and not by CalculiX" in line for line in unknown)
    assert not any((calibrated.project.root / "cache" / "jobs").iterdir())


def test_an_interrupted_run_goes_on_with_the_same_candidates(
    calibrated: Calibrated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project, again = calibrated.project, tmp_path / "again"
    assert len(project.runs()) == 1  # resumed
    asked = candidates(project)
    assert len(asked["x"]) == CANDIDATES == 4 + 2  # an elite of 2 is not solved again
    assert any(f"{CANDIDATES} jobs for the genetic algorithm" in line for line in calibrated.say.lines)
    # what was done is not done again, candidate by candidate, though its generation was not told
    left = len(np.unique(asked["x"], axis=0)) - BEFORE  # a child may be its parent: that is no job either
    assert len(set(calibrated.first)) == BEFORE
    assert 0 < left <= CANDIDATES - BEFORE
    assert not set(calibrated.first) & set(calibrated.second[:left])

    def none(*_: object, **__: object) -> None:
        raise AssertionError("a job")

    shutil.copytree(project.root, again)
    shutil.rmtree(again / "runs")
    monkeypatch.setattr(CalculiX, "run", none)  # the same search, uninterrupted, on what the jobs gave
    run_calibrate(Project.open(again, builtin=STUB), Lines())
    other = Project.open(again, builtin=STUB)
    for name, values in candidates(other).items():
        np.testing.assert_array_equal(values, asked[name])
    assert files.read(FitRecord, fit_file(other)) == files.read(FitRecord, fit_file(project))


def test_compare_needs_no_job_and_other_stages_name_the_way_out(
    calibrated: Calibrated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "batch"
    shutil.copytree(calibrated.project.root, root)
    project, say = Project.open(root, builtin=STUB), Lines()
    monkeypatch.setattr(CalculiX, "run", None)
    assert run_compare(project, say)["stage"] == "compare"
    text = (root / "twin.toml").read_text(encoding="utf-8")
    assert 'engine = "calculix"' in text
    cpus = text.replace('engine = "calculix"', 'engine = "calculix"\nengine_cpus = 2')
    cpus = re.sub(r"(?m)^# engine_cpus.*\n", "", cpus)
    (root / "twin.toml").write_text(cpus, encoding="utf-8")
    assert fit_file(Project.open(root, builtin=STUB))  # how many processors a job has changes no figure
    (root / "twin.toml").write_text(text.replace('engine = "calculix"', 'engine = "embedded"'), encoding="utf-8")
    with pytest.raises(ValueError, match=saying(r"\[model\]", "twin.toml", "twin calibrate")):
        run_compare(Project.open(root, builtin=STUB), say)


@pytest.mark.slow
def test_an_effect_is_added_and_reviewed_by_jobs(calibrated: Calibrated, tmp_path: Path) -> None:
    """Five minutes where the machine is busy, half of one else."""
    root = tmp_path / "batch"
    shutil.copytree(calibrated.project.root, root)
    result = run_add(Project.open(root, builtin=STUB), Lines(), names=["camera_scale"])
    record = files.read(FitRecord, fit_file(Project.open(root, builtin=STUB)))
    assert result["effects"] == ["camera_scale"]
    assert record.engine == "calculix"
    one = record.estimates["camera_scale.scale"]
    assert one.low is not None
    assert one.high is not None
    assert one.low < 0.0 < one.high  # the truth has none
    run_review(Project.open(root, builtin=STUB), Lines())


STAGES = [run_diagnose, run_explain, run_profile, run_predict, run_study]


def test_a_stage_that_needs_derivatives_refuses_another_engine(tmp_path: Path) -> None:
    project = project_at(tmp_path / "batch", engine="abaqus")
    for stage in STAGES:
        name = stage.__name__.removeprefix("run_")
        options = {"name": "creep"} if stage is run_explain else {"pressure": ["20kPa"]} if stage is run_predict else {}
        with pytest.raises(ValueError, match=rf'"?abaqus.?: twin {name} asks for .* set engine = "embedded"'):
            stage(project, Lines(), **options)  # type: ignore[operator]


@pytest.mark.parametrize(("engine", "command"), [("calculix", "ccx_absent"), ("abaqus", "abq_absent")])
def test_a_program_that_is_absent_is_one_line_before_anything_runs(
    tmp_path: Path, engine: str, command: str
) -> None:
    project = project_at(tmp_path / "batch", engine=engine, engine_command=command)
    with pytest.raises(ValueError, match=rf"^model.engine = '{engine}': {command}: not found, .*engine_command") as told:
        run_calibrate(project, Lines())
    assert "\n" not in str(told.value)
    assert project.runs() == []
    with pytest.raises(ValueError, match=f"{command}: not found"):
        run_check(project, Lines())


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"engine": "ansys"}, "'embedded', 'calculix' or 'abaqus'"),
        ({"engine_cpus": 4}, "the embedded engine takes none"),
        ({"engine": "calculix", "engine_memory": "4 GB"}, "CalculiX takes no limit of memory"),
        ({"engine": "abaqus", "engine_memory": "4"}, 'a size such as "4 GB"'),
        ({"engine": "abaqus", "engine_command": "/opt/tools/abaqus"}, "without its folder"),
        ({"engine": "abaqus", "engine_command": "bash"}, "begins with abaqus"),
        ({"engine_timeout_s": 60}, "the embedded engine takes none"),
        ({"engine": "calculix", "engine_timeout_s": 0}, "greater than 0"),
        ({"engine": "abaqus", "engine_cpus": 0}, "greater than or equal to 1"),
    ],
)
def test_keys_of_an_engine_that_cannot_be(keys: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        ModelTable(**keys)  # type: ignore[arg-type]


def test_processors_and_memory_reach_the_command_line() -> None:
    several: tuple[tuple[dict[str, int], int], ...]
    several = ({}, 4), ({"engine_cpus": 2}, 2), ({"engine_jobs": 3}, 3), ({"engine_cpus": 8}, 0)
    with using(Processes(4)):
        for given, most in several:
            together = together_of(ModelTable(engine="calculix", **given))  # type: ignore[arg-type]
            assert (together.__self__.workers if together else 0) == most, given  # type: ignore[attr-defined]
        assert together_of(ModelTable(engine="abaqus")) is None
        assert together_of(ModelTable(engine="abaqus", engine_jobs=2)) is not None
    table = ModelTable(engine="abaqus", engine_cpus=2, engine_memory="4 GB", engine_command="abq2023")
    job, extraction = engine_of(table).commands()  # type: ignore[attr-defined]
    assert job == ["abq2023", "job=job", "input=job.inp", "cpus=2", "domains=2", "memory=4gb", "interactive",
                   "ask_delete=OFF"]  # fmt: skip
    assert extraction[0] == "abq2023"
    assert engine_of(ModelTable(engine="abaqus")) == Abaqus()  # the study's 4 CPUs and 60 % of the memory
    assert engine_of(ModelTable(engine="calculix", engine_cpus=3)) == CalculiX(threads=3)
    assert engine_of(ModelTable(engine="calculix", engine_timeout_s=60)) == CalculiX(timeout_s=60)
