"""An absent effect under test: how much the data ask for it, and its refit where there is one."""

from dataclasses import dataclass, field
from typing import Any

from calibrate import Fit
from twin.diagnosis.comparison import Comparison
from twin.effects.protocol import Effect, Theta


@dataclass(frozen=True)
class Candidate:
    """One absent effect: its score z, p-value after multiplicity, and, where refitted, its fit and BIC
    gain."""

    effect: Effect
    z: float
    p_value: float
    note: str = ""
    fit: Fit | None = None
    comparison: Comparison | None = None
    delta_bic: float | None = None
    start: Theta = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """One row of the ranking in diagnosis.json."""
        parameters = {}
        if self.fit is not None:
            rows = zip(self.fit.parameters, self.fit.theta, self.fit.sd, strict=True)
            parameters = {p.name: {"value": float(x), "sd": float(s), "unit": p.unit} for p, x, s in rows}
        return {
            "effect": self.effect.name,
            "law": self.effect.label,
            "z": self.z,
            "p_value": self.p_value,
            "delta_bic": self.delta_bic,
            "adequate": self.comparison.adequate if self.comparison else None,
            "parameters": parameters,
            "note": self.note,
        }
