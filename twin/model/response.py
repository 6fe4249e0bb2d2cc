"""A model's whole solves and tangents -> its answer anywhere near them, in milliseconds, with a stated error.

What is solved are displacements at a few parameters, some with derivatives, and tangents of absent effects at
null. Between and beyond them a Gaussian process with derivatives answers (kriging with gradients: Rasmussen &
Williams 2006, section 9.4), which at the solves is exact. Its kernel over the parameters c of the base model,
the amplitudes a of what is added and their other parameters s (a time, a place),

    k = exp(c c') (1 + (exp(a a') - 1) exp(-|s - s'|^2 / 2)),

is that of a Taylor series: to first order what was solved says, the orders beyond are unknown by as much as
the scales below say, and where an amplitude is null nothing depends on its time or place.
docs/finite-elements.md has its error in units of what it states.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calibrate import Parameter
from fe import Solution
from twin.effects.protocol import Effect, Unsolvable
from twin.model.discretisation import Discretisation
from twin.model.keptmodel import KeptModel
from twin.model.prediction import Model, Solved
from twin.model.prediction import Tangents as SolvedTangents
from twin.targets import Array

Tangents = Mapping[str, Sequence[Array]]  # by an effect's label, (k, s, p, 3) mm for each of its tries

BENT = 5.0  # typical steps of a parameter at which the second order may be as large as the first
APART = 1.5  # spacings of an effect's tries over which its time or place may change what it does
SURE, ROUGH = 3e-5, 1e-2  # relative sd of a solve, and of a tangent, which is a secant over a typical step
STRETCHES = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # of the scales of what is added, as the solves bear out
WORSE = 8.0  # the squared error over what the likeliest kernel says (docs/finite-elements.md)
FAR = 2.5  # coordinates beyond every solve: no answer there


@dataclass(frozen=True)
class Axis:
    """The map of a parameter to a coordinate x: (value - middle) / scale, of its logarithm where it runs over
    decades. free: whether it has no null, as a time or a place of something added."""

    middle: float
    scale: float
    log: bool = False
    free: bool = False
    of_base: bool = False

    @staticmethod
    def of(
        p: Parameter, value: float, tried: Sequence[float], *, of_base: bool, scale: float = 0.0
    ) -> "Axis":
        """The axis of a parameter about a value, where an effect is tried at some; of_base: it is the base
        model's; scale: at least so large."""
        if of_base or p.null is not None:
            middle = value if of_base or p.null is None else p.null
            likely = [abs(end - middle) for end in p.plausible or ()]
            return Axis(middle, max([BENT * p.step, scale, *likely]), of_base=of_base)
        log = p.low > 0 and p.high > 5 * p.low
        ends = np.array(sorted({*tried})) if len({*tried}) > 1 else np.array([p.low, p.high])
        x = np.log(ends) if log else ends
        spacing = float(np.diff(x).mean()) if len({*tried}) > 1 else float(np.ptp(x)) / 4
        return Axis(float(np.log(value) if log else value), APART * spacing, log=log, free=True)

    def x(self, value: float) -> float:
        """The coordinate of a value."""
        return ((float(np.log(value)) if self.log else value) - self.middle) / self.scale

    def slope(self, value: float) -> float:
        """dx / dvalue."""
        return 1 / (self.scale * (value if self.log else 1.0))


@dataclass(frozen=True)
class Row:
    """One thing that is known: at coordinates x (d,) the displacements (n,) mm (along < 0), or their
    derivative along a coordinate; sd: how well, as a share."""

    x: Array
    along: int
    value: Array
    sd: float = SURE


