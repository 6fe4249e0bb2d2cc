"""The value of --cluster -> the executor: a scheduler's address or file, jobs of SLURM, or nothing."""

import asyncio
import logging
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from twin.executors.daskcluster import PATIENCE_S, Dask
from twin.executors.local import using
from twin.executors.surroundings import THREADS
from twin.tablemodel import Positive, TableModel
from twin.validation import checked, tables_of

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster

ADDRESS = re.compile(r"(tcp|tls|ucx|ws|wss)://\S+")
WANTED = "tcp://HOST:8786, the scheduler's JSON file, or a slurm.toml (docs/cluster.md)"
CONNECT_S = 8.0  # for which a scheduler may take to answer


Count = Annotated[int, Field(ge=1, le=100_000)]


class SlurmTable(TableModel):
    """The table of slurm.toml: jobs, their size and their limits."""

    jobs: Count = Field(description="jobs that are asked for")
    workers_per_job: Count = Field(default=1, description="workers, and so processors, of each")
    memory: str = Field(description='of each job, such as "4GB"')
    walltime: str = Field(default="01:00:00", description="after which SLURM ends a job")
    queue: str | None = Field(default=None, description="partition; without it SLURM's own")
    account: str | None = Field(default=None, description="that is charged")
    interface: str | None = Field(default=None, description='network of the workers, such as "ib0"')
    directives: tuple[str, ...] = Field(default=(), description="further lines of #SBATCH")
    before: tuple[str, ...] = Field(default=(), description="lines of the shell before a worker starts")
    python: str | None = Field(default=None, description="of the workers; by default the one of here")
    log_folder: str | None = Field(default=None, description="where the jobs write; by default here")
    patience_min: Positive = Field(default=60.0, description="min, for which jobs are waited for")

    @staticmethod
    def read(path: Path) -> "SlurmTable":
        """The table in a file. ValueError where it is not right."""
        return checked(SlurmTable, tables_of(path.read_bytes(), name=path.name), name=path.name)


@contextmanager
def on_cluster(cluster: str, say: Callable[[str], None]) -> Iterator[None]:
    """Block whose solves run on a cluster; with an empty `cluster` they run on this machine.

    ValueError where it names nothing to connect to, or dask is missing. ConnectionError where nobody answers,
    or a worker's results might differ. say: told what the user should know of the workers.
    """
    if not cluster:
        yield
        return
    with ExitStack() as stack:
        table = _table(cluster)
        stack.enter_context(_quiet())
        where: Any
        if table is not None:
            _needed("dask_jobqueue")
            if shutil.which("sbatch") is None:
                raise ValueError(
                    f"--cluster {cluster}: this computer has no command sbatch, which asks SLURM for jobs; "
                    "run it where jobs are submitted"
                )
            where = stack.enter_context(slurm_jobs(table))
        else:
            where = _address(cluster)
        patience = PATIENCE_S if table is None else 60 * table.patience_min
        executor = Dask(stack.enter_context(_client(where, cluster)), cluster, patience)
        for remark in executor.check():
            say(remark)
        stack.enter_context(using(executor))
        yield


def _table(cluster: str) -> SlurmTable | None:
    """The SLURM jobs of a slurm.toml; None for the address or file of a running scheduler."""
    if ADDRESS.fullmatch(cluster):
        return None
    path = Path(cluster)
    if path.suffix not in (".json", ".toml"):
        raise ValueError(f"--cluster {cluster}: wanted {WANTED}")
    if not path.is_file():
        raise ValueError(f"--cluster {cluster}: no such file; wanted {WANTED}")
    return SlurmTable.read(path) if path.suffix == ".toml" else None


def _address(cluster: str) -> str:
    """The address of a scheduler, read from its JSON file where that is named."""
    if ADDRESS.fullmatch(cluster):
        return cluster
    from twin.files import read_json

    content = read_json(Path(cluster))
    address = content.get("address") if isinstance(content, dict) else None
    if not isinstance(address, str):
        raise ValueError(
            f"--cluster {cluster}: no address of a scheduler in it; wanted the file that "
            "`dask scheduler --scheduler-file` writes"
        )
    return address


