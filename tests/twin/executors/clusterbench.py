"""A real scheduler of dask and its workers on loopback, each a process of its own, for the tests."""

import os
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
WITHIN_S = 120.0  # for a process to start on a busy machine


@dataclass
class ClusterBench:
    """A scheduler and its workers; `file` is what --cluster takes."""

    folder: Path
    settings: Mapping[str, str] = field(default_factory=dict)  # environment of all
    scheduler_words: tuple[str, ...] = ()
    worker_words: tuple[str, ...] = ()
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    @property
    def file(self) -> Path:
        return self.folder / "scheduler.json"

    def start(self) -> "ClusterBench":
        words = ("--no-dashboard", "--scheduler-file", str(self.file), "--host", "127.0.0.1", "--port", "0")
        self._run("scheduler", "distributed.cli.dask_scheduler", *words, *self.scheduler_words)
        deadline = time.monotonic() + WITHIN_S
        while not self.file.is_file():
            assert time.monotonic() < deadline, self.log("scheduler")
            time.sleep(0.05)
        return self

    def worker(self, name: str, *words: str, root: Path = ROOT, **settings: str) -> None:
        """Start a worker of this name with the packages in a folder."""
        words = ("--scheduler-file", str(self.file), "--name", name, "--no-dashboard", *self.worker_words, *words)
        self._run(name, "distributed.cli.dask_worker", *words, PYTHONPATH=str(root), **settings)

    def kill(self, name: str) -> None:
        self.processes[name].kill()
        self.processes.pop(name).wait()

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(encoding="utf-8", errors="replace")

    def end(self) -> None:
        for name in list(self.processes):
            self.kill(name)

    def _run(self, name: str, module: str, *words: str, **settings: str) -> None:
        env = {**os.environ, **ONE_THREAD, **self.settings, **settings}
        with (self.folder / f"{name}.log").open("wb") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, "-m", module, *words], cwd=self.folder, env=env, stdout=log, stderr=log
            )
