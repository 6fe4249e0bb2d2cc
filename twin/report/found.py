"""What the newest runs of a project say, gathered once for report and recording."""

from typing import Any

from twin.bench.fits import fresh
from twin.chain import kinds_writing
from twin.effects.labels import name_of
from twin.project import files
from twin.project.folder import Project, Run, Say
from twin.report.footage import Footage
from twin.report.onfilm import measured_file, models_on_film
from twin.report.waypictures import Way
from twin.review.states import Fields, Generations, Strains
from twin.targets import Array

STUDY = "study.json"
CHANGES = ("add", "drop")  # the stages that change the effects


class Story:
    """What the newest runs say, gathered once; no number is computed here."""

    def __init__(self, project: Project, run: Run, say: Say) -> None:
        self.project, self.run, self.targets = project, run, project.targets()
        self.generations = Generations.load(self.file("calibrate", "generations.npz"))
        self.calibrated = files.read_json(self.file("calibrate", "fit.json"))
        self.fit = self.json(kinds_writing("fit.json"), "fit.json")
        self.diagnosis = self.json(("diagnose",), "diagnosis.json")
        self.added = self.json(CHANGES, "comparison.json")
        path = fresh(project, CHANGES, "fields.npz")
        self.fields = Fields.load(path) if path else None
        effects = {name_of(label) for label in self.fit.get("effects", [])}
        effects |= set(self.diagnosis.get("named", []))
        self.way = Way.of(project, self.targets, effects=effects)
        self.study_file = fresh(project, ("study",), STUDY)
        self.study = files.read_json(self.study_file) if self.study_file else {}
        filmed, self.not_filmed = models_on_film(project, self.targets, self.generations, say)
        self.footage = Footage(project, filmed) if filmed else None
        strained = measured_file(project, "strain.npz")
        self.strains = Strains.load(strained) if strained else None

    def file(self, kind: str, name: str) -> Any:
        path = fresh(self.project, (kind,), name)
        if path is None:
            raise ValueError(f"{name} of {kind} is missing; run twin {kind}")
        return path

    def json(self, kinds: tuple[str, ...], name: str) -> dict[str, Any]:
        path = fresh(self.project, kinds, name)
        return files.read_json(path) if path else {}

    @property
    def headline(self) -> str:
        """The diagnosis in one sentence, or what is to be done for one."""
        return self.said[0]

    @property
    def said(self) -> tuple[str, str]:
        """The first sentence of the diagnosis, and the others."""
        if self.untested:
            return self.found
        whole = self.diagnosis.get("sentence") or "Not diagnosed yet: run twin diagnose."
        return _first(whole)

    @property
    def untested(self) -> bool:
        """Whether nothing can be said of what is missing, so that the constants are what was found."""
        return self.targets.noise is None or (bool(self.study) and not self.diagnosis.get("ranking"))

    @property
    def found(self) -> tuple[str, str]:
        """What the calibration has found, in one sentence, and the others."""
        if self.study:
            return self.study["headline"], ""
        return _first(self.fit.get("identifiability") or self.calibrated["identifiability"])

    @property
    def labels(self) -> tuple[str, str]:
        """What the report calls the model before and the one with the effects that were added."""
        effects = " and ".join(self.fit.get("effects", []))
        return "calibrated", f"with {effects}" if effects else "model now"

    def prediction(self, kinds: tuple[str, ...]) -> dict[str, Array]:
        """What the newest run of these kinds predicted and left, or nothing."""
        path = fresh(self.project, kinds, "prediction.npz")
        return dict(files.read_npz(path)) if path else {}


def _first(whole: str) -> tuple[str, str]:
    """The first sentence of a text, and the others."""
    first, _, others = whole.partition(". ")
    return (first + "." if others else first), others
