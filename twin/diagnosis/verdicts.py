"""A ranking of refitted effects -> the verdict: which is missing, what cannot be told, what to film next."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibrate import Fit
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.comparison import Comparison
from twin.effects.protocol import Effect

TIE = 6.0  # BIC
# Of the misfit: right physics, wrong law. Measured: 0.88 on the demo's film, where two terms stand for three;
# 0.2 to 0.3 for a tube that pulls the tip (tests/twin/diagnosis/test_twin_diagnose.py).
EXPLAINED = 0.8

ANY_TWO = "repeat the film with a 60 s hold and a 0.2 s step"  # the next test where effects name none


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What the data ask for: verdict, named effects, ties, ranking, next test, and the errors in mm."""

    verdict: str
    sentence: str
    named: tuple[str, ...] = ()
    law: str | None = None
    ties: tuple[tuple[str, ...], ...] = ()
    ranking: tuple[Candidate, ...] = ()
    next_test: str = ""
    base: Comparison | None = None
    base_fit: Fit | None = None
    kept: Candidate | None = None
    explained: float | None = None
    remainder_mm: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """What diagnosis.json holds."""
        after = self.kept.final if self.kept else self.base
        return {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "named": list(self.named),
            "law": self.law,
            "ties": [list(t) for t in self.ties],
            "ranking": [c.to_dict() for c in self.ranking],
            "next_test": self.next_test,
            "rms_before_mm": self.base.rms_mm if self.base else None,
            "rms_after_mm": after.rms_mm if after else None,
            "noise_sd_mm": self.base.noise_sd_mm if self.base else None,
            "adequate": after.adequate if after else None,
            "p_value_before": self.base.p_value if self.base else None,
            "p_value_after": after.p_value if after else None,
            "explained": self.explained,
            "discretisation_remainder_mm": self.remainder_mm,
        }


def ranked(rows: Sequence[Candidate]) -> tuple[Candidate, ...]:
    return tuple(
        sorted(rows, key=lambda c: (-(c.delta_bic if c.delta_bic is not None else -np.inf), -abs(c.z)))
    )


def concluded(rows: tuple[Candidate, ...], base: Comparison, fit: Fit, remainder: float | None) -> Diagnosis:
    best = rows[0] if rows and rows[0].delta_bic is not None and rows[0].delta_bic > TIE else None
    if best is not None and best.comparison is not None:
        found = _judged(rows, best, base, best.comparison)
    elif base.adequate:
        found = Diagnosis(
            verdict="none needed",
            sentence="The model agrees with the measurement: no effect is missing.",
        )
    else:
        found = Diagnosis(
            verdict="none of these",
            sentence="Something is missing that the library does not have: no effect lowers the error.",
        )
    blind = [c.effect.name for c in rows if c.note]
    unseen = f" Not visible in these data: {', '.join(blind)}." if blind else ""
    return replace(
        found,
        sentence=found.sentence + unseen,
        ranking=rows,
        base=base,
        base_fit=fit,
        remainder_mm=remainder,
    )


def _judged(rows: tuple[Candidate, ...], best: Candidate, base: Comparison, after: Comparison) -> Diagnosis:
    """The verdict on the best effect, whose refit leaves `after`."""
    explained = 1 - max(after.excess, 0.0) / max(base.excess, 1.0)
    name, law = best.effect.name, best.effect.label
    left = (best.final or after).rms_mm
    change = (
        f"With {law} the error falls from {base.rms_mm:.3f} to {left:.3f} mm rms; the noise is "
        f"{base.noise_sd_mm:.3f} mm."
    )
    named = Diagnosis(
        verdict=name, sentence="", named=(name,), law=law, kept=best, explained=explained
    )
    tied = [c.effect for c in rows[1:] if _tied(c, best)]
    if after.adequate and tied:
        names = (name, *dict.fromkeys(e.name for e in tied))
        test = next_test(best.effect, tied[0])
        sentence = f"These data cannot tell {' from '.join(names)}. {change}"
        verdict = f"{' or '.join(names)}: run test {test}"
        return replace(named, verdict=verdict, sentence=sentence, ties=(names,), next_test=test)
    if after.adequate:
        return replace(named, sentence=f"{name} is missing. {_capital(best.effect.sentence)}. {change}")
    if explained > EXPLAINED:
        sentence = (
            f"{name} is the missing physics. {_capital(best.effect.sentence)}. "
            f"Its law is not exactly that of the library. {change}"
        )
        return replace(named, verdict="right physics, wrong law", sentence=sentence)
    sentence = (
        f"Something is missing that the library does not have. The model is wrong by {base.rms_mm:.3f} mm "
        f"rms, and {name}, the best effect of the library, explains {100 * explained:.0f} % of it."
    )
    return Diagnosis(verdict="none of these", sentence=sentence, explained=explained)


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def next_test(one: Effect, other: Effect) -> str:
    """The test that tells two effects apart, as either of them names it."""
    return one.separations.get(other.name) or other.separations.get(one.name) or ANY_TWO


def _tied(c: Candidate, best: Candidate) -> bool:
    if c.delta_bic is None or best.delta_bic is None or c.effect.name == best.effect.name:
        return False
    return best.delta_bic - c.delta_bic < TIE
