"""All hypotheses -> the decision: the missing effect, its equals in these data, or none that explains them.

One decision for all: the hypothesis with the highest evidence, and every one that is not behind it by TIE in
both evidence and BIC. `none of these` where a stand-in of another kind is ahead by as much, or where nothing
of the named is adequate under any law errors. So a wrong name needs a wrong model that fits.
docs/how-it-decides.md says what fixes each constant.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from twin.diagnosis.classes import Mimics
from twin.diagnosis.explanation import EvidenceRecord
from twin.diagnosis.grades import Grade
from twin.diagnosis.hypotheses import Hypothesis, Refit, ranked
from twin.diagnosis.lawresidual import LawResidual
from twin.diagnosis.shortlist import DETECTED, SHARE
from twin.diagnosis.sizes import Detectable
from twin.effects.labels import AND
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Effect, Theta
from twin.experiments.choice import Experiment
from twin.judging.comparison import Comparison
from twin.judging.fitrecord import Estimate
from twin.judging.frame import FrameTest
from twin.judging.intervals import estimates, united
from twin.judging.judged import Judged

TIE = 6.0  # 2 ln B: below it neither of two models is preferred (Kass & Raftery 1995, doi 10.2307/2291091)
SECOND = 25.0  # by which several together must be ahead of every single one
NONE = "none of these"  # the verdict where nothing of the library explains the data
POWER = 0.9  # with which a size must be found to be named


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The result of `diagnose`: verdict, named effects, ties, ranking, next test, and the errors in mm.

    named: the best hypothesis' effects, `effects` in their laws; tied: every hypothesis of the verdict, the
    best first, stand-ins last, and where nothing is named the nearest; groups: those of several effects,
    whether named or not; kept: the best one's fit, and where it began (`start`). grade: how sure the names
    are, `sure` in words; foretold: by block that no fit has seen, the probability of its forecast.
    """

    verdict: str
    sentence: str
    named: tuple[str, ...] = ()
    effects: tuple[Effect, ...] = ()
    ties: tuple[tuple[str, ...], ...] = ()
    tied: tuple[Hypothesis, ...] = ()
    ranking: tuple[Hypothesis, ...] = ()
    resembles: tuple[Hypothesis, ...] = ()
    classes: tuple[Mimics, ...] = ()
    groups: tuple[Hypothesis, ...] = ()
    next_test: str = ""
    next_tests: tuple[Experiment, ...] = ()
    detectable: tuple[Detectable, ...] = ()
    scaling: Mapping[str, float] = field(default_factory=dict)
    evidence: EvidenceRecord | None = None
    frame: FrameTest | None = None
    base: Judged | None = None
    kept: Judged | Refit | None = None
    start: Theta = field(default_factory=dict)
    law_left: LawResidual | None = None
    grade: Grade | None = None
    sure: str = ""
    foretold: Mapping[int, float] = field(default_factory=dict)

    @property
    def nearest(self) -> tuple[str, ...]:
        """The effects that come nearest, named or not, each physics as a verdict joins it."""
        return tuple(h.physics for h in self.tied if not h.kind)

    @property
    def mechanisms(self) -> tuple[Mechanism, ...]:
        """The mechanisms of what is named, that of the best first; where nothing is, of what explains most:
        an effect or a stand-in."""
        near = self.tied
        if self.verdict == NONE:
            near = _leading([*near, *self.resembles])
        return tuple(dict.fromkeys(e.mechanism for h in near for e in h.effects))

    @property
    def shared(self) -> dict[str, Estimate]:
        """The parameters that all have which a tie names, whichever of them it is."""
        fits = [self.kept, *(h.refit for h in self.tied[1:] if not h.kind)]
        if not self.ties or any(fit is None for fit in fits):
            return {}
        return united([estimates(fit.fit, fit.comparison) for fit in fits if fit is not None])

    @property
    def law(self) -> str | None:
        """The labels of the named effects, as twin.toml writes them."""
        return AND.join(e.label for e in self.effects) or None

    @property
    def before(self) -> Comparison | None:
        """The comparison of the base model."""
        return self.base.comparison if self.base else None

    @property
    def after(self) -> Comparison | None:
        """The comparison with the named effects; of the base model where nothing is named."""
        return self.kept.comparison if self.kept else self.before


@dataclass(frozen=True, kw_only=True)
class Decision:
    """A decision. needed: whether the data ask for anything; named: the best hypothesis and those that
    cannot be told from it, stand-ins among them; weak: whether the best is too small to be named; unknown:
    whether none of these explains the data; least: the size in sds that is found reliably."""

    needed: bool = True
    named: tuple[Hypothesis, ...] = ()
    weak: bool = False
    unknown: bool = False
    least: float = 0.0


