"""A base model, a library of effects and targets -> the physical effect that the data ask for, if any.

Noise, frame and mesh first: what they forbid is not tested. Then all hypotheses to first order, refits of
those that may be the best (`shortlist`), a decision (`deciding`), its words (`wording`), and what belongs
beside a verdict: who mimics whom, what sizes would have been found, what to do next.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrate import Fit
from twin.diagnosis.classes import classes_of
from twin.diagnosis.deciding import NONE, Diagnosis, decided
from twin.diagnosis.grades import Grade, grade_of
from twin.diagnosis.hypotheses import Hypothesis, Refit
from twin.diagnosis.lawresidual import law_residual
from twin.diagnosis.refitting import near_with_effects, with_effects
from twin.diagnosis.scaling import scaling_in_words, scaling_of
from twin.diagnosis.shortlist import LATE, Progress, Task
from twin.diagnosis.signatures import Signatures, prior_sd
from twin.diagnosis.sizes import Detectable, smallest, unseen
from twin.diagnosis.sizes import in_words as sizes_in_words
from twin.diagnosis.swing import swing_in_words
from twin.diagnosis.wording import (
    cannot,
    concluded,
    fallen,
    missing_in_words,
    sure_in_words,
    unrefitted,
)
from twin.effects.protocol import Effect, Unsolvable
from twin.effects.standins import stand_ins
from twin.experiments.benchchecks import in_words as checks_in_words
from twin.experiments.benchchecks import witnesses
from twin.experiments.choice import Member, in_words, next_experiments
from twin.judging.fitting import noise_of, unresolved
from twin.judging.frame import frame_test
from twin.judging.heldout import forecasts
from twin.judging.judged import SETTLED, Judged, judge
from twin.judging.lawerrorlevels import inexact
from twin.judging.nearfit import fitted_near
from twin.model.nearmodel import NearModel
from twin.model.prediction import Model
from twin.targets import Array, Targets

ASTRAY = 0.05  # of the motion, rms
WORSE = 1.25  # a weighted fit may miss a little more than nominal constants, or the model without an effect
TIED = 3  # members of a tie that experiments are planned for


def diagnose(
    model: Model,
    effects: Sequence[Effect],
    targets: Targets,
    *,
    seed: int,
    start: Array | Fit,
    beside: Sequence[Effect] | None = None,
    plan: bool = True,
    progress: Progress | None = None,
) -> Diagnosis:
    """The diagnosis of a base model. start: its calibrated parameters (d,), from where it is fitted, or
    its fit, which is taken as it is; beside: generic stand-ins for what the library does not have, by default
    `stand_ins`; plan: whether experiments are planned for a tie.

    Reads targets only. Raises Unsolvable where the base model cannot be solved at `start`.
    """
    why = _astray(model, targets, start) or _refusal(targets)
    if why:
        return cannot(why)
    frame = frame_test(targets)
    if frame.moves:
        return replace(cannot(f"the frame moves: {frame.place}"), frame=frame)
    generic = stand_ins(model.test) if beside is None else beside
    tell = progress or (lambda stage, done, total: None)
    task = Task(model, tuple(effects), tuple(generic), targets, seed, tell)
    if model.mesh is not None and model.mesh.unknown:
        return replace(cannot(f"mesh: {model.mesh.unknown}"), frame=frame)
    base = task.base(start)
    rows = task.searched(base)
    decision = decided(base, rows)
    try:
        diagnosis = _kept(concluded(decision, base, rows), base, task)
        wrong = _misses_more(diagnosis)  # law errors forgive what a huge effect does wrong
    except Unsolvable:
        wrong = True  # its refit lies where the model has no equilibrium, or no such rubber is stable
    if wrong:
        diagnosis = _kept(concluded(replace(decision, unknown=True), base, rows), base, task)
    signatures = task.signatures(base, [*task.laws(wide=False), *task.generic])
    untried = [*task.silent, *(h for h in rows if h.note == LATE)]
    diagnosis = _completed(diagnosis, base, signatures, untried, targets, plan=plan)
    basis = targets.noise.basis if targets.noise else ""
    sentences = [diagnosis.sentence, basis, _mesh(model, noise_of(targets, base.errors.gauge))]
    return replace(diagnosis, frame=frame, sentence=" ".join(filter(None, sentences)))


def _kept(diagnosis: Diagnosis, base: Judged, task: Task) -> Diagnosis:
    """The diagnosis with the fit of what it names carried to its end, under the law errors that its refit
    asked for, how sure it is, and a sentence on the accuracy of the laws."""
    if diagnosis.kept is None or diagnosis.tied[0].score is None:
        return replace(diagnosis, sure=sure_in_words(diagnosis))
    targets, last, law = task.targets, diagnosis.kept.fit, diagnosis.tied[0].score.law
    model = near_with_effects(base, diagnosis.effects, targets, task.known)

    def ended(start: Array) -> Judged:
        if isinstance(model, NearModel):
            return fitted_near(model, targets, start, seed=last.seed, law=law)
        return judge(model, targets, starts=start, seed=last.seed, tolerance=SETTLED, law=law)

    try:
        judged = ended(model.theta(diagnosis.start))
    except Unsolvable:  # a step beyond the refit, where there is no such finger
        judged = ended(last.theta)
    residual, judged = law_residual(judged, targets), inexact(judged, targets)
    foretold = forecasts(judged, targets)
    judged = replace(judged, model=with_effects(base, diagnosis.effects))
    refit = Refit.of(judged)  # one fit, the same numbers wherever they are shown
    grade = grade_of(diagnosis.tied[0], alone=not diagnosis.ties, forecasts=list(foretold.values()))
    diagnosis = replace(diagnosis, grade=grade, foretold=foretold)
    rows = tuple(replace(h, refit=refit) if h.label == diagnosis.law else h for h in diagnosis.ranking)
    diagnosis = replace(diagnosis, kept=judged, law_left=residual, ranking=rows)
    doubt = residual.words(diagnosis.named) if residual else ""
    wider = any(e.label != e.name for e in diagnosis.effects)
    others = unrefitted(diagnosis) if doubt or wider else ""
    sentences = [missing_in_words(diagnosis), swing_in_words(judged), doubt, others, fallen(diagnosis)]
    return replace(diagnosis, sure=sure_in_words(diagnosis), sentence=" ".join(filter(None, sentences)))


def _misses_more(diagnosis: Diagnosis) -> bool:
    """True if the fit of what is named misses the film by WORSE times what the base model leaves."""
    if diagnosis.kept is None or diagnosis.base is None:
        return False
    return diagnosis.kept.comparison.raw_rms_mm > WORSE * diagnosis.base.comparison.raw_rms_mm


def _refusal(targets: Targets) -> str:
    if targets.noise is None:
        return (
            "no noise model: film the finger at rest (>= 300 frames) and run twin measure, or state sd_mm or "
            "still_steps under [noise] of targets/targets.toml"
        )
    if targets.noise.frames < 30:
        return f"the noise model rests on {targets.noise.frames} static frames, wanted 300 or more"
    return ""


def _mesh(model: Model, noise: float) -> str:
    """A sentence on an error of the mesh that is carried as one of its own beside a noise in mm."""
    error = unresolved(model, noise)
    if not error:
        return ""
    return (
        f"The mesh errs by {error:.4f} mm beyond its correction, more than a tenth of the noise ({noise:.4f} "
        "mm), and this is carried as an error of its own; mesh = 2 under [model] of twin.toml lowers it."
    )


def _astray(model: Model, targets: Targets, start: Array | Fit) -> str:
    """The reason for which a fit is no model of this finger: it misses the film by WORSE times what
    nominal constants leave, and by more than ASTRAY of the motion; "" where it may be one."""
    if not isinstance(start, Fit) or any(p.start is None for p in model.parameters):
        return ""
    moved, missed = (targets.rms(x) for x in (targets.value, targets.value - model.predict(start.theta)))
    if missed <= ASTRAY * moved:
        return ""
    try:
        constants = np.array([p.start for p in model.parameters], float)
        nominal = targets.rms(targets.value - model.predict(constants))
    except Unsolvable:
        return ""
    if missed <= WORSE * nominal:
        return ""
    return (
        f"your base fit is no model of this finger: it misses the film by {missed:.3g} mm of a motion of "
        f"{moved:.3g} mm, nominal constants by {nominal:.3g} mm; run twin calibrate --starts 10, and correct "
        "dimensions, signs and units"
    )


# -- what belongs beside a verdict ---------------------------------------------------------------------------


def _completed(
    diagnosis: Diagnosis,
    base: Judged,
    signatures: Signatures,
    silent: Sequence[Hypothesis],
    targets: Targets,
    *,
    plan: bool,
) -> Diagnosis:
    """The diagnosis with the classes of equivalence, the smallest sizes that would have been found, and,
    where it is to `plan`, the experiments that tell tied effects apart, or would refute one that is not
    sure."""
    rows = _smallest_sizes(signatures, silent)
    diagnosis = replace(diagnosis, classes=classes_of(signatures), detectable=tuple(rows))
    if diagnosis.verdict == "none needed":
        return replace(diagnosis, sentence=f"{diagnosis.sentence} {sizes_in_words(rows)}".strip())
    if diagnosis.verdict == NONE:
        shares = scaling_of(base, targets)
        text = f"{diagnosis.sentence} {scaling_in_words(shares)}".strip()
        return replace(diagnosis, scaling=shares, sentence=text)
    if not plan or diagnosis.grade in (None, Grade.NAMED):
        return diagnosis
    return (_planned if diagnosis.ties else _refutable)(diagnosis, base, targets)


def _smallest_sizes(signatures: Signatures, silent: Sequence[Hypothesis]) -> list[Detectable]:
    """The smallest size of each absent effect that these data would have shown; for those that they cannot
    show, why."""
    tested = [rows for rows in signatures.values() if not rows[0].effect.kind]
    sizes = [unseen(c.effect, c.note) for c in silent]
    for rows in tested:
        seen, effect = [r for r in rows if not r.note], rows[0].effect
        if not seen:
            sizes.append(unseen(effect, rows[0].note))
            continue
        columns = np.array([r.columns[:, 0] for r in seen]) / prior_sd(seen[0].parameters[0])
        nothing = np.zeros((columns.shape[1], 0))
        entries = [r.entry for r in seen]
        sizes.append(smallest(effect, columns, nothing, effects=len(tested), entries=entries))
    return sizes


def _refutable(diagnosis: Diagnosis, base: Judged, targets: Targets) -> Diagnosis:
    """The diagnosis with the experiments that tell what is named from the best other effect, the one that
    would refute it most first."""
    best = diagnosis.tied[0]
    rival = next((h for h in diagnosis.ranking if h.refit is not None and h.physics not in best.names), None)
    pair = [h.refit for h in (best, rival) if h is not None and h.refit is not None]
    if rival is None or len(pair) < 2:
        return diagnosis
    try:
        tests = next_experiments([Member(r.model, r.fit.theta) for r in pair], targets, base.whitener)
    except Unsolvable:
        return diagnosis
    tests = tuple(sorted(tests, key=lambda e: -e.sigmas))
    told = f"to confirm or refute {best.physics}, next to it {rival.physics}: {in_words(tests[:1])}"
    return replace(diagnosis, next_tests=tests, next_test=told if tests else "")


def _planned(diagnosis: Diagnosis, base: Judged, targets: Targets) -> Diagnosis:
    """The diagnosis with experiments that tell tied hypotheses apart: films of this finger, which the models
    predict, and checks without a model."""
    tied = [h for h in diagnosis.tied if h.refit is not None][:TIED]
    members = [Member(h.refit.model, h.refit.fit.theta) for h in tied if h.refit is not None]
    users = [e for h in diagnosis.tied for e in h.effects if e.origin is not None]
    seen = checks_in_words(witnesses([h.kind or h.label for h in diagnosis.tied], users=users))
    try:
        tests = next_experiments(members, targets, base.whitener)
    except Unsolvable:
        tests = ()
    return replace(
        diagnosis,
        next_tests=tests,
        next_test=". ".join(filter(None, [in_words(tests), seen])).removesuffix("."),
        verdict=f"{diagnosis.verdict}: run test {tests[0].experiment}" if tests else diagnosis.verdict,
    )
