"""How sure a verdict is: three grades, their thresholds, and how often names of each were right in trials."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from twin.diagnosis.hypotheses import Hypothesis

PLAIN = 15.0  # sds of an effect: of 57 unknown causes 8 had a name that all else confirmed, 1 with so many
FORETOLD = 0.01  # chance of a forecast: of 103 right names it refuted 2, of 12 of unknown causes 5


class Grade(StrEnum):
    """How sure a name is. named: its law fits without law errors, a film that was not fitted is foretold, and
    the effect is plain; likely: its law fits, but it is faint, or there is no such film; like: another law,
    one of a tie, or nothing that fits."""

    NAMED = "named"
    LIKELY = "likely"
    LIKE = "like"


@dataclass(frozen=True)
class Rate:
    """Of `n` virtual trials whose verdict had a grade, how many had the right name first, and how many the
    right mechanism."""

    n: int
    name: int
    mechanism: int

    @property
    def words(self) -> str:
        """The rates in words."""
        return (
            f"Of {self.n} virtual trials with this grade the name was right in {self.name}, the mechanism in "
            f"{self.mechanism}."
        )


RIGHT = {  # `said` of benchmarks/results/identify.json
    Grade.NAMED: Rate(n=63, name=60, mechanism=62),
    Grade.LIKELY: Rate(n=43, name=39, mechanism=43),
    Grade.LIKE: Rate(n=137, name=58, mechanism=122),
}


class Outcome(StrEnum):
    """What a film that no fit has seen says of what is named."""

    CONFIRMED = "confirmed"
    REFUTED = "refuted"
    UNTESTED = "not tested"


def outcome(without: float, beside: float) -> Outcome:
    """What a film says that a model without an effect foretells with a probability, and the one with it with
    another: where both foretell it, the film does not test the effect.

    >>> [str(outcome(*p)) for p in ((1e-9, 0.3), (0.2, 0.3), (1e-9, 1e-4))]
    ['confirmed', 'not tested', 'refuted']
    """
    if beside <= FORETOLD:
        return Outcome.REFUTED
    return Outcome.CONFIRMED if without <= FORETOLD else Outcome.UNTESTED


def grade_of(best: Hypothesis, *, alone: bool, forecasts: Sequence[float]) -> Grade:
    """The grade of the best hypothesis; alone: whether it is the only one named; forecasts: the probability
    of each film that no fit has seen, as it foretells it."""
    if not alone or not best.exact or any(p <= FORETOLD for p in forecasts):
        return Grade.LIKE
    assert best.score is not None
    return Grade.NAMED if forecasts and best.score.size >= PLAIN else Grade.LIKELY
