"""Records of a fit and of its comparison with the measurement: fit.json and comparison.json.

It loads quickly: whoever asks which runs hold reads fits, and does without the packages that make them.
"""

from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from twin.records import Maybe, MaybeSize, Record
from twin.tablemodel import Finite

if TYPE_CHECKING:
    from calibrate import Fit, Parameter

Rows = tuple[tuple[Maybe, ...], ...]
NEGATIVE = 1e-9  # relative: an eigenvalue that rounding leaves below 0


class Interval(Record):
    low: Maybe = Field(default=None, description="of the 95 % interval")
    high: Maybe = None
    note: str = Field(default="", description="why there is none")


OLDER = Interval(note="no interval: this fit was made by an older version")


class Estimate(Record):
    """A fitted value with its 95 % interval from low to high, or with a note that says why it has none."""

    value: Finite
    unit: str = ""
    low: Maybe = Field(default=None, description="of the 95 % interval")
    high: Maybe = None
    note: str = Field(default="", description="why there is none")


class ParameterRow(Record):
    value: Finite
    sd: Maybe = Field(description="null where it is open, or at a bound")
    low: Finite = Field(description="bounds of the search")
    high: Finite
    unit: str = ""
    null: Maybe = Field(default=None, description="where an effect is absent")
    typical: Maybe = Field(default=None, description="a step that is felt")
    plausible: tuple[Finite, Finite] | None = Field(default=None, description="expected range")
    start: Maybe = Field(default=None, description="nominal value")

    @model_validator(mode="after")
    def _inside(self) -> Self:
        room = 1e-9 * (self.high - self.low)
        if not self.low - room <= self.value <= self.high + room:
            raise ValueError(f"value {self.value:g} is outside its bounds {self.low:g} to {self.high:g}")
        return self


class MaterialTestRow(Record):
    """Agreement of a fit with a test of the silicone itself."""

    name: str
    kind: str = Field(description="uniaxial, planar, equibiaxial or shear; a compression is uniaxial")
    count: int = Field(description="values of the curve that are fitted")
    recorded: int = Field(description="rows of the file")
    left_out: int = Field(description="rows of the loading branch beyond up_to")
    up_to: Finite = Field(description="largest stretch that is used")
    rms_MPa: Finite = Field(description="of measured minus fitted nominal stress")
    chi2: Finite = Field(description="of its values, under the errors that are stated of it")
    worst_sd: Finite = Field(description="largest misfit of one value, shared errors taken off, in its sd")
    shared_sd: dict[str, Finite] = Field(description="size of each error that all its values share, in sds")
    decides: Finite = Field(description="number of fitted parameters that it decides beside all other data")
    strain: tuple[Finite, ...] = Field(description="nominal strain")
    stress_MPa: tuple[Finite, ...] = Field(description="nominal stress, measured")
    sd_MPa: tuple[Finite, ...] = Field(description="sd of each, shared errors included")
    fitted_MPa: tuple[Finite, ...] = Field(description="nominal stress of the law that was fitted")


class MaterialTestsRow(Record):
    """Agreement of a fit with all tests of the silicone, and of the film with these tests."""

    tests: tuple[MaterialTestRow, ...]
    film_decides: Finite = Field(description="number of fitted parameters that the film decides")
    film_shear_MPa: Maybe = Field(description="shear modulus at rest that the film alone asks for")
    film_shear_sd_MPa: Maybe
    tests_shear_MPa: Maybe = Field(description="the same that the tests alone ask for")
    tests_shear_sd_MPa: Maybe
    p_value: Maybe = Field(description="probability that film and tests of one silicone are as far apart")
    law_p_value: Maybe = Field(description="probability that tests which obey the law are as far from it")
    finger_stretch: Maybe = Field(description="largest stretch in the finger, by which the curves are cut")
    sentence: str


class InitialRow(Record):
    values: dict[str, Finite]
    rms_mm: Maybe = Field(description="as in comparison.json")
    raw_rms_mm: Maybe


class PriorRow(Record):
    """A prior, and what it did to the fit."""

    name: str = Field(description="a parameter, C10+C01 or share")
    unit: str
    mean: Finite
    sd: Finite
    value: Finite = Field(description="as fitted")
    by_data: Maybe = Field(description="what the data say without it, to first order; null where not known")
    sd_by_data: Maybe
    moved_sd: Maybe = Field(description="by which part of that sd the prior moved the value")
    apart_sd: Maybe = Field(description="how far prior and data lie apart, in sd of their difference")
    sentence: str = Field(description="the same in words")


