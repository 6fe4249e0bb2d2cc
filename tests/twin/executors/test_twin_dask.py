"""A cluster of dask on loopback: the bits of this process, workers that die or are of another version, a
scheduler that is killed. Every process is a real one."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from fe import Case
from tests.twin.executors.clusterbench import ClusterBench
from tests.twin.executors.order import gathered
from twin import effort
from twin.calibrated.caches import FolderCache
from twin.effects.ownfiles import own_effects
from twin.effects.protocol import Effect
from twin.executors.clusters import on_cluster
from twin.executors.daskcluster import Dask
from twin.executors.local import Serial, current, using
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.messages import Say
from twin.model.loadpaths import NOTHING, along_path
from twin.targets import Array

pytest.importorskip("distributed")
# a worker without a nanny: one process less; after one death of its workers a task is given up
WORKER = ("--nthreads", "1", "--no-nanny", "--memory-limit", "0")
SETTINGS = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
WIND = """
from calibrate import Parameter
from twin.effects.protocol import Effect, Order
class Fan(Effect):
    name, order = "fan", Order.SUPPORT
    sentence = "a fan blows on the finger"
    parameters = (Parameter("fan.speed", 0.0, 9.0, "m/s", null=0.0),)
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ClusterBench]:
    """A scheduler and two workers."""
    made = ClusterBench(tmp_path_factory.mktemp("cluster"), SETTINGS, worker_words=WORKER)
    try:
        made.start()
        made.worker("one")
        made.worker("two")
        yield made
    finally:
        made.end()


@pytest.fixture(scope="module")
def dask(bench: ClusterBench) -> Iterator[Dask]:
    """The executor that --cluster gives, with both workers."""
    told: list[str] = []
    with on_cluster(str(bench.file), told.append):
        found = current()
        assert isinstance(found, Dask)
        wait_for(found, 2)
        assert told == []  # one machine: one processor
        yield found


def wait_for(dask: Dask, count: int) -> None:
    deadline = time.monotonic() + 120
    while dask.workers != count:
        assert time.monotonic() < deadline, dask.workers
        time.sleep(0.05)


def name_of(e: Effect) -> str:
    return type(e).__name__


def after(path: Path, value: float) -> Array:
    """An array, once a file is there."""
    while not path.exists():
        time.sleep(0.01)
    return np.full(2, value)


def executor_there() -> str:
    return type(current()).__name__


def started(folder: Path, k: int, rest_s: float) -> int:
    """Says who does a task, then takes its time."""
    (folder / f"{k}-{os.getpid()}").touch()
    time.sleep(rest_s)
    return k


def test_a_cluster_gives_the_bits_of_this_process_in_the_order_of_the_tasks(dask: Dask, coarsest_case: Case) -> None:
    reduced, points = np.linspace(0.0, 0.05, 4), coarsest_case.position(4401)[None]
    every = [MOONEY_RIVLIN.at(0.3, (share,)) for share in (0.2, 0.6)]
    tasks = [partial(along_path, coarsest_case, c, 0.3, reduced, points, NOTHING) for c in every]
    alone = list(gathered(Serial(), tasks))
    before = effort.so_far()
    together = list(gathered(dask, tasks))
    assert np.abs(alone[0]).max() > 0.1  # mm
    for a, b in zip(alone, together):
        np.testing.assert_array_equal(a, b)
    assert {kind: s.n for kind, s in effort.since(before).items()} == {effort.PATHS: 2}


def test_a_slow_worker_holds_up_no_other_and_changes_no_order(dask: Dask, tmp_path: Path) -> None:
    """The first task does not end before all others have: its worker is as slow as can be."""
    ended: list[int] = []

    def keep(k: int, _: object) -> None:
        ended.append(k)
        if len(ended) == 20:
            (tmp_path / "go").touch()

    tasks = [partial(after, tmp_path / "go", 0.5), *(partial(pow, k, 2) for k in range(20))]
    first, *others = gathered(dask, tasks, keep=keep)
    np.testing.assert_array_equal(first, [0.5, 0.5])
    assert others == [k * k for k in range(20)]
    assert (sorted(ended), ended[-1]) == (list(range(21)), 0)


