"""What --cluster takes and refuses, jobs of SLURM by their script, and which worker may not help. No cluster is
started."""

import re
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextvars import Context
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.twin.executors.order import gathered
from twin.executors import clusters, daskcluster
from twin.executors.clusters import SlurmTable, on_cluster, slurm_jobs
from twin.executors.daskcluster import Dask
from twin.executors.local import LOCAL, Processes, Serial, Threads, current, using
from twin.executors.protocol import Task
from twin.executors.surroundings import Surroundings

HERE = replace(Surroundings.here(), threads=(("OMP_NUM_THREADS", "1"),))


@dataclass(frozen=True)
class Backwards:
    """An executor whose tasks end in the opposite order."""

    workers: int = 1

    def ended(self, tasks: Sequence[Task], /) -> Iterator[tuple[int, Any]]:
        yield from ((k, tasks[k]()) for k in reversed(range(len(tasks))))


def test_results_come_in_the_order_of_the_tasks_and_are_kept_as_they_end() -> None:
    ended: list[int] = []
    found = list(gathered(Backwards(), [partial(pow, k, 2) for k in range(4)], keep=lambda k, _: ended.append(k)))
    assert (found, ended) == ([0, 1, 4, 9], [3, 2, 1, 0])


def test_an_executor_holds_for_its_block() -> None:
    assert Context().run(current) == LOCAL == Processes()
    outside = current()
    with using(Threads(2)):
        assert current() == Threads(2)
    with pytest.raises(ZeroDivisionError), using(Threads(2)):
        next(Serial().ended([partial(divmod, 1, 0)]))
    assert current() == outside


