"""The newest fit of a project -> a sample of its posterior, on the response, which whole solves check.

The prior is flat within the bounds of the parameters, times the priors of twin.toml. Measured values are
normal about what the model shows, with the errors of gauge, mesh and laws that the model has itself at those
parameters, as in a profile. One of the mesh's errors is taken whole and not to first order: its stiffness, of
relative sd s, which the moduli take up. It is a number of its own, eta, normal with sd 1: with constants C
the mesh is to be solved with C exp(s eta). Those, theta, the film holds within little, so that few solves
serve for the response. The prior is flat in C, not in theta. What the other errors change of the density is
known at whole solves, and interpolated between them.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy

from calibrate.parameters import Array, bounds
from calibrate.posteriors import Chain, sampled, spread
from calibrate.priors import Prior
from twin.calibrated.profiles import Profiler
from twin.judging.fitting import ModelErrors
from twin.judging.likelihood import priors_of
from twin.judging.materialcurves import curve_jacobian, curve_residual
from twin.judging.whitening import Whitener
from twin.model.keptmodel import KeptModel
from twin.model.prediction import Model, Solved, Unsolvable
from twin.model.rangedresponse import begun
from twin.model.rangedresponse import spread as even
from twin.model.response import Surrogate
from twin.targets import Targets

WIDER = 1.5  # than what the derivatives at the fit expect: the spread of the first solves
LEAST = 5.0  # typical steps: sd of a parameter that the derivatives at the fit do not know
CHECKS = 8  # whole solves by which a chain is checked
ROUNDS = 5  # chains at most, each on the response with the checks of those before
OFF = 0.1  # chi2, by which the response may be off a whole solve
OFF_ERRORS = 1.0  # of -2 ln density, by which what the errors change of it may be off there
WALKERS, EACH = 32, 6  # at least, and for each parameter
TRIED = 64  # starts, for each that is taken
OUTWARD, CUT = 1.3, 0.01  # times as far from the fit; share of the sample that may have no answer there
THINNED = 2000  # positions of a chain that are kept as its sample


@dataclass(frozen=True, eq=False)
class WholeSolve:
    """A whole solve at theta (d,): displacements u (s, p, 3) mm and derivatives (d, s, p, 3), NaN where there
    is no equilibrium; moved: what the errors that the model has there, instead of those at the fit, add to
    -2 ln of the density."""

    theta: Array
    u: Array
    jacobian: Array
    moved: float

    @property
    def solved(self) -> bool:
        """True where there is an equilibrium."""
        return bool(np.all(np.isfinite(self.u)))


@dataclass(frozen=True, eq=False)
class Density:
    """The log density of positions (m, d) or (m, d + 1): theta, and eta where the mesh's stiffness is not
    known.

    chi2 of theta is |small (r + 1, r + 1) (1, -c)|^2, c (r,) what is in it of each of the response's fields;
    moved: what errors add to it, at theta (m, d) in units of scale (d, d); guard: whether each theta is asked
    for stable rubber; priors: those of twin.toml. beside: chi2 (m,) of tests of the silicone itself at
    parameters (m, d).
    """

    response: Surrogate
    small: Array
    moved: Callable[[Array], Array]
    scale: Array
    stiffness: float
    guard: bool
    priors: tuple[Prior, ...] = ()
    beside: Callable[[Array], Array] | None = None

    @staticmethod
    def of(
        response: Surrogate, solves: Sequence[WholeSolve], targets: Targets, w: Whitener, *, scale: Array,
        stiffness: float, guard: bool, beside: Callable[[Array], Array] | None = None,
    ) -> "Density":  # fmt: skip
        """The density of a response and whole solves.

        w: a whitener without the mesh's stiffness where that is a number of its own. scale (d, d): a root of
        the covariance of theta.
        """
        rows = np.column_stack([w.whiten(targets.value), w.whiten(response.fields).T])
        thetas = [solve.theta for solve in solves if solve.solved]
        positions, rows_of = np.unique(thetas, axis=0, return_index=True)
        moved = np.array([solve.moved for solve in solves if solve.solved])[rows_of]
        if np.linalg.matrix_rank(positions - positions[0]) < positions.shape[1]:
            raise ValueError(
                f"no posterior: of {len(solves)} places around the fit the model has a stable equilibrium at "
                f"{len(positions)}, which do not say how it changes with every parameter; run twin profile, "
                "which tells how far each may go"
            )
        scaled = np.asarray(np.linalg.solve(scale, positions.T).T, float)
        between = scipy.interpolate.RBFInterpolator(scaled, moved, kernel="thin_plate_spline", degree=1)
        small, priors = np.asarray(np.linalg.qr(rows).R), priors_of(response.parameters, targets)
        return Density(response, small, between, scale, stiffness, guard, priors, beside)

    def __call__(self, x: Array) -> Array:
        """The log densities (m,), -inf where there is none."""
        theta, true = self.theta(x), self.true(x)
        low, high = bounds(self.response.parameters)
        out = np.full(len(x), -np.inf)
        inside = np.flatnonzero(np.all((true >= low) & (true <= high), axis=1))
        if self.guard:
            inside = inside[[self.response.allowed(self.response.named(t)) for t in theta[inside]]]
        if not len(inside):
            return out
        chi2 = self.chi2(theta[inside]) + self.added(theta[inside])
        if self.beside is not None:
            chi2 = chi2 + self.beside(true[inside])
        finite = np.isfinite(chi2)
        rows = inside[finite]
        out[rows] = -chi2[finite] / 2
        for prior in self.priors:
            out[rows] -= [prior.value(parameters) ** 2 / 2 for parameters in true[rows]]
        if self.stiffness:  # the prior of eta, and the prior of the constants, which is flat in `true`
            eta = x[:, -1]
            out -= eta**2 / 2 + len(self.moduli) * self.stiffness * eta
        return out

    @property
    def moduli(self) -> tuple[str, ...]:
        """The constants that take up the mesh's stiffness."""
        return self.response.law.moduli if self.response.law else ()

    def theta(self, x: Array) -> Array:
        """The parameters (m, d) that show what the positions stand for on this mesh."""
        return x[:, :-1] if self.stiffness else x

    def true(self, x: Array) -> Array:
        """The parameters (m, d) of the positions."""
        out = self.theta(x).copy()
        if self.stiffness:
            scaled = [p.name in self.moduli for p in self.response.parameters]
            out[:, scaled] *= np.exp(-self.stiffness * x[:, -1:])
        return out

    def chi2(self, theta: Array) -> Array:
        """chi2 (m,) of the response at theta (m, d); NaN where it has no answer."""
        c = self.response.coefficients(theta)
        rows = np.column_stack([np.ones(len(c)), -c])
        return np.sum((rows @ self.small.T) ** 2, axis=1)

    def added(self, theta: Array) -> Array:
        """Change (m,) of -2 ln density by the errors at theta (m, d), in place of the errors at the fit."""
        return self.moved(np.asarray(np.linalg.solve(self.scale, theta.T).T, float))


