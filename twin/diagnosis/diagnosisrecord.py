"""The record of diagnosis.json: the verdict, and everything that it rests on."""

from collections.abc import Sequence
from typing import ClassVar

from pydantic import Field

from twin.diagnosis.classes import Mimics
from twin.diagnosis.deciding import Diagnosis
from twin.diagnosis.explanation import EvidenceRecord
from twin.diagnosis.grades import Grade, Outcome, outcome
from twin.diagnosis.hypotheses import Hypothesis
from twin.diagnosis.lawresidual import LawResidual
from twin.diagnosis.sizes import Detectable
from twin.effects.mechanism import Mechanism
from twin.experiments.choice import Experiment
from twin.judging.comparison import right_in_words
from twin.judging.fitrecord import Estimate, UnseenFilm
from twin.judging.frame import FrameTest
from twin.judging.intervals import estimates
from twin.records import Maybe, Record
from twin.tablemodel import Finite


class RankingRow(Record):
    effect: str
    law: str = Field(default="", description="as in twin.toml")
    z: Maybe = Field(default=None, description="score")
    gain: Maybe = Field(default=None, description="promised fall of chi2")
    p_value: Maybe = Field(default=None, description="of that gain by chance")
    hint: Maybe = Field(default=None, description="2 ln B to first order")
    delta_bic: Maybe = Field(default=None, description="BIC gain of the refit")
    evidence: Maybe = Field(default=None, description="2 ln B over the calibrated model")
    law_error: Maybe = Field(default=None, description="share by which its law errs")
    adequate: bool | None = Field(default=None, description="whether the model fits, under that")
    at_bound: tuple[str, ...] = ()
    plausible: bool | None = None
    parameters: dict[str, Estimate] = Field(default={})
    note: str = Field(default="", description="why it was not tested or refitted")

    @staticmethod
    def of(c: Hypothesis) -> "RankingRow":
        """The row of an effect."""
        refit = c.refit
        return RankingRow(
            effect=c.effect.name,
            law=c.effect.label,
            z=c.z,
            gain=c.gain,
            p_value=c.p_value,
            hint=c.hint,
            delta_bic=c.delta_bic,
            evidence=c.evidence,
            law_error=c.score.law if c.score else None,
            adequate=c.adequate if refit else None,
            at_bound=tuple(refit.at_bound) if refit else (),
            plausible=c.plausible,
            parameters=estimates(refit.fit, refit.comparison) if refit else {},
            note=c.note,
        )

    @property
    def untested(self) -> bool:
        """True if it was never tested; the note says why."""
        return bool(self.note) and self.delta_bic is None


class Resemblance(Record):
    kind: str
    words: str
    evidence: Maybe
    adequate: bool

    @staticmethod
    def of(c: Hypothesis) -> "Resemblance":
        """The row of a stand-in."""
        return Resemblance(kind=c.kind, words=c.words, evidence=c.evidence, adequate=c.adequate)


class PairRow(Record):
    effects: tuple[str, ...]
    gain: Maybe = Field(description="promised fall of chi2")
    delta_bic: Maybe
    evidence: Maybe
    adequate: bool | None
    held_out: dict[str, Maybe] = Field(description="fall of chi2 in parts left out, by effect")

    @staticmethod
    def of(g: Hypothesis) -> "PairRow":
        """The row of effects that were tried together."""
        return PairRow(
            effects=tuple(e.label for e in g.effects),
            gain=g.gain,
            delta_bic=g.delta_bic,
            evidence=g.evidence,
            adequate=g.adequate if g.refit else None,
            held_out=dict(g.score.held_out if g.score else {}),
        )


class NextTest(Record):
    experiment: str
    sigmas: Maybe = Field(description="separation of what is tied")
    minutes: Finite
    words: str

    @staticmethod
    def of(e: Experiment) -> "NextTest":
        """The row of an experiment."""
        return NextTest(experiment=e.experiment, sigmas=e.sigmas, minutes=e.minutes, words=e.words)


class ForetoldFilm(Record):
    film: str
    before: UnseenFilm = Field(description="as in comparison.json")
    after: UnseenFilm | None = Field(description="with the effect")
    ratio: Maybe
    p_before: Maybe = Field(default=None, description="of so bad a forecast by a right model")
    p_after: Maybe = None
    outcome: Outcome | None = Field(default=None, description="what the film says of the effect")

    @staticmethod
    def of(
        before: UnseenFilm,
        after: UnseenFilm | None,
        p_before: float | None = None,
        p_after: float | None = None,
    ) -> "ForetoldFilm":
        """The errors of two models in one film, and the probabilities of their forecasts."""
        ratio = before.rms_mm / after.rms_mm if after and after.rms_mm else None
        found = None if p_before is None or p_after is None else outcome(p_before, p_after)
        return ForetoldFilm(film=before.film, before=before, after=after, ratio=ratio, p_before=p_before,
                            p_after=p_after, outcome=found)  # fmt: skip

    @property
    def words(self) -> str:
        """The error before and after, and what the film says of the effect."""
        before, after = self.before, self.after
        if after is None or self.outcome is None:
            return f"{self.film}: {before.raw_rms_mm:.3f} mm rms. {right_in_words(before)}"
        told = {
            Outcome.CONFIRMED: "so it is confirmed: without it the film is not foretold",
            Outcome.REFUTED: f"so it is refuted: a right model would foretell it so badly with p = "
            f"{self.p_after or 0.0:.2g}",
            Outcome.UNTESTED: "which does not test it: without it the film is foretold as well",
        }
        return (
            f"{self.film}: {before.raw_rms_mm:.3f} mm rms, {after.raw_rms_mm:.3f} mm with the named effect, "
            f"{told[self.outcome]}. {right_in_words(before)}"
        )


