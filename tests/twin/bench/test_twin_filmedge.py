"""The edge along the film is that of the solve of the fit, which the review does not make again."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fe import Case, Solution
from fe.mesh.finger import Finger
from twin.bench.filmedge import CHUNK, FilmEdge
from twin.calibrated.caches import Store
from twin.effects.library import effect
from twin.model.keptmodel import KeptModel, base_model
from twin.targets import Array, Targets

BASE = {"C10": 0.214, "C01": 0.083}


@dataclass
class Fitted:
    """A model at a fit."""

    model: KeptModel
    theta: Array

    @property
    def values(self) -> dict[str, float]:
        return self.model.named(self.theta)


@pytest.fixture(scope="module")
def fitted(coarsest_case: Case, make_targets: Callable[..., Targets]) -> Fitted:
    model = base_model(make_targets(), coarsest_case)
    theta = model.theta(BASE)
    model.solved(theta)
    return Fitted(model, theta)


@pytest.fixture
def edge(coarsest_case: Case, make_targets: Callable[..., Targets], tmp_path: Path) -> FilmEdge:
    """The edge in a folder of its own, of a film."""
    (tmp_path / "targets").mkdir()
    project = SimpleNamespace(
        root=tmp_path, targets_folder=tmp_path / "targets", effect_files=list, config=SimpleNamespace(cameras=("one",))
    )
    structure = SimpleNamespace(key="short", outside=coarsest_case.face_nodes("outside"))
    return FilmEdge(SimpleNamespace(
        project=project, structure=structure, case=coarsest_case, targets=make_targets(), carried=None,
        store=Store(tmp_path / "cache"),
    ))  # fmt: skip


def no_solve() -> Solution:
    raise AssertionError("a solve")


def test_what_a_fit_has_solved_is_kept_for_the_review(edge: FilmEdge, fitted: Fitted, short: Finger) -> None:
    edge.keep(fitted)
    moved = edge.moved([], fitted.values, no_solve)
    solution, steps = fitted.model.solution(fitted.theta), list(range(len(edge.bench.targets.time)))
    np.testing.assert_array_equal(moved, solution.fields(steps)[:, edge.nodes])
    along = edge.bench.case.nodes[edge.nodes, 0]
    assert np.ptp(along) == pytest.approx(short.length)  # from the clamp to the tip
    assert np.abs(moved).max() > 1.0  # mm: it bends


@pytest.mark.parametrize("change", ["values", "effects", "targets", "mesh"])
def test_another_model_is_solved(edge: FilmEdge, fitted: Fitted, change: str) -> None:
    edge.keep(fitted)
    values = {**fitted.values, **({"C10": 0.2140001} if change == "values" else {})}
    if change == "targets":
        (edge.bench.project.targets_folder / "targets.csv").write_text("other", encoding="utf-8")
    if change == "mesh":
        edge.bench.structure.key = "long"
    with pytest.raises(AssertionError, match="a solve"):
        edge.moved(["creep"] if change == "effects" else [], values, no_solve)


@pytest.mark.parametrize("why", ["not solved there", "no camera", "a part of the test"])
def test_what_is_no_solve_of_the_fit_is_not_kept(edge: FilmEdge, fitted: Fitted, why: str) -> None:
    here = fitted
    if why == "not solved there":  # what is near serves no picture
        here = Fitted(fitted.model, fitted.theta * 1.001)
    if why == "no camera":
        edge.bench.project.config.cameras = ()
    if why == "a part of the test":
        edge.bench.carried = object()
    edge.keep(here)
    with pytest.raises(AssertionError, match="a solve"):
        edge.moved([], here.values, no_solve)


def test_effects_stand_in_its_name_as_the_fit_names_them(edge: FilmEdge, fitted: Fitted) -> None:
    model = fitted.model.with_effect(effect("camera_scale"))
    more = Fitted(model, model.theta({**fitted.values, "camera_scale.scale": 0.01}))
    model.solved(more.theta)
    edge.keep(more)
    assert len(edge.moved(["camera_scale"], more.values, no_solve)) <= CHUNK
