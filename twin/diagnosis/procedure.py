"""A base model, a library of effects and targets -> which physical effect the data ask for, and what cannot
be told.

Noise first; fit; lack of fit; the signature of every absent effect with all fitted parameters projected out
(score test, one-sided where the parameter is); refits of the best; a wider law of the same physics before
anything else; ties are one answer. Multiplicity: Sidak over an effect's grid, Holm over effects.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import ndtr

from calibrate import Fit, bic, holm, sidak
from twin.diagnosis.comparison import Comparison, compare
from twin.diagnosis.fitting import fit_model, whitener_of
from twin.diagnosis.whitening import Whitener
from twin.effects.protocol import Effect, Theta
from twin.model.discretisation import Discretisation
from twin.model.prediction import Model
from twin.parallel import finished
from twin.targets import Array, Targets

Progress = Callable[[str, int, int], None]

DETECTED = 0.01  # after multiplicity
TIE = 6.0  # BIC
# Of the misfit: right physics, wrong law. Measured: 0.88 on the demo's film, where two terms stand for three;
# 0.2 to 0.3 for a tube that pulls the tip (tests/twin/diagnosis/test_twin_diagnose.py).
EXPLAINED = 0.8
INVISIBLE = 0.02  # of its own size is what an effect keeps apart from the fitted parameters
REFITS = 3
UNLOADED = 0.1  # of the top pressure is how far it must fall, for an effect that shows in unloading
SETTLED = 0.1  # sd to which refits are carried; `twin add` carries on from there
PROMISING = 0.25  # of the best z2: what a refit must promise as a fall of chi2

NEXT_TEST = {
    frozenset(
        {"creep", "pressure_lag"}
    ): "hold the top pressure for 60 s and film a 0.2 s step at 30 frames/s",
    frozenset({"pressure_gain", "camera_scale"}): "measure the pressure gauge against a second one",
    frozenset({"creep", "mullins"}): "repeat the cycle after a minute of rest: softening stays, creep fades",
    frozenset({"creep", "thermal"}): "repeat the film ten minutes later: creep fades, a drift goes on",
    frozenset({"stiffening", "camera_scale"}): "film a ruler in the finger's plane",
}


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


@dataclass(frozen=True)
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
        after = self.kept.comparison if self.kept else self.base
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


def diagnose(
    model: Model,
    effects: Sequence[Effect],
    targets: Targets,
    *,
    seed: int,
    start: Array,
    mesh: Discretisation | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Diagnosis:
    """The diagnosis of a base model. start (d,): its calibrated parameters; mesh: its discretisation error
    there; workers: processes that refit.

    Reads targets only. Raises Unsolvable where the base model cannot be solved at `start`.
    """
    refusal = _refusal(targets)
    if refusal:
        return _cannot(refusal)
    tell = progress or (lambda stage, done, total: None)
    if mesh is not None and mesh.unknown:
        return _cannot(f"mesh: {mesh.unknown}")
    tell("base model", 0, 3)
    w = whitener_of(model, start, targets, mesh)
    if mesh is not None and mesh.remainder_mm > 0.1 * w.noise_sd:
        return _cannot(
            f"mesh: {mesh.remainder_mm:.4f} mm of the discretisation error is carried by no mode, more than "
            f"a tenth of the noise ({w.noise_sd:.4f} mm); refine the mesh"
        )
    fit = fit_model(model, targets, w, start=start, seed=seed)
    jacobian = model.jacobian(fit.theta)
    base = compare(targets, model.predict(fit.theta), w, jacobian=jacobian)
    tell("signatures", 1, 3)
    candidates = screen(model, effects, targets, w, fit.theta, base, jacobian)
    chosen = _to_refit(candidates, base)
    one = partial(refit, model=model, targets=targets, w=w, base=base, seed=seed)
    refitted = refits(chosen, one, workers=workers, tell=tell)
    rows = _ranked([c for c in candidates if c.effect.name not in {r.effect.name for r in chosen}] + refitted)
    return _conclude(rows, base, fit, mesh.remainder_mm if mesh else None)


def _refusal(targets: Targets) -> str:
    if targets.noise is None:
        return "no noise model: film the finger at rest (>= 300 frames) and run twin measure"
    if targets.noise.frames < 30:
        return f"the noise model rests on {targets.noise.frames} static frames, wanted 300 or more"
    return ""


def _cannot(why: str) -> Diagnosis:
    return Diagnosis(f"cannot test: {why}", f"The data cannot be tested: {why}.")


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
    testable = [e for e in absent if not lacking(e, targets)]
    scored = [
        _score(e, rows, jacobian, w, base.whitened, model.named(theta), model)
        for e, rows in zip(testable, model.signatures(theta, testable), strict=True)
    ]
    adjusted = iter(holm([c.p_value for c in scored if not c.note]))
    scored = [c if c.note else replace(c, p_value=float(next(adjusted))) for c in scored]
    return scored + [Candidate(e, 0.0, 1.0, lacking(e, targets)) for e in absent if e not in testable]


def lacking(effect: Effect, targets: Targets) -> str:
    """What an effect requires and the data do not hold, or nothing."""
    if "history" in effect.requires and not targets.has_log:
        return "not testable: needs the pressure between the steps (a dense log)"
    if "gravity" in effect.requires and targets.gravity is None:
        return "not testable: needs the direction of gravity (twin.toml [model], or targets.toml by block)"
    p = np.interp(targets.time, targets.log_time, targets.log_pressure)
    if "unloading" in effect.requires and (np.maximum.accumulate(p) - p).max() < UNLOADED * p.max():
        return "not testable: needs steps at which the pressure has fallen again"
    return ""


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
    best = Candidate(effect, 0.0, 1.0, "cannot be seen apart from the fitted parameters with these data")
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
            best = Candidate(effect, score, chance, start={**_inside(model, moved), p.name: size, **entry})
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


def _to_refit(candidates: Sequence[Candidate], base: Comparison) -> list[Candidate]:
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
    candidate: Candidate, *, model: Model, targets: Targets, w: Whitener, base: Comparison, seed: int
) -> Candidate:
    """The candidate with its fit, its comparison and its BIC gain over the base; a note where it has none."""
    wider = model.with_effect(candidate.effect)
    start = wider.theta(candidate.start)
    fit = fit_model(wider, targets, w, start=start, seed=seed, evaluations=15, tolerance=SETTLED)
    if not np.isfinite(fit.chi2):
        return replace(candidate, note=fit.reason)
    found = compare(targets, wider.predict(fit.theta), w, jacobian=wider.jacobian(fit.theta))
    gain = bic(base.chi2, len(model.parameters), w.count) - bic(found.chi2, len(fit.theta), w.count)
    return replace(candidate, fit=fit, comparison=found, delta_bic=gain)


def _ranked(rows: Sequence[Candidate]) -> tuple[Candidate, ...]:
    return tuple(
        sorted(rows, key=lambda c: (-(c.delta_bic if c.delta_bic is not None else -np.inf), -abs(c.z)))
    )


def _conclude(rows: tuple[Candidate, ...], base: Comparison, fit: Fit, remainder: float | None) -> Diagnosis:
    best = rows[0] if rows and rows[0].delta_bic is not None and rows[0].delta_bic > TIE else None
    if best is not None and best.comparison is not None:
        found = _judged(rows, best, base, best.comparison)
    elif base.adequate:
        found = Diagnosis("none needed", "The model agrees with the measurement: no effect is missing.")
    else:
        found = Diagnosis("none of these", "The model is wrong, and no effect of the library helps.")
    blind = [c.effect.name for c in rows if c.note]
    unseen = f" These data cannot tell: {', '.join(blind)}." if blind else ""
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
    change = f"{base.rms_mm:.3f} mm -> {after.rms_mm:.3f} mm rms (noise {base.noise_sd_mm:.3f} mm)"
    named = Diagnosis(name, "", (name,), law, kept=best, explained=explained)
    tied = tuple(c.effect.name for c in rows[1:] if _tied(c, best))
    if after.adequate and tied:
        names = (name, *dict.fromkeys(tied))
        test = NEXT_TEST.get(frozenset(names[:2]), "repeat the film with a 60 s hold and a 0.2 s step")
        sentence = f"These data cannot tell {' from '.join(names)}; {change}."
        verdict = f"{' or '.join(names)}: run test {test}"
        return replace(named, verdict=verdict, sentence=sentence, ties=(names,), next_test=test)
    if after.adequate:
        return replace(named, sentence=f"{name} is missing: {best.effect.sentence}; {change}.")
    if explained > EXPLAINED:
        sentence = (
            f"{name} is the missing physics ({best.effect.sentence}), but its law is not exactly this one; "
            f"{change}."
        )
        return replace(named, verdict="right physics, wrong law", sentence=sentence)
    sentence = (
        f"The model is wrong by {base.rms_mm:.3f} mm rms, and the best effect of the library, {name}, "
        f"explains only {100 * explained:.0f} % of it: something else is missing."
    )
    return Diagnosis("none of these", sentence, explained=explained)


def _tied(c: Candidate, best: Candidate) -> bool:
    if c.delta_bic is None or best.delta_bic is None or c.effect.name == best.effect.name:
        return False
    return best.delta_bic - c.delta_bic < TIE
