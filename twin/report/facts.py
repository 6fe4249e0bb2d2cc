"""Everything that the report shows, as one record; what is drawn and said of it comes from its neighbours."""

from datetime import date
from typing import Any

import numpy as np

from twin.batches.series import earlier_facts
from twin.effects.labels import name_of
from twin.judging.intervals import estimates_of_record
from twin.report.figures import pictures_of, study_facts
from twin.report.found import Story
from twin.report.heldoutrows import held_out_rows
from twin.report.provenance import budget_facts, provenance_of
from twin.report.sentences import commands, errors_of, mechanism, opening, untold, where


def facts_of(story: Story, notes: list[str]) -> dict[str, Any]:
    """Everything that the report shows."""
    d = story.diagnosis
    every = [r | {"effect": r["law"], "named": r["effect"] in d["named"]} for r in d.get("ranking", [])]
    return {
        "headline": story.headline,
        "summary": " ".join(opening(story)),
        "where": where(story),
        "mechanism": mechanism(story),
        "date": date.today().isoformat(),
        "errors": errors_of(story),
        "named": _named(story),
        "evidence": story.way.facts,
        "ranking": [r for r in every if not _blind(r)],
        "study": study_facts(story),
        "ties": d.get("ties", []),
        "next_test": d.get("next_test"),
        "cannot_tell": [*untold(story), *_by_note([r for r in every if _blind(r)])],
        "calibration": {
            "parameters": _parameters(story.calibrated),
            "sentence": story.calibrated.get("identifiability"),
        },
        "held_out": held_out_rows(story),
        "earlier": earlier_facts(story.project, story.fit or story.calibrated),
        "budget": budget_facts(story.project, story.generations.point_names),
        "chain": _chain(story),
        "pictures": pictures_of(story),
        "notes": notes,
        "provenance": provenance_of(story.project, seed=story.calibrated.get("seed")),
        "commands": commands(story),
    }


def _named(story: Story) -> list[dict[str, Any]]:
    """The effects in the model and the constants beside them, each with its parameters."""
    rows, every = [], _parameters(story.fit)
    for label in story.fit.get("effects", []):
        name = name_of(label)
        own = [p for p in every if p["name"].startswith(f"{name}.")]
        rows.append({"effect": label, "text": "", "parameters": own})
    constants = [p for p in every if "." not in p["name"]]
    return [*rows, {"effect": "constants beside it", "parameters": constants}] if rows else []


def _chain(story: Story) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    camera = story.json(("camera",), "camera.json")
    if camera:
        rows.append({"name": "camera, reprojection RMS", "value": camera["rms_px"], "unit": "px"})
    noise = story.targets.noise
    if noise is not None:
        rows.append(
            {
                "name": "marker noise at rest, median sd",
                "value": 1e3 * float(np.nanmedian(noise.sd)),
                "unit": "um",
            }
        )
        rows.append({"name": "static frames", "value": noise.frames})
        rows.append({"name": "gauge noise, sd", "value": 1e3 * noise.gauge_sd_MPa, "unit": "kPa"})
    rows.append(
        {"name": "steps x markers", "value": f"{len(story.targets.time)} x {len(story.targets.names)}"}
    )
    return rows


def _parameters(fit: dict[str, Any]) -> list[dict[str, Any]]:
    return [{"name": e.name} | e.to_dict() for e in estimates_of_record(fit)]


def _blind(row: dict[str, Any]) -> bool:
    """Whether an effect of the ranking was never tested, and its note says why."""
    return bool(row["note"]) and row["delta_bic"] is None


def _by_note(rows: list[dict[str, Any]]) -> list[str]:
    """One sentence for all effects of which the same is noted."""
    notes = dict.fromkeys(r["note"] for r in rows)
    return [f"{', '.join(r['law'] for r in rows if r['note'] == note)}: {note}." for note in notes]
