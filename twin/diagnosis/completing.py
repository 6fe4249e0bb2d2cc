"""A verdict -> what belongs beside it: who mimics whom, what sizes would have been found, what to do next."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.diagnosis.candidates import Candidate
from twin.diagnosis.classes import classes_of
from twin.diagnosis.rivals import Rival, prior_sd
from twin.diagnosis.scaling import scaling_in_words, scaling_of
from twin.diagnosis.sizes import Detectable, smallest, unseen
from twin.diagnosis.sizes import in_words as sizes_in_words
from twin.diagnosis.verdicts import TIE, Diagnosis, ranked
from twin.effects.protocol import Unsolvable
from twin.experiments.choice import Member, in_words, next_experiments
from twin.judging.judged import Judged
from twin.targets import Targets

TIED = 3  # members of a tie that experiments are planned for


def completed(
    found: Diagnosis,
    base: Judged,
    rivals: Mapping[str, Sequence[Rival]],
    silent: Sequence[Candidate],
    targets: Targets,
    *,
    plan: bool,
) -> Diagnosis:
    """The diagnosis with the classes of equivalence, the smallest sizes that would have been found, and,
    where effects are tied and it is to `plan`, the experiments that tell them apart."""
    rows = smallest_sizes(rivals, silent)
    found = replace(found, classes=classes_of(rivals), detectable=tuple(rows))
    if found.verdict == "none needed":
        return replace(found, sentence=f"{found.sentence} {sizes_in_words(rows)}".strip())
    if found.verdict == "none of these":
        shares = scaling_of(base, targets)
        text = f"{found.sentence} {scaling_in_words(shares)}".strip()
        return replace(found, scaling=shares, sentence=text)
    return _planned(found, base, targets) if found.ties and plan else found


def smallest_sizes(rivals: Mapping[str, Sequence[Rival]], silent: Sequence[Candidate]) -> list[Detectable]:
    """The smallest size of each absent effect that these data would have shown; for those that they cannot
    show, why."""
    own = [rows for rows in rivals.values() if not rows[0].effect.kind]
    found = [unseen(c.effect, c.note) for c in silent]
    for rows in own:
        seen, effect = [r for r in rows if not r.note], rows[0].effect
        if not seen:
            found.append(unseen(effect, rows[0].note))
            continue
        signatures = np.array([r.columns[:, 0] for r in seen]) / prior_sd(seen[0].parameters[0])
        nothing = np.zeros((signatures.shape[1], 0))
        entries = [r.entry for r in seen]
        found.append(smallest(effect, signatures, nothing, effects=len(own), entries=entries))
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
