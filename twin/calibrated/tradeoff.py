"""Parts of the targets -> fits of each alone, what all of them cost each other, and whether they contradict.

The misfit of a part is the root mean square of its residual, whitened by all errors that are known of it:
1 where the model is right. The errors are those at the fit of the project, and each part takes up errors that
many values share on its own.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import count as counting
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from calibrate import Fit, Parameter, least_squares
from calibrate.genetic import GENERATIONS, Front, pareto_front
from twin.calibrated.problem import CalibrationProblem
from twin.calibrated.profiles import with_own_errors
from twin.effects.protocol import Unsolvable
from twin.judging.fitting import ModelErrors, whitened
from twin.judging.whitening import Whitener
from twin.messages import Say
from twin.model.keptmodel import KeptModel
from twin.model.rangedresponse import RangedResponse
from twin.targets import Array, Targets

COMPONENTS = ("U1", "U2", "U3")
MOST = 4  # objectives
FEWEST = 5  # values of one
KEPT = 8  # points of the front that are solved
SOLVES = 8  # of the response, beside those at the fits
TOLERANCE, STEPS = 0.1, 20  # sd, and solves, of the fit of one part alone

LEVEL = 0.05  # chance to say of a right model that it contradicts the data
LACKING = 1e-3  # probability of a chi2 as high, below which a part is not fitted
Made = dict[str, Any]
Keep = Callable[[str, Callable[[], Made]], Made]  # what was made under a name before, else what is made now


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the targets that is fitted: its name, the targets with these values alone, without tests of
    the silicone, and its whitener."""

    name: str
    targets: Targets
    whitener: Whitener

    @staticmethod
    def of(name: str, mask: NDArray[np.bool_], targets: Targets, errors: ModelErrors) -> "Part":
        """The part of a mask (s, p, 3). ValueError where it has too few values to be fitted."""
        targets_of = replace(targets, valid=targets.valid & mask, curves=())
        if (count := int(targets_of.used.sum())) < FEWEST:
            raise ValueError(f"--objectives {name}: {count} values of it are fitted; wanted {FEWEST} or more")
        return Part(name, targets_of, errors.whitener(targets_of))

    def chi2(self, u: Array) -> float:
        """The squared misfit of displacements u (s, p, 3) mm: as many as values where the model is right."""
        z = self.whitener.whiten(self.targets.value - u)
        return float(z @ z)

    def misfit(self, chi2: float) -> float:
        """Root mean square of the whitened residual of a chi2."""
        return float(np.sqrt(chi2 / self.whitener.count))

    def rms_mm(self, u: Array) -> float:
        """Root mean square of the residual, mm."""
        return self.whitener.error(self.targets.value - u)


def masks_of(text: str, targets: Targets, films: Mapping[int, str]) -> dict[str, NDArray[np.bool_]]:
    """The masks (s, p, 3) of the parts that a text names, between commas: points, components and films, or
    several of them joined by a dot, tip.U3. ValueError for a name that there is not, and for one part alone.
    """
    names = [name.strip() for name in text.split(",")]
    by_name = _known(targets, films)
    if not 2 <= len(set(names)) == len(names) <= MOST:
        raise ValueError(f"--objectives {text!r}: wanted 2 to {MOST} different ones between commas, such as "
                         "tip,middle or U1,U3")  # fmt: skip
    out = {}
    for name in names:
        words = [name] if name in by_name else name.split(".")
        unknown = [word for word in words if word not in by_name]
        if unknown:
            raise ValueError(f"--objectives {name}: nothing in the targets is called {unknown[0]!r}; wanted "
                             f"some of {', '.join(by_name)}, or two joined, such as tip.U3")  # fmt: skip
        out[name] = np.logical_and.reduce([by_name[word] for word in words])
    return out


