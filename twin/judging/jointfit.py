"""A fit of a film and of tests of the silicone itself -> how each test agrees, and whether all ask for one
silicone."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from calibrate import least_squares
from twin.effects.protocol import Unsolvable
from twin.judging.comparison import ADEQUATE
from twin.judging.fitrecord import MaterialTestRow, MaterialTestsRow
from twin.judging.judged import Judged
from twin.judging.materialcurves import curve_jacobian, curve_residual, silicone
from twin.model.prediction import STEP
from twin.targets import Array, MaterialCurve, Targets

SMALL = 1e-9  # of the largest information, below which a direction is not determined


def agreement(
    judged: Judged, targets: Targets, *, finger_stretch: float | None = None
) -> MaterialTestsRow | None:
    """Agreement of a judged model with the tests of the silicone; None where there are none. The optimum of
    the film alone is found to first order, along the derivatives at the fit; the tests are fitted alone."""
    return _Joint(judged, targets).row(finger_stretch) if targets.curves else None


def doubt_of_tests(agreed: MaterialTestsRow | None) -> str:
    """The reason for which a fit of film and tests has no interval, in words; "" where they agree."""
    if agreed is None:
        return ""
    if agreed.law_p_value is not None and agreed.law_p_value < ADEQUATE:
        return "the law does not follow the material tests"
    if agreed.p_value is not None and agreed.p_value < ADEQUATE:
        return "film and material tests contradict each other"
    return ""


@dataclass(frozen=True, eq=False)
class _Joint:
    """A fit of the free parameters (f,) to a film and to curves."""

    judged: Judged
    targets: Targets

    @cached_property
    def free(self) -> Array:
        """Flags (d,) of the free parameters."""
        return np.array([p.name not in self.judged.at_bound for p in self.judged.model.parameters])

    @cached_property
    def parts(self) -> list[Array]:
        """Whitened derivatives (n, f) of the film and of each curve, by the free parameters, but for the sign
        of the curves', which nothing asks for."""
        jacobian = curve_jacobian(self.judged.model, self.targets, self.judged.theta)[:, self.free]
        ends = np.cumsum([len(curve.strain) for curve in self.targets.curves])
        return [self.judged.fitted, *np.split(jacobian, ends[:-1])]

    @cached_property
    def scale(self) -> Array:
        """The length (f,) of each parameter's derivatives, all data together."""
        length = np.sqrt(sum((part**2).sum(axis=0) for part in self.parts))
        return np.where(length > 0, length, 1.0)

    @cached_property
    def rows(self) -> list[Array]:
        """The derivatives in units of their lengths."""
        return [part / self.scale for part in self.parts]

    @cached_property
    def alone(self) -> tuple[Array, float, int]:
        """The tests fitted alone: theta (d,), chi2, and the number of parameters that they determine."""
        model, start = self.judged.model, self.judged.theta

        def residual(theta: Array) -> Array | None:
            if not model.allowed(model.named(theta)):
                return None
            try:
                return curve_residual(model, self.targets, theta)
            except Unsolvable:
                return None

        fit = least_squares(
            residual, lambda theta: curve_jacobian(model, self.targets, theta), model.parameters, start=start
        )
        return fit.theta, fit.chi2, rank(np.vstack(self.rows[1:]))

    def row(self, finger_stretch: float | None) -> MaterialTestsRow:
        film = self.rows[0]
        covariance = np.linalg.pinv(sum(part.T @ part for part in self.rows), rcond=SMALL, hermitian=True)
        decide = [float(np.trace(covariance @ part.T @ part)) for part in self.rows]
        theta, least, determined = self.alone
        z = self.judged.z
        step = np.asarray(np.linalg.lstsq(film, z, rcond=SMALL)[0], float)
        now = curve_residual(self.judged.model, self.targets, self.judged.theta)
        excess = float(z @ z + now @ now - ((z - film @ step) ** 2).sum() - least)
        spare = rank(film) + determined - rank(np.vstack(self.rows))
        lacking = len(now) - determined
        result = MaterialTestsRow(
            tests=tuple(map(self._test, self.targets.curves, decide[1:])),
            film_decides=decide[0],
            **self._shears(step, theta),
            p_value=float(scipy.special.chdtrc(spare, excess)) if spare else None,
            law_p_value=float(scipy.special.chdtrc(lacking, least)) if lacking > 0 else None,
            finger_stretch=finger_stretch,
            sentence="",
        )
        return result.model_copy(update={"sentence": _sentence(result, int(self.free.sum()))})

    def _test(self, curve: MaterialCurve, decides: float) -> MaterialTestRow:
        model = self.judged.model
        stress = curve.predicted(silicone(model, self.judged.values))
        misfit = curve.stress - stress
        shared, z = curve.shared(misfit), curve.whiten(misfit)
        return MaterialTestRow(
            name=curve.name, kind=curve.kind, count=len(misfit), recorded=curve.recorded,
            left_out=curve.left_out, up_to=curve.up_to, rms_MPa=float(np.sqrt((misfit**2).mean())),
            chi2=float(z @ z),
            worst_sd=float(np.abs((misfit - shared @ curve.modes) / curve.sd).max()),
            shared_sd=dict(zip(curve.mode_names, shared.tolist(), strict=True)), decides=decides,
            strain=tuple(curve.strain.tolist()), stress_MPa=tuple(curve.stress.tolist()),
            sd_MPa=tuple(np.sqrt(curve.sd**2 + (curve.modes**2).sum(axis=0)).tolist()),
            fitted_MPa=tuple(stress.tolist()),
        )  # fmt: skip

    def _shears(self, step: Array, alone: Array) -> dict[str, float | None]:
        """The shear moduli at rest that the film and the tests ask for alone, with their sds."""
        model, theta = self.judged.model, self.judged.theta

        def shear(point: Array) -> float:
            return silicone(model, model.named(point)).shear

        steps = np.diag([STEP * p.step for p in model.parameters])
        slopes = np.array([(shear(theta + h) - shear(theta - h)) / (2 * h.sum()) for h in steps])
        slope = slopes[self.free] / self.scale
        film, *tests = self.rows
        return {
            "film_shear_MPa": shear(theta) + float(slope @ step),
            "film_shear_sd_MPa": sd_along(slope, film),
            "tests_shear_MPa": shear(alone),
            "tests_shear_sd_MPa": sd_along(slope, np.vstack(tests)),
        }


