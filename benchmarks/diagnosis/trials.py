"""A hidden truth and seeds -> what `twin diagnose` says to each draw of the noise; shared by the benchmarks.

The truth is solved once and kept under the system's temporary folder, as are the discretisation modes. All
draws of one truth share one base model, whose solves they start from, so that a draw costs its refits only.
"""

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import benchmarks  # noqa: F401

import numpy as np

from fe import Case, Finger, Lattice
from fe.case import digest
from twin import virtual
from twin.diagnosis.deciding import Diagnosis
from twin.diagnosis.procedure import diagnose
from twin.diagnosis.record import DiagnosisRecord
from twin.effects.library import effect
from twin.effects.protocol import Effect
from twin.executors.chosen import current
from twin.executors.protocol import gathered
from twin.judging.fitting import fit_model, whitener_of
from twin.laws.mooneyrivlin import mooney_rivlin
from twin.model.basemodel import base_model
from twin.model.discretisation import SolvedAt, discretisation_error
from twin.model.prediction import Model
from twin.model.structure import base_case, of_finger
from twin.project.config import DiagnoseTable
from twin.targets import Array, Targets

# The finger's markers sit on nodes of the flat lower edge of the side face y = 11.5 mm, as far as the tip.
STATIONS = (12, 22, 32, 42, 52, 64)  # in 1/72 of the bellows' 100 mm; 42 is the node 5848
NAMES = ("p1", "p2", "p3", "middle", "p5", "p6", "tip")
SHARE = 5  # draws of a task, whatever the number of workers: they start from each other's solves
WANTED = 0.95  # share of right verdicts: 19 of 20
# Where every prefit starts: the study's constants.
NOMINAL = np.array([0.214, 0.083])  # MPa, C10 and C01
CANDIDATES = tuple(effect(label) for label in DiagnoseTable().candidates)  # those of a new project


def marked_points() -> Array:
    """Undeformed places (7, 3) mm of the finger's markers, those of NAMES."""
    x = np.append(4.0 + np.array(STATIONS) * 100.0 / 72.0, 110.0)
    return np.stack([x, np.full_like(x, 11.5), np.zeros_like(x)], axis=1)


def nodes_of(case: Case) -> np.ndarray:
    """Labels (7,) of the nodes of a model under the markers; ValueError where one has no node."""
    gap = np.linalg.norm(case.nodes[:, None] - marked_points(), axis=2)
    if gap.min(axis=0).max() > 1e-6:
        raise ValueError(f"a finger tag lies {gap.min(axis=0).max():g} mm from every node; wanted a node")
    return case.labels[gap.argmin(axis=0)]


def kept(kind: str, key: str, make: Callable[[], dict[str, Array]]) -> dict[str, Array]:
    """The arrays that `make` gives, from the system's temporary folder where they were made before.

    They do not know of changes to the solver: delete softtwin-*.npz there after one.
    """
    path = Path(tempfile.gettempdir()) / f"softtwin-{kind}-{key}.npz"
    if not path.exists():
        print(f"solving ({kind}), kept as {path}", flush=True)
        arrays, scratch = make(), path.with_suffix(".part.npz")
        np.savez(scratch, allow_pickle=False, **arrays)
        scratch.replace(path)
    with np.load(path) as data:
        return dict(data)


def solved(truth: Case, bench: virtual.Bench, points: Array) -> tuple[Array, Array]:
    """True displacements (s, p, 3) mm of points (p, 3) mm, and dU/dp (s, p, 3) mm per MPa."""
    course = virtual.path(bench)
    key = digest("truth", truth, course.time, course.pressure, course.output, points)

    def make() -> dict[str, Array]:
        u, slope = virtual.displaced(truth, course, points)
        return {"u": u, "slope": slope}

    found = kept("truth", key, make)
    return found["u"], found["slope"]


@dataclass(frozen=True)
class Laboratory:
    """The true motion (s, 7, 3) mm and slope (s, 7, 3) mm per MPa of the markers, filmed on a bench."""

    u: Array
    slope: Array
    bench: virtual.Bench

    @staticmethod
    def of(truth: Case, bench: virtual.Bench) -> "Laboratory":
        """The laboratory of a truth."""
        return Laboratory(*solved(truth, bench, marked_points()), bench)

    def targets(self, case: Case, seed: int) -> Targets:
        """One draw of what would be measured."""
        return virtual.noisy_targets(
            self.u, self.slope, virtual.path(self.bench), bench=self.bench, seed=seed,
            points=virtual.at_nodes(NAMES, nodes_of(case), marked_points()),
        )  # fmt: skip


def prepared(case: Case, targets: Targets) -> tuple[Model, Array]:
    """The base model with the error of its mesh, and its fitted parameters (2,)."""
    model = base_model(targets, case)

    def keep(stage: str, tasks: Mapping[str, Callable[[], Array]]) -> dict[str, Array]:
        one = {key: lambda make=make: {"array": make()} for key, make in tasks.items()}
        return {key: kept("mesh", key, one[key])["array"] for key in tasks}

    at = SolvedAt.beside(mooney_rivlin(*map(float, NOMINAL)), float(targets.log_pressure.max()))
    model = model.on_mesh(
        discretisation_error(
            model.test, structure=of_finger(Finger(), Lattice()), solved_at=at, cache=keep
        )
    )
    return model, fit_model(model, targets, whitener_of(model, NOMINAL, targets), start=NOMINAL).theta


def verdicts(
    laboratory: Laboratory,
    prefit: tuple[Model, Array],
    effects: Sequence[Effect],
    seeds: Sequence[int],
) -> list[Diagnosis]:
    """The diagnoses of these draws, a printed line for each."""
    # what a model has solved, others start from: each share of the draws begins with the same
    case, found, (model, start) = base_case(lattice=Lattice()), [], deepcopy(prefit)
    for seed in seeds:
        began = time.perf_counter()
        said = diagnose(model, effects, laboratory.targets(case, seed), seed=0, start=start)
        found.append(said)
        print(f"{seed:5d} {_numbers(said)} {time.perf_counter() - began:10.0f} "
              f"  {said.verdict} ({said.law or '-'})", flush=True)  # fmt: skip
    return found


def _numbers(said: Diagnosis) -> str:
    """The error before and after, and the noise, in mm."""
    row = DiagnosisRecord.of(said)
    cells = [row.rms_before_mm, row.rms_after_mm, row.noise_sd_mm]
    return " ".join(f"{x:7.4f}" if x is not None else "      -" for x in cells)


def report(
    title: str,
    laboratory: Laboratory,
    count: int,
    *,
    right: Callable[[Diagnosis], bool],
    effects: Sequence[Effect] = CANDIDATES,
) -> tuple[bool, list[Diagnosis]]:
    """Prints a table of `count` draws; says whether at least 19 of 20 are right, and the draws."""
    print(f"{title}: {count} draws", flush=True)
    case = base_case(lattice=Lattice())
    prefit = prepared(case, laboratory.targets(case, 0))
    print(f"{'seed':>5s} {'before':>7s} {'after':>7s} {'noise':>7s}  mm rms   s  verdict (law)")
    shares = [range(k, min(k + SHARE, count)) for k in range(0, count, SHARE)]
    tasks = [partial(verdicts, laboratory, prefit, effects, seeds) for seeds in shares]
    found = [said for some in gathered(current(), tasks) for said in some]
    good = sum(map(right, found))
    print(f"{title}: {good} of {count} right, wanted {WANTED:.0%}", flush=True)
    return good >= WANTED * count - 1e-9, found