class Keeping(Protocol):
    """The store of a sampler, so that a killed run goes on: whole solves in their order, the newest chain
    with its number, and the check points of each chain."""

    def solve(self, theta: Array) -> WholeSolve | None: ...
    def add_solve(self, solve: WholeSolve) -> None: ...
    def chain(self, number: int) -> Chain | None: ...
    def set_chain(self, number: int, chain: Chain, most: int) -> None: ...
    def points(self, number: int) -> Array | None: ...
    def set_points(self, number: int, points: Array) -> None: ...
    def note(self, text: str) -> None: ...


@dataclass(frozen=True, eq=False)
class Sample:
    """A sample of the posterior: its chain on a density; solves: whole ones, checks among them; off: the
    largest errors at the checks, of chi2 by the response and of -2 ln density by errors in between; doubt:
    why it may not be trusted, "" where it may."""

    chain: Chain
    density: Density
    solves: int
    off: tuple[float, float]
    doubt: str

    @cached_property
    def positions(self) -> Array:
        """THINNED positions (k, d), evenly from the chain."""
        every = self.chain.samples
        return every[np.linspace(0, len(every) - 1, min(THINNED, len(every))).astype(int)]

    @cached_property
    def values(self) -> Array:
        """The parameters (k, d) of `positions`."""
        return self.density.true(self.positions)

    def shown(self) -> Array:
        """Displacements (k, s, p, 3) mm of `positions`."""
        c = self.density.response.coefficients(self.density.theta(self.positions))
        return np.tensordot(c, self.density.response.fields, 1)


