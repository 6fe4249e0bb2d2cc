"""Simpler rules than the diagnosis, on the same trial: what each would name, to first order at the base
fit."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from calibrate import bic
from twin.effects.protocol import Effect
from twin.effects.requirements import lacking
from twin.targets import Array, Targets

EXPLAINED = 0.8  # of the misfit: the cut of an earlier version
GRID = tuple(s * 2.0**k for k in range(-3, 5) for s in (-1, 1))  # steps of an effect, of fingerprints


def named_by(judged: Any, effects: Sequence[Effect], targets: Targets) -> dict[str, str]:
    """The effect that each rule names, or nothing: by the residual's correlation with what an effect changes;
    by the smallest rms after a refit of one effect at a time; by BIC alone; by BIC with the cut of 0.8; by
    the cosine of the data with fingerprints (Material Fingerprinting, arXiv 2508.07831)."""
    able = [e for e in effects if not lacking(e.requires, targets)]
    found = judged.model.tangents(judged.theta, able)
    data = targets.valid & ~targets.held_out[:, None, None] & ~targets.fixed[:, None]
    residual = (targets.value - judged.predicted)[data]
    fitted = judged.model.jacobian(judged.theta)[:, data].T
    alike, rms, gain = {}, {}, {}
    signatures: list[tuple[str, Array]] = []
    for e in able:
        for row in (rows[0] for rows in found[e.label]):
            s = row[data]
            if np.abs(s).max() == 0.0:
                continue
            signatures.append((e.name, s * e.amplitudes[0].step))
            alike[e.name] = max(alike.get(e.name, 0.0), abs(float(np.corrcoef(s, residual)[0, 1])))
            rms[e.name] = min(rms.get(e.name, np.inf), _left(np.column_stack([fitted, s]), residual))
            column = judged.whitener.whiten(row)
            both = np.column_stack([judged.fitted, column])
            fall = _left(judged.fitted, judged.z) - _left(both, judged.z)
            gain[e.name] = max(gain.get(e.name, -np.inf), fall)
    best, n = max(gain, key=gain.__getitem__), len(judged.z)
    worth = gain[best] - (bic(0.0, 1, n) - bic(0.0, 0, n))
    beyond = max(judged.comparison.excess, 1.0)
    return {
        "cosine": fingerprinted(targets.value[data], judged.predicted[data], signatures),
        "correlation": max(alike, key=alike.__getitem__),
        "rms": min(rms, key=rms.__getitem__),
        "bic": best if worth > 0 else "",
        "cut_of_0.8": best if worth > 6 and gain[best] / beyond > EXPLAINED else "",
    }


def fingerprinted(measured: Array, base: Array, signatures: Sequence[tuple[str, Array]]) -> str:
    """The name whose fingerprint has the largest cosine with the data (n,), nothing where that is the base's.

    Fingerprints are the base prediction with an effect at sizes of a grid, to first order; lengths do not
    count, so that the modulus does not.
    """
    entries = [("", base), *((name, base + a * s) for name, s in signatures for a in GRID)]
    return max(entries, key=lambda row: float(row[1] @ measured / np.linalg.norm(row[1])))[0]


def _left(rows: Array, values: Array) -> float:
    rest = values - rows @ np.linalg.lstsq(rows, values, rcond=1e-12)[0]
    return float(rest @ rest)


def ridge(judged: Any, targets: Targets, steps: Array) -> Array:
    """A correction (k, p, 3) mm of the prediction at steps, learnt from the residual: ridge regression on
    powers of pressure, its rate and a memory of it, for each marker and axis; it knows no orientation."""
    p = targets.pressure / targets.pressure.max()
    rate = np.gradient(p, targets.time)
    memory = np.interp(targets.time, targets.log_time, _slow(targets)) / targets.pressure.max()
    x = np.column_stack([p, p**2, p**3, rate, memory, memory * p])
    x = x - x[targets.reference].mean(axis=0)
    train = ~targets.held_out
    a = x[train]
    residual = np.nan_to_num(targets.value - judged.predicted)[train].reshape(len(a), -1)
    known = np.linalg.solve(a.T @ a + 1e-2 * len(a) * np.eye(a.shape[1]) / 10, a.T @ residual)
    return (x[steps] @ known).reshape(int(np.sum(steps)), *targets.value.shape[1:])


def _slow(targets: Targets, tau: float = 5.0) -> Array:
    out, t, p = np.zeros(len(targets.log_time)), targets.log_time, targets.log_pressure
    for n in range(1, len(t)):
        out[n] = out[n - 1] + (1 - np.exp(-(t[n] - t[n - 1]) / tau)) * (p[n] - out[n - 1])
    return p - out
