"""Verdicts on virtual films of a short finger: nothing hidden, creep, a force outside the library, and
refusals.

The truth is on a mesh of the other topology; base model, discretisation modes and truths are shared by
the seeds.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material
from tests.few import few
from tests.messages import says
from twin import virtual
from twin.diagnosis.deciding import Diagnosis
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.diagnosis.procedure import diagnose
from twin.effects.library import all_effects, effect
from twin.effects.requirements import lacking
from twin.files import plain
from twin.judging.fitting import fit_model, whitener_of
from twin.laws.mooneyrivlin import mooney_rivlin
from twin.model.discretisation import Discretisation, SolvedAt, discretisation_error
from twin.model.keptmodel import base_model, base_test
from twin.model.prediction import Model
from twin.model.structure import of_finger
from twin.targets import Array, Targets

# A ramp, a hold, a release in 0.4 s and a rest: seconds and kPa.
FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 30.0), (12.0, 30.0), (12.4, 0.0), (22.0, 0.0))
BENCH = virtual.Bench(film_hz=3.5, gauge_sd_MPa=3e-4, sd=0.005)
NOISY = virtual.Bench(film_hz=5.0, gauge_sd_MPa=1e-3, sd=0.01)
NAMES, X = ("p1", "p2", "middle", "p4", "tip"), np.array([9.556, 15.111, 4 + 50 / 3, 31.778, 10 + 100 / 3])
NOMINAL = np.array([0.214, 0.083])
# What every verdict is asked of; the two that these films cannot tell from the constants are left to one
# test.
SOUGHT = ("creep", "pressure_lag", "stiffening", "camera_scale")
pytestmark = pytest.mark.usefixtures("solved_once")


@dataclass(frozen=True)
class Laboratory:
    """A finger, its base case, its discretisation modes, and what the truths do."""

    finger: Finger
    case: Case
    points: Array
    nodes: Array
    mesh: Discretisation

    def film(self, truth: Case, bench: virtual.Bench = BENCH) -> Callable[[int], Targets]:
        """Targets of a truth by seed."""
        course = virtual.path(bench, protocol=FILM)
        u, slope = virtual.displaced(truth, course, self.points)
        return lambda seed: virtual.noisy_targets(
            u, slope, course, points=virtual.at_nodes(NAMES, self.nodes, self.points), bench=bench, seed=seed
        )

    def truth(self, *, force: float = 0.0, prony: tuple[tuple[float, float], ...] = ()) -> Case:
        """The finger of cells that are not the model's, with a dead force up in N on half its tip face."""
        lattice, material = Lattice(per_bellow=2, centred=False), Material(*NOMINAL, prony=prony)
        case = virtual.truth_case(self.finger, lattice, material=material, element=None)
        return replace(case, forces={"tip_face": np.array([0.0, 0.0, force])} if force else {})