def test_workers_have_the_effects_of_a_users_own_file(dask: Dask, tmp_path: Path) -> None:
    (tmp_path / "fan.py").write_text(WIND, encoding="utf-8")
    (fan,) = own_effects(tmp_path, ["fan.py"])
    (tmp_path / "fan.py").unlink()
    assert list(gathered(dask, [partial(name_of, fan)] * 2)) == ["Fan", "Fan"]
    assert list(gathered(dask, [executor_there])) == ["Serial"]  # one that has tasks of its own does them itself


def test_what_a_task_raises_is_raised_and_the_others_are_cancelled(dask: Dask, tmp_path: Path) -> None:
    tasks = [partial(float, "x"), *(partial(started, tmp_path, k, 0.5) for k in range(20))]
    with pytest.raises(ValueError, match="could not convert string to float: 'x'"):
        list(dask.ended(tasks))
    time.sleep(1.5)
    assert len(list(tmp_path.iterdir())) < 10


def test_a_worker_that_dies_gives_its_task_to_another(bench: ClusterBench, dask: Dask, tmp_path: Path) -> None:
    bench.worker("mortal")
    wait_for(dask, 3)
    pid = bench.processes["mortal"].pid
    tasks = [partial(started, tmp_path, k, 0.3) for k in range(12)]
    found = []
    for value in gathered(dask, tasks):
        found.append(value)
        if "mortal" in bench.processes and list(tmp_path.glob(f"*-{pid}")):
            bench.kill("mortal")
    assert found == list(range(12))
    assert "mortal" not in bench.processes  # it had begun one


def test_a_worker_of_another_version_is_refused_by_name(bench: ClusterBench, dask: Dask, tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[3]
    for package in ("vision", "fe", "calibrate", "twin"):
        shutil.copytree(root / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    with (tmp_path / "fe" / "case.py").open("a", encoding="utf-8") as file:
        file.write("# another state\n")
    bench.worker("stranger", root=tmp_path)
    wait_for(dask, 3)
    sentence = r"worker tcp://\S+ \(stranger\) has another state of softtwin's sources \(\w{12}, here \w{12}\); install"
    try:
        with pytest.raises(ConnectionError, match=sentence):
            dask.check()
        # one that came after the check refuses its own tasks
        with pytest.raises(ConnectionError, match=sentence):
            list(dask.ended([partial(time.sleep, 0.1)] * 30))
    finally:
        bench.kill("stranger")
        wait_for(dask, 2)
    assert dask.check() == []


def test_a_killed_scheduler_is_one_sentence_and_what_was_made_is_kept(tmp_path: Path, say: Say) -> None:
    tasks: dict[str, Callable[[], Array]] = {"a": partial(np.full, 2, 0.1)}
    tasks |= {key: partial(after, tmp_path / "go", value) for key, value in (("b", 0.2), ("c", 0.3))}
    bench = ClusterBench(tmp_path, SETTINGS, worker_words=WORKER)
    cache = FolderCache(tmp_path / "cache", say)
    with ExitStack() as stack:
        stack.callback(bench.end)
        bench.start().worker("only")
        stack.enter_context(on_cluster(str(bench.file), print))
        killing = stack.enter_context(_once(tmp_path / "cache" / "a.npz", partial(bench.kill, "scheduler")))
        with pytest.raises(ConnectionError, match=r"the scheduler \S+scheduler.json has ended, .* run the same command"):
            cache("stage", tasks)
        assert killing == ["done"]
        with pytest.raises(ConnectionError, match=r"the scheduler .* has ended"):
            list(current().ended([partial(max, 0, 1)]))
    (tmp_path / "go").touch()
    del tasks["a"]  # it is not made again
    with using(Serial()):
        found = cache("stage", tasks | {"a": partial(np.full, 2, 9.0)})
    np.testing.assert_array_equal([found[k] for k in "abc"], [[0.1, 0.1], [0.2, 0.2], [0.3, 0.3]])


class _once:
    """While the block runs: once a file is there, something is done."""

    def __init__(self, path: Path, act: Callable[[], None]) -> None:
        from threading import Thread

        self.done: list[str] = []
        self._left = False

        def watch() -> None:
            while not path.exists():
                if self._left:
                    return
                time.sleep(0.02)
            self.done.append("done")  # first: who waits may hear of it before the act has come to its end
            act()

        self._thread = Thread(target=watch)

    def __enter__(self) -> list[str]:
        self._thread.start()
        return self.done

    def __exit__(self, *_: object) -> None:
        self._left = True
        self._thread.join()
