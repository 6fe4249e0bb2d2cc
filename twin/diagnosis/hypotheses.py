"""Hypotheses on what a model lacks: effects in their laws, stand-ins, or several effects together."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from calibrate import Fit
from twin.effects.labels import AND
from twin.effects.protocol import Effect, Theta
from twin.judging.comparison import ADEQUATE, Comparison
from twin.judging.judged import Fitted, Judged
from twin.model.prediction import Model
from twin.targets import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Refit(Fitted):
    """A judged model without its whitener and its solves, which are large.

    z (n,): whitened residual; fitted (n, f): whitened derivatives by the free parameters; deviance: chi2 + ln
    det of the data's covariance.
    """

    comparison: Comparison
    z: Array
    fitted: Array
    deviance: float

    @staticmethod
    def of(judged: Judged) -> "Refit":
        """The record of a judged model."""
        return Refit(
            model=_without_solves(judged.model),
            fit=judged.fit,
            comparison=judged.comparison,
            z=judged.z,
            fitted=judged.fitted,
            deviance=judged.deviance,
        )


def _without_solves(model: Model) -> Model:
    """The same model with nothing in its memory."""
    return replace(model, parent=_without_solves(model.parent) if model.parent is not None else None)


@dataclass(frozen=True, kw_only=True)
class Score:
    """Gains of a refit over the base, averaged over the sizes of law errors.

    evidence: 2 ln B (Laplace); delta_bic: the BIC gain; size: the root of the fall of deviance without law
    errors, in sds. law: the size of the laws' errors that the data ask for, as a share of what the effects
    add; p_value: of the lack of fit there, p_exact without law errors. held_out: of several effects the fall
    of chi2 that each brings in parts that are left out. near: whether the response gave them, near a solve.
    """

    evidence: float
    delta_bic: float
    size: float
    law: float
    p_value: float
    p_exact: float = 0.0
    held_out: Mapping[str, float] = field(default_factory=dict)
    near: bool = False

    @property
    def much(self) -> float:
        """The larger of evidence and BIC gain."""
        return max(self.evidence, self.delta_bic)


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Effects that are missing, one or several, or a stand-in: what the residual promises, what a refit says.

    gain: the fall of chi2 that its best entry promises, its amplitudes within their bounds; z: its root, with
    the sign of a single amplitude. p_value: of that gain by chance, after multiplicity. hint: 2 ln B to first
    order. start: where its refit begins, or would go on. refit: the fit with it, and its score. note: why it
    cannot be tested, or was not refitted.
    """

    effects: tuple[Effect, ...]
    z: float = 0.0
    gain: float = 0.0
    p_value: float = 1.0
    hint: float = 0.0
    note: str = ""
    start: Theta = field(default_factory=dict)
    refit: Refit | None = None
    score: Score | None = None

    @property
    def effect(self) -> Effect:
        """The first of its effects."""
        return self.effects[0]

    @property
    def names(self) -> tuple[str, ...]:
        """The effects' names."""
        return tuple(e.name for e in self.effects)

    @property
    def physics(self) -> str:
        """The missing physics whatever its law: names as a verdict joins them."""
        return AND.join(self.names)

    @property
    def label(self) -> str:
        """Its effects in their laws, as twin.toml writes them."""
        return AND.join(e.label for e in self.effects)

    @property
    def kind(self) -> str:
        """The kind of a stand-in; nothing for effects of the library or of the user's."""
        return self.effect.kind

    @property
    def fit(self) -> Fit | None:
        """The refit's fit."""
        return self.refit.fit if self.refit else None

    @property
    def comparison(self) -> Comparison | None:
        """The comparison of the refit, without law errors."""
        return self.refit.comparison if self.refit else None

    @property
    def evidence(self) -> float | None:
        """2 ln B over the base; None without a refit."""
        return self.score.evidence if self.score else None

    @property
    def delta_bic(self) -> float | None:
        """BIC gain over the base; None without a refit."""
        return self.score.delta_bic if self.score else None

    @property
    def adequate(self) -> bool:
        """True if the refit leaves noise alone, under the law errors that the data ask for, with no amplitude
        that would go beyond its bound."""
        return self.score is not None and self.score.p_value > ADEQUATE and not self.at_outer_bound

    @property
    def exact(self) -> bool:
        """True if it is adequate, and as much so without law errors."""
        return self.adequate and self.score is not None and self.score.p_exact > ADEQUATE

    @property
    def at_outer_bound(self) -> bool:
        """True if an amplitude of the refit ends at a bound that is not its null."""
        if self.refit is None:
            return False
        values, bound = self.refit.values, self.refit.at_bound
        ends = [p for e in self.effects for p in e.amplitudes if p.name in bound]
        return any(abs(values[p.name] - (p.null or 0.0)) > 0.5 * p.step for p in ends)

    @property
    def plausible(self) -> bool | None:
        """True if every amplitude of the refit lies in its plausible range; None without a refit."""
        if self.refit is None:
            return None
        values = self.refit.values
        ranges = [(values[p.name], p.plausible) for e in self.effects for p in e.parameters if p.plausible]
        return all(min(low, 0.0) <= x <= high if low > 0 else low <= x <= high for x, (low, high) in ranges)

    @property
    def words(self) -> str:
        """The refit of a stand-in in words, "0.18 N near the tip, pointing up"; of effects their
        sentences."""
        values = self.refit.values if self.refit else self.start
        resembles: Any = getattr(self.effect, "resembles", None)
        return str(resembles(values)) if resembles else "; ".join(e.sentence for e in self.effects)


def ranked(rows: list[Hypothesis] | tuple[Hypothesis, ...]) -> tuple[Hypothesis, ...]:
    """Hypotheses by their evidence; those without a refit by what they promise."""
    return tuple(sorted(rows, key=lambda h: (h.evidence is None, -(h.evidence or 0.0), -h.hint, -h.gain)))
