"""Dimensions that no camera sees: what their tolerances change is an error that all values share."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Lattice
from tests.messages import saying
from tests.twin.conftest import SHORT
from twin.bench.workbench import tolerances_of
from twin.bodies.finger import BuiltIn, FingerTable
from twin.bodies.pneunet import PneunetTable
from twin.bodies.tube import TubeTable
from twin.judging.tolerances import leaning, leaning_in_words
from twin.judging.whitening import whitener
from twin.laws.mooneyrivlin import NOMINAL
from twin.model.discretisation import SolvedAt, discretisation_error
from twin.model.keptmodel import base_model
from twin.model.structure import body_case, of_body
from twin.project.config import Config, ModelTable
from twin.project.folder import Project
from twin.targets import PointKind, TargetPoint, Targets

BODY = BuiltIn(SHORT, Lattice(per_bellow=1, ring=False, centred=False))
OFF = {"bottom_wall_mm": 0.2, "tip_cap_mm": 0.3}


@pytest.mark.parametrize("body", [FingerTable().body, PneunetTable(), TubeTable()], ids=lambda b: b.kind)
def test_an_inner_dimension_changes_the_chamber_alone(body: object) -> None:
    lattice = body.lattice  # type: ignore[attr-defined]
    case = body_case(body, lattice)  # type: ignore[arg-type]
    outer = np.unique(case.face_nodes("outside"))
    low, high = case.nodes[outer].min(axis=0), case.nodes[outer].max(axis=0)
    for name in body.inner:  # type: ignore[attr-defined]
        larger = body_case(body.larger(name, 0.1), lattice)  # type: ignore[attr-defined]
        inner = np.unique(case.face_nodes("chamber"))
        assert np.abs(larger.nodes - case.nodes)[inner].max() > 0.01, name
        np.testing.assert_allclose(larger.nodes[outer].min(axis=0), low, atol=1e-9)
        np.testing.assert_allclose(larger.nodes[outer].max(axis=0), high, atol=1e-9)


def test_a_tolerance_is_a_mode_of_the_model(make_targets: Callable[..., Targets]) -> None:
    structure = of_body(BODY, tolerances=OFF)
    structure = replace(structure, finer={"check": structure.base})  # the mesh itself errs elsewhere
    t = make_targets()
    places = [tuple(x.tolist()) for x in t.places(structure.case.position)]
    t = replace(t, points=tuple(
        p if p.node is None else TargetPoint(p.name, PointKind.PLACE, None, x)
        for p, x in zip(t.points, places, strict=True)
    ))  # fmt: skip
    model = base_model(t, structure.case)
    theta = np.array([NOMINAL.named["C10"], NOMINAL.named["C01"]]) * 1.1
    point = SolvedAt.beside(NOMINAL, float(t.pressure.max()))
    mesh = discretisation_error(model.test, structure=structure, solved_at=point)
    assert mesh.mode_names[mesh.wall_modes] == ("wall:bottom_wall_mm", "wall:tip_cap_mm")
    modes = model.on_mesh(mesh).modes(theta)[mesh.wall_modes]
    for (name, mm), mode in zip(OFF.items(), modes, strict=True):
        other: Case = body_case(BODY.larger(name, mm), BODY.lattice)
        change = base_model(t, other).predict(theta) - model.predict(theta)
        assert np.abs(change).max() > 0.01
        np.testing.assert_allclose(mode, change, rtol=0, atol=0.06 * np.abs(change).max())
    jacobian = model.jacobian(theta)
    none = np.zeros_like(t.value)
    w = whitener(t, prediction_modes=modes, gauge=none, points=~t.fixed, names=mesh.mode_names[mesh.wall_modes])
    rows = leaning(w, jacobian[:1], ("C10",))
    assert [row[:2] for row in rows] == [("tip_cap_mm", "C10")]
    assert "% of the variance of C10" in leaning_in_words(rows)
    exact = whitener(t, prediction_modes=1e-4 * modes, gauge=none, points=~t.fixed, names=mesh.mode_names[mesh.wall_modes])
    assert leaning(exact, jacobian[:1], ("C10",)) == []


def test_tolerances_that_twin_toml_states() -> None:
    def of(stated: object) -> dict[str, float]:
        model = ModelTable.model_validate({"wall_sd_mm": stated})
        project = Project.__new__(Project)
        config = Config.model_construct(model=model)
        object.__setattr__(project, "config", config)
        return tolerances_of(project, BODY)

    assert set(of(0.1).values()) == {0.1}
    assert of({"bottom_wall_mm": 0.05})["bottom_wall_mm"] == 0.05
    assert of({"bottom_wall_mm": 0.05})["top_wall_mm"] == 0.1
    with pytest.raises(ValueError, match=saying("width_mm is no inner dimension of a finger", "bottom_wall_mm")):
        of({"width_mm": 0.1})
