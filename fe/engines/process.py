"""Jobs of other programs: run with bounds on time and output, their result files read with care."""

import os
import select
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fe.element import Array
from fe.engines.engine import EngineResult

TIMEOUT_S = 3600.0  # of a job
RELEASE_S = 30.0  # of the question for a program's version
MOST_PRINTED = 2**24  # bytes of a job's output
MOST_RESULT = 2**31  # bytes of its result


@dataclass(frozen=True)
class Output:
    """All that a command printed, its exit code, and why it was stopped, "" where it ended by itself."""

    text: str
    code: int
    stopped: str = ""


def output(
    command: Sequence[str], *, seconds: float, folder: Path | None = None, env: dict[str, str] | None = None
) -> Output:
    """Output of a command, which is killed with all that it started after some seconds, or when it prints
    more than MOST_PRINTED bytes; bytes that are no UTF-8 are replaced.

    >>> output(["echo", "Version 2.20"], seconds=10).text
    'Version 2.20\\n'
    """
    process = subprocess.Popen(
        command, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    assert process.stdout
    printed, end, stopped = bytearray(), time.monotonic() + seconds, ""
    try:
        while not stopped:
            ended = process.poll() is not None
            if select.select([process.stdout], [], [], 0 if ended else 0.2)[0]:
                chunk = os.read(process.stdout.fileno(), 2**16)
                if not chunk:
                    process.wait(max(end - time.monotonic(), 0.01))
                    break
                printed += chunk
            elif ended:
                break
            if time.monotonic() > end:
                stopped = f"not ended after {seconds:g} s, and killed"
            elif len(printed) > MOST_PRINTED:
                stopped = f"killed, as it printed more than {MOST_PRINTED / 2**20:g} MB"
    except subprocess.TimeoutExpired:
        stopped = f"not ended after {seconds:g} s, and killed"
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.stdout.close()
        code = process.wait()
    return Output(printed.decode(errors="replace"), code, stopped)


def release_words(command: Sequence[str]) -> list[list[str]]:
    """Words of the lines in which a program tells its version. TimeoutError where it does not end."""
    told = output(command, seconds=RELEASE_S)
    if told.stopped:
        raise TimeoutError(f"{' '.join(command)}: {told.stopped}; wanted its version")
    return [line.split() for line in told.text.splitlines() if line.split()]


def run_job(text: str, folder: Path | None, solve: Callable[[Path], EngineResult]) -> EngineResult:
    """Result of a job in a folder, by default a temporary one, with its deck as job.inp; failed, with the
    reason, where its result cannot be read."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        folder = folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "job.inp").write_text(text, encoding="utf-8")
        try:
            return solve(folder)
        except ValueError as error:
            return EngineResult.failed(str(error), time.perf_counter() - start)


def result_lines(path: Path) -> list[str]:
    """Lines of a result file, none where it is absent. ValueError for a pipe, a device, or too many bytes."""
    if not path.exists():
        return []
    if not path.is_file() or path.stat().st_size > MOST_RESULT:
        most = f"{MOST_RESULT / 2**30:g} GB"
        raise ValueError(f"{path.name}: wanted a file, no pipe or device, of at most {most}")
    return path.read_text(encoding="utf-8", errors="replace").splitlines()


def numbers(words: Sequence[str]) -> Array:
    """Words of a result as numbers (k,). ValueError for one that is none, such as stars or 1.0-100."""
    try:
        return np.array([float(word) for word in words])
    except ValueError as error:
        raise ValueError(f"its result has a word that is no number ({error})") from None
