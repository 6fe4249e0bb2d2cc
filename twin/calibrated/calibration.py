"""A calibration as an object: fitted, printed, diagnosed, extended by effects, and asked for predictions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from calibrate import Fit
from calibrate.posteriors import END, Chain
from calibrate.profiles import Profile
from twin.calibrated.actuators import Actuator
from twin.calibrated.effectstarts import begun, begun_from, nominal
from twin.calibrated.positions import asked
from twin.calibrated.posterior import Sample, Sampler, WholeSolve
from twin.calibrated.predictions import NORMAL, Prediction, WantedCourse, predicted, pressure_of, why_none
from twin.calibrated.problem import CalibrationProblem
from twin.calibrated.profiles import Profiler, profiled_names
from twin.calibrated.reports import Report, Reported
from twin.diagnosis import procedure
from twin.diagnosis.deciding import Diagnosis
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.effects.labels import name_of
from twin.effects.library import all_effects, effects_of
from twin.effects.protocol import Effect, Unsolvable
from twin.foreign.foreigndiagnosis import diagnosed
from twin.foreign.programs import Simulator
from twin.judging.comparison import Comparison, error_in_words
from twin.judging.fitrecord import FitRecord
from twin.judging.intervals import fit_record
from twin.judging.judged import Judged
from twin.judging.likelihood import held
from twin.messages import Say, Silent
from twin.targets import Array, Targets

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCALES = (0.5, 1.0, 2.0)  # of the law's nominal constants: the best of them is where a fit begins


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration(Reported):
    """A fitted model beside its data. It prints as a table, a row a parameter: value, sd, 95 % interval, unit
    and note.

    problem: data, structure, law and effects. judged: the model, its fit and its comparison with the data.
    """

    problem: CalibrationProblem
    judged: Judged

    @property
    def fit(self) -> Fit:
        """The fit: theta (d,), covariance (d, d), chi2."""
        return self.judged.fit

    @property
    def values(self) -> dict[str, float]:
        """The fitted parameters by name."""
        return self.judged.values

    @property
    def comparison(self) -> Comparison:
        """The lack-of-fit test, and residuals (s, p, 3) mm."""
        return self.judged.comparison

    @property
    def predicted(self) -> Array:
        """Displacements (s, p, 3) mm at the steps of the data."""
        return self.judged.predicted

    @cached_property
    def record(self) -> FitRecord:
        """The fit as fit.json of a project holds it."""
        law_error = self.judged.errors.law
        return fit_record(self.fit, self.comparison, law_error=law_error, effects=self.problem.labels)

    @property
    def _report(self) -> Report:
        c, rows = self.comparison, list[dict[str, Any]]()
        for name, row in self.record.parameters.items():
            span = self.record.intervals[name]
            rows.append({"parameter": name, "value": row.value, "sd": row.sd, "low_95": span.low,
                         "high_95": span.high, "unit": row.unit, "note": span.note})  # fmt: skip
        effects = f" Effects: {', '.join(self.problem.labels)}." if self.problem.labels else ""
        fits = "The model fits." if c.adequate else "The model does not fit."
        chi2 = f"chi2 is {self.fit.chi2:.4g} of {self.fit.degrees_of_freedom} degrees of freedom."
        return Report(said=(f"{fits} {error_in_words(c)}", f"{chi2}{effects}"), rows=tuple(rows))

    def compare(self) -> Report:
        """The error by marker, direction, pressure and branch, mm: a row each."""
        rows = [
            {"by": by, **row.model_dump()} for by, every in self.comparison.maps.items() for row in every
        ]
        return Report(said=(self.comparison.where,), rows=tuple(rows))

    def add(self, what: "Diagnosed | str", *, say: Say | None = None) -> "Calibration":
        """The model with an effect more, refitted: that which a diagnosis names, or a label such as
        "creep:2". ValueError where the diagnosis names none, or the model cannot have it."""
        if isinstance(what, Diagnosed):
            labels = (*self.problem.labels, *(e.label for e in what.diagnosis.effects))
            judged = what.diagnosis.kept
            if not what.diagnosis.effects:
                raise ValueError(f"the diagnosis names no effect: {what.diagnosis.verdict}")
            problem = replace(self.problem, effects=labels)
            if isinstance(judged, Judged):
                return Calibration(problem=problem, judged=judged)
            return self._refitted(labels, what.diagnosis.start, say or Silent())
        groups = effects_of(what, users=self.problem.own_effects, law=self.problem.law)
        start: dict[str, float] = {}
        labels = self.problem.labels
        for effect in groups[0]:
            _, values = begun(self.judged, effect)
            start |= values
            labels = (*labels, effect.label)
        return self._refitted(labels, start, say or Silent())

    def drop(self, name: str, *, say: Say | None = None) -> "Calibration":
        """The model without an effect, refitted. ValueError where it does not have it."""
        labels = tuple(label for label in self.problem.labels if name_of(label) != name_of(name))
        if labels == self.problem.labels:
            raise ValueError(f"{name!r}: the model has {', '.join(labels) or 'no effect'}; name one of these")
        return self._refitted(labels, {}, say or Silent())

    def _refitted(self, labels: tuple[str, ...], start: Mapping[str, float], say: Say) -> "Calibration":
        problem = replace(self.problem, effects=labels)
        model = problem.model()
        unknown: dict[str, float] = {}
        for effect in model.effects:
            if effect.name not in [e.name for e in self.judged.model.effects]:
                unknown |= nominal(effect, model.test)
        theta = model.theta(begun_from(model, self.values, {**unknown, **start}))
        return Calibration(problem=problem, judged=problem.judged(model, theta, say))

    def predict(
        self,
        *pressure: str,
        at: str | Sequence[str | Sequence[float]] = (),
        ramp_s: float = 2.0,
        hold_s: float = 2.0,
        say: Say | None = None,
    ) -> "Predicted":
        """Displacements that nobody has measured, with 95 % intervals, under pressures such as "20kPa".

        at: names of points, "x=60", or (x, y, z) in mm; by default the points of the data. Each pressure is
        reached in ramp_s and held for hold_s, s. ValueError for a pressure without a unit.
        """
        texts = [at] if isinstance(at, str) else [_place_text(place) for place in at]
        places = asked(self.problem, texts, argument="at")
        tops = [pressure_of(str(text), argument="pressure") for text in pressure]
        courses = [WantedCourse.held(top, ramp_s=ramp_s, hold_s=hold_s) for top in tops]
        if not courses:
            raise ValueError('predict: no pressure; wanted one or more, such as predict("20kPa")')
        return Predicted(tuple(predicted(self.problem, self.record, courses, places, say or Silent())))

    def profile(self, name: str) -> Profile:
        """The likelihood profile of a parameter, of C10+C01 or of share: `.points`, `.ends`, `.known`.

        Source: Raue et al. 2009, doi:10.1093/bioinformatics/btp358. ValueError for another name.
        """
        names = profiled_names([p.name for p in self.fit.parameters])
        if name not in names:
            raise ValueError(f"{name!r} has no profile; wanted one of {', '.join(names)}")
        return self._profiler.profile(name, lambda: None)

    def posterior(self, *, seed: int = 0, steps: int = 20000) -> "Posterior":
        """A sample of the posterior of all parameters, by an ensemble of walkers (emcee). steps: of each at
        most. ValueError where the model does not fit: its parameters then mean nothing."""
        if why := why_none(self.record):
            raise ValueError(f"no posterior: {why}; find what the model lacks with twin.diagnose")
        return Posterior(self.fit, Sampler.of(self._profiler, _Memory()).sample(seed=seed, most=steps))

    @cached_property
    def _profiler(self) -> Profiler:
        return Profiler.of(self.problem, self.fit, Silent(), errors=self.judged.errors)

    def plot(self) -> "Figure":
        """Measured and fitted displacements over pressure, a panel for each component that was seen."""
        from matplotlib.figure import Figure

        data, u = self.problem.targets, self.predicted
        seen = [i for i in range(3) if data.valid[..., i].any()]
        figure = Figure(figsize=(4.5 * len(seen), 3.6), layout="constrained")
        for axes, i in zip(np.ravel(figure.subplots(1, len(seen))), seen, strict=True):
            for p, name in enumerate(data.names):
                (line,) = axes.plot(1e3 * data.pressure, u[:, p, i], lw=1.2, label=name)
                value = np.where(data.valid[:, p, i], data.value[:, p, i], np.nan)
                axes.plot(1e3 * data.pressure, value, ".", ms=3, color=line.get_color())
            axes.set(xlabel="pressure, kPa", ylabel=f"U{i + 1}, mm")
        axes.legend(title="lines: model")
        return figure


def calibrate(
    model: Actuator,
    data: Targets,
    *,
    start: Mapping[str, float] | None = None,
    seed: int = 1,
    say: Say | None = None,
) -> Calibration:
    """The constants of an actuator's silicone, and its effects, fitted to data by bounded least squares.

    model: as `twin.finger` makes it. data: as `twin.read_table` reads it. start: values of parameters by
    name; by default the law's nominal constants, times that of 1/2, 1 and 2 which fits best. The residual is
    whitened by noise and shared errors, those of the mesh included (`CalibrationProblem`). ValueError where
    data and actuator do not belong together, or nothing can be solved at the start.
    """
    if not isinstance(model, Actuator):
        raise ValueError(f"model: {type(model).__name__}; wanted an actuator such as twin.finger()")
    problem, say = model.problem(data), say or Silent()
    fitted = problem.model()
    values: dict[str, float] = {}
    for effect in fitted.effects:
        values |= nominal(effect, fitted.test)
    if start is not None:
        if unknown := sorted(set(start) - set(values)):
            raise ValueError(f"start: {unknown[0]}; wanted {', '.join(values)}")
        starts = [values | dict(start)]
    else:
        starts = [values | {k: s * values[k] for k in problem.law.moduli if k in values} for s in SCALES]
    misfits = {k: _misfit(problem, fitted, theta) for k, theta in enumerate(map(fitted.theta, starts))}
    best = min(misfits, key=lambda k: misfits[k])
    if not np.isfinite(misfits[best]):
        raise ValueError("the model has no equilibrium at its start; state other values: start={'C10': 0.2}")
    try:
        judged = problem.judged(fitted, fitted.theta(starts[best]), say, seed=seed)
    except Unsolvable as error:
        raise ValueError(f"the model cannot be fitted: {error}") from None
    return Calibration(problem=problem, judged=judged)


def _place_text(place: "str | Sequence[float]") -> str:
    """The text of a place, as `twin predict --at` takes it.

    >>> _place_text((60, 11.5, 0)), _place_text("tip")
    ('60,11.5,0', 'tip')
    """
    return place if isinstance(place, str) else ",".join(f"{float(x):.9g}" for x in np.ravel(place))


def _misfit(problem: CalibrationProblem, model: Any, theta: Array) -> float:
    """Root mean square residual in mm; inf where there is no equilibrium."""
    try:
        u = model.predict(theta)
    except Unsolvable:
        return float("inf")
    return problem.targets.rms(problem.targets.value - u)


@dataclass(frozen=True, eq=False)
class Diagnosed(Report):
    """The effect that data ask for: it prints as verdict and ranking."""

    diagnosis: Diagnosis

    @staticmethod
    def of(diagnosis: Diagnosis) -> "Diagnosed":
        """A diagnosis with a row for each effect of its ranking."""
        rows = [
            {"effect": h.effect.label, "score": float(h.z), "evidence": h.evidence, "note": h.note}
            for h in diagnosis.ranking
        ]
        following = f"Next test: {diagnosis.next_test}." if diagnosis.next_test else ""
        said = filter(None, (*DiagnosisRecord.of(diagnosis).lines, following))
        return Diagnosed(said=tuple(said), rows=tuple(rows), diagnosis=diagnosis)

    @property
    def verdict(self) -> str:
        """The answer in a few words."""
        return self.diagnosis.verdict

    @property
    def named(self) -> tuple[str, ...]:
        """Names of the missing effects."""
        return self.diagnosis.named


def diagnose(
    fit: "Calibration | Simulator",
    data: Targets | None = None,
    *,
    effects: Sequence[str | Effect] = (),
    seed: int = 1,
    stand_ins: bool = True,
    like: Calibration | None = None,
    say: Say | None = None,
) -> Diagnosed:
    """The physical effect that a calibrated model lacks, if the data tell it; `fit.add(found)` adds it.

    fit: a calibration, or somebody's own program (`twin.simulator`), which is fitted first. data: by default
    those of the fit. effects: candidates, labels or effects of your own; by default the library
    (docs/effects.md). stand_ins: whether generic effects are tried too, so that something unknown is told
    from what the library has. like: beside a simulator, our own model of a like body, fitted to the same
    data: effects inside the structure are then tried by the shape that they have there. Source of the
    evidence: docs/how-it-decides.md.
    """
    if isinstance(fit, Simulator):
        return _of_simulator(fit, data, effects, seed=seed, stand_ins=stand_ins, say=say, like=like)
    if like is not None:
        raise ValueError("like: beside a calibration; wanted beside a simulator: ours shows its structure")
    problem = fit.problem
    if data is not None and not np.array_equal(data.value, problem.targets.value, equal_nan=True):
        raise ValueError("data: not those of the fit; wanted the same table: calibrate with these first")
    user_effects, law = problem.own_effects, problem.law
    wanted_effects = [effect for effect in effects if isinstance(effect, Effect)]
    for label in effects:
        if isinstance(label, str):
            wanted_effects += [e for group in effects_of(label, users=user_effects, law=law) for e in group]
    candidates = wanted_effects or [*all_effects(law), *user_effects]
    progress = (say or Silent()).progress
    diagnosis = procedure.diagnose(
        fit.judged.model, candidates, problem.targets, seed=seed, start=fit.fit, progress=progress,
        beside=None if stand_ins else (),
    )  # fmt: skip
    return Diagnosed.of(diagnosis)


def _of_simulator(
    simulator: Simulator, data: Targets | None, effects: Sequence[str | Effect], *, seed: int,
    stand_ins: bool, say: Say | None, like: Calibration | None,
) -> Diagnosed:  # fmt: skip
    if data is None:
        raise ValueError("data: none; wanted the targets of twin.read_table(...) beside a simulator")
    if named := [effect for effect in effects if isinstance(effect, str)]:
        raise ValueError(f"effects: {named[0]!r}; wanted effects themselves, or none: all that it can have")
    own = [effect for effect in effects if isinstance(effect, Effect)]
    found = diagnosed(
        simulator, data, effects=own, seed=seed, stand_ins=stand_ins, say=say,
        like=None if like is None else like.judged,
    )  # fmt: skip
    return Diagnosed.of(found)


@dataclass(frozen=True, eq=False)
class Predicted(Reported):
    """Predictions as a table: a row a point and pressure, with 95 % intervals in mm."""

    states: tuple[Prediction, ...]

    @property
    def _report(self) -> Report:
        rows = list[dict[str, Any]]()
        for state in self.states:
            half = NORMAL * state.sd
            for s, p in np.ndindex(state.u.shape[:2]):
                row: dict[str, Any] = {"pressure_kPa": 1e3 * float(state.pressure[s])}
                row["point"] = state.names[p]
                for i in range(3):
                    u, h = float(state.u[s, p, i]), float(half[s, p, i])
                    row |= {f"u{i + 1}_mm": u, f"u{i + 1}_low_mm": None if state.why else u - h,
                            f"u{i + 1}_high_mm": None if state.why else u + h}  # fmt: skip
                rows.append(row)
        why = next((f"No interval: {state.why}." for state in self.states if state.why), "")
        beyond = any(state.beyond.any() for state in self.states)
        sentences = (why, "Beyond the pressure of the data: nobody has tested it." if beyond else "")
        return Report(said=tuple(filter(None, sentences)), rows=tuple(rows))


@dataclass(frozen=True, eq=False)
class Posterior(Reported):
    """A sample of the posterior: `values` (k, d); it prints as mean and 95 % interval of each parameter."""

    fit: Fit
    sample: Sample

    @property
    def values(self) -> Array:
        """The parameters (k, d) of the sample."""
        return self.sample.values

    @property
    def _report(self) -> Report:
        if self.sample.doubt:
            return Report(said=(f"No interval: {self.sample.doubt}.",))
        every, rows = self.sample.density.true(self.sample.chain.samples), list[dict[str, Any]]()
        for name in profiled_names([p.name for p in self.fit.parameters]):
            quantity = held(self.fit.parameters, name)
            x = np.apply_along_axis(quantity.value, 1, every)
            low, high = (float(q) for q in np.percentile(x, END))
            rows.append({"parameter": name, "mean": float(x.mean()), "sd": float(x.std()), "low_95": low,
                         "high_95": high, "unit": quantity.unit})  # fmt: skip
        return Report(rows=tuple(rows))


class _Memory:
    """The solves and chains of a sampler, in memory."""

    def __init__(self) -> None:
        self.solves: list[WholeSolve] = []
        self.chains: dict[int, Chain] = {}
        self.checks: dict[int, Array] = {}

    def solve(self, theta: Array) -> WholeSolve | None:
        return next((solve for solve in self.solves if np.array_equal(solve.theta, theta)), None)

    def add_solve(self, solve: WholeSolve) -> None:
        self.solves.append(solve)

    def chain(self, number: int) -> Chain | None:
        return self.chains.get(number)

    def set_chain(self, number: int, chain: Chain, most: int) -> None:
        self.chains[number] = chain

    def points(self, number: int) -> Array | None:
        return self.checks.get(number)

    def set_points(self, number: int, points: Array) -> None:
        self.checks[number] = points

    def note(self, text: str) -> None:
        """Nothing is kept of a remark."""