def _known(targets: Targets, films: Mapping[int, str]) -> dict[str, NDArray[np.bool_]]:
    """The mask of everything that has a name."""
    shape = targets.valid.shape
    out: dict[str, NDArray[np.bool_]] = {}
    blocks = range(int(targets.block[-1]) + 1)
    for b in blocks if len(blocks) > 1 else ():
        out[films.get(b, f"film{b + 1}")] = np.broadcast_to((targets.block == b)[:, None, None], shape)
    for k, name in enumerate(COMPONENTS):
        out[name] = np.broadcast_to(np.arange(3) == k, shape)
    for p, name in enumerate(targets.names):
        if not targets.fixed[p]:
            out[name] = np.broadcast_to((np.arange(shape[1]) == p)[None, :, None], shape)
    return out


@dataclass(frozen=True, eq=False)
class SolvedFit:
    """A point that was solved whole: theta (d,), the chi2 (m,) of each part, their rms (m,) in mm, and how
    far the response was off the misfits."""

    theta: Array
    chi2: Array
    rms_mm: Array
    off: float = 0.0

    @staticmethod
    def of(
        theta: Array, solved: Mapping[str, Any], parts: Sequence[Part], foretold: Array | None = None
    ) -> "SolvedFit":
        """The point of a solve; foretold: misfits (m,) by the response."""
        chi2 = np.array(solved["chi2"])
        off = 0.0 if foretold is None else float(np.abs(misfits(parts, chi2[None])[0] - foretold).max())
        return SolvedFit(theta, chi2, np.array(solved["rms_mm"]), off)


@dataclass(frozen=True, eq=False)
class TradeOff:
    """Parts of the targets against each other: the front by the response, its points that were solved whole,
    the knee among them, the one fit of all; unsettled: parts whose own fit has not converged."""

    parts: tuple[Part, ...]
    front: Front
    solved: tuple[SolvedFit, ...]
    knee: int
    fit: SolvedFit
    unsettled: tuple[str, ...] = ()

    @property
    def values(self) -> Array:
        """The misfits (n, m) of the points that were solved."""
        return misfits(self.parts, np.array([solve.chi2 for solve in self.solved]))

    @cached_property
    def least(self) -> Array:
        """The lowest chi2 (m,) of each part that was solved."""
        return np.array([solve.chi2 for solve in (*self.solved, self.fit)]).min(axis=0)

    @property
    def excess(self) -> Array:
        """Excess (m,) of each part's chi2 at the joint fit over its own fit."""
        return np.asarray(self.fit.chi2 - self.least)

    @property
    def threshold(self) -> float:
        """The excess that noise alone goes beyond in LEVEL of all tests of a model that is right: of chi2
        with as many degrees of freedom as parameters, for all parts together (Bonferroni)."""
        level = LEVEL / len(self.parts)
        return float(scipy.special.chdtri(len(self.fit.theta), level))

    @property
    def lacking(self) -> tuple[str, ...]:
        """Names of the parts that a fit of each alone does not fit."""
        free = len(self.fit.theta)
        return tuple(
            p.name
            for p, x in zip(self.parts, self.least, strict=True)
            if scipy.special.chdtrc(max(p.whitener.count - free, 1), x) < LACKING
        )

    @property
    def conflicting(self) -> tuple[str, ...]:
        """Names of the parts that the one fit misses by more than noise."""
        return tuple(p.name for p, x in zip(self.parts, self.excess, strict=True) if x > self.threshold)


def misfits(parts: Sequence[Part], chi2: Array) -> Array:
    """Misfits (n, m) of chi2 (n, m)."""
    return np.asarray(np.sqrt(chi2 / [p.whitener.count for p in parts]))


def anew(name: str, make: Callable[[], Made]) -> Made:
    """The result of `make`, without a store."""
    del name
    return make()


