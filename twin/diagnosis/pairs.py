"""Two missing effects at once: all pairs to first order by their Gram matrix, the best by refits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calibrate import bic
from twin.diagnosis.candidates import Refit
from twin.diagnosis.evidence import Gram
from twin.diagnosis.refitting import CLOSE, TURNS, Progress, lost_to_priors, told
from twin.diagnosis.screening import start_of
from twin.diagnosis.signatures import Signature, Signatures, null
from twin.effects.protocol import Effect, Theta, Unsolvable
from twin.judging.heldout import folds
from twin.judging.judged import Judged, judge
from twin.model.prediction import Model
from twin.targets import Array, Targets

TRIED = 40  # pairs whose amplitudes are kept within their bounds, of all


@dataclass(frozen=True, kw_only=True)
class Group:
    """Effects that are missing together: promise, the fall of chi2 to first order; start, where their refit
    begins; refit, and what it gains: delta_bic, evidence, and held_out, for each effect the fall of chi2 in
    parts that are left out."""

    effects: tuple[Effect, ...]
    promise: float
    start: Theta
    refit: Refit | None = None
    delta_bic: float | None = None
    evidence: float | None = None
    held_out: Mapping[str, float] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The effects' names."""
        return tuple(e.name for e in self.effects)

    @property
    def adequate(self) -> bool:
        """Whether the refit leaves noise alone."""
        return self.refit is not None and self.refit.comparison.adequate


def best_pairs(judged: Judged, signatures: Signatures, *, count: int) -> list[Group]:
    """The pairs of effects that promise most, one for each two names."""
    rows = [r for own in signatures.values() for r in own if not r.note]
    if len(rows) < 2:
        return []
    columns = np.concatenate([r.columns for r in rows], axis=1)
    whole, ends = Gram.of(judged.z, columns), np.cumsum([r.columns.shape[1] for r in rows])
    spans = [np.arange(e - r.columns.shape[1], e) for e, r in zip(ends, rows, strict=True)]
    able = [
        (i, j) for i, j in combinations(range(len(rows)), 2) if rows[i].effect.name != rows[j].effect.name
    ]
    free = {ij: _free(whole.only(np.concatenate([spans[k] for k in ij]))) for ij in able}
    found: dict[frozenset[str], Group] = {}
    for ij in sorted(able, key=lambda ij: -free[ij])[:TRIED]:
        group = _group(judged, [rows[k] for k in ij], whole.only(np.concatenate([spans[k] for k in ij])))
        key = frozenset(group.names)
        if key not in found or found[key].promise < group.promise:
            found[key] = group
    return sorted(found.values(), key=lambda g: -g.promise)[:count]


def _free(gram: Gram) -> float:
    """The fall of chi2 with amplitudes of any size."""
    return float(gram.b @ np.linalg.lstsq(gram.S, gram.b, rcond=1e-10)[0])


def _group(judged: Judged, rows: Sequence[Signature], gram: Gram) -> Group:
    low, high = (np.concatenate([getattr(r, side) for r in rows]) for side in ("low", "high"))
    amplitudes, promise = gram.attained(low, high)
    start: dict[str, float] = dict(judged.values)
    moved = np.zeros(judged.fitted.shape[1])
    ends = np.cumsum([len(r.parameters) for r in rows])[:-1]
    for r, own in zip(rows, np.split(amplitudes, ends), strict=True):
        moved = moved + r.moved @ own
        start |= {k: v for k, v in start_of(judged, r, own).items() if k not in judged.values}
    free = [p for p in judged.model.parameters if p.name not in judged.at_bound]
    now = judged.values
    start |= {
        p.name: float(np.clip(now[p.name] + d, p.low, p.high)) for p, d in zip(free, moved, strict=True)
    }
    effects = tuple(r.effect.at(r.entry, judged.model.test) for r in rows)
    return Group(effects=effects, promise=promise, start=start)


def confirmed(
    groups: Sequence[Group], base: Judged, targets: Targets, *, seed: int, workers: int, tell: Progress
) -> list[Group]:
    """The groups with their refits and what each of their effects gains in parts that are left out."""
    tasks = [partial(_confirmed, g, base=base, targets=targets, seed=seed) for g in groups]
    labels = [" and ".join(e.label for e in g.effects) for g in groups]
    return told(labels, tasks, workers, tell)


def _confirmed(group: Group, *, base: Judged, targets: Targets, seed: int) -> Group:
    model: Model = base.model
    for e in group.effects:
        model = model.with_effect(e)
    try:
        judged = judge(
            model, targets, starts=model.theta(group.start), seed=seed, evaluations=20, tolerance=CLOSE,
            turns=TURNS,
        )  # fmt: skip
    except Unsolvable:
        return group
    refit, part = Refit.of(judged), np.where(targets.held_out, -1, folds(targets)[0])
    fall, added = base.deviance - refit.deviance, len(refit.fit.theta) - len(base.fit.theta)
    return replace(
        group,
        refit=refit,
        delta_bic=fall - bic(0.0, added, judged.whitener.count),
        evidence=fall - lost_to_priors(refit, group.effects),
        held_out={e.name: held_out(refit, e, part) for e in group.effects},
    )


def held_out(refit: Refit, effect: Effect, part: NDArray[np.int64]) -> float:
    """The fall of chi2 in parts (s,) of the steps that are left out, which an effect of a refit brings."""
    free = [p.name for p in refit.fit.parameters if p.name not in refit.at_bound]
    mine, amplitudes = {p.name for p in effect.parameters}, {p.name: p for p in effect.amplitudes}
    own = np.array([name in mine for name in free])
    values = refit.values
    amount = np.array(
        [values[name] - null(amplitudes[name]) if name in amplitudes else 0.0 for name in free]
    )
    each = np.repeat(part, len(refit.z) // len(part))
    return gain(refit.z, refit.fitted, own, amount, each)


def gain(z: Array, fitted: Array, own: NDArray[np.bool_], amount: Array, part: NDArray[np.int64]) -> float:
    """The fall of chi2 in left-out parts that an effect brings.

    z (n,): whitened residual at a fit with it; fitted (n, f): whitened derivatives by what was fitted; own
    (f,): which of them are the effect's; amount (f,): how far each is from null, 0 for what is not an
    amplitude; part (n,): the part of each value. Cross-validation by parts (Stone 1974, doi
    10.1111/j.2517-6161.1974.tb00994.x).
    """
    without = z + fitted[:, own] @ amount[own]  # measured - predicted, once the effect is taken out
    total = 0.0
    for k in np.unique(part[part >= 0]):
        inside, outside = part == k, (part >= 0) & (part != k)
        if outside.sum() > fitted.shape[1]:
            total += _left(without, fitted[:, ~own], outside, inside) - _left(z, fitted, outside, inside)
    return total


def _left(z: Array, columns: Array, train: NDArray[np.bool_], test: NDArray[np.bool_]) -> float:
    """chi2 of z in `test` after a fit of columns in `train`, its step kept short where `train` says
    little."""
    lengths = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(lengths > 0, lengths, 1.0)
    inner = scaled[train].T @ scaled[train] + 1e-6 * np.eye(scaled.shape[1])
    step = np.linalg.solve(inner, scaled[train].T @ z[train])
    left = z[test] - scaled[test] @ step
    return float(left @ left)