@dataclass(frozen=True)
class Surrogate(Model):
    """A model that answers from what was solved. whole: what it stands for; axes: its coordinates; rows: what
    is known; solves: whole solves among it, of `whole`; before: a solve of `source`, which it came from.

    Its own errors come from the nearest whole solve. Raises Unsolvable FAR beyond every solve.
    """

    whole: KeptModel = field(default=None, compare=False, repr=False)  # type: ignore[assignment]
    axes: tuple[Axis, ...] = field(default=(), compare=False, repr=False)
    rows: tuple[Row, ...] = field(default=(), compare=False, repr=False)
    solves: tuple[Solved, ...] = field(default=(), compare=False, repr=False)
    source: KeptModel = field(default=None, compare=False, repr=False)  # type: ignore[assignment]
    before: Solved | None = field(default=None, compare=False, repr=False)
    misses: tuple[float, ...] = field(default=(), compare=False, repr=False)

    # -- what it knows --------------------------------------------------------------------------------------

    @staticmethod
    def of(full: KeptModel, base: KeptModel, theta: Array, tangents: Tangents) -> "Surrogate":
        """The response of a base model with effects more, of all that both have solved. theta (d,): where the
        tangents are; tangents: of its effects, as `Model.tangents` gives them; some may be absent."""
        last = base.solved(theta, derivatives=True)
        earlier = [s for s in base.kept if s is not last]
        base_solves = [] if full is base else [*earlier, last]  # its own solves are joined below
        base_names = {p.name for p in base.parameters}
        tries = {p.name: [e[p.name] for e in f.tries(base.test) if p.name in e]
                 for f in full.effects for p in f.parameters}  # fmt: skip
        start = base.named(last.theta)
        for f in full.effects:
            entry = f.tries(base.test)[0]
            start |= {p.name: p.null if p.null is not None else entry.get(p.name, (p.low + p.high) / 2)
                      for p in f.parameters if p.name not in base_names}  # fmt: skip
        stiff = full.law.at_rest if full.law else ()
        moduli = sum(x for n, x in start.items() if n in stiff)
        axes = tuple(
            Axis.of(
                p, start[p.name], tries[p.name], of_base=p.name in base_names,
                scale=moduli * (p.name in stiff),
            )
            for p in full.parameters
        )
        empty = Surrogate(
            test=full.test, effects=full.effects, reference=full.reference, mesh=full.mesh,
            parent=full.parent, rests=full.rests, whole=full, axes=axes, source=base, before=last,
        )  # fmt: skip
        rows = []
        for solve in base_solves:
            rows += empty._told(solve, {**start, **base.named(solve.theta)}, base)
        for f in full.effects:
            for entry, fields in zip(f.tries(base.test), tangents.get(f.label, ()), strict=False):
                names = [p.name for p in f.amplitudes]
                rows += empty._along({**start, **entry}, dict(zip(names, fields, strict=True)), ROUGH)
        out = replace(empty, rows=tuple(rows))
        for solve in full.kept:
            out = out.joined(solve)
        return out

    def reaches(self, theta: Array) -> bool:
        """True if it can answer at theta (d,), and has derivatives along every parameter."""
        along, x = {r.along for r in self.rows}, self._x(self.named(theta))
        near = min((float(np.abs(r.x - x).max()) for r in self.rows), default=np.inf) <= FAR
        return near and all(axis.free or k in along for k, axis in enumerate(self.axes))

    def certified(self, theta: Array) -> "Surrogate":
        """The response with a whole solve at theta (d,) more, and its derivatives. Raises Unsolvable where
        there is no equilibrium."""
        return self.joined(self.whole.solved(theta, derivatives=True))

    def joined(self, solve: Solved) -> "Surrogate":
        """The response with one more solve of the whole model, with the derivatives that it has."""
        same = [s for s in self.solves if np.array_equal(s.theta, solve.theta)]
        told = self._told(solve, self.named(solve.theta), self.whole)
        if same and (same[0].jacobian is not None or solve.jacobian is None):
            return self
        if same:  # its derivatives are new
            solves = tuple(solve if s is same[0] else s for s in self.solves)
            return replace(self, rows=(*self.rows, *told[1:]), solves=solves)
        rows = (*self.rows, *told)
        misses = (*self.misses, *([self._missed(solve)] if self.reaches(solve.theta) else []))
        return replace(self, rows=rows, solves=(*self.solves, solve), misses=misses)

    def _told(self, solved: Solved, values: Mapping[str, float], model: Model) -> list[Row]:
        """The rows of a solve, of this model or its base: displacements and derivatives."""
        rows = [Row(self._x(values), -1, solved.u.ravel())]
        if solved.jacobian is None:
            return rows
        fields = dict(zip((p.name for p in model.parameters), solved.jacobian, strict=True))
        return [*rows, *self._along(values, fields, SURE)]

    def _along(self, values: Mapping[str, float], fields: Mapping[str, Array], sd: float) -> list[Row]:
        x, names = self._x(values), [p.name for p in self.parameters]
        return [
            Row(x, k, fields[n].ravel() / self.axes[k].slope(values[n]), sd)
            for k, n in enumerate(names)
            if n in fields
        ]

    def _missed(self, solve: Solved) -> float:
        """The mean square of what a new solve is off, over what the likeliest kernel says there."""
        u, sd = self.answer(solve.theta)
        return float(np.mean((solve.u - u) ** 2) / np.mean(sd**2)) * self._worse

    # -- its answer -----------------------------------------------------------------------------------------

    def answer(self, theta: Array) -> tuple[Array, Array]:
        """Displacements (s, p, 3) mm at theta (d,), and their sd, mm."""
        (k, itself), process = self._beside_rows(theta), self._fitted
        unexplained = itself - float(k[0] @ process.inverse @ k[0])
        unexplained = max(unexplained, SURE**2 * itself)  # what cancels is not seen
        sd = np.sqrt(unexplained * process.variance * self._worse)
        return (k[0] @ process.weights).reshape(self._shape), sd.reshape(self._shape)

    @property
    def fields(self) -> Array:
        """The displacements (r, s, p, 3) mm whose sums by `coefficients` are answers."""
        return self._fitted.weights.reshape(-1, *self._shape)

    def coefficients(self, thetas: Array) -> Array:
        """Coefficients (m, r) of `fields` in the answers at thetas (m, d); NaN FAR beyond every solve."""
        x, (points, along) = np.array([self._x(self.named(t)) for t in thetas]), self._points
        every = self._kernel(x, points, self._fitted.stretch)[:, :, 0]
        out = every[:, np.arange(len(points)), along]
        far = np.abs(points - x[:, None]).max(axis=2).min(axis=1) > FAR
        return np.asarray(np.where(far[:, None], np.nan, out))

    def solved(self, theta: Array, *, derivatives: bool = False) -> Solved:
        """As `Model.solved`, without a solve; at a whole solve what that gave, to the bit."""
        solved = next((s for s in self.solves if np.array_equal(s.theta, theta)), None)
        if solved is not None and not (derivatives and solved.jacobian is None):
            return solved
        k, _ = self._beside_rows(theta)
        u = (k[0] @ self._fitted.weights).reshape(self._shape)
        jacobian = None
        if derivatives:
            slopes = np.array([a.slope(v) for a, v in zip(self.axes, theta, strict=True)])
            jacobian = (slopes[:, None] * (k[1:] @ self._fitted.weights)).reshape(-1, *self._shape)
        if solved is not None:
            return replace(solved, jacobian=jacobian)
        return Solved(theta.copy(), u, jacobian, None)  # type: ignore[arg-type]

    def with_effect(self, effect: Effect) -> Model:
        """The whole model with one more effect, which this surrogate does not know."""
        return self.whole.with_effect(effect)

    def on_mesh(self, mesh: Discretisation | None) -> Self:
        """Refused: what was solved is corrected already. Make the response of `whole.on_mesh(mesh)`."""
        raise TypeError("a response is of one mesh: make one of whole.on_mesh(mesh)")

    def tangents(self, theta: Array, effects: Sequence[Effect]) -> SolvedTangents:
        """As `Model.tangents`, by whole solves."""
        return self.whole.tangents(theta, effects)

    def solution(self, theta: Array) -> Solution:
        """The solution of the nearest whole solve."""
        return self._nearest(theta)[1].solution

    def per_pressure(self, theta: Array) -> Array:
        """As `Model.per_pressure`, at the nearest whole solve."""
        model, near = self._nearest(theta)
        return model.per_pressure(near.theta)

    def modes(self, theta: Array) -> Array:
        """As `Model.modes`, from the nearest whole solve."""
        model, near = self._nearest(theta)
        return self._beside(theta, model.mesh_modes(near.theta).copy())

    def nearest(self, theta: Array) -> Solved:
        """The whole solve, of this model or of what it came from, that is nearest to theta (d,)."""
        return self._nearest(theta)[1]

    def _nearest(self, theta: Array) -> tuple[Model, Solved]:
        if not self.solves:
            assert self.before is not None
            return self.source, self.before
        x = self._x(self.named(theta))
        apart = [float(np.abs(self._x(self.named(s.theta)) - x).max()) for s in self.solves]
        return self.whole, self.solves[int(np.argmin(apart))]

    # -- its arithmetic -------------------------------------------------------------------------------------

    @property
    def _shape(self) -> tuple[int, ...]:
        return len(self.test.path.output), len(self.test.points), 3

    def _x(self, values: Mapping[str, float]) -> Array:
        return np.array([a.x(values[p.name]) for a, p in zip(self.axes, self.parameters, strict=True)])

    @cached_property
    def _points(self) -> tuple[Array, NDArray[np.int64]]:
        return np.array([r.x for r in self.rows]), np.array([r.along for r in self.rows]) + 1

    @cached_property
    def _fitted(self) -> "_Process":
        """The process at the stretch of the amplitudes' scales under which what is known is likeliest; where
        larger amplitudes were solved than these scales are for, of scales as large."""
        added = self._points[0][:, [not axis.of_base and not axis.free for axis in self.axes]]
        least = max(1.0, float(np.sqrt((added**2).sum(axis=1).max(initial=0.0))) / FAR)
        return max((self._at(least * stretch) for stretch in STRETCHES), key=lambda one: one.likelihood)

    def _at(self, stretch: float) -> "_Process":
        x, along = self._points
        every, n = self._kernel(x, x, stretch), np.arange(len(x))
        kernel = every[n[:, None], n[None, :], along[:, None], along[None, :]]
        sd, size = np.array([r.sd for r in self.rows]), np.sqrt(np.diag(kernel))
        size = np.where(size > 0, size, 1.0)  # of a derivative that this stretch takes for zero
        unit = kernel / np.outer(size, size) + np.diag(sd**2)
        inverse = np.linalg.inv(unit) / np.outer(size, size)
        values = np.array([r.value for r in self.rows])
        weights = inverse @ values
        each = np.mean(values * weights, axis=0).reshape(self._shape).mean(axis=0)
        moving = each > 1e-12 * each.max(initial=1e-300)
        log_det = np.linalg.slogdet(unit)[1] + 2 * np.log(size).sum()
        likelihood = -0.5 * (len(x) * np.log(each[moving]).mean() + log_det)
        variance = np.broadcast_to(np.maximum(each, 0.0), self._shape).ravel()
        return _Process(stretch, inverse, weights, variance, float(likelihood))

    @property
    def _worse(self) -> float:
        """Ratio of the squared error to the kernel's, as far as whole solves have shown."""
        return (WORSE + sum(self.misses)) / (1 + len(self.misses))

    def _beside_rows(self, theta: Array) -> tuple[Array, float]:
        """The kernel (1 + d, r) of the value and the derivatives at theta with all rows, and of the value
        with itself."""
        x = self._x(self.named(theta))[None]
        points, along = self._points
        if float(np.abs(points - x).max(axis=1).min()) > FAR:
            values = ", ".join(f"{n} = {v:.3g}" for n, v in self.named(theta).items())
            raise Unsolvable(
                f"{values}: too far from every solve to be answered; certify a whole solve there"
            )
        stretch = self._fitted.stretch
        every = self._kernel(x, points, stretch)[0]
        return every[np.arange(len(points)), :, along].T, float(self._kernel(x, x, stretch)[0, 0, 0, 0])

    def _kernel(self, a: Array, b: Array, stretch: float) -> Array:
        """The kernel (m, n, 1 + d, 1 + d) of values and derivatives at points (m, d) and (n, d)."""
        of_base = np.array([axis.of_base for axis in self.axes])
        free = np.array([axis.free for axis in self.axes])
        more = _taylor(a, b, np.where(~of_base & ~free, 1 / stretch, 0.0))
        more[:, :, 0, 0] -= 1.0
        here = _product(more, _near(a, b, free))
        here[:, :, 0, 0] += 1.0
        return _product(_taylor(a, b, of_base.astype(float)), here)


