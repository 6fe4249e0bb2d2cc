"""All that was tried -> the verdict: what is missing, what cannot be told apart, and what is left
unexplained."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from scipy.special import ndtri

from twin.diagnosis.candidates import Candidate, Refit
from twin.diagnosis.classes import Mimics
from twin.diagnosis.explanation import EvidenceRecord
from twin.diagnosis.pairs import Group
from twin.diagnosis.refitting import DETECTED
from twin.diagnosis.sizes import Detectable
from twin.effects.labels import AND, KINDS, OR
from twin.effects.protocol import Effect, Theta
from twin.experiments.choice import Experiment
from twin.judging.comparison import Comparison
from twin.judging.frame import FrameTest
from twin.judging.judged import Judged

TIE = 6.0  # 2 ln B: below it neither of two models is preferred (Kass & Raftery 1995, doi 10.2307/2291091)
SECOND = 25.0  # BIC gain that a second effect must bring
POWER = 0.9  # with which a size must be found to be named
SHOWN = 3  # stand-ins and nearest effects that are told


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """What was tried on a base model.

    candidates: absent effects, every law that was refitted; stand_ins: generic explanations; wide: the
    declared wider families of the best effects; groups: effects that may be missing together; beside: the
    evidence of the best effect with each other explanation on top of it, to first order, by name.
    """

    base: Judged
    candidates: tuple[Candidate, ...]
    stand_ins: tuple[Candidate, ...] = ()
    wide: tuple[Candidate, ...] = ()
    groups: tuple[Group, ...] = ()
    beside: Mapping[str, float] = field(default_factory=dict)

    @property
    def least(self) -> float:
        """The size in sds from which on an effect would have been found with a chance of POWER."""
        tries = max(sum(not c.note for c in self.candidates), 1)
        return float(-ndtri(DETECTED / 2 / tries) + ndtri(POWER))


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What the data ask for: verdict, named effects, ties, ranking, next test, and the errors in mm.

    kept: the fit with the named effects, `effects` in their laws, and where it began (`start`).
    """

    verdict: str
    sentence: str
    named: tuple[str, ...] = ()
    effects: tuple[Effect, ...] = ()
    ties: tuple[tuple[str, ...], ...] = ()
    ranking: tuple[Candidate, ...] = ()
    resembles: tuple[Candidate, ...] = ()
    classes: tuple[Mimics, ...] = ()
    groups: tuple[Group, ...] = ()
    next_test: str = ""
    next_tests: tuple[Experiment, ...] = ()
    detectable: tuple[Detectable, ...] = ()
    scaling: Mapping[str, float] = field(default_factory=dict)
    evidence: EvidenceRecord | None = None
    frame: FrameTest | None = None
    base: Judged | None = None
    kept: Refit | None = None
    start: Theta = field(default_factory=dict)

    @property
    def law(self) -> str | None:
        """The labels of the named effects, as twin.toml writes them."""
        return AND.join(e.label for e in self.effects) or None

    @property
    def before(self) -> Comparison | None:
        """The comparison of the base model."""
        return self.base.comparison if self.base else None

    @property
    def after(self) -> Comparison | None:
        """The comparison with the named effects; that of the base model where nothing is named."""
        return self.kept.comparison if self.kept else self.before

    @property
    def text(self) -> str:
        """The sentence, and how the error falls with the named effects."""
        if self.kept is None or self.before is None or self.after is None:
            return self.sentence
        return (
            f"{self.sentence} The error falls from {self.before.rms_mm:.3f} to {self.after.rms_mm:.3f} mm "
            f"rms with {' and '.join(e.label for e in self.effects)}; the noise is "
            f"{self.before.noise_sd_mm:.3f} mm."
        )


def cannot(why: str) -> Diagnosis:
    """The verdict on data that cannot be tested."""
    sentence = f"Whether the model lacks an effect cannot be tested: {why}."
    return Diagnosis(verdict=f"cannot test: {why}", sentence=sentence)


