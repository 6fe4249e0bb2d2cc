"""The commands of `twin`, once: command line, notebook, demo, `check`, `list`, review, README and CI read
this list. `python -m twin.chain` prints the names."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from typing import Any

TARGETS = "targets/"  # the folder that the stages after `measure` start from
DECK = "deck"  # the files of the user's own mesh
FIT = "fit.json"
MODEL = ("[model]", "[points]", "[calibrate]", "[material_tests]", TARGETS, DECK)  # what a model is made from
FITTED = (*MODEL, FIT)  # what a calibrated model is made from


class Needs(Enum):
    """First argument of a command's function."""

    FOLDER = "the path that it is given"
    ROOT = "the path of --project"
    PROJECT = "the project"
    LOCK = "the project, which no other command may write to meanwhile"


class Group(Enum):
    """The purpose of a command: the headings of `twin --help` and of the table in README."""

    SET_UP = "Set up a project, and keep track of it"
    MEASURE = "Measure"
    CALIBRATE = "Calibrate, and say how sure it is"
    MISSING = "Find what the model lacks"
    USE = "Use the calibrated model"
    BATCHES = "Many batches"


class When(Enum):
    """When a project goes through a stage."""

    ALWAYS = "always"
    NAMED = "where the diagnosis names an effect"
    ASKED = "where the user asks for it"


@dataclass(frozen=True, kw_only=True)
class Command:
    """One command: its name as it is typed, and where its function lies."""

    name: str
    title: str  # what it does, one sentence
    function: str  # "module:function", imported when it runs: the list is cheap
    group: Group
    needs: Needs = Needs.LOCK
    solves: bool = False  # it solves many models, which a cluster may do
    alone: str = ""  # the argument with which it needs no project

    def run(self, of: Any, say: Any, **options: Any) -> dict[str, Any]:
        """Result for --json once the command has run on `of`, its first argument, with its options."""
        result: dict[str, Any] = function_at(self.function)(of, say, **options)
        return result