def rank(rows: Array) -> int:
    """The number of directions that whitened derivatives (n, f), columns of length 1 at most, determine.

    >>> rank(np.array([[1.0, 1.0], [2.0, 2.0]]) / 3)
    1
    """
    return int((np.linalg.svd(rows, compute_uv=False) > np.sqrt(SMALL)).sum())


def sd_along(slope: Array, rows: Array) -> float | None:
    """The sd of what has these derivatives (f,), by whitened derivatives (n, f); None where they do not
    determine it.

    >>> sd_along(np.array([1.0, 0.0]), np.array([[2.0, 0.0]]))
    0.5
    >>> sd_along(np.array([0.0, 1.0]), np.array([[2.0, 0.0]])) is None
    True
    """
    _, sizes, axes = np.linalg.svd(rows, full_matrices=True)
    sizes = np.append(sizes, np.zeros(len(axes) - len(sizes)))
    along, determined = axes @ slope, sizes > np.sqrt(SMALL)
    if np.linalg.norm(along[~determined]) > 1e-6 * np.linalg.norm(slope):
        return None
    return float(np.linalg.norm(along[determined] / sizes[determined]))


def _sentence(agreed: MaterialTestsRow, free: int) -> str:
    """Agreement of film and tests in words: what each decides, and likely causes where they disagree."""
    names = " and ".join(test.name for test in agreed.tests)
    decided = (
        f"Of the {free} fitted parameters the film decides {agreed.film_decides:.1f}, "
        f"{', '.join(f'{test.name} {test.decides:.1f}' for test in agreed.tests)}."
    )
    wished = _wished(agreed)
    doubt = doubt_of_tests(agreed)
    if not doubt:
        return f"Film and material tests ({names}) agree within their errors.{wished} {decided}"
    if agreed.law_p_value is not None and agreed.law_p_value < ADEQUATE:
        worst = max(agreed.tests, key=lambda test: test.worst_sd)
        return (
            f"The model's law does not follow the material tests: {worst.name} is off by up to "
            f"{worst.worst_sd:.1f} sd.{wished} Are sd_MPa and sd_percent too small? Else another law is "
            "needed, or a lower stretch_up_to."
        )
    return (
        f"Film and material tests ({names}) contradict each other.{wished} The silicone of the specimen may "
        "have cured otherwise, been colder, pulled faster or stretched before (Mullins). Or its area, "
        f"true_stress or the finger's walls are not as stated. {decided}"
    )


def _wished(agreed: MaterialTestsRow) -> str:
    """The shear moduli that film and tests ask for alone, in words."""
    a, b = agreed.film_shear_MPa, agreed.tests_shear_MPa
    sa, sb = agreed.film_shear_sd_MPa, agreed.tests_shear_sd_MPa
    if a is None or b is None or sa is None or sb is None:
        return ""
    apart = abs(a - b) / np.hypot(sa, sb)
    return (
        f" The film alone asks for a shear modulus of {a:.3g} ± {sa:.2g} MPa (1 sd), the tests for {b:.3g} ± "
        f"{sb:.2g} MPa: {apart:.1f} sd apart."
    )
