"""Everything that is tried on a base model, and in which order: from its own fit to effects that are missing
together.

Signatures at the base fit; refits of the effects that promise most, and of those that mimic the best; wider
laws where none is adequate, then declared families and pairs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibrate import Fit
from twin.diagnosis.candidates import Candidate, Refit
from twin.diagnosis.classes import shares_of
from twin.diagnosis.pairs import Group, best_pairs, confirmed
from twin.diagnosis.refitting import PROMISING, Progress, refits, resembling, worth_refitting
from twin.diagnosis.screening import screened
from twin.diagnosis.signatures import Signatures, signatures_of
from twin.diagnosis.verdicts import SECOND, TIE, Trial, ranked
from twin.effects.protocol import Effect, Test, Unsolvable
from twin.effects.requirements import lacking
from twin.judging.judged import Judged, judge, judge_fit
from twin.model.prediction import Model
from twin.targets import Array, Targets

ALIASES = 3  # effects that are refitted because they mimic the best one
APART = 12.0  # chi2 by which an effect may fall short of the best one, to first order, and still be refitted
BENT = 0.1  # of the best one's chi2: so wrong the first order may be
PAIRS = 2  # pairs that are refitted
FAMILIES = 3  # and wider families
HALF = 0.5  # of the best one's evidence: what another must have to cast doubt on it

Content = tuple[tuple[str, ...], bytes, tuple[str, ...], bytes]


@dataclass(frozen=True)
class Search:
    """A model, the effects and stand-ins that may be missing from it, and targets.

    workers: processes that refit; tell: who hears of the progress.
    """

    model: Model
    effects: tuple[Effect, ...]
    generic: tuple[Effect, ...]
    targets: Targets
    seed: int
    workers: int
    tell: Progress

    def base(self, start: Array | Fit) -> Judged:
        """The base model's fit; from nominal constants too where the first ends at a bound."""
        self.tell("base model", 0, 3)
        if isinstance(start, Fit):
            first = judge_fit(self.model, self.targets, start)
        else:
            first = judge(self.model, self.targets, starts=start, seed=self.seed)
        if not first.at_bound:
            return first
        again = judge(self.model, self.targets, starts=self.nominal, seed=self.seed)
        return min(first, again, key=lambda j: j.deviance)

    @cached_property
    def nominal(self) -> Array:
        """The base model's nominal parameters (d,)."""
        values = [p.start if p.start is not None else p.null for p in self.model.parameters]
        middle = [(p.low + p.high) / 2 for p in self.model.parameters]
        return np.array([m if v is None else v for v, m in zip(values, middle, strict=True)])

    @cached_property
    def absent(self) -> tuple[Effect, ...]:
        """The effects that the model does not have and the data can show."""
        present = {e.name for e in self.model.effects}
        return tuple(
            e for e in self.effects if e.name not in present and not lacking(e.requires, self.targets)
        )

    @cached_property
    def silent(self) -> list[Candidate]:
        """The effects that these data cannot show, with what they lack."""
        present = {e.name for e in self.model.effects} | {e.name for e in self.absent}
        lost = [e for e in self.effects if e.name not in present]
        return [Candidate(effect=e, note=lacking(e.requires, self.targets)) for e in lost]

    @cached_property
    def _known(self) -> dict[Content, Signatures]:
        return {}

    def signatures_at(self, judged: Judged) -> Signatures:
        """Absent effects and stand-ins as they would show beside a judged model."""
        key = _content(judged)
        if key not in self._known:
            present = {e.name for e in judged.model.effects}
            every = [e for e in (*self.absent, *self.generic) if e.name not in present]
            self._known[key] = signatures_of(judged, every, workers=self.workers)
        return self._known[key]

    # -- what is tried --------------------------------------------------------------------------------------

    def tried(self, base: Judged) -> Trial:
        """All that is tried on the base model."""
        self.tell("signatures", 1, 3)
        found = self.signatures_at(base)
        rows = self._screened(base, found)
        starts = (self.nominal,) if base.at_bound else ()
        rows = self._with(rows, worth_refitting(rows, adequate=base.comparison.adequate), base, starts)
        rows = self._with(rows, self._mimics(base, rows, found), base, ())
        rows += self._wider_laws(base, rows)
        if not base.comparison.adequate and not any(c.adequate for c in rows):
            rows = self._with(rows, resembling(rows), base, ())
        trial = Trial(
            base=base,
            candidates=(*(c for c in rows if not c.kind), *self.silent),
            stand_ins=tuple(c for c in rows if c.kind),
        )
        best = ranked([c for c in trial.candidates if c.evidence is not None])
        if base.comparison.adequate or not _asks_for_more(best, trial.stand_ins):
            return trial
        wide = self._families(base, best)
        trial = replace(trial, candidates=(*trial.candidates, *self._narrow(base, wide, best, rows)))
        groups = self._groups(base, found, best)
        return replace(
            trial, wide=tuple(wide), groups=tuple(groups), beside=self._beside(best) if wide else {}
        )

    def _screened(self, base: Judged, found: Signatures) -> list[Candidate]:
        """Candidates by what they promise at the base fit; where that ends at a bound, at nominal constants
        too: there no fit misleads."""
        rows = screened(base, found)
        if not base.at_bound:
            return rows
        try:
            there = replace(base.fit, theta=self.nominal, at_bound=())
            view = judge_fit(self.model, self.targets, there)
        except Unsolvable:
            return rows
        others = screened(view, self.signatures_at(view))
        left = base.comparison.chi2
        rest = view.z - view.fitted @ np.linalg.lstsq(view.fitted, view.z, rcond=1e-12)[0]
        short = max(float(rest @ rest) - left, 0.0)  # what the first order does not know of the base fit
        return [
            replace(b, gain=b.gain - short) if b.gain - short > a.gain and not b.note else a
            for a, b in zip(rows, others, strict=True)
        ]

    def _refits(
        self, chosen: Sequence[Candidate], base: Judged, starts: tuple[Array, ...]
    ) -> list[Candidate]:
        own = [self._held(c, base) for c in chosen]
        return refits(
            own, base, self.targets, starts=starts, seed=self.seed, workers=self.workers, tell=self.tell
        )

    def _held(self, c: Candidate, base: Judged) -> Candidate:
        """The candidate as it is fitted: what cannot be fitted, such as a marker and a time, is held where it
        shows most."""
        finer = c.effect.closer(c.start, self.model.test)
        if finer is not None:
            (best,) = screened(base, signatures_of(base, [finer]))
            c = replace(c, start=best.start, gain=best.gain) if best.gain > c.gain else c
        return replace(c, effect=c.effect.at(c.start, self.model.test))

    def _with(
        self, rows: Sequence[Candidate], chosen: Sequence[Candidate], base: Judged, starts: tuple[Array, ...]
    ) -> list[Candidate]:
        """The candidates, the chosen ones refitted."""
        new = dict(zip(map(id, chosen), self._refits(chosen, base, starts), strict=True))
        return [new.get(id(c), c) for c in rows]

    def _mimics(
        self, base: Judged, rows: Sequence[Candidate], found: Signatures
    ) -> list[Candidate]:
        """The candidates without a refit that could do what the best one does."""
        fitted = ranked([c for c in rows if c.evidence is not None and not c.kind])
        if not fitted or fitted[0].refit is None or (fitted[0].evidence or 0.0) < TIE:
            return []
        refit = fitted[0].refit
        before, after = (x.comparison.residual for x in (base, refit))
        size, shares = shares_of(np.nan_to_num(before - after), base, found)
        short = {label: size * (1 - share) for label, share in shares.items()}
        able = [c for c in rows if c.refit is None and not c.note and c.gain > 0]
        near = [c for c in able if short[c.effect.label] < max(APART, BENT * size)]
        near.sort(key=lambda c: short[c.effect.label])
        return [c for c in near if not c.kind][:ALIASES] + [c for c in near if c.kind][:1]

    def _wider_laws(self, base: Judged, rows: Sequence[Candidate]) -> list[Candidate]:
        """Wider laws of the candidates that came furthest, until one is surely adequate or none is left."""
        out: list[Candidate] = []
        fitted = ranked([c for c in rows if c.evidence is not None and not c.kind])
        top = (fitted[0].evidence or 0.0) if fitted else 0.0
        if base.comparison.adequate or any(c.sure for c in fitted):
            return []
        for c in fitted[:2]:
            last = c
            while last.refit is not None and not last.sure and (last.evidence or 0.0) > PROMISING * top:
                law = last.effect.wider()
                if law is None:
                    break
                start = law.start(last.refit.values)
                (last,) = self._refits([replace(c, effect=law, start=start)], base, ())
                out.append(last)
        return out

    def _families(self, base: Judged, best: Sequence[Candidate]) -> list[Candidate]:
        """The declared wider families that promise most, of all absent effects, refitted."""
        wide = [w for e in self.absent if (w := e.wide()) is not None]
        fits = {c.effect.name: c.refit for c in reversed(best) if c.refit is not None}
        able = [w for w in wide if _on_a_basis(w, base.model.test)]
        rows = [c for c in screened(base, signatures_of(base, able)) if not c.note and c.gain > 0]
        rows = sorted(rows, key=lambda c: -c.gain)[:FAMILIES]
        rows += [Candidate(effect=w) for w in wide if w not in able and w.name in fits]
        begun = [
            replace(c, start=c.effect.start(fits[c.effect.name].values)) if c.effect.name in fits else c
            for c in rows
        ]
        return [c for c in self._refits(begun, base, ()) if c.refit is not None]

    def _narrow(
        self,
        base: Judged,
        wide: Sequence[Candidate],
        best: Sequence[Candidate],
        rows: Sequence[Candidate],
    ) -> list[Candidate]:
        """Refits of the library's own laws of the best family's effect that have none yet: the first, and the
        widest where that shows most."""
        fits = ranked([c for c in wide if c.adequate])
        if not fits:
            return []
        name = fits[0].effect.name
        own = [c for c in rows if c.effect.name == name and not c.note]
        tried = {c.effect.label for c in best if c.refit is not None}
        first = [c for c in own if c.gain > 0 and c.effect.label not in tried][:1]
        laws = own[0].effect.laws()[1:] if own else ()
        law = next((w for w in reversed(laws) if _on_a_basis(w, base.model.test)), None)
        if law is None or law.label in {*tried, fits[0].effect.label}:
            return self._refits(first, base, ())
        widest = [c for c in screened(base, signatures_of(base, [law])) if c.gain > 0 and not c.note]
        return self._refits([*first, *widest], base, ())

    def _groups(
        self, base: Judged, found: Signatures, best: Sequence[Candidate]
    ) -> list[Group]:
        """The pairs that promise most, refitted; a third effect where none of them is adequate."""
        own = {label: rows for label, rows in found.items() if not rows[0].effect.kind}
        pairs = best_pairs(base, own, count=PAIRS)
        if best and best[0].refit is not None:
            beside = self._added_to((best[0].effect,), best[0].refit, best[0].gain)
            if beside:  # begun from a refit it is nearer than the same pair from the base
                pairs = [g for g in pairs if set(g.names) != set(beside.names)] + [beside]
        groups = self._confirmed(pairs, base)
        top = groups[0] if groups else None
        alone = max((c.delta_bic or 0.0 for c in best), default=0.0)
        if top is None or top.refit is None or top.adequate or (top.delta_bic or 0.0) < alone + SECOND:
            return groups
        third = self._added_to(top.effects, top.refit, top.promise)
        return self._confirmed([third], base) + groups if third else groups

    def _confirmed(self, groups: Sequence[Group], base: Judged) -> list[Group]:
        found = confirmed(
            groups, base, self.targets, seed=self.seed, workers=self.workers, tell=self.tell
        )
        return sorted(found, key=lambda g: -(g.evidence or -np.inf))

    def _added_to(self, effects: tuple[Effect, ...], refit: Refit, gain: float) -> Group | None:
        """Effects of a refit, and the one that promises most beside them."""
        view = self._view(refit)
        rows = screened(view, self.signatures_at(view))
        rows = [r for r in rows if not r.kind and not r.note and r.gain > 0]
        if not rows:
            return None
        top = self._held(max(rows, key=lambda r: r.gain), view)
        return Group(effects=(*effects, top.effect), promise=gain + top.gain, start=top.start)

    def _beside(self, best: Sequence[Candidate]) -> dict[str, float]:
        """The evidence of the best effect with each other explanation on top of it, to first order; none
        where no effect was refitted."""
        top = next((c for c in best if c.refit is not None), None)
        if top is None or top.refit is None:
            return {}
        view = self._view(top.refit)
        rows = screened(view, self.signatures_at(view))
        more = (top.effect.generic, top.effect.completed_by)  # beside it they tell nothing
        told = [r for r in rows if not r.note and not (r.kind and r.kind in more)]
        return {r.effect.name: (top.evidence or 0.0) + r.hint for r in told}

    def _view(self, refit: Refit) -> Judged:
        """A refitted model, judged as it stands."""
        key = _content(refit)
        if key not in self._views:
            self._views[key] = judge_fit(refit.model, self.targets, refit.fit)
        return self._views[key]

    @cached_property
    def _views(self) -> dict[Content, Judged]:
        return {}


def _content(fitted: Judged | Refit) -> Content:
    """What tells one fit on these targets from another: its effects, values, bounds and residual. An object's
    address does not: once a record is gone, another may lie there."""
    labels = tuple(e.label for e in fitted.model.effects)
    return labels, fitted.theta.tobytes(), fitted.at_bound, fitted.z.tobytes()


def _asks_for_more(best: Sequence[Candidate], stand_ins: Sequence[Candidate]) -> bool:
    """Whether families and pairs are tried: no effect alone is adequate; or one is, but not beyond doubt
    while another explanation does half as much; or a stand-in explains more."""
    fits = [c for c in best if c.adequate]
    if not fits:
        return True
    most = fits[0].evidence or 0.0
    others = [c.evidence or 0.0 for c in (*best, *stand_ins) if c.effect.name != fits[0].effect.name]
    top = max(others, default=0.0)
    return top > most + TIE or (not fits[0].sure and top > HALF * most)


def _on_a_basis(effect: Effect, test: Test) -> bool:
    """Whether an effect's parameters are amplitudes, but for those that its tries on a test state."""
    others = {p.name for p in effect.parameters if p.null is None}
    return all(others <= set(entry) for entry in effect.tries(test))
