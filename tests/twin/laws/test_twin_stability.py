"""Drucker's test of a law, against differences of its energy and against what is known of Mooney-Rivlin rubber."""

import numpy as np
import pytest

from fe import Material
from fe.element import Array
from twin.laws.catalogue import LAWS
from twin.laws.law import RubberLaw
from twin.laws.stability import MODES, drucker_limit, stiffness

EACH = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def energy(law: RubberLaw, strain: Array) -> float:
    """W in MPa at the two first logarithmic strains (2,), of constant volume."""
    l = np.exp([*strain, -strain.sum()])  # noqa: E741
    return float(law.energy(law.nominal.named, (l**2).sum(), (l**-2.0).sum(), l))


@EACH
@pytest.mark.parametrize("mode", MODES)
def test_the_stiffness_is_the_second_derivative_of_the_energy(law: RubberLaw, mode: str) -> None:
    strain, h = np.log(1.4) * np.array(MODES[mode][:2]), 1e-4
    found = stiffness(law.nominal.material, np.exp([*strain, -strain.sum()]))
    for i, a in enumerate(h * np.eye(2)):
        for k, b in enumerate(h * np.eye(2)):
            plus = energy(law, strain + a + b) + energy(law, strain - a - b)
            minus = energy(law, strain + a - b) + energy(law, strain - a + b)
            # W of 0.1 MPa to 1e-16 over h^2: 1e-9; the fourth derivative times h^2: 1e-7
            assert (plus - minus) / (4 * h**2) == pytest.approx(found[i, k], rel=1e-5, abs=1e-6)


def test_a_negative_constant_fails_where_the_tension_is_by_two_axes() -> None:
    assert drucker_limit(Material(C10=0.2, C01=0.1), 3.0) == (3.0, "")
    limit, mode = drucker_limit(Material(C10=0.4, C01=-0.1), 3.0)
    assert mode == "equibiaxial"
    # 4 (C10 x^2 + C01 x^-2) of two axes and twice 4 (C10 x^-4 + C01 x^4) of the third add up to 0 at 1.5
    assert limit == pytest.approx(1.50, abs=0.01)  # 200 stretches up to 3


def test_beyond_gents_limit_there_is_no_stable_rubber() -> None:
    limit, _ = drucker_limit(Material(gent=(0.5, 1.0)), 3.0)
    x = limit
    assert max(x**2 + 2 / x, 2 * x**2 + x**-4) - 3 == pytest.approx(1.0, abs=0.1)
