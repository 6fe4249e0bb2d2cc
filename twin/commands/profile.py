"""The command profile: likelihood profiles of the parameters of the newest fit."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from typer import Argument

from calibrate import Fit
from calibrate.profiles import IDENTIFIED, LEVELS, NOT_IDENTIFIED, End, Profile
from twin import files
from twin.bench.comparison import kept_errors
from twin.bench.engines import check_embedded
from twin.bench.fits import fit_file
from twin.bench.workbench import Workbench
from twin.calibrated.predictions import NORMAL, why_none
from twin.calibrated.profiles import ENDS, Profiler, profiled_names, sd_of
from twin.drawing.uncertaintyplots import ProfileCurve, draw_profiles
from twin.judging.fitrecord import FitRecord
from twin.judging.likelihood import held
from twin.messages import Say
from twin.numerals import interval, short, value
from twin.project.folder import Project, Run
from twin.records import Maybe, Record
from twin.table import DataTable
from twin.tablemodel import Finite

APART = 0.25  # of half of an interval by covariance, by which an end of the profile's differs: it is told
BETTER = -0.1  # deviance below which another fit is better than the best


class SolvedPoint(Record):
    """A value with all else fitted anew."""

    value: Finite
    deviance: Finite = Field(description="chi2 less that of the best fit")
    parameters: dict[str, Finite] = Field(description="all, fitted anew")


class ProfileRow(Record):
    """The profile of one value."""

    name: str = Field(description="a parameter, C10+C01 or share")
    value: Finite = Field(description="the best")
    unit: str
    low_68: Maybe = Field(description="null where the profile reaches no end")
    high_68: Maybe
    low_95: Maybe
    high_95: Maybe
    low_covariance: Maybe = Field(description="of the 95 % interval by the covariance of the fit")
    high_covariance: Maybe
    known: str = Field(description="identified, one-sided or not identified")
    sentence: str = Field(description="the same in words")
    solves: int = Field(description="whole solves of the model")
    points: tuple[SolvedPoint, ...] = Field(description="all values that were solved")


class ProfilesRecord(Record):
    """The likelihood profiles of a fit, under the errors kept beside it."""

    file: ClassVar[str] = "profile.json"
    fit: str = Field(description="the run with the fit")
    profiles: tuple[ProfileRow, ...] = Field(description="a row a value")
    note: str = Field(default="", description="where intervals by covariance differ, and a better fit")


def run_profile(
    project: Project,
    say: Say,
    names: Annotated[Sequence[str], Argument(
        metavar="[NAME]...", help="parameters such as C10, C10+C01 or share; without a name all")] = (),
) -> dict[str, Any]:
    """Likelihood profiles of parameters of the newest fit, of C10+C01 and of share.

    ValueError for a name that has none, without a fit, and where the model does not fit.
    """
    check_embedded(project, "twin profile")
    file = fit_file(project)
    record = files.read(FitRecord, file)
    chosen = _wanted(record, names)
    if why := why_none(record):
        raise ValueError(
            f"no profiles: {why}, and how far its parameters may go then means nothing; find what it lacks "
            "with twin diagnose, or measure more"
        )
    bench, fit = Workbench.of(project), record.fit
    extra = {"names": list(chosen), "fit": file.parent.name}
    inputs = [project.targets_folder, *project.deck_files(), *project.effect_files()]
    with project.new_run("profile", inputs=inputs, extra=extra) as run:
        rows = _rows(bench, file, fit, chosen, run, say)
        profiles = ProfilesRecord(fit=file.parent.name, profiles=rows, note=" ".join(_notes(rows)))
        run.write(profiles)
        run.write_text("profile.csv", _csv(rows, [p.name for p in fit.parameters]))
        run.write_bytes("profile.png", _picture(rows, fit))
        run.summary["headline"] = _headline(rows)
    for line in _table(rows):
        say(line)
    for row in rows:
        if row.known != IDENTIFIED:
            say(row.sentence)
    if profiles.note:
        say(profiles.note)
    say(f"All ends are whole solves of the model, {sum(row.solves for row in rows)} in all.")
    say(f"Wrote {project.shown(run.folder)}/profile.csv, profile.json and profile.png")
    return {"stage": "profile", "run": run.name} | files.plain(profiles)


def _wanted(record: FitRecord, names: Sequence[str]) -> tuple[str, ...]:
    available = profiled_names(list(record.parameters))
    for name in names:
        if name not in available:
            raise ValueError(
                f"profile {name!r}: not in the newest fit; wanted some of {', '.join(available)}"
            )
    return tuple(dict.fromkeys(names)) or available


def _rows(
    bench: Workbench, file: Path, fit: Fit, chosen: Sequence[str], run: Run, say: Say
) -> tuple[ProfileRow, ...]:
    """A row a name; a killed run's rows come from its log."""
    former = (ProfileRow.model_validate(line["profile"]) for line in run.log() if "profile" in line)
    done = {row.name: row for row in former}
    missing = [name for name in chosen if name not in done]
    ended, total = ENDS * (len(chosen) - len(missing)), ENDS * len(chosen)

    def step() -> None:
        nonlocal ended
        ended += 1
        say.progress("profile", ended, total)

    say.progress("profile", ended, total)
    if missing:
        profiler = Profiler.of(bench, fit, say, errors=kept_errors(file, fit, bench.targets))
        for profile in profiler.profiles(missing, step):
            done[profile.name] = _row(profile, fit)
            run.append({"profile": files.plain(done[profile.name])})
    return tuple(done[name] for name in chosen)