def decided(base: Judged, rows: Sequence[Hypothesis]) -> Decision:
    """The decision on all hypotheses on a base model."""
    fitted = [h for h in ranked(list(rows)) if h.score is not None and h.score.much > 0]
    fitted = [h for h in fitted if not base.comparison.adequate or h.p_value < DETECTED]
    effects, stand_ins = [h for h in fitted if not h.kind], [h for h in fitted if h.kind]
    least = reliable(sum(not h.note and len(h.effects) == 1 and not h.kind for h in rows))
    if not effects:
        wrong = not base.comparison.adequate
        return Decision(needed=wrong, unknown=wrong, least=least)
    singles = _by_physics([h for h in effects if len(h.effects) == 1])
    several = [h for h in _by_physics([h for h in effects if len(h.effects) > 1]) if _earned(h, singles)]
    contenders = several or singles
    best = contenders[0]
    others = [s for s in stand_ins if s.kind not in [e.generic for e in best.effects]]
    tied = sorted((h for h in contenders if close(h, best)), key=doubts)
    mimics = _by_kind([s for s in others if s.adequate and close(s, best)])
    unknown = any(ahead(s, best) for s in others) or not any(h.adequate for h in tied)
    assert best.score is not None
    weak = best.score.size < least or best.score.much < TIE
    return Decision(named=(*tied, *mimics), weak=weak, unknown=unknown, least=least)


def reliable(tries: int) -> float:
    """The size in sds from which on an effect among `tries` is found with probability POWER (Bonferroni).

    >>> round(reliable(1), 2), round(reliable(25), 2)
    (3.86, 4.82)
    """
    return float(-scipy.special.ndtri(DETECTED / 2 / max(tries, 1)) + scipy.special.ndtri(POWER))


def doubts(h: Hypothesis) -> tuple[bool, bool, bool, int]:
    """What speaks against one of several that the data cannot tell apart, the gravest first: it does not fit,
    its size is not plausible, it is pressed against a bound, and how many numbers it takes."""
    return (not h.adequate, h.plausible is False, h.at_outer_bound, sum(len(e.parameters) for e in h.effects))


def close(a: Hypothesis, b: Hypothesis) -> bool:
    """True if these data cannot tell a from b, which is better: two are told apart only where the evidence,
    which knows what sizes are plausible, and the BIC, which knows nothing of sizes, both say so."""
    return not ahead(b, a)


def ahead(a: Hypothesis, b: Hypothesis) -> bool:
    """True if a is better than b by TIE on both scales.

    >>> from twin.diagnosis.hypotheses import Score
    >>> def scored(evidence, bic_gain):
    ...     score = Score(evidence=evidence, delta_bic=bic_gain, size=5.0, law=0.0, p_value=0.5)
    ...     return Hypothesis(effects=(), score=score)
    >>> creep, gravity, tube = scored(40.0, 38.0), scored(30.0, 29.0), scored(37.0, 20.0)
    >>> ahead(creep, gravity), ahead(creep, tube), close(tube, creep)
    (True, False, True)
    """
    assert a.score is not None
    assert b.score is not None
    return min(a.score.evidence - b.score.evidence, a.score.delta_bic - b.score.delta_bic) >= TIE


def _leading(rows: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """What explains most, and what cannot be told from it: by evidence where any fits; else half by that, in
    which the largest law errors forgive most, and half by the fall of deviance without any."""
    if any(h.adequate for h in rows):
        best = ranked(list(rows))
        return tuple(h for h in best if close(h, best[0]))
    much = [-np.inf if h.score is None else (h.score.evidence + h.score.size**2) / 2 for h in rows]
    return tuple(rows[k] for k in np.argsort(much)[::-1] if max(much) - much[k] < TIE)


def _by_physics(rows: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Each physics, best first: of its laws the best that is adequate, with the score of the best of all."""
    laws: dict[frozenset[str], list[Hypothesis]] = {}
    for h in ranked(list(rows)):
        laws.setdefault(frozenset(h.names), []).append(h)
    best = [_as_good(next((h for h in rows if h.adequate), rows[0]), rows) for rows in laws.values()]
    return list(ranked(best))


def _as_good(h: Hypothesis, laws: Sequence[Hypothesis]) -> Hypothesis:
    """The hypothesis with the evidence and BIC gain of the best of these laws."""
    scores = [law.score for law in laws if law.score is not None]
    best, most = max(s.evidence for s in scores), max(s.delta_bic for s in scores)
    return h if h.score is None else replace(h, score=replace(h.score, evidence=best, delta_bic=most))


def _by_kind(rows: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The best stand-in of each kind."""
    best: dict[str, Hypothesis] = {}
    for h in ranked(list(rows)):
        best.setdefault(h.kind, h)
    return list(best.values())


def _earned(h: Hypothesis, singles: Sequence[Hypothesis]) -> bool:
    """True if several effects together are far ahead of every single one, and each predicts parts that were
    left out of the fit. What a single law leaves grows with its effect, so that a second one that only takes
    it up may be far ahead, too: it leads by a small share, and does not fit either."""
    assert h.score is not None
    evidence = max((s.score.evidence for s in singles if s.score), default=0.0)
    bic_gain = max((s.score.delta_bic for s in singles if s.score), default=0.0)
    lead = min(h.score.evidence - evidence, h.score.delta_bic - bic_gain)
    far = lead > (SECOND if h.exact else max(SECOND, SHARE * evidence))
    return far and all(x > 0 for x in h.score.held_out.values())
