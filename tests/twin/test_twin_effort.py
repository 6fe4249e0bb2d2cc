"""What was solved is counted by its kind, in this process and in workers, and kept in run.json."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from fe import Case
from twin import effort
from twin.effects.library import effect
from twin.executors.local import Processes
from twin.model.keptmodel import KeptModel, base_model
from twin.project.folder import Project
from twin.report.facts import provenance_of
from twin.targets import Targets

THETA = np.array([0.214, 0.083])


@pytest.fixture(scope="module")
def model(coarsest_case: Case, make_targets: Callable[..., Targets]) -> KeptModel:
    return base_model(make_targets(), coarsest_case)


def counts(before: effort.Effort) -> dict[str, int]:
    assert all(s.cpu_s > 0 for s in effort.since(before).values())
    return {kind: s.n for kind, s in effort.since(before).items()}


def test_every_solve_is_counted_by_its_kind(model: KeptModel) -> None:
    before = effort.so_far()
    model.predict(THETA)
    model.predict(THETA)  # kept
    assert counts(before) == {"with derivatives": 1}
    creeping = model.with_effect(effect("creep"))
    creeping.predict(np.array([*THETA, 0.05, 3.0]))
    tangents = model.tangents(THETA, [effect("clamp"), effect("camera_scale")])
    assert {len(rows) for one in tangents.values() for rows in one} == {1}
    # the camera's scale moves nothing that is solved
    assert counts(before) == {"with derivatives": 1, "with history and derivatives": 1, effort.COLUMNS: 1}


@pytest.mark.parametrize("workers", [1, 2])
def test_what_workers_solve_is_counted_here(workers: int) -> None:
    before = effort.so_far()
    list(Processes(workers).ended([partial(effort.add, "plain", k, 2.0) for k in (1, 2)]))
    assert effort.since(before) == {"plain": (3, pytest.approx(4.0))}  # a difference of sums over all tests before


def test_a_run_keeps_what_it_solved(tmp_path: Path) -> None:
    names = (("tip", 4401), ("middle", 5848))
    points = [f'[[points]]\nname = "{name}"\nnode = {node}' for name, node in names]
    (tmp_path / "twin.toml").write_text("\n".join(points))
    project = Project.open(tmp_path)
    effort.add("plain", 5, 1.0)  # an earlier stage's
    with project.new_run("compare") as run, effort.counted("plain"):
        sum(range(100_000))
    info = project.info(run.folder)
    assert info.solves["plain"].n == 1
    assert 0 < info.solves["plain"].cpu_s <= (info.cpu_s or 0.0)
    assert run.log()[-1] == {"note": f"Solved: 1 plain in {info.solves['plain'].cpu_s:.1f} s."}
    shown = provenance_of(project, seed=1)["compare solved"]
    assert shown.startswith("1 plain in 0.0 s; ")
