"""What a calibration by one objective has found, as one record: the models before and after, the ridge, and
what would tell C10 from C01. The sentences of the report come from here; no number is computed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.effects.baselaw import Constants
from twin.study.readings import Plan
from twin.study.ridges import Ridge
from twin.study.separability import KNOWN, UNKNOWN, Addition, Knowledge
from twin.targets import Array

SHOWN = 6  # readings that the report shows, within the pressure of the test and beyond


@dataclass(frozen=True, kw_only=True)
class Side:
    """One model: its constants, its RMS error of the objective in mm, its displacements u_mm (p,)."""

    constants: Constants
    rms_mm: float
    u_mm: Array

    def to_dict(self) -> dict[str, Any]:
        """What study.json says of it."""
        return {**self.constants.named, "total": self.constants.total, "share": self.constants.share,
                "rms_mm": self.rms_mm, "u_mm": self.u_mm.tolist()}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class PointCurve:
    """Displacement of one point over pressure: the models before and after (k,) mm at pressures (k,) MPa of
    the record, and what was read (n,) mm at pressures (n,) MPa with sds (n,) mm."""

    name: str
    node: int | None
    initial: Array
    final: Array
    read_at: Array
    read: Array
    read_sd: Array

    def to_dict(self) -> dict[str, Any]:
        """What study.json says of it."""
        return {"point": self.name, "node": self.node, "initial_mm": self.initial.tolist(),
                "final_mm": self.final.tolist(), "measured_at_MPa": self.read_at.tolist(),
                "measured_mm": self.read.tolist(), "measured_sd_mm": self.read_sd.tolist()}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Study:
    """What was found. measured (p,) mm: the objective's values at the top pressure; sd_mm: their error;
    starts: other initial models; published: what the source of the targets states."""

    points: tuple[str, ...]
    component: int
    top_MPa: float
    measured: Array
    sd_mm: float
    initial: Side
    initial_is_stated: bool
    final: Side
    least: Side
    difference: str
    starts: tuple[Side, ...]
    ridge: Ridge
    agreeing: tuple[float, float]
    known: Knowledge
    readings: tuple[Addition, ...]
    plans: tuple[Plan, ...]
    pressure: Array
    curves: tuple[PointCurve, ...]
    published: Side | None
    published_reduction: float | None
    matching: tuple[float, ...]  # MPa, sums C10 + C01 of an initial model with the published reduction

    @property
    def reduction(self) -> float:
        """By how much the RMS error fell from the initial to the final model, %."""
        return self.reduction_from(self.initial)

    def reduction_from(self, start: Side) -> float:
        """The same from another initial model, %; negative where that one was better."""
        return 100.0 * (1.0 - self.final.rms_mm / start.rms_mm)

    @property
    def separated(self) -> bool:
        """Whether the targets tell C10 from C01."""
        return self.known.share_sd < UNKNOWN

    # -- words ----------------------------------------------------------------------------------------------

    @property
    def headline(self) -> str:
        """What was found, in one sentence."""
        low, high = self._totals
        total = f"{low:.3g} MPa" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.3g} to {high:.3g} MPa"
        if self.separated:
            c = self.final.constants
            return f"The targets fix both constants: C10 = {c.C10:.3g} MPa, C01 = {c.C01:.3g} MPa."
        return f"The targets fix the sum C10 + C01 = {total}; how much of it is C01 they cannot tell."

    @property
    def _agree(self) -> Any:
        """Which rows of the ridge agree with the readings."""
        low, high = self.agreeing
        return (self.ridge.share >= low) & (self.ridge.share <= high)

    @property
    def _totals(self) -> tuple[float, float]:
        """The lowest and highest sum in MPa along the part of the ridge that agrees."""
        own = self.ridge.total[self._agree]
        return float(own.min()), float(own.max())

    @property
    def sentences(self) -> list[str]:
        """What was found, one thought each: fall of the error, ridge, the two searches, what separates."""
        said = [self._fall, self._along, self.difference, self._others, self._separate]
        return [sentence for sentence in said if sentence]

    @property
    def _fall(self) -> str:
        a, b = self.initial, self.final
        assumed = "as stated" if self.initial_is_stated else "assumed; [study] initial states others"
        return (
            f"The RMS error of U{self.component + 1} falls by {self.reduction:.1f} %: from {a.rms_mm:.3g} mm "
            f"with {_pair(a)} ({assumed}) to {b.rms_mm:.3g} mm with {_pair(b)}, "
            "the best of the genetic algorithm."
        )

    @property
    def _along(self) -> str:
        rms, (low, high) = self.ridge.rms_mm[self._agree], self.agreeing
        return (
            f"With the best sum for each share C01/(C10 + C01) from {low:.2g} to {high:.2g}, the error stays "
            f"between {rms.min():.3g} and {rms.max():.3g} mm: this is the ridge. A reading is known to "
            f"{self.sd_mm:.2g} mm."
        )

    @property
    def _others(self) -> str:
        if self.published_reduction is None or not self.matching:
            return ""
        sums = " or ".join(f"{total:.3g}" for total in self.matching)
        return (
            f"The published {self.published_reduction:g} % says more of the first guess than of the result: "
            f"on this finger, initial constants with C10 + C01 = {sums} MPa give it."
        )

    @property
    def _separate(self) -> str:
        if self.separated:
            return ""
        inside = next(r for r in self.readings if r.pressure <= self.top_MPa * (1 + 1e-9))
        best, plan = self.readings[0], min(self.plans, key=lambda p: p.known.share_sd)
        said = [
            f"To tell C10 from C01 by one reading more, {in_words(inside)} serves best: with all "
            f"readings exact to {self._wanted(inside)} mm, the sd of the share is {KNOWN:g}."
        ]
        if best is not inside:
            said.append(
                f"Beyond the pressure of the test, {in_words(best)} asks for {self._wanted(best)} mm only."
            )
        said.append(f"{plan.words} ({plan.count} values) ask for {self._wanted(plan)} mm.")
        if min(best.known.share_sd, plan.known.share_sd) > UNKNOWN:
            said.append(f"Read to {self.sd_mm:.2g} mm, none of these is enough.")
        return " ".join(said)

    def _wanted(self, more: Addition | Plan) -> str:
        """The error of all readings in mm, with this one, for a known share."""
        return f"{more.known.wanted_sd_mm(self.sd_mm):.2g}"

    # -- record ---------------------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The content of study.json."""
        return {
            "headline": self.headline,
            "sentences": self.sentences,
            "points": list(self.points),
            "component": self.component + 1,
            "pressure_MPa": self.top_MPa,
            "measured_mm": self.measured.tolist(),
            "measured_sd_mm": self.sd_mm,
            "initial": self.initial.to_dict() | {"stated": self.initial_is_stated},
            "final": self.final.to_dict(),
            "reduction_percent": self.reduction,
            "least_squares": self.least.to_dict(),
            "difference": self.difference,
            "published": self.published.to_dict() if self.published else None,
            "published_reduction_percent": self.published_reduction,
            "published_reduction_from_total_MPa": list(self.matching),
            "starts": [s.to_dict() | {"reduction_percent": self.reduction_from(s)} for s in self.starts],
            "ridge": {"share": self.ridge.share.tolist(), "total_MPa": self.ridge.total.tolist(),
                      "rms_mm": self.ridge.rms_mm.tolist(), "agreeing_share": list(self.agreeing)},
            "known": knowledge(self.known, self.sd_mm),
            "readings": [reading(r, self.sd_mm) for r in self.readings],
            "plans": [
                {"words": p.words, "count": p.count} | knowledge(p.known, self.sd_mm) for p in self.plans
            ],
            "curves": {"pressure_MPa": self.pressure.tolist(), "points": [c.to_dict() for c in self.curves]},
        }  # fmt: skip


