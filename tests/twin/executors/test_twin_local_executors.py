"""Work on several processes: every result with its number, errors raised here, and no process left behind."""

import multiprocessing as mp
import operator
import os
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
import psutil
import pytest

from fe import Case, solve
from fe import Path as LoadPath
from tests.twin.executors.order import gathered
from twin.executors.local import WORKERS, Processes, Threads
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.model.loadpaths import NOTHING, along_path


@pytest.mark.parametrize("workers", [1, 2])
def test_every_result_has_its_task_number(workers: int) -> None:
    tasks = [partial(operator.mul, k, k) for k in range(5)]
    assert dict(Processes(workers).ended(tasks)) == {k: k * k for k in range(5)}


def test_one_worker_does_in_turn_what_is_asked_for() -> None:
    done: list[int] = []
    results = Processes(1).ended([partial(done.append, k) for k in range(3)])
    assert next(results) == (0, None)
    assert done == [0]  # the others may still turn out not to be needed
    assert [k for k, _ in results] == [1, 2]


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_task_raises_is_raised(workers: int) -> None:
    with pytest.raises(ValueError, match="could not convert string to float: 'x'"):
        list(Processes(workers).ended([partial(float, "x"), partial(float, "1")]))


def test_threads_wait_for_several_programs_at_a_time() -> None:
    """Each ends only when the other has begun."""
    met = threading.Barrier(2, timeout=60)
    assert sorted(Threads(2).ended([met.wait, met.wait])) in ([(0, 0), (1, 1)], [(0, 1), (1, 0)])
    with pytest.raises(ValueError, match="could not convert string to float: 'x'"):
        list(Threads(2).ended([partial(float, "x"), partial(float, "1")]))
    begun: list[int] = []
    results = Threads(1).ended([partial(begun.append, k) for k in range(100)])
    next(results)
    results.close()
    assert len(begun) < 100  # what has not begun is cancelled


def test_a_listener_who_leaves_ends_the_work() -> None:
    results = Processes(2).ended([partial(time.sleep, 0.0), partial(time.sleep, 600.0)])
    assert next(results) == (0, None)
    results.close()
    deadline = time.monotonic() + 60
    while mp.active_children() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert mp.active_children() == []


def pids() -> tuple[int, set[int]]:
    """This process, and those that do its own tasks."""
    return os.getpid(), {pid for _, pid in Processes(2).ended([os.getpid, os.getpid])}


def test_a_task_that_has_tasks_does_them_itself() -> None:
    found = list(gathered(Processes(2), [pids, pids]))
    assert all(others == {own} for own, others in found)
    assert os.getpid() not in {own for own, _ in found}


def test_an_interrupt_while_workers_start_waits_until_they_have(tmp_path: Path) -> None:
    """Ctrl-C comes just before a worker is told what to do: cut off there, it would answer with a traceback."""
    script = tmp_path / "parent.py"
    script.write_text(
        "import os, signal, threading, time\nfrom multiprocessing import util\n"
        "from functools import partial\nfrom twin.executors.local import Processes\n"
        "honest = util.spawnv_passfds\n"
        "def spawned(*given):\n"
        "    child = honest(*given)\n"
        "    if 'spawn_main' in str(given):\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "        time.sleep(0.1)\n"
        "    return child\n"
        "if __name__ == '__main__':\n"
        "    signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell may have switched off\n"
        "    threading.Thread(target=time.sleep, args=(600,), daemon=True).start()  # a thread that takes it\n"
        "    util.spawnv_passfds = spawned\n"
        "    try:\n"
        "        list(Processes(2).ended([partial(time.sleep, 600)] * 2))\n"
        "    except KeyboardInterrupt:\n"
        "        print('interrupted')\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr, done.returncode) == ("interrupted\n", "", 0)


def test_work_ends_with_a_killed_parent(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        "import time\nfrom functools import partial\nfrom twin.executors.local import Processes\n"
        "if __name__ == '__main__':\n"
        "    for k, _ in Processes(2).ended([partial(time.sleep, 0), partial(time.sleep, 600)]):\n"
        "        print(k, flush=True)\n"
    )
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "0\n"
        children = psutil.Process(parent.pid).children(recursive=True)
        parent.kill()
    assert len(children) >= 2
    assert psutil.wait_procs(children, timeout=60)[1] == []


def test_there_are_as_many_workers_as_processors_allowed() -> None:
    ask = "import os; os.sched_setaffinity(0, {CPU}); from twin.executors.local import WORKERS; print(WORKERS)"
    one = ask.replace("CPU", str(min(os.sched_getaffinity(0))))
    found = subprocess.run([sys.executable, "-c", one], capture_output=True, text=True, check=True, timeout=120)
    assert found.stdout.split() == ["1"]
    assert len(os.sched_getaffinity(0)) == WORKERS


def test_solves_give_the_same_bits_in_any_number_of_processes(coarsest_case: Case) -> None:
    reduced, points = np.linspace(0.0, 0.05, 4), coarsest_case.position(4401)[None]
    every = [MOONEY_RIVLIN.at(0.3, (share,)) for share in (0.2, 0.6)]
    tasks = [partial(along_path, coarsest_case, c, 0.3, reduced, points, NOTHING) for c in every]
    beyond = solve(coarsest_case, LoadPath(np.array([0.0, 1.0]), np.array([0.0, 1.0]), output=np.array([1.0])))
    assert not beyond.converged  # in this process alone; its matrices were not positive definite
    alone, together = (dict(Processes(workers).ended(tasks)) for workers in (1, 2))
    assert np.abs(alone[0]).max() > 0.1  # mm
    for k in range(len(tasks)):
        np.testing.assert_array_equal(alone[k], together[k])
