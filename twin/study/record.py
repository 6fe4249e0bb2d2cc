"""What a calibration by one objective has found, as study.json has it: the models before and after, the
ridge, and what would tell C10 from C01. The sentences of the report come from here; no number is computed."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from twin.study.readings import Several
from twin.study.separability import KNOWN, UNKNOWN, Known, Reading
from twin.targets import Array

SHOWN = 6  # readings that the report shows, within the pressure of the test and beyond


@dataclass(frozen=True, kw_only=True)
class Side:
    """One model: its constants in MPa, their sum, the share of C01, its RMS error of the objective in mm, its
    displacements (p,) mm."""

    C10: float
    C01: float
    total: float
    share: float
    rms_mm: float
    u_mm: list[float]


@dataclass(frozen=True, kw_only=True)
class Initial(Side):
    """The model before; whether twin.toml states its constants."""

    stated: bool


@dataclass(frozen=True, kw_only=True)
class Start(Side):
    """Another model before; by how much the error falls from it to the final one, %, negative where it was
    better."""

    reduction_percent: float


@dataclass(frozen=True, kw_only=True)
class Line:
    """The ridge: shares (h,), their best sums (h,) MPa and errors (h,) mm; the shares between which it agrees
    with the readings."""

    share: list[float]
    total_MPa: list[float]
    rms_mm: list[float]
    agreeing_share: tuple[float, float]

    def agreeing(self, values: Sequence[float]) -> Array:
        """Those of values (h,) along the ridge where it agrees with the readings."""
        share, (low, high) = np.array(self.share), self.agreeing_share
        return np.array(values)[(share >= low) & (share <= high)]


@dataclass(frozen=True, kw_only=True)
class PointCurve:
    """Displacement of one point over pressure: the models before and after (k,) at the pressures of `Curves`,
    and what was read (n,) with its sds (n,)."""

    point: str
    node: int | None
    initial_mm: list[float]
    final_mm: list[float]
    measured_at_MPa: list[float]
    measured_mm: list[float]
    measured_sd_mm: list[float]

    @property
    def label(self) -> str:
        """The point with its node."""
        return self.point if self.node is None else f"{self.point} (node {self.node})"


@dataclass(frozen=True, kw_only=True)
class Curves:
    """The curves of all points at pressures (k,)."""

    pressure_MPa: list[float]
    points: list[PointCurve]


@dataclass(frozen=True, kw_only=True)
class Study:
    """What was found. component: 1 to 3; measured_mm (p,): the objective's values at the top pressure;
    measured_sd_mm: their error; published: what the source of the targets states;
    published_reduction_from_total_MPa: sums C10 + C01 of an initial model from which the error falls by as
    much; starts: other initial models."""

    points: list[str]
    component: int
    pressure_MPa: float
    measured_mm: list[float]
    measured_sd_mm: float
    initial: Initial
    final: Side
    reduction_percent: float
    least_squares: Side
    difference: str
    published: Side | None
    published_reduction_percent: float | None
    published_reduction_from_total_MPa: list[float]
    starts: list[Start]
    ridge: Line
    known: Known
    readings: list[Reading]
    plans: list[Several]
    curves: Curves

    def to_dict(self) -> dict[str, Any]:
        """The content of study.json."""
        return {"headline": self.headline, "sentences": self.sentences} | asdict(self)

    # -- words ----------------------------------------------------------------------------------------------

    @property
    def separated(self) -> bool:
        """Whether the targets tell C10 from C01."""
        return self.known.vague < UNKNOWN

    @property
    def headline(self) -> str:
        """What was found, in one sentence."""
        if self.separated:
            c = self.final
            return f"The targets fix both constants: C10 = {c.C10:.3g} MPa, C01 = {c.C01:.3g} MPa."
        totals = self.ridge.agreeing(self.ridge.total_MPa)
        low, high = f"{totals.min():.3g}", f"{totals.max():.3g}"
        total = low if low == high else f"{low} to {high}"
        return f"The targets fix the sum C10 + C01 = {total} MPa; how much of it is C01 they cannot tell."

    @property
    def sentences(self) -> list[str]:
        """What was found, one thought each: fall of the error, ridge, the two searches, what separates."""
        said = [self._fall, self._along, self.difference, self._others, self._separate]
        return [sentence for sentence in said if sentence]

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


def page_facts(record: Mapping[str, Any]) -> dict[str, Any]:
    """The tables of the report, from study.json."""
    published = record["published"] or {}
    a, b = record["initial"], record["final"]
    every, top = record["readings"], record["pressure_MPa"] * (1 + 1e-9)
    inside, beyond = ([r for r in every if (r["pressure_MPa"] <= top) == within] for within in (True, False))
    rows = [
        ("initial RMS, mm", a["rms_mm"], None),
        ("final RMS, mm", b["rms_mm"], None),
        ("reduction, %", record["reduction_percent"], record["published_reduction_percent"]),
        ("C10, MPa", b["C10"], published.get("C10")),
        ("C01, MPa", b["C01"], published.get("C01")),
        ("C10 + C01, MPa", b["total"], published.get("total")),
        ("RMS of these constants on this finger, mm", b["rms_mm"], published.get("rms_mm")),
    ]
    return {key: record[key] for key in ("sentences", "starts", "known", "plans")} | {
        "rows": [{"name": name, "here": here, "published": stated} for name, here, stated in rows],
        "readings": [
            {"within": "up to the pressure of the test", "rows": inside[:SHOWN]},
            {"within": "beyond it, if the finger bears it", "rows": beyond[:SHOWN]},
        ],
    }
