"""A base model, a library of effects and targets -> which physical effect the data ask for, and what cannot
be told.

Noise first; fit; lack of fit; the signature of every absent effect with all fitted parameters projected out;
refits of the best; a wider law of the same physics before anything else; ties are one answer.
"""

from collections.abc import Callable, Sequence
from functools import partial

from twin.diagnosis.candidates import Candidate
from twin.diagnosis.comparison import compare
from twin.diagnosis.fitting import fit_model, whitener_of
from twin.diagnosis.refitting import Progress, refit, refits, worth_refitting
from twin.diagnosis.screening import screen
from twin.diagnosis.verdicts import Diagnosis, concluded, ranked
from twin.effects.protocol import Effect
from twin.model.discretisation import Discretisation
from twin.model.prediction import Model
from twin.targets import Array, Targets


def diagnose(
    model: Model,
    effects: Sequence[Effect],
    targets: Targets,
    *,
    seed: int,
    start: Array,
    mesh: Discretisation | None = None,
    settle: Callable[[Candidate], Candidate] | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Diagnosis:
    """The diagnosis of a base model. start (d,): its calibrated parameters; mesh: its discretisation error
    there; settle: gives the kept effect the fit that is given out, by default its refit as it is; workers:
    processes that refit.

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
    chosen = worth_refitting(candidates, base)
    one = partial(refit, model=model, targets=targets, w=w, mesh=mesh, base=base, seed=seed)
    refitted = refits(chosen, one, workers=workers, tell=tell)
    rows = ranked([c for c in candidates if c.effect.name not in {r.effect.name for r in chosen}] + refitted)
    remainder = mesh.remainder_mm if mesh else None
    found = concluded(rows, base, fit, remainder)
    if settle is None or found.kept is None:
        return found
    rows = tuple(settle(c) if c is found.kept else c for c in rows)
    return concluded(rows, base, fit, remainder)


def _refusal(targets: Targets) -> str:
    if targets.noise is None:
        return "no noise model: film the finger at rest (>= 300 frames) and run twin measure"
    if targets.noise.frames < 30:
        return f"the noise model rests on {targets.noise.frames} static frames, wanted 300 or more"
    return ""


def _cannot(why: str) -> Diagnosis:
    return Diagnosis(verdict=f"cannot test: {why}", sentence=f"The data cannot be tested: {why}.")
