"""slurm.toml -> jobs of SLURM, each with workers of one thread, by dask-jobqueue."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from twin.executors.surroundings import THREADS
from twin.tablemodel import Positive, TableModel
from twin.validation import checked, tables_of

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster

Count = Annotated[int, Field(ge=1, le=100_000)]


class SlurmTable(TableModel):
    """What slurm.toml says."""

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
def slurm_jobs(table: SlurmTable) -> "Iterator[SLURMCluster]":
    """A scheduler in this process, and the jobs that work for it; they end with the block."""
    from dask_jobqueue import SLURMCluster

    own: dict[str, Any] = {"queue": table.queue, "account": table.account, "interface": table.interface,
                           "python": table.python, "log_directory": table.log_folder}  # fmt: skip
    with SLURMCluster(
        cores=table.workers_per_job, processes=table.workers_per_job, memory=table.memory,
        walltime=table.walltime, job_extra_directives=list(table.directives),
        job_script_prologue=[*(f"export {name}=1" for name in THREADS), *table.before],
        scheduler_options={"dashboard": False, "dashboard_address": ":0"},
        **{name: value for name, value in own.items() if value is not None},
    ) as cluster:  # fmt: skip
        cluster.scale(jobs=table.jobs)
        yield cluster
