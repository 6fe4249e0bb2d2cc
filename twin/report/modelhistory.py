"""Pictures of the models in their order: the fall of the error, its distribution, and the evidence for an
effect. how the error fell, where it was, and what speaks for an effect. No number is computed here.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from twin import files
from twin.bench.fits import every_fresh
from twin.bench.waterfall import Stair, stairs
from twin.chain import kinds_writing
from twin.diagnosis.explanation import EvidenceRecord
from twin.drawing import plots
from twin.effects.labels import name_of
from twin.project.folder import Project
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
