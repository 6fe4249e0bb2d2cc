"""What a swing tells: whether its damping is a drag, and which way its frequency is off that of the model."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.vibration import modes
from tests.messages import says
from twin.contract.specimen import small_test
from twin.diagnosis.swing import beside_model, damping_in_words, in_words, swing_in_words
from twin.effects.inertia import Inertia
from twin.effects.material import Elasticity
from twin.foreign.courseeffects import NoStructure
from twin.model.prediction import Model

BASE = {"C10": 0.214, "C01": 0.083}
DENSITY = 1.07e-9


def judged(density: float, hz: float, **more: float) -> Any:
    test = small_test()
    test = replace(test, case=test.case.with_material(density=density))
    model = Model(test, (Elasticity(), Inertia(2)), np.array([0]))
    values = {**BASE, "inertia.share": 1.0, "inertia.hz": hz, "inertia.damping": 0.05, "inertia.drag": 0.0,
              "inertia.faster": 0.0, **more}  # fmt: skip
    return SimpleNamespace(model=model, values=values, fit=SimpleNamespace(sd=np.full(7, 0.01)))


@pytest.fixture(scope="module")
def frequency() -> float:
    """That of the specimen at rest in Hz: its pressure changes it little."""
    test = judged(DENSITY, 5.0).model.test
    found = modes(at_rest(test.case.with_material(C10=0.214, C01=0.083), HeldLoad()), count=6)
    return float(found.frequency[~found.sideways][0])


def test_a_frequency_that_the_density_gives_is_told_as_such_and_any_other_with_what_it_may_be(
    frequency: float,
) -> None:
    says(beside_model(judged(DENSITY, frequency)), "as its stiffness and density say, to 10 %")
    says(beside_model(judged(DENSITY, 0.7 * frequency)), "times the mass that the model has, or its clamp gives way")
    says(beside_model(judged(DENSITY, 1.4 * frequency)), "it is lighter than the model, stiffer at that rate than at rest, or its chamber is closed")
    # four times as dense it swings half as fast
    says(beside_model(judged(4 * DENSITY, frequency / 2)), "as its stiffness and density say")


def test_the_frequency_is_that_at_the_pressure_of_the_film(frequency: float) -> None:
    test = judged(DENSITY, 5.0).model.test
    share = float(np.median(test.path.at_output()) / np.ptp(test.path.pressure))
    assert share > 0.3
    says(beside_model(judged(DENSITY, frequency / (1 + share), **{"inertia.faster": 1.0})), "density say, to 10 %")


def test_a_damping_that_grows_with_the_amplitude_is_told_as_a_drag(frequency: float) -> None:
    film = judged(DENSITY, frequency, **{"inertia.drag": 0.3})
    says(swing_in_words(film), "as a drag of what surrounds it does. With its density the model swings at")
    film.fit.sd[:] = 0.2
    says(damping_in_words(film), "as a loss of the material or of the clamp is")
    says(damping_in_words(judged(DENSITY, frequency, **{"inertia.drag": 0.09})), "as a loss of the material")


def test_without_density_or_structure_or_inertia_nothing_is_said() -> None:
    bare = judged(0.0, 5.0)
    assert beside_model(bare) == ""
    assert swing_in_words(bare) == "Its damping is much the same at all amplitudes, as a loss of the material or of the clamp is."
    bare.values = BASE
    bare.model = replace(bare.model, effects=(Elasticity(),))
    assert swing_in_words(bare) == ""
    foreign = judged(DENSITY, 5.0)
    test = replace(foreign.model.test, case=NoStructure())
    foreign.model = SimpleNamespace(put=lambda values: test)
    assert beside_model(foreign) == ""


def test_what_the_sd_of_the_frequency_leaves_open_is_no_difference() -> None:
    says(in_words(4.0, 1.0, 5.0, 0.01), "as its stiffness and density say")
    says(in_words(4.0, 0.1, 5.0, 0.01), "1.6 times the mass")
