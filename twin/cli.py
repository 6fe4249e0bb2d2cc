"""The command `twin`: a subcommand for each entry of `twin.chain`, with the options that the signature of its
function states. It parses, runs the command and prints, and decides nothing."""

import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from inspect import Parameter, Signature
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from twin.chain import COMMANDS, Command, Group, Needs, command_of
from twin.console import BAD_INPUT, INTERRUPTED, Console, guarded
from twin.signatures import signature_of

SETTINGS = (".numba_config.yaml", "matplotlibrc")  # which numba and matplotlib read in the current folder
LINE = 63  # characters of help beside the name of a command, on 80 columns
# without the formats of rich, which take a third of a second to load
PLAIN: dict[str, Any] = {
    "add_completion": False, "rich_markup_mode": None, "pretty_exceptions_enable": False,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}  # fmt: skip
HELP = """Calibrate the model of a soft finger from the film of an inflation test, and find the physical
effect that it lacks.

\b
The usual way:
  twin init my-batch               a project: put film, board and log into it
  twin camera, twin measure        displacements in the film, in mm
  twin calibrate, twin compare     the constants; where the model differs
  twin diagnose, twin add          what the model lacks, put into it
  twin predict --pressure 20kPa    motions that nobody has filmed
`twin check` names what is missing and the next command."""

PROJECT = Annotated[Path, typer.Option(
    "--project", "-p", metavar="PATH", help="project folder, the one with twin.toml")]  # fmt: skip
JSON = Annotated[bool, typer.Option("--json", help="print the result as one JSON line, text to stderr")]
CLUSTER = Annotated[str, typer.Option(
    metavar="WHERE", envvar="DASK_SCHEDULER_ADDRESS", show_envvar=False,
    help="solve on a cluster: tcp://HOST:8786, scheduler.json, slurm.toml")]  # fmt: skip


class Parsers(Mapping[str, Any]):
    """The parser of each command, made when it is asked for."""

    def __getitem__(self, name: str) -> Any:
        if name not in list(self):
            raise KeyError(name)
        command, app = command_of(name), typer.Typer(**PLAIN)
        app.command(name, help=command.title)(_typed(command))
        return get_command(app)

    def __iter__(self) -> Iterator[str]:
        return (command.name for command in COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class Commands(TyperGroup):
    """The subcommands; a parser is made for the one that is typed, none for their list."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = Parsers()  # type: ignore[assignment]

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of the commands, in the order of the list."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """A section of the help for each group."""
        for group in Group:
            with formatter.section(group.value):
                formatter.write_dl(
                    [(f"{c.name:<11}", _short(c.title)) for c in COMMANDS if c.group is group]
                )


app = typer.Typer(cls=Commands, help=HELP, no_args_is_help=True, **PLAIN)


def _version(requested: bool) -> None:
    if requested:
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
    parameters = signature_of(command).parser
    if command.needs is not Needs.FOLDER:
        parameters.append(_parameter("project", PROJECT, Path()))
    if command.solves:
        parameters.append(_parameter("cluster", CLUSTER, ""))
    parameters.append(_parameter("json", JSON, False))

    def typed(**options: Any) -> None:
        _run(command, **options)

    typed.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    typed.__annotations__ = {p.name: p.annotation for p in parameters}
    return typed


def _parameter(name: str, kind: Any, default: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def _short(title: str) -> str:
    """A title that a line of `twin --help` holds: its first clause where the whole is longer."""
    return title if len(title) <= LINE else re.split(r"[,:]", title)[0] + "."


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
    if command.alone and options[command.alone]:
        say.result(command.run(None, say, **options))
    elif command.needs in (Needs.FOLDER, Needs.ROOT):
        result = command.run(options.pop("folder", project), say, **options)
        say.result(result)
        if result.get("failed"):
            raise typer.Exit(BAD_INPUT)
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
    for name in filter(os.path.exists, SETTINGS):
        raise ValueError(
            f"{name} lies in this folder, where libraries would take settings from it that can make them run "
            "programs; remove it, or call twin from another folder, with --project"
        )
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