@dataclass(frozen=True)
class _Process:
    """The process at a stretch: inverse (r, r) of the rows' kernel, weights (r, n), variance (n,) mm^2 of the
    displacements, and the log likelihood of the rows, a displacement."""

    stretch: float
    inverse: Array
    weights: Array
    variance: Array
    likelihood: float


def _taylor(a: Array, b: Array, factor: Array) -> Array:
    """exp(a b') over coordinates scaled by factors (d,), 0 for none, with its derivatives by a and b."""
    square = factor**2
    out = _jets(b[None, :, :] * square + 0 * a[:, None, :], a[:, None, :] * square + 0 * b[None, :, :])
    out[:, :, 1:, 1:] += np.diag(square)
    return np.asarray(out * np.exp((a * square) @ b.T)[:, :, None, None])


def _near(a: Array, b: Array, which: NDArray[np.bool_]) -> Array:
    """exp(-|a - b|^2 / 2) over some coordinates, with its derivatives by a and b."""
    apart = (a[:, None, :] - b[None, :, :]) * which
    out = _jets(-apart, apart)
    out[:, :, 1:, 1:] += np.diag(which.astype(float))
    return np.asarray(out * np.exp(-0.5 * (apart**2).sum(axis=2))[:, :, None, None])


def _jets(by_a: Array, by_b: Array) -> Array:
    """The outer product (m, n, 1 + d, 1 + d) of 1 and logarithmic derivatives (m, n, d)."""
    ones = np.ones((*by_a.shape[:2], 1))
    rows, columns = np.concatenate([ones, by_a], axis=2), np.concatenate([ones, by_b], axis=2)
    return np.asarray(rows[:, :, :, None] * columns[:, :, None, :])


def _product(f: Array, g: Array) -> Array:
    """The product of two kernels with their derivatives."""
    out = f * g[:, :, :1, :1] + f[:, :, :1, :1] * g
    out[:, :, 0, 0] /= 2
    out[:, :, 1:, 1:] += f[:, :, 1:, :1] * g[:, :, :1, 1:] + f[:, :, :1, 1:] * g[:, :, 1:, :1]
    return np.asarray(out)
