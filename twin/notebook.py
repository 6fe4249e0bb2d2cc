"""A project folder, opened in a notebook or a script: its stages as methods that return what they found."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin import files
from twin.bench.workbench import Workbench
from twin.chain import Needs, command_of, stage_of
from twin.messages import Lines
from twin.project.folder import Project
from twin.results import StageResult, columns_of, rows_of
from twin.signatures import called_with, signature_of
from twin.targets import Array, Targets

if TYPE_CHECKING:
    from calibrate import Fit
    from twin.model.prediction import Model
    from twin.model.rangedresponse import RangedResponse
    from twin.model.structure import BuiltIn


def _method(name: str) -> Callable[..., StageResult]:
    """The command of a name as a method, with the signature and the docstring of the command's function."""
    command = command_of(name)
    signature = signature_of(command)

    def run(opened: "OpenedProject", /, **options: Any) -> StageResult:
        messages, project = Lines(), opened.project
        with project.lock(name) if command.needs is Needs.LOCK else nullcontext():
            summary = command.run(project, messages, **options)
        last = summary.get("with_effects", summary)  # of calibrate: the fit with effects comes last
        folder = project.root / "runs" / Path(str(last["run"])).name if "run" in last else None
        return _result(name, summary, messages, folder)

    method = called_with(signature.method, run)
    method.__name__, method.__qualname__, method.__module__ = name, f"OpenedProject.{name}", __name__
    options = "\n".join(f"{option}: {text}." for option, text in signature.helps.items())
    table = f"Its table has {columns_of(name)}"
    method.__doc__ = "\n\n".join(filter(None, (command.title, signature.doc, table, options)))
    return method


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
        """The model with these effects, by default the effects of twin.toml; it predicts (s, p, 3) mm,
        without the correction for its mesh, which `predicted` has."""
        return self.bench.model(effects)

    def response(
        self, *, within: Mapping[str, tuple[float, float]] | None = None, solves: int = 8
    ) -> "RangedResponse":
        """Response of the calibrated model at the film's steps to other values of its parameters, each answer
        in milliseconds: `.at({"C10": 0.2})` has `u` and `error` (s, p, 3) mm, 1 sd.

        within: lowest and highest value by a parameter's name; of others 20 % of what was fitted either way,
        or a typical step where that is more. solves: whole solves that it is made of. ValueError without a
        fit that holds, for a range that no parameter has, and where the model has no equilibrium in it.
        """
        from twin.bench.engines import check_embedded
        from twin.model.keptmodel import KeptModel
        from twin.model.rangedresponse import RangedResponse

        check_embedded(self.project, "response")
        bench, theta = self.bench, self.fit.theta
        model = bench.on_mesh(bench.model(), theta, Lines())
        assert isinstance(model, KeptModel)  # as every base model
        return RangedResponse.of(model, theta, within=within, solves=solves)

    def found(self, stage: str) -> StageResult:
        """Result of the newest run of a stage on the present inputs; nothing is run.

        Of "calibrate" it is the fit of the model with the effects that twin.toml has. ValueError where there
        is no such run.
        """
        from twin.bench.fits import fit_file, fresh

        stage_of(stage)
        project = self.project
        path = fit_file(project) if stage == "calibrate" else fresh(project, (stage,))
        if path is None:
            raise ValueError(f"no run of {stage} belongs to this project as it is; run batch.{stage}()")
        summary, messages = files.plain(project.info(path.parent).summary), Lines()
        messages(str(summary.get("headline") or stage))
        return _result(stage, summary, messages, path.parent)

    def recalibrate(self) -> StageResult:
        """Every stage that is stale, none that is fresh; the fitted constants: a row for each."""
        from twin.commands.recalibrate import run_recalibrate

        messages, project = Lines(), self.project
        with project.lock("recalibrate"):
            summary = run_recalibrate(project, messages)
        return _result("recalibrate", summary, messages, self.found("calibrate").folder)

    look = _method("look")
    print = _method("print")
    check = _method("check")
    pick = _method("pick")
    list = _method("list")
    camera = _method("camera")
    measure = _method("measure")
    calibrate = _method("calibrate")
    compare = _method("compare")
    profile = _method("profile")
    posterior = _method("posterior")
    pareto = _method("pareto")
    study = _method("study")
    diagnose = _method("diagnose")
    explain = _method("explain")
    confirm = _method("confirm")
    confirm = _method("confirm")
    add = _method("add")
    drop = _method("drop")
    predict = _method("predict")
    modes = _method("modes")
    ringing = _method("ringing")
    explore = _method("explore")
    export = _method("export")
    review = _method("review")


def _result(stage: str, summary: dict[str, Any], messages: Lines, folder: Path | None) -> StageResult:
    return StageResult(stage, summary, tuple(messages.lines), folder, rows_of(stage, folder, summary))
