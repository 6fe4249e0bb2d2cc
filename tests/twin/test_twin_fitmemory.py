"""The steps that a fit holds: no more memory than stated, however many points, errors and recordings."""

import pytest

from twin.fitmemory import LEAST_STEPS, MOST_BYTES, MOST_STEPS, bytes_of, steps_held


@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize(("components", "errors"), [(24, 357), (96, 1269), (200, 1700), (300, 1), (300, 300)])
def test_so_many_steps_take_no_more_memory_than_stated_and_one_more_would(components: int, errors: int, parts: int) -> None:
    rest = 30
    steps = steps_held(components, errors, rest=rest, parts=parts)
    held, more = (bytes_of(parts * (steps + rest + k) * components, components, errors) for k in (0, 1))
    assert held <= MOST_BYTES or steps == LEAST_STEPS
    assert more > MOST_BYTES or steps == MOST_STEPS


def test_a_film_of_few_markers_keeps_all_that_are_asked_for_and_none_keeps_too_few() -> None:
    assert steps_held(24, 357, rest=54) == MOST_STEPS
    assert steps_held(0, 0, rest=0) == MOST_STEPS
    assert steps_held(3000, 20000, rest=54) == LEAST_STEPS
