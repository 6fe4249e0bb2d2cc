"""Cases and a pressure -> displacements by jobs of another program, each made once.

A job is a deck: its text is the key under which what it gave is stored. A job runs in a folder of its own,
which is kept where it failed, with deck, log and result files, and else removed.
"""

import platform
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix

from fe import Case
from fe.case import digest
from fe.engines.engine import LEAST, EngineResult, Program, over_pressure
from fe.mesh.points import interpolation
from twin import effort
from twin.effects.protocol import Unsolvable
from twin.model.arraycache import ArrayCache, code_digest, rounded_up
from twin.targets import Array

JOBS = "engine jobs"
LEVELS = 12  # pressures at least at which a job writes displacements
REACHED = 1e-6  # relative, by which the last increment may miss the wanted pressure
FRUITLESS = 3  # jobs in a row that wrote no displacements: then it is the program, and not the candidates
KEPT = 8  # courses of all nodes that are held in memory
Course = tuple[Array, Array]  # pressures (k,) MPa, displacements (k, n, 3) mm


@dataclass(frozen=True)
class Job:
    """A job: what it is called, the key of what it gives, its deck, and where displacements are wanted.

    case: what is solved; top: the pressure in MPa to which it goes; wanted: the least to which it must; at
    (p, 3) mm: material points, None for all nodes.
    """

    name: str
    key: str
    text: str
    case: Case
    top: float
    wanted: float
    at: Array | None


@dataclass(frozen=True)
class Done:
    """The result of a job: array (k, 1 + p, 3), in mm but for the first column, which has the pressures in
    MPa; or None, and why, and whether it wrote displacements at all."""

    array: Array | None
    why: str = ""
    wrote: bool = False


Together = Callable[[Sequence[Callable[[], Done]]], Iterator[tuple[int, Done]]]


@dataclass(frozen=True)
class EngineJobs:
    """Another program and the jobs that it did.

    engine: the program; release: its version, as it says; cache: what keeps the arrays of done jobs; folder:
    where jobs run; together: runs several at a time, giving number and result of each as it ends; None: they
    run one after the other. failed: why jobs failed, in the order in which they were asked for.
    """

    engine: Program
    release: str
    cache: ArrayCache
    folder: Path
    together: Together | None = None
    failed: list[str] = field(default_factory=list, compare=False, repr=False)
    _fruitless: list[str] = field(default_factory=list, compare=False, repr=False)
    _courses: dict[str, Course] = field(default_factory=dict, compare=False, repr=False)
    _unused: dict[str, Done] = field(default_factory=dict, compare=False, repr=False)

    def ahead(self, cases: Sequence[Case], pressure: float, gravity: Array, *, at: Array) -> None:
        """Run jobs together that `course` will be asked for, of one pressure, gravity and points; its results
        are unchanged by it."""
        if self.together is None:
            return
        jobs = {job.key: job for job in (self._job(case, pressure, gravity, at) for case in cases)}
        open_jobs = [job for key, job in jobs.items() if key not in self._unused and not self._stored(key)]
        tasks = [partial(done_elsewhere, self.engine, self.release, self.folder, job) for job in open_jobs]
        for k, result in self.together(tasks):
            if result.array is None:
                self._unused[open_jobs[k].key] = result  # told when it is asked for
            else:
                self.cache(JOBS, {open_jobs[k].key: partial(np.array, result.array)})

    def course(self, case: Case, pressure: float, gravity: Array, *, at: Array | None = None) -> Course:
        """Pressures (k,) MPa and displacements (k, n, 3) mm of all nodes while the pressure grows to one in
        MPa, or a little further, under a gravity (3,) mm/s2; or those (k, p, 3) of material points (p, 3) mm.

        Raises Unsolvable where the program does not get there; ValueError for what it cannot solve, and where
        FRUITLESS jobs in a row give nothing.
        """
        job = self._job(case, pressure, gravity, at)
        course = self._courses.get(job.name)
        if course is None:
            array = self.cache(JOBS, {job.key: partial(self._made, job)})[job.key]
            course = array[:, 0, 0], array[:, 1:]
            if course[0][-1] < pressure * (1 - REACHED):  # stored for a lower pressure
                raise Unsolvable(f"{self.engine.name} stopped at {course[0][-1]:.4g} of {pressure:.4g} MPa")
            if at is not None:
                return course
            self._courses[job.name] = course
            for old in list(self._courses)[:-KEPT]:
                del self._courses[old]
        return course if at is None else (course[0], _at(interpolation(case, at), course[1]))

    def reasons(self, most: int = 3) -> str:
        """Why jobs failed, the most frequent reasons first; "" where none did."""
        counted = Counter(why.partition("; its files are in")[0] for why in self.failed).most_common(most)
        return "; ".join(f"{why} ({n} jobs)" for why, n in counted)

    def _job(self, case: Case, pressure: float, gravity: Array, at: Array | None) -> Job:
        top = rounded_up(max(pressure, 1e-6))
        heavy = gravity if np.any(gravity) else None
        text = self.engine.deck(case, top, gravity=heavy, levels=LEVELS)
        name = digest("engine job", code_digest(), self.engine.name, self.release, self.engine.kind, text)
        where = "all nodes" if at is None else np.ascontiguousarray(at)
        return Job(name, digest(name, where), text, case, top, pressure, at)

    def _stored(self, key: str) -> bool:
        try:
            self.cache(JOBS, {key: _absent})
        except KeyError:
            return False
        return True

    def _made(self, job: Job) -> Array:
        """The array of a job. Raises Unsolvable."""
        result = self._unused.pop(job.key, None) or done(self.engine, self.folder, job)
        if result.array is None:
            self._fail(result.why, wrote=result.wrote)
        assert result.array is not None
        self._fruitless.clear()
        return result.array

    def _fail(self, why: str, *, wrote: bool) -> None:
        """Raise Unsolvable, or ValueError where the program seems to be at fault."""
        self.failed.append(why)
        self._fruitless[:] = [] if wrote else [*self._fruitless, why]
        if len(self._fruitless) >= FRUITLESS:
            raise ValueError(f"{FRUITLESS} jobs in a row wrote no displacements. The last: {why}")
        raise Unsolvable(why)


