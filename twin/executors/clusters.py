"""What --cluster says -> the executor: a scheduler's address or file, jobs of SLURM, or nothing."""

import logging
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from twin.executors.chosen import using
from twin.executors.daskcluster import PATIENCE_S, Dask
from twin.executors.slurm import SlurmTable, slurm_jobs

ADDRESS = re.compile(r"(tcp|tls|ucx|ws|wss)://\S+")
WANTED = "tcp://HOST:8786, the scheduler's JSON file, or a slurm.toml (docs/cluster.md)"
CONNECT_S = 15.0  # for which a scheduler may take to answer


@contextmanager
def on_cluster(wanted: str, say: Callable[[str], None]) -> Iterator[None]:
    """What runs in the block solves on a cluster; where `wanted` is empty, on this machine as before.

    ValueError where it names nothing to connect to, or dask is missing. ConnectionError where nobody answers,
    or a worker's results might differ. say: told what the user should know of the workers.
    """
    if not wanted:
        yield
        return
    with ExitStack() as stack:
        table = _table(wanted)
        stack.enter_context(_quiet())
        where: Any
        if table is not None:
            _needed("dask_jobqueue")
            where = stack.enter_context(slurm_jobs(table))
        else:
            where = _address(wanted)
        patience = PATIENCE_S if table is None else 60 * table.patience_min
        executor = Dask(stack.enter_context(_client(where, wanted)), wanted, patience)
        for remark in executor.check():
            say(remark)
        stack.enter_context(using(executor))
        yield


def _table(wanted: str) -> SlurmTable | None:
    """The jobs that are asked for; None where a scheduler is there already."""
    if ADDRESS.fullmatch(wanted):
        return None
    path = Path(wanted)
    if path.suffix not in (".json", ".toml"):
        raise ValueError(f"--cluster {wanted}: wanted {WANTED}")
    if not path.is_file():
        raise ValueError(f"--cluster {wanted}: no such file; wanted {WANTED}")
    return SlurmTable.read(path) if path.suffix == ".toml" else None


def _address(wanted: str) -> str:
    """The address of a scheduler, or that in its file."""
    if ADDRESS.fullmatch(wanted):
        return wanted
    from twin.files import read_json

    found = read_json(Path(wanted))
    address = found.get("address") if isinstance(found, dict) else None
    if not isinstance(address, str):
        raise ValueError(
            f"--cluster {wanted}: no address of a scheduler in it; wanted the file that "
            "`dask scheduler --scheduler-file` writes"
        )
    return address


@contextmanager
def _client(where: Any, wanted: str) -> Iterator[Any]:
    """A client of a scheduler, or of a cluster object."""
    _needed("distributed")
    from distributed import Client

    if isinstance(where, str):
        _check_encryption(where, wanted)
    try:
        client = Client(where, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise ConnectionError(
            f"--cluster {wanted}: no scheduler answers ({' '.join(str(error).split())}); start one with "
            "`dask scheduler`, or leave --cluster out"
        ) from error
    try:
        yield client
    finally:
        client.close(timeout=2)


def _check_encryption(address: str, wanted: str) -> None:
    """ValueError where dask's settings do not fit: a client that fails by them is never closed."""
    from distributed.security import Security

    settings, encrypted = Security().get_connection_args("client"), address.startswith("tls://")
    if encrypted and settings["ssl_context"] is None:
        raise ValueError(
            f"--cluster {wanted}: TLS, but dask's settings have no certificate of the client "
            "(distributed.comm.tls.client); docs/cluster.md says how to make one"
        )
    if settings["require_encryption"] and not encrypted:
        raise ValueError(
            f"--cluster {wanted}: not encrypted, but dask's settings ask for it "
            "(distributed.comm.require-encryption); wanted an address tls://HOST:8786"
        )


def _needed(library: str) -> None:
    from importlib.util import find_spec

    if find_spec(library) is None:
        raise ValueError(
            "--cluster needs dask, which is not installed: run pip install distributed dask-jobqueue"
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """What dask would print of lost connections: one sentence says it, if work was lost."""
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