@pytest.fixture(scope="module")
def laboratory(short: Finger, short_case: Case) -> Laboratory:
    edge = np.stack([X, np.full_like(X, 11.5), np.zeros_like(X)], axis=1)
    rows = np.linalg.norm(short_case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    points, nodes = short_case.nodes[rows], short_case.labels[rows]
    assert np.abs(points - edge).max() < 1e-3  # mm
    found = Laboratory(short, short_case, points, nodes, Discretisation.none("not yet solved"))
    t = found.film(found.truth())(0)
    structure = of_finger(short, Lattice(per_bellow=2, ring=False, centred=False))
    at = SolvedAt.beside(mooney_rivlin(*map(float, NOMINAL)), float(t.log_pressure.max()))
    mesh = discretisation_error(base_test(t, short_case), structure=structure, solved_at=at)
    return replace(found, mesh=mesh)


def diagnosed(
    laboratory: Laboratory, truth: Case, *, seeds: tuple[int, ...], bench: virtual.Bench = BENCH,
    sought: tuple[str, ...] = SOUGHT,
) -> list[Diagnosis]:
    film = laboratory.film(truth, bench)
    first = film(seeds[0])
    model = base_model(first, laboratory.case).on_mesh(laboratory.mesh)
    start = fit_model(model, first, whitener_of(model, NOMINAL, first), start=NOMINAL).theta
    effects = [effect(name) for name in sought]
    return [diagnose(model, effects, film(seed), seed=0, start=start) for seed in seeds]


@pytest.mark.parametrize("seed", few([1, 2], [1]))
def test_nothing_hidden_needs_nothing(laboratory: Laboratory, seed: int) -> None:
    for found in diagnosed(laboratory, laboratory.truth(), seeds=(seed,)):
        assert (found.verdict, found.named, found.law, found.kept) == ("none needed", (), None, None)
        data = plain(DiagnosisRecord.of(found))
        assert data["adequate"] is True
        assert data["rms_after_mm"] == data["rms_before_mm"] <= 1.1 * data["noise_sd_mm"]
        assert data["p_value_before"] > 1e-3


@pytest.mark.slow  # in every run, test_twin_stages.py finds it from a project's folder
@pytest.mark.parametrize("seed", [1, 2])
def test_hidden_creep_is_named_and_its_error_goes(laboratory: Laboratory, seed: int) -> None:
    truth = laboratory.truth(prony=((0.09, 1.2), (0.067, 3.5), (0.024, 15.0)))
    for found in diagnosed(laboratory, truth, seeds=(seed,)):
        assert found.named == ("creep",), found.sentence
        assert found.verdict == "creep"
        assert found.law in ("creep", "creep:2")
        data = plain(DiagnosisRecord.of(found))
        assert data["rms_before_mm"] >= 2.5 * data["noise_sd_mm"]
        # most of the noise is one gauge error a step: with some forty steps its rms is known to a tenth
        assert data["rms_after_mm"] <= 1.3 * data["noise_sd_mm"]
        assert data["ranking"][0]["effect"] == "creep"
        assert data["ranking"][0]["delta_bic"] > 25
        assert found.kept is not None
        assert found.kept.fit is not None
        g = sum(x for p, x in zip(found.kept.fit.parameters, found.kept.fit.theta) if p.name.startswith("creep.g"))
        assert 0.09 < g < 0.26  # of 0.18 hidden, what relaxes within the film


@pytest.mark.slow  # test_twin_verdicts.py has it with a linear model
@pytest.mark.parametrize("seed", [1, 2])
def test_a_force_outside_the_library_is_none_of_these(laboratory: Laboratory, seed: int) -> None:
    # so large a force that it is plain, and so much noise that the short finger's coarse mesh can be tested
    for found in diagnosed(laboratory, laboratory.truth(force=0.4), seeds=(seed,), bench=NOISY):
        assert (found.verdict, found.named, found.law, found.kept) == ("none of these", (), None, None), found.sentence
        data = plain(DiagnosisRecord.of(found))
        assert data["p_value_before"] < 1e-9
        assert data["rms_after_mm"] == data["rms_before_mm"]
        assert data["adequate"] is False


def test_without_noise_model_or_with_few_frames_nothing_can_be_tested(laboratory: Laboratory) -> None:
    t = laboratory.film(laboratory.truth())(1)
    model = base_model(t, laboratory.case)
    assert t.noise is not None
    for noise, why in ((None, "no noise model"), (replace(t.noise, frames=20), "20 static frames")):
        found = diagnose(model, all_effects(), replace(t, noise=noise), seed=0, start=NOMINAL)
        assert found.verdict.startswith("cannot test: ")
        assert why in found.verdict
        assert (found.named, found.ranking) == ((), ())
        assert plain(DiagnosisRecord.of(found))["rms_before_mm"] is None


def test_a_mesh_too_coarse_for_the_noise_is_carried_and_told(laboratory: Laboratory) -> None:
    t = laboratory.film(laboratory.truth())(1)
    assert t.noise is not None
    noise = replace(t.noise, sd=t.noise.sd / 1000)
    still = np.where(t.fixed[:, None], 0.0 * t.value, t.value)
    exact = replace(
        t, value=still, covariance=t.covariance / 1e6, pressure_sd=0 * t.pressure_sd, noise=noise
    )
    model: Model = base_model(exact, laboratory.case).on_mesh(laboratory.mesh)
    found = diagnose(model, (), exact, seed=0, start=NOMINAL, beside=())
    assert not found.verdict.startswith("cannot test")
    says(found.sentence, "mesh = 2")


def test_without_a_log_history_is_not_testable(laboratory: Laboratory) -> None:
    t = laboratory.film(laboratory.truth())(1)
    bare = replace(t, log_time=t.time, log_pressure=t.pressure)
    model = base_model(bare, laboratory.case).on_mesh(laboratory.mesh)
    found = diagnose(model, all_effects(), bare, seed=0, start=NOMINAL)
    notes = {c.effect.name: c.note for c in found.ranking}
    # for a log, for gravity's direction, for its way down, and for a fast course
    asking = {"creep", "mullins", "pressure_lag", "time_shift", "gravity", "inertia"}
    assert {name for name, note in notes.items() if note.startswith("not testable")} == asking
    assert "cannot be seen apart" in notes["pressure_gain"]  # C10 and C01 do the same
    says(found.sentence, "pressure_lag", "time_shift")


@pytest.mark.slow
def test_hidden_softening_of_another_law_is_named(laboratory: Laboratory) -> None:
    # beta is not 0, as the narrow law has it, and the mesh is of the other topology
    truth = laboratory.truth().with_material(mullins=(0.4, 3e-4, 0.3))
    (found,) = diagnosed(laboratory, truth, seeds=(1,), sought=(*SOUGHT, "mullins"))
    assert found.named == ("mullins",), found.sentence
    data = plain(DiagnosisRecord.of(found))
    assert data["rms_before_mm"] >= 2 * data["noise_sd_mm"]
    assert data["rms_after_mm"] <= 1.1 * data["noise_sd_mm"]


def test_softening_needs_steps_of_falling_pressure(laboratory: Laboratory) -> None:
    t = laboratory.film(laboratory.truth())(1)
    assert lacking(effect("mullins").requires, t) == ""
    rising = replace(t, log_pressure=np.maximum.accumulate(t.log_pressure))
    assert "needs steps at which the pressure has fallen" in lacking(effect("mullins").requires, rising)
    assert lacking(effect("creep").requires, rising) == ""
