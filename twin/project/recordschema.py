"""What the JSON files of runs hold, by their names: a damaged one is named, and used for nothing.

run.json, fit.json and kept.json are known key by key. Of findings that only reports show, what is read of
them is checked, and other keys may be there.
"""

from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, RootModel, model_validator

from twin.project.tablemodel import Finite, NotNegative, Positive, TableModel
from twin.project.validation import checked

Maybe = Finite | None  # null: infinite, or not known
Rows = tuple[tuple[Maybe, ...], ...]
Text = str
NEGATIVE = 1e-9  # relative: an eigenvalue that rounding leaves below 0


class Finding(BaseModel):
    """A part of a finding: what is named is checked, other keys may be there."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True)


class RunExtra(Finding):
    effects: tuple[Text, ...] = ()


class StoredModel(Finding):
    effects: tuple[Text, ...] = ()
    effect_files: tuple[Text, ...] = ()


class StoredConfig(Finding):
    """The configuration that a run was made with, by any version."""

    model: StoredModel = StoredModel()


class RunSummary(Finding):
    headline: Text = ""


class RunRecord(TableModel):
    kind: Text
    seed: int | None = None
    extra: RunExtra = RunExtra()
    config: StoredConfig = StoredConfig()
    inputs: dict[str, Text] = Field(default={})
    versions: dict[str, Text] = Field(default={})
    builtin: Text | None = None
    digest: Text
    started: tuple[Text, ...] = ()
    status: Text
    seconds: NotNegative | None = None
    finished: Text | None = None
    summary: RunSummary = RunSummary()


class ParameterRow(TableModel):
    value: Finite
    sd: Maybe
    low: Finite
    high: Finite
    unit: Text = ""
    null: Maybe = None
    typical: Maybe = None
    plausible: tuple[Finite, Finite] | None = None
    start: Maybe = None

    @model_validator(mode="after")
    def _inside(self) -> Self:
        room = 1e-9 * (self.high - self.low)
        if not self.low - room <= self.value <= self.high + room:
            raise ValueError(f"value {self.value:g} is outside its bounds {self.low:g} to {self.high:g}")
        return self


class IntervalRow(TableModel):
    low: Maybe
    high: Maybe
    note: Text


class InitialRow(TableModel):
    values: dict[str, Finite]
    rms_mm: Maybe
    raw_rms_mm: Maybe


class FitRecord(TableModel):
    parameters: dict[str, ParameterRow] = Field(min_length=1)
    covariance: Rows
    chi2: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None
    degrees_of_freedom: int
    seed: int
    evaluations: Annotated[int, Field(ge=0)]
    converged: bool
    reason: Text
    at_bound: tuple[Text, ...]
    adequate: bool = False
    intervals: dict[str, IntervalRow] = Field(default={})
    effects: tuple[Text, ...] = ()
    identifiability: Text = ""
    initial: InitialRow | None = None
    start: dict[str, Finite] | None = None  # of kept.json

    @model_validator(mode="after")
    def _fits(self) -> Self:
        names = set(self.parameters)
        for key, used in (("at_bound", set(self.at_bound)), ("intervals", set(self.intervals))):
            if used - names:
                raise ValueError(f"{key} names {sorted(used - names)[0]!r}, which is no parameter")
        check_covariance(self.covariance, len(names))
        return self


def check_covariance(rows: Rows, size: int) -> None:
    """Raise ValueError unless rows are a covariance of so many parameters: square, symmetric, positive."""
    if len(rows) != size or any(len(row) != size for row in rows):
        raise ValueError(f"covariance has {len(rows)} rows; wanted {size} x {size}, one for each parameter")
    matrix = np.array([[np.nan if x is None else x for x in row] for row in rows], dtype=float)
    known = np.flatnonzero(np.isfinite(np.diag(matrix)))
    own = np.nan_to_num(matrix[np.ix_(known, known)])
    scale = np.sqrt(np.abs(np.diag(own)))
    scale[scale == 0] = 1.0
    own = own / np.outer(scale, scale)
    if not np.allclose(own, own.T, rtol=0, atol=1e-6):
        raise ValueError("covariance is not symmetric")
    if len(own) and float(np.linalg.eigvalsh(own)[0]) < -NEGATIVE * len(own):
        raise ValueError("covariance has an eigenvalue below 0")


# -- what is found -----------------------------------------------------------------------------------------


class MapRow(Finding):
    name: Text
    count: int
    rms_mm: Maybe
    noise_sd_mm: Maybe


class BeyondRow(Finding):
    name: Text
    sd: Maybe


class ComparisonRecord(Finding):
    rms_mm: Maybe
    noise_sd_mm: Maybe = None
    chi2: Maybe = None
    degrees_of_freedom: int | None = None
    p_value: Maybe = None
    adequate: bool = False
    where: Text = ""
    raw_rms_mm: Maybe = None
    beyond: tuple[BeyondRow, ...] = ()
    maps: dict[str, tuple[MapRow, ...]] = Field(default={})


class EstimateRow(Finding):
    value: Finite
    unit: Text = ""
    low: Maybe = None
    high: Maybe = None
    note: Text = ""


class ClassRow(Finding):
    effect: Text
    members: dict[str, Finite] = Field(default={})


class RankingRow(Finding):
    effect: Text
    z: Maybe = None
    p_value: Maybe = None
    delta_bic: Maybe = None
    evidence: Maybe = None
    parameters: dict[str, EstimateRow] | None = None
    note: Text = ""


class ShareRow(Finding):
    marker: Text
    branch: Text
    count: int
    before_mm: Maybe
    after_mm: Maybe


class EvidenceRecord(Finding):
    effect: Text = ""
    sentence: Text = ""
    rms_before_mm: Maybe = None
    rms_after_mm: Maybe = None
    noise_sd_mm: Maybe = None
    parameters: dict[str, EstimateRow] = Field(default={})
    held_out: dict[str, Any] | None = None
    shares: tuple[ShareRow, ...] = ()


class DiagnosisRecord(Finding):
    verdict: Text
    named: tuple[Text, ...]
    sentence: Text = ""
    law: Text | None = None
    ties: tuple[Any, ...] = ()
    classes: tuple[ClassRow, ...] = ()
    ranking: tuple[RankingRow, ...] = ()
    detectable: tuple[dict[str, Any], ...] = ()
    pairs: tuple[dict[str, Any], ...] = ()
    next_test: Text | None = None
    next_tests: tuple[dict[str, Any], ...] = ()
    frame: dict[str, Any] | None = None
    rms_before_mm: Maybe = None
    rms_after_mm: Maybe = None
    noise_sd_mm: Maybe = None


# -- cameras and what else is stored -------------------------------------------------------------------------

Three = tuple[Finite, Finite, Finite]


class CameraRecord(TableModel):
    matrix: tuple[Three, Three, Three]
    distortion: tuple[Finite, Finite, Finite, Finite, Finite]
    size: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]
    rms_px: NotNegative
    images: Annotated[int, Field(ge=0)]
    covariance: Rows
    model: tuple[Text, ...]
    covered: tuple[tuple[Finite, Finite], ...]
    remarks: tuple[Text, ...]
    notes: tuple[Text, ...] = ()

    @model_validator(mode="after")
    def _focused(self) -> Self:
        if self.matrix[0][0] <= 0 or self.matrix[1][1] <= 0:
            raise ValueError(
                f"matrix: the focal lengths are {self.matrix[0][0]:g} and {self.matrix[1][1]:g} px; wanted "
                "them above 0"
            )
        check_covariance(self.covariance, 9)
        return self


class RigRecord(Finding):
    cameras: tuple[CameraRecord, ...] = Field(min_length=2)
    turn: tuple[Any, ...]
    shift: tuple[Any, ...]
    covariance: tuple[Any, ...]
    remarks: tuple[Text, ...]


class StudyRecord(Finding):
    """The figures of the reference study."""


class SourceRecord(Finding):
    run: Text | None = None


class SolvedRow(TableModel):
    C10: NotNegative
    C01: NotNegative
    top_MPa: Positive


class SolvedRows(RootModel[tuple[SolvedRow, ...]]):
    """Where finer meshes were solved."""


SCHEMAS: dict[str, type[BaseModel]] = {
    "run.json": RunRecord, "fit.json": FitRecord, "kept.json": FitRecord,
    "comparison.json": ComparisonRecord, "diagnosis.json": DiagnosisRecord, "evidence.json": EvidenceRecord,
    "camera.json": CameraRecord, "rig.json": RigRecord, "study.json": StudyRecord,
    "source.json": SourceRecord,
}  # fmt: skip


def check_record(name: str, data: Any, *, path: str) -> None:
    """Raise ValueError where a JSON file of that name does not hold what it should; others may hold "
    "anything."""
    schema = SolvedRows if name.endswith("-solved.json") else SCHEMAS.get(name)
    if schema is not None:
        checked(schema, data, name=path)
