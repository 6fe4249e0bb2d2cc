"""`twin calibrate --laws`: laws of the silicone, each fitted to the targets, in a table."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from twin import files
from twin.bench.engines import check_embedded
from twin.bench.workbench import Workbench
from twin.effects.phrases import listed
from twin.effects.protocol import Unsolvable
from twin.judging.comparison import ADEQUATE
from twin.laws.catalogue import LAWS, named_law
from twin.laws.law import RubberLaw
from twin.messages import Say
from twin.model.discretisation import Discretisation
from twin.project.folder import Project, Run
from twin.records import Record
from twin.study.lawchoice import LawFit, bench_of, classes, fitted, starts_of
from twin.table import DataTable
from twin.tablemodel import Finite
from twin.targets import Array

ALL = "all"


class LawValue(Record):
    """A constant of a law."""

    value: Finite
    sd: Finite | None = Field(description="null at a bound, and where it is left open")
    unit: str


class LawRow(Record):
    """A law, fitted to the targets."""

    name: str
    title: str
    parameters: dict[str, LawValue]
    at_bound: tuple[str, ...]
    rms_mm: Finite
    chi2: Finite
    degrees_of_freedom: int
    p_value: Finite
    adequate: bool
    evidence: Finite = Field(description="2 ln B over the law with the most: 0 or below")
    bic: Finite = Field(description="BIC over that of the same law, 0 or more where it is worse")
    stretch: Finite = Field(description="highest principal stretch in the model")
    stable_to: Finite = Field(description="stretch up to which it passes Drucker's test, at most `stretch`")
    mode: str = Field(description="uniaxial, planar or equibiaxial: how it fails beyond; empty: it does not")
    group: int = Field(description="laws of one number cannot be told apart; 1 has the most evidence")


class LawsRecord(Record):
    """Laws of the silicone, fitted to one set of targets without effects."""

    file: ClassVar[str] = "laws.json"
    laws: tuple[LawRow, ...] = Field(description="a row a law, that with the most evidence first")
    unsolved: dict[str, str] = Field(description="why a law could not be fitted, by its name")
    sentence: str = Field(description="what the targets say of the laws")


def run_laws(project: Project, say: Say, *, laws: str) -> dict[str, Any]:
    """laws.json: the named laws, or all, fitted to the targets and compared. ValueError for a name that there
    is not, and where none can be fitted."""
    check_embedded(project, "twin calibrate --laws")
    chosen = asked(laws)
    bench = Workbench.of(project)
    if effects := project.config.model.effects:
        say(f"Laws are compared without the effects of twin.toml ({', '.join(effects)}).")
    extra = {"laws": [law.name for law in chosen]}
    with project.new_run("laws", seed=project.config.calibrate.seed, extra=extra) as run:
        rows, unsolved = _fits(bench, chosen, run, say)
        if not rows:
            raise ValueError(f"no law can be fitted: {'; '.join(unsolved.values())}")
        record = LawsRecord(laws=rows, unsolved=unsolved, sentence=sentence_of(rows))
        run.write(record)
        run.summary["headline"] = record.sentence
    for line in (*table(record.laws), *(f"{name}: {why}." for name, why in unsolved.items())):
        say(line)
    for row in record.laws:
        if row.mode:
            say(f"{row.title}: not stable beyond a stretch of {row.stable_to:.3g} ({row.mode}); the model "
                f"reaches {row.stretch:.3g}.")  # fmt: skip
    say(record.sentence)
    say(f"Wrote {project.shown(run.folder)}/laws.json")
    return {"stage": "calibrate", "run": run.name} | files.plain(record)


def asked(text: str) -> tuple[RubberLaw, ...]:
    """The laws that a text names between commas, or all. ValueError for an unknown name.

    >>> [law.name for law in asked("yeoh,gent")]
    ['yeoh', 'gent']
    """
    if text.strip() == ALL:
        return tuple(LAWS.values())
    return tuple(named_law(name.strip()) for name in dict.fromkeys(text.split(",")))


def _fits(
    bench: Workbench, chosen: Sequence[RubberLaw], run: Run, say: Say
) -> tuple[tuple[LawRow, ...], dict[str, str]]:
    """A row a law, and why others have none. Where a killed run had ended a law, its fit begins there and is
    judged anew, which costs two solves."""
    ends = {line["law"]: line["values"] for line in run.log() if "law" in line}
    seed, fits, unsolved = bench.project.config.calibrate.seed, list[LawFit](), dict[str, str]()
    mesh: Discretisation | None = None
    for k, law in enumerate(chosen):
        say.progress("laws", k, len(chosen))
        law_bench = bench_of(bench, law)
        try:
            starts = _starts(law_bench, ends.get(law.name), say)
            if mesh is None and bench.targets.noise is not None:
                initial = starts if law_bench is bench else starts_of(bench, say)
                mesh = bench.mesh(initial[0], bench.model(()), say)
            fits.append(fitted(law_bench, starts, mesh, seed=seed))
        except (Unsolvable, ValueError) as why:
            unsolved[law.name] = str(why)
            continue
        if law.name not in ends:
            run.append({"law": law.name, "values": fits[-1].judged.values})
    say.progress("laws", len(chosen), len(chosen))
    return rows_of(fits), unsolved


def _starts(bench: Workbench, ended: dict[str, float] | None, say: Say) -> Array:
    """Starts (m, d) of a law's fit: its former end, else the scales that fit best."""
    if ended is None:
        return starts_of(bench, say)
    return np.array([[ended[p.name] for p in bench.elasticity.parameters]])


