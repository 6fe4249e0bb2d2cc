"""What is left out is predicted better with a right effect, and no better with a wrong one."""

import numpy as np

from twin.diagnosis.refitting import gain


def test_only_a_right_effect_gains_in_parts_left_out() -> None:
    rng = np.random.default_rng(3)
    fitted = rng.standard_normal((400, 3))
    own, part = np.array([False, False, True]), np.repeat([0, 1], 200)
    right, wrong = [], []
    for _ in range(50):
        noise = rng.standard_normal(400)
        for size, out in ((0.5, right), (0.0, wrong)):
            y = noise + size * fitted[:, 2]
            theta = np.linalg.lstsq(fitted, y, rcond=None)[0]
            out.append(gain(y - fitted @ theta, y - fitted @ (theta * ~own), fitted, fitted[:, ~own], part))
    # half a unit in 400 values of variance 1 is a fall of chi2 of about 100
    assert np.mean(np.array(right) > 25) == 1.0
    # each part pays for one parameter fitted to the other: -1 a part, on average
    assert -4 < np.mean(wrong) < 0
