"""The newest fit of a project -> likelihood profiles of its parameters, and of C10 + C01 and the share.

A value is tested under the errors of gauge, mesh and laws that the model has there. Every point of a profile
is a whole solve of the model; its derivatives say where the next should be.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from functools import partial

import numpy as np

from calibrate import Fit, least_squares, profile_likelihood
from calibrate.fit import Jacobian, Residual
from calibrate.profiles import LEVELS, Profile
from twin.calibrated.problem import CalibrationProblem
from twin.executors.local import current
from twin.judging.fitting import ModelErrors, whitened
from twin.judging.likelihood import SHARE, TOTAL, held
from twin.laws.mooneyrivlin import NAMES
from twin.messages import Say
from twin.model.prediction import Model, Unsolvable
from twin.targets import Array, Targets

TOLERANCE = 0.01  # sd, to which the best fit is found anew: deviances are relative to it


def profiled_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names of all quantities with a profile: the parameters, and C10+C01 and share where both are fitted.

    >>> profiled_names(["C10", "C01", "creep.g1"])
    ('C10', 'C01', 'creep.g1', 'C10+C01', 'share')
    """
    return (*names, TOTAL, SHARE) if set(NAMES) <= set(names) else tuple(names)


def sd_of(fit: Fit, name: str) -> float:
    """The sd by the covariance of the fit, to first order; NaN where it is not known."""
    slope = held(fit.parameters, name).slope(fit.theta)
    if not np.isfinite(fit.sd[slope != 0]).all():
        return float("nan")
    block = fit.covariance[np.ix_(slope != 0, slope != 0)]
    return float(np.sqrt(max(slope[slope != 0] @ block @ slope[slope != 0], 0.0)))


def with_own_errors(
    problem: CalibrationProblem, fit: Fit, say: Say, *, errors: ModelErrors | None = None
) -> tuple[Model, ModelErrors]:
    """The model of a fit on its mesh, and its errors there; errors: where they are known."""
    if errors is None:
        judged = problem.judged_fit(problem.model(), fit, say)
        return judged.model, judged.errors
    return problem.on_mesh(problem.model(), fit.theta, say), errors


@dataclass(frozen=True)
class Profiler:
    """A fit whose profiles are asked for: its model, its errors, and its best theta (d,) under them."""

    fit: Fit
    model: Model
    targets: Targets
    errors: ModelErrors
    theta: Array

    @staticmethod
    def of(
        problem: CalibrationProblem, fit: Fit, say: Say, *, errors: ModelErrors | None = None
    ) -> "Profiler":
        """The profiler of a fit; errors: its model's, where they are known."""
        model, errors = with_own_errors(problem, fit, say, errors=errors)
        residual, jacobian, _ = whitened(model, problem.targets, errors.whitener(problem.targets))
        best = least_squares(residual, jacobian, fit.parameters, start=fit.theta, tolerance=TOLERANCE)
        return Profiler(fit, model, problem.targets, errors, best.theta)

    def profiles(self, names: Sequence[str], step: Callable[[], None]) -> Iterator[Profile]:
        """Profiles of these names, each as soon as it is done, by the executor in use.

        step: called after each of the ENDS of a profile.
        """
        executor = current()
        if len(names) == 1 or executor.workers == 1:
            yield from (self.profile(name, step) for name in names)
            return
        for _, profile in executor.ended([partial(self.profile, name, _nobody) for name in names]):
            for _ in range(ENDS):
                step()
            yield profile

    def profile(self, name: str, step: Callable[[], None]) -> Profile:
        """The profile of a quantity by name; its bits do not depend on earlier calls."""
        fresh = deepcopy(self)  # a model begins its solves from those that it has kept
        quantity = held(self.fit.parameters, name)
        return profile_likelihood(fresh._around, held=quantity, theta=self.theta, step=step)

    def _around(self, theta: Array) -> tuple[Residual, Jacobian]:
        """Residual and Jacobian under the errors that the model has at theta (d,)."""
        errors = self.errors
        if self.model.allowed(self.model.named(theta)):
            with suppress(Unsolvable):  # which the residual says, too
                errors = ModelErrors.of(self.model, theta, self.targets, law=errors.law)
        return whitened(self.model, self.targets, errors.whitener(self.targets))[:2]


def _nobody() -> None:
    """A step without progress."""


ENDS = 2 * len(LEVELS)  # of a profile