def rows_of(fits: Sequence[LawFit]) -> tuple[LawRow, ...]:
    """A row a law, that with the most evidence first."""
    groups = {f.law.name: k for k, members in enumerate(classes(fits), 1) for f in members}
    if not fits:
        return ()
    every = sorted(fits, key=lambda f: f.evidence)
    return tuple(_row(f, every[0], groups[f.law.name]) for f in every)


def _row(f: LawFit, best: LawFit, group: int) -> LawRow:
    fit, comparison = f.judged.fit, f.judged.comparison
    sds = {
        p.name: float(sd) if np.isfinite(sd) and p.name not in fit.at_bound else None
        for p, sd in zip(fit.parameters, fit.sd, strict=True)
    }
    units = {p.name: p.unit for p in f.law.parameters}
    return LawRow(
        name=f.law.name, title=f.law.title,
        parameters={
            n: LawValue(value=v, sd=sds.get(n), unit=units[n]) for n, v in f.constants.named.items()
        },
        at_bound=fit.at_bound, rms_mm=comparison.raw_rms_mm, chi2=comparison.chi2,
        degrees_of_freedom=comparison.degrees_of_freedom, p_value=comparison.p_value,
        adequate=bool(comparison.p_value > ADEQUATE), evidence=best.evidence - f.evidence,
        bic=f.bic - best.bic, stretch=f.stretch, stable_to=f.stable_to, mode=f.mode, group=group,
    )  # fmt: skip


def sentence_of(rows: Sequence[LawRow]) -> str:
    """A sentence on the laws: the best, those that the targets cannot tell apart, and whether any fits."""
    best = [row.name for row in rows if row.group == 1]
    if len(best) > 1:
        text = f"{listed(best)} cannot be told apart by these targets."
    else:
        text = f"{best[0]} fits these targets best."
    if others := [row.name for row in rows if row.group > 1]:
        text += f" Less likely: {', '.join(others)}."
    if not any(row.adequate for row in rows):
        text += (
            " None fits within the noise, so that this order says little: another effect is missing, which "
            "`twin diagnose` looks for."
        )
    return text


def table(rows: Sequence[LawRow]) -> list[str]:
    """A line a law: its class, RMS, chi2, 2 ln B, BIC, constants and stability."""
    head, cells = ("", "class", "rms, mm", "chi2 / dof", "2 ln B", "BIC", "stable", "constants"), []
    for row in rows:
        stable = f"to {row.stable_to:.2f}" if row.mode else "yes"
        chi2 = f"{row.chi2:.4g} / {row.degrees_of_freedom}"
        constants = ", ".join(f"{n} {_told(v)}" for n, v in row.parameters.items())
        cells.append((row.name, str(row.group), f"{row.rms_mm:.3g}", chi2, f"{row.evidence:.1f}",
                      f"{row.bic:+.1f}", stable, constants))  # fmt: skip
    return DataTable(head, cells).lines()


def _told(v: LawValue) -> str:
    sd = "" if v.sd is None else f" +- {v.sd:.2g}"
    return f"{v.value:.4g}{sd} {v.unit}".rstrip()