class DownWeighted(Record):
    """A value more than 5 scales of Student's t off the model, which gives it little weight."""

    point: str
    component: str = Field(description="U1, U2 or U3")
    step: int
    time_s: Finite
    residual_mm: Finite
    weight: Finite = Field(description="of 1.25 at most")


class StartRow(Record):
    """A start of least squares on the load paths, and where it ended."""

    start: dict[str, Finite]
    end: dict[str, Finite] | None = Field(description="null where the model has no equilibrium")
    chi2: MaybeSize = Field(description="at the end")
    converged: bool


class FitRecord(Record):
    """A fit. kept.json is one too: of the named effects, with where it began."""

    file: ClassVar[str] = "fit.json"
    parameters: dict[str, ParameterRow] = Field(min_length=1, description="by name")
    covariance: Rows = Field(description="of the parameters, in their order")
    chi2: MaybeSize = Field(description="of the residuals in units of their noise")
    degrees_of_freedom: int
    seed: int = Field(description="how the fit began and ended")
    evaluations: int = Field(ge=0)
    converged: bool
    reason: str
    at_bound: tuple[str, ...] = Field(description="parameters that ended at a bound")
    adequate: bool = Field(default=False, description="no lack of fit")
    intervals: dict[str, Interval] = Field(default={}, description="by name")
    effects: tuple[str, ...] = Field(default=(), description="effects in the model")
    law_error: Finite = Field(
        default=0.0, description="share of what they add by which their laws may err, as the data ask, 1 sd"
    )
    identifiability: str = Field(default="", description="what the targets say about C10 and C01")
    engine: str = Field(default="embedded", description="what solved the model: [model] engine")
    release: str = Field(default="", description="its version, where it is another program")
    initial: InitialRow | None = Field(
        default=None, description="the nominal constants, and their error"
    )
    start: dict[str, Finite] | None = Field(default=None, description="of kept.json: where the fit began")
    loss: str = Field(default="least-squares", description="[calibrate] loss")
    priors: tuple[PriorRow, ...] = Field(default=(), description="[calibrate] priors that the model has")
    down_weighted: tuple[DownWeighted, ...] = Field(
        default=(), description="gross errors, the one that counts least first, 20 at most"
    )
    starts: tuple[StartRow, ...] = Field(default=(), description="of --starts, the best end first")
    said: tuple[str, ...] = Field(
        default=(), description="what engine, priors, loss and starts did, in sentences"
    )
    material_tests: MaterialTestsRow | None = Field(
        default=None, description="tests of the silicone that were fitted beside the film"
    )
    carried_MPa: tuple[Finite, Finite] | None = Field(
        default=None,
        description="up to which pressure the model carries the films of its fit, and those held out, where "
        "it does not carry all",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        names = set(self.parameters)
        for key, used in (("at_bound", set(self.at_bound)), ("intervals", set(self.intervals))):
            if used - names:
                raise ValueError(f"{key} names {sorted(used - names)[0]!r}, which is no parameter")
        check_covariance(self.covariance, len(names))
        return self

    @staticmethod
    def of(fit: "Fit", **beside: Any) -> "FitRecord":
        """The record of a fit, with what stands beside it."""
        fields = {name: value for name, value in vars(fit).items() if name not in ("theta", "parameters")}
        rows = zip(fit.parameters, fit.theta, fit.sd, strict=True)
        values = {p.name: ParameterRow(value=x, sd=sd, **_given(p)) for p, x, sd in rows}
        return FitRecord(**fields | {"parameters": values, "covariance": fit.covariance.tolist()} | beside)

    @property
    def fit(self) -> "Fit":
        """The fit itself."""
        from calibrate import Fit, Parameter

        covariance = np.array([[np.nan if x is None else x for x in row] for row in self.covariance])
        open_ = np.isnan(np.diag(covariance))
        covariance[open_, open_] = np.inf
        return Fit(
            parameters=tuple(
                Parameter(name, p.low, p.high, p.unit, p.null, p.typical, p.plausible, p.start)
                for name, p in self.parameters.items()
            ),
            theta=np.array([p.value for p in self.parameters.values()]),
            covariance=covariance,
            chi2=np.inf if self.chi2 is None else self.chi2,
            degrees_of_freedom=self.degrees_of_freedom,
            seed=self.seed,
            evaluations=self.evaluations,
            converged=self.converged,
            reason=self.reason,
            at_bound=self.at_bound,
        )

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The parameters with their intervals, by name; a fit of an older version has none."""
        intervals = {name: self.intervals.get(name, OLDER) for name in self.parameters}
        return {
            name: Estimate(value=p.value, unit=p.unit, low=span.low, high=span.high, note=span.note)
            for (name, p), span in zip(self.parameters.items(), intervals.values(), strict=True)
        }


def _given(parameter: "Parameter") -> dict[str, Any]:
    """The parameter's own fields, without its name and without what was never given."""
    return {k: v for k, v in vars(parameter).items() if k != "name" and v is not None}


def check_covariance(rows: Rows, size: int) -> None:
    """Raise ValueError unless rows are a covariance of `size` parameters: square, symmetric, positive.

    >>> check_covariance(((1.0, 0.5), (0.4, 1.0)), 2)
    Traceback (most recent call last):
    ValueError: covariance is not symmetric
    """
    if len(rows) != size or any(len(row) != size for row in rows):
        raise ValueError(f"covariance has {len(rows)} rows; wanted {size} x {size}, one for each parameter")
    matrix = np.array([[np.nan if x is None else x for x in row] for row in rows], dtype=float)
    determined = np.flatnonzero(np.isfinite(np.diag(matrix)))
    correlation = np.nan_to_num(matrix[np.ix_(determined, determined)])
    scale = np.sqrt(np.abs(np.diag(correlation)))
    scale[scale == 0] = 1.0
    correlation = correlation / np.outer(scale, scale)
    if not np.allclose(correlation, correlation.T, rtol=0, atol=1e-6):
        raise ValueError("covariance is not symmetric")
    if len(correlation) and float(np.linalg.eigvalsh(correlation)[0]) < -NEGATIVE * len(correlation):
        raise ValueError("covariance has an eigenvalue below 0")


# -- the model beside the measurement ------------------------------------------------------------------------


class MapRow(Record):
    name: str
    count: int
    rms_mm: Maybe
    noise_sd_mm: Maybe
    ratio: Maybe = None


class BeyondRow(Record):
    name: str
    sd: Maybe


class FitTest(Record):
    """A test of lack of fit: its chi2, degrees of freedom, and the probability of one as large."""

    name: str
    chi2: Maybe
    degrees_of_freedom: Finite
    p_value: Maybe


class UnseenFilm(Record):
    """The error of a model in a block that it was not fitted to."""

    film: str
    block: int
    rms_mm: Finite = Field(description="shared errors taken off up to 3 sd")
    raw_rms_mm: Finite = Field(description="with them, as drawn")
    expected_mm: Maybe = Field(default=None, description="that of a right model, fitted to the other films")
    expected_low_mm: Maybe = Field(default=None, description="ends of its 95 % band")
    expected_high_mm: Maybe = None
    noise_sd_mm: Finite
    values: int


class ComparisonRecord(Record):
    """A model beside its targets."""

    file: ClassVar[str] = "comparison.json"
    chi2: Maybe = Field(default=None, description="test of lack of fit")
    degrees_of_freedom: int | None = None
    p_value: Maybe = None
    raw_rms_mm: Maybe = Field(
        default=None, description="error of the model, as it is drawn, with walls within their tolerance"
    )
    expected_mm: Maybe = Field(default=None, description="error of a right model after its fit")
    expected_low_mm: Maybe = Field(default=None, description="ends of its 95 % band")
    expected_high_mm: Maybe = None
    tests: tuple[FitTest, ...] = Field(
        default=(),
        description="tests of lack of fit apart: `all` values, the `pressure`'s errors, the `picture`'s, "
        "`smooth` functions of pressure, time and history",
    )
    rms_mm: Finite = Field(description="error with shared errors taken off up to 3 sd")
    noise_sd_mm: Finite = Field(description="what noise alone would leave of that")
    adequate: bool = Field(default=False, description="p_value above 0.001")
    where: str = Field(default="", description="where the model fails most, in words")
    leans: str = Field(default="", description="dimensions that no camera sees and that count, in words")
    beyond: tuple[BeyondRow, ...] = Field(default=(), description="errors that would have to exceed 4 sd")
    maps: dict[str, tuple[MapRow, ...]] = Field(
        default={},
        description="by `marker`, `direction`, `pressure`, `branch`; shared errors taken off up to 3 sd",
    )
    held_out: tuple[UnseenFilm, ...] = Field(default=(), description="every film that no fit has seen")
