"""The model with other effects than now: refitted, compared, and written into the project."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate import Fit, Parameter
from twin import files
from twin.bench import waterfall
from twin.bench.comparison import (
    JUDGED,
    Judgement,
    compared,
    fitted_by,
    keep,
    kept,
    told_of_tests,
    write_curves,
)
from twin.bench.filmedge import FilmEdge
from twin.bench.fits import fresh, held_fit, newest, newest_fit
from twin.bench.workbench import Workbench, as_far_as_it_carries
from twin.calibrated.effectstarts import begun_from, carrying, nominal
from twin.calibrated.problem import Carried
from twin.judging.comparison import change_in_words
from twin.judging.fitrecord import ComparisonRecord, Estimate, FitRecord, MaterialTestsRow
from twin.judging.intervals import estimates, fit_record
from twin.judging.judged import Judged
from twin.messages import Say
from twin.model.prediction import Model
from twin.numerals import in_words
from twin.project.folder import Run
from twin.review.states import Fields
from twin.targets import Array, Targets

FIELDS, KEPT, KEPT_FIT = "fields.npz", "kept-", "kept.json"
SHOWN = 80  # film times at which the deformed model is stored for the review


@dataclass(frozen=True, kw_only=True)
class Change:
    """A model with other effects, fitted: its fit, how it is judged, and its shape at some film times."""

    fit: Fit
    judgement: Judgement
    fields: Fields
    tests: MaterialTestsRow | None = None

    @staticmethod
    def of(bench: Workbench, judged: Judged) -> "Change":
        """The change to a model that was judged in this process; its edge along the film is kept."""
        fields, tests = _fields(bench, judged.model, judged.theta), bench.agreement(judged)
        FilmEdge(bench).keep(judged)
        return Change(fit=judged.fit, judgement=Judgement.of(judged), fields=fields, tests=tests)

    def record(self, **beside: Any) -> FitRecord:
        """The record for fit.json; beside: further fields."""
        comparison, law_error = self.judgement.comparison, self.judgement.errors.law
        return fit_record(
            self.fit, comparison, material_tests=self.tests, law_error=law_error, **beside
        )

    def keep(self, run: Run, *, effects: Sequence[str], start: Mapping[str, float]) -> None:
        """Write the change into the run of a diagnosis, so that `twin add` need not solve it again."""
        run.write(self.record(effects=tuple(effects), start=dict(start)), KEPT_FIT)
        keep(run, self.fit.theta, self.judgement, file=f"{KEPT}{JUDGED}")
        self.fields.save(run.path(f"{KEPT}{FIELDS}"))


def without(bench: Workbench, now: Judged, labels: Sequence[str], say: Say) -> Judged:
    """The model without some of its effects, as it was fitted before, else from where it is now."""
    effects = [e for e in bench.project.config.model.effects if e not in labels]
    model, former = bench.model(effects), held_fit(bench.project, effects)
    if former:
        return bench.judged_fit(model, former.fit, say)
    return bench.judged(model, model.theta(now.values), say)


def diagnosed(bench: Workbench, effects: Sequence[str], start: Mapping[str, float]) -> Change | None:
    """The change to these effects, as the newest diagnosis fitted it from this start; None without one.

    None also where another version of the code fitted it, or where there are priors or tests of the
    silicone: a diagnosis uses the film alone.
    """
    if bench.targets.known or bench.targets.curves:
        return None
    fit_path = fresh(bench.project, ("diagnose",), KEPT_FIT)
    record = files.read(FitRecord, fit_path) if fit_path else None
    if fit_path is None or record is None or record.effects != tuple(effects) or record.start != dict(start):
        return None
    judgement = kept(fit_path, record.fit, bench.targets, file=f"{KEPT}{JUDGED}")
    fields = fit_path.with_name(f"{KEPT}{FIELDS}")
    if judgement is None or not fields.is_file():
        return None
    return Change(fit=record.fit, judgement=judgement, fields=Fields.load(fields))


def change_effects(
    bench: Workbench,
    kind: str,
    effects: tuple[str, ...],
    start: dict[str, float],
    say: Say,
    *,
    base: Fit | None = None,
) -> dict[str, Any]:
    """Summary of `twin add` and `twin drop`: the model with these effects is fitted, compared with the newest
    comparison, and written into twin.toml. A drop leads back to the fit of before, where that still holds.

    start: values of parameters by name; others begin at the fit `base`, by default the newest valid one.
    """
    bench.project.check_effects(effects)  # before any work is done for them
    project, base = bench.project, base or newest_fit(bench.project)
    then = newest(project, ComparisonRecord)
    with project.new_run(kind, extra={"effects": list(effects)}) as run:
        model = bench.model(effects)
        former = held_fit(project, effects) if kind == "drop" else None
        if former is not None and former.carried_MPa is not None:
            bench = bench.carrying(Carried(*former.carried_MPa))
        if former is None:
            change = diagnosed(bench, effects, start)
        else:
            change = Change.of(bench, bench.judged_fit(model, former.fit, say))
        if change is None:
            fitted = {p.name: float(x) for p, x in zip(base.parameters, base.theta, strict=True)}
            unknown = {n: x for n, x in _nominal(model).items() if n not in fitted}
            theta = model.theta(begun_from(model, fitted, {**unknown, **start}))
            say.progress(f"refit with {', '.join(effects) or 'no effect'}", 0, 1)
            bench, change = _fitted(bench, effects, theta, say)
        if bench.carried is not None and former is None:  # the effects may carry more
            all_of_it = Workbench.of(project, whole=True)
            stronger = _carrying(all_of_it, effects, base, change.fit.theta)
            further, gone_on = _fitted(all_of_it, effects, stronger, say)
            if further.carried is None or further.carried.fitted >= bench.carried.fitted:
                bench, change = further, gone_on
            say(_carries(bench, effects))
        fit, comparison = change.fit, compared(run, change.fit.theta, change.judgement, bench, say)
        beside = fitted_by(bench, fit, change.judgement)
        run.write(change.record(effects=effects, **beside))
        change.fields.save(run.path(FIELDS))
        write_curves(run, change.tests)
        run.note(model.extent)
    project.set_effects(effects)
    say(change_in_words(then.raw_rms_mm if then else None, comparison, effects))
    history = waterfall.stairs(project)
    if len(history) > 2:
        say(waterfall.in_words(history))
    say(f"{in_words(estimates(fit, comparison, change.tests))}.")
    for sentence in (*beside["said"], *told_of_tests((), change.tests)):
        say(sentence)
    for sentence in _unseen(model, change):
        say(sentence)
    say(comparison.where)
    if change.judgement.errors.law:
        say(f"These data ask for laws that may err by {change.judgement.errors.law:.0%} of what the effects "
            "add: intervals and the test of the fit know it.")  # fmt: skip
    say(f"Wrote {project.shown(run.folder)}/fit.json; twin.toml has effects = {list(effects)}")
    return {
        "stage": kind,
        "run": run.name,
        "rms_before_mm": then and then.rms_mm,
        "rms_after_mm": comparison.rms_mm,
        "raw_rms_before_mm": then and then.raw_rms_mm,
        "raw_rms_after_mm": comparison.raw_rms_mm,
        "expected_mm": comparison.expected_mm,
        "expected_low_mm": comparison.expected_low_mm,
        "expected_high_mm": comparison.expected_high_mm,
        "noise_sd_mm": comparison.noise_sd_mm,
        "effects": list(effects),
        "fit": files.plain(change.record(**beside)),
        "steps": files.plain(history),
    }


def _fitted(
    bench: Workbench, effects: tuple[str, ...], start: Array, say: Say
) -> tuple[Workbench, Change]:
    """The model with effects, fitted from a start (d,) to the targets as far as it carries them, and the
    workbench with these."""
    return as_far_as_it_carries(
        bench, lambda b: (b, Change.of(b, b.judged(b.model(effects), start, say)))
    )


def _carrying(bench: Workbench, effects: tuple[str, ...], base: Fit, theta: Array) -> Array:
    """A start (d,) at which what is new beside a base fit carries as much of the test as it may: with the
    constants of that fit and more of what is new, or theta (d,)."""
    model = bench.model(effects)
    fitted = {p.name: float(x) for p, x in zip(base.parameters, base.theta, strict=True)}
    added = [p for p in model.parameters if p.name not in fitted and p.null is not None]
    if not added:
        return theta
    begun = model.theta({**model.named(theta), **fitted, **{p.name: p.null or 0.0 for p in added}})
    start = carrying(model, begun, added)
    return theta if np.array_equal(start, begun) else start


def _carries(bench: Workbench, effects: Sequence[str]) -> str:
    """A sentence on how far a model with effects carries a test of which it carried a part."""
    model = f"The model with {' and '.join(effects)}" if effects else "The model"
    if bench.carried is None:
        return f"{model} carries all of the test, and is fitted to all of it."
    return f"{model} is fitted up to {1e3 * bench.carried.fitted:.3g} kPa: it does not carry more."


def _unseen(model: Model, change: Change) -> list[str]:
    """A sentence for each effect of a model that these data do not need."""
    estimated = estimates(change.fit, change.judgement.comparison, change.tests)
    unseen = [e for e in model.effects if e.amplitudes and all(_at_null(p, estimated) for p in e.amplitudes)]
    return [
        f"These data do not ask for {e.label}: it may as well be absent. `twin drop {e.name}` takes it out."
        for e in unseen
    ]


def _at_null(p: Parameter, estimated: Mapping[str, Estimate]) -> bool:
    """True where the 95 % interval of an effect's parameter holds the value of an absent effect."""
    null, estimate = p.null or 0.0, estimated[p.name]
    if estimate.low is None or estimate.high is None:
        return bool(np.isclose(estimate.value, null))  # at its bound
    return estimate.low <= null <= estimate.high


