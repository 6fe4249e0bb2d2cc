"""Start values of the fit of a model with one effect more."""

from twin.diagnosis.screening import screened
from twin.diagnosis.signatures import signatures_of
from twin.effects.protocol import Effect, Test, Theta, Unsolvable
from twin.judging.judged import Judged
from twin.model.prediction import Model

Start = dict[str, float]
HALVED = 6  # times at most


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