class DiagnosisRecord(Record):
    """A diagnosis."""

    file: ClassVar[str] = "diagnosis.json"
    verdict: str = Field(description="the answer, short and in words")
    sentence: str = ""
    named: tuple[str, ...] = Field(description="the missing effects, and their laws as in twin.toml")
    law: str | None = None
    grade: Grade | None = Field(default=None, description="how sure a name is: named, likely or like")
    sure: str = Field(default="", description="the grade with its reason, in words")
    nearest: tuple[str, ...] = Field(default=(), description="the effects that come nearest, named or not")
    mechanisms: tuple[Mechanism, ...] = Field(default=(), description="their classes of physics")
    ties: tuple[tuple[str, ...], ...] = Field(
        default=(),
        description="what these data cannot tell apart",
    )
    shared: dict[str, Estimate] = Field(
        default={}, description="parameters that all of a tie have, their intervals the union of theirs"
    )
    classes: tuple[Mimics, ...] = Field(default=(), description="who mimics each effect")
    ranking: tuple[RankingRow, ...] = Field(default=(), description="every hypothesis")
    resembles: tuple[Resemblance, ...] = Field(default=(), description="nearest stand-ins")
    scaling: dict[str, Maybe] = Field(
        default={},
        description="with `none of these`: shares of the misfit that go with pressure, history, time",
    )
    detectable: tuple[Detectable, ...] = Field(
        default=(), description="smallest size of every effect that would have been found"
    )
    pairs: tuple[PairRow, ...] = Field(default=(), description="effects tried together")
    next_test: str | None = Field(default=None, description="what separates a tie, or may refute a name")
    next_tests: tuple[NextTest, ...] = Field(default=(), description="every experiment")
    law_left: LawResidual | None = Field(default=None, description="what the named laws leave")
    frame: FrameTest | None = Field(default=None, description="the test of the fixed markers")
    modes_beyond: tuple[tuple[str, Maybe], ...] = Field(
        default=(), description="shared errors that would have to exceed what is stated, in sd"
    )
    evidence: EvidenceRecord | None = Field(
        default=None, description="as evidence.json"
    )
    raw_rms_before_mm: Maybe = Field(default=None, description="error without and with the effects")
    raw_rms_after_mm: Maybe = None
    expected_mm: Maybe = Field(default=None, description="of the last, as in comparison.json")
    expected_low_mm: Maybe = Field(default=None, description="ends of its 95 % band")
    expected_high_mm: Maybe = None
    rms_before_mm: Maybe = Field(default=None, description="the errors without shared ones")
    rms_after_mm: Maybe = None
    noise_sd_mm: Maybe = Field(default=None, description="the noise")
    adequate: bool | None = Field(default=None, description="lack of fit")
    p_value_before: Maybe = None
    p_value_after: Maybe = None
    held_out: tuple[ForetoldFilm, ...] = Field(default=(), description="every film that no fit has seen")

    @staticmethod
    def of(diagnosis: Diagnosis, held_out: Sequence[ForetoldFilm] = ()) -> "DiagnosisRecord":
        """The record of a diagnosis, with what it foretells of films that no fit has seen."""
        before, after = diagnosis.before, diagnosis.after
        return DiagnosisRecord(
            verdict=diagnosis.verdict,
            sentence=diagnosis.sentence,
            named=diagnosis.named,
            law=diagnosis.law,
            grade=diagnosis.grade,
            sure=diagnosis.sure,
            nearest=diagnosis.nearest,
            mechanisms=diagnosis.mechanisms,
            ties=diagnosis.ties,
            shared=diagnosis.shared,
            classes=diagnosis.classes,
            ranking=tuple(map(RankingRow.of, diagnosis.ranking)),
            resembles=tuple(map(Resemblance.of, diagnosis.resembles)),
            scaling=dict(diagnosis.scaling),
            detectable=diagnosis.detectable,
            pairs=tuple(map(PairRow.of, diagnosis.groups)),
            next_test=diagnosis.next_test,
            next_tests=tuple(map(NextTest.of, diagnosis.next_tests)),
            law_left=diagnosis.law_left,
            frame=diagnosis.frame,
            modes_beyond=after.beyond if after else (),
            evidence=diagnosis.evidence,
            rms_before_mm=before.rms_mm if before else None,
            rms_after_mm=after.rms_mm if after else None,
            raw_rms_before_mm=before.raw_rms_mm if before else None,
            raw_rms_after_mm=after.raw_rms_mm if after else None,
            expected_mm=after.expected_mm if after else None,
            expected_low_mm=after.expected_low_mm if after else None,
            expected_high_mm=after.expected_high_mm if after else None,
            noise_sd_mm=before.noise_sd_mm if before else None,
            adequate=after.adequate if after else None,
            p_value_before=before.p_value if before else None,
            p_value_after=after.p_value if after else None,
            held_out=tuple(held_out),
        )

    def behind(self, row: RankingRow) -> float | None:
        """How far an effect is behind the best of the ranking by evidence; None where it was not refitted."""
        best = max((r.evidence for r in self.ranking if r.evidence is not None), default=0.0)
        return None if row.evidence is None else best - row.evidence

    @property
    def lines(self) -> tuple[str, ...]:
        """The verdict as it is told: the names, their mechanism, how sure they are, and what was found."""
        mechanism = f"Mechanism: {' or '.join(self.mechanisms)}" if self.mechanisms else ""
        sure = f"How sure: {self.sure}" if self.sure else ""
        return tuple(filter(None, (f"Verdict: {self.verdict}", mechanism, sure, self.sentence)))


NONE = DiagnosisRecord(verdict="not diagnosed", named=())
