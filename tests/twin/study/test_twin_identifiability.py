"""What calibrate says of constants that end at their bounds."""

import numpy as np
import pytest

from calibrate import Fit, Parameter, least_squares
from twin.study.identifiability import at_all_bounds

BOTH = (Parameter("C10", 0.01, 1.0, "MPa"), Parameter("C01", 0.0, 0.5, "MPa"))


def fit(*wanted: float) -> Fit:
    """Towards these values, within the bounds."""
    return least_squares(lambda x: x - np.array(wanted), lambda x: np.eye(2), BOTH, start=[0.3, 0.1], seed=0)


@pytest.mark.parametrize(("wanted", "way"), [((9.0, 9.0), "stiffest"), ((-9.0, -9.0), "softest")])
def test_all_constants_at_one_end_raise_the_question_of_units(wanted: tuple[float, float], way: str) -> None:
    said = at_all_bounds(fit(*wanted))
    assert f"All constants end at the {way} that [calibrate] bounds allow: are pressures in MPa" in said


@pytest.mark.parametrize("wanted", [(0.2, 0.08), (9.0, 0.08), (9.0, -9.0), (0.2, -9.0)])
def test_one_constant_at_its_bound_or_at_opposite_ends_raises_none(wanted: tuple[float, float]) -> None:
    assert at_all_bounds(fit(*wanted)) == ""