def _nominal(model: Model) -> dict[str, float]:
    """Default start values of all parameters. ValueError for an effect whose variant must be stated."""
    values: dict[str, float] = {}
    for e in model.effects:
        values |= (start := nominal(e, model.test))
        fixed = e.at(start, model.test)
        if fixed is not e:
            raise ValueError(
                f"effect {e.label!r}: it must be stated which; wanted for example {fixed.label!r}, as "
                "the diagnosis names it"
            )
    return {p.name: float(np.clip(values[p.name], p.low, p.high)) for p in model.parameters}


def _fields(bench: Workbench, model: Model, theta: Array) -> Fields:
    """The fitted model at evenly spread film times, for the review."""
    t: Targets = bench.targets
    steps = np.unique(np.linspace(0, len(t.time) - 1, min(SHOWN, len(t.time))).round().astype(int))
    rows = np.flatnonzero(~t.fixed)
    solved = model.values(theta)
    u, predicted = solved.solution.fields(list(steps)), solved.u
    rest = solved.solution.fields(list(t.reference[:: max(1, len(t.reference) // 3)])).mean(axis=0)
    node_count = len(bench.case.nodes)  # of a whole made of a half, the half comes first
    return Fields(
        time_s=t.time[steps] - t.time[0],
        pressure=t.pressure[steps],
        u=(u - rest)[:, :node_count].astype(np.float32),
        u_points=predicted[steps][:, rows],
        u_measured=t.value[steps][:, rows],
    )
