"""The command `twin`: one subcommand a stage; it parses, calls the stage and prints, and decides nothing."""

import os
import sys
from pathlib import Path
from typing import Annotated, Any, Protocol

import typer

from twin.console import BAD_INPUT, INTERRUPTED, Console, guarded

app = typer.Typer(
    help="From the film of a soft finger's inflation test to a calibrated twin that names its missing "
         "effect.",
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
)  # fmt: skip

Folder = Annotated[Path, typer.Option("--project", "-p", help="project folder (with twin.toml)")]
Json = Annotated[
    bool, typer.Option("--json", help="end with one line of JSON on stdout; text goes to stderr")
]
HERE = Path()


class Stage(Protocol):
    """What runs a stage of an open project."""

    def __call__(self, project: Any, say: Any, /) -> dict[str, Any]: ...


@app.callback()
def settings(
    debug: Annotated[bool, typer.Option("--debug", help="show the traceback of an error")] = False,
) -> None:
    """Options before the subcommand; `main` reads --debug itself."""


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(help="project folder to make")] = Path("softtwin-demo"),
    json: Json = False,
) -> None:
    """Run the whole chain on the recorded demo."""
    from twin.stages.demonstrating import run_demo

    say = Console(as_json=json)
    say.result(run_demo(folder, say))


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="project folder to make")],
    targets: Annotated[Path | None, typer.Option(help="folder with targets.csv, measured elsewhere")] = None,
    node: Annotated[list[str] | None, typer.Option(help="node of a point, NAME=LABEL; repeat it")] = None,
    deck: Annotated[Path | None, typer.Option(help="Abaqus deck of your own mesh (mm, N, MPa)")] = None,
    json: Json = False,
) -> None:
    """Make a project for a film or for targets, of the built-in finger or of your own mesh."""
    from twin.stages.starting import run_init

    say = Console(as_json=json)
    say.result(run_init(folder, say, targets=targets, nodes=node or [], deck=deck))


@app.command("print")
def print_sheets(
    project: Folder = HERE,
    paper: Annotated[str, typer.Option(help="a4, letter or a3")] = "a4",
    json: Json = False,
) -> None:
    """Write a PDF of board and markers at true scale."""
    from twin.stages.printing import run_print

    _stage("print", lambda p, say: run_print(p, say, paper=paper), project, json)


@app.command()
def camera(project: Folder = HERE, json: Json = False) -> None:
    """Calibrate the camera from board images."""
    from twin.stages.cameras import run_camera

    _stage("camera", run_camera, project, json)


@app.command()
def measure(
    project: Folder = HERE,
    replace: Annotated[
        bool, typer.Option("--replace", help="measure anew; keep old targets as targets-0001")
    ] = False,
    budget: Annotated[
        bool, typer.Option("--budget", help="print what each marker's uncertainty is made of")
    ] = False,
    json: Json = False,
) -> None:
    """Measure film and pressure log into targets/."""
    from twin.stages.measuring import run_measure

    _stage("measure", lambda p, say: run_measure(p, say, replace=replace, budget=budget), project, json)


@app.command()
def calibrate(project: Folder = HERE, json: Json = False) -> None:
    """Fit the material to the targets."""
    from twin.stages.chain import run_calibrate

    _stage("calibrate", run_calibrate, project, json)


@app.command()
def compare(project: Folder = HERE, json: Json = False) -> None:
    """Say where model and measurement differ."""
    from twin.stages.chain import run_compare

    _stage("compare", run_compare, project, json)


@app.command()
def diagnose(project: Folder = HERE, json: Json = False) -> None:
    """Name the physical effect that the model lacks."""
    from twin.stages.chain import run_diagnose

    _stage("diagnose", run_diagnose, project, json)


@app.command()
def add(
    effect: Annotated[str, typer.Argument(help="name of the effect, such as creep")],
    project: Folder = HERE,
    json: Json = False,
) -> None:
    """Add an effect to the model, fit again and compare."""
    from twin.stages.chain import run_add

    _stage("add", lambda p, say: run_add(p, effect, say), project, json)


@app.command()
def drop(
    effect: Annotated[str, typer.Argument(help="name of the effect, such as creep")],
    project: Folder = HERE,
    json: Json = False,
) -> None:
    """Take an effect out of the model, fit again and compare."""
    from twin.stages.chain import run_drop

    _stage("drop", lambda p, say: run_drop(p, effect, say), project, json)


@app.command()
def review(project: Folder = HERE, json: Json = False) -> None:
    """Write review.rrd (for rerun) and report.html."""
    from twin.stages.chain import run_review

    _stage("review", run_review, project, json)


@app.command("list")
def list_runs(project: Folder = HERE, json: Json = False) -> None:
    """List the runs of a project."""
    from twin.project.folder import Project
    from twin.stages.starting import run_list

    say = Console(as_json=json)
    say.result(run_list(Project.open(project), stderr=json))


@app.command()
def check(project: Folder = HERE, json: Json = False) -> None:
    """Check the project and say what comes next."""
    from twin.project.folder import Project
    from twin.stages.starting import run_check

    say = Console(as_json=json)
    say.result(run_check(Project.open(project), say))


def main() -> None:
    """Run the command line and exit with its code."""
    arguments = sys.argv[1:]
    # Threads of the numerical libraries that wait for each other cost more than they bring here. Set before
    # any of these libraries is loaded; the own setting of a user holds.
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    sys.exit(guarded(lambda: _run(arguments), debug="--debug" in arguments))


def _run(arguments: list[str]) -> None:
    """Run the command; a usage error of the parser keeps its own message and exit code."""
    try:
        code = app(args=arguments, prog_name="twin", standalone_mode=False)
    except typer.Abort:
        raise KeyboardInterrupt from None  # the same in older versions of the parser
    except Exception as error:
        if not hasattr(error, "show"):  # not one of the parser's, whose class moves between its versions
            raise
        error.show()
        sys.exit(getattr(error, "exit_code", BAD_INPUT))
    if code == INTERRUPTED:
        raise KeyboardInterrupt  # Ctrl-C, which the parser turned into its exit code
    if isinstance(code, int) and code:
        sys.exit(code)


def _stage(name: str, stage: Stage, folder: Path, as_json: bool) -> None:
    """Run a stage with the project locked, and print its result."""
    from twin.project.folder import Project

    say = Console(as_json=as_json)
    project = Project.open(folder)
    try:
        with project.lock(name):
            result = stage(project, say)
    finally:
        say.close()
    say.result(result)
