"""A decision -> the verdict and its sentence, with the facts of what was fitted."""

from collections.abc import Sequence
from dataclasses import replace

from twin.diagnosis.deciding import Decision, Diagnosis
from twin.diagnosis.hypotheses import Hypothesis, ranked
from twin.effects.labels import KINDS, OR
from twin.judging.comparison import Comparison, change_in_words, error_in_words
from twin.judging.judged import Judged

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
        diagnosis = _unknown(base, rows)
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
    """The verdict on the best hypothesis, with those that cannot be told from it."""
    best = named[0]
    names = tuple(KINDS.get(h.kind, h.kind) if h.kind else h.physics for h in named)
    mimics = [h for h in named if h.kind]
    diagnosis = Diagnosis(
        verdict=OR.join(names),
        sentence="",
        named=best.names,
        effects=best.effects,
        kept=best.refit,
        start=best.start,
        ties=(names,) if names[1:] else (),
        tied=tuple(named),
        resembles=tuple(mimics),
    )
    if diagnosis.ties:
        like = "".join(f" The {h.kind} would be {h.words}." for h in mimics)
        return replace(diagnosis, sentence=f"These data cannot tell {' from '.join(names)}.{like}")
    are = "are" if best.names[1:] else "is"
    clauses = ". ".join(capital(e.told(diagnosis.start)) for e in best.effects)
    return replace(diagnosis, sentence=f"{' and '.join(best.names)} {are} missing. {clauses}.")


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


def _unknown(base: Judged, rows: Sequence[Hypothesis]) -> Diagnosis:
    """The verdict where nothing of the library explains the residual."""
    comparison = base.comparison
    fitted = [h for h in ranked(list(rows)) if h.score is not None and h.score.evidence > 0]
    alike = [h for h in fitted if h.kind][:SHOWN]
    like = f" The rest looks like {'; or like '.join(h.words for h in alike)}." if alike else ""
    near = [
        f"{h.label} leaves {h.comparison.raw_rms_mm:.3f} mm" for h in fitted if not h.kind and h.comparison
    ][:SHOWN]
    nearest = f" The nearest effects: {', '.join(near)}." if near else " No effect lowers the error."
    return Diagnosis(
        verdict="none of these",
        sentence=(
            "Something is missing that the library does not have. "
            f"{error_in_words(comparison)}{like}{nearest} {_place(comparison)}"
        ).strip(),
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
