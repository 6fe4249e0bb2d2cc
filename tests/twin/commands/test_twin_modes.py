"""`twin modes` on a short finger that was fitted: what it tells, what it needs, and what it refuses."""

import csv
from pathlib import Path
from typing import Any

from benchmarks.kernel.beams import Beam

import numpy as np
import pytest
from rerun.chunk import RrdReader

from calibrate import Fit
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.mass import Attached
from fe.dynamics.vibration import modes
from fe.mesh.mirror import mirrored
from tests.messages import Lines
from tests.twin.test_twin_notebook import C10, batch, coarsest
from twin import files
from twin.bench.workbench import Workbench
from twin.calibrated.naturalvibrations import WantedVibrations, _at, motion_of, vibrations
from twin.commands.modes import run_modes
from twin.effects.loads import PressureGain
from twin.effects.protocol import Unsolvable
from twin.judging.fitrecord import FitRecord
from twin.model.structure import BuiltIn
from twin.project.folder import Project
from twin.results import rows_of

__all__ = ["batch", "coarsest"]
KG_M3, RHO = 1070.0, 1.07e-9


@pytest.fixture(scope="module")
def project(batch: Path, coarsest: BuiltIn) -> Project:
    return Project.open(batch, builtin=coarsest)


@pytest.fixture(scope="module")
def bench(project: Project) -> Workbench:
    return Workbench.of(project)


@pytest.fixture(scope="module")
def fit(bench: Workbench) -> FitRecord:
    parameters = bench.model().parameters
    assert [p.name for p in parameters] == ["C10"]
    fit = Fit(parameters, theta=np.array([C10]), covariance=np.array([[0.01**2]]), chi2=4.0, degrees_of_freedom=5,
              seed=1, evaluations=1, converged=True, reason="made", at_bound=())  # fmt: skip
    return FitRecord.of(fit, adequate=True)


@pytest.fixture
def fitted(fit: FitRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The newest fit of the project, without the minute that it takes."""
    files.write_json(tmp_path / "fit.json", files.plain(fit))
    monkeypatch.setattr("twin.commands.modes.fit_file", lambda _: tmp_path / "fit.json")


def ends_of(path: Path, entity: str) -> list[Any]:
    """The places of points at both ends of their motion, as a rerun file has them."""
    for chunk in RrdReader(str(path)).stream().filter(content=entity):
        table = chunk.to_record_batch()
        if {"part_of_period", "Points3D:positions"} <= set(table.schema.names):
            found = dict(zip(table.column("part_of_period").cast("int64").to_pylist(),
                             table.column("Points3D:positions").to_pylist(), strict=True))  # fmt: skip
            return [found[0], found[12]]
    return []


@pytest.mark.usefixtures("fitted")
def test_it_tells_the_vibrations_of_the_fitted_finger(project: Project, bench: Workbench, fit: FitRecord) -> None:
    found = run_modes(project, Lines(), ["4kPa"], count=3, loss=0.1, density=KG_M3, attach=["tip=2"])
    folder, rows = project.root / "runs" / found["run"], found["vibrations"]
    assert [row["number"] for row in rows] == [1, 2, 3]
    model = bench.model()
    case = model.put(model.named(fit.fit.theta)).case.with_material(density=RHO)
    # the tip lies beside the plane of symmetry, so that the mass asks for the whole finger
    tip = Attached(case.position(4401), 2e-6)
    other = modes(at_rest(mirrored(case), HeldLoad(0.004)), count=3, attached=[tip], loss=0.1)
    np.testing.assert_allclose([row["frequency_Hz"] for row in rows], other.frequency, rtol=1e-5)
    np.testing.assert_allclose([row["damping_ratio"] for row in rows], other.damping, rtol=1e-4)
    np.testing.assert_allclose(
        [row["points"]["tip"] for row in rows], other.at(tip.place[None])[:, 0], atol=1e-4 * np.sign(other.shape).max()
    )
    with (folder / "vibrations.csv").open(encoding="utf-8", newline="") as stream:
        table = list(csv.DictReader(stream))
    assert float(table[0]["frequency_Hz"]) == pytest.approx(rows[0]["frequency_Hz"], rel=1e-5)
    assert (folder / "vibrations.png").stat().st_size
    length = np.ptp((case.nodes + at_rest(case, HeldLoad(0.004)).state.u)[:, 0])
    seen = [place for row in ends_of(folder / "vibrations.rrd", "vibration0/markers") for place in row]
    apart = np.subtract(*np.array(seen).reshape(2, -1, 3))  # of the points, in their order, from end to end
    np.testing.assert_allclose(apart, 2 * 0.12 * length * np.array(list(rows[0]["points"].values())), atol=1e-3)
    assert [row["moves"] for row in rows_of("modes", folder, found)] == [row["moves"] for row in rows]


def test_the_interval_of_a_frequency_at_rest_is_half_that_of_the_modulus(bench: Workbench, fit: FitRecord) -> None:
    """omega ~ sqrt(C10 + C01), of which C10 alone was fitted."""
    assert fit.adequate
    (here,) = vibrations(bench, fit, WantedVibrations((0.0,), 2, kg_m3=KG_M3))
    assert here.sd is not None
    np.testing.assert_allclose(here.sd / here.found.frequency, 0.01 / (C10 + 0.083) / 2, rtol=1e-3)


def test_the_pressure_is_the_one_that_the_chamber_feels(
    bench: Workbench, fit: FitRecord
) -> None:
    model = bench.model()
    gained = model.with_effect(PressureGain())
    found = []
    for which, theta, pressure in ((gained, [*fit.fit.theta, 0.25], 0.004), (model, fit.fit.theta, 0.005)):
        asked = WantedVibrations((pressure,), 1, kg_m3=KG_M3)
        found.append(float(_at(bench, which, asked, pressure, np.array(theta)).found.frequency[0]))
    assert found[0] == pytest.approx(found[1], rel=1e-6)


@pytest.mark.usefixtures("fitted")
def test_what_is_no_question_is_refused(project: Project, bench: Workbench, fit: FitRecord) -> None:
    before = len(project.runs())
    wrong: list[tuple[dict[str, Any], str]] = [
        ({}, r"--density 1070 \(kg/m3\)"),
        ({"density": 1.07}, "--density 1.07: wanted kg/m3"),
        ({"density": KG_M3, "loss": -1.0}, "loss factor"),
        ({"density": KG_M3, "count": 0}, "wanted 1 to 20"),
        ({"density": KG_M3, "attach": ["tip"]}, "PLACE=GRAMS"),
        ({"density": KG_M3, "attach": ["top=2"]}, "--attach 'top': wanted a point"),
    ]
    for how, words in wrong:
        with pytest.raises(ValueError, match=words):
            run_modes(project, Lines(), **how)
    assert len(project.runs()) == before
    with pytest.raises(Unsolvable, match="no equilibrium at 900 kPa"):
        vibrations(bench, fit, WantedVibrations((0.9,), 1, kg_m3=KG_M3))


def test_what_moves_is_told_in_words() -> None:
    beam = Beam(length=80.0, width=14.0, height=10.0)
    found = modes(at_rest(beam.case((8, 1, 1)), HeldLoad()), count=8)
    words = [motion_of(found.case, s, bool(a)) for s, a in zip(found.shape, found.sideways, strict=True)]
    assert words[:4] == ["bends up and down", "sways aside", "bends up and down", "twists"]
    assert "stretches" in words
    whole = mirrored(found.case)
    both = modes(at_rest(whole, HeldLoad()), count=8)
    assert [motion_of(whole, s, sideways=False) for s in both.shape] == words
