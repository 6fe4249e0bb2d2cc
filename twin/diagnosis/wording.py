"""A decision -> the verdict and its sentence, with the facts of what was fitted."""

from collections.abc import Sequence
from dataclasses import replace

from twin.diagnosis.deciding import NONE, Decision, Diagnosis
from twin.diagnosis.grades import FORETOLD, RIGHT, Grade
from twin.diagnosis.hypotheses import Hypothesis, ranked
from twin.effects.labels import KINDS, OR
from twin.effects.protocol import Theta
from twin.judging.comparison import Comparison, change_in_words, error_in_words
from twin.judging.judged import Judged
from twin.numerals import interval

HALF = 0.5
SHOWN = 3  # stand-ins and nearest effects that are told


def cannot(why: str) -> Diagnosis:
    """The verdict on data that cannot be tested."""
    sentence = f"Whether the model lacks an effect cannot be tested: {why}."
    return Diagnosis(verdict=f"cannot test: {why}", sentence=sentence)


def concluded(decision: Decision, base: Judged, rows: Sequence[Hypothesis]) -> Diagnosis:
    """The diagnosis that a decision makes of all hypotheses on a base model."""
    if not decision.needed:
        diagnosis = Diagnosis(
            verdict="none needed",
            sentence="The model agrees with the measurement: these data ask for no further effect.",
        )
    elif decision.unknown:
        diagnosis = _unknown(decision.named, base, rows)
    elif decision.weak:
        diagnosis = _weak(decision)
    else:
        diagnosis = _named(decision.named)
    stand_ins = ranked([h for h in rows if h.kind and h.score is not None])
    return replace(
        diagnosis,
        ranking=ranked([h for h in rows if not h.kind and len(h.effects) == 1]),
        groups=ranked([h for h in rows if len(h.effects) > 1]),
        resembles=diagnosis.resembles or stand_ins[:SHOWN],
        base=base,
    )


def _named(named: Sequence[Hypothesis]) -> Diagnosis:
    """The verdict on the best hypothesis, with those that cannot be told from it; its sentence waits for the
    fit of the best."""
    best, names = named[0], tuple(map(_called, named))
    return Diagnosis(
        verdict=OR.join(names),
        sentence="",
        named=best.names,
        effects=best.effects,
        kept=best.refit,
        start=best.start,
        ties=(names,) if names[1:] else (),
        tied=tuple(named),
        resembles=tuple(h for h in named if h.kind),
    )


def _called(h: Hypothesis) -> str:
    """What a verdict calls a hypothesis."""
    return KINDS.get(h.kind, h.kind) if h.kind else h.physics


def missing_in_words(diagnosis: Diagnosis) -> str:
    """What is missing, as surely as its grade says, with the sizes of the fits."""
    best, *others = diagnosis.tied
    assert diagnosis.kept is not None
    sizes = _sizes(best, diagnosis.kept.values)
    if others:
        members = [f"{best.physics}: {sizes}"]
        members += [f"{h.physics}: {_sizes(h, h.refit.values)}" for h in others if h.refit and not h.kind]
        mimics = [f"The {h.kind} would be {h.words}" for h in others if h.kind]
        names = " from ".join(map(_called, diagnosis.tied))
        spans = [
            f"{name} is {interval(e.low, e.high)} {e.unit}".strip()
            for name, e in diagnosis.shared.items() if e.low is not None and e.high is not None
        ]  # fmt: skip
        whichever = f" Whichever it is, {', '.join(spans)} (95 %)." if spans else ""
        return f"These data cannot tell {names}. {'. '.join([*members, *mimics])}.{whichever}"
    names, are = " and ".join(best.names), "are" if best.names[1:] else "is"
    missing = f"Something like {names} is missing ({' or '.join(diagnosis.mechanisms)})"
    if diagnosis.grade is not Grade.LIKE:
        missing = f"{'Probably ' * (diagnosis.grade is Grade.LIKELY)}{names} {are} missing"
    return f"{missing}. {capital(sizes)}."


def _sizes(h: Hypothesis, values: Theta) -> str:
    """The effects of a hypothesis at fitted values."""
    return "; ".join(e.told(values) for e in h.effects)


