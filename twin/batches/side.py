"""One of two that are compared: what is known of it, and the recording that lays both side by side."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from twin.batches.values import BatchValue
from twin.bench.fits import fresh
from twin.judging.fitrecord import ComparisonRecord, FitRecord
from twin.project.folder import Project
from twin.review.merging import write_merged
from twin.review.recording import write_review
from twin.review.states import Fields, Generations


@dataclass(frozen=True, kw_only=True)
class Laid:
    """One of the two: what it is called, its project, its fit and what was found with it."""

    name: str
    project: Project
    record: FitRecord
    values: tuple[BatchValue, ...]
    comparison: ComparisonRecord | None
    verdict: str
    run: Path | None  # the run folder of one model; None: the newest of the batch


def write_side_by_side(path: Path, two: Sequence[Laid]) -> Path | None:
    """The path of a rerun file with the recordings of both; None where one has none, and none is written."""
    with tempfile.TemporaryDirectory() as scratch:
        files = {side.name: _recording(side, Path(scratch) / f"{k}.rrd") for k, side in enumerate(two)}
        recordings = {name: file for name, file in files.items() if file is not None}
        if len(recordings) < len(two):
            return None
        write_merged(path, recordings=recordings)
    return path


def _recording(side: Laid, scratch: Path) -> Path | None:
    """Recording of a batch: its newest review, or one made for a given run."""
    if side.run is None:
        return side.project.newest("review", "review.rrd")
    generations = side.run / "generations.npz"
    history = generations if generations.is_file() else fresh(side.project, ("calibrate",), "generations.npz")
    if history is None:
        return None
    fields, targets = side.run / "fields.npz", side.project.targets()
    cameras = side.project.config.cameras
    film = side.project.path(cameras[0].film) if cameras else None
    write_review(
        scratch, film=film if film is not None and film.is_file() else None,
        frame_times_s=targets.time - targets.time[0], generations=Generations.load(history),
        fields=Fields.load(fields) if fields.is_file() else None,
        diagnosis_markdown=f"# {side.name}\n\n{side.comparison.where if side.comparison else ''}",
    )  # fmt: skip
    return scratch
