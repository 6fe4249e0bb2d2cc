"""The error after each change of the model: nominal constants, calibrated, effects added or dropped."""

from pathlib import Path

from twin import files
from twin.bench.fits import holds
from twin.chain import FIT, kinds_writing
from twin.effects.labels import name_of
from twin.judging.fitrecord import ComparisonRecord, FitRecord
from twin.project.folder import Project, kind_of
from twin.records import Maybe, Record

COMPARISON = ComparisonRecord.file
NOMINAL, CALIBRATED = "nominal constants", "calibrated"


class Stair(Record):
    """One model on the way: what was done, its effects, its error and what is expected of it, without shared
    errors and the noise in mm, whether it fits, and its run (none before the first fit)."""

    done: str
    effects: tuple[str, ...]
    rms_mm: float
    raw_rms_mm: Maybe
    expected_mm: Maybe = None
    expected_low_mm: Maybe = None
    expected_high_mm: Maybe = None
    noise_sd_mm: float
    adequate: bool
    run: str

    @property
    def error_mm(self) -> float:
        """The raw rms error; in the comparison of an older version the error without shared errors."""
        return self.rms_mm if self.raw_rms_mm is None else self.raw_rms_mm

    @property
    def foot_mm(self) -> float:
        """The error expected of a right model; in an older comparison the noise."""
        return self.noise_sd_mm if self.expected_mm is None else self.expected_mm


def stairs(project: Project) -> tuple[Stair, ...]:
    """The models since the newest valid calibration, the oldest first; runs in a row with equal effects give
    one, the newest."""
    out: list[Stair] = []
    for folder in _runs(project):
        fit = files.read(FitRecord, folder / FIT)
        comparison, effects = files.read(ComparisonRecord, folder / COMPARISON), fit.effects
        if kind_of(folder) == "calibrate":
            out = _nominal(fit, comparison)
        elif out and out[-1].effects == effects:
            out.pop()
        done = _done(out[-1].effects if out else (), effects)
        out.append(
            Stair(
                done=done, effects=effects, rms_mm=comparison.rms_mm, raw_rms_mm=comparison.raw_rms_mm,
                expected_mm=comparison.expected_mm, expected_low_mm=comparison.expected_low_mm,
                expected_high_mm=comparison.expected_high_mm, noise_sd_mm=comparison.noise_sd_mm,
                adequate=comparison.adequate, run=folder.name,
            )
        )  # fmt: skip
    return tuple(out)


def in_words(rows: tuple[Stair, ...]) -> str:
    """The errors one after the other, and what is expected, in words; nothing for a single model."""
    if len(rows) < 2:
        return ""
    steps = " -> ".join(f"{row.done} {row.error_mm:.3f}" for row in rows)
    low, high = rows[-1].expected_low_mm, rows[-1].expected_high_mm
    band = "" if low is None or high is None else f"; a right model: {low:.3f} to {high:.3f} (95 %)"
    return f"Error, mm rms: {steps}{band}."


def _runs(project: Project) -> list[Path]:
    """The runs with a fit of the present project, whatever their effects, from the newest calibration on."""
    kinds, folders = kinds_writing(FIT), []
    for folder in reversed(project.runs()):
        complete = (folder / FIT).is_file() and (folder / COMPARISON).is_file()
        if kind_of(folder) in kinds and complete and holds(project, folder):
            folders.append(folder)
            if kind_of(folder) == "calibrate":
                return folders[::-1]
    return []


def _nominal(fit: FitRecord, comparison: ComparisonRecord) -> list[Stair]:
    """The model before the calibration, where it was kept."""
    if fit.initial is None or fit.initial.rms_mm is None:
        return []
    return [
        Stair(
            done=NOMINAL, effects=(), rms_mm=fit.initial.rms_mm, raw_rms_mm=fit.initial.raw_rms_mm,
            expected_mm=comparison.expected_mm, expected_low_mm=comparison.expected_low_mm,
            expected_high_mm=comparison.expected_high_mm, noise_sd_mm=comparison.noise_sd_mm,
            adequate=False, run="",
        )
    ]  # fmt: skip


def _done(before: tuple[str, ...], after: tuple[str, ...]) -> str:
    """The change between two models, such as "+ creep"."""
    more, less = ([e for e in a if e not in b] for a, b in ((after, before), (before, after)))
    widened = {name_of(e) for e in more} & {name_of(e) for e in less}
    less = [e for e in less if name_of(e) not in widened]
    return " ".join([*(f"+ {e}" for e in more), *(f"- {e}" for e in less)]) or CALIBRATED
