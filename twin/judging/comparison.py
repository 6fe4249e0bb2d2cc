"""Targets, a prediction and a whitener -> whether they agree within the noise, and where not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calibrate import chi2_test, excess
from calibrate.statistics import omnibus_test
from twin.judging.fitrecord import BeyondRow, ComparisonRecord, FitTest, MapRow, UnseenFilm
from twin.judging.lawerrors import memory
from twin.judging.sharederrors import beyond, in_words
from twin.judging.tolerances import leaning, leaning_in_words
from twin.judging.whitening import PLAUSIBLE, UNKNOWN, Expected, Whitener
from twin.targets import Array, Targets, relative

ADEQUATE = 1e-3  # a model is adequate while its lack of fit has at least this probability
OVERSTATED = 0.7  # of its degrees of freedom is the chi2 of the picture below which its noise is told
EVEN = 1.3  # times as large as the smallest is the largest misfit over its noise, where it is even
LEAST, ENOUGH = 50, 100  # values of a marker, direction, pressure or branch that count; degrees of freedom
MEANS = 10.0  # times the noise is what may be expected beside it of data that hardly move
MISSTATED = "The misfit is even"
BRANCHES = ("rest", "up", "hold", "down")
WHILE = {
    "rest": "at rest",
    "up": "while the pressure rises",
    "hold": "while the pressure is held",
    "down": "while the pressure falls",
}


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The misfit of a model: residual (s, p, 3) = measured - predicted mm; cleaned (s, p, 3) mm, without
    errors of measurement and mesh that many values share, each up to PLAUSIBLE sds, NaN where no data;
    whitened (n,); the lack-of-fit test; where it fails.

    raw_rms_mm: the error, as it is drawn, with walls within their tolerance. expected: the error of a right
    model after its fit. rms_mm: the error without shared errors; noise_sd_mm: what noise alone would give of
    that. tests: those of which the smallest probability is p_value, times their number, and that of chi2.
    """

    residual: Array
    cleaned: Array
    whitened: Array
    chi2: float
    degrees_of_freedom: int
    excess: float  # of chi2 over what noise gives, in smooth functions where there are data enough for them
    p_value: float
    rms_mm: float
    noise_sd_mm: float
    where: str
    maps: dict[str, tuple[MapRow, ...]]
    raw_rms_mm: float = float("nan")
    expected: Expected = UNKNOWN
    tests: tuple[FitTest, ...] = ()
    beyond: tuple[tuple[str, float], ...] = ()  # shared errors larger than stated: name, size in sd
    leans: str = ""  # on which dimensions that no camera sees, a sentence

    @property
    def expected_mm(self) -> float:
        """The error of a right model after its fit."""
        return self.expected.rms_mm

    @property
    def expected_low_mm(self) -> float:
        """The lower end of its 95 % band."""
        return self.expected.low_mm

    @property
    def expected_high_mm(self) -> float:
        """The upper end of its 95 % band."""
        return self.expected.high_mm

    @property
    def adequate(self) -> bool:
        """True if noise alone explains the residual."""
        return self.p_value > ADEQUATE

    @property
    def doubt(self) -> str:
        """The reason for which parameters of this fit have no interval, in words; "" where the model fits."""
        if np.isnan(self.p_value):
            return "there are no more data than fitted parameters"
        return "" if self.adequate else "the model does not fit yet"

    def record(self, held_out: Sequence[UnseenFilm] | None = None) -> ComparisonRecord:
        """The record of comparison.json; held_out: of films that the fit has not seen."""
        beside = {} if held_out is None else {"held_out": tuple(held_out)}
        return ComparisonRecord(
            chi2=self.chi2,
            degrees_of_freedom=self.degrees_of_freedom,
            p_value=self.p_value,
            rms_mm=self.rms_mm,
            raw_rms_mm=self.raw_rms_mm,
            expected_mm=self.expected.rms_mm,
            expected_low_mm=self.expected.low_mm,
            expected_high_mm=self.expected.high_mm,
            tests=self.tests,
            noise_sd_mm=self.noise_sd_mm,
            adequate=self.adequate,
            where=self.where,
            leans=self.leans,
            beyond=tuple(BeyondRow(name=name, sd=size) for name, size in self.beyond),
            maps=self.maps,
            **beside,
        )


def branches(time: Array, pressure: Array, log_time: Array, log_pressure: Array) -> Array:
    """Branch number (s,) of each step, an index of BRANCHES, from the pressure path around it.

    A step is on a ramp where the log changes by more than 3 % of its range within 0.5 s.

    >>> time, pressure = np.arange(6.0), np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    >>> [BRANCHES[k] for k in branches(time, pressure, time, pressure)]
    ['rest', 'up', 'up', 'down', 'down', 'rest']
    """
    span = max(float(np.ptp(log_pressure)), 1e-12)
    change = np.interp(time + 0.25, log_time, log_pressure) - np.interp(time - 0.25, log_time, log_pressure)
    low = pressure < 0.05 * span + log_pressure.min()
    still = np.where(low, 0, 2)
    return np.where(change > 0.03 * span, 1, np.where(change < -0.03 * span, 3, still))