def _row(profile: Profile, fit: Fit) -> ProfileRow:
    ends = [None if end.limit else end.value for pair in profile.ends for end in pair]
    low, high = _by_covariance(profile.name, fit)
    return ProfileRow(
        name=profile.name, value=profile.best, unit=profile.unit,
        low_68=ends[0], high_68=ends[1], low_95=ends[2], high_95=ends[3],
        low_covariance=low, high_covariance=high,
        known=profile.known, sentence=_sentence(profile), solves=profile.evaluations,
        points=tuple(
            SolvedPoint(value=p.value, deviance=p.deviance, parameters=_named(fit, p.theta))
            for p in profile.points
        ),
    )  # fmt: skip


def _named(fit: Fit, theta: Any) -> dict[str, float]:
    return {p.name: float(x) for p, x in zip(fit.parameters, theta, strict=True)}


def _by_covariance(name: str, fit: Fit) -> tuple[float | None, float | None]:
    """The 95 % interval by the covariance of the fit, cut at the bounds."""
    sd, quantity = sd_of(fit, name), held(fit.parameters, name)
    if not math.isfinite(sd):
        return None, None
    best = quantity.value(fit.theta)
    return max(best - NORMAL * sd, quantity.low), min(best + NORMAL * sd, quantity.high)


# -- in words ------------------------------------------------------------------------------------------------


def _sentence(profile: Profile) -> str:
    """A sentence on the class of a profile."""
    name, (low, high) = profile.name, profile.ends[-1]
    if profile.known == IDENTIFIED:
        return f"The data hold {name} on both sides."
    if profile.known == NOT_IDENTIFIED:
        return (
            f"The data do not hold {name}: every value from {short(low.value)} to {short(high.value)} "
            f"{profile.unit}".rstrip() + " agrees with them."
        )
    open_, side, closed_side = (low, "below", "above") if low.limit else (high, "above", "below")
    return f"The data hold {name} from {closed_side} only: {side}, {_limit(open_, side, profile.unit)}."


def _limit(end: End, side: str, unit: str) -> str:
    end_value = f"{short(end.value)} {unit}".rstrip()
    if end.limit == "bound":
        return f"every value down to its bound of {end_value} agrees" if side == "below" else (
            f"every value up to its bound of {end_value} agrees")  # fmt: skip
    if end.limit == "unsolvable":
        return f"they agree with every value to {end_value}, beyond which the model has no stable equilibrium"
    return f"they agree with every value to {end_value}, where the search gave up"


def _notes(rows: Sequence[ProfileRow]) -> list[str]:
    out = [
        f"{row.name}: the intervals by profile and by covariance differ by more than a quarter of half their "
        "width; quote the profile's, which solves the model where it ends."
        for row in rows
        if _differs(row)
    ]
    best = min((point for row in rows for point in row.points), key=lambda point: point.deviance)
    if best.deviance < BETTER:
        values = ", ".join(f"{name} = {short(x)}" for name, x in best.parameters.items())
        out.append(
            f"A better fit was met at {values}: its chi2 is lower by {-best.deviance:.2g}. Run "
            "`twin calibrate`, and these profiles again."
        )
    return out


def _differs(row: ProfileRow) -> bool:
    """True if an end of the profile lies more than APART of half an interval off the end by covariance."""
    if row.low_covariance is None or row.high_covariance is None:
        return False
    room = APART * (row.high_covariance - row.low_covariance) / 2
    values = [point.value for point in row.points]  # an end that is not reached is the last value of all
    low = min(values) if row.low_95 is None else row.low_95
    high = max(values) if row.high_95 is None else row.high_95
    return abs(low - row.low_covariance) > room or abs(high - row.high_covariance) > room


def _headline(rows: Sequence[ProfileRow]) -> str:
    open_ = [f"{row.name} {row.known}" for row in rows if row.known != IDENTIFIED]
    return f"{', '.join(open_)}." if open_ else f"Identified: {', '.join(row.name for row in rows)}."


def _span(row: ProfileRow) -> str:
    """The 95 % interval by the profile; one-sided where the other end is open."""
    if row.low_95 is not None and row.high_95 is not None:
        return interval(row.low_95, row.high_95)
    if row.high_95 is not None:
        return f"below {short(row.high_95)}"
    return "open" if row.low_95 is None else f"above {short(row.low_95)}"


def _table(rows: Sequence[ProfileRow]) -> list[str]:
    """A line a name: value, 95 % interval by profile and by covariance, class."""
    head = ("", "value", "95 % by profile", "by covariance", "")
    cells = [
        (
            f"{row.name}, {row.unit}" if row.unit else row.name, value(row.value, row.low_95, row.high_95),
            _span(row), interval(row.low_covariance, row.high_covariance), row.known,
        )
        for row in rows
    ]  # fmt: skip
    return DataTable(head, cells).lines()


# -- files ---------------------------------------------------------------------------------------------------


def _csv(rows: Sequence[ProfileRow], names: Sequence[str]) -> str:
    """A line a point that was solved, with all parameters as they were fitted anew."""
    columns = ["name", "unit", "value", "deviance", *names]
    cells = [
        [row.name, row.unit, point.value, point.deviance, *(point.parameters[name] for name in names)]
        for row in rows
        for point in row.points
    ]
    return DataTable(columns, cells).csv(digits=8)


def _picture(rows: Sequence[ProfileRow], fit: Fit) -> bytes:
    curves = [
        ProfileCurve(
            title=f"{row.name}, {row.unit}" if row.unit else row.name,
            values=np.array([point.value for point in row.points]),
            deviances=np.array([point.deviance for point in row.points]),
            best=row.value, centre=held(fit.parameters, row.name).value(fit.theta), sd=sd_of(fit, row.name),
        )
        for row in rows
    ]  # fmt: skip
    return draw_profiles(curves, level=LEVELS[-1])
