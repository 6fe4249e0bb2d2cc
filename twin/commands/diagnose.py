"""The diagnose stage: which physical effect the model lacks, and what these data cannot tell."""

from dataclasses import dataclass, replace
from typing import Any

from twin import files
from twin.bench.comparison import foretold, write_prediction
from twin.bench.effectchange import Change
from twin.bench.engines import check_embedded
from twin.bench.fits import newest_fit
from twin.bench.priors import check_least_squares
from twin.bench.workbench import Workbench, law_of_project, own_of
from twin.diagnosis.deciding import Diagnosis
from twin.diagnosis.diagnosisrecord import DiagnosisRecord, ForetoldFilm, RankingRow
from twin.diagnosis.explanation import Explanation, explained
from twin.diagnosis.hypotheses import Hypothesis
from twin.diagnosis.procedure import diagnose
from twin.diagnosis.shortlist import LATE
from twin.effects.labels import OPEN, name_of
from twin.effects.library import all_effects, effects_of
from twin.effects.protocol import Effect
from twin.judging.heldout import forecasts
from twin.judging.judged import Judged
from twin.messages import Say
from twin.project.folder import Project, Run

BY_FILM = (
    "The diagnosis asks the film alone, without the material tests. Whether they contradict it, "
    "`twin calibrate` says."
)
TOP = 3  # effects of the ranking that are said; all stand in diagnosis.json


def run_diagnose(project: Project, say: Say) -> dict[str, Any]:
    """Verdict: the effect of the library that the data ask for, and effects that they cannot tell apart."""
    check_embedded(project, "twin diagnose")
    check_least_squares(project, "twin diagnose")
    all_data, fit = Workbench.of(project), newest_fit(project)
    known = all_data.targets.known
    bench, start = all_data.of_film, fit if not (all_data.tests or known) else fit.theta
    dimensions = tuple(k for k in known if k.name.startswith(f"{OPEN}."))  # without a prior they are no use
    if len(known) > len(dimensions):
        say("The diagnosis asks these data alone: it fits without the priors of twin.toml.")
        bench = replace(bench, targets=replace(bench.targets.alone, known=dimensions))
    seed = project.config.diagnose.seed
    with project.new_run("diagnose", seed=seed) as run:
        model = bench.on_mesh(bench.model(), fit.theta, say)
        diagnosis = diagnose(
            model,
            _candidates(project),
            bench.targets,
            seed=seed,
            start=start,
            progress=say.progress,
        )
        settled = _settled(bench, diagnosis)
        diagnosis, held = settled.diagnosis, _held_out(bench, settled)
        record = DiagnosisRecord.of(diagnosis, held)
        _write(run, bench, settled, record)
        if settled.explanation is not None:
            run.write(settled.explanation.record)
            run.write_npz("evidence.npz", settled.explanation.maps)
        for line in (model.extent, *map(_row, diagnosis.ranking)):
            run.note(line)
    for line in record.lines:
        say(line)
    if all_data.tests:
        say(BY_FILM)
    if bench.targets.noise is None:
        say("The calibration holds without it: `twin study` shows what these targets fix and leave open.")
    if diagnosis.ranking:
        say(f"Ranking: {', '.join(_score(r, record) for r in record.ranking[:TOP])}.")
    for row in held:
        say(f"Held out, {row.words}")
    if diagnosis.next_test:
        say(f"Next test: {diagnosis.next_test}.")
    say(f"Wrote {project.shown(run.folder)}/diagnosis.json")
    return {"stage": "diagnose", "run": run.name} | files.plain(record)


@dataclass(frozen=True)
class Settled:
    """A diagnosis with the fit that `twin add` gives of what it names; that fit, and its evidence: both
    None where nothing is named."""

    diagnosis: Diagnosis
    judged: Judged | None = None
    explanation: Explanation | None = None


def _held_out(bench: Workbench, settled: Settled) -> list[ForetoldFilm]:
    """A row a film that no fit has seen: its error before and after the named effect, mm, and their ratio."""
    if settled.diagnosis.base is None:
        return []
    before = foretold(bench, settled.diagnosis.base)
    then = foretold(bench, settled.judged) if settled.judged else [None] * len(before)
    p_before, p_after = forecasts(settled.diagnosis.base, bench.targets), settled.diagnosis.foretold
    rows = zip(before, then, strict=True)
    return [ForetoldFilm.of(a, b, p_before[a.block], p_after.get(a.block)) for a, b in rows]


def _candidates(project: Project) -> tuple[Effect, ...]:
    """Effects to be tested: the candidates of twin.toml or the whole library, and the project's own files."""
    project_effects, law = own_of(project), law_of_project(project)
    groups = [effects_of(text, users=project_effects, law=law) for text in project.config.diagnose.candidates]
    named = [e for candidate in groups for g in candidate for e in g] or all_effects(law)
    return (*named, *(e for e in project_effects if e.name not in [n.name for n in named]))


def _settled(bench: Workbench, diagnosis: Diagnosis) -> Settled:
    """The diagnosis with the evidence for what it names."""
    if not isinstance(diagnosis.kept, Judged) or diagnosis.base is None:
        return Settled(diagnosis)
    labels = [e.label for e in diagnosis.effects]
    members_of = [c.members for c in diagnosis.classes if name_of(c.effect) in diagnosis.named]
    explanation = explained(
        diagnosis.effects,
        before=diagnosis.base,
        after=diagnosis.kept,
        targets=bench.targets,
        evidence=diagnosis.tied[0].evidence,
        mimics=[pair for members in members_of for pair in members.items() if pair[0] not in labels],
    )
    return Settled(replace(diagnosis, evidence=explanation.record), diagnosis.kept, explanation)


def _write(run: Run, bench: Workbench, settled: Settled, record: DiagnosisRecord) -> None:
    """Write diagnosis.json, the base model's prediction.npz and, of the kept effects, what `twin add` takes
    over."""
    diagnosis = settled.diagnosis
    run.write(record)
    run.summary["headline"] = diagnosis.verdict
    if diagnosis.base is not None:
        write_prediction(run, diagnosis.base.predicted, diagnosis.base.comparison)
    if settled.judged is not None:
        effects = [*bench.project.config.model.effects, *(e.label for e in diagnosis.effects)]
        Change.of(bench, settled.judged).keep(run, effects=effects, start=diagnosis.start)


def _score(row: RankingRow, record: DiagnosisRecord) -> str:
    """One effect of the ranking and how far it is behind the best by evidence."""
    behind = record.behind(row)
    if behind is None:
        why = "not visible" if row.note else "not refitted"
        return f"{row.law} ({'not tried' if row.note == LATE else why})"
    return f"{row.law} ({behind:.0f} behind)" if behind else row.law


def _row(c: Hypothesis) -> str:
    """A line of the ranking for the run's log: score, evidence, BIC gain and note of an effect."""
    gain = "not refitted" if c.evidence is None else f"evidence {c.evidence:.0f}, BIC gain {c.delta_bic:.0f}"
    return f"{c.effect.label}: score {c.z:.1f}, {gain}" + (f" ({c.note})" if c.note else "")
