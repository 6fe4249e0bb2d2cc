"""A base model, a library of effects and targets -> which physical effect the data ask for, and what cannot
be told.

Noise, frame and mesh first: what they forbid is not tested. `searchorder` tries, `verdicts` concludes, then
comes what belongs beside a verdict: who mimics whom, what sizes would have been found, what to do next.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrate import Fit
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.classes import classes_of
from twin.diagnosis.refitting import Progress
from twin.diagnosis.scaling import scaling_in_words, scaling_of
from twin.diagnosis.searchorder import Search
from twin.diagnosis.signatures import Signatures, prior_sd
from twin.diagnosis.sizes import Detectable, smallest, unseen
from twin.diagnosis.sizes import in_words as sizes_in_words
from twin.diagnosis.verdicts import TIE, Diagnosis, cannot, concluded, ranked
from twin.effects.protocol import Effect, Unsolvable
from twin.effects.standins import stand_ins
from twin.experiments.choice import Member, in_words, next_experiments
from twin.judging.fitting import whitener_of
from twin.judging.frame import frame_test
from twin.judging.judged import Judged
from twin.model.prediction import Model
from twin.targets import Array, Targets

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
    workers: int = 1,
    progress: Progress | None = None,
) -> Diagnosis:
    """The diagnosis of a base model. start: its calibrated parameters (d,), from where it is fitted, or
    its fit, which is taken as it is; beside: generic stand-ins for what the library does not have, by default
    `stand_ins`; plan: whether experiments are planned for a tie; workers: processes that refit.

    Reads targets only. Raises Unsolvable where the base model cannot be solved at `start`.
    """
    why = _refusal(targets)
    if why:
        return cannot(why)
    frame = frame_test(targets)
    if frame.moves:
        return replace(cannot(f"the frame moves: {frame.place}"), frame=frame)
    tell = progress or (lambda stage, done, total: None)
    generic = stand_ins(model.test) if beside is None else beside
    task = Search(model, tuple(effects), tuple(generic), targets, seed, workers, tell)
    theta = start.theta if isinstance(start, Fit) else start
    why = _mesh(model, whitener_of(model, theta, targets).noise_sd)
    if why:
        return replace(cannot(why), frame=frame)
    base = task.base(start)
    found = concluded(task.tried(base))
    found = _completed(found, base, task.signatures_at(base), task.silent, targets, plan=plan)
    basis = targets.noise.basis if targets.noise else ""
    return replace(found, frame=frame, sentence=" ".join(filter(None, [found.sentence, basis])))


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
    """Why the mesh does not allow a test at a noise of so many mm; nothing where it does."""
    if model.mesh is None:
        return ""
    if model.mesh.unknown:
        return f"mesh: {model.mesh.unknown}"
    left = model.mesh.remainder_mm
    if left > 0.1 * noise:
        return (
            f"mesh: {left:.4f} mm of the discretisation error is neither corrected nor carried by a mode, "
            f"more than a tenth of the noise ({noise:.4f} mm); refine the mesh"
        )
    return ""


# -- what belongs beside a verdict ---------------------------------------------------------------------------


def _completed(
    found: Diagnosis,
    base: Judged,
    signatures: Signatures,
    silent: Sequence[Candidate],
    targets: Targets,
    *,
    plan: bool,
) -> Diagnosis:
    """The diagnosis with the classes of equivalence, the smallest sizes that would have been found, and,
    where effects are tied and it is to `plan`, the experiments that tell them apart."""
    rows = _smallest_sizes(signatures, silent)
    found = replace(found, classes=classes_of(signatures), detectable=tuple(rows))
    if found.verdict == "none needed":
        return replace(found, sentence=f"{found.sentence} {sizes_in_words(rows)}".strip())
    if found.verdict == "none of these":
        shares = scaling_of(base, targets)
        text = f"{found.sentence} {scaling_in_words(shares)}".strip()
        return replace(found, scaling=shares, sentence=text)
    return _planned(found, base, targets) if found.ties and plan else found


def _smallest_sizes(signatures: Signatures, silent: Sequence[Candidate]) -> list[Detectable]:
    """The smallest size of each absent effect that these data would have shown; for those that they cannot
    show, why."""
    own = [rows for rows in signatures.values() if not rows[0].effect.kind]
    found = [unseen(c.effect, c.note) for c in silent]
    for rows in own:
        seen, effect = [r for r in rows if not r.note], rows[0].effect
        if not seen:
            found.append(unseen(effect, rows[0].note))
            continue
        columns = np.array([r.columns[:, 0] for r in seen]) / prior_sd(seen[0].parameters[0])
        nothing = np.zeros((columns.shape[1], 0))
        entries = [r.entry for r in seen]
        found.append(smallest(effect, columns, nothing, effects=len(own), entries=entries))
    return found


def _planned(found: Diagnosis, base: Judged, targets: Targets) -> Diagnosis:
    """The diagnosis with the experiments that tell tied effects apart."""
    fits = [c for c in ranked([*found.ranking, *found.resembles]) if c.adequate and c.refit is not None]
    top = fits[0].evidence or 0.0 if fits else 0.0
    tied = [c for c in fits if (c.evidence or 0.0) > top - TIE][:TIED]
    members = [Member(c.refit.model, c.refit.fit.theta) for c in tied if c.refit is not None]
    try:
        tests = next_experiments(members, targets, base.whitener)
    except Unsolvable:
        return found
    return replace(
        found,
        next_tests=tests,
        next_test=in_words(tests),
        verdict=f"{found.verdict}: run test {tests[0].experiment}" if tests else found.verdict,
    )
