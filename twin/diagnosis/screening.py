"""Signatures -> candidates: what each absent effect could gain, and how likely chance gives that.

What counts is the fall of chi2 that a refit can reach: amplitudes stay within their bounds, so that an effect
that can only add gains nothing where it would have to take away. Multiplicity: Sidak over an effect's grid,
Holm over effects.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from calibrate import holm, sidak
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.signatures import Signature, Signatures, null
from twin.effects.protocol import Theta
from twin.judging.judged import Judged
from twin.targets import Array


def screened(judged: Judged, signatures: Signatures) -> list[Candidate]:
    """A candidate for every effect of `signatures`, its p-value adjusted for the number of tries."""
    found = [_best(judged, rows) for rows in signatures.values()]
    adjusted = iter(holm([c.p_value for c in found if not c.note]))
    return [c if c.note else replace(c, p_value=float(next(adjusted))) for c in found]


def _best(judged: Judged, rows: Sequence[Signature]) -> Candidate:
    """The entry of an effect's grid that gains most."""
    seen = [r for r in rows if not r.note]
    if not seen:
        return Candidate(effect=rows[0].effect, note=rows[0].note)
    grams = [r.gram(judged.z) for r in seen]
    gains = [g.attained(r.low, r.high) for g, r in zip(grams, seen, strict=True)]
    k = int(np.argmax([gain for _, gain in gains]))
    (amplitudes, gain), best = gains[k], seen[k]
    evidences = np.array([g.log_bayes(r.one_sided) for g, r in zip(grams, seen, strict=True)]) / 2
    top = float(evidences.max())
    hint = 2 * (top + np.log(np.exp(np.maximum(evidences - top, -700.0)).mean()))
    sign = np.sign(grams[k].b[0]) if len(amplitudes) == 1 else 1.0
    return Candidate(
        effect=best.effect,
        z=float(sign * np.sqrt(gain)),
        gain=gain,
        p_value=sidak(_chance(gain, best), len(seen)),
        hint=float(hint),
        start=start_of(judged, best, amplitudes),
    )


def _chance(gain: float, signature: Signature) -> float:
    """Probability that noise alone gains as much: chi2 with a degree of freedom for each amplitude, and half
    of it for a single one-sided one (Self & Liang 1987, doi 10.2307/2289471)."""
    if gain <= 0:
        return 1.0
    p = float(chdtrc(len(signature.parameters), gain))
    return p / 2 if len(signature.parameters) == 1 and signature.one_sided[0] else p


def start_of(judged: Judged, signature: Signature, amplitudes: Array) -> Theta:
    """Where a refit begins: the effect at the promised size, and the fitted parameters where they then go."""
    sizes = signature.values(amplitudes)
    for p in signature.parameters:
        if abs(sizes[p.name] - null(p)) < 0.02 * p.step:  # at null, what it needs beside it would be lost
            sizes[p.name] = float(np.clip(null(p) + 0.1 * p.step, p.low, p.high))
    moves = iter(signature.moved @ amplitudes)
    values = {
        p.name: x if p.name in judged.at_bound else float(np.clip(x + next(moves), p.low, p.high))
        for p, x in zip(judged.model.parameters, judged.theta, strict=True)
    }
    return {**values, **sizes}