def compare(
    targets: Targets, predicted: Array, whitener: Whitener, *, jacobian: Array, at_bound: int = 0,
    names: Sequence[str] = (),
) -> Comparison:  # fmt: skip
    """The comparison of a fitted prediction (s, p, 3) mm.

    jacobian (d, s, p, 3): the prediction's derivatives by the free parameters. at_bound: how many more there
    are, which ended at a bound; they take no degree of freedom, but as many data as parameters show nothing.
    names (d,): of the free parameters, where it is to be told what they lean on.
    """
    residual = targets.value - predicted
    z = whitener.whiten(residual)
    fitted = whitener.whiten(jacobian).T if len(jacobian) else np.zeros((len(z), 0))
    chi2, degrees = float(z @ z), whitener.count - fitted.shape[1]
    smooth = smooth_functions(targets, whitener)
    enough = len(z) > 2 * smooth.shape[1]
    testable = degrees > at_bound
    tests = fit_tests(targets, whitener, z, fitted, smooth if enough else None) if testable else ()
    cleaned_values, cleaned = whitener.cleaned(residual, bound=PLAUSIBLE), np.full(residual.shape, np.nan)
    cleaned[:, whitener.components[:, 0], whitener.components[:, 1]] = cleaned_values
    comparison = Comparison(
        residual=residual,
        cleaned=cleaned,
        whitened=z,
        chi2=chi2,
        degrees_of_freedom=degrees,
        excess=excess(z, smooth, fitted=fitted) if enough else chi2 - degrees,
        p_value=_smallest(tests),
        rms_mm=float(np.sqrt(np.nanmean(cleaned_values**2))),
        noise_sd_mm=whitener.noise_sd,
        where="",
        maps=residual_maps(targets, whitener, cleaned_values),
        raw_rms_mm=whitener.error_beside_walls(residual),
        expected=credible(whitener.expected_after(jacobian), targets, whitener),
        tests=tests,
        beyond=beyond(whitener, residual),
        leans=leaning_in_words(leaning(whitener, jacobian, names)) if names else "",
    )
    return replace(comparison, where=_where(comparison))


def credible(expected: Expected, targets: Targets, w: Whitener) -> Expected:
    """The error that is expected of a right model; UNKNOWN where errors other than noise are larger than all
    that moves: it would say nothing."""
    most = float(np.abs(np.where(targets.valid, targets.value, 0.0)).max(initial=0.0))
    return UNKNOWN if expected.rms_mm > max(most, MEANS * w.noise_sd) else expected


def lack_of_fit(targets: Targets, w: Whitener, z: Array, fitted: Array, smooth: Array | None) -> float:
    """Probability of so bad a fit: the smallest of the tests of `fit_tests`, times their number."""
    return _smallest(fit_tests(targets, w, z, fitted, smooth))


def fit_tests(
    targets: Targets, w: Whitener, z: Array, fitted: Array, smooth: Array | None
) -> tuple[FitTest, ...]:
    """The tests of a whitened residual z (n,) with fitted columns (n, f).

    The chi2 of everything; of it that of the gauge's errors alone, into which a misfit may creep that looks
    like another pressure, and that of all others, the picture's; and the omnibus test on smooth functions (n,
    b), where there are any. They know from how many static frames, values of the film itself, and samples of
    the resting log, the noise was estimated.
    """
    values = w.valid.sum(axis=0)
    nu = freedom(targets, len(values))

    def test(name: str, chi2: float, free: Array, frames: Array) -> FitTest:
        p = chi2_test(chi2, free, frames)
        return FitTest(name=name, chi2=chi2, degrees_of_freedom=float(free.sum()), p_value=p)

    total, f = float(z @ z), fitted.shape[1]
    rows = [test("all", total, values * (1 - f / w.count), nu)]
    chi2, count = w.along_gauge(z)
    if targets.noise and count > f and targets.noise.gauge_frames > 6:
        samples = np.array([targets.noise.gauge_frames - 2.0])
        rows.append(test("pressure", chi2, np.array([float(count - f)]), samples))
        if w.count - count > f:
            rows.append(test("picture", total - chi2, values * (1 - count / w.count), nu))
    if smooth is not None:
        component = np.tile(np.arange(len(values)), len(w.valid))
        share, free, p = omnibus_test(
            z, smooth, component=component, static_frames_effective=nu, fitted=fitted
        )
        rows.append(FitTest(name="smooth", chi2=share, degrees_of_freedom=free, p_value=p))
    return tuple(rows)


