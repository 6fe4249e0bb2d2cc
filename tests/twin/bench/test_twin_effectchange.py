"""Which effects in a model the data do not ask for."""

import pytest

from calibrate import Parameter
from twin.bench.effectchange import _at_null
from twin.judging.fitrecord import Estimate

SIZE = Parameter("creep.g1", 0.0, 0.5, null=0.0, typical=0.01)
FACTOR = Parameter("camera_scale.scale", 0.5, 1.5, null=1.0, typical=0.01)


@pytest.mark.parametrize(
    ("parameter", "value", "low", "high", "absent"),
    [
        (SIZE, 0.03, 0.02, 0.04, False),
        (SIZE, 0.01, 0.0, 0.03, True),  # cut at the bound
        (FACTOR, 1.01, 0.99, 1.03, True),
        (FACTOR, 1.02, 1.01, 1.03, False),
        (SIZE, 0.0, None, None, True),  # at the bound, where it is absent: no interval
        (SIZE, 0.5, None, None, False),  # at the other one
    ],
)
def test_an_effect_may_be_absent_where_its_interval_holds_that(
    parameter: Parameter, value: float, low: float | None, high: float | None, absent: bool
) -> None:
    assert _at_null(parameter, {parameter.name: Estimate(value=value, low=low, high=high)}) is absent
