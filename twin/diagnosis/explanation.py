"""The evidence for one effect: the model without it and with it, side by side.

What the effect explains is what it takes off the residual, once everything else is fitted anew; it stands
beside the residual, in mm and sds, by marker and branch. Held-out errors say whether it foretells data that
it was not fitted to.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from calibrate import Parameter
from twin.effects.protocol import Effect
from twin.judging.comparison import BRANCHES, branches, right_in_words
from twin.judging.fitrecord import Estimate
from twin.judging.heldout import HeldOut, held_out
from twin.judging.intervals import estimates
from twin.judging.judged import Judged
from twin.judging.whitening import PLAUSIBLE, Whitener
from twin.records import Maybe, Record
from twin.table import DataTable
from twin.targets import Array, Targets

ALL = "all"


class Share(Record):
    """The residual that an effect explains at a marker in a branch, in root mean squares."""

    marker: str
    branch: str
    count: int
    before_mm: float = Field(description="residual without the effect")
    signature_mm: float = Field(description="what the effect takes off it")
    after_mm: float
    before_sd: float = Field(description="the same in sds")
    after_sd: float
    explained: float = Field(description="share of the mean square that it takes away")


class Found(Estimate):
    """A parameter of the effect."""

    plausible: str = Field(default="", description="the value beside its plausible range")


class Mimic(Record):
    effect: str
    ceiling: float = Field(description="share of the signature that it mimics")


class EvidenceRecord(Record):
    """Everything that speaks for or against one effect."""

    file: ClassVar[str] = "evidence.json"
    effect: str = Field(default="", description="the effect, and what it is")
    sentence: str = ""
    chi2_before: Maybe = Field(default=None, description="fit without and with it")
    chi2_after: Maybe = None
    gain: Maybe = Field(default=None, description="fall of -2 ln likelihood")
    more_parameters: int = Field(default=0, description="how many it brings")
    evidence: Maybe = Field(default=None, description="2 ln of the Bayes factor")
    raw_rms_before_mm: Maybe = Field(default=None, description="error without and with it, and expected")
    raw_rms_after_mm: Maybe = None
    expected_mm: Maybe = None
    expected_low_mm: Maybe = None
    expected_high_mm: Maybe = None
    rms_before_mm: Maybe = Field(default=None, description="the same without shared errors, and the noise")
    rms_after_mm: Maybe = None
    noise_sd_mm: Maybe = None
    adequate: bool = Field(default=False, description="whether the model with it fits")
    parameters: dict[str, Found] = Field(default={}, description="by name")
    held_out: HeldOut | None = Field(
        default=None, description="error of parts foretold from the others"
    )
    shares: tuple[Share, ...] = Field(default=(), description="by marker and branch")
    mimics: tuple[Mimic, ...] = Field(
        default=(), validation_alias="class", serialization_alias="class", description="what could mimic it"
    )


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """The evidence for an effect; residual, signature and left (s, p, 3) mm are without the errors that many
    values share, NaN where no data."""

    record: EvidenceRecord
    residual: Array
    signature: Array
    left: Array

    @property
    def maps(self) -> dict[str, Array]:
        """The maps (s, p, 3) mm by their names in evidence.npz."""
        return {"residual": self.residual, "signature": self.signature, "left": self.left}


def explained(
    effects: Sequence[Effect],
    *,
    before: Judged,
    after: Judged,
    targets: Targets,
    evidence: float | None = None,
    mimics: Sequence[tuple[str, float]] = (),
) -> Explanation:
    """The evidence for an effect, or for several together, from the models without and with them, each at its
    own fit and with its own errors: what is uncertain of an effect is no error of the model without it."""
    w, names = after.whitener, {e.name for e in effects}
    residual, remainder = (_cleaned(s.whitener, targets.value - s.predicted) for s in (before, after))
    parameters = [p for p in after.model.parameters if p.name.partition(".")[0] in names]
    every = estimates(after.fit, after.comparison)
    record = EvidenceRecord(
        effect=" + ".join(e.label for e in effects),
        sentence="; ".join(e.told(after.values) for e in effects),
        chi2_before=before.comparison.chi2,
        chi2_after=after.comparison.chi2,
        gain=before.deviance - after.deviance,
        more_parameters=len(after.model.parameters) - len(before.model.parameters),
        evidence=evidence,
        raw_rms_before_mm=before.comparison.raw_rms_mm,
        raw_rms_after_mm=after.comparison.raw_rms_mm,
        expected_mm=after.comparison.expected_mm,
        expected_low_mm=after.comparison.expected_low_mm,
        expected_high_mm=after.comparison.expected_high_mm,
        rms_before_mm=before.comparison.rms_mm,
        rms_after_mm=after.comparison.rms_mm,
        noise_sd_mm=after.comparison.noise_sd_mm,
        adequate=after.comparison.adequate,
        parameters={p.name: _found(p, every[p.name]) for p in parameters},
        held_out=held_out(before, after, targets),
        shares=shares(targets, w, residual, remainder),
        mimics=tuple(Mimic(effect=name, ceiling=share) for name, share in mimics),
    )
    return Explanation(record=record, residual=residual, signature=residual - remainder, left=remainder)


def _found(p: Parameter, e: Estimate) -> Found:
    """A parameter of the effect beside what is plausible."""
    words = plausibility(p, e.value)
    return Found(value=e.value, unit=e.unit, low=e.low, high=e.high, note=e.note, plausible=words)


def _cleaned(w: Whitener, residual: Array) -> Array:
    """A residual (s, p, 3) mm without its shared errors; NaN where no data."""
    out = np.full(residual.shape, np.nan)
    out[:, w.components[:, 0], w.components[:, 1]] = w.cleaned(residual, bound=PLAUSIBLE)
    return out


def shares(targets: Targets, w: Whitener, residual: Array, remainder: Array) -> tuple[Share, ...]:
    """The explained shares by marker and branch, and over all, from cleaned residuals (s, p, 3) mm without
    the effect and with it."""
    point, axis = w.components.T
    noise = w.noise_sds
    branch = branches(targets.time, targets.pressure, targets.log_time, targets.log_pressure)
    markers = {targets.names[k]: point == k for k in np.unique(point)} | {ALL: np.ones(len(point), bool)}
    steps = {name: branch == k for k, name in enumerate(BRANCHES)} | {ALL: np.ones(len(branch), bool)}
    before, after = residual[:, point, axis], remainder[:, point, axis]
    return tuple(
        _share(marker, name, before[cell], after[cell], noise[cell])
        for marker, columns in markers.items()
        for name, rows in steps.items()
        if np.isfinite(before[cell := np.ix_(rows, columns)]).any()
    )


def _share(marker: str, branch: str, before: Array, after: Array, noise: Array) -> Share:
    good = np.isfinite(before)
    b, a, sd = before[good], after[good], noise[good]
    before_mm, signature_mm, after_mm, before_sd, after_sd = (
        float(np.sqrt((x**2).mean())) for x in (b, b - a, a, b / sd, a / sd)
    )
    return Share(
        marker=marker, branch=branch, count=len(b), before_mm=before_mm, signature_mm=signature_mm,
        after_mm=after_mm, before_sd=before_sd, after_sd=after_sd,
        explained=1 - (after_mm / before_mm) ** 2 if before_mm > 0 else 0.0,
    )  # fmt: skip


# -- beside what is known ------------------------------------------------------------------------------------


def plausibility(parameter: Parameter, value: float) -> str:
    """A fitted value beside its plausible range, in words; "" where none is declared.

    >>> plausibility(Parameter("creep.g1", 0.0, 0.4, null=0.0, plausible=(0.003, 0.2)), 0.3)
    'not plausible: expected 0.003 to 0.2'
    """
    if parameter.plausible is None:
        return ""
    low, high = parameter.plausible
    span = f"{low:.3g} to {high:.3g} {parameter.unit}".rstrip()
    return f"plausible ({span})" if low <= value <= high else f"not plausible: expected {span}"


# -- in words ------------------------------------------------------------------------------------------------


def table(e: EvidenceRecord) -> list[str]:
    """The evidence as lines of a terminal: numbers, then a row a marker and a column a branch."""
    out = [f"{e.effect}: {e.sentence}."]
    errors = (
        f"Without it the model misses the film by {e.raw_rms_before_mm:.3f} mm.", right_in_words(e),
        f"With {e.effect} it misses it by {e.raw_rms_after_mm:.3f} mm.",
    )  # fmt: skip
    out.append(" ".join(filter(None, errors)))
    bayes = "" if e.evidence is None else f", 2 ln B = {e.evidence:.0f}"
    out.append(
        f"chi2: {e.chi2_before:.0f} without, {e.chi2_after:.0f} with {e.more_parameters} more "
        f"parameter{'s' * (e.more_parameters != 1)}{bayes}."
    )
    h = e.held_out
    assert h is not None
    out.append(
        f"Foretold, each {h.left_out} from the others: {h.before_sd:.2f} sd without, {h.after_sd:.2f} with."
    )
    mimics = ", ".join(f"{m.effect} {100 * m.ceiling:.0f} %" for m in e.mimics)
    out += [f"What could mimic it: {mimics}."] if mimics else []
    names = list(dict.fromkeys(s.marker for s in e.shares))
    parts = list(dict.fromkeys(s.branch for s in e.shares))
    cell = {(s.marker, s.branch): s for s in e.shares}
    rows = [
        [name, *(_cell(cell[name, part]) if (name, part) in cell else "-" for part in parts)]
        for name in names
    ]
    title = "Residual in sds without -> with it, and the share explained:"
    return [*out, "", title, *DataTable(["", *parts], rows).lines("<>")]


def _cell(s: Share) -> str:
    percent = round(100 * s.explained)
    return f"{s.before_sd:.1f} -> {s.after_sd:.1f} {percent:4d} %"
