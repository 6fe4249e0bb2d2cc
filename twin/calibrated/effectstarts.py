"""Start values of the fit of a model with one effect more."""

from collections.abc import Sequence

import numpy as np

from calibrate import Parameter
from twin.diagnosis.screening import screened
from twin.diagnosis.signatures import signatures_of
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.judging.judged import Judged
from twin.model.prediction import Model
from twin.targets import Array

Start = dict[str, float]
HALVED = 6  # times at most
DOUBLED = 10  # times at most


def begun(now: Judged, chosen: Effect) -> tuple[Effect, Start]:
    """The effect and start values of its fit.

    They are those of its narrowest law, at the size and the entry of its tries that lower chi2 most to first
    order, carried on to the wider laws.
    """
    laws, test = chosen.laws(), now.model.test
    law = laws[0] if chosen.label in [narrower.label for narrower in laws] else chosen
    (screening,) = screened(now, signatures_of(now, [law]))
    values = dict(screening.start) or {**now.values, **nominal(law, test)}
    if chosen.label == law.label:
        return law.at(values, test), _within(now, chosen, values)
    for wider in laws[1:]:
        values = dict(wider.start(values))
        if wider.label == chosen.label:
            break
    return chosen, _within(now, chosen, values)


def _within(now: Judged, e: Effect, values: Start) -> Start:
    """The values, the effect's amplitudes halved towards null until a model can be made with them: where
    several are large at once, walls may close or all of the stiffness relax."""
    model = now.model.with_effect(e)
    for _ in range(HALVED):
        try:
            model.put(values)
            return values
        except Unsolvable:
            values = values | {p.name: ((p.null or 0.0) + values[p.name]) / 2 for p in e.amplitudes}
    return values


def nominal(e: Effect, test: Test) -> Start:
    """Default start values of an effect: half a typical step from null, or the middle of its tries."""
    half = {p.name: (p.null or 0.0) + 0.5 * p.step for p in e.parameters}
    tried = e.tries(test)
    starts = {p.name: p.start for p in e.parameters if p.start is not None}
    return {**half, **starts, **tried[len(tried) // 2]}


def begun_from(model: Model, fitted: Theta, start: Theta) -> dict[str, float]:
    """Start values beside fitted ones (`start` counts first); where the rubber is not stable with these, the
    fitted ones count first."""
    values = {**fitted, **start}
    return values if model.allowed(values) else {**start, **fitted}


def carrying(model: Model, theta: Array, added: Sequence[Parameter]) -> Array:
    """A start (d,) that carries more of the test than theta (d,): with the amplitudes `added` doubled from a
    typical step on to either side, the first that carries all, else that which carries most."""
    rows = [k for k, p in enumerate(model.parameters) if p in added]
    null, low, high, step = (
        np.array([getattr(p, name) for p in added], float) for name in ("null", "low", "high", "step")
    )
    best, most = theta, _carried(model, theta)
    for side in (1.0, -1.0):
        for k in range(DOUBLED):
            if most == np.inf:
                return best
            tried = theta.copy()
            tried[rows] = np.clip(null + side * step * 2.0**k, low, high)
            reached = -np.inf if np.array_equal(tried[rows], null) else _carried(model, tried)
            best, most = (tried, reached) if reached > most else (best, most)
    return best


def _carried(model: Model, theta: Array) -> float:
    """The pressure in MPa that a model carries at theta (d,); infinite where that is all of its test."""
    try:
        model.values(theta)
    except Unsolvable as why:
        return why.reached
    return np.inf
