"""A fitted base model and absent effects -> the score of each: does the residual contain its signature?

The signature is what the effect would change in the displacements. All fitted parameters are projected
out of it (score test, one-sided where the parameter is). Multiplicity: Sidak over an effect's grid, Holm over
effects.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from calibrate import holm, sidak
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.comparison import Comparison
from twin.diagnosis.whitening import Whitener
from twin.effects.protocol import Effect
from twin.effects.requirements import lacking
from twin.model.prediction import Model
from twin.targets import Array, Targets

INVISIBLE = 0.02  # of its own size is what an effect keeps apart from the fitted parameters

UNSEEN = "cannot be seen apart from the fitted parameters with these data"


def screen(
    model: Model,
    effects: Sequence[Effect],
    targets: Targets,
    w: Whitener,
    theta: Array,
    base: Comparison,
    jacobian: Array,
) -> list[Candidate]:
    """The score of every absent effect at the base fit, adjusted for the number of tries."""
    present = {e.name for e in model.effects}
    absent = [e for e in effects if e.name not in present]
    testable = [e for e in absent if not lacking(e.requires, targets)]
    scored = [
        _score(e, rows, jacobian, w, base.whitened, model.named(theta), model)
        for e, rows in zip(testable, model.signatures(theta, testable), strict=True)
    ]
    adjusted = iter(holm([c.p_value for c in scored if not c.note]))
    scored = [c if c.note else replace(c, p_value=float(next(adjusted))) for c in scored]
    silent = [e for e in absent if e not in testable]
    return scored + [
        Candidate(effect=e, z=0.0, p_value=1.0, note=lacking(e.requires, targets)) for e in silent
    ]


def _score(
    effect: Effect,
    rows: Sequence[Array],
    jacobian: Array,
    w: Whitener,
    z: Array,
    base: dict[str, float],
    model: Model,
) -> Candidate:
    """The largest score over the effect's grid, one-sided where its null is a bound, and the start it
    suggests."""
    p, fitted = effect.parameters[0], w.whiten(jacobian).T
    best = Candidate(effect=effect, z=0.0, p_value=1.0, note=UNSEEN)
    for entry, row in zip(effect.grid or ({},), rows, strict=True):
        if _hidden(w.pick(row), w.pick(jacobian), p.step):
            continue
        both = np.column_stack([fitted, w.whiten(row)])
        step, *_ = np.linalg.lstsq(both, z, rcond=1e-12)
        apart = both[:, -1] - fitted @ np.linalg.lstsq(fitted, both[:, -1], rcond=1e-12)[0]
        score = float(apart @ z / np.linalg.norm(apart))
        chance = float(ndtr(-score)) if p.null == p.low else float(2 * ndtr(-abs(score)))
        if best.note or chance < best.p_value or (chance == best.p_value and abs(score) > abs(best.z)):
            assert p.null is not None
            size = float(np.clip(p.null + step[-1], p.low, p.high))
            size = size if abs(size - p.null) > 0.02 * p.step else p.null + 0.1 * p.step
            moved = {k: v + d for (k, v), d in zip(base.items(), step[:-1], strict=True)}
            start = {**_inside(model, moved), p.name: size, **entry}
            best = Candidate(effect=effect, z=score, p_value=chance, start=start)
    return best if best.note else replace(best, p_value=sidak(best.p_value, len(rows)))


def _hidden(row: Array, jacobian: Array, step: float) -> bool:
    """Whether a signature (s, m) mm is nothing, or a combination of the fitted parameters' (d, s, m)."""
    whole = np.nan_to_num(row).ravel()
    if np.abs(whole).max(initial=0.0) * step < 1e-5:  # mm
        return True
    fitted = np.nan_to_num(jacobian).reshape(len(jacobian), -1).T
    fitted = fitted / np.linalg.norm(fitted, axis=0)
    apart = whole - fitted @ np.linalg.lstsq(fitted, whole, rcond=1e-12)[0]
    return bool(np.linalg.norm(apart) < INVISIBLE * np.linalg.norm(whole))


def _inside(model: Model, values: dict[str, float]) -> dict[str, float]:
    return {p.name: float(np.clip(values[p.name], p.low, p.high)) for p in model.parameters}