def freedom(targets: Targets, components: int) -> Array:
    """The degrees of freedom (c,) that the noise of each component was estimated with. A factor that all
    components share errs in all of them at once."""
    frames, film = (targets.noise.frames, targets.noise.freedom) if targets.noise else (10**6, np.inf)
    return np.full(components, 1 / (1 / (frames - 2) + components / film))


def _smallest(tests: Sequence[FitTest]) -> float:
    """The smallest probability of the tests, times their number; NaN without any. `all` counts where its
    parts were not tested."""
    parts = {t.name: t.p_value for t in tests if t.p_value is not None}
    p = [v for name, v in parts.items() if name != "all" or "picture" not in parts]
    return min(1.0, len(p) * min(p)) if p else float("nan")


def smooth_functions(targets: Targets, w: Whitener, shapes: Array | None = None) -> Array:
    """Whitened smooth functions (n, b): shapes (k, s), by default `slow_shapes`, for every component."""
    courses = slow_shapes(targets) if shapes is None else shapes
    name = f"smooth {hash(courses.tobytes())}"
    if name not in w.noise.kept:
        fields = []
        for point, axis in w.components:
            for shape in courses:
                field = np.zeros((*targets.value.shape[:2], 3))
                field[:, point, axis] = relative(shape, targets.reference, targets.rests)
                fields.append(field)
        w.noise.kept[name] = w.innovations(np.array(fields))  # at once: the filter's steps are what costs
    return w.rewhitened(w.noise.kept[name]).T


def slow_shapes(targets: Targets) -> Array:
    """Courses (k, s) that missing physics may take: powers of pressure, its memory, and branches; powers of
    time where no pressure moves the body."""
    if not np.ptp(targets.pressure):
        t = (targets.time - targets.time[0]) / max(float(np.ptp(targets.time)), 1e-12)
        return np.array([t, t**2, t**3])
    x = targets.pressure / max(float(np.abs(targets.pressure).max()), 1e-12)
    branch = branches(targets.time, targets.pressure, targets.log_time, targets.log_pressure)
    since = np.interp(targets.time, targets.log_time, memory(targets.log_time, targets.log_pressure))
    since = since / max(float(np.abs(since).max()), 1e-12)
    return np.array([x, x**2, x**3, since, (branch == 0).astype(float), x * (branch == 2)])


def residual_maps(targets: Targets, w: Whitener, cleaned: Array) -> dict[str, tuple[MapRow, ...]]:
    """Root mean square of the cleaned residual (s, m) mm, in mm and in noise sds, by marker, direction,
    pressure and branch.

    Shared errors are taken off at PLAUSIBLE sds at most: a misfit at top pressure would else ask for a wrong
    rest position of 16 sd, say, and then seem to be at rest.
    """
    noise = w.noise_sds
    branch = branches(targets.time, targets.pressure, targets.log_time, targets.log_pressure)
    edges = np.linspace(targets.pressure.min(), targets.pressure.max() + 1e-12, 5)
    band = np.clip(np.digitize(targets.pressure, edges) - 1, 0, 3)
    point, axis = w.components.T
    masks = {
        "marker": {targets.names[k]: np.broadcast_to(point == k, cleaned.shape) for k in np.unique(point)},
        "direction": {f"U{k + 1}": np.broadcast_to(axis == k, cleaned.shape) for k in np.unique(axis)},
        "pressure": {
            f"{edges[k] * 1e3:.1f} to {edges[k + 1] * 1e3:.1f} kPa": np.broadcast_to(
                (band == k)[:, None], cleaned.shape
            )
            for k in range(4 if np.ptp(targets.pressure) else 0)
        },
        "branch": {BRANCHES[k]: np.broadcast_to((branch == k)[:, None], cleaned.shape) for k in range(4)},
    }
    return {
        kind: tuple(_row(n, cleaned[m], noise[m]) for n, m in rows.items() if m.any())
        for kind, rows in masks.items()
    }


def _row(name: str, cleaned: Array, noise: Array) -> MapRow:
    """One row of a map; of values that were never measured there is none: count 0 and no rms."""
    good = np.isfinite(cleaned)
    if not good.any():
        return MapRow(name=name, count=0, rms_mm=None, noise_sd_mm=None, ratio=None)
    rms, sd = (float(np.sqrt((x[good] ** 2).mean())) for x in (cleaned, noise))
    return MapRow(
        name=name, count=int(good.sum()), rms_mm=rms, noise_sd_mm=sd, ratio=rms / sd if sd else None
    )


def _beyond_noise(row: MapRow) -> float:
    """The mean square in mm2 that noise does not explain; of nothing measured, less than any."""
    return (row.rms_mm or 0.0) ** 2 - (row.noise_sd_mm or 0.0) ** 2 if row.count else -np.inf