def _pair(side: Side) -> str:
    return f"C10 = {side.constants.C10:.3g}, C01 = {side.constants.C01:.3g} MPa"


def in_words(found: Addition) -> str:
    """A reading as one would ask for it."""
    at = f"{1e3 * found.pressure:.3g} kPa"
    return f"U{found.component + 1} of {found.spot.name} at {at}"


def reading(found: Addition, sd_mm: float) -> dict[str, Any]:
    """A reading as study.json has it."""
    return {"point": found.spot.name, "node": found.spot.node, "x_mm": float(found.spot.place[0]),
            "direction": f"U{found.component + 1}", "pressure_MPa": found.pressure, "u_mm": found.u_mm,
            } | knowledge(found.known, sd_mm)  # fmt: skip


def knowledge(known: Knowledge, sd_mm: float) -> dict[str, Any]:
    """What is known, as study.json has it; null where the share is left open."""
    open_ = not np.isfinite(known.share_sd)
    return {"share_sd": None if open_ else known.share_sd, "correlation": known.correlation,
            "wanted_sd_mm": None if open_ else known.wanted_sd_mm(sd_mm)}  # fmt: skip


# -- the report ----------------------------------------------------------------------------------------------


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
    return {
        "sentences": record["sentences"],
        "rows": [{"name": name, "here": here, "published": stated} for name, here, stated in rows],
        "starts": record["starts"],
        "known": record["known"],
        "readings": [
            {"within": "up to the pressure of the test", "rows": inside[:SHOWN]},
            {"within": "beyond it, if the finger bears it", "rows": beyond[:SHOWN]},
        ],
        "plans": record["plans"],
    }