def _absent() -> Array:
    raise KeyError


def done_elsewhere(engine: Program, release: str, folder: Path, job: Job) -> Done:
    """As `done`, in a worker. ValueError where its program is of another release."""
    if (here := engine.release()) != release:
        raise ValueError(f"{platform.node()} has {here}, wanted {release}; install the same on every worker")
    return done(engine, folder, job)


def done(engine: Program, folder: Path, job: Job) -> Done:
    """The result of a job that a program runs in a folder of its own below `folder`."""
    job_folder, result = _run(engine, folder, job)
    why, course = result.reason, None
    if len(result.share):
        try:
            course = over_pressure(result, job.case, engine.kind, top=job.top)
        except ValueError as error:
            why = str(error)
    wrote = course is not None and len(course[0]) >= LEAST
    if course is None or not wrote or course[0][-1] < job.wanted * (1 - REACHED):
        return Done(None, f"{engine.name}: {why}; its files are in {job_folder}", wrote)
    shutil.rmtree(job_folder, ignore_errors=True)
    pressure, u = course
    if job.at is not None:
        u = _at(interpolation(job.case, job.at), u)
    column = np.zeros((len(pressure), 1, 3))
    column[:, 0, 0] = pressure
    return Done(np.concatenate([column, u], axis=1), wrote=True)


def _run(engine: Program, folder: Path, job: Job) -> tuple[Path, EngineResult]:
    """A job's folder and what it gave. What a killed run left of the same job is removed."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob(f"{job.name}-*"):
        shutil.rmtree(old, ignore_errors=True)
    job_folder, start = Path(tempfile.mkdtemp(prefix=f"{job.name}-", dir=folder)), time.perf_counter()
    try:
        result = engine.run(job.text, folder=job_folder)
    except BaseException:
        shutil.rmtree(job_folder, ignore_errors=True)
        raise
    effort.add(JOBS, 1, time.perf_counter() - start)
    return job_folder, result


def _at(operator: csr_matrix, u: Array) -> Array:
    return np.stack([operator @ field for field in u])
