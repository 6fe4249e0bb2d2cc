"""Where the measured markers are drawn on the finger at top pressure."""

import numpy as np

from twin.commands.review import with_aside


def test_a_marker_that_one_camera_saw_is_drawn_and_one_that_was_covered_not() -> None:
    seen = np.array([[1.0, np.nan, 2.0], [np.nan, np.nan, np.nan], [1.0, 3.0, 2.0]])
    found = with_aside(seen, np.full((3, 3), 0.5))
    assert found[0].tolist() == [1.0, 0.5, 2.0]
    assert np.isnan(found[1, [0, 2]]).all()
    assert found[2].tolist() == [1.0, 3.0, 2.0]
