"""What a cluster lives through, at length: tasks that end their workers, no memory, no workers, kills at random,
TLS, jobs of SLURM, many tiny tasks."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying
from tests.twin.executors.clusterbench import ONE_THREAD, ROOT, ClusterBench
from tests.twin.executors.order import gathered
from twin.executors.clusters import on_cluster
from twin.executors.daskcluster import Dask
from twin.executors.local import Processes, Serial, current

pytest.importorskip("distributed")
pytestmark = pytest.mark.slow
BARE = ("--nthreads", "1", "--no-nanny", "--memory-limit", "0")
NURSED = ("--nthreads", "1", "--nanny")


@contextmanager
def cluster(folder: Path, *names: str, words: tuple[str, ...] = BARE, deaths: int = 3) -> Iterator[ClusterBench]:
    """A scheduler that gives a task up after so many deaths and one more, and workers of these names."""
    made = ClusterBench(folder, {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(deaths)}, worker_words=words)
    try:
        made.start()
        for name in names:
            made.worker(name)
        yield made
    finally:
        made.end()


def filled(megabytes: int) -> int:
    """Takes so much memory, touched, step by step."""
    kept = []
    for _ in range(megabytes // 20):
        kept.append(np.ones(20 * 2**17))
        time.sleep(0.05)
    return len(kept)


def walked(seed: int, steps: int = 20_000) -> float:
    """A sum whose last bits depend on every step, and that takes a moment."""
    time.sleep(0.05)
    return float(np.cumsum(np.random.default_rng(seed).normal(size=steps))[-1])


def test_a_task_that_ends_its_workers_is_named_after_so_many(tmp_path: Path) -> None:
    with cluster(tmp_path, "one", "two", "three", deaths=1) as bench, on_cluster(str(bench.file), print):
        sentence = r"task 1 of 1 ended every worker that ran it, 2 in all, the last \S+: most likely its memory"
        with pytest.raises(ChildProcessError, match=sentence):
            list(current().ended([partial(os._exit, 1)]))
        assert list(current().ended([partial(pow, 2, 3)])) == [(0, 8)]  # the third worker is there


def test_a_task_without_memory_is_named(tmp_path: Path) -> None:
    words = (*NURSED, "--memory-limit", "500MB")
    with cluster(tmp_path, "one", words=words, deaths=1) as bench, on_cluster(str(bench.file), print):
        with pytest.raises(ChildProcessError, match=r"task 2 of 2 ended every worker .* memory does not suffice"):
            list(current().ended([partial(pow, 2, 3), partial(filled, 2000)]))
        assert list(current().ended([partial(pow, 2, 3)])) == [(0, 8)]  # the nanny has started another


def test_without_a_worker_one_sentence_says_so(tmp_path: Path) -> None:
    with cluster(tmp_path, "only") as bench, on_cluster(str(bench.file), print):
        dask = current()
        assert isinstance(dask, Dask)
        alone = Dask(dask.client, "head", 3.0)
        results = alone.ended([partial(pow, 2, 3), *[partial(time.sleep, 600.0)] * 3])
        assert next(results) == (0, 8)
        bench.kill("only")
        with pytest.raises(ConnectionError, match=saying("3 s", "ADDRESS")):
            next(results)


@pytest.mark.parametrize("seed", range(4))
def test_kills_at_random_change_no_bit(tmp_path: Path, seed: int) -> None:
    """A worker dies and another comes, again and again, at moments that a seed draws; no nanny helps."""
    draw = random.Random(seed)
    tasks = [partial(walked, k) for k in range(60)]
    with cluster(tmp_path, "w0", "w1") as bench, on_cluster(str(bench.file), print):
        found, number, killed = [], 2, 0
        for value in gathered(current(), tasks):
            found.append(value)
            if killed < 3 and draw.random() < 0.15:
                bench.kill(draw.choice([n for n in bench.processes if n != "scheduler"]))
                bench.worker(f"w{number}")
                number, killed = number + 1, killed + 1
    assert killed > 0
    assert found == list(gathered(Serial(), tasks)) == list(gathered(Processes(2), tasks))


CLIENT = """
import sys, time
from functools import partial
from pathlib import Path
import numpy as np
from tests.twin.executors.test_twin_cluster_trials import walked
from twin.calibrated.caches import FolderCache
from twin.executors.clusters import on_cluster
class Say:
    def __call__(self, text, /): print(text)
    def progress(self, stage, done, total, /): print(done, flush=True)
def one(k): return np.array([walked(k)])
if __name__ == "__main__":
    from tests.twin.executors.test_twin_cluster_trials import arrayed
    with on_cluster(sys.argv[1], print):
        FolderCache(Path(sys.argv[2]), Say())("walks", {str(k): partial(arrayed, k) for k in range(40)})
