"""Fits of a residual function: genetic search, least squares, statistics of noise that was itself measured.

Knows no mechanics and no images. Read `parameters` (what varies, what a fit is), then `fit` (least squares),
`genetic` (the search before it, and Pareto fronts of several misfits) and `statistics` (tests, criteria).
`priors` adds prior knowledge, `robust` limits the influence of gross errors, `starts` repeats a fit from many
starts. The accuracy of a fit: `profiles` (profile likelihood), `posteriors` (Markov chain Monte Carlo) and
`randomeffects` (differences between several fits). Operators are arguments: crossover and mutation of a
`Population`, moves of a sampler, refit and guess of a profile.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibrate.fit import least_squares
    from calibrate.genetic import Population
    from calibrate.parameters import Fit, Parameter
    from calibrate.profiles import profile_likelihood
    from calibrate.statistics import bic, chi2_test, excess, holm, identifiability, omnibus, sidak

__all__ = [
    "Fit",
    "Parameter",
    "Population",
    "bic",
    "chi2_test",
    "excess",
    "holm",
    "identifiability",
    "least_squares",
    "omnibus",
    "profile_likelihood",
    "sidak",
]

_MODULES = {
    "Fit": "parameters", "Parameter": "parameters", "Population": "genetic", "least_squares": "fit",
    "profile_likelihood": "profiles",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """What is exported, loaded at its first use: whoever names a parameter needs no optimiser."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES.get(name, 'statistics')}"), name)
