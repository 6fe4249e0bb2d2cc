"""All facts of the report as one record; sentences and pictures come from the neighbouring modules."""

from collections.abc import Sequence
from datetime import date
from typing import Any

import numpy as np

from twin import effort, files
from twin.batches.series import earlier_facts
from twin.bench.comparison import told_of_tests
from twin.bench.fits import fresh, newest
from twin.chain import FIT, kinds_writing
from twin.diagnosis.diagnosisrecord import DiagnosisRecord, RankingRow
from twin.effects.labels import name_of
from twin.inputs.cameras import CameraRecord
from twin.judging.fitrecord import FitRecord
from twin.project.folder import Project, kind_of, versions
from twin.report.figures import held_out_films, pictures_of, study_facts
from twin.report.sentences import commands, errors_of, mechanism, opening, untold, where
from twin.report.story import Story

SMALL = 0.01  # of the largest source of uncertainty: smaller ones are not shown
SHOWN = 16  # digits of a SHA-256


def facts_of(story: Story, notes: list[str]) -> dict[str, Any]:
    """Everything that the report shows."""
    d = story.diagnosis
    return {
        "headline": story.headline,
        "summary": " ".join(opening(story)),
        "where": where(story),
        "mechanism": mechanism(story),
        "date": date.today().isoformat(),
        "errors": errors_of(story),
        "named": _named(story),
        "evidence": story.history.facts,
        "ranking": [_ranked(r, d) for r in d.ranking if not r.untested],
        "study": study_facts(story),
        "ties": d.ties,
        "next_test": d.next_test,
        "cannot_tell": [*untold(story), *_by_note([r for r in d.ranking if r.untested])],
        "calibration": {
            "parameters": _parameters(story.calibrated),
            "sentence": " ".join(
                filter(None, (story.calibrated.identifiability, *story.calibrated.said, _of_tests(story.fit)))
            ),
        },
        "held_out": held_out_films(story),
        "earlier": earlier_facts(story.project, story.fit),
        "budget": budget_facts(story.project, story.generations.point_names),
        "chain": _chain(story),
        "pictures": pictures_of(story),
        "notes": notes,
        "provenance": provenance_of(story.project, seed=story.calibrated.seed),
        "commands": commands(story),
    }


def _named(story: Story) -> list[dict[str, Any]]:
    """The effects in the model and the constants beside them, each with its parameters."""
    rows, every = [], _parameters(story.fit)
    for label in story.fit.effects:
        name = name_of(label)
        parameters = [p for p in every if p["name"].startswith(f"{name}.")]
        rows.append({"effect": label, "text": "", "parameters": parameters})
    constants = [p for p in every if "." not in p["name"]]
    note = " ".join(story.fit.said)
    return [*rows, {"effect": "constants beside it", "parameters": constants, "note": note}] if rows else []


def _chain(story: Story) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    camera = newest(story.project, CameraRecord)
    if camera:
        rows.append({"name": "camera, reprojection RMS", "value": camera.rms_px, "unit": "px"})
    noise = story.targets.noise
    if noise is not None:
        rows.append(
            {
                "name": "marker noise at rest, median sd",
                "value": 1e3 * float(np.nanmedian(noise.sd)),
                "unit": "um",
            }
        )
        resting = {"name": "noise model", "value": "", "note": noise.basis}
        rows.append(resting if noise.basis else {"name": "static frames", "value": noise.frames})
        rows.append({"name": "gauge noise, sd", "value": 1e3 * noise.gauge_sd_MPa, "unit": "kPa"})
    rows.append(
        {"name": "steps x markers", "value": f"{len(story.targets.time)} x {len(story.targets.names)}"}
    )
    return rows


def _parameters(fit: FitRecord) -> list[dict[str, Any]]:
    return [{"name": name} | e.model_dump() for name, e in fit.estimates.items()]


def _of_tests(fit: FitRecord) -> str:
    """Sentence on the material tests in a fit, "" without them."""
    return " ".join(told_of_tests((), fit.material_tests))


def _ranked(row: RankingRow, d: DiagnosisRecord) -> dict[str, Any]:
    """A row of the ranking as the page shows it."""
    return row.model_dump() | {"effect": row.law, "named": row.effect in d.named, "behind": d.behind(row)}


def _by_note(rows: list[RankingRow]) -> list[str]:
    """Sentences on untested effects, one for each note."""
    notes = dict.fromkeys(r.note for r in rows)
    return [f"{', '.join(r.law for r in rows if r.note == note)}: {note}." for note in notes]


# -- where the numbers come from ----------------------------------------------------------------------------


def budget_facts(project: Project, names: Sequence[str]) -> dict[str, Any]:
    """Error budget of some markers in um, the largest source first; empty where the targets were measured
    elsewhere.
    """
    path = project.newest("measure", "budget.csv")
    if path is None:
        return {}
    from vision.errors.errorbudget import from_csv
    from vision.errors.errormodel import SOURCES

    table, marks = from_csv(path.read_text(encoding="utf-8"))
    columns = [p for p, name in enumerate(marks) if name in names]
    um = 1e3 * np.sqrt((table.sd[:, columns] ** 2).sum(axis=2))
    order = [r for r in np.argsort(-um.max(axis=1)) if um[r].max() > SMALL * um.max()]
    named = [(table.sources[r], list(um[r])) for r in order]
    rows = [{"source": name, "um": cells, "remedy": SOURCES.get(name)} for name, cells in named]
    total = {"source": "all", "um": list(np.sqrt((um**2).sum(axis=0)))}
    return {"markers": [marks[p] for p in columns], "rows": [*rows, total]}


def provenance_of(project: Project, *, seed: Any) -> dict[str, str]:
    """Seed, run, engine, SHA-256 of every file that the newest fit was made from, and versions."""
    fit = fresh(project, kinds_writing(FIT), FIT)
    inputs = project.info(fit.parent).inputs if fit else {}
    digests = {name: f"SHA-256 {digest[:SHOWN]}" for name, digest in inputs.items()}
    run = {"fit of run": fit.parent.name, "engine": _engine(files.read(FitRecord, fit))} if fit else {}
    return {"seed": str(seed), **run, **_solved(project), **digests, **versions()}


def _engine(fit: FitRecord) -> str:
    """Engine of a fit, with the version of another program."""
    return f"{fit.engine}, {fit.release}" if fit.release else fit.engine


def _solved(project: Project) -> dict[str, str]:
    """Solves of the newest run of each stage, in words."""
    newest = {kind_of(folder): project.info(folder) for folder in project.runs()}
    return {
        f"{kind} solved": f"{effort.in_words(info.solves)}; {info.cpu_s or 0.0:.0f} s of processor in all"
        for kind, info in newest.items()
        if info.solves
    }
