"""The memory that a fit needs for the errors of targets, and how many steps that leaves to them."""

HELD = 7.0  # times the shared errors of all values are in memory during a fit; 9 with those of walls and laws
FILTERED = 3.0  # times the noise's filter, a matrix of all components in each step
MOST_BYTES = 3e9  # of a fit: with all that a program takes beside it, below 4 GB
MOST_STEPS = 2000  # a film of a minute
LEAST_STEPS = 50  # fewer show no course


def bytes_of(values: float, components: int, errors: int) -> float:
    """Memory in bytes of a fit: so many values, of so many components (a point's axis), share errors.

    >>> round(bytes_of(424 * 24, 24, 357) / 1e6)  # of the demo
    209
    """
    return 8.0 * values * (HELD * errors + FILTERED * components)


def steps_held(components: int, errors: int, *, rest: int, parts: int = 1) -> int:
    """Number of evenly spaced steps of a recording, besides `rest` of its reference, that a fit holds.

    components: values in each step.   errors: shared ones in all parts.   parts: recordings that are fitted
    together, as long as this.

    >>> steps_held(24, 357, rest=54), steps_held(200, 1600, rest=54)
    (2000, 104)
    """
    step = parts * bytes_of(components, components, errors)
    return min(max(int(MOST_BYTES / max(step, 1.0)) - rest, LEAST_STEPS), MOST_STEPS)