@pytest.mark.parametrize(
    ("wanted", "sentence"),
    [
        ("head:8786", r"--cluster head:8786: wanted tcp://HOST:8786, the scheduler's JSON file, or a slurm\.toml"),
        ("absent.json", r"--cluster absent\.json: no such file; wanted tcp://HOST:8786"),
        ("other.json", r"--cluster other\.json: no address of a scheduler in it; wanted the file that `dask sch"),
        ("jobs.toml", r"^jobs\.toml: memory is missing \(of each job, such as \"4GB\"\); add it"),
        ("more.toml", r"^more\.toml: job is not a known key; did you mean 'jobs'\?"),
        ("none.toml", r"^none\.toml: jobs = 0: it should be greater than or equal to 1"),
        ("torn.toml", r"^torn\.toml: not valid TOML: "),
    ],
)
def test_what_is_no_cluster_is_one_sentence(
    wanted: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("other.json").write_text('{"workers": {}}', encoding="utf-8")
    Path("jobs.toml").write_text("jobs = 2\n", encoding="utf-8")
    Path("more.toml").write_text('jobs = 2\nmemory = "4GB"\njob = 3\n', encoding="utf-8")
    Path("none.toml").write_text('jobs = 0\nmemory = "4GB"\n', encoding="utf-8")
    Path("torn.toml").write_text("jobs = \n", encoding="utf-8")
    with pytest.raises(ValueError, match=sentence), on_cluster(wanted, print):
        pytest.fail("it connected")


def said(port: socket.socket, answer: bytes) -> None:
    """Who calls hears an answer, and nothing more."""
    with port.accept()[0] as call:
        call.sendall(answer)
        call.settimeout(5.0)
        while call.recv(1000):
            pass


@pytest.mark.parametrize(("answer", "told"), [
    (None, "Timed out"), (b"", "nothing is said within"), (b"HTTP/1.0 400 Bad request\r\n\r\n", ""),
])  # fmt: skip
def test_a_port_without_a_scheduler_is_one_sentence(answer: bytes | None, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(clusters, "CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as port:
        address = f"tcp://127.0.0.1:{port.getsockname()[1]}"
        other = threading.Thread(target=said, args=(port, answer or b""))
        if answer is None:
            port.close()
        else:
            other.start()
        sentence = rf"--cluster {address}: no scheduler answers \(.*{told}.*\); start one with `dask scheduler`"
        begin = time.monotonic()
        with pytest.raises(ConnectionError, match=sentence) as caught, on_cluster(address, print):
            pytest.fail("it connected")
        if answer is not None:
            other.join()
    assert "\n" not in str(caught.value)
    assert time.monotonic() - begin < 10.0


def sbatch(folder: Path, monkeypatch: pytest.MonkeyPatch, does: str) -> None:
    """A command sbatch, and no other."""
    (folder / "bin").mkdir()
    (folder / "bin" / "sbatch").write_text(f"#!/bin/sh\n{does}\n", encoding="utf-8")
    (folder / "bin" / "sbatch").chmod(0o700)
    monkeypatch.setenv("PATH", str(folder / "bin"))


def test_slurm_that_is_absent_or_refuses_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue")
    monkeypatch.chdir(tmp_path)
    Path("slurm.toml").write_text('jobs = 2\nmemory = "4GB"\n', encoding="utf-8")
    sbatch(tmp_path, monkeypatch, "echo 'invalid partition' >&2; exit 1")
    with pytest.raises(ConnectionError, match=r"SLURM takes no such job \(invalid partition\)"), on_cluster("slurm.toml", print):
        pytest.fail("it began")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ValueError, match=r"slurm\.toml: this computer has no command sbatch"), on_cluster("slurm.toml", print):
        pytest.fail("it began")


@pytest.mark.parametrize(
    ("address", "asked", "sentence"),
    [
        ("tls://127.0.0.1:1", False, r"--cluster tls://127\.0\.0\.1:1: TLS, but dask's settings have no certificate"),
        ("tcp://127.0.0.1:1", True, r"--cluster tcp://127\.0\.0\.1:1: not encrypted, but dask's settings ask for it"),
    ],
)
def test_settings_of_dask_that_do_not_fit_the_address_are_named(address: str, asked: bool, sentence: str) -> None:
    dask = pytest.importorskip("dask")
    pytest.importorskip("distributed")
    with (
        dask.config.set({"distributed.comm.require-encryption": asked}),
        pytest.raises(ValueError, match=sentence),
        on_cluster(address, print),
    ):
        pytest.fail("it connected")


def test_without_dask_the_way_out_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install distributed dask-jobqueue"), on_cluster("tcp://head:1", print):
        pytest.fail("it connected")


def version(name: str, value: str) -> Surroundings:
    return replace(HERE, versions=tuple((n, value if n == name else v) for n, v in HERE.versions))


@pytest.mark.parametrize(
    ("seen", "threads", "sentence"),
    [
        (HERE, 1, ""),
        (replace(HERE, processor=("another",)), 1, ""),  # told, not refused
        (version("python", "3.10.0"), 1, "worker w1 has python 3.10.0, here "),
        (version("numpy", "1.0"), 1, "worker w1 has numpy 1.0, here "),
        (version("mkl", "none"), 1, "worker w1 has mkl none, here "),
        (replace(HERE, versions=HERE.versions[:3]), 1, "worker w1 has numpy none, here "),
        (version("softtwin", "0.0.1"), 1, "worker w1 has softtwin 0.0.1, here "),
        (replace(HERE, sources="0123"), 1, "worker w1 has another state of softtwin's sources (0123, here "),
        (HERE, 4, "worker w1 has 4 threads, wanted 1"),
        (replace(HERE, threads=(("OMP_NUM_THREADS", "8"),)), 1, "worker w1 has OMP_NUM_THREADS = 8, wanted 1"),
        (replace(HERE, threads=(("MKL_NUM_THREADS", "not set"),)), 1, "worker w1 has MKL_NUM_THREADS = not set"),
    ],
)
def test_a_worker_whose_last_bit_may_differ_is_refused(seen: Surroundings, threads: int, sentence: str) -> None:
    refused = daskcluster._Seen("w1", threads, seen).refused(HERE)
    assert refused.startswith(sentence)
    assert bool(refused) == bool(sentence)


@dataclass
class FewWorkers:
    """Stands for a client of dask whose workers say what is given."""

    seen: dict[str, Any]
    status: str = "running"

    def nthreads(self) -> dict[str, Any]:
        return self.seen

    def run(self, function: object, *, on_error: str) -> dict[str, Any]:
        assert on_error == "return"
        return self.seen


def test_another_processor_is_told_and_a_worker_without_softtwin_is_refused() -> None:
    pytest.importorskip("distributed")
    here = daskcluster._Seen("tcp://b:2", 1, replace(HERE, threads=()))
    client: Any = FewWorkers({"tcp://b:2": here})
    assert Dask(client, "head").check() == []
    other = replace(here, name="tcp://a:1", of=replace(here.of, processor=("AVX",)))
    client = FewWorkers({"tcp://a:1": other, "tcp://b:2": here})
    assert Dask(client, "head").check() == [
        "Another processor than here on tcp://a:1: results may differ from those of this computer in the last digits."
    ]
    client = FewWorkers({"tcp://c:3": ModuleNotFoundError("No module named 'twin'")})
    with pytest.raises(ConnectionError, match=r"worker tcp://c:3 cannot load this version of softtwin \(ModuleNotF"):
        Dask(client, "head").check()
    with pytest.raises(ConnectionError, match=r"no worker at head for 0\.01 s; start some with `dask worker"):
        Dask(FewWorkers({}), "head", 0.01).check()  # type: ignore[arg-type]



def test_jobs_of_slurm_have_workers_of_one_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue")
    file = tmp_path / "slurm.toml"
    file.write_text(
        'jobs = 3\nworkers_per_job = 4\nmemory = "8GB"\nqueue = "short"\naccount = "soft"\n'
        'directives = ["--exclusive"]\nbefore = ["module load python"]\npython = "/opt/twin/bin/python"\n',
        encoding="utf-8",
    )
    sbatch(tmp_path, monkeypatch, "exit 0")
    with slurm_jobs(replace_jobs(SlurmTable.read(file))) as cluster:
        script = cluster.job_script()
    lines = script.splitlines()
    for line in ("#SBATCH -p short", "#SBATCH -A soft", "#SBATCH --cpus-per-task=4", "#SBATCH --mem=8G",
                 "#SBATCH -t 01:00:00", "#SBATCH --exclusive", "export OMP_NUM_THREADS=1", "module load python"):  # fmt: skip
        assert line in lines, script
    assert lines[-1].startswith("/opt/twin/bin/python -m distributed.cli.dask_worker tcp://")
    assert {"--nthreads 1", "--nworkers 4", "--nanny"} <= {f"--{word.strip()}" for word in lines[-1].split("--")}


def test_the_docs_have_every_key_of_slurm_toml(tmp_path: Path) -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "cluster.md").read_text(encoding="utf-8")
    (piece,) = re.findall(r"^`slurm\.toml`:\n\n```toml\n(.*?)^```$", page, re.S | re.M)
    (tmp_path / "slurm.toml").write_text(piece, encoding="utf-8")
    assert SlurmTable.read(tmp_path / "slurm.toml").jobs == 20
    table = page.partition("## SLURM")[2].partition("## TLS")[0]
    named = {name for row in re.findall(r"^\| (`.*?) \|", table, re.M) for name in re.findall(r"`(\w+)`", row)}
    assert named == set(SlurmTable.model_fields)


def replace_jobs(table: SlurmTable) -> SlurmTable:
    """The table without a job: nothing is submitted."""
    return table.model_copy(update={"jobs": 0})