@dataclass(frozen=True, eq=False)
class Sampler:
    """A fit whose posterior is asked for: model, targets, errors as at the fit, and the best theta (d,)."""

    model: KeptModel
    targets: Targets
    errors: ModelErrors
    theta: Array
    keeping: Keeping

    @staticmethod
    def of(profiler: Profiler, keeping: Keeping) -> "Sampler":
        """The sampler of the fit of a profiler."""
        assert isinstance(profiler.model, KeptModel)
        p = profiler
        return Sampler(p.model, p.targets, p.errors, p.theta, keeping)  # type: ignore[arg-type]

    @property
    def stiffness(self) -> float:
        """The sd of the mesh's stiffness, as a share, where it is a number of its own; else 0."""
        mesh, free = self.model.mesh, {p.name for p in self.model.parameters}
        moduli = self.model.law.moduli if self.model.law else ()
        separate = mesh is not None and len(self.errors.modes) > 0 and bool(moduli) and set(moduli) <= free
        return float(mesh.stiffness) if separate and mesh is not None else 0.0

    @cached_property
    def whitener(self) -> Whitener:
        """The whitener of all errors but a stiffness of its own."""
        return self._apart(self.errors).whitener(self.targets)

    def _apart(self, errors: ModelErrors) -> ModelErrors:
        return replace(errors, modes=errors.modes[1:], names=errors.names[1:]) if self.stiffness else errors

    def sample(self, *, seed: int, most: int) -> Sample:
        """The sample; most: steps of a walker at most."""
        best = self.solve(self.theta)
        scale = self._scale(best)
        solves = [best, *(self.solve(theta) for theta in self._design(scale))]
        response = _joined(begun(self.model, self.theta), solves)
        guard = False
        for number in range(ROUNDS):
            density = Density.of(
                response, solves, self.targets, self.whitener, scale=scale, stiffness=self.stiffness,
                guard=guard, beside=self._beside,
            )  # fmt: skip
            points, chain = self.keeping.points(number), self.keeping.chain(number)
            if points is None:
                chain = sampled(
                    density, self._start(density, seed), seed=seed + number, chain=chain, most=most,
                    step=lambda made, n=number: self.keeping.set_chain(n, made, most),  # type: ignore[misc]
                )  # fmt: skip
                if chain.doubt:
                    return Sample(chain, density, len(solves), (np.nan, np.nan), chain.doubt)
                points = self._checks(chain, density)
                self.keeping.set_points(number, points)
            if not len(points):
                guard = True
                continue
            checks = [self.solve(theta) for theta in points]
            solves += checks
            off = self._off(density, checks)
            self.keeping.note(
                f"Chain {number + 1}: at {len(checks)} whole solves the response is off by {off[0]:.2g} of "
                f"chi2, errors in between by {off[1]:.2g} of -2 ln density."
            )
            if (off[0] <= OFF and off[1] <= OFF_ERRORS) or number == ROUNDS - 1:
                assert chain is not None
                return Sample(chain, density, len(solves), off, _doubt(off) or self._cut(chain, density))
            response = _joined(response, checks)
        raise AssertionError("the last round returns")

    def solve(self, theta: Array) -> WholeSolve:
        """The whole solve at theta (d,), made or kept: alone, so that it does not depend on those before."""
        if (stored := self.keeping.solve(theta)) is not None:
            return stored
        model = replace(self.model, parent=None)
        try:
            solved = model.solved(theta, derivatives=True)
            assert solved.jacobian is not None
            solve = WholeSolve(theta, solved.u, solved.jacobian, self._moved(model, solved))
        except Unsolvable:
            shape = self.targets.value.shape
            solve = WholeSolve(theta, np.full(shape, np.nan), np.full((len(theta), *shape), np.nan), np.nan)
        self.keeping.add_solve(solve)
        return solve

    def _moved(self, model: Model, solved: Solved) -> float:
        """Change of -2 ln density by a model's errors at a solve, in place of the errors at the fit."""
        there = ModelErrors.of(model, solved.theta, self.targets, law=self.errors.law)
        w, z = self._apart(there).whitener(self.targets), self.targets.value - solved.u
        at_fit = self.whitener
        a, b = w.whiten(z), at_fit.whiten(z)
        return float(a @ a - b @ b) + w.log_det - at_fit.log_det

    @property
    def _beside(self) -> Callable[[Array], Array] | None:
        """chi2 of the silicone's tests; None without them."""
        return self._curves if self.targets.curves else None

    def _curves(self, true: Array) -> Array:
        """chi2 (m,) of the silicone's tests at parameters (m, d), NaN where the law has no stress."""
        out = np.full(len(true), np.nan)
        for k, theta in enumerate(true):
            with suppress(Unsolvable):
                z = curve_residual(self.model, self.targets, theta)
                out[k] = z @ z
        return out

    def _scale(self, best: WholeSolve) -> Array:
        """The root (d, d) of the covariance that the derivatives at the fit expect of theta."""
        rows = self.whitener.whiten(best.jacobian)
        if self.targets.curves:
            slopes = curve_jacobian(self.model, self.targets, self.theta)
            rows = np.concatenate([rows, -slopes.T], axis=1)
        least = [1 / (LEAST * p.step) ** 2 for p in self.model.parameters]
        return np.asarray(np.linalg.cholesky(np.linalg.inv(rows @ rows.T + np.diag(least))))

    def _design(self, scale: Array) -> Array:
        """Parameters (2 d, d) of the response's whole solves around the fit."""
        size = len(self.theta)
        unit = even(np.zeros(size), np.ones(size), 2 * size)
        theta = self.theta + WIDER * scipy.special.ndtri(unit) @ scale.T
        return np.clip(theta, *bounds(self.model.parameters))

    def _start(self, density: Density, seed: int) -> Array:
        """Start positions of the walkers, normal with the covariance at the fit, nearer where it is 0.
        ValueError where it is 0 all around the fit."""
        extra = int(bool(self.stiffness))
        size = len(self.theta) + extra
        count = max(WALKERS, EACH * size)
        rng = np.random.default_rng(seed)
        for narrower in 0.5 ** np.arange(8):
            z = rng.normal(size=(TRIED * count, size))
            x = self.theta + narrower * z[:, : len(self.theta)] @ density.scale.T
            x = np.column_stack([x, z[:, -1]]) if extra else x
            starts = x[np.isfinite(density(x))]
            if len(starts) >= count:
                return starts[:count]
        raise ValueError("no posterior: around the fit its density is 0; run twin calibrate")

    def _checks(self, chain: Chain, density: Density) -> Array:
        """Check points (CHECKS, d) of a chain; none where it reaches unstable rubber."""
        samples = chain.samples[:: max(len(chain.samples) // 500, 1)]
        model = self.model
        if not density.guard and not all(model.allowed(model.named(t)) for t in density.theta(samples)):
            return np.zeros((0, len(self.theta)))
        return density.theta(spread(chain, CHECKS))

    def _cut(self, chain: Chain, density: Density) -> str:
        """The reason why the response may have cut off a chain; "" where it reaches OUTWARD times as far from
        the fit as the chain."""
        low, high = bounds(self.model.parameters)
        samples = density.theta(chain.samples[:: max(len(chain.samples) // THINNED, 1)])
        beyond = np.clip(self.theta + OUTWARD * (samples - self.theta), low, high)
        if np.isnan(density.chi2(beyond)).mean() <= CUT:
            return ""
        return "it goes as far as the response reaches, so that the data hardly hold some parameter"

    def _off(self, density: Density, checks: Sequence[WholeSolve]) -> tuple[float, float]:
        """The largest errors of a density at whole solves, of chi2 and of what errors add; inf where one has
        no equilibrium."""
        if not all(solve.solved for solve in checks):
            return np.inf, np.inf
        theta = np.array([solve.theta for solve in checks])
        z = self.whitener.whiten(self.targets.value - np.array([solve.u for solve in checks]))
        added = density.added(theta) - [solve.moved for solve in checks]
        return float(np.abs(density.chi2(theta) - (z**2).sum(axis=1)).max()), float(np.abs(added).max())


def _doubt(off: tuple[float, float]) -> str:
    """The reason to distrust a sample with these errors (`Sample.off`); "" where there is none."""
    if not np.isfinite(off[0]):
        return "it goes where the model has no stable equilibrium"
    if off[0] > OFF:
        return f"the response is off whole solves by {off[0]:.2g} of chi2, wanted {OFF}"
    if off[1] > OFF_ERRORS:
        return (
            f"the errors of gauge, mesh and laws change by more than is known between whole solves: by "
            f"{off[1]:.2g} of -2 ln density, wanted {OFF_ERRORS}"
        )
    return ""


def _joined(response: Surrogate, solves: Sequence[WholeSolve]) -> Surrogate:
    """The response with whole solves more, those with an equilibrium."""
    for solve in solves:
        if solve.solved:
            response = response.joined(Solved(solve.theta, solve.u, solve.jacobian, None))  # type: ignore[arg-type]
    return response