def sure_in_words(diagnosis: Diagnosis) -> str:
    """How sure what is named is, why, and how often that was right; "" where nothing is named or near."""
    if diagnosis.grade is None:
        return ""
    best, rates = diagnosis.tied[0], RIGHT[diagnosis.grade].words
    size = best.score.size if best.score else 0.0
    refuted = any(p <= FORETOLD for p in diagnosis.foretold.values())
    if diagnosis.grade is Grade.LIKE:
        why = "nothing that was tried fits" if not diagnosis.named else (
            "these data cannot tell it from others" if diagnosis.ties
            else "a film that no fit has seen contradicts it" if refuted
            else "its law is another than those tried"
        )  # fmt: skip
        return f"like: {why}. {rates}"
    foretold = "a film that no fit has seen is foretold"
    if diagnosis.grade is Grade.NAMED:
        why = f"its law fits within the noise, it is {size:.0f} times its uncertainty, and {foretold}"
        return f"named: {why}. {rates}"
    why = f"it is only {size:.0f} times its uncertainty" if diagnosis.foretold else (
        "no film is held out that could confirm it"
    )  # fmt: skip
    return (
        f"likely: its law fits within the noise, but {why}. {rates} To be sure, film the finger again "
        f"{diagnosis.mechanisms[0].film}, hold that film out (held_out = true), and run twin diagnose."
    )


def _weak(decision: Decision) -> Diagnosis:
    best = decision.named[0]
    size = best.score.size if best.score else 0.0
    return Diagnosis(
        verdict=f"weak: {best.physics}",
        sentence=(
            f"There is a trace of {best.physics}, of {size:.1f} times its own uncertainty: too small to be "
            f"named. This test finds it reliably from {decision.least:.1f} on."
        ),
    )


def _unknown(nearest: Sequence[Hypothesis], base: Judged, rows: Sequence[Hypothesis]) -> Diagnosis:
    """The verdict where nothing of the library explains the residual, with what comes nearest."""
    comparison = base.comparison
    fitted = [h for h in ranked(list(rows)) if h.score is not None and h.score.evidence > 0]
    alike = [h for h in fitted if h.kind][:SHOWN]
    like = f" The rest looks like {'; or like '.join(h.words for h in alike)}." if alike else ""
    near = [h for h in nearest if not h.kind and h.comparison]
    told = [
        f"{h.label} ({' or '.join(dict.fromkeys(e.mechanism for e in h.effects))}) leaves "
        f"{h.comparison.raw_rms_mm:.3f} mm" for h in near if h.comparison
    ]  # fmt: skip
    said = f" The nearest effects: {', '.join(told)}." if told else " No effect lowers the error."
    return Diagnosis(
        verdict=NONE,
        sentence=(
            "Something is missing that the library does not have. "
            f"{error_in_words(comparison)}{like}{said} {_place(comparison)}"
        ).strip(),
        tied=tuple(near),
        grade=Grade.LIKE if near else None,
        resembles=tuple(alike),
    )


def _place(base: Comparison) -> str:
    """The part of the comparison's sentence that says where the residual is largest."""
    _, clause, rest = base.where.partition("It fails most")
    return clause + rest


def fallen(diagnosis: Diagnosis) -> str:
    """A sentence on the fall of the error with the named effects; "" where none is kept."""
    if diagnosis.kept is None or diagnosis.before is None or diagnosis.after is None:
        return ""
    labels = [e.label for e in diagnosis.effects]
    return change_in_words(diagnosis.before.raw_rms_mm, diagnosis.after, labels)


def unrefitted(diagnosis: Diagnosis) -> str:
    """The effects that were not refitted, as to first order they promise less, though more than HALF of what
    the best refit reached; nothing where there are none. One of them may be the right one where a model is so
    far off that the first order says little."""
    done = {h.physics for h in diagnosis.ranking if h.refit is not None}
    best = max((h.evidence for h in diagnosis.ranking if h.evidence is not None), default=0.0)
    over = [h.physics for h in ranked(diagnosis.ranking) if not h.kind and h.hint > max(HALF * best, 0.0)]
    missed = [name for name in dict.fromkeys(over) if name not in done]
    if not missed:
        return ""
    return (
        f"Not refitted, as to first order they explain less of it: {', '.join(missed)}. One of them may fit "
        f"as well with fewer numbers: `twin add NAME` tries it in the place of {diagnosis.law}."
    )


def capital(sentence: str) -> str:
    """The sentence with a capital letter."""
    return sentence[:1].upper() + sentence[1:]
