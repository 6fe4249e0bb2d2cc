"""An absent effect under test: how much the data ask for it, and its refit where there is one."""

from dataclasses import dataclass, field, replace

from calibrate import Fit
from twin.effects.protocol import Effect, Theta
from twin.judging.comparison import Comparison
from twin.judging.judged import Fitted, Judged
from twin.model.prediction import Model
from twin.targets import Array

SURE = 0.01  # probability of the lack of fit from which on a model is adequate beyond doubt


@dataclass(frozen=True, eq=False, kw_only=True)
class Refit(Fitted):
    """What is kept of a judged model: all but its whitener, which is large, and its solves.

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
class Candidate:
    """One absent effect: what the residual promises, and what its refit keeps.

    gain: the fall of chi2 that its best entry promises, its amplitudes within their bounds; z: its root, with
    the sign of a single amplitude. p_value: of that gain by chance, after multiplicity. hint: 2 ln B to first
    order. refit: the fit with it, judged by its own errors; delta_bic: its BIC gain, evidence: 2 ln B over
    the base model (Laplace), size: the root of its fall of deviance, in sds. start: where the refit began.
    note: why it cannot be tested, or was not refitted.
    """

    effect: Effect
    z: float = 0.0
    gain: float = 0.0
    p_value: float = 1.0
    hint: float = 0.0
    note: str = ""
    start: Theta = field(default_factory=dict)
    refit: Refit | None = None
    delta_bic: float | None = None
    evidence: float | None = None
    size: float | None = None

    @property
    def fit(self) -> Fit | None:
        """The refit."""
        return self.refit.fit if self.refit else None

    @property
    def comparison(self) -> Comparison | None:
        """The comparison of the refit."""
        return self.refit.comparison if self.refit else None

    @property
    def adequate(self) -> bool:
        """Whether the refit leaves noise alone."""
        return self.refit is not None and self.refit.comparison.adequate

    @property
    def sure(self) -> bool:
        """Whether the refit leaves noise alone beyond doubt."""
        return self.refit is not None and self.refit.comparison.p_value > SURE

    @property
    def stretched(self) -> bool:
        """Whether an amplitude of the refit ends at a bound that is not its null: it would take more."""
        if self.refit is None:
            return False
        values, bound = self.refit.values, self.refit.at_bound
        ends = [p for p in self.effect.amplitudes if p.name in bound]
        return any(abs(values[p.name] - (p.null or 0.0)) > 0.5 * p.step for p in ends)

    @property
    def kind(self) -> str:
        """The kind of a stand-in; nothing for an effect of the library or of the user's."""
        return self.effect.kind

    @property
    def plausible(self) -> bool | None:
        """Whether every amplitude of the refit lies where experience expects it; None without a refit."""
        if self.refit is None:
            return None
        values = self.refit.values
        ranges = [(values[p.name], p.plausible) for p in self.effect.parameters if p.plausible]
        return all(min(low, 0.0) <= x <= high if low > 0 else low <= x <= high for x, (low, high) in ranges)