def error_in_words(found: Comparison | ComparisonRecord) -> str:
    """The error of a model beside that of a right one, in words."""
    return f"The model misses the film by {found.raw_rms_mm:.3f} mm. {right_in_words(found)}".strip()


class Banded(Protocol):
    """A record with the 95 % band of the error of a right model in mm; None where it is not known."""

    @property
    def expected_low_mm(self) -> float | None: ...

    @property
    def expected_high_mm(self) -> float | None: ...


def right_in_words(found: Banded) -> str:
    """The 95 % band of the error of a right model, in words; "" of a comparison of an older version."""
    if found.expected_low_mm is None or found.expected_high_mm is None or np.isnan(found.expected_low_mm):
        return ""
    return (
        f"A right model would miss it by {found.expected_low_mm:.3f} to "
        f"{found.expected_high_mm:.3f} mm (95 %)."
    )


def change_in_words(
    before: float | None, after: Comparison | ComparisonRecord, effects: Sequence[str]
) -> str:
    """The error before, that of a right model, and the error with effects, in words."""
    with_them = f"With {' and '.join(effects)}" if effects else "Without any effect"
    if before is None:
        return f"{with_them} the model misses the film by {after.raw_rms_mm:.3f} mm. {right_in_words(after)}"
    return (
        f"The model misses the film by {before:.3f} mm. {right_in_words(after)} {with_them} it misses it by "
        f"{after.raw_rms_mm:.3f} mm."
    )


def noise_in_words(tests: Sequence[FitTest], maps: Mapping[str, Sequence[MapRow]]) -> str:
    """The factor by which the noise is stated too large or too small, in words; "" where it is neither, or
    where the misfit has a place or a course of its own, as that of a missing effect has.

    >>> rows = {"marker": [MapRow(name=n, count=99, rms_mm=0.02, noise_sd_mm=0.01, ratio=2.0) for n in "ab"]}
    >>> test = FitTest(name="picture", chi2=800.0, degrees_of_freedom=200.0, p_value=1e-9)
    >>> noise_in_words([test], rows)
    'The misfit is even over markers, pressures and time: the stated noise is too small, by a factor of 2.0.'
    >>> noise_in_words([test.model_copy(update={"chi2": 50.0, "p_value": 1.0})], rows)
    'The noise of the picture is stated 2.0 times too large: chi2 is 50 of 200 degrees of freedom.'
    """
    found = {t.name: t for t in tests}
    picture, smooth = found.get("picture") or found.get("all"), found.get("smooth")
    if picture is None or picture.chi2 is None or picture.p_value is None:
        return ""
    if picture.degrees_of_freedom < ENOUGH:
        return ""
    factor = float(np.sqrt(picture.chi2 / picture.degrees_of_freedom))
    if factor**2 < OVERSTATED:
        return (
            f"The noise of the picture is stated {1 / factor:.1f} times too large: chi2 is "
            f"{picture.chi2:.0f} of {picture.degrees_of_freedom:.0f} degrees of freedom."
        )
    ratios = [r.ratio for rows in maps.values() for r in rows if r.ratio is not None and r.count >= LEAST]
    even = bool(ratios) and max(ratios) < EVEN * min(ratios) and min(ratios) > 1
    slow = smooth is not None and (smooth.chi2 or 0.0) > 2 * factor**2 * smooth.degrees_of_freedom
    if picture.p_value > ADEQUATE or not even or slow:
        return ""
    return (
        f"{MISSTATED} over markers, pressures and time: the stated noise is too small, by a factor of "
        f"{factor:.1f}."
    )


def _where(comparison: Comparison) -> str:
    """The agreement of the model, or the place of its misfit, in words."""
    if np.isnan(comparison.p_value):
        return (
            "These data cannot show whether the model is right: there are no more data than fitted "
            f"parameters ({comparison.raw_rms_mm:.3f} mm rms are left). Measure more markers, "
            "pressures or times."
        )
    excessive = in_words(comparison.beyond, fits=comparison.adequate)
    noise = noise_in_words(comparison.tests, comparison.maps)
    told = f"{error_in_words(comparison)} {noise}".strip()
    if comparison.adequate:
        return f"The model agrees with the measurement within the noise. {told}{excessive}"
    if noise.startswith(MISSTATED):
        return f"The model does not fit. {told}{excessive}"
    worst = {kind: max(rows, key=_beyond_noise) for kind, rows in comparison.maps.items() if rows}
    marker = worst["marker"]
    places = [f"in {worst['direction'].name}"]
    places += [f"at {worst['pressure'].name}"] if "pressure" in worst else []
    places += [WHILE[worst["branch"].name]] if "branch" in worst else []
    return (
        f"The model does not fit. {told} It fails most at marker "
        f"{marker.name} ({marker.rms_mm:.3f} mm, {marker.ratio:.1f} times its noise), "
        f"{', '.join(places)}.{excessive}"
    )