"""


def arrayed(k: int) -> np.ndarray:
    return np.array([walked(k)])


@pytest.mark.parametrize("victim", ["client", "scheduler"])
def test_a_killed_client_or_scheduler_keeps_what_was_made(tmp_path: Path, victim: str) -> None:
    """kill -9 in the middle; then the same again on the other executor gives the bits of one process."""
    script, cache = tmp_path / "client.py", tmp_path / "cache"
    script.write_text(CLIENT, encoding="utf-8")
    env = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(ROOT)}
    with cluster(tmp_path, "w0", "w1") as bench:
        words = [sys.executable, str(script), str(bench.file), str(cache)]
        with subprocess.Popen(words, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as client:
            assert client.stdout is not None
            assert client.stderr is not None
            while client.stdout.readline().strip() != "12":
                assert client.poll() is None, client.stderr.read()
            if victim == "client":
                os.kill(client.pid, signal.SIGKILL)
            else:
                bench.kill("scheduler")
            _, error = client.communicate(timeout=60)
        assert client.returncode != 0
        if victim == "scheduler":
            assert error.splitlines()[-1].startswith("ConnectionError: the scheduler ")
        made = {path.name: path.stat().st_mtime_ns for path in cache.glob("[!.]*.npz")}
        assert 11 <= len(made) < 40  # the twelfth may be under way
        if victim == "client":  # it goes on with the same cluster
            done = subprocess.run(words, env=env, capture_output=True, text=True, timeout=120)
            assert done.returncode == 0, done.stderr
            found = {path.stem: np.load(path)["array"] for path in cache.glob("[!.]*.npz")}
        else:
            from twin.calibrated.caches import FolderCache

            found = FolderCache(cache, Quiet())("walks", {str(k): partial(arrayed, k) for k in range(40)})
    assert {path.name: path.stat().st_mtime_ns for path in cache.glob("[!.]*.npz") if path.name in made} == made
    assert {k: float(v[0]) for k, v in found.items()} == {str(k): walked(k) for k in range(40)}


class Quiet:
    def __call__(self, text: str, /) -> None:
        raise AssertionError(text)

    def progress(self, stage: str, done: int, total: int, /) -> None:
        pass


def test_ten_thousand_tiny_tasks(tmp_path: Path) -> None:
    with cluster(tmp_path, "one", "two") as bench, on_cluster(str(bench.file), print):
        began = time.perf_counter()
        found = list(gathered(current(), [partial(pow, k, 2) for k in range(10_000)]))
        print(f"10 000 tiny tasks in {time.perf_counter() - began:.0f} s")
    assert found == [k * k for k in range(10_000)]


def test_tls_keeps_strangers_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recipe of docs/cluster.md: one authority, one certificate of the cluster, everything else refused."""
    import dask

    words = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=softtwin",
             "-keyout", "key.pem", "-out", "cert.pem"]  # fmt: skip
    subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
    cert, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    files = ("--tls-ca-file", str(cert), "--tls-cert", str(cert), "--tls-key", str(key))
    made = ClusterBench(tmp_path, scheduler_words=("--protocol", "tls", *files), worker_words=(*BARE, *files))
    own = {"tls.ca-file": cert, "tls.client.cert": cert, "tls.client.key": key, "require-encryption": True}
    try:
        made.start()
        made.worker("one")
        with dask.config.set({f"distributed.comm.{name}": str(x) if isinstance(x, Path) else x for name, x in own.items()}), on_cluster(str(made.file), print):  # fmt: skip
            dask_executor = current()
            assert isinstance(dask_executor, Dask)
            assert dask_executor.client.scheduler.address.startswith("tls://127.0.0.1")
            assert list(gathered(dask_executor, [partial(pow, k, 2) for k in range(3)])) == [0, 1, 4]
        address = json.loads(made.file.read_text())["address"]
        monkeypatch.setattr("twin.executors.clusters.CONNECT_S", 3.0)
        plain = address.replace("tls://", "tcp://")
        with pytest.raises(ConnectionError, match=r"no scheduler answers"), on_cluster(plain, print):
            pytest.fail("it connected in the clear")
    finally:
        made.end()


SBATCH = """#!/bin/sh
echo $$ > {folder}/job-$$
sh "$1" > {folder}/job.log 2>&1 &
echo "Submitted batch job $$"
"""


def test_jobs_of_slurm_solve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The programs of SLURM are stood for: sbatch runs its script here, at once."""
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "sbatch").write_text(SBATCH.format(folder=tmp_path), encoding="utf-8")
    (folder / "scancel").write_text("#!/bin/sh\n", encoding="utf-8")
    for program in folder.iterdir():
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.chdir(tmp_path)
    table = 'jobs = 1\nworkers_per_job = 2\nmemory = "2GB"\nbefore = ["echo started"]\ninterface = "lo"\n'
    (tmp_path / "slurm.toml").write_text(table, encoding="utf-8")
    with on_cluster("slurm.toml", print):
        found = list(gathered(current(), [partial(walked, k) for k in range(6)]))
        assert len(list(tmp_path.glob("job-*"))) == 1
    assert found == [walked(k) for k in range(6)]
