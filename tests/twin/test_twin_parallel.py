"""Work on several processes: every result with its number, errors raised here, and no process left behind."""

import multiprocessing as mp
import operator
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import psutil
import pytest

from twin.parallel import finished


@pytest.mark.parametrize("workers", [1, 2])
def test_every_result_has_its_task_number(workers: int) -> None:
    tasks = [partial(operator.mul, k, k) for k in range(5)]
    assert dict(finished(tasks, workers=workers)) == {k: k * k for k in range(5)}


def test_one_worker_does_in_turn_what_is_asked_for() -> None:
    done: list[int] = []
    results = finished([partial(done.append, k) for k in range(3)], workers=1)
    assert next(results) == (0, None)
    assert done == [0]  # the others may still turn out not to be needed
    assert [k for k, _ in results] == [1, 2]


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_task_raises_is_raised(workers: int) -> None:
    with pytest.raises(ValueError, match="could not convert string to float: 'x'"):
        list(finished([partial(float, "x"), partial(float, "1")], workers=workers))


def test_a_listener_who_leaves_ends_the_work() -> None:
    results = finished([partial(time.sleep, 0.0), partial(time.sleep, 600.0)], workers=2)
    assert next(results) == (0, None)
    results.close()
    deadline = time.monotonic() + 60
    while mp.active_children() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert mp.active_children() == []


def test_work_ends_with_a_killed_parent(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        "import time\nfrom functools import partial\nfrom twin.parallel import finished\n"
        "if __name__ == '__main__':\n"
        "    for k, _ in finished([partial(time.sleep, 0), partial(time.sleep, 600)], workers=2):\n"
        "        print(k, flush=True)\n"
    )
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "0\n"
        children = psutil.Process(parent.pid).children(recursive=True)
        parent.kill()
    assert len(children) >= 2
    assert psutil.wait_procs(children, timeout=60)[1] == []
