"""A film's clock against the pressure log's."""

from dataclasses import replace

import numpy as np

from twin.contract.specimen import small_test
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.effects.measurement import shifted
from twin.model.prediction import Model, respond


def test_a_log_is_shifted_by_smooth_curves_and_not_at_all_by_nothing() -> None:
    time = np.linspace(0.0, 10.0, 201)
    values = np.sin(time)
    np.testing.assert_array_equal(shifted(time, values, 0.0), values)
    for shift in (0.13, -0.27):
        late = shifted(time, values, shift)
        inside = (time > 0.4) & (time < 9.6)
        # cubics through points 0.05 apart with slopes to second order
        np.testing.assert_allclose(late[inside], np.sin(time - shift)[inside], rtol=0, atol=3e-5)
        edge = 0 if shift > 0 else -1
        assert late[edge] == values[edge]  # beyond the log it is as at its end
    corner = np.maximum(time - 5.0, 0.0)
    slopes = [(shifted(time, corner, h) - corner) / h for h in (1e-7, -1e-7)]
    np.testing.assert_allclose(slopes[0][:-1], slopes[1][:-1], rtol=0, atol=1e-4)  # the log ends at the last


def test_a_static_model_is_seen_as_much_later() -> None:
    test, shift = small_test(), 0.1  # of the film, which has a log every 0.1 s
    model = Model(test, (Elasticity(), effect("time_shift")), np.array([0]))
    values = {"C10": 0.2, "C01": 0.1, "time_shift.s": shift}
    late = respond(model.put(values), (), start=None)[0]
    earlier = replace(test.path, output=test.path.output[1:] - shift)
    at = respond(replace(model.put({**values, "time_shift.s": 0.0}), path=earlier), (), start=None)[0]
    # levels of the curve over pressure differ in the last bits only
    np.testing.assert_allclose(late[1:], at, rtol=0, atol=1e-6)
