"""The command `twin`: one subcommand for each entry of `twin.chain`, with the options that stand here; it
parses, runs the command and prints, and decides nothing."""

import os
import re
import sys
from collections.abc import Callable
from inspect import Parameter, Signature
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer

from twin.chain import COMMANDS, Command, Needs
from twin.console import BAD_INPUT, INTERRUPTED, Console, guarded

app = typer.Typer(
    help="Calibrate the model of a soft finger from the film of an inflation test, and find the physical "
         "effect that it lacks.",
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
LINE = 63  # characters of help beside the name of a command, on 80 columns


def _option(name: str, kind: Any, default: Any, text: str, *flags: str) -> Parameter:
    """An option of a command: `--name`, unless `flags` say how it is typed."""
    return _parameter(name, kind, typer.Option(default, *flags, help=text))


def _flag(name: str, text: str) -> Parameter:
    """An option without a value."""
    return _option(name, bool, False, text, f"--{name}")


def _argument(name: str, kind: Any, default: Any, text: str, typed: str | None = None) -> Parameter:
    """What is typed without a name; `...` as the default: it must be.   typed: how the help shows it."""
    return _parameter(name, kind, typer.Argument(default, help=text, metavar=typed))


def _parameter(name: str, kind: Any, default: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)


PROJECT = _option("project", Path, Path(), "project folder, the one with twin.toml", "--project", "-p")
JSON = _option("json", bool, False, "print the result as one JSON line, text to stderr", "--json")
CLUSTER = _parameter("cluster", str, typer.Option(
    "", metavar="WHERE", envvar="DASK_SCHEDULER_ADDRESS", show_envvar=False,
    help="solve on a cluster: tcp://HOST:8786, scheduler.json, slurm.toml",
))
MADE = _argument("folder", Path, ..., "project folder to make")
NUMBER, NAMES = float | None, list[str]

# The options of every command that has own ones, named as its function names them.
OPTIONS: dict[str, tuple[Parameter, ...]] = {
    "demo": (
        _argument("folder", Path | None, None, "project folder to make; else softtwin-demo, or "
                  "softtwin-quick with --quick"),
        _flag("quick", "8 s of film of a short finger, in place of the full demo"),
    ),
    "init": (
        MADE,
        _option("targets", Path | None, None, "displacements measured elsewhere: file or folder"),
        _option("form", str | None, None, "format of that file: see docs/files.md",
                "--format"),
        _option("nodes", NAMES, [], "point, NAME=node label or NAME=X,Y,Z in mm; repeated", "--node"),
        _option("finger", NAMES, [], "a dimension, such as length_mm=80; once for each"),
        _option("body", str, "finger", "kind, such as pneunet:chambers=4"),
        _option("sd_mm", NUMBER, None, "sd of one position in another program's file, mm"),
        _option("still", str, "", "instead: its rows at rest, 0-60,200-260, or holds"),
        _option("deck", Path | None, None, "your own mesh: Abaqus (mm, N, MPa), Gmsh or VTK"),
        _option("pressure_set", str, "", "of such a mesh: the group of faces under pressure"),
        _option("clamp_set", str, "", "of such a mesh: the group of faces that is held"),
        _option("axes", str, "", "of such a mesh: which are x, y, z: --axes=-x,z,y"),
        _option("unit", str, "", "of such a mesh: its unit of length, such as m; else mm"),
        _option("like", Path | None, None, "project of a former batch on the same rig: "
                "its twin.toml is copied"),
    ),
    "virtual": (
        MADE,
        _option("protocol", str, "P3", "P1 (tip, one ramp) to P5 (three orientations)"),
        _option("hide", NAMES, [], "what the model lacks, NAME or NAME=SIZE; repeated"),
        _option("sigmas", NUMBER, None, "size of what is hidden, in sds of the noise beside the constants"),
        _option("noise_mm", float, 0.015, "noise of a marker's position, 1 sd"),
        _option("noise", str, "white", "white, or ar1: each value resembles the one before"),
        _option("placement_mm", float, 0.1, "distance of a marker from its node, 1 sd"),
        _option("element", str, "C3D20H", "Abaqus element of the truth"),
        _option("body", str, "finger", "kind, such as pneunet:chambers=3"),
        _option("object", str, "", "what it meets: cylinder:d=20,x=50,z=-14"),
        _option("seed", int, 0, "seed of the noise"),
    ),
    "look": (
        _option("at", NAMES, [], "a place x,y,z in mm: the nearest surface node is said and drawn; "
                "once for each"),
    ),
    "print": (_option("paper", str, "a4", "a4, letter or a3"),),
    "pick": (
        _option("names", NAMES, [], "write a numbered feature into twin.toml as a point, "
                "NAME=NUMBER; once for each", "--name"),
        _option("size_mm", NUMBER, None, "side of a feature, mm; 30 px without it"),
        _option("sag_mm", float, 1.0, "how far the finger hangs at rest, mm"),
    ),
    "measure": (
        _flag("replace", "measure again; the targets that are there become targets-0001"),
        _flag("budget", "print what the uncertainty of each marker consists of"),
    ),
    "calibrate": (
        _option("starts", int, 0, "also least squares from so many starts, over all of the bounds, with a "
                "picture of where they end"),
        _option("laws", str, "", "laws of the silicone to fit and compare, between commas such as "
                "yeoh,gent, or all"),
    ),
    "compare": (
        _argument("two", list[Path], [], "two project folders, or two run folders with a fit.json, to lay "
                  "side by side; without them the model of this project and its measurement are compared",
                  "[A B]"),
    ),
    "explain": (
        _argument("name", str, ..., "name of the effect, in the model or not, such as creep", "EFFECT"),
    ),
    "add": (
        _argument("names", NAMES, [], "names of effects, such as creep, added one after the other; without "
                  "a name the one that the diagnosis names", "[EFFECT]..."),
    ),
    "drop": (
        _argument("names", NAMES, ..., "names of effects, such as creep, dropped one after the other",
                  "EFFECT..."),
    ),
    "profile": (
        _argument("names", NAMES, [], "parameters such as C10, C10+C01 or share; without a name all",
                  "[NAME]..."),
    ),
    "posterior": (
        _option("seed", int, 0, "seed of the chain"),
        _option("steps", int, 20000, "steps of each walker at most"),
    ),
    "pareto": (
        _option("objectives", str, "", "what is fitted, between commas: points, U1, U3 or films, or two of "
                "them as tip.U3; by default the points of [calibrate]"),
        _option("seed", int, 1, "seed of the genetic algorithm"),
    ),
    "explore": (
        _option("over", NAMES, [], "what is varied, NAME=LOW:HIGH: a constant in MPa, a parameter of an "
                "effect, or a dimension such as top_wall_mm=1.6:2.4; once for each"),
        _option("design", str, "sobol", "sobol, latin (hypercube) or factorial"),
        _option("runs", int, 32, "number of runs, of a factorial design at most"),
        _option("seed", int, 1, "seed of the design"),
        _option("pressure", str, "", "such as 30kPa; by default the highest of the film"),
        _flag("whole", "solve every run, in place of a response"),
    ),
    "predict": (
        _option("pressure", NAMES, [], "pressure that is held, such as 20kPa; once for each"),
        _option("course", Path | None, None, "pressure log to follow instead, CSV"),
        _option("inverse", NAMES, [], "the pressure that gives a motion, tip.U3=-40 mm"),
        _option("at", NAMES, [], "a point, x=60, or x,y,z in mm; once for each"),
        _option("ramp_s", float, 2.0, "time in which a held pressure is reached, s"),
        _option("hold_s", float, 2.0, "time for which it is held, s"),
        _option("gravity", str, "", "its direction X,Y,Z, if other than in the film"),
        _option("shares", NAMES, [], "of several chambers, what of the pressure one carries, LEFT=1.0"),
        _flag("blocked", "also the force of the finger whose end is kept at its height"),
        _option("object", str, "", "also the force on a rigid object: cylinder:d=40,x=70,z=-30 (mm)"),
    ),
    "export": (
        _argument("form", str, ..., "abaqus or calculix: a deck; json or csv: a table of the response",
                  "FORM"),
        _option("pressure", str, "", "of a deck, such as 20kPa; by default the highest of the film"),
        _option("at", NAMES, [], "of a table: a point, x=60, or x,y,z in mm; once for each"),
        _option("ramp_s", float, 2.0, "time in which the pressure is reached, s"),
        _option("hold_s", float, 2.0, "time for which it is held, s"),
    ),
    "review": (_flag("clip", "also write clip.mp4: film with the model before and after, for a talk"),),
    "batches": (_argument("folder", Path, Path(), "folder whose subfolders are projects, one a batch"),),
}  # fmt: skip


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


def _typed(command: Command) -> Callable[..., None]:
    """The function that the parser takes for a command: its parameters are the command's."""
    own = OPTIONS.get(command.name, ())
    parameters = [*own, *(() if command.needs is Needs.FOLDER else (PROJECT,)),
                  *((CLUSTER,) if command.solves else ()), JSON]  # fmt: skip

    def typed(**given: Any) -> None:
        _run(command, **given)

    typed.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    typed.__annotations__ = {p.name: p.annotation for p in parameters}
    return typed


def _short(title: str) -> str:
    """A title that a line of `twin --help` holds: its first clause where the whole is longer."""
    return title if len(title) <= LINE else re.split(r"[,:]", title)[0] + "."


for _command in COMMANDS:
    app.command(_command.name, help=_command.title, short_help=_short(_command.title))(_typed(_command))


def _run(command: Command, /, *, json: bool, cluster: str = "", **options: Any) -> None:
    """Run a command where it is to solve, and print its result."""
    say = Console(as_json=json)
    if not cluster:
        _run_here(command, say, **options)
        return
    from twin.executors.clusters import on_cluster

    with on_cluster(cluster, say):
        _run_here(command, say, **options)


def _run_here(command: Command, say: Console, /, *, project: Path = Path(), **options: Any) -> None:
    """Run a command on what it needs, and print its result."""
    if command.name == "compare" and (two := options.pop("two")):
        from twin.commands.comparetwo import run_side_by_side

        say.result(run_side_by_side(two, say))
    elif command.needs in (Needs.FOLDER, Needs.ROOT):
        result = command.run(options.pop("folder", project), say, **options)
        say.result(result)
        if result.get("failed"):
            raise typer.Exit(BAD_INPUT)
    elif command.name in ("add", "drop"):  # one after the other: each is a fit of its own
        for name in options["names"] or [None]:
            _on_project(command, project, say, name=name)
    else:
        _on_project(command, project, say, **options)


def _on_project(command: Command, folder: Path, say: Console, /, **options: Any) -> None:
    """Run a command on a project, locked where it writes, and print its result."""
    from twin.project.folder import Project

    project = Project.open(folder)
    if command.needs is Needs.PROJECT:
        say.result(command.run(project, say, **options))
        return
    for sentence in project.remarks:
        say(sentence)
    try:
        with project.lock(command.name):
            result = command.run(project, say, **options)
    finally:
        say.close()
    say.result(result)


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
    sys.exit(guarded(lambda: _parse(arguments), debug="--debug" in arguments))


def _parse(arguments: list[str]) -> None:
    """Parse and run the command; a usage error of the parser keeps its own message and exit code."""
    if not re.fullmatch("0*[1-9][0-9]{0,3}", threads := os.environ.get("OMP_NUM_THREADS") or "1"):
        raise ValueError(f"OMP_NUM_THREADS = {threads!r}: wanted a number of threads, 1 or more; unset it")
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
