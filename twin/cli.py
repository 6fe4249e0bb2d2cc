"""The command `twin`: one subcommand a stage; it parses, calls the stage and prints, and decides nothing."""

import os
import re
import sys
from collections.abc import Callable
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer

from twin.chain import STAGES, Stage, stage_of
from twin.console import BAD_INPUT, INTERRUPTED, Console, guarded

app = typer.Typer(
    help="Calibrate the model of a soft finger from the film of an inflation test, and find the physical "
         "effect that it lacks.",
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
)  # fmt: skip

Folder = Annotated[Path, typer.Option("--project", "-p", help="project folder, the one with twin.toml")]
Json = Annotated[
    bool, typer.Option("--json", help="print the result as one line of JSON; all text goes to stderr")
]
HERE = Path()
LINE = 63  # characters of help beside the name of a command, on 80 columns


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"softtwin {version('softtwin')}")
        raise typer.Exit


@app.callback()
def settings(
    debug: Annotated[bool, typer.Option("--debug", help="show the traceback of an error")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="print the version and end", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Options before the subcommand; `main` reads --debug itself."""


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(help="project folder to make")] = Path("softtwin-demo"),
    json: Json = False,
) -> None:
    """Run all stages on the recorded demo."""
    from twin.commands.demo import run_demo

    say = Console(as_json=json)
    say.result(run_demo(folder, say))


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="project folder to make")],
    targets: Annotated[
        Path | None,
        typer.Option(help="displacements measured elsewhere: a folder with targets.csv, or with --format the "
                          "file or folder of another program"),
    ] = None,
    node: Annotated[
        list[str] | None,
        typer.Option(help="a point: its node, NAME=LABEL, or position in mm, NAME=X,Y,Z; once for each"),
    ] = None,
    deck: Annotated[
        Path | None, typer.Option(help="Abaqus deck of your own mesh, in mm, N and MPa")
    ] = None,
    form: Annotated[
        str | None,
        typer.Option("--format", help="format of --targets: deeplabcut, anipose, dice, matchid, c3d or csv"),
    ] = None,
    sd_mm: Annotated[float | None, typer.Option(help="for --format: sd of one position, mm")] = None,
    mm_per_px: Annotated[float | None, typer.Option(help="for --format: size of a pixel, mm")] = None,
    scale_sd: Annotated[float, typer.Option(help="for --format: relative sd of --mm-per-px")] = 0.001,
    axes: Annotated[
        str | None,
        typer.Option(help="for --format: the file's axes that point along the finger, across it and up, "
                          "such as x,0,-y"),
    ] = None,
    fps: Annotated[float | None, typer.Option(help="for --format: frames in a second")] = None,
    log: Annotated[Path | None, typer.Option(help="for --format: pressure log, a CSV file")] = None,
    log_unit: Annotated[
        str | None, typer.Option(help="for --format: unit of the pressure, where its heading has none")
    ] = None,
    start_s: Annotated[
        float, typer.Option(help="for --format: time of the first frame on the clock of the log, s")
    ] = 0.0,
    rest_steps: Annotated[
        int, typer.Option(help="for --format: first steps, at rest, that displacements are relative to")
    ] = 1,
    fixed: Annotated[
        list[str] | None, typer.Option(help="for --format: name of a marker on the rig; once for each")
    ] = None,
    origin_mm: Annotated[
        str | None,
        typer.Option(help="for --format: world x,y,z of the file's origin; points without --node then count "
                          "too, where they lie"),
    ] = None,
    min_likelihood: Annotated[
        float, typer.Option(help="for --format: likelihood below which a point counts as not seen")
    ] = 0.6,
    like: Annotated[
        Path | None, typer.Option(help="project of a former batch on the same rig: its twin.toml is copied")
    ] = None,
    json: Json = False,
) -> None:
    """Make a project folder with a commented twin.toml."""
    from twin.commands.init import run_init
    from twin.inputs.foreign import foreign_of

    say = Console(as_json=json)
    if like is not None:
        from twin.commands.initlike import run_init_like

        if targets or node or deck or form:
            raise ValueError("--like copies points and mesh of the former batch; leave out --targets, "
                             "--format, --node and --deck")  # fmt: skip
        say.result(run_init_like(folder, say, like=like))
        return
    foreign = foreign_of(
        form, sd_mm=sd_mm, mm_per_px=mm_per_px, scale_sd=scale_sd, axes=axes, fps=fps, log=log,
        log_unit=log_unit, start_s=start_s, rest_steps=rest_steps, fixed=fixed, origin_mm=origin_mm,
        min_likelihood=min_likelihood,
    )  # fmt: skip
    say.result(run_init(folder, say, targets=targets, nodes=node or [], deck=deck, foreign=foreign))


@app.command("virtual")
def virtual(
    folder: Annotated[Path, typer.Argument(help="project folder to make")],
    protocol: Annotated[str, typer.Option(help="P1 (tip, one ramp) to P5 (three orientations)")] = "P3",
    hide: Annotated[
        list[str] | None, typer.Option(help="what the model lacks, NAME or NAME=SIZE; again for a pair")
    ] = None,
    sigmas: Annotated[
        float | None, typer.Option(help="size of what is hidden, in sds of the noise beside the constants")
    ] = None,
    noise_mm: Annotated[float, typer.Option(help="noise of a marker's position, 1 sd")] = 0.015,
    noise: Annotated[str, typer.Option(help="white, or ar1: each value resembles the one before")] = "white",
    placement_mm: Annotated[float, typer.Option(help="distance of a marker from its node, 1 sd")] = 0.1,
    element: Annotated[str, typer.Option(help="element type of the truth, an Abaqus name")] = "C3D20H",
    seed: Annotated[int, typer.Option(help="seed of the noise")] = 0,
    json: Json = False,
) -> None:
    """Make a project of a virtual experiment, its truth sealed."""
    from twin.commands.virtual import run_virtual
    from twin.virtual.draws import Setup

    say = Console(as_json=json)
    setup = Setup(sd_mm=noise_mm, noise=noise, placement_sd_mm=placement_mm)
    say.result(run_virtual(folder, say, protocol=protocol, hide=hide or [], sigmas=sigmas, setup=setup,
                           element=element, seed=seed))  # fmt: skip


@app.command("print")
def print_sheets(
    project: Folder = HERE,
    paper: Annotated[str, typer.Option(help="a4, letter or a3")] = "a4",
    json: Json = False,
) -> None:
    """Write board and markers as a PDF at true scale."""
    from twin.commands.print import run_print

    _locked("print", lambda p, say: run_print(p, say, paper=paper), project, json)


@app.command()
def look(
    project: Folder = HERE,
    at: Annotated[
        list[str] | None,
        typer.Option(help="a place x,y,z in mm: the nearest surface node is said and drawn; once for each"),
    ] = None,
    json: Json = False,
) -> None:
    """Draw the finger: dimensions, points, nodes, element shapes."""
    from twin.commands.look import run_look

    _locked("look", lambda p, say: run_look(p, say, at=at or []), project, json)


@app.command()
def pick(
    project: Folder = HERE,
    name: Annotated[
        list[str] | None,
        typer.Option(help="write a numbered feature into twin.toml as a point, NAME=NUMBER; once for each"),
    ] = None,
    size_mm: Annotated[float | None, typer.Option(help="side of a feature, mm; 30 px without it")] = None,
    sag_mm: Annotated[float, typer.Option(help="how far the finger hangs at rest, mm")] = 1.0,
    json: Json = False,
) -> None:
    """Number features that can be followed without markers."""
    from twin.commands.pick import run_pick

    def work(p: Any, say: Any) -> dict[str, Any]:
        return run_pick(p, say, size_mm=size_mm, sag_mm=sag_mm, names=name or [])

    _locked("pick", work, project, json)


def measure(
    project: Folder = HERE,
    replace: Annotated[
        bool, typer.Option("--replace", help="measure again; the targets that are there become targets-0001")
    ] = False,
    budget: Annotated[
        bool, typer.Option("--budget", help="print what the uncertainty of each marker consists of")
    ] = False,
    json: Json = False,
) -> None:
    _run_stage("measure", project, json, replace=replace, budget=budget)


def add(
    effects: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[EFFECT]...",
            help="names of effects, such as creep, added one after the other; without a name the one that "
                 "the diagnosis names",
        ),
    ] = None,
    project: Folder = HERE,
    json: Json = False,
) -> None:
    names: list[str | None] = [*effects] if effects else [None]
    for name in names:
        _run_stage("add", project, json, name=name)


def drop(
    effects: Annotated[
        list[str],
        typer.Argument(
            metavar="EFFECT...", help="names of effects, such as creep, dropped one after the other"
        ),
    ],
    project: Folder = HERE,
    json: Json = False,
) -> None:
    for name in effects:
        _run_stage("drop", project, json, name=name)


def explain(
    effect: Annotated[str, typer.Argument(help="name of the effect, in the model or not, such as creep")],
    project: Folder = HERE,
    json: Json = False,
) -> None:
    _run_stage("explain", project, json, name=effect)


def compare(
    two: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[A B]",
            help="two project folders, or two run folders with a fit.json, to lay side by side; without them "
                 "the model of this project and its measurement are compared",
        ),
    ] = None,
    project: Folder = HERE,
    json: Json = False,
) -> None:
    if not two:
        _run_stage("compare", project, json)
        return
    from twin.commands.comparetwo import run_side_by_side

    say = Console(as_json=json)
    say.result(run_side_by_side(two, say))


def review(
    project: Folder = HERE,
    clip: Annotated[
        bool,
        typer.Option("--clip", help="also write clip.mp4: film with the model before and after, for a talk"),
    ] = False,
    json: Json = False,
) -> None:
    _run_stage("review", project, json, clip=clip)


WITH_OPTIONS: dict[str, Callable[..., None]] = {
    "measure": measure, "explain": explain, "add": add, "drop": drop, "compare": compare,
    "review": review
}  # fmt: skip


def _plain(stage: Stage) -> Callable[..., None]:
    """The command of a stage without options of its own."""

    def command(project: Folder = HERE, json: Json = False) -> None:
        _run_stage(stage.name, project, json)

    return command


def _short(title: str) -> str:
    """A title that a line of `twin --help` holds: its first clause where the whole is longer."""
    return title if len(title) <= LINE else re.split(r"[,:]", title)[0] + "."


for _stage in STAGES:
    _command = app.command(_stage.name, help=_stage.title, short_help=_short(_stage.title))
    _command(WITH_OPTIONS.get(_stage.name) or _plain(_stage))


@app.command()
def recalibrate(project: Folder = HERE, json: Json = False) -> None:
    """Run every stage that is stale; in a folder, all batches."""
    from twin.batches.order import holds_batches
    from twin.commands.recalibrate import run_recalibrate
    from twin.commands.recalibrateall import recalibrate_all

    if not holds_batches(project):
        _locked("recalibrate", run_recalibrate, project, json)
        return
    say = Console(as_json=json)
    result = recalibrate_all(project, say)
    say.result(result)
    if result["failed"]:
        raise typer.Exit(BAD_INPUT)


@app.command()
def batches(
    folder: Annotated[Path, typer.Argument(help="folder whose subfolders are projects, one a batch")] = HERE,
    json: Json = False,
) -> None:
    """Compare all batches of a folder: does the newest differ?"""
    from twin.commands.batches import run_batches

    say = Console(as_json=json)
    say.result(run_batches(folder, say))


@app.command("list")
def list_runs(project: Folder = HERE, json: Json = False) -> None:
    """List the runs of a project and what each found."""
    from twin.commands.list import run_list
    from twin.project.folder import Project

    say = Console(as_json=json)
    say.result(run_list(Project.open(project), say))


@app.command()
def check(project: Folder = HERE, json: Json = False) -> None:
    """Check twin.toml and its files, and name the next command."""
    from twin.commands.check import run_check
    from twin.project.folder import Project

    say = Console(as_json=json)
    say.result(run_check(Project.open(project), say))


@app.command()
def trust(
    files: Annotated[
        list[str] | None, typer.Argument(help="which of its effect files or links; without a name all")
    ] = None,
    project: Folder = HERE,
    json: Json = False,
) -> None:
    """Let a project's own effects run and links be followed."""
    from twin.commands.trust import run_trust

    say = Console(as_json=json)
    say.result(run_trust(project, say, names=files or []))


def main() -> None:
    """Run the command line and exit with its code."""
    arguments = sys.argv[1:]
    # Threads of the numerical libraries that wait for each other cost more than they bring here. Set before
    # any of these libraries is loaded; the own setting of a user holds.
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    for stream in (sys.stdout, sys.stderr):  # a name may hold letters that the terminal does not have
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
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


def _run_stage(stage: str, folder: Path, as_json: bool, /, **options: Any) -> None:
    """Run a stage of the list with the project locked, and print its result."""
    _locked(stage, lambda project, say: stage_of(stage).run(project, say, **options), folder, as_json)


def _locked(
    name: str, work: Callable[[Any, Any], dict[str, Any]], folder: Path, as_json: bool
) -> None:
    """Do something with the project locked, and print its result."""
    from twin.project.folder import Project

    say = Console(as_json=as_json)
    project = Project.open(folder)
    for sentence in project.remarks:
        say(sentence)
    try:
        with project.lock(name):
            result = work(project, say)
    finally:
        say.close()
    say.result(result)