def ranked(rows: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Candidates by their evidence; those without a refit by what they promise."""
    return tuple(sorted(rows, key=lambda c: (c.evidence is None, -(c.evidence or 0.0), -c.gain)))


def concluded(trial: Trial) -> Diagnosis:
    """The verdict on what was tried."""
    singles = [c for c in ranked(trial.candidates) if c.evidence is not None and _much(c) > 0]
    singles = [c for c in singles if not c.stretched]
    fits = [c for c in singles if c.adequate]
    if trial.base.comparison.adequate:
        fits = [c for c in fits if c.p_value < DETECTED]
    if not fits and trial.base.comparison.adequate:
        found = Diagnosis(
            verdict="none needed",
            sentence="The model agrees with the measurement: these data ask for no further effect.",
        )
    else:
        found = (
            (None if any(c.sure for c in fits) else _together(trial, singles))
            or (_single(trial, fits) if fits else None)
            or _wider(trial, singles)
            or _unknown(trial, fits or singles)
        )
    return replace(
        found,
        ranking=ranked([*trial.candidates, *trial.wide]),
        resembles=found.resembles or ranked([c for c in trial.stand_ins if c.evidence is not None])[:SHOWN],
        groups=trial.groups,
        base=trial.base,
    )


def _single(trial: Trial, fits: Sequence[Candidate]) -> Diagnosis | None:
    """The verdict where one effect alone is adequate; None where a stand-in or a wider family of another
    effect explains more than each of them."""
    alone = {c.effect.name for c in fits}
    wide = [c for c in ranked(trial.wide) if c.sure and c.effect.name not in alone]
    stand_ins = [c for c in ranked(trial.stand_ins) if c.evidence is not None]
    kept = [c for c in fits if all(_close(c, r) for r in (*_others(stand_ins, c)[:1], *wide[:1]))]
    if not kept:
        return None
    best = kept[0]
    if (best.size or 0.0) < trial.least or _much(best) < TIE:
        return _weak(trial, best)
    others = [c for c in (*kept[1:], *wide) if c.effect.name != best.effect.name and _close(c, best)]
    mimics = [c for c in _others(stand_ins, best) if c.adequate and _close(c, best)]
    return _named(best, others, mimics)


def _others(stand_ins: Sequence[Candidate], c: Candidate) -> list[Candidate]:
    """The stand-ins that are another explanation than an effect."""
    return [s for s in stand_ins if s.kind != c.effect.generic]


def _named(best: Candidate, others: Sequence[Candidate], mimics: Sequence[Candidate]) -> Diagnosis:
    """The verdict on an effect that is adequate, with the effects and stand-ins that cannot be told from
    it."""
    kinds = {c.kind: c for c in reversed(mimics)}
    tied = dict.fromkeys(c.effect.name for c in others)
    names = (best.effect.name, *tied, *(KINDS.get(k, k) for k in kinds))
    named = Diagnosis(
        verdict=OR.join(names),
        sentence="",
        named=(best.effect.name,),
        effects=(best.effect,),
        kept=best.refit,
        ties=(names,) if names[1:] else (),
        resembles=tuple(kinds.values()),
    )
    if not named.ties:
        return replace(named, sentence=f"{names[0]} is missing. {_capital(best.effect.sentence)}.")
    like = "".join(f" The {k} would be {words_of(c)}." for k, c in kinds.items())
    return replace(named, sentence=f"These data cannot tell {' from '.join(names)}.{like}")


def _weak(trial: Trial, best: Candidate) -> Diagnosis:
    name = best.effect.name
    return Diagnosis(
        verdict=f"weak: {name}",
        sentence=(
            f"There is a trace of {name}, of {best.size or 0.0:.1f} times its own uncertainty: too small to "
            f"be named. This test finds it reliably from {trial.least:.1f} on."
        ),
    )


def _wider(trial: Trial, singles: Sequence[Candidate]) -> Diagnosis | None:
    """The verdict where a wider family of one effect's physics is adequate beyond doubt, as so much freedom
    comes near to many things, and nothing else explains as much; what explains as much and is adequate is
    named with it."""
    fits = [c for c in ranked(trial.wide) if c.adequate and c.evidence is not None]
    if not fits or not fits[0].sure:
        return None
    best, name = fits[0], fits[0].effect.name
    others = [c for c in (*singles, *fits) if c.effect.name != name]
    others += _others(trial.stand_ins, best)
    tied = [c for c in others if c.adequate and _close(c, best)]
    if any(not _close(best, c) for c in tied):
        return None
    rest = [c.evidence or 0.0 for c in others if not c.adequate]
    rest += [g.evidence or 0.0 for g in trial.groups if g.adequate]
    rest += [evidence for beside, evidence in trial.beside.items() if beside != name]
    if (best.evidence or 0.0) < max(rest, default=0.0) + TIE:
        return None
    if tied:
        found = _named(best, [c for c in tied if not c.kind], [c for c in tied if c.kind])
        return replace(
            found, sentence=f"{found.sentence} {name} would follow another law than the library's."
        )
    return Diagnosis(
        verdict="right physics, wrong law",
        sentence=(
            f"{name} is the missing physics. {_capital(best.effect.sentence)}. Its law is not exactly that "
            "of the library: a wider family of the same physics fits."
        ),
        named=(name,),
        effects=(best.effect,),
        kept=best.refit,
    )


def _together(trial: Trial, singles: Sequence[Candidate]) -> Diagnosis | None:
    """The verdict where several effects together are adequate, and each of them predicts what it has not
    seen."""
    alone = max((c.delta_bic or 0.0 for c in singles), default=0.0)
    fits = [g for g in trial.groups if g.adequate and (g.delta_bic or 0.0) > alone + SECOND]
    fits = [g for g in fits if all(x > 0 for x in (g.held_out or {}).values())]
    if not fits:
        return None
    best = max(fits, key=lambda g: g.evidence or 0.0)
    rest = [c.evidence or 0.0 for c in trial.stand_ins]
    rest += [c.evidence or 0.0 for c in trial.wide if c.sure]
    if (best.evidence or 0.0) < max(rest, default=0.0) + TIE:
        return None
    tied = [g for g in fits if g is not best and (best.evidence or 0.0) - (g.evidence or 0.0) < TIE]
    names = tuple(AND.join(g.names) for g in (best, *tied))
    told = f"{' and '.join(best.names)} are missing."
    if tied:
        told = f"These data cannot tell {' from '.join(names)}."
    return Diagnosis(
        verdict=OR.join(names),
        sentence=f"{told} {'. '.join(_capital(e.sentence) for e in best.effects)}.",
        named=best.names,
        effects=best.effects,
        kept=best.refit,
        ties=(names,) if tied else (),
    )


def _unknown(trial: Trial, singles: Sequence[Candidate]) -> Diagnosis:
    """The verdict where nothing of the library explains the residual."""
    base = trial.base.comparison
    alike = ranked([c for c in trial.stand_ins if c.evidence is not None and c.evidence > TIE])[:SHOWN]
    like = f" The rest looks like {'; or like '.join(words_of(c) for c in alike)}." if alike else ""
    near = [f"{c.effect.label} leaves {c.comparison.rms_mm:.3f} mm" for c in singles if c.comparison][:SHOWN]
    nearest = f" The nearest effects: {', '.join(near)}." if near else " No effect of it lowers the error."
    return Diagnosis(
        verdict="none of these",
        sentence=(
            f"Something is missing that the library does not have. The model is wrong by {base.rms_mm:.3f} "
            f"mm rms where the noise is {base.noise_sd_mm:.3f} mm.{like}{nearest} {_place(base)}"
        ).strip(),
        resembles=alike,
    )


def _place(base: Comparison) -> str:
    """Where the residual is, of what the comparison says."""
    _, found, rest = base.where.partition("It fails most")
    return found + rest


def words_of(stand_in: Candidate) -> str:
    """What a stand-in's refit amounts to: "0.18 N near the tip, pointing up"."""
    values = stand_in.refit.values if stand_in.refit else stand_in.start
    resembles: Any = getattr(stand_in.effect, "resembles", None)
    return str(resembles(values)) if resembles else stand_in.effect.sentence


def _close(c: Candidate, best: Candidate) -> bool:
    """Whether these data cannot tell a candidate from a better one: two are told apart only where the
    evidence, which knows what sizes are plausible, and the BIC, which knows nothing of sizes, both say so."""
    gaps = ((best.evidence or 0.0) - (c.evidence or 0.0), (best.delta_bic or 0.0) - (c.delta_bic or 0.0))
    return min(gaps) < TIE


def _much(c: Candidate) -> float:
    """How much speaks for a candidate against the base model: by evidence or BIC, whichever says more."""
    return max(c.evidence or 0.0, c.delta_bic or 0.0)


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]
