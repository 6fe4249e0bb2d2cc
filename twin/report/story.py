"""Results of the newest runs of a project, gathered for report and recording; and pictures of the models in
their order: how the error fell, where it was, and what speaks for an effect."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from twin import files
from twin.bench.fits import every_fresh, fresh, newest
from twin.bench.waterfall import Stair, stairs
from twin.chain import kinds_writing
from twin.diagnosis.diagnosisrecord import NONE, DiagnosisRecord
from twin.diagnosis.explanation import EvidenceRecord
from twin.drawing import plots
from twin.effects.labels import name_of
from twin.judging.fitrecord import ComparisonRecord, FitRecord
from twin.messages import Say
from twin.project.folder import Project, Run
from twin.report.filmprojection import Footage, measured_file, models_on_film
from twin.review.states import Fields, Generations, Strains
from twin.study.record import Study
from twin.targets import Array, Targets

SHOWN = 4  # models whose residuals stand side by side
PARTS = {"residual": "residual", "signature": "{} explains", "left": "left"}  # of evidence.npz, and titles


@dataclass(frozen=True)
class ModelHistory:
    """Models in their order, and the evidence for one effect with its maps (s, p, 3) mm, where there is any.
    """

    project: Project
    targets: Targets
    stairs: tuple[Stair, ...]
    evidence: EvidenceRecord | None
    maps: dict[str, Array]

    @staticmethod
    def of(project: Project, targets: Targets, *, effects: set[str]) -> "ModelHistory":
        """Models of a project, with the newest evidence for an effect of this set."""
        for path in every_fresh(project, kinds_writing(EvidenceRecord.file), EvidenceRecord.file):
            evidence = files.read(EvidenceRecord, path)
            if effects & {name_of(label) for label in evidence.effect.split(" + ")}:
                maps = files.read_npz(path.with_name("evidence.npz"))
                return ModelHistory(project, targets, stairs(project), evidence, maps)
        return ModelHistory(project, targets, stairs(project), None, {})

    @property
    def law(self) -> str:
        """The effect that the evidence is for, nothing without any."""
        return self.evidence.effect if self.evidence else ""

    @property
    def facts(self) -> dict[str, Any]:
        """The evidence as the page shows it: its record, and a table of shares."""
        if not self.evidence:
            return {}
        shares = self.evidence.shares
        markers, branches = (list(dict.fromkeys(getattr(s, k) for s in shares)) for k in ("marker", "branch"))
        cell = {(s.marker, s.branch): s for s in shares}
        table = [{"marker": name, "cells": [cell.get((name, b)) for b in branches]} for name in markers]
        return self.evidence.model_dump(by_alias=True) | {"branches": branches, "table": table}

    @property
    def markdown(self) -> list[str]:
        """Lines of a table of the models and their errors."""
        if not self.stairs:
            return []
        last = self.stairs[-1]
        rows = [(row.done, row.error_mm) for row in self.stairs]
        rows += [("a right model", last.foot_mm)]
        lines = ["", "| model | error, mm rms |", "| --- | --- |"]
        return lines + [f"| {name} | {error:.3g} |" for name, error in rows]

    @cached_property
    def pictures(self) -> dict[str, tuple[str, bytes]]:
        """SVG texts and PNG files by name: error, evidence and residuals, as far as there is something to
        show."""
        drawn = {"error": plots.falling_pictures(**self._fall)} if self.stairs else {}
        return drawn | {name: plots.residual_pictures(**kwargs) for name, kwargs in self._drawings.items()}

    @property
    def _fall(self) -> dict[str, Any]:
        rows = [(row.done, row.error_mm) for row in self.stairs]
        return {"rows": rows, "expected_mm": self.stairs[-1].foot_mm}

    @property
    def _drawings(self) -> dict[str, dict[str, Any]]:
        """Arguments of the residual maps, by name."""
        t, rows = self.targets, np.flatnonzero(~self.targets.fixed)
        if len(t.time) < 3:
            return {}
        drawings = {"evidence": self._signature(), "residuals": self._residuals()}
        common = {"time_s": t.time - t.time[0], "names": [t.names[r] for r in rows], "unit": "um"}
        return {
            name: common | {"maps": {title: 1e3 * residual[:, rows] for title, residual in maps.items()}}
            for name, maps in drawings.items()
            if maps
        }

    def _signature(self) -> dict[str, Array]:
        """Residual, its part explained by the effect, and the remainder, by title."""
        return {PARTS[name].format(self.law): self.maps[name] for name in PARTS if name in self.maps}

    def _residuals(self) -> dict[str, Array]:
        """The cleaned residuals of the last models that were fitted, by what was done."""
        fitted = [row for row in self.stairs if row.run][-SHOWN:]
        paths = {row.done: self.project.root / "runs" / row.run / "prediction.npz" for row in fitted}
        there = {done: path for done, path in paths.items() if path.is_file()}
        return {done: files.read_npz(path, "cleaned")["cleaned"] for done, path in there.items()}


CHANGES = ("add", "drop")  # the stages that change the effects


@dataclass(frozen=True, kw_only=True)
class Story:
    """Results of the newest runs; no number is computed here.

    calibrated: the fit without effects; fit: the newest; start, before, added: comparison of the calibration,
    of what was compared since, and with other effects; not_filmed: why no model lies over the film.
    """

    project: Project
    run: Run
    targets: Targets
    generations: Generations
    calibrated: FitRecord
    fit: FitRecord
    diagnosis: DiagnosisRecord
    start: ComparisonRecord | None
    before: ComparisonRecord | None
    added: ComparisonRecord | None
    fields: Fields | None
    history: ModelHistory
    study_file: Path | None
    study: Study | None
    footage: Footage | None
    not_filmed: str
    strains: Strains | None

    @staticmethod
    def of(project: Project, run: Run, say: Say) -> "Story":
        """Results as of now. ValueError without a calibration."""
        targets = project.targets()
        generations = Generations.load(calibration_file(project, "generations.npz"))
        calibrated = files.read(FitRecord, calibration_file(project, FitRecord.file))
        fit, diagnosis = newest(project, FitRecord) or calibrated, newest(project, DiagnosisRecord) or NONE
        fields, study = fresh(project, CHANGES, "fields.npz"), fresh(project, ("study",), Study.file)
        filmed, why = models_on_film(project, targets, generations, say)
        strained = measured_file(project, "strain.npz")
        effects = {name_of(label) for label in fit.effects}
        return Story(
            project=project,
            run=run,
            targets=targets,
            generations=generations,
            calibrated=calibrated,
            fit=fit,
            diagnosis=diagnosis,
            start=newest(project, ComparisonRecord, ("calibrate",)),
            before=newest(project, ComparisonRecord, ("compare", "calibrate")),
            added=newest(project, ComparisonRecord, CHANGES),
            fields=Fields.load(fields) if fields else None,
            history=ModelHistory.of(project, targets, effects=effects | set(diagnosis.named)),
            study_file=study,
            study=files.read(Study, study) if study else None,
            footage=Footage(project, filmed) if filmed else None,
            not_filmed=why,
            strains=Strains.load(strained) if strained else None,
        )

    @property
    def headline(self) -> str:
        """The diagnosis in one sentence, or what is to be done for one."""
        return self.said[0]

    @property
    def said(self) -> tuple[str, str]:
        """The first sentence of the diagnosis, and the others."""
        if self.untested:
            return self.found
        return _first(self.diagnosis.sentence or "Not diagnosed yet: run twin diagnose.")

    @property
    def untested(self) -> bool:
        """True where missing effects cannot be tested, so that the constants are the result."""
        return self.targets.noise is None or (self.study is not None and not self.diagnosis.ranking)

    @property
    def found(self) -> tuple[str, str]:
        """First sentence on the result of the calibration, and the remaining ones."""
        if self.study:
            return self.study.headline, ""
        return _first(self.fit.identifiability or self.calibrated.identifiability)

    @property
    def labels(self) -> tuple[str, str]:
        """Names in the report of the calibrated model and of the present one with its effects."""
        effects = " and ".join(self.fit.effects)
        return "calibrated", f"with {effects}" if effects else "model now"

    @property
    def unmended(self) -> tuple[float | None, float | None]:
        """Errors in mm of the model without effects, with and without shared errors: from the diagnosis, or
        from the calibration where effects were in the model before it and it asks for no more.
        """
        if self.fit.effects and self.start is not None and not self.diagnosis.named:
            return self.start.raw_rms_mm, self.start.rms_mm
        return self.diagnosis.raw_rms_before_mm, self.diagnosis.rms_before_mm

    def prediction(self, kinds: tuple[str, ...]) -> dict[str, Array]:
        """Prediction and residual of the newest run of these kinds, or nothing."""
        path = fresh(self.project, kinds, "prediction.npz")
        return files.read_npz(path, "u") if path else {}


def calibration_file(project: Project, name: str) -> Path:
    """A file of the newest calibration that holds."""
    path = fresh(project, ("calibrate",), name)
    if path is None:
        raise ValueError(f"{name} of calibrate is missing; run twin calibrate")
    return path


def _first(text: str) -> tuple[str, str]:
    """The first sentence of a text, and the others."""
    sentence, _, others = text.partition(". ")
    return (sentence + "." if others else sentence), others
