"""The sentences of the report: what to do, where the model fails, what these data cannot show."""

import re
from typing import Any

from twin.bench.fits import newest
from twin.chain import STAGES, When
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.diagnosis.wording import capital
from twin.inputs.outlinechecks import OutlineRecord
from twin.judging.comparison import right_in_words
from twin.report.story import Story

FILMED = ("camera", "measure")  # stages of a project with a film
UNTESTED = "Whether the model lacks an effect is not tested: the targets have no noise model."


def markdown(story: Story) -> str:
    lines = [f"# {story.diagnosis.verdict}", "", " ".join(story.said)]
    lines += ["", f"Calibration: {story.calibrated.identifiability}"]
    return "\n".join([*lines, *story.history.markdown])


def ranking_rows(story: Story) -> list[dict[str, object]]:
    return [
        {
            "effect": r.law,
            "score": _round(r.z),
            "behind": "not refitted" if r.evidence is None else _round(story.diagnosis.behind(r)),
        }
        for r in story.diagnosis.ranking
    ]


def untold(story: Story) -> list[str]:
    """That no missing effect was looked for, where the targets do not allow it."""
    if story.targets.noise is not None:
        return []
    return [story.diagnosis.sentence or UNTESTED]


def opening(story: Story) -> list[str]:
    """The two sentences below the headline: the errors, and what to do now."""
    d, last, (before, _) = story.diagnosis, story.diagnosis.next_test, story.unmended
    if before is None or d.raw_rms_before_mm is None:
        return []
    clauses = [f"The model misses the film by {before:.3f} mm.", right_in_words(d)]
    if story.added is not None:
        clauses.append(f"{capital(story.labels[1])} it misses it by {story.added.raw_rms_mm:.3f} mm.")
    sentences = [" ".join(filter(None, clauses))]
    if last and d.ties:
        return [*sentences, f"To be sure, make the next test: {_small(last)}"]
    if story.added.adequate if story.added else d.adequate:
        leans = [story.added.leans] if story.added and story.added.leans else []
        return [
            *sentences,
            *leans,
            "The model now agrees with the measurement: its constants and intervals can be used.",
        ]
    return [*sentences, "The model does not agree with the measurement yet: do not use its constants."]


def where(story: Story) -> str:
    """Sentences on the largest errors of the model without effects, and on the outline beside it."""
    outline = newest(story.project, OutlineRecord)
    said = outline.said if outline else ()
    return " ".join(filter(None, (story.before.where if story.before else "", *said)))


def mechanism(story: Story) -> str:
    """Sentences of the diagnosis after its first one; the errors stand in the opening."""
    parts = story.said[1].removesuffix(".").split(". ")
    told = re.compile(r"The model misses the film|A right model would|With .* it misses it by")
    sure = [f"How sure: {story.diagnosis.sure} "] if story.diagnosis.sure else []
    return "".join([*sure, *(f"{part}. " for part in parts if part and not told.match(part))])


def commands(story: Story) -> list[str]:
    """The commands that lead to this report, with the effects that were added."""
    if story.study and story.untested:
        return ["twin study"]
    filmed = bool(story.project.config.cameras)
    added = [f"twin add {label}" for label in story.fit.effects]
    every = [s for s in STAGES if s.when is When.ALWAYS and (filmed or s.name not in FILMED)]
    before = [f"twin {stage.name}" for stage in every]
    return [*before[:-1], *added, *(["twin study"] if story.study else []), before[-1]]


def errors_of(story: Story) -> dict[str, Any] | None:
    """The errors before and after and the expected one, mm, with what the models are called; None without a
    diagnosis."""
    d, (before, after), added = story.diagnosis, story.labels, story.added
    raw, _ = story.unmended
    if raw is None or d.raw_rms_before_mm is None:
        return None
    return {
        "before_mm": raw,
        "after_mm": added.raw_rms_mm if added else None,
        "expected_mm": d.expected_mm,
        "before_note": before,
        "after_note": after if added else None,
        "expected_note": _band(d),
    }


def _band(d: DiagnosisRecord) -> str:
    """The 95 % band of the error of a right model."""
    if d.expected_low_mm is None or d.expected_high_mm is None:
        return "of a right model"
    return f"of a right model; 95 %: {d.expected_low_mm:.3f} to {d.expected_high_mm:.3f} mm"


def _small(sentence: str) -> str:
    """Sentence to follow a colon: its first letter small, unless it is part of a name."""
    return sentence[:1].lower() + sentence[1:] if sentence[1:2].islower() else sentence


def _round(x: float | None) -> float | None:
    return None if x is None else round(float(x), 1)
