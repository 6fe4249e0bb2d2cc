"""Screened candidates -> those worth a refit, each with its fit, and with a wider law where one is needed."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from calibrate import bic
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.comparison import Comparison, compare
from twin.diagnosis.fitting import fit_model, with_mesh
from twin.diagnosis.whitening import Whitener
from twin.model.discretisation import Discretisation
from twin.model.prediction import Model
from twin.parallel import finished
from twin.targets import Targets

Progress = Callable[[str, int, int], None]

DETECTED = 0.01  # after multiplicity
REFITS = 3
CLOSE = 0.1  # sd to which refits are carried; the kept one is carried on from there
PROMISING = 0.25  # of the best z2: what a refit must promise as a fall of chi2


def worth_refitting(candidates: Sequence[Candidate], base: Comparison) -> list[Candidate]:
    """The best few by score: the detected ones, or all visible ones where the base is inadequate.

    The square of a score is the fall of chi2 that the refit promises.
    """
    worth = [c for c in candidates if not c.note and (c.p_value < DETECTED or not base.adequate)]
    worth = sorted(worth, key=lambda c: -abs(c.z))[:REFITS]
    return [c for c in worth if c.z**2 > PROMISING * worth[0].z ** 2]


def refits(
    chosen: Sequence[Candidate], fit: Callable[[Candidate], Candidate], *, workers: int, tell: Progress
) -> list[Candidate]:
    """The candidates as `fit` refits them, each with its wider laws where the narrower one is inadequate.

    With several workers the wider laws are fitted meanwhile, and left out where they are not needed.
    """
    laws = [law for c in chosen for law in _laws(c)]
    settled: set[str] = set()

    def task(law: Candidate) -> Callable[[], Candidate | None]:
        one = partial(fit, law)
        return one if workers > 1 else lambda: None if law.effect.name in settled else one()

    found: dict[int, Candidate] = {}
    for done, (k, row) in enumerate(finished([task(law) for law in laws], workers=workers)):
        tell(f"refit with {laws[k].effect.label}", done + 1, len(laws))
        if row is not None:
            found[k] = row
            if row.comparison is not None and row.comparison.adequate:
                settled.add(row.effect.name)
    out: list[Candidate] = []
    for k in sorted(found):
        row, narrow = found[k], out[-1] if out and out[-1].effect.name == found[k].effect.name else None
        if narrow is not None and narrow.comparison is not None:
            if narrow.comparison.adequate:
                continue
            if narrow.fit is not None and (row.fit is None or row.fit.chi2 > narrow.fit.chi2):
                # the wider law holds the narrower one: a worse minimum is not its answer
                values = dict(zip((p.name for p in narrow.fit.parameters), narrow.fit.theta, strict=True))
                row = fit(replace(laws[k], start=row.effect.start(values)))
        out.append(row)
    return out


def _laws(candidate: Candidate) -> list[Candidate]:
    """The candidate, and the same physics with ever wider laws, each with its start."""
    rows = [candidate]
    while (wider := rows[-1].effect.wider()) is not None:
        rows.append(replace(candidate, effect=wider, start=wider.start(rows[-1].start)))
    return rows


def refit(
    candidate: Candidate,
    *,
    model: Model,
    targets: Targets,
    w: Whitener,
    mesh: Discretisation | None,
    base: Comparison,
    seed: int,
) -> Candidate:
    """The candidate with its fit, its comparison and its BIC gain over the base; a note where it has none."""
    wider = model.with_effect(candidate.effect)
    start = wider.theta(candidate.start)
    fit = fit_model(wider, targets, w, start=start, seed=seed, evaluations=15, tolerance=CLOSE)
    if not np.isfinite(fit.chi2):
        return replace(candidate, note=fit.reason)
    found = compare(targets, wider.predict(fit.theta), w, jacobian=wider.jacobian(fit.theta))
    gain = bic(base.chi2, len(model.parameters), w.count) - bic(found.chi2, len(fit.theta), w.count)
    return replace(candidate, fit=with_mesh(fit, mesh), comparison=found, delta_bic=gain)
