"""Where a fit begins that needs its new effect to carry the test."""

from typing import Any, cast

import numpy as np
import pytest

from calibrate import Parameter
from twin.calibrated.effectstarts import carrying
from twin.effects.protocol import Unsolvable
from twin.targets import Array

CONSTANT = Parameter("C", 0.01, 1.0, "MPa")


class Walls:
    """Walls that carry 10 kPa, and 10 kPa more for each unit of what is added, up to a test of 40 kPa."""

    def __init__(self, low: float, high: float, sign: float = 1.0) -> None:
        self.parameters = (CONSTANT, Parameter("added", low, high, "N/mm", null=0.0, typical=0.1))
        self.sign, self.tried = sign, list[float]()

    def values(self, theta: Array) -> None:
        self.tried.append(theta[1])
        if (reached := 0.01 * (1 + self.sign * theta[1])) < 0.04:
            raise Unsolvable("limit point", reached=reached)

    def start(self) -> Array:
        return carrying(cast(Any, self), np.array([0.05, 0.0]), self.parameters[1:])


def test_a_start_that_does_not_carry_the_test_is_taken_where_more_of_the_effect_does() -> None:
    walls = Walls(0.0, 200.0)
    step = walls.parameters[1].step
    found = walls.start()
    assert found[0] == 0.05
    assert 3.0 <= found[1] < 6.0 + step  # the first of the doubled ones
    assert walls.tried[:3] == pytest.approx([0.0, step, 2 * step])


def test_where_none_carries_all_the_start_is_where_most_is_carried() -> None:
    assert Walls(0.0, 1.5).start()[1] == 1.5  # at its bound
    assert Walls(0.0, 200.0, sign=-1.0).start()[1] == 0.0  # more of it carries less
    assert Walls(-20.0, 20.0, sign=-1.0).start()[1] <= -3.0  # the other way
