"""The command posterior: how likely the parameters of the newest fit are, all together, by a Markov chain."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from typer import Option

from calibrate import Fit
from calibrate.posteriors import END, Chain
from twin import files
from twin.bench.comparison import kept_errors
from twin.bench.engines import check_embedded
from twin.bench.fits import fit_file, newest
from twin.bench.priors import check_least_squares
from twin.bench.workbench import Workbench
from twin.calibrated.posterior import Sample, Sampler, WholeSolve
from twin.calibrated.predictions import NORMAL, why_none
from twin.calibrated.profiles import Profiler, profiled_names, sd_of
from twin.commands.profile import ProfilesRecord
from twin.drawing.uncertaintyplots import draw_band, draw_corner
from twin.judging.fitrecord import FitRecord
from twin.judging.likelihood import held
from twin.judging.whitening import Whitener
from twin.messages import Say
from twin.numerals import interval, short, value
from twin.project.folder import Project, Run
from twin.records import Maybe, Record
from twin.table import DataTable
from twin.tablemodel import Finite
from twin.targets import Array, Targets

NEAR, LEANS = 0.05, 0.01  # sds from a bound, and the share of the sample that lies there where it matters
ALIKE = 0.3  # a correlation that is told
OTHERWISE = "Run `twin profile`: a profile solves the model itself wherever it goes."
HARDLY = 0.8  # of the sd that the bounds alone would give


class PosteriorRow(Record):
    """The posterior of one value."""

    name: str = Field(description="a parameter, C10+C01 or share")
    unit: str
    best: Finite = Field(description="of the fit")
    mean: Maybe = Field(description="null, as all below, where the chain may not be trusted")
    sd: Maybe
    low_95: Maybe = Field(description="2.5 % of the sample lie below")
    high_95: Maybe
    low_covariance: Maybe = Field(description="of the 95 % interval by the covariance of the fit")
    high_covariance: Maybe
    low_profile: Maybe = Field(description="of the newest profile of the same fit; null where there is none")
    high_profile: Maybe
    bound: str = Field(description="what its bounds do to it, in words; empty: nothing")


class PosteriorRecord(Record):
    """The posterior of a fit: prior flat within the bounds, errors as the model has them at each value."""

    file: ClassVar[str] = "posterior.json"
    fit: str = Field(description="the run with the fit")
    trusted: bool = Field(description="whether the chain is long enough and the response right")
    doubt: str = Field(description="why not")
    rows: tuple[PosteriorRow, ...] = Field(description="a row a value")
    correlation: tuple[tuple[Maybe, ...], ...] = Field(description="of the parameters, in their order")
    steps: int = Field(description="of each walker")
    walkers: int
    autocorrelation_time: Maybe = Field(description="steps, the longest of all parameters")
    rhat: Maybe = Field(description="split R-hat, the largest")
    acceptance: Finite = Field(description="share of the moves that were accepted")
    solves: int = Field(description="whole solves of the model")
    off: Maybe = Field(description="largest error of chi2 by the response at the solves that checked it")
    off_errors: Maybe = Field(
        description="the same of -2 ln density, by errors of gauge, mesh and laws interpolated between solves"
    )
    inside: Maybe = Field(description="share of the measured values within the 95 % band of a measurement")


@dataclass(frozen=True)
class RunKeeping:
    """Store of a sampler in the folder of a run: solves.npz, chain.npz, and decisions in its log."""

    run: Run
    say: Say

    def solve(self, theta: Array) -> WholeSolve | None:
        """A whole solve at theta (d,) of before."""
        every = self._solves()
        rows: Any = np.flatnonzero([np.array_equal(t, theta) for t in every["theta"]]) if every else []
        if not len(rows):
            return None
        k = int(rows[0])
        return WholeSolve(theta, every["u"][k], every["jacobian"][k], float(every["moved"][k]))

    def add_solve(self, solve: WholeSolve) -> None:
        """Keep a whole solve."""
        arrays = {
            "theta": solve.theta,
            "u": solve.u,
            "jacobian": solve.jacobian,
            "moved": np.array(solve.moved),
        }
        before = self._solves()
        rows = {k: np.concatenate([before[k], x[None]]) if before else x[None] for k, x in arrays.items()}
        self.run.write_npz("solves.npz", rows)

    def _solves(self) -> dict[str, Array]:
        path = self.run.path("solves.npz")
        return files.read_npz(path, "theta", "u", "jacobian", "moved") if path.is_file() else {}

    def chain(self, number: int) -> Chain | None:
        """The stored chain of a number, complete or not."""
        path = self.run.path("chain.npz")
        if not path.is_file():
            return None
        arrays = files.read_npz(path, "number", "positions", "log_density", "accepted", "key", "place")
        return Chain.of(arrays) if int(arrays["number"]) == number else None

    def set_chain(self, number: int, chain: Chain, most: int) -> None:
        """Keep a chain in place of the former state."""
        self.run.write_npz("chain.npz", {"number": np.array(number), **chain.arrays})
        self.say.progress(f"chain {number + 1}, steps", min(chain.steps, most), most)

    def points(self, number: int) -> Array | None:
        """Points (k, d) at which the chain of a number is checked; none where it was made for another."""
        logged = (line["checks"] for line in self.run.log() if "checks" in line)
        theta = next((check["theta"] for check in logged if check["chain"] == number), None)
        return None if theta is None else np.array(theta, float)

    def set_points(self, number: int, points: Array) -> None:
        """Keep where a chain is to be checked."""
        self.run.append({"checks": {"chain": number, "theta": points.tolist()}})

    def note(self, text: str) -> None:
        """A remark for the log."""
        self.run.note(text)


def run_posterior(
    project: Project,
    say: Say,
    *,
    seed: Annotated[int, Option(help="seed of the chain")] = 0,
    steps: Annotated[int, Option(help="steps of each walker at most")] = 20000,
) -> dict[str, Any]:
    """Posterior of all parameters of the newest fit, by a Markov chain.

    ValueError without a fit, where the model does not fit, for steps or seed below their least, and without
    emcee or corner.
    """
    _check(seed, steps)
    check_embedded(project, "twin posterior")
    check_least_squares(project, "twin posterior")
    file = fit_file(project)
    record = files.read(FitRecord, file)
    if why := why_none(record):
        raise ValueError(
            f"no posterior: {why}, and how likely its parameters are then means nothing; find what it lacks "
            "with twin diagnose, or measure more"
        )
    bench, fit = Workbench.of(project), record.fit
    profiles = newest(project, ProfilesRecord)
    extra = {"fit": file.parent.name, "steps": steps}
    inputs = [project.targets_folder, *project.deck_files(), *project.effect_files()]
    with project.new_run("posterior", seed=seed, inputs=inputs, extra=extra) as run:
        profiler = Profiler.of(bench, fit, say, errors=kept_errors(file, fit, bench.targets))
        sampler = Sampler.of(profiler, RunKeeping(run, say))
        sample = sampler.sample(seed=seed, most=steps)
        fit_profiles = profiles if profiles is not None and profiles.fit == file.parent.name else None
        posterior = _record(sample, fit, file, fit_profiles)
        if posterior.trusted:
            band = _Band.of(sample, sampler.whitener)
            posterior = posterior.model_copy(update={"inside": band.inside(bench.targets)})
            _write_sample(run, sample, fit, band, bench.targets)
        run.write(posterior)
        run.summary["headline"] = _headline(posterior)
    for line in _told(posterior):
        say(line)
    wrote = (
        "posterior.json" if not posterior.trusted else "posterior.json, .csv and .png, band.csv and band.png"
    )
    say(f"Wrote {project.shown(run.folder)}/{wrote}")
    return {"stage": "posterior", "run": run.name} | files.plain(posterior)


def _check(seed: int, steps: int) -> None:
    from importlib.util import find_spec

    if seed < 0:
        raise ValueError(f"--seed {seed}: wanted 0 or more")
    if steps < 1:
        raise ValueError(f"--steps {steps}: wanted 1 or more, of each walker at most")
    if missing := [name for name in ("emcee", "corner") if find_spec(name) is None]:
        raise ValueError(
            f"a posterior needs {' and '.join(missing)}: not installed; run pip install emcee corner"
        )


# -- the record ----------------------------------------------------------------------------------------------


def _record(sample: Sample, fit: Fit, file: Path, profiles: ProfilesRecord | None) -> PosteriorRecord:
    chain, trusted = sample.chain, not sample.doubt
    values = sample.density.true(chain.samples)
    names = profiled_names([p.name for p in fit.parameters])
    every = {row.name: row for row in profiles.profiles} if profiles else {}
    rows = [_row(name, fit, values if trusted else None, every.get(name)) for name in names]
    correlation = np.full((len(fit.theta), len(fit.theta)), np.nan)
    if trusted:
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation = np.atleast_2d(np.corrcoef(values.T))
    return PosteriorRecord(
        fit=file.parent.name, trusted=trusted, doubt=sample.doubt, rows=tuple(rows),
        correlation=tuple(tuple(float(x) for x in row) for row in correlation),
        steps=chain.steps, walkers=chain.positions.shape[1], autocorrelation_time=float(chain.tau.max()),
        rhat=float(chain.rhat.max()), acceptance=chain.acceptance, solves=sample.solves, off=sample.off[0],
        off_errors=sample.off[1], inside=None,
    )  # fmt: skip


def _row(name: str, fit: Fit, values: Array | None, profile: Any) -> PosteriorRow:
    quantity, sd = held(fit.parameters, name), sd_of(fit, name)
    best = quantity.value(fit.theta)
    finite = math.isfinite(sd)
    x = None if values is None else np.apply_along_axis(quantity.value, 1, values)
    ends = (None, None) if x is None else tuple(float(q) for q in np.percentile(x, END))
    return PosteriorRow(
        name=name, unit=quantity.unit, best=best,
        mean=None if x is None else float(x.mean()), sd=None if x is None else float(x.std()),
        low_95=ends[0], high_95=ends[1],
        low_covariance=max(best - NORMAL * sd, quantity.low) if finite else None,
        high_covariance=min(best + NORMAL * sd, quantity.high) if finite else None,
        low_profile=profile and profile.low_95, high_profile=profile and profile.high_95,
        bound="" if x is None or name not in {p.name for p in fit.parameters} else _leaning(x, name, fit),
    )  # fmt: skip


def _leaning(x: Array, name: str, fit: Fit) -> str:
    """A sentence on a parameter that its bounds limit, by sample values x (k,); else empty."""
    p = next(p for p in fit.parameters if p.name == name)
    if x.std() > HARDLY * (p.high - p.low) / math.sqrt(12):
        return f"The data hardly narrow {name}: its interval is that of its bounds."
    for end, apart in ((p.low, x - p.low), (p.high, p.high - x)):
        if float(np.mean(apart < NEAR * x.std())) > LEANS:
            bound = f"{short(end)} {p.unit}".rstrip()
            return f"{name} leans on its bound of {bound}: its interval ends there because of that bound."
    return ""


# -- in words ------------------------------------------------------------------------------------------------


def _headline(posterior: PosteriorRecord) -> str:
    if not posterior.trusted:
        return f"No interval: {posterior.doubt}."
    return ", ".join(f"{row.name} {interval(row.low_95, row.high_95)}" for row in posterior.rows) + "."


def _told(posterior: PosteriorRecord) -> list[str]:
    """Lines for the user: table, correlations, limiting bounds, checks of the chain."""
    if not posterior.trusted:
        longer = f"Run `twin posterior --steps {2 * posterior.steps}`."
        return [f"No interval: {posterior.doubt}. {longer if posterior.off is None else OTHERWISE}"]
    out = [*_table(posterior), *(row.bound for row in posterior.rows if row.bound)]
    names = [row.name for row in posterior.rows][: len(posterior.correlation)]
    pairs = [
        f"{a} and {b} {posterior.correlation[i][j]:+.2f}"
        for i, a in enumerate(names)
        for j, b in enumerate(names[:i])
        if abs(posterior.correlation[i][j] or 0.0) > ALIKE
    ]
    if pairs:
        out.append(f"Correlations above {ALIKE}: {', '.join(pairs)}.")
    out.append(
        f"{posterior.steps} steps of {posterior.walkers} walkers, R-hat {posterior.rhat:.3f}. Where it was "
        f"checked, the response is off whole solves by {posterior.off:.2g} of chi2 at most, and the errors "
        f"of gauge, mesh and laws by {posterior.off_errors:.2g} of -2 ln density; {posterior.solves} whole "
        "solves in all."
    )
    out.append(f"{posterior.inside:.0%} of the measured values lie within the 95 % band of a measurement.")
    return out


def _table(posterior: PosteriorRecord) -> list[str]:
    """A line a value: mean, 95 % interval, by covariance, by profile."""
    profiled = any(row.low_profile is not None or row.high_profile is not None for row in posterior.rows)
    cells = [["", "mean", "95 %", "by covariance", *(["by profile"] if profiled else [])]]
    for row in posterior.rows:
        line = [
            f"{row.name}, {row.unit}" if row.unit else row.name, value(row.mean, row.low_95, row.high_95),
            interval(row.low_95, row.high_95), interval(row.low_covariance, row.high_covariance),
        ]  # fmt: skip
        cells.append([*line, *([interval(row.low_profile, row.high_profile)] if profiled else [])])
    return DataTable(cells[0], cells[1:]).lines()


# -- files ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Band:
    """Predictions over the sample: mean (s, p, 3) mm and 95 % ends (2, s, p, 3). outer: ends for a repeated
    measurement, with its noise and shared errors."""

    mean: Array
    ends: Array
    outer: Array

    @staticmethod
    def of(sample: Sample, w: Whitener) -> "_Band":
        """The band of a sample."""
        predictions = sample.shown()
        mean, variance = predictions.mean(axis=0), predictions.var(axis=0)
        noise_variance = np.full(mean.shape, np.nan)
        points, axes = w.components.T
        noise_variance[:, points, axes] = w.sd**2 + (w.modes**2).sum(axis=0)
        half = NORMAL * np.sqrt(variance + noise_variance)
        return _Band(mean, np.percentile(predictions, END, axis=0), np.array([mean - half, mean + half]))

    def inside(self, targets: Targets) -> float:
        """The share of the measured values that lie within the band of a measurement."""
        measured = targets.valid & np.isfinite(self.outer[0])
        within = (targets.value >= self.outer[0]) & (targets.value <= self.outer[1])
        return float(within[measured].mean())


def _write_sample(run: Run, sample: Sample, fit: Fit, band: _Band, targets: Targets) -> None:
    names = profiled_names([p.name for p in fit.parameters])
    every = [held(fit.parameters, name) for name in names]
    rows = np.array([[quantity.value(theta) for quantity in every] for theta in sample.values])
    run.write_text("posterior.csv", DataTable(names, rows.tolist()).csv(digits=8))
    titles = [f"{quantity.name}, {quantity.unit}" if quantity.unit else quantity.name for quantity in every]
    best = np.array([quantity.value(fit.theta) for quantity in every])
    run.write_bytes("posterior.png", draw_corner(rows, titles, best))
    run.write_text("band.csv", DataTable(BAND, _band_rows(band, targets)).csv(digits=6))
    markers = [k for k, fixed in enumerate(targets.fixed) if not fixed]
    measured = np.where(targets.valid, targets.value, np.nan)
    run.write_bytes("band.png", draw_band(
        targets.time, measured[:, markers], band.ends[:, :, markers], band.outer[:, :, markers],
        names=[targets.names[k] for k in markers],
    ))  # fmt: skip


BAND = ("time_s", "point", "component", "measured_mm", "mean_mm", "low_mm", "high_mm", "low_measured_mm",
        "high_measured_mm")  # fmt: skip


def _band_rows(band: _Band, targets: Targets) -> list[list[Any]]:
    """A row for each measured value."""
    return [
        [
            float(targets.time[s]), targets.names[p], f"U{i + 1}",
            *(float(x[s, p, i]) for x in (targets.value, band.mean, *band.ends, *band.outer)),
        ]
        for s, p, i in np.argwhere(targets.valid & np.isfinite(band.outer[0]))
    ]  # fmt: skip