@dataclass(frozen=True, kw_only=True)
class Stage(Command):
    """A command that makes a run of a project; its name is the kind of its runs."""

    reads: tuple[str, ...]  # "[table]" of twin.toml, TARGETS, DECK, other files of the project or of its runs
    writes: tuple[str, ...]  # files of its run folder, or TARGETS
    when: When = When.ALWAYS
    skips: bool = False  # it knows its inputs and skips what is done

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables of twin.toml that it reads.

        >>> stage_of("profile").tables
        ('model', 'points', 'calibrate', 'material_tests')
        """
        return tuple(name.strip("[]") for name in self.reads if name.startswith("["))


COMMANDS = (
    Command(
        name="demo", title="Run all stages on a recorded demo.",
        group=Group.SET_UP, function="twin.commands.demo:run_demo", needs=Needs.FOLDER, solves=True,
    ),
    Command(
        name="init", title="Make a project folder with a commented twin.toml.",
        group=Group.SET_UP, function="twin.commands.init:run_init", needs=Needs.FOLDER,
    ),
    Command(
        name="setup", title="Make twin.toml from a folder with film, board and log.",
        group=Group.SET_UP, function="twin.commands.setup:run_setup", needs=Needs.FOLDER,
    ),
    Command(
        name="virtual", title="Make a project of a virtual experiment, its truth sealed.",
        group=Group.SET_UP, function="twin.commands.virtual:run_virtual", needs=Needs.FOLDER,
    ),
    Command(
        name="look", title="Draw the finger: dimensions, points, nodes, element shapes.",
        group=Group.SET_UP, function="twin.commands.look:run_look",
    ),
    Command(
        name="print", title="Write board and markers as a PDF at true scale.",
        group=Group.SET_UP, function="twin.commands.print:run_print",
    ),
    Command(
        name="check", title="Check twin.toml and its files, and name the next command.",
        group=Group.SET_UP, function="twin.commands.check:run_check", needs=Needs.PROJECT,
    ),
    Command(
        name="pick", title="Number features that can be followed without markers.",
        group=Group.SET_UP, function="twin.commands.pick:run_pick",
    ),
    Command(
        name="list", title="List the runs of a project and what each found.",
        group=Group.SET_UP, function="twin.commands.list:run_list", needs=Needs.PROJECT,
    ),
    Command(
        name="trust", title="Let a project's own effects run and links be followed.",
        group=Group.SET_UP, function="twin.commands.trust:run_trust", needs=Needs.ROOT,
    ),
    Stage(
        name="camera", title="Calibrate the camera from images of a board.",
        reads=("[cameras]", "raw/boards"), writes=("camera.json", "rig.json"),
        group=Group.MEASURE, function="twin.commands.camera:run_camera", skips=True,
    ),
    Stage(
        name="measure", title="Measure the displacements in the film, with their uncertainty.",
        reads=("[cameras]", "[films]", "[pressure]", "[import]", "[measure]", "[frame]", "[points]", "[dic]",
               "raw/film", "camera.json"),
        writes=(TARGETS, "tracks.npz", "overlay.png", "outline.png", "budget.csv"),
        group=Group.MEASURE, function="twin.commands.measure:run_measure", skips=True,
    ),
    Stage(
        name="calibrate", title="Fit the material constants to the displacements.",
        reads=MODEL,
        writes=(FIT, "generations.npz", "candidates.npz", "prediction.npz", "judged.npz", "comparison.json",
                "starts.png", "material-tests.png"),
        group=Group.CALIBRATE, function="twin.commands.calibrate:run_calibrate", solves=True,
    ),
    Stage(
        name="compare", title="Say where the model and the measurement differ.",
        reads=(*FITTED, "[outline]"),
        writes=("comparison.json", "prediction.npz", "outline.json", "outline.csv", "outline.png"),
        group=Group.CALIBRATE, function="twin.commands.compare:run_compare", solves=True, alone="two",
    ),
    Stage(
        name="profile", title="Say how well each parameter is known, by likelihood profiles.",
        reads=FITTED,
        writes=("profile.json", "profile.csv", "profile.png"),
        group=Group.CALIBRATE, function="twin.commands.profile:run_profile", solves=True, when=When.ASKED,
    ),
    Stage(
        name="posterior", title="Say how likely the parameters are, all together, by a Markov chain.",
        reads=(*FITTED, "profile.json"),
        writes=("posterior.json", "posterior.csv", "posterior.png", "band.csv", "band.png", "chain.npz",
                "solves.npz"),
        group=Group.CALIBRATE, function="twin.commands.posterior:run_posterior", when=When.ASKED,
    ),
    Stage(
        name="pareto", title="Say what fits one marker or film at the cost of another.",
        reads=FITTED,
        writes=("pareto.json", "pareto.csv", "pareto.png"),
        group=Group.CALIBRATE, function="twin.commands.pareto:run_pareto", when=When.ASKED,
    ),
    Stage(
        name="study",
        title="Show what a calibration by two points has found, and what would tell C10 from C01.",
        reads=(*MODEL, "[study]", "candidates.npz"),
        writes=("study.json", "figure-5a.svg", "figure-5b.svg", "figure-5c.svg", "figure-6a.svg",
                "figure-6b.svg", "figure-6c.svg", "figure-6d.svg"),
        group=Group.CALIBRATE, function="twin.commands.study:run_study", solves=True, when=When.ASKED,
    ),
    Stage(
        name="diagnose", title="Name the physical effect that the model lacks.",
        reads=(*FITTED, "[diagnose]"),
        writes=("diagnosis.json", "kept.json", "evidence.json", "evidence.npz", "prediction.npz"),
        group=Group.MISSING, function="twin.commands.diagnose:run_diagnose", solves=True,
    ),
    Stage(
        name="explain", title="Show what speaks for an effect, and where: the evidence for it.",
        reads=(*FITTED, "diagnosis.json"),
        writes=("evidence.json", "evidence.npz"),
        group=Group.MISSING, function="twin.commands.explain:run_explain", solves=True, when=When.ASKED,
    ),
    Stage(
        name="confirm", title="Ask a film that no fit has seen whether the model's effects are in it.",
        reads=FITTED, writes=("confirmation.json",),
        group=Group.MISSING, function="twin.commands.confirm:run_confirm", solves=True, when=When.ASKED,
    ),
    Stage(
        name="add", title="Add an effect to the model, fit again and compare.",
        reads=(*FITTED, "diagnosis.json"),
        writes=(FIT, "comparison.json", "prediction.npz", "judged.npz", "fields.npz"),
        group=Group.MISSING, function="twin.commands.add:run_add", solves=True, when=When.NAMED,
    ),
    Stage(
        name="drop", title="Take an effect out of the model, fit again and compare.",
        reads=FITTED,
        writes=(FIT, "comparison.json", "prediction.npz", "judged.npz", "fields.npz"),
        group=Group.MISSING, function="twin.commands.drop:run_drop", solves=True, when=When.ASKED,
    ),
    Stage(
        name="predict", title="Predict displacements under another pressure, with their intervals.",
        reads=FITTED,
        writes=("predicted.json", "predicted.csv", "predicted.png", "predicted.pvd", "predicted.rrd",
                "contact.csv", "contact.png"),
        group=Group.USE, function="twin.commands.predict:run_predict", solves=True, when=When.ASKED,
    ),
    Stage(
        name="modes", title="Say at which frequencies the finger vibrates, and what moves.",
        reads=FITTED,
        writes=("vibrations.json", "vibrations.csv", "vibrations.png", "vibrations.rrd"),
        group=Group.USE, function="twin.commands.modes:run_modes", when=When.ASKED,
    ),
    Stage(
        name="ringing", title="Say at which frequency and damping a film or file rings.",
        reads=FITTED,
        writes=("ringing.json", "ringing.csv"),
        group=Group.USE, function="twin.commands.ringing:run_ringing", when=When.ASKED, alone="recordings",
    ),
    Stage(
        name="explore", title="Say which constant or dimension bends the finger most.",
        reads=tuple(name for name in FITTED if name != "[points]"),
        writes=("explore.json", "explore.csv", "explore-effects.png"),
        group=Group.USE, function="twin.commands.explore:run_explore", solves=True, when=When.ASKED,
    ),
    Stage(
        name="export", title="Write the calibrated finger as a deck, as a table, or for a simulator.",
        reads=FITTED,
        writes=("finger.inp", "model.json", "response.csv", "card.json", "card.md", "finger.xml", "rod.json",
                "sections.csv", "finger_pyelastica.py", "finger_newton.py"),
        group=Group.USE, function="twin.commands.export:run_export", when=When.ASKED,
    ),
    Stage(
        name="review", title="Write the report, and the film beside the simulation for rerun.",
        reads=(*FITTED, "[project]", "diagnosis.json"),
        writes=("report.html", "review.rrd", "clip.mp4", "deformed.png", "deformed.pvd"),
        group=Group.USE, function="twin.commands.review:run_review", solves=True,
    ),
    Command(
        name="recalibrate", title="Run every stage that is stale; in a folder, all batches.",
        group=Group.BATCHES, function="twin.commands.recalibrateall:run_recalibrate", needs=Needs.ROOT,
        solves=True,
    ),
    Command(
        name="batches", title="Compare all batches of a folder: does the newest differ?",
        group=Group.BATCHES, function="twin.commands.batches:run_batches", needs=Needs.FOLDER,
    ),
)  # fmt: skip
STAGES = tuple(command for command in COMMANDS if isinstance(command, Stage))


def command_of(name: str) -> Command:
    """The command of a name.

    >>> command_of("add").group
    <Group.MISSING: 'Find what the model lacks'>
    """
    return next(command for command in COMMANDS if command.name == name)


def stage_of(name: str) -> Stage:
    """The stage of a name."""
    return next(stage for stage in STAGES if stage.name == name)


def kinds_writing(file: str) -> tuple[str, ...]:
    """Names of the stages that write a file.

    >>> kinds_writing("fit.json")
    ('calibrate', 'add', 'drop')
    """
    return tuple(stage.name for stage in STAGES if file in stage.writes)


def function_at(place: str) -> Callable[..., Any]:
    """The function that "module:function" names."""
    module, _, name = place.partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    return function


if __name__ == "__main__":
    print(*(command.name for command in COMMANDS), sep="\n")
