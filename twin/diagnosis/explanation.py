"""The evidence for one effect: the model without it and with it, side by side.

What the effect explains is what it takes off the residual, once everything else is fitted anew; it stands
beside the residual, in mm and sds, by marker and branch. Held-out errors say whether it foretells data that
it was not fitted to.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate import Parameter
from twin.effects.protocol import Effect
from twin.judging.comparison import BRANCHES, branches
from twin.judging.heldout import HeldOut, held_out
from twin.judging.intervals import Estimate, estimates
from twin.judging.judged import Judged
from twin.judging.whitening import Whitener
from twin.targets import Array, Targets

ALL = "all"
WIDE = 20  # letters of a column of the table


@dataclass(frozen=True, kw_only=True)
class Share:
    """What an effect explains at one marker (or all) in one branch (or all): root mean squares in mm of the
    residual before, of what the effect takes off it, and of what it leaves; before and after in sds, too."""

    marker: str
    branch: str
    count: int
    before_mm: float
    signature_mm: float
    after_mm: float
    before_sd: float
    after_sd: float

    @property
    def explained(self) -> float:
        """The share of the residual's mean square that the effect takes away."""
        return 1 - (self.after_mm / self.before_mm) ** 2 if self.before_mm > 0 else 0.0


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Everything that speaks for or against one effect; residual, signature and left (s, p, 3) mm are without
    the errors that many values share, NaN where no data."""

    effect: str
    sentence: str
    parameters: tuple[Estimate, ...]
    plausible: Mapping[str, str]  # by parameter: what its value says beside its plausible range
    chi2_before: float
    chi2_after: float
    gain: float  # fall of chi2 + ln det of the covariance
    more_parameters: int
    evidence: float | None  # 2 ln of the Bayes factor, where it was computed
    held_out: HeldOut
    rms_before_mm: float
    rms_after_mm: float
    noise_sd_mm: float
    adequate: bool
    shares: tuple[Share, ...]
    mimics: tuple[tuple[str, float], ...]  # what mimics it, and how much (cos2) of its signature
    residual: Array
    signature: Array
    left: Array

    def to_dict(self) -> dict[str, Any]:
        """What `evidence` of diagnosis.json and evidence.json hold; the maps are arrays of evidence.npz."""
        plain = (
            "effect", "sentence", "chi2_before", "chi2_after", "gain", "more_parameters", "evidence",
            "rms_before_mm", "rms_after_mm", "noise_sd_mm", "adequate",
        )  # fmt: skip
        rows = {e.name: e.to_dict() | {"plausible": self.plausible.get(e.name, "")} for e in self.parameters}
        return {name: getattr(self, name) for name in plain} | {
            "parameters": rows,
            "held_out": vars(self.held_out),
            "shares": [vars(s) | {"explained": s.explained} for s in self.shares],
            "class": [{"effect": name, "ceiling": ceiling} for name, ceiling in self.mimics],
        }

    @property
    def arrays(self) -> dict[str, Array]:
        """What evidence.npz holds."""
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
    residual, left = (_cleaned(s.whitener, targets.value - s.predicted) for s in (before, after))
    own = [p for p in after.model.parameters if p.name.partition(".")[0] in names]
    every = {e.name: e for e in estimates(after.fit, after.comparison)}
    return Explanation(
        effect=" + ".join(e.label for e in effects),
        sentence="; ".join(e.sentence for e in effects),
        parameters=tuple(every[p.name] for p in own),
        plausible={p.name: plausibility(p, after.values[p.name]) for p in own},
        chi2_before=before.comparison.chi2,
        chi2_after=after.comparison.chi2,
        gain=before.deviance - after.deviance,
        more_parameters=len(after.model.parameters) - len(before.model.parameters),
        evidence=evidence,
        held_out=held_out(before, after, targets),
        rms_before_mm=before.comparison.rms_mm,
        rms_after_mm=after.comparison.rms_mm,
        noise_sd_mm=after.comparison.noise_sd_mm,
        adequate=after.comparison.adequate,
        shares=shares(targets, w, residual, left),
        mimics=tuple(mimics),
        residual=residual,
        signature=residual - left,
        left=left,
    )


def _cleaned(w: Whitener, residual: Array) -> Array:
    """A residual (s, p, 3) mm without its shared errors; NaN where no data."""
    out = np.full(residual.shape, np.nan)
    out[:, w.components[:, 0], w.components[:, 1]] = w.cleaned(residual)
    return out


def shares(targets: Targets, w: Whitener, residual: Array, left: Array) -> tuple[Share, ...]:
    """What is explained by marker and branch, and of all, from cleaned residuals (s, p, 3) mm without the
    effect and with it."""
    point, axis = w.components.T
    noise = np.sqrt(w.sd**2 + (w.modes[w.shared :] ** 2).sum(axis=0))
    branch = branches(targets.time, targets.pressure, targets.log_time, targets.log_pressure)
    markers = {targets.names[k]: point == k for k in np.unique(point)} | {ALL: np.ones(len(point), bool)}
    steps = {name: branch == k for k, name in enumerate(BRANCHES)} | {ALL: np.ones(len(branch), bool)}
    before, after = residual[:, point, axis], left[:, point, axis]
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
    )  # fmt: skip


# -- beside what is known ------------------------------------------------------------------------------------


def plausibility(parameter: Parameter, value: float) -> str:
    """What a fitted value says beside its plausible range, in words; "" where none is declared."""
    if parameter.plausible is None:
        return ""
    low, high = parameter.plausible
    span = f"{low:.3g} to {high:.3g} {parameter.unit}".rstrip()
    return f"plausible ({span})" if low <= value <= high else f"not plausible: expected {span}"


# -- in words ------------------------------------------------------------------------------------------------


def table(e: Explanation) -> list[str]:
    """The evidence as lines of a terminal: numbers, then a row a marker and a column a branch."""
    out = [f"{e.effect}: {e.sentence}."]
    out.append(
        f"Error: {e.rms_before_mm:.4f} mm rms without it, {e.rms_after_mm:.4f} mm with it; the noise is "
        f"{e.noise_sd_mm:.4f} mm."
    )
    bayes = "" if e.evidence is None else f", 2 ln B = {e.evidence:.0f}"
    out.append(
        f"chi2: {e.chi2_before:.0f} without, {e.chi2_after:.0f} with {e.more_parameters} more "
        f"parameter{'s' * (e.more_parameters != 1)}{bayes}."
    )
    h = e.held_out
    out.append(
        f"Foretold, each {h.left_out} from the others: {h.before_sd:.2f} sd without, {h.after_sd:.2f} with."
    )
    mimics = ", ".join(f"{name} {100 * c:.0f} %" for name, c in e.mimics)
    out += [f"What could mimic it: {mimics}."] if mimics else []
    names = list(dict.fromkeys(s.marker for s in e.shares))
    parts = list(dict.fromkeys(s.branch for s in e.shares))
    cell = {(s.marker, s.branch): s for s in e.shares}
    wide = max(len(name) for name in names)
    out += ["", "Residual in sds without -> with it, and the share explained:"]
    out.append(" " * wide + "".join(f"{part:>{WIDE}}" for part in parts))
    for name in names:
        row = [f"{_cell(cell[name, part]) if (name, part) in cell else '-':>{WIDE}}" for part in parts]
        out.append(f"{name:<{wide}}" + "".join(row))
    return out


def _cell(s: Share) -> str:
    percent = round(100 * s.explained)
    return f"{s.before_sd:.1f} -> {s.after_sd:.1f} {percent:4d} %"
