"""The program that [model] engine of twin.toml names to solve the model, its version and its jobs."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from fe.engines.abaqus import Abaqus
from fe.engines.calculix import CalculiX
from fe.engines.engine import Program
from twin.calibrated.caches import FolderCache
from twin.executors.local import Processes, Threads, current
from twin.executors.protocol import Executor
from twin.messages import Silent
from twin.model.enginejobs import Done, EngineJobs, Together
from twin.project.config import EMBEDDED, ModelTable
from twin.project.folder import Project

JOBS = "cache/jobs"  # the folder of a project where jobs run


def jobs_of(project: Project) -> EngineJobs | None:
    """The jobs of the program that solves a project's model, None where that is the embedded engine.
    ValueError where the program is not installed."""
    table = project.config.model
    if table.engine == EMBEDDED:
        return None
    engine = engine_of(table)
    try:
        release = engine.release()
    except OSError as error:
        raise ValueError(
            f"model.engine = {table.engine!r}: {error}, or name its command: engine_command under [model] "
            f'of twin.toml; without it take engine = "{EMBEDDED}"'
        ) from None
    cache = FolderCache(project.root / "cache", Silent())  # the search tells how far it is
    together = together_of(table)
    return EngineJobs(engine, release, cache, project.root / JOBS, together)


def together_of(table: ModelTable) -> Together | None:
    """The runner of several jobs at a time; None for one after the other.

    Abaqus runs one by default, as each takes tokens of the licence; CalculiX as many as the executor has
    workers. On this machine threads wait for the program.
    """
    executor = current()
    cpus = table.engine_cpus or 1 if isinstance(executor, Processes) else 1  # a cluster's worker is for one
    room = max(1, executor.workers // cpus)
    most = min(room, table.engine_jobs or (1 if table.engine == "abaqus" else room))
    if most < 2:
        return None
    return Threads(most).ended if isinstance(executor, Processes) else partial(_chunks, executor, most)


def _chunks(executor: Executor, most: int, tasks: Sequence[Callable[[], Done]]) -> Iterator[tuple[int, Done]]:
    """Results of tasks with their numbers; `most`: tasks that run at a time."""
    step = max(len(tasks), 1) if most == executor.workers else most
    for offset in range(0, len(tasks), step):
        yield from ((offset + k, result) for k, result in executor.ended(tasks[offset : offset + step]))


def engine_of(table: ModelTable) -> Program:
    """The program that [model] names, with its processors and memory."""
    options: dict[str, object] = {}
    if table.engine_command is not None:
        options["executable"] = table.engine_command
    if table.engine_timeout_s is not None:
        options["timeout_s"] = table.engine_timeout_s
    if table.engine == "calculix":
        return CalculiX(threads=table.engine_cpus or 1, **options)  # type: ignore[arg-type]
    if table.engine_cpus is not None:
        options["cpus"] = table.engine_cpus
    if table.engine_memory is not None:
        options["memory"] = table.engine_memory.replace(" ", "").lower()
    return Abaqus(**options)  # type: ignore[arg-type]


def check_embedded(project: Project, stage: str) -> None:
    """ValueError for a stage that asks for more than the project's engine gives."""
    engine = project.config.model.engine
    if engine != EMBEDDED:
        raise ValueError(
            f"model.engine = {engine!r}: {stage} asks for derivatives by effects and for finer meshes, which "
            f'the embedded engine alone gives; set engine = "{EMBEDDED}" under [model] of twin.toml and run '
            "twin calibrate again"
        )


def solved_by(project: Project, jobs: EngineJobs | None) -> dict[str, str]:
    """The engine and its release, for fit.json."""
    return {"engine": project.config.model.engine, "release": jobs.release if jobs else ""}
