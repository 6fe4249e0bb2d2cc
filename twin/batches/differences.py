"""Two fingers that ought to be alike -> what the second differs in, by the model that fits the first.

The second film is asked what its finger differs in as `diagnose` asks a film what its model lacks: its
residual at the values of the first fit, in which what that left uncertain is an error that all values share,
gives evidence for each of many changes: of the constants, a dimension, an effect, gauge or camera. The best
are refitted, and ranked with those that these data cannot tell from them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from twin.diagnosis.deciding import TIE
from twin.diagnosis.evidence import Gram, occam
from twin.diagnosis.shortlist import BENT, DETECTED, REACH, on_a_basis
from twin.diagnosis.signatures import null, prior_sd
from twin.effects.phrases import percent, way
from twin.effects.protocol import Effect, Theta, Unsolvable
from twin.effects.requirements import lacking
from twin.judging.comparison import Comparison, compare
from twin.judging.fitting import ModelErrors
from twin.judging.whitening import Whitener
from twin.model.discretisation import WALL
from twin.model.prediction import Model
from twin.targets import Array, Targets

MODULUS, CONSTANTS = "modulus", "constants"
BETWEEN = 0.15  # sd of a modulus between batches, of itself: cures differ by a third at most (judgement)
MOST = 8  # changes that are refitted
TURNS, PARTS = 5, (1.0, 0.5, 0.25, 0.1)  # steps of a refit, and the parts of one that are tried
SETTLED = 0.1  # sd, below which a step ends a refit
LEAVES = 0.03  # of the best one's evidence, by which no law is exact: what is closer is no worse


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """One way in which a finger may differ. model, values: with the change absent; directions (k, d): what an
    amplitude does to the model's parameters, sd (k,) of its prior, and the bounds low, high (k,) of it; rows
    (k, s, p, 3) mm: what it does to the displacements, to first order; told: in words, at values."""

    name: str
    model: Model
    values: Theta
    directions: Array
    sd: Array
    low: Array
    high: Array
    rows: Array
    told: Callable[[Theta], str]

    @property
    def theta(self) -> Array:
        """The model's parameters (d,) with the change absent."""
        return self.model.theta(self.values)

    def at(self, amplitudes: Array) -> Array:
        """The parameters (d,) at amplitudes (k,), within their bounds."""
        low, high = (np.array([getattr(p, end) for p in self.model.parameters]) for end in ("low", "high"))
        return np.asarray(np.clip(self.theta + amplitudes @ self.directions, low, high), float)


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A change that was refitted: its words and values, 2 ln B against no change, the fall of chi2, and the
    comparison that is left."""

    name: str
    words: str
    values: Theta
    evidence: float
    fall: float
    comparison: Comparison

    @property
    def adequate(self) -> bool:
        """True if it leaves noise alone."""
        return self.comparison.adequate


@dataclass(frozen=True, kw_only=True)
class Differing:
    """What differs. before: the comparison of the second film with the first model; ranking: the changes that
    were refitted, the best first; proven: whether the data ask for any; hints: of all, 2 ln B to first
    order."""

    before: Comparison
    ranking: tuple[Difference, ...] = ()
    proven: bool = False
    hints: Mapping[str, float] = field(default_factory=dict)

    @property
    def nearest(self) -> tuple[Difference, ...]:
        """The best and all that these data cannot tell from it; those that fit come first."""
        if not self.proven:
            return ()
        best = self.ranking[0].evidence
        near = [d for d in self.ranking if d.evidence > best - max(TIE, LEAVES * best)]
        return tuple(sorted(near, key=lambda d: not d.adequate))


def differing(
    model: Model, values: Theta, covariance: Array, targets: Targets, effects: Sequence[Effect]
) -> Differing:
    """What a film's finger differs in from a model at fitted values with a covariance (d, d), of its own
    parameters and of effects that it lacks. Raises Unsolvable where the model has no equilibrium there."""
    asked = SecondFilm.of(model, values, covariance, targets)
    changes = [*own_changes(model, values), *asked.of_effects(effects)]
    rows = sorted(asked.hinted(changes), key=lambda row: -row[1])
    done: list[Difference] = []
    for change, hint, begin in rows[:MOST]:
        best = max((d.evidence for d in done), default=-np.inf)
        behind = hint < min(best, rows[0][1]) - REACH - BENT * abs(best)
        if done and (behind or (asked.before.adequate and hint < 0)):
            break
        found = asked.refitted(change, begin)
        done += [found] if found is not None else []
    done.sort(key=lambda d: -d.evidence)
    tries = max(len(rows), 1)
    by_chance = 1 - (1 - float(scipy.special.chdtrc(1, max(done[0].fall, 0.0)))) ** tries if done else 1.0
    proven = bool(done) and done[0].evidence >= TIE and (not asked.before.adequate or by_chance < DETECTED)
    hints = {change.name: hint for change, hint, _ in rows}
    return Differing(before=asked.before, ranking=tuple(done), proven=proven, hints=hints)


def own_changes(model: Model, values: Theta) -> list[Deviation]:
    """The changes of what a model has: all moduli alike, each constant by itself, and the size of each of its
    effects."""
    names, jacobian = [p.name for p in model.parameters], model.jacobian(model.theta(values))
    rows = {p.name: np.eye(len(names))[k] for k, p in enumerate(model.parameters)}
    moduli = moduli_of(model)
    total = sum(values[name] for name in moduli)

    def change(name: str, directions: Array, sd: Array, told: Callable[[Theta], str]) -> Deviation:
        free = np.full(len(sd), np.inf)
        return Deviation(
            name=name, model=model, values=values, directions=directions, sd=sd, low=-free, high=free,
            rows=np.tensordot(directions, jacobian, 1), told=told,
        )  # fmt: skip

    def sums(found: Theta) -> str:
        share = sum(found[name] for name in moduli) / total - 1
        return f"{' + '.join(moduli)} is {percent(share)} {way(share, 'larger', 'smaller')}"

    def each(found: Theta) -> str:
        return f"the silicone is another: {', '.join(f'{name} = {found[name]:.3g}' for name in moduli)} MPa"

    out = []
    if moduli:
        along = sum(values[name] * rows[name] for name in moduli)
        out.append(change(MODULUS, np.array([along]), np.array([BETWEEN]), sums))
    if len(moduli) > 1:
        every = np.array([rows[name] for name in moduli])
        out.append(change(CONSTANTS, every, np.full(len(moduli), BETWEEN * total), each))
    for e in model.effects:
        own = [p for p in e.amplitudes if p.name in rows]
        if own:
            every = np.array([rows[p.name] for p in own])
            out.append(change(e.name, every, np.array([prior_sd(p) for p in own]), e.told))
    return out


def moduli_of(model: Model) -> list[str]:
    """The moduli of a model's law that are among its parameters."""
    names = [p.name for p in model.parameters]
    return [name for name in (model.law.moduli if model.law else ()) if name in names]


