"""A residual function in, a fit out: genetic search, least squares, honest statistics. Knows no mechanics."""

from calibrate.fit import least_squares
from calibrate.genetic import Population
from calibrate.parameters import Fit, Parameter
from calibrate.statistics import (
    bic,
    chi2_test,
    excess,
    holm,
    identifiability,
    omnibus,
    profile_likelihood,
    sidak,
)

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
