"""The stages of `twin` in the order of a project: one list, which the command line, the demo, `check`, `list`
and the review read."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the command line reads this list before it knows whether it needs a project
    from twin.project.folder import Project, Say

TARGETS = "targets/"  # the folder that the stages after `measure` start from
DECK = "deck"  # the files of the user's own mesh
FIT = "fit.json"


class When(Enum):
    """When a project goes through a stage."""

    ALWAYS = "always"
    NAMED = "where the diagnosis names an effect"
    ASKED = "where the user asks for it"


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One stage: its command, what it reads and writes, and where its function lies."""

    name: str  # the command, and the kind of its runs
    title: str  # what it does, one sentence
    reads: tuple[str, ...]  # "[table]" of twin.toml, TARGETS, DECK, other files of the project or of its runs
    writes: tuple[str, ...]  # files of its run folder, or TARGETS
    function: str  # "module:function", imported when it runs: the list is cheap
    when: When = When.ALWAYS
    skips: bool = False  # it knows its inputs and skips what is done

    def run(self, project: "Project", say: "Say", **options: Any) -> dict[str, Any]:
        """What --json prints, once the stage has run; `options` are those of its command."""
        result: dict[str, Any] = function_at(self.function)(project, say, **options)
        return result

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables of twin.toml that it reads."""
        return tuple(name.strip("[]") for name in self.reads if name.startswith("["))


STAGES = (
    Stage(
        name="camera", title="Calibrate the camera from images of a board.",
        reads=("[cameras]", "raw/boards"), writes=("camera.json", "rig.json"),
        function="twin.commands.camera:run_camera", skips=True,
    ),
    Stage(
        name="measure", title="Measure the displacements in the film, with their uncertainty.",
        reads=("[cameras]", "[films]", "[pressure]", "[measure]", "[frame]", "[points]", "[dic]", "raw/film",
               "camera.json"),
        writes=(TARGETS, "tracks.npz", "overlay.png", "budget.csv"),
        function="twin.commands.measure:run_measure", skips=True,
    ),
    Stage(
        name="calibrate", title="Fit the material constants to the displacements.",
        reads=("[model]", "[points]", "[calibrate]", TARGETS, DECK),
        writes=(FIT, "generations.npz", "candidates.npz", "prediction.npz", "judged.npz", "comparison.json"),
        function="twin.commands.calibrate:run_calibrate",
    ),
    Stage(
        name="compare", title="Say where the model and the measurement differ.",
        reads=("[model]", "[points]", "[calibrate]", TARGETS, DECK, FIT),
        writes=("comparison.json", "prediction.npz"),
        function="twin.commands.compare:run_compare",
    ),
    Stage(
        name="diagnose", title="Name the physical effect that the model lacks.",
        reads=("[model]", "[points]", "[calibrate]", "[diagnose]", TARGETS, DECK, FIT),
        writes=("diagnosis.json", "kept.json", "evidence.json", "evidence.npz", "prediction.npz"),
        function="twin.commands.diagnose:run_diagnose",
    ),
    Stage(
        name="explain", title="Show what speaks for an effect, and where: the evidence for it.",
        reads=("[model]", "[points]", "[calibrate]", TARGETS, DECK, FIT, "diagnosis.json"),
        writes=("evidence.json", "evidence.npz"),
        function="twin.commands.explain:run_explain", when=When.ASKED,
    ),
    Stage(
        name="add", title="Add an effect to the model, fit again and compare.",
        reads=("[model]", "[points]", "[calibrate]", TARGETS, DECK, FIT, "diagnosis.json"),
        writes=(FIT, "comparison.json", "prediction.npz", "judged.npz", "fields.npz"),
        function="twin.commands.add:run_add", when=When.NAMED,
    ),
    Stage(
        name="drop", title="Take an effect out of the model, fit again and compare.",
        reads=("[model]", "[points]", "[calibrate]", TARGETS, DECK, FIT),
        writes=(FIT, "comparison.json", "prediction.npz", "judged.npz", "fields.npz"),
        function="twin.commands.drop:run_drop", when=When.ASKED,
    ),
    Stage(
        name="study",
        title="Show what a calibration by two points has found, and what would tell C10 from C01.",
        reads=("[model]", "[points]", "[calibrate]", "[study]", TARGETS, DECK, "candidates.npz"),
        writes=("study.json", "figure-5a.svg", "figure-5b.svg", "figure-5c.svg", "figure-6a.svg",
                "figure-6b.svg", "figure-6c.svg", "figure-6d.svg"),
        function="twin.commands.study:run_study", when=When.ASKED,
    ),
    Stage(
        name="review", title="Write the report, and the film beside the simulation for rerun.",
        reads=("[project]", "[model]", "[points]", "[calibrate]", TARGETS, DECK, FIT, "diagnosis.json"),
        writes=("report.html", "review.rrd", "clip.mp4", "deformed.png", "deformed.pvd"),
        function="twin.commands.review:run_review",
    ),
)  # fmt: skip


def stage_of(name: str) -> Stage:
    """The stage of a name."""
    return next(stage for stage in STAGES if stage.name == name)


def kinds_writing(file: str) -> tuple[str, ...]:
    """Names of the stages that write a file."""
    return tuple(stage.name for stage in STAGES if file in stage.writes)


def function_at(place: str) -> Callable[..., Any]:
    """The function that "module:function" names."""
    module, _, name = place.partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    return function
