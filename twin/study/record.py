"""Record of `twin study`, study.json: the models before and after, the ridge, and readings that would
tell C10 from C01; its sentences and its tables. No number is computed here."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from twin.records import Reach, Record
from twin.study.separability import KNOWN, UNKNOWN, FurtherReading, FurtherReadings, Separation
from twin.targets import Array

SHOWN = 6  # readings in the report, within the pressure of the test and beyond


class Side(Record):
    """A model with its constants in MPa and its error."""

    C10: float = Field(description="MPa")
    C01: float
    total: float
    share: float
    rms_mm: float = Field(description="error of the objective")
    u_mm: list[float] = Field(description="displacements of the points")
    stated: bool = Field(default=False, description="of an initial model: by `[study]`")
    reduction_percent: float = Field(default=0.0, description="of another initial model: fall of the error")

    def __str__(self) -> str:
        return f"C10 = {self.C10:.3g}, C01 = {self.C01:.3g} MPa"


class Ridge(Record):
    """The best sum C10 + C01 for every share C01 / (C10 + C01)."""

    share: list[float]
    total_MPa: list[Reach] = Field(description="with its error")
    rms_mm: list[Reach]
    agreeing_share: tuple[float, float] = Field(description="range that agrees with the readings")

    def agreeing(self, values: Sequence[float]) -> Array:
        """Values (h,) along the ridge, cut to the part that agrees with the readings."""
        share, (low, high) = np.array(self.share), self.agreeing_share
        return np.array(values)[(share >= low) & (share <= high)]


class PointCurve(Record):
    """Displacement of a point over pressure: initial and final model, and readings."""

    point: str
    node: int | None
    initial_mm: list[float] = Field(description="models before and after at the pressures of the curves")
    final_mm: list[float]
    measured_at_MPa: list[float] = Field(description="what was read, with its error")
    measured_mm: list[float]
    measured_sd_mm: list[float]

    @property
    def label(self) -> str:
        """Name of the point with its node."""
        return self.point if self.node is None else f"{self.point} (node {self.node})"


class PointCurves(Record):
    """Curves of all points over the pressures in MPa."""

    pressure_MPa: list[float]
    points: list[PointCurve]


class Study(Record):
    """Results of a calibration by two points."""

    file: ClassVar[str] = "study.json"
    headline: str = Field(default="", description="what was found, in words")
    sentences: tuple[str, ...] = ()
    points: list[str] = Field(description="the objective")
    component: int
    pressure_MPa: float
    measured_mm: list[float]
    measured_sd_mm: float
    initial: Side = Field(description="the model before")
    final: Side = Field(description="the best of the genetic algorithm")
    reduction_percent: float = Field(description="fall of the RMS error")
    least_squares: Side = Field(description="the best of least squares")
    difference: str = Field(description="why the two end apart")
    published: Side | None = Field(description="constants that the source states")
    published_reduction_percent: float | None = Field(description="and the fall of the error")
    published_reduction_from_total_MPa: list[float] = Field(
        description="sums C10 + C01 of initial models that give this fall"
    )
    starts: list[Side] = Field(description="other initial models")
    ridge: Ridge = Field(description="the best sum for every share")
    known: Separation = Field(description="what the targets tell of the share")
    readings: list[FurtherReading] = Field(description="one more reading, best first")
    plans: list[FurtherReadings] = Field(description="several more")
    curves: PointCurves = Field(description="data of figures 6a and 6b")
    figures: tuple[str, ...] = Field(default=(), description="names of the files")

    def worded(self) -> "Study":
        """Copy with its headline and sentences."""
        sentences = (self._fall(), self._along(), self.difference, self._published(), self._separation())
        words = {"headline": self._headline(), "sentences": tuple(s for s in sentences if s)}
        return self.model_copy(update=words)

    def _headline(self) -> str:
        if self.known.sd < UNKNOWN:
            c = self.final
            return f"The targets fix both constants: C10 = {c.C10:.3g} MPa, C01 = {c.C01:.3g} MPa."
        totals = self.ridge.agreeing(self.ridge.total_MPa)
        ends = dict.fromkeys([f"{totals.min():.3g}", f"{totals.max():.3g}"])
        return (
            f"The targets fix the sum C10 + C01 = {' to '.join(ends)} MPa; "
            "how much of it is C01 they cannot tell."
        )

    def _fall(self) -> str:
        a, b = self.initial, self.final
        source = "as stated" if a.stated else "assumed; [study] initial states others"
        return (
            f"The RMS error of U{self.component} falls by {self.reduction_percent:.1f} %: from "
            f"{a.rms_mm:.3g} mm with {a} ({source}) to {b.rms_mm:.3g} mm with {b}, "
            "the best of the genetic algorithm."
        )

    def _along(self) -> str:
        rms, (low, high) = self.ridge.agreeing(self.ridge.rms_mm), self.ridge.agreeing_share
        return (
            f"With the best sum for each share C01/(C10 + C01) from {low:.2g} to {high:.2g}, the error stays "
            f"between {rms.min():.3g} and {rms.max():.3g} mm: this is the ridge. A reading is known to "
            f"{self.measured_sd_mm:.2g} mm."
        )

    def _published(self) -> str:
        if self.published_reduction_percent is None or not self.published_reduction_from_total_MPa:
            return ""
        sums = " or ".join(f"{total:.3g}" for total in self.published_reduction_from_total_MPa)
        return (
            f"The published {self.published_reduction_percent:g} % says more of the first guess than of the "
            f"result: on this finger, initial constants with C10 + C01 = {sums} MPa give it."
        )

    def _separation(self) -> str:
        if self.known.sd < UNKNOWN:
            return ""
        inside = next(r for r in self.readings if r.pressure_MPa <= self.pressure_MPa * (1 + 1e-9))
        best, plan = self.readings[0], min(self.plans, key=lambda p: p.sd)
        words = (
            f"To tell C10 from C01 by one reading more, {inside.words} serves best: with all "
            f"readings exact to {_mm(inside)}, the sd of the share is {KNOWN:g}."
        )
        if best is not inside:
            words += f" Beyond the pressure of the test, {best.words} asks for {_mm(best)} only."
        words += f" {plan.words} ({plan.count} values) ask for {_mm(plan)}."
        if min(best.sd, plan.sd) > UNKNOWN:
            words += f" Read to {self.measured_sd_mm:.2g} mm, none of these is enough."
        return words


def _mm(s: Separation) -> str:
    return f"{s.wanted_sd_mm or 0.0:.2g} mm"


def page_facts(study: Study) -> dict[str, Any]:
    """Tables of the report."""
    published, a, b = study.published, study.initial, study.final
    top = study.pressure_MPa * (1 + 1e-9)
    inside = [r for r in study.readings if r.pressure_MPa <= top]
    beyond = [r for r in study.readings if r.pressure_MPa > top]
    rows = [
        ("initial RMS, mm", a.rms_mm, None),
        ("final RMS, mm", b.rms_mm, None),
        ("reduction, %", study.reduction_percent, study.published_reduction_percent),
        ("C10, MPa", b.C10, published and published.C10),
        ("C01, MPa", b.C01, published and published.C01),
        ("C10 + C01, MPa", b.total, published and published.total),
        ("RMS of these constants on this finger, mm", b.rms_mm, published and published.rms_mm),
    ]
    return {
        "sentences": study.sentences, "starts": study.starts, "known": study.known, "plans": study.plans,
        "rows": [{"name": name, "here": here, "published": source} for name, here, source in rows],
        "readings": [
            {"within": "up to the pressure of the test", "rows": inside[:SHOWN]},
            {"within": "beyond it, if the finger bears it", "rows": beyond[:SHOWN]},
        ],
    }  # fmt: skip
