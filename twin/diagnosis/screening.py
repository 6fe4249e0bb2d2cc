"""Signatures -> hypotheses: attainable gain, its probability by chance, and evidence to first order.

What counts is the fall of chi2 that a refit can reach: amplitudes stay within their bounds, so that an effect
that can only add gains nothing where it would have to take away. Multiplicity: Sidak over an effect's grid,
Holm over effects. Several effects together are weighed by the Gram matrix of their columns, without a solve.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import scipy
from numpy.typing import NDArray

from calibrate import holm, sidak
from twin.diagnosis.evidence import Gram, log_bayes
from twin.diagnosis.hypotheses import Hypothesis
from twin.diagnosis.signatures import Signature, Signatures, null, signatures_of
from twin.effects.protocol import Effect, Test, Theta
from twin.judging.comparison import ADEQUATE, lack_of_fit, smooth_functions
from twin.judging.judged import Judged
from twin.targets import Array, Targets

TRIED = 12  # pairs whose start is worked out: those with most evidence


def screened(judged: Judged, signatures: Signatures) -> list[Hypothesis]:
    """A hypothesis for every effect of `signatures`, its p-value adjusted for the number of tries."""
    hypotheses = [_best(judged, rows) for rows in signatures.values()]
    adjusted = iter(holm([c.p_value for c in hypotheses if not c.note]))
    return [c if c.note else replace(c, p_value=float(next(adjusted))) for c in hypotheses]


def _best(judged: Judged, rows: Sequence[Signature]) -> Hypothesis:
    """The entry of an effect's grid that gains most."""
    seen = [r for r in rows if not r.note]
    if not seen:
        return Hypothesis(effects=(rows[0].effect,), note=rows[0].note)
    grams = [r.gram(judged.z) for r in seen]
    gains = [g.attained(r.low, r.high) for g, r in zip(grams, seen, strict=True)]
    k = int(np.argmax([gain for _, gain in gains]))
    (amplitudes, gain), best = gains[k], seen[k]
    hint = _mean([g.log_bayes(r.one_sided) for g, r in zip(grams, seen, strict=True)])
    sign = np.sign(grams[k].b[0]) if len(amplitudes) == 1 else 1.0
    return Hypothesis(
        effects=(best.effect,),
        z=float(sign * np.sqrt(gain)),
        gain=gain,
        p_value=sidak(_chance(gain, best), len(seen)),
        hint=hint,
        start=start_of(judged, best, amplitudes),
    )


def _chance(gain: float, signature: Signature) -> float:
    """Probability that noise alone gains as much: chi2 with a degree of freedom for each amplitude, and half
    of it for a single one-sided one (Self & Liang 1987, doi 10.2307/2289471)."""
    if gain <= 0:
        return 1.0
    p = float(scipy.special.chdtrc(len(signature.parameters), gain))
    return p / 2 if len(signature.parameters) == 1 and signature.one_sided[0] else p


def _mean(evidences: Sequence[float]) -> float:
    """2 ln of the mean Bayes factor of equally likely entries with 2 ln B each.

    >>> round(_mean([10.0, 0.0]), 3)  # 2 ln((exp(5) + 1) / 2)
    8.627
    """
    half = np.array(evidences) / 2
    top = float(half.max())
    return 2 * (top + float(np.log(np.exp(np.maximum(half - top, -700.0)).mean())))


# -- several together ----------------------------------------------------------------------------------------


def paired(judged: Judged, signatures: Signatures) -> list[Hypothesis]:
    """Pairs of effects, one for each two names, those with most evidence to first order first."""
    rows = [r for entries in signatures.values() for r in entries if not r.note]
    if len(rows) < 2:
        return []
    every = Gram.of(judged.z, np.concatenate([r.columns for r in rows], axis=1))
    ends = np.cumsum([r.columns.shape[1] for r in rows])
    spans = [np.arange(e - r.columns.shape[1], e) for e, r in zip(ends, rows, strict=True)]
    by_names: dict[frozenset[str], list[tuple[float, tuple[int, int]]]] = {}
    for hint, (i, j) in _hints(every, rows, spans):
        by_names.setdefault(frozenset((rows[i].effect.name, rows[j].effect.name)), []).append((hint, (i, j)))
    means = ((_mean([e for e, _ in entries]), max(entries)[1]) for entries in by_names.values())
    out = []
    for hint, (i, j) in sorted(means, reverse=True)[:TRIED]:
        near = [_together(judged, pair) for pair in _about(judged, (rows[i], rows[j]))]
        out.append(replace(max(near, key=lambda h: h.gain), hint=hint))
    return out


