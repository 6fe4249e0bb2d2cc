"""Cases and a pressure -> displacements by jobs of another program, each made once.

A job is a deck: its text is the key under which what it gave is stored. A job runs in a folder of its own,
which is kept where it failed, with deck, log and result files, and else removed.
"""

import shutil
import tempfile
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix

from fe import Case
from fe.case import digest
from fe.deck.course import LEAST, over_pressure
from fe.deck.engine import EngineResult, Program
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
class EngineJobs:
    """Another program and the jobs that it did.

    engine: the program; release: its version, as it says; cache: what keeps the arrays of done jobs; folder:
    where jobs run. failed: why jobs failed, in their order.
    """

    engine: Program
    release: str
    cache: ArrayCache
    folder: Path
    failed: list[str] = field(default_factory=list, compare=False, repr=False)
    _fruitless: list[str] = field(default_factory=list, compare=False, repr=False)
    _courses: dict[str, Course] = field(default_factory=dict, compare=False, repr=False)

    def course(self, case: Case, pressure: float, gravity: Array, *, at: Array | None = None) -> Course:
        """Pressures (k,) MPa and displacements (k, n, 3) mm of all nodes while the pressure grows to one in
        MPa, or a little further, under a gravity (3,) mm/s2; or those (k, p, 3) of material points (p, 3) mm.

        Raises Unsolvable where the program does not get there; ValueError for what it cannot solve, and where
        FRUITLESS jobs in a row give nothing.
        """
        top = rounded_up(max(pressure, 1e-6))
        heavy = gravity if np.any(gravity) else None
        text = self.engine.deck(case, top, gravity=heavy, levels=LEVELS)
        job = digest("engine job", code_digest(), self.engine.name, self.release, self.engine.kind, text)
        whole = self._courses.get(job)
        if whole is None:
            where = "all nodes" if at is None else np.ascontiguousarray(at)
            key = digest(job, where)
            task = partial(self._made, job, text, case, top, pressure, at)
            made = self.cache(JOBS, {key: task})[key]
            whole = made[:, 0, 0], made[:, 1:]
            if whole[0][-1] < pressure * (1 - REACHED):  # stored for a lower pressure
                raise Unsolvable(f"{self.engine.name} stopped at {whole[0][-1]:.4g} of {pressure:.4g} MPa")
            if at is not None:
                return whole
            self._courses[job] = whole
            for old in list(self._courses)[:-KEPT]:
                del self._courses[old]
        return whole if at is None else (whole[0], _at(interpolation(case, at), whole[1]))

    def _made(
        self, job: str, text: str, case: Case, top: float, wanted: float, at: Array | None
    ) -> Array:
        """The course that a job gives, (k, 1 + n, 3), the pressures first. Raises Unsolvable."""
        folder, found = self._run(job, text)
        reason, course = found.reason, None
        if len(found.share):
            try:
                course = over_pressure(found, case, self.engine.kind, top=top)
            except ValueError as error:
                reason = str(error)
        got = course is not None and len(course[0]) >= LEAST
        if course is None or not got or course[0][-1] < wanted * (1 - REACHED):
            self._fail(f"{self.engine.name}: {reason}", folder, got=got)
        assert course is not None
        shutil.rmtree(folder, ignore_errors=True)
        self._fruitless.clear()
        pressure, u = course
        if at is not None:
            u = _at(interpolation(case, at), u)
        first = np.zeros((len(pressure), 1, 3))
        first[:, 0, 0] = pressure
        return np.concatenate([first, u], axis=1)

    def _run(self, job: str, text: str) -> tuple[Path, EngineResult]:
        """A job's folder and what it gave. What a killed run left of the same job is removed."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in self.folder.glob(f"{job}-*"):
            shutil.rmtree(old, ignore_errors=True)
        folder, start = Path(tempfile.mkdtemp(prefix=f"{job}-", dir=self.folder)), time.perf_counter()
        try:
            found = self.engine.run(text, folder=folder)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        effort.add(JOBS, 1, time.perf_counter() - start)
        return folder, found

    def _fail(self, why: str, folder: Path, *, got: bool) -> None:
        """Raise Unsolvable, or ValueError where the program seems to be at fault."""
        said = f"{why}; its files are in {folder}"
        self.failed.append(said)
        self._fruitless[:] = [] if got else [*self._fruitless, said]
        if len(self._fruitless) >= FRUITLESS:
            raise ValueError(f"{FRUITLESS} jobs in a row wrote no displacements. The last: {said}")
        raise Unsolvable(said)


def _at(operator: csr_matrix, u: Array) -> Array:
    return np.stack([operator @ field for field in u])