def _covariance(rows: Array) -> Array:
    """The covariance (d, d) of parameters by their whitened derivatives (d, n)."""
    return np.asarray(np.linalg.pinv(rows @ rows.T, rcond=1e-12, hermitian=True), float)


def _root(covariance: Array) -> Array:
    """A matrix (d, d) whose R' R is a covariance, without its part below 0."""
    sizes, axes = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray((axes * np.sqrt(np.maximum(sizes, 0.0))).T, float)


@dataclass(frozen=True)
class SecondFilm:
    """The second film at the values of the first fit: the whitener with what that left uncertain, the
    whitened residual, and the comparison."""

    model: Model
    values: Theta
    targets: Targets
    whitener: Whitener
    z: Array
    before: Comparison

    @staticmethod
    def of(model: Model, values: Theta, covariance: Array, targets: Targets) -> "SecondFilm":
        """At fitted values with their covariance (d, d). What the mesh's stiffness and the walls may be off
        is the same in both films, and the fitted moduli have taken it up: it is no error between the two."""
        theta, errors = model.theta(values), ModelErrors.of(model, model.theta(values), targets)
        jacobian = model.jacobian(theta)
        own = np.array([not name.startswith(WALL) for name in errors.names], bool)
        if model.mesh is not None and model.law and moduli_of(model) == list(model.law.moduli):
            own[:1] = False  # the first is exactly what these moduli take up
        names = tuple(name for name, kept in zip(errors.names, own, strict=True) if kept)
        w = replace(errors, modes=errors.modes[own], names=names).whitener(targets)
        if not own.all():
            least, more = (_covariance(each.whiten(jacobian)) for each in (w, errors.whitener(targets)))
            covariance = least + _root(covariance - more).T @ _root(covariance - more)
        uncertain = np.tensordot(_root(covariance), jacobian, 1)
        w = w.beside(uncertain, ["former"] * len(uncertain))
        predicted = model.predict(theta)
        before = compare(targets, predicted, w, jacobian=jacobian[:0])
        return SecondFilm(model, values, targets, w, before.whitened, before)

    def of_effects(self, effects: Sequence[Effect]) -> list[Deviation]:
        """The changes by effects that the model lacks, each where it shows most."""
        have = {e.name for e in self.model.effects}
        able = [
            e for e in effects
            if e.name not in have and e.smooth and not lacking(e.requires, self.targets)
            and on_a_basis(e, self.model.test)
        ]  # fmt: skip
        tangents, out = self.model.tangents(self.model.theta(self.values), able), list[Deviation]()
        for e in able:
            parameters = e.amplitudes
            offset, sd = (np.array([of(p) for p in parameters]) for of in (null, prior_sd))
            low, high = (np.array([getattr(p, end) for p in parameters]) - offset for end in ("low", "high"))
            grams = [self._gram(rows, sd) for rows in tangents[e.label]]
            best = int(np.argmax([gram.attained(low / sd, high / sd)[1] for gram in grams]))
            entry, rows = e.tries(self.model.test)[best], tangents[e.label][best]
            held = e.at(entry, self.model.test)
            model = self.model.with_effect(held)
            names = [p.name for p in model.parameters]
            values = {**self.values, **entry, **{p.name: null(p) for p in parameters}}
            directions = np.array([np.eye(len(names))[names.index(p.name)] for p in parameters])
            out.append(Deviation(
                name=e.name, model=model, values={name: values[name] for name in names},
                directions=directions, sd=sd, low=low, high=high, rows=rows, told=held.told,
            ))  # fmt: skip
        return out

    def _gram(self, rows: Array, sd: Array) -> Gram:
        """The products of displacements (k, s, p, 3) mm, per prior sd (k,), with the residual."""
        return Gram.of(self.z, self.whitener.whiten(rows).T * sd)

    def hinted(self, changes: Sequence[Deviation]) -> list[tuple[Deviation, float, Array]]:
        """Each change with its 2 ln B to first order, and the amplitudes (k,) that it promises."""
        out = []
        for c in changes:
            gram = self._gram(c.rows, c.sd)
            step, fall = gram.attained(c.low / c.sd, c.high / c.sd)
            out.append((c, fall - occam(step, gram.S), step * c.sd))
        return out

    def _columns(self, c: Deviation, a: Array) -> tuple[Array, Array]:
        """The derivatives (k, s, p, 3) mm by a change's amplitudes at them, and whitened (n, k)."""
        rows = np.tensordot(c.directions, c.model.jacobian(c.at(a)), 1)
        return rows, self.whitener.whiten(rows).T

    def refitted(self, c: Deviation, begin: Array) -> Difference | None:
        """The change fitted by Gauss-Newton steps from amplitudes (k,); None where it cannot be solved."""
        a, objective, z = np.zeros(len(c.sd)), float(self.z @ self.z), self.z
        step: Array = begin
        for _ in range(TURNS):
            tries = (self._tried(c, np.clip(a + part * step, c.low, c.high)) for part in PARTS)
            found = next((end for end in tries if end is not None and end[1] < objective), None)
            if found is None:
                break
            a, objective, z = found
            columns = self._columns(c, a)[1]
            information = columns.T @ columns + np.diag(1 / c.sd**2)
            step = np.asarray(np.linalg.solve(information, columns.T @ z - a / c.sd**2), float)
            if (np.abs(step) * np.sqrt(np.diag(information)) < SETTLED).all():
                break
        if not a.any():
            return None
        rows, columns = self._columns(c, a)
        values, fall = c.model.named(c.at(a)), float(self.z @ self.z - z @ z)
        scaled = columns * c.sd
        return Difference(
            name=c.name, words=c.told(values), values=values, fall=fall,
            evidence=fall - occam(a / c.sd, scaled.T @ scaled),
            comparison=compare(self.targets, c.model.predict(c.at(a)), self.whitener, jacobian=rows),
        )  # fmt: skip

    def _tried(self, c: Deviation, a: Array) -> tuple[Array, float, Array] | None:
        """Amplitudes, objective and whitened residual; None where there is no equilibrium."""
        try:
            z = self.whitener.whiten(self.targets.value - c.model.predict(c.at(a)))
        except Unsolvable:
            return None
        return a, float(z @ z + ((a / c.sd) ** 2).sum()), z