def _about(judged: Judged, pair: Sequence[Signature]) -> Iterable[Sequence[Signature]]:
    """Signatures of several effects, and the same at the entries of the finer grids about them."""
    grids = []
    for r in pair:
        finer = r.effect.closer(r.entry, judged.model.test)
        near = signatures_of(judged, [finer])[finer.label] if finer is not None else ()
        grids.append([r, *(row for row in near if not row.note)])
    return product(*grids)


def _hints(
    gram: Gram, rows: Sequence[Signature], spans: Sequence[NDArray[np.int64]]
) -> Iterable[tuple[float, tuple[int, int]]]:
    """2 ln B of every two rows of different effects, those with as many amplitudes at once."""
    sided = np.concatenate([r.one_sided for r in rows])
    groups: dict[int, list[tuple[int, int]]] = {}
    for i, j in combinations(range(len(rows)), 2):
        if rows[i].effect.name != rows[j].effect.name:
            groups.setdefault(len(spans[i]) + len(spans[j]), []).append((i, j))
    for pairs in groups.values():
        columns = np.array([np.concatenate([spans[i], spans[j]]) for i, j in pairs])
        S = gram.S[columns[:, :, None], columns[:, None, :]]
        evidences = log_bayes(S, gram.b[columns], sided[columns])
        yield from zip(map(float, evidences), pairs, strict=True)


def _together(judged: Judged, rows: Sequence[Signature]) -> Hypothesis:
    """Signatures of several effects as one hypothesis, begun at the amplitudes that gain most together."""
    gram = Gram.of(judged.z, np.concatenate([r.columns for r in rows], axis=1))
    low, high = (np.concatenate([getattr(r, side) for r in rows]) for side in ("low", "high"))
    amplitudes, gain = gram.attained(low, high)
    ends = np.cumsum([len(r.parameters) for r in rows])[:-1]
    return Hypothesis(
        effects=tuple(r.effect.at(r.entry, judged.model.test) for r in rows),
        gain=gain,
        z=float(np.sqrt(gain)),
        start=_started(judged, list(zip(rows, np.split(amplitudes, ends), strict=True))),
    )


def added(rows: Iterable[Hypothesis], effects: tuple[Effect, ...], test: Test) -> list[Hypothesis]:
    """Effects that a judged model has, and beside them each other one of hypotheses on that, those with most
    evidence first; hint: 2 ln B of the one that is added."""
    out = [
        replace(h, effects=(*effects, h.effect.at(h.start, test)))
        for h in rows
        if not h.note and h.gain > 0 and h.effect.name not in [e.name for e in effects]
    ]
    return sorted(out, key=lambda h: -h.hint)


def fits(judged: Judged, targets: Targets, signatures: Iterable[Signature]) -> bool:
    """Whether a judged model with any of these beside it fits to first order, without law errors."""
    w, smooth = judged.whitener, smooth_functions(targets, judged.whitener)
    for r in signatures:
        amplitudes, _ = r.gram(judged.z).attained(r.low, r.high)
        left, fitted = judged.z - r.columns @ amplitudes, np.column_stack([judged.fitted, r.columns])
        if lack_of_fit(targets, w, left, fitted, smooth) > ADEQUATE:
            return True
    return False


# -- where a refit begins ------------------------------------------------------------------------------------


def start_of(judged: Judged, signature: Signature, amplitudes: Array) -> Theta:
    """Starting values of a refit: the effect at the promised size, and the fitted parameters moved along."""
    return _started(judged, [(signature, amplitudes)])


def _started(judged: Judged, parts: Iterable[tuple[Signature, Array]]) -> Theta:
    """As `start_of`, of several signatures with their amplitudes (k,)."""
    moved = np.zeros(judged.fitted.shape[1])
    out: dict[str, float] = {}
    for r, amplitudes in parts:
        moved = moved + r.moved @ amplitudes
        out |= _sizes(r, amplitudes)
    moves = iter(moved)
    values = {
        p.name: x if p.name in judged.at_bound else float(np.clip(x + next(moves), p.low, p.high))
        for p, x in zip(judged.model.parameters, judged.theta, strict=True)
    }
    return {**values, **out}


def _sizes(signature: Signature, amplitudes: Array) -> dict[str, float]:
    """The values of an effect at amplitudes (k,), none quite at null: there its other parameters, a time or
    a place, would have no derivative."""
    out = signature.values(amplitudes)
    for p in signature.parameters:
        if abs(out[p.name] - null(p)) < 0.02 * p.step:
            out[p.name] = float(np.clip(null(p) + 0.1 * p.step, p.low, p.high))
    return out