def trade_off(
    problem: CalibrationProblem, fit: Fit, masks: Mapping[str, NDArray[np.bool_]], *, seed: int, say: Say,
    keep: Keep = anew, errors: ModelErrors | None = None,
) -> TradeOff:  # fmt: skip
    """The trade-off between parts of the targets in a model, around a fit.

    keep: store of the solves of a killed run. errors: of the model at the fit, where they are known.
    """
    model, errors = with_own_errors(problem, fit, say, errors=errors)
    assert isinstance(model, KeptModel)
    parts = tuple(Part.of(name, mask, problem.targets.alone, errors) for name, mask in masks.items())
    done, total = counting(1), len(parts) + GENERATIONS + KEPT

    def step() -> None:
        say.progress("pareto", min(next(done), total), total)

    say.progress("pareto", 0, total)
    return front_of(model, parts, fit.theta, seed=seed, step=step, keep=keep)


def front_of(
    model: KeptModel, parts: Sequence[Part], theta: Array, *, seed: int,
    step: Callable[[], None] = lambda: None, keep: Keep = anew,
) -> TradeOff:  # fmt: skip
    """The trade-off between parts in a model, around its joint fit theta (d,). ValueError where it cannot be
    solved there."""
    alone = []
    for part in parts:
        alone.append(keep(f"alone: {part.name}", partial(_alone, model, part, theta)))
        step()
    ends = [np.array(fit["theta"]) for fit in alone]
    unsettled = tuple(part.name for part, fit in zip(parts, alone, strict=True) if not fit["converged"])
    response = _response(model, np.array([theta, *ends]))
    allowed = model.allowed

    def objectives(theta: Array) -> Array | None:
        if not allowed(model.named(theta)):
            return None
        u = response.answer(theta).u
        return np.array([part.misfit(part.chi2(u)) for part in parts])

    starts = np.array([np.clip(theta, response.low, response.high), *ends])
    front = pareto_front(
        objectives, _within(response), starts=starts, seed=seed, generations=GENERATIONS, step=step
    )
    solved = []
    for k in front.spread(KEPT):
        solve = keep(f"point {k}", partial(_solved, model, parts, front.theta[k]))
        solved += [SolvedFit.of(front.theta[k], solve, parts, front.values[k])] if solve else []
        step()
    solve = keep("the one fit", partial(_solved, model, parts, theta))
    if not solve or not solved:
        raise ValueError("pareto: the model cannot be solved at its fit; run `twin calibrate`")
    of_all = SolvedFit.of(theta, solve, parts)
    values = misfits(parts, np.array([point.chi2 for point in solved]))
    knee = Front(np.array([point.theta for point in solved]), values).knee
    return TradeOff(tuple(parts), front, tuple(solved), knee, of_all, unsettled)


def _alone(model: KeptModel, part: Part, start: Array) -> Made:
    """The fit of one part, by whole solves: theta, and whether it has converged."""
    fit = least_squares(
        *whitened(model, part.targets, part.whitener)[:2], model.parameters, start=start,
        max_evaluations=STEPS, tolerance=TOLERANCE,
    )  # fmt: skip
    return {"theta": fit.theta.tolist(), "converged": fit.converged}


def _response(model: KeptModel, ends: Array) -> RangedResponse:
    """A response that holds fits (k, d), solved at each."""
    usual = RangedResponse.reach(model, ends[0])
    ranges = {}
    for k, p in enumerate(model.parameters):
        low, high = (float(f(np.append(ends[:, k], usual[k]))) for f in (np.min, np.max))
        ranges[p.name] = (low, high)
    response = RangedResponse.of(model, ends[0], within=ranges, solves=SOLVES)
    for end in ends:
        response = response.certified(end)
    return response


def _within(response: RangedResponse) -> tuple[Parameter, ...]:
    """The parameters, between the ends of a response."""
    ends = zip(response.surrogate.parameters, response.low, response.high, strict=True)
    return tuple(Parameter(p.name, float(low), float(high), p.unit, typical=p.step) for p, low, high in ends)


def _solved(model: KeptModel, parts: Sequence[Part], theta: Array) -> Made:
    """A whole solve at theta (d,): chi2 and rms in mm of each part; nothing where there is no equilibrium."""
    try:
        u = model.predict(theta)
    except Unsolvable:
        return {}
    return {"chi2": [part.chi2(u) for part in parts], "rms_mm": [part.rms_mm(u) for part in parts]}