@contextmanager
def _client(where: Any, cluster: str) -> Iterator[Any]:
    """A client of a scheduler, or of a cluster object."""
    _needed("distributed")
    from distributed import Client

    if isinstance(where, str):
        _check_answers(where, cluster)
    client = Client(where, timeout=CONNECT_S, set_as_default=False)
    try:
        yield client
    finally:
        client.close(timeout=2)


def _check_answers(address: str, cluster: str) -> None:
    """ValueError where dask's settings do not fit, ConnectionError where no scheduler answers at an address:
    a client that fails by either is never closed, and may wait for ever."""
    from distributed.security import Security

    settings, encrypted = Security().get_connection_args("client"), address.startswith("tls://")
    if encrypted and settings["ssl_context"] is None:
        raise ValueError(
            f"--cluster {cluster}: TLS, but dask's settings have no certificate of the client "
            "(distributed.comm.tls.client); docs/cluster.md says how to make one"
        )
    if settings["require_encryption"] and not encrypted:
        raise ValueError(
            f"--cluster {cluster}: not encrypted, but dask's settings ask for it "
            "(distributed.comm.require-encryption); wanted an address tls://HOST:8786"
        )
    try:
        with ThreadPoolExecutor(1) as thread:  # a notebook has a loop of its own
            thread.submit(asyncio.run, _greeted(address, settings)).result()
    except Exception as error:
        why = " ".join(str(error).split()) or f"nothing is said within {1.25 * CONNECT_S:g} s"
        if not isinstance(error, OSError | ValueError | ImportError):
            why = "another program answers there"
        raise ConnectionError(
            f"--cluster {cluster}: no scheduler answers ({why}); start one with `dask scheduler`, or leave "
            "--cluster out"
        ) from error


async def _greeted(address: str, settings: dict[str, Any]) -> None:
    """Nothing, once a scheduler has answered the greeting of a client."""
    from distributed.comm import connect

    talk = await asyncio.wait_for(connect(address, timeout=CONNECT_S, **settings), 1.25 * CONNECT_S)
    talk.abort()


def _needed(library: str) -> None:
    from importlib.util import find_spec

    if find_spec(library) is None:
        raise ValueError(
            "--cluster needs dask, which is not installed: run pip install distributed dask-jobqueue"
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """Block without dask's messages on lost connections: one error says it where work was lost."""
    _needed("distributed")
    import distributed  # noqa: F401  it gives its loggers levels of their own

    every = [n for n in logging.root.manager.loggerDict if n.split(".")[0] == "distributed"]
    before = {logger: logger.level for logger in map(logging.getLogger, every)}
    for logger in before:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in before.items():
            logger.setLevel(level)


# -- jobs of SLURM -------------------------------------------------------------------------------------------


@contextmanager
def slurm_jobs(table: SlurmTable) -> "Iterator[SLURMCluster]":
    """A scheduler in this process, and the jobs that work for it; they end with the block."""
    from dask_jobqueue import SLURMCluster

    options: dict[str, Any] = {"queue": table.queue, "account": table.account, "interface": table.interface,
                           "python": table.python, "log_directory": table.log_folder}  # fmt: skip
    with SLURMCluster(
        cores=table.workers_per_job, processes=table.workers_per_job, memory=table.memory,
        walltime=table.walltime, job_extra_directives=list(table.directives),
        job_script_prologue=[*(f"export {name}=1" for name in THREADS), *table.before],
        scheduler_options={"dashboard": False, "dashboard_address": ":0"},
        **{name: value for name, value in options.items() if value is not None},
    ) as cluster:  # fmt: skip
        _check_jobs(cluster.job_script())
        cluster.scale(jobs=table.jobs)
        yield cluster


def _check_jobs(script: str) -> None:
    """ConnectionError where SLURM takes no job with this script: dask would wait for it all the same."""
    test: dict[str, Any] = {"input": script, "capture_output": True, "text": True, "timeout": CONNECT_S}
    try:
        subprocess.run(["sbatch", "--test-only"], check=True, **test)
    except (OSError, subprocess.SubprocessError) as error:
        why = " ".join((getattr(error, "stderr", None) or str(error)).split())
        raise ConnectionError(f"SLURM takes no such job ({why}); correct slurm.toml") from None
