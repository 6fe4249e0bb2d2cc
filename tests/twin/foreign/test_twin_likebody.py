"""Effects inside a structure, by their shape in our own model of a like body."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import twin
from fe import Case
from tests.messages import says
from tests.twin.foreign.arcs import BEND, PLACES, STIFF, TIME, TRUE, arcs, course, data_of
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Effect
from twin.foreign.foreigndiagnosis import diagnosed
from twin.foreign.likebody import like_body_effects

SHAPE = {"wall_taper": (0.0, 3.0, 1.0), "eccentric_core": (1.0, 2.0, -1.0)}  # mm per mm at the points, along z


def like(case: Case, steps: int = len(TIME)) -> Any:
    """A fit of ours in which two effects move the points with the square of the pressure, and others nothing."""

    def tangents(theta: object, effects: Sequence[Effect]) -> dict[str, list[np.ndarray]]:
        found = {}
        for e in effects:
            along = np.outer((course(TIME) / 0.03) ** 2, SHAPE.get(e.name, (0.0, 0.0, 0.0)))
            found[e.label] = [np.stack([along[..., None] * [0.0, 0.0, 1.0]] * len(e.amplitudes))]
        return found

    test = SimpleNamespace(path=SimpleNamespace(output=np.arange(float(steps))), points=np.zeros((3, 3)), case=case)
    return SimpleNamespace(model=SimpleNamespace(test=test, tangents=tangents), fit=SimpleNamespace(theta=np.zeros(2)))


def test_what_our_model_knows_is_named_in_a_program_that_shows_no_structure(short_case: Case) -> None:
    u = arcs(TRUE, course(TIME))
    u[..., 2] += 0.4 * np.outer((course(TIME) / 0.03) ** 2, SHAPE["wall_taper"])
    program = twin.simulator(arcs, [STIFF, BEND])
    found = diagnosed(program, data_of(u), effects=(), seed=1, stand_ins=True, say=None, like=like(short_case))
    assert found.named == ("wall_taper",)
    assert found.mechanisms[0] is Mechanism.BODY
    assert found.start["wall_taper.mm"] == pytest.approx(0.4, abs=0.05)  # sd of a value 0.05 mm, 80 steps
    says(found.sentence, "its shape is that in our own model of a like body")


def test_effects_that_move_nothing_or_are_known_are_left_out(short_case: Case) -> None:
    data = data_of(arcs(TRUE, course(TIME)))
    names = [e.name for e in like_body_effects(like(short_case), data, ())]
    assert set(names) == set(SHAPE)
    (known,) = [e for e in like_body_effects(like(short_case), data, ()) if e.name == "wall_taper"]
    assert [e.name for e in like_body_effects(like(short_case), data, [known])] == ["eccentric_core"]


def test_a_fit_of_other_data_is_refused(short_case: Case) -> None:
    data = data_of(arcs(TRUE, course(TIME)))
    with pytest.raises(ValueError, match=f"5 steps of 3 points; wanted one to these data, of {len(TIME)} steps and {len(PLACES)}"):
        like_body_effects(like(short_case, steps=5), data, ())


def test_a_like_body_belongs_beside_a_simulator() -> None:
    with pytest.raises(ValueError, match="beside a simulator"):
        twin.diagnose(SimpleNamespace(), like=SimpleNamespace())  # type: ignore[arg-type]
