"""Fits of a residual function: genetic search, least squares, statistics of noise that was itself measured.

Knows no mechanics and no images. Read `parameters` (what varies, what a fit is), then `fit` (least squares),
`genetic` (the search before it) and `statistics` (tests, criteria). `priors` adds what is known beforehand,
`robust` makes gross errors count little, `starts` begins in many places. What a fit leaves open: `profiles`
(how far a value may go), `posteriors` (how likely values are), `fronts` (several misfits at once) and
`randomeffects` (how far several fits differ).
"""

from calibrate.fit import least_squares
from calibrate.genetic import Population
from calibrate.parameters import Fit, Parameter
from calibrate.profiles import profile_likelihood
from calibrate.statistics import (
    bic,
    chi2_test,
    excess,
    holm,
    identifiability,
    omnibus,
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
