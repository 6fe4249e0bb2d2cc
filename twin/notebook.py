"""A project folder, opened in a notebook or a script: its stages as methods that return what they found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin import files
from twin.bench.workbench import Workbench
from twin.chain import COMMANDS, stage_of
from twin.messages import Lines
from twin.project.folder import Project
from twin.results import StageResult, rows_of
from twin.targets import Array, Targets

if TYPE_CHECKING:
    from calibrate import Fit
    from twin.model.answering import RangedResponse
    from twin.model.prediction import Model
    from twin.model.structure import BuiltIn


def open_project(folder: Path | str, *, builtin: "BuiltIn | None" = None) -> "OpenedProject":
    """The project in a folder, with every stage as a method. ValueError where twin.toml is not right.

    builtin: another built-in finger than that of the reference study.
    """
    return OpenedProject(Project.open(folder, builtin=builtin).root, builtin)


@dataclass(frozen=True)
class OpenedProject:
    """A project folder; twin.toml is read again at every use.

    Stages write into the folder as the commands of the same names do, one at a time, and overwrite nothing.
    In a script they belong below `if __name__ == "__main__":`, as other processes help with the work.
    """

    root: Path
    builtin: "BuiltIn | None" = field(default=None, repr=False)

    @property
    def project(self) -> Project:
        """The folder with the configuration of now."""
        return Project.open(self.root, builtin=self.builtin)

    @property
    def targets(self) -> Targets:
        """The measured displacements; `.to_pandas()` has one row for each step and point."""
        return self.project.targets()

    @property
    def fit(self) -> "Fit":
        """The newest fit of the model that twin.toml has. ValueError where there is none that still holds."""
        from twin.bench.fits import newest_fit

        return newest_fit(self.project)

    @property
    def predicted(self) -> Array:
        """Displacements (s, p, 3) mm that the newest fit predicts of the targets, with the mesh's correction.
        ValueError where there is no fit that still holds."""
        from twin.bench.fits import fit_file

        return files.read_npz(fit_file(self.project).with_name("prediction.npz"), "u")["u"]

    @property
    def bench(self) -> Workbench:
        """Targets, structure and model together, for what no stage does."""
        return Workbench.of(self.project)

    def model(self, effects: Sequence[str] | None = None) -> "Model":
        """The model with these effects, by default those of twin.toml; it predicts (s, p, 3) mm, without the
        error of its mesh: `predicted` has that."""
        return self.bench.model(effects)

    def response(
        self, *, within: Mapping[str, tuple[float, float]] | None = None, solves: int = 8
    ) -> "RangedResponse":
        """What the calibrated model shows at the film's steps for other values of its parameters, each answer
        in milliseconds: `.at({"C10": 0.2})` has `u` and `error` (s, p, 3) mm, 1 sd.

        within: lowest and highest value by a parameter's name; of others 20 % of what was fitted either way,
        or a typical step where that is more. solves: whole solves that it is made of. ValueError without a
        fit that holds, for a range that no parameter has, and where the model has no equilibrium in it.
        """
        from twin.bench.engines import check_embedded
        from twin.model.answering import RangedResponse
        from twin.model.memo import KeptModel

        check_embedded(self.project, "response")
        bench, theta = self.bench, self.fit.theta
        model = bench.on_mesh(bench.model(), theta, Lines())
        assert isinstance(model, KeptModel)  # as every base model
        return RangedResponse.of(model, theta, within=within, solves=solves)

    def check(self) -> StageResult:
        """What comes next, as `next` of the summary. ValueError at the first thing that is wrong."""
        from twin.commands.check import run_check

        said = Lines()
        return _result("check", run_check(self.project, said), said, None)

    def list(self) -> StageResult:
        """All runs, oldest first: a row for each."""
        from twin.commands.list import run_list

        said = Lines()
        return _result("list", run_list(self.project, said), said, None)

    def found(self, stage: str) -> StageResult:
        """What the newest run of a stage has found that belongs to the project as it is: nothing is run.

        Of "calibrate" it is the fit of the model with the effects that twin.toml has. ValueError where there
        is no such run.
        """
        from twin.bench.fits import fit_file, fresh

        stage_of(stage)
        project = self.project
        path = fit_file(project) if stage == "calibrate" else fresh(project, (stage,))
        if path is None:
            raise ValueError(f"no run of {stage} belongs to this project as it is; run batch.{stage}()")
        summary, said = files.plain(project.info(path.parent).summary), Lines()
        said(str(summary.get("headline") or stage))
        return _result(stage, summary, said, path.parent)

    def look(self, *, at: Sequence[str] = ()) -> StageResult:
        """Drawings of the finger, its points and node labels: a row for each file."""
        return self._run("look", at=at)

    def recalibrate(self) -> StageResult:
        """Every stage that is stale, none that is fresh; the fitted constants: a row for each."""
        from twin.commands.recalibrate import run_recalibrate

        said, project = Lines(), self.project
        with project.lock("recalibrate"):
            summary = run_recalibrate(project, said)
        return _result("recalibrate", summary, said, self.found("calibrate").folder)

    def camera(self) -> StageResult:
        """The calibrated camera: rms in px."""
        return self._run("camera")

    def measure(self, *, replace: bool = False) -> StageResult:
        """The film's displacements, written to targets/: a row for each marker and source of its error."""
        return self._run("measure", replace=replace)

    def calibrate(self) -> StageResult:
        """The fitted constants: a row for each, with its 95 % interval."""
        return self._run("calibrate")

    def compare(self) -> StageResult:
        """Where model and measurement differ, mm: a row for each marker, direction, pressure, branch."""
        return self._run("compare")

    def diagnose(self) -> StageResult:
        """The missing effect, as `verdict` of the summary: a row for each effect, the best first."""
        return self._run("diagnose")

    def explain(self, effect: str) -> StageResult:
        """What speaks for an effect, mm: a row for each marker and branch."""
        return self._run("explain", name=effect)

    def add(self, effect: str | None = None) -> StageResult:
        """The refit with an effect, by default the one that the diagnosis names: a row for each parameter."""
        return self._run("add", name=effect)

    def drop(self, effect: str) -> StageResult:
        """The refit without an effect: a row for each parameter."""
        return self._run("drop", name=effect)

    def profile(self, *names: str) -> StageResult:
        """How well parameters are known, by likelihood profiles: a row for each name, by default for every
        parameter, C10+C01 and share."""
        return self._run("profile", names=names)

    def posterior(self, *, seed: int = 0, steps: int = 20000) -> StageResult:
        """How likely parameters are, all together, by a Markov chain: a row for every parameter, C10+C01 and
        share. steps: of each walker at most."""
        return self._run("posterior", seed=seed, steps=steps)

    def pareto(self, objectives: str = "", *, seed: int = 1) -> StageResult:
        """What fits one part of the measurement at the cost of another, "tip,middle" or "U1,U3": a row for
        each point of the front that was solved."""
        return self._run("pareto", objectives=objectives, seed=seed)

    def explore(
        self,
        *over: str,
        design: str = "sobol",
        runs: int = 32,
        seed: int = 1,
        pressure: str = "",
        whole: bool = False,
    ) -> StageResult:
        """Bending and highest stretch of the finger over ranges, such as "C10=0.15:0.25" or
        "top_wall_mm=1.6:2.4": a row for each run of the design."""
        asked: dict[str, Any] = {"design": design, "runs": runs, "pressure": pressure, "whole": whole}
        return self._run("explore", over=over, seed=seed, **asked)

    def predict(
        self,
        *pressure: str,
        course: Path | str | None = None,
        at: Sequence[str] = (),
        ramp_s: float = 2.0,
        hold_s: float = 2.0,
        inverse: Sequence[str] = (),
        gravity: str = "",
        blocked: bool = False,
    ) -> StageResult:
        """Displacements that nobody has measured, mm, under pressures such as "20kPa" or along the course of
        a pressure log, or at the pressures that give wanted ones, such as inverse=["tip.U3=-40"]: a row for
        each point and time, with the 95 % interval. The blocked force, N, stands in the summary."""
        log, held = None if course is None else Path(course), {"ramp_s": ramp_s, "hold_s": hold_s}
        asked: dict[str, Any] = {"at": at, "inverse": inverse, "gravity": gravity, "blocked": blocked}
        return self._run("predict", pressure=pressure, course=log, **asked, **held)

    def export(
        self,
        form: str,
        *,
        pressure: str = "",
        at: Sequence[str] = (),
        ramp_s: float = 2.0,
        hold_s: float = 2.0,
    ) -> StageResult:
        """The calibrated finger as "abaqus" or "calculix" deck under a held pressure, or the table of its
        response as "json" or "csv": a row for each file."""
        held = {"ramp_s": ramp_s, "hold_s": hold_s}
        return self._run("export", form=form, pressure=pressure, at=at, **held)

    def study(self) -> StageResult:
        """What a calibration by two points has found: a row for each constant and error."""
        return self._run("study")

    def review(self) -> StageResult:
        """The report and the recording for rerun: a row for each file."""
        return self._run("review")

    def _run(self, stage: str, /, **options: Any) -> StageResult:
        """The result of a stage, run with the project locked."""
        said, project = Lines(), self.project
        command = next(one for one in COMMANDS if one.name == stage)
        with project.lock(stage):
            summary = command.run(project, said, **options)
        last = summary.get("with_effects", summary)  # of calibrate: the fit with effects comes last
        return _result(stage, summary, said, project.root / "runs" / Path(str(last["run"])).name)


def _result(stage: str, summary: dict[str, Any], said: Lines, folder: Path | None) -> StageResult:
    return StageResult(stage, summary, tuple(said.lines), folder, rows_of(stage, folder, summary))
