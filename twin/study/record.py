"""What a calibration by one objective has found, as study.json has it: the models before and after, the
ridge, and what would tell C10 from C01. The sentences of the report come from here; no number is computed."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from twin.records import Reach, Record
from twin.study.readings import Several
from twin.study.separability import KNOWN, UNKNOWN, Known, ReadingRow
from twin.targets import Array

SHOWN = 6  # readings that the report shows, within the pressure of the test and beyond


class Side(Record):
    """One model."""

    C10: float = Field(description="MPa")
    C01: float
    total: float
    share: float
    rms_mm: float = Field(description="error of the objective")
    u_mm: list[float] = Field(description="displacements of the points")


class Initial(Side):
    """The model before."""

    stated: bool = Field(description="by `[study]`")


class Start(Side):
    """Another model before."""

    reduction_percent: float = Field(description="fall of the error from it")


class RidgeLine(Record):
    """The ridge."""

    share: list[float]
    total_MPa: list[Reach] = Field(description="with its error")
    rms_mm: list[Reach]
    agreeing_share: tuple[float, float] = Field(description="range that agrees with the readings")

    def agreeing(self, values: Sequence[float]) -> Array:
        """Those of values (h,) along the ridge where it agrees with the readings."""
        share, (low, high) = np.array(self.share), self.agreeing_share
        return np.array(values)[(share >= low) & (share <= high)]


class PointCurve(Record):
    """Displacement of one point over pressure, of the models before and after, and as read."""

    point: str
    node: int | None
    initial_mm: list[float] = Field(description="models before and after at the pressures of the curves")
    final_mm: list[float]
    measured_at_MPa: list[float] = Field(description="what was read, with its error")
    measured_mm: list[float]
    measured_sd_mm: list[float]

    @property
    def label(self) -> str:
        """The point with its node."""
        return self.point if self.node is None else f"{self.point} (node {self.node})"


class PointCurves(Record):
    """The curves of all points."""

    pressure_MPa: list[float]
    points: list[PointCurve]


class Study(Record):
    """What was found."""

    file: ClassVar[str] = "study.json"
    headline: str = Field(default="", description="what was found, in words")
    sentences: tuple[str, ...] = ()
    points: list[str] = Field(description="the objective")
    component: int
    pressure_MPa: float
    measured_mm: list[float]
    measured_sd_mm: float
    initial: Initial = Field(description="the model before")
    final: Side = Field(description="the best of the genetic algorithm")
    reduction_percent: float = Field(description="fall of the RMS error")
    least_squares: Side = Field(description="the best of least squares")
    difference: str = Field(description="why the two end apart")
    published: Side | None = Field(description="constants that the source states")
    published_reduction_percent: float | None = Field(description="and the fall of the error")
    published_reduction_from_total_MPa: list[float] = Field(
        description="sums C10 + C01 of initial models that give this fall"
    )
    starts: list[Start] = Field(description="other initial models")
    ridge: RidgeLine = Field(description="the best sum for every share")
    known: Known = Field(description="what the targets tell of the share")
    readings: list[ReadingRow] = Field(description="one more reading, best first")
    plans: list[Several] = Field(description="several more")
    curves: PointCurves = Field(description="data of figures 6a and 6b")
    figures: tuple[str, ...] = Field(default=(), description="names of the files")

    def told(self, figures: Sequence[str]) -> "Study":
        """The same with what was found in words, and the files of its figures."""
        said = [self._fall, self._along, self.difference, self._others, self._separate]
        return self.model_copy(
            update={
                "headline": self._headline,
                "sentences": tuple(sentence for sentence in said if sentence),
                "figures": tuple(figures),
            }
        )

    # -- words ----------------------------------------------------------------------------------------------

    @property
    def separated(self) -> bool:
        """Whether the targets tell C10 from C01."""
        return self.known.vague < UNKNOWN

    @property
    def _headline(self) -> str:
        """What was found, in one sentence."""
        if self.separated:
            c = self.final
            return f"The targets fix both constants: C10 = {c.C10:.3g} MPa, C01 = {c.C01:.3g} MPa."
        totals = self.ridge.agreeing(self.ridge.total_MPa)
        low, high = f"{totals.min():.3g}", f"{totals.max():.3g}"
        total = low if low == high else f"{low} to {high}"
        return f"The targets fix the sum C10 + C01 = {total} MPa; how much of it is C01 they cannot tell."

    @property
    def _fall(self) -> str:
        a, b = self.initial, self.final
        assumed = "as stated" if a.stated else "assumed; [study] initial states others"
        return (
            f"The RMS error of U{self.component} falls by {self.reduction_percent:.1f} %: from "
            f"{a.rms_mm:.3g} mm with {_pair(a)} ({assumed}) to {b.rms_mm:.3g} mm with {_pair(b)}, "
            "the best of the genetic algorithm."
        )

    @property
    def _along(self) -> str:
        rms, (low, high) = self.ridge.agreeing(self.ridge.rms_mm), self.ridge.agreeing_share
        return (
            f"With the best sum for each share C01/(C10 + C01) from {low:.2g} to {high:.2g}, the error stays "
            f"between {rms.min():.3g} and {rms.max():.3g} mm: this is the ridge. A reading is known to "
            f"{self.measured_sd_mm:.2g} mm."
        )

    @property
    def _others(self) -> str:
        if self.published_reduction_percent is None or not self.published_reduction_from_total_MPa:
            return ""
        sums = " or ".join(f"{total:.3g}" for total in self.published_reduction_from_total_MPa)
        return (
            f"The published {self.published_reduction_percent:g} % says more of the first guess than of the "
            f"result: on this finger, initial constants with C10 + C01 = {sums} MPa give it."
        )

    @property
    def _separate(self) -> str:
        if self.separated:
            return ""
        inside = next(r for r in self.readings if r.pressure_MPa <= self.pressure_MPa * (1 + 1e-9))
        best, plan = self.readings[0], min(self.plans, key=lambda p: p.vague)
        said = [
            f"To tell C10 from C01 by one reading more, {inside.words} serves best: with all "
            f"readings exact to {inside.wanted} mm, the sd of the share is {KNOWN:g}."
        ]
        if best is not inside:
            said.append(f"Beyond the pressure of the test, {best.words} asks for {best.wanted} mm only.")
        said.append(f"{plan.words} ({plan.count} values) ask for {plan.wanted} mm.")
        if min(best.vague, plan.vague) > UNKNOWN:
            said.append(f"Read to {self.measured_sd_mm:.2g} mm, none of these is enough.")
        return " ".join(said)


def _pair(side: Side) -> str:
    """C10 and C01 in words."""
    return f"C10 = {side.C10:.3g}, C01 = {side.C01:.3g} MPa"


def page_facts(found: Study) -> dict[str, Any]:
    """The tables of the report."""
    published, a, b = found.published, found.initial, found.final
    top = found.pressure_MPa * (1 + 1e-9)
    inside, beyond = (
        [r for r in found.readings if (r.pressure_MPa <= top) == within] for within in (True, False)
    )
    rows = [
        ("initial RMS, mm", a.rms_mm, None),
        ("final RMS, mm", b.rms_mm, None),
        ("reduction, %", found.reduction_percent, found.published_reduction_percent),
        ("C10, MPa", b.C10, published and published.C10),
        ("C01, MPa", b.C01, published and published.C01),
        ("C10 + C01, MPa", b.total, published and published.total),
        ("RMS of these constants on this finger, mm", b.rms_mm, published and published.rms_mm),
    ]
    return {
        "sentences": found.sentences, "starts": found.starts, "known": found.known, "plans": found.plans,
        "rows": [{"name": name, "here": here, "published": stated} for name, here, stated in rows],
        "readings": [
            {"within": "up to the pressure of the test", "rows": inside[:SHOWN]},
            {"within": "beyond it, if the finger bears it", "rows": beyond[:SHOWN]},
        ],
    }  # fmt: skip
