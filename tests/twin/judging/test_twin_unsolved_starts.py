"""Starts of a fit at which a model has no equilibrium."""

from typing import Any, cast

import numpy as np
import pytest

from twin.effects.protocol import Unsolvable
from twin.judging import judged
from twin.targets import Array


def test_how_far_a_model_came_is_known_where_no_start_can_be_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    def first(self: object, start: Array) -> None:
        raise Unsolvable("limit point", reached=float(start[0]))

    monkeypatch.setattr(judged._Task, "first", first)
    with pytest.raises(Unsolvable, match="limit point") as caught:
        judged.judge(cast(Any, None), cast(Any, None), starts=np.array([[0.01], [0.02], [0.0]]))
    assert caught.value.reached == 0.02  # MPa, the furthest
