"""An absent effect under test: how much the data ask for it, and its refit where there is one."""

from dataclasses import dataclass, field
from typing import Any

from calibrate import Fit
from twin.diagnosis.comparison import Comparison
from twin.diagnosis.intervals import estimates
from twin.effects.protocol import Effect, Theta


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One absent effect: its score z, p-value after multiplicity, and, where refitted, its fit and BIC gain.

    comparison: of the refit under the base model's errors, by which all are judged alike. settled: of the fit
    that is given out, under the errors at its own parameters; the kept effect has one. start: where the fit
    began.
    """

    effect: Effect
    z: float
    p_value: float
    note: str = ""
    fit: Fit | None = None
    comparison: Comparison | None = None
    settled: Comparison | None = None
    delta_bic: float | None = None
    start: Theta = field(default_factory=dict)

    @property
    def final(self) -> Comparison | None:
        """The comparison that belongs to `fit`."""
        return self.settled or self.comparison

    def to_dict(self) -> dict[str, Any]:
        """One row of the ranking in diagnosis.json."""
        parameters = {}
        if self.fit is not None and self.final is not None:
            parameters = {e.name: e.to_dict() for e in estimates(self.fit, self.final)}
        return {
            "effect": self.effect.name,
            "law": self.effect.label,
            "z": self.z,
            "p_value": self.p_value,
            "delta_bic": self.delta_bic,
            "adequate": self.final.adequate if self.final else None,
            "parameters": parameters,
            "note": self.note,
        }
