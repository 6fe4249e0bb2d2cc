"""All hypotheses on a base model to first order -> refits of those that may be the best.

One list: every absent effect in all its laws, its widest family too, stand-ins, pairs. They are refitted in
the order of their evidence to first order, while one may come within REACH of the best refit.
docs/how-it-decides.md says what fixes each constant.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calibrate import Fit
from twin.diagnosis.hypotheses import Hypothesis, ranked
from twin.diagnosis.refitting import DOUBT, near_with_effects, refitted
from twin.diagnosis.screening import added, fits, paired, screened
from twin.diagnosis.signatures import Signatures, signatures_of
from twin.effects.protocol import Effect, Test, Unsolvable
from twin.effects.requirements import lacking
from twin.judging.judged import Judged, judge_base, judge_fit
from twin.model.prediction import Model
from twin.targets import Array, Targets

Progress = Callable[[str, int, int], None]

DETECTED = 0.01  # after multiplicity
REACH = 12.0  # of 2 ln B: so far behind the best refit a hypothesis may be to first order and is refitted,
BENT = 0.1  # and by this share of the best one's evidence more: so wrong the first order may be
FAR = 0.5  # the same share where no effect fits: it may bend in its own size
FURTHER = 2  # effects that are refitted then
PAIRED = 10.0  # by which several together must beat the best single to first order to be refitted
SHARE = 0.15  # and by this share of its evidence where they do not fit without law errors
LATE = "takes whole solves to try, and is tried where nothing else fits"
MOST = 12  # effects and stand-ins that are refitted, each in its laws; of several together a third of it


@dataclass(frozen=True)
class Task:
    """A base model, the effects and stand-ins that may be missing from it, and targets."""

    model: Model
    effects: tuple[Effect, ...]
    generic: tuple[Effect, ...]
    targets: Targets
    seed: int
    tell: Progress
    known: dict[str, Sequence[Array]] = field(default_factory=dict)  # tangents at the base fit, by label

    def base(self, start: Array | Fit) -> Judged:
        """The base model's fit; from nominal constants too where the first ends at a bound."""
        self.tell("base model", 0, 3)
        if isinstance(start, Fit):
            fit = judge_fit(self.model, self.targets, start)
        else:
            fit = judge_base(self.model, self.targets, starts=start, seed=self.seed)
        if not fit.at_bound:
            return fit
        again = judge_base(self.model, self.targets, starts=self.nominal, seed=self.seed)
        return min(fit, again, key=lambda j: j.deviance)

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
    def silent(self) -> list[Hypothesis]:
        """The effects that these data cannot show, with what they lack."""
        present = {e.name for e in self.model.effects} | {e.name for e in self.absent}
        lost = [e for e in self.effects if e.name not in present]
        return [Hypothesis(effects=(e,), note=lacking(e.requires, self.targets)) for e in lost]

    def signatures(
        self, base: Judged, effects: Sequence[Effect], *, beside: Judged | None = None
    ) -> Signatures:
        """Effects as they would show beside a judged model, by default the base, by what they add to the base
        to first order."""
        missing = [e for e in effects if e.label not in self.known]
        if missing:
            self.known.update(self.model.tangents(base.theta, missing))
        return signatures_of(beside or base, effects, tangents=self.known)

    def laws(self, *, wide: bool) -> list[Effect]:
        """Every law of the absent effects whose amplitudes alone tell how it shows, each one's widest family
        too where it is asked for; what takes whole solves to tell is left for later."""
        smooth = [e for e in self.absent if e.smooth]
        more = [law for e in smooth for law in e.laws()[1:]]
        more += [family for e in smooth if (family := e.wide()) is not None]
        return smooth + [e for e in more if wide and on_a_basis(e, self.model.test)]

    # -- the search -----------------------------------------------------------------------------------------

    def searched(self, base: Judged) -> list[Hypothesis]:
        """All hypotheses on the base model, those that may be the best refitted."""
        self.tell("signatures", 1, 3)
        wrong = not base.comparison.adequate
        rows = self._screened(base, [*self.laws(wide=wrong), *self.generic])
        able = [h for h in rows if not h.note and h.gain > 0 and (wrong or h.p_value < DETECTED)]
        refits = Refits(self, base, starts=({**self.model.named(self.nominal)},) if base.at_bound else ())
        refits.run(able)
        if wrong and not refits.fits:
            others = {h.physics for h in refits.done}
            refits.run([h for h in able if not h.kind and h.physics not in others], most=FURTHER, bent=FAR)
        rough = [e for e in self.absent if not e.smooth]
        if wrong and not refits.fits:
            late = self._screened(base, rough)
            refits.run([h for h in late if not h.note and h.gain > 0])
        else:
            late = [Hypothesis(effects=(e,), note=LATE) for e in rough]
        rows += late
        if wrong and any(not h.kind for h in refits.done):
            refits.run(self._several(base, refits), most=MOST // 3)
            refits.run(self._partners(base, refits), most=MOST // 3)
            refits.run(self._third(base, refits), most=1)
        refits.tell_apart()
        return [*refits.done, *(h for h in rows if h.label not in refits.tried), *self.silent]

    def _screened(self, base: Judged, effects: Sequence[Effect]) -> list[Hypothesis]:
        """Hypotheses by what they promise at the base fit; where that ends at a bound, at nominal constants
        too: there no fit misleads."""
        rows = screened(base, self.signatures(base, effects))
        if not base.at_bound:
            return rows
        try:
            view = judge_fit(self.model, self.targets, replace(base.fit, theta=self.nominal, at_bound=()))
            others = screened(view, signatures_of(view, effects))
        except Unsolvable:
            return rows
        rest = view.z - view.fitted @ np.linalg.lstsq(view.fitted, view.z, rcond=1e-12)[0]
        short = max(float(rest @ rest) - base.comparison.chi2, 0.0)  # what the first order does not know
        return [
            a if b.note or b.gain - short <= a.gain else replace(b, gain=b.gain - short, hint=b.hint - short)
            for a, b in zip(rows, others, strict=True)
        ]

    def _narrow(self) -> list[Effect]:
        return [e for e in self.laws(wide=False) if e.label in self.known]

    def _several(self, base: Judged, refits: "Refits") -> list[Hypothesis]:
        """Pairs of effects that beat every single one: to first order at the base fit what those promised
        there, or at the best refit of an effect its evidence."""
        single, view = refits.best, refits.view
        if single is not None and single.kind:
            single = ranked([h for h in refits.done if not h.kind])[0]
            view = self._view(base, single) if single.refit is not None else None
        if single is None or single.evidence is None:
            return []
        least = min(single.evidence, single.hint) + PAIRED
        first = paired(base, self.signatures(base, self._narrow()))
        pairs = {frozenset(h.names): h for h in first if h.hint > least}
        if view is not None:
            signatures = self.signatures(base, self._narrow(), beside=view)
            for k, h in enumerate(self._added(base, view, single.effects)):
                pairs.pop(frozenset(h.names), None)  # begun from a refit it is nearer
                promising = k == 0 and not single.adequate
                if h.hint > PAIRED and (promising or not self._in_vain(h, single.evidence, view, signatures)):
                    pairs[frozenset(h.names)] = replace(h, hint=h.hint + single.evidence)
        return list(pairs.values())

    def _in_vain(self, h: Hypothesis, evidence: float, view: Judged, signatures: Signatures) -> bool:
        """Whether an effect beside the best single one, of this evidence and view, would not be named: it
        leads by less than SHARE and leaves more than noise."""
        if not PAIRED < h.hint < SHARE * evidence:
            return False
        beside = h.effects[-1].name  # its label may say at which entry of its grid
        rows = [r for each in signatures.values() for r in each if r.effect.name == beside and not r.note]
        return not fits(view, self.targets, rows)

    def _partners(self, base: Judged, refits: "Refits") -> list[Hypothesis]:
        """Each member of the best pair with every other effect, begun from its own refit: a partner is not
        named where another does as well."""
        top = refits.best
        if top is None or len(top.effects) != 2:
            return []
        done, out = {frozenset(h.names) for h in refits.done}, []
        for member in top.effects:
            alone = next((h for h in refits.done if h.label == member.label), None)
            alone = alone or refits.refit(Hypothesis(effects=(member,), hint=top.hint, start=top.start))
            if alone.evidence is not None:
                view = self._view(base, alone)
                rows = self._added(base, view, (member,))
                out += [replace(h, hint=h.hint + alone.evidence) for h in rows]
        return [h for h in out if frozenset(h.names) not in done]

    def _third(self, base: Judged, refits: "Refits") -> list[Hypothesis]:
        """The best pair with a third effect, where no pair is adequate."""
        pairs = [h for h in ranked(refits.done) if len(h.effects) == 2 and h.refit is not None]
        if not pairs or any(h.adequate for h in refits.done):
            return []
        top = pairs[0]
        view = self._view(base, top)
        rows = self._added(base, view, top.effects)
        return [replace(h, hint=h.hint + (top.evidence or 0.0)) for h in rows[:1]]

    def _added(self, base: Judged, view: Judged, effects: tuple[Effect, ...]) -> list[Hypothesis]:
        """Effects of a judged model, and each other one beside them, where it shows most; the best first."""
        rows = screened(view, self.signatures(base, self._narrow(), beside=view))
        return added([self.closest(base, h, beside=view) for h in rows], effects, base.model.test)

    def closest(self, base: Judged, h: Hypothesis, *, beside: Judged) -> Hypothesis:
        """A hypothesis on one effect beside a judged model, at the best entry of the finest grid."""
        finer = h.effect.closer(h.start, base.model.test) if h.gain > 0 and not h.note else None
        if finer is None:
            return h
        tangents = base.model.tangents(base.theta, [finer])
        (best,) = screened(beside, signatures_of(beside, [finer], tangents=tangents))
        return replace(h, start=best.start, gain=best.gain) if best.gain > h.gain else h

    def _view(self, base: Judged, h: Hypothesis) -> Judged:
        """The judged model of a refit, by the solves that its model has kept."""
        assert h.fit is not None
        return judge_fit(near_with_effects(base, h.effects, self.targets, self.known), self.targets, h.fit)


@dataclass
class Refits:
    """Refits by their evidence to first order. done: those that were made, of hypotheses `tried`, by label;
    best: the best of them, and view, its judged model."""

    task: Task
    base: Judged
    starts: tuple[Mapping[str, float], ...] = ()
    done: list[Hypothesis] = field(default_factory=list)
    tried: set[str] = field(default_factory=set)
    best: Hypothesis | None = None
    view: Judged | None = None

    @property
    def fits(self) -> bool:
        """Whether an effect fits, be it with law errors."""
        return any(h.adequate and not h.kind for h in self.done)

    def run(self, rows: Sequence[Hypothesis], *, most: int = MOST, bent: float = BENT) -> None:
        """Refit these, the physics that promises most first, while one may come within reach of the best, the
        first order being wrong by a share `bent`; at least one that is no stand-in."""
        waiting: dict[str, list[Hypothesis]] = {}
        for h in sorted(rows, key=lambda h: -h.hint):
            waiting.setdefault(h.physics, []).append(h)
        count = 0
        for laws in waiting.values():
            lone = not laws[0].kind and all(d.kind for d in self.done)
            if lone or (count < most and self._near(laws[0], bent)):
                count += 1
                self._laws(laws) if len(laws[0].effects) == 1 else self._together(laws[0])

    def _laws(self, laws: Sequence[Hypothesis]) -> None:
        """Refit one physics in its laws, the narrowest first, until one leaves nothing to a law's errors."""
        rows = {h.label: h for h in laws}
        last: Hypothesis | None = None
        for law in self._widening(laws[0]):
            h = rows.get(law.label)
            if h is None and last is not None and last.refit is not None:
                h = replace(last, effects=(law,), start=law.start(last.start), refit=None, score=None)
            if h is None:
                continue
            last = self.refit(h)
            if _left_nothing(last):
                break

    def _together(self, h: Hypothesis) -> None:
        """Refit several effects in their narrowest laws, then in those that they were proposed in, until
        nothing is left to a law's errors."""
        for each in (self._narrowed(h), h):
            if each.label not in self.tried and _left_nothing(self.refit(each)):
                break

    def _narrowed(self, h: Hypothesis) -> Hypothesis:
        """Several effects in their narrowest laws, begun where those were refitted alone: a law that is wide
        because a partner was missing is none beside it."""
        alone = {r.label: r.start for r in self.done if len(r.effects) == 1 and r.refit is not None}
        narrow = {e.name: e for e in self.task.absent if e.label in alone}
        effects = tuple(narrow.get(name, e) for name, e in zip(h.names, h.effects, strict=True))
        labels = {e.label for e in effects} - {e.label for e in h.effects}
        changed = [e for e in effects if e.label in labels]
        start = {k: x for k, x in h.start.items() if k.partition(".")[0] not in [e.name for e in changed]}
        start |= {p.name: alone[e.label][p.name] for e in changed for p in e.parameters}
        return replace(h, effects=effects, start=start)

    def _widening(self, h: Hypothesis) -> list[Effect]:
        """The laws of what a hypothesis says is missing, the narrowest first; of a stand-in, itself."""
        law = next((e for e in self.task.absent if e.name == h.physics), None)
        if law is None:
            return [h.effect]
        out, wide = [], law.wide()
        while law is not None:
            out.append(law)
            law = law.wider()
        return [*out, *([wide] if wide is not None else [])]

    def _near(self, h: Hypothesis, bent: float) -> bool:
        if self.best is None or self.best.evidence is None:
            return True
        best = min(self.best.evidence, self.best.hint)  # to first order it may have promised less than it has
        return h.hint > best - REACH - bent * abs(best)

    def refit(self, h: Hypothesis) -> Hypothesis:
        """The hypothesis with its refit, which is kept in `done`."""
        self.task.tell(f"refit with {h.label}", len(self.done) + 1, len(self.done) + 2)
        held = self._held(h)
        refit, judged = self._refitted(held)
        widest = len(h.effects) == 1 and h.effect.wider() is None and h.effect.wide() is None
        if _left_nothing(refit) and refit.score is not None and refit.score.near and not widest:
            refit, judged = self._refitted(replace(held, start=refit.start), exact=True)
        self.done.append(refit)
        self.tried.add(h.label)
        if judged is not None and (self.best is None or _better(refit, self.best)):
            self.best, self.view = refit, judged
        return refit

    def tell_apart(self) -> None:
        """Solve the ends of the best and of what the response cannot tell from it."""
        while near := rivals(self.done):
            for h in near:
                self.done[self.done.index(h)], _ = self._refitted(h, exact=True)

    def _refitted(self, h: Hypothesis, *, exact: bool = False) -> tuple[Hypothesis, Judged | None]:
        return refitted(
            h, self.base, self.task.targets, starts=() if exact else self.starts, seed=self.task.seed,
            tangents=self.task.known, exact=exact,
        )  # fmt: skip

    def _held(self, h: Hypothesis) -> Hypothesis:
        """The hypothesis for a refit: what cannot be fitted, such as a marker and a time, is held where it
        shows most."""
        if len(h.effects) > 1:
            return h
        h = self.task.closest(self.base, h, beside=self.base)
        return replace(h, effects=(h.effect.at(h.start, self.base.model.test),))


def _better(a: Hypothesis, b: Hypothesis) -> bool:
    """Whether a refit is better than another: by evidence; of two laws of one physics the one that fits."""
    if a.physics == b.physics and a.adequate != b.adequate:
        return a.adequate
    return (a.evidence or -np.inf) > (b.evidence or -np.inf)


def _left_nothing(h: Hypothesis) -> bool:
    """True if a refit leaves nothing to a law's errors."""
    return h.adequate and h.score is not None and not h.score.law


def rivals(rows: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Of the refits by the response the best one, and those within REACH and their DOUBT of it where one of
    these is of another physics."""
    scored = [h for h in ranked(list(rows)) if h.evidence is not None]
    top = max((h.evidence or 0.0 for h in scored), default=0.0)
    close = [h for h in scored if (h.evidence or 0.0) > top - REACH - DOUBT * abs(top)]
    alone = all(h.physics == close[0].physics for h in close)
    return [h for h in close[: 1 if alone else None] if h.score is not None and h.score.near]


def on_a_basis(effect: Effect, test: Test) -> bool:
    """True if all of an effect's parameters are amplitudes, but for those that its tries on a test state."""
    others = {p.name for p in effect.parameters if p.null is None}
    return all(others <= set(entry) for entry in effect.tries(test))
