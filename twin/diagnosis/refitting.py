"""Screened candidates -> those worth a refit, and their refits, each judged by its own errors."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from calibrate import bic
from twin.diagnosis.candidates import Candidate, Refit
from twin.diagnosis.evidence import apart, occam, orthonormal
from twin.diagnosis.signatures import null, prior_sd
from twin.effects.protocol import Effect, Unsolvable
from twin.judging.comparison import ADEQUATE
from twin.judging.judged import Judged, judge
from twin.parallel import finished
from twin.targets import Array, Targets

Progress = Callable[[str, int, int], None]

DETECTED = 0.01  # after multiplicity
REFITS = 4  # effects of the library that are refitted
STAND_INS = 2  # and stand-ins
PROMISING = 0.25  # of the best gain: what a refit must promise
COMPETING = 0.7  # of the best effect's gain: what a stand-in must promise to be refitted before all is said
CLOSE = 0.1  # sd to which refits are carried
TURNS = 2  # steps under rebuilt errors: enough for most, as no model that is wrong needs be exact
MORE = 4  # for one that is not quite adequate yet,
NEARLY = 1e-12  # by its lack of fit's probability


def worth_refitting(candidates: Sequence[Candidate], *, adequate: bool) -> list[Candidate]:
    """The few that promise most: detected ones, or all visible ones where the base model is inadequate."""
    able = [c for c in candidates if not c.note and c.gain > 0 and (c.p_value < DETECTED or not adequate)]
    top = max((c.gain for c in able), default=0.0)
    able = sorted((c for c in able if c.gain >= PROMISING * top), key=lambda c: -c.gain)
    own = [c for c in able if not c.kind][:REFITS]
    least = COMPETING * own[0].gain if own else 0.0
    return own + [c for c in able if c.kind and c.gain >= least][:STAND_INS]


def resembling(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The stand-ins without a refit that promise most: what a rest that nothing explains may look like."""
    able = [c for c in candidates if c.kind and c.refit is None and not c.note and c.gain > 0]
    return sorted(able, key=lambda c: -c.gain)[:STAND_INS]


def refits(
    chosen: Sequence[Candidate],
    base: Judged,
    targets: Targets,
    *,
    starts: Sequence[Array] = (),
    seed: int,
    workers: int,
    tell: Progress,
) -> list[Candidate]:
    """The candidates with their refits, in the order given.

    starts: further values (d,) of the base model's parameters from which every refit is tried too.
    """
    task = partial(refitted, base=base, targets=targets, starts=tuple(starts), seed=seed)
    return told([c.effect.label for c in chosen], [partial(task, c) for c in chosen], workers, tell)


def told(
    labels: Sequence[str], tasks: Sequence[Callable[[], Any]], workers: int, tell: Progress
) -> list[Any]:
    """What tasks give, in their order; each is told, by the label of what is refitted, as it is done."""
    found: dict[int, Any] = {}
    for done, (k, row) in enumerate(finished(tasks, workers=workers)):
        tell(f"refit with {labels[k]}", done + 1, len(tasks))
        found[k] = row
    return [found[k] for k in sorted(found)]


def refitted(
    candidate: Candidate, *, base: Judged, targets: Targets, starts: Sequence[Array], seed: int
) -> Candidate:
    """The candidate with its refit, its BIC gain and its evidence over the base; a note where it has none."""
    model = base.model.with_effect(candidate.effect)
    others = [{**candidate.start, **base.model.named(theta)} for theta in starts]
    rows = np.array([model.theta(values) for values in (candidate.start, *others)])
    try:
        fit = partial(judge, model, targets, seed=seed, evaluations=15, tolerance=CLOSE)
        judged = fit(starts=rows, turns=TURNS)
        if NEARLY < judged.comparison.p_value <= ADEQUATE:
            judged = fit(starts=judged.theta, turns=MORE)
    except Unsolvable as error:
        return replace(candidate, note=str(error))
    return scored(candidate, Refit.of(judged), base)


def scored(candidate: Candidate, refit: Refit, base: Judged | Refit) -> Candidate:
    """The candidate with a refit, and what it gains over the base."""
    n, fall = len(refit.z), base.deviance - refit.deviance
    added = len(refit.fit.theta) - len(base.fit.theta)
    lost = lost_to_priors(refit, (candidate.effect,))
    return replace(
        candidate,
        refit=refit,
        delta_bic=fall - bic(0.0, added, n),
        evidence=fall - lost,
        size=float(np.sqrt(max(fall, 0.0))),
    )


def lost_to_priors(refit: Refit, effects: Sequence[Effect]) -> float:
    """What a refit's evidence loses to the priors of its effects' parameters."""
    free = [p.name for p in refit.fit.parameters if p.name not in refit.at_bound]
    own = [p for e in effects for p in e.parameters if p.name in free]
    if not own:
        return 0.0
    own.sort(key=lambda p: free.index(p.name))
    mine = np.array([name in {p.name for p in own} for name in free])
    sd = np.array([prior_sd(p) for p in own])
    columns = apart(refit.fitted[:, mine], orthonormal(refit.fitted[:, ~mine])) * sd
    values = refit.values
    amount = np.array([0.0 if p.null is None else (values[p.name] - null(p)) for p in own]) / sd
    return occam(amount, columns.T @ columns)


