"""One of two that are compared, batches or models of one batch: what is known of it, and the recording that
lays both side by side in one rerun file."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

from twin.batches.values import BatchValue
from twin.bench.fits import fresh
from twin.judging.fitrecord import ComparisonRecord, FitRecord
from twin.project.folder import Project
from twin.review.recording import write_review
from twin.review.scene import rerun_file
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


VIEWS = ("films", "fingers", "errors", "search", "diagnoses")  # the tabs, in their order
COLOURS = ((86, 180, 233), (230, 159, 0))
CURVES = {  # of a recording, which are drawn in one view for both
    "rms/calibrated": "calibrated model",
    "rms/best": "best of generation",
    "parameters/pressure": "pressure",
}


def write_merged(path: Path, *, recordings: Mapping[str, Path]) -> None:
    """Write the rerun file `path`, atomically: everything of two recordings, each below its name."""
    chunks = {name: list(_below(name, source)) for name, source in recordings.items()}
    entities = {chunk.entity_path for parts in chunks.values() for chunk in parts}
    with rerun_file(path, arranged(list(recordings), entities)) as recording:
        for parts in chunks.values():
            recording.send_chunks(parts)
        _name_curves(recording, list(recordings), entities)


def _below(name: str, source: Path) -> Iterator[Chunk]:
    """The chunks of a recording with their entities below a name; what describes the file itself is left."""
    try:
        reader = RrdReader(str(source))
    except RuntimeError as error:
        raise ValueError(f"{source} cannot be read ({error}); run `twin review` again") from None
    for chunk in reader.stream():
        if not chunk.entity_path.startswith("/__"):
            yield chunk.with_entity_path(entity(name, chunk.entity_path))


def entity(name: str, path: str) -> str:
    """Path of an entity of a recording in the merged one."""
    return f"/{rr.escape_entity_path_part(name)}/{path.lstrip('/')}"


def _name_curves(recording: rr.RecordingStream, names: Sequence[str], entities: set[str]) -> None:
    """Colour and name of the curves of each side."""
    for name, colour in zip(names, COLOURS, strict=True):
        for curve, what in CURVES.items():
            if entity(name, curve) in entities:
                style = rr.SeriesLines(colors=colour, widths=2.5, names=f"{name}: {what}")
                recording.log(entity(name, curve), style, static=True)


def arranged(names: Sequence[str], entities: set[str]) -> rrb.Blueprint:
    """The views as tabs; what a recording does not have gets no view."""
    tabs = {
        "films": _beside([_film(name) for name in names if entity(name, "film/frame") in entities]),
        "fingers": _beside([_finger(name) for name in names]),
        "errors": rrb.Vertical(
            _curves(names, "rms/calibrated", "error at each moment, mm rms (film_time)"),
            _curves(names, "parameters/pressure", "pressure, MPa"),
        ),
        "search": _curves(names, "rms/best", "error of the best, mm rms (generation)"),
        "diagnoses": _beside([rrb.TextDocumentView(origin=entity(n, "diagnosis"), name=n) for n in names]),
    }
    views = [_named(tabs[view], view) for view in VIEWS if tabs[view] is not None]
    return rrb.Blueprint(
        rrb.Tabs(*views, active_tab=0, name="side by side"),
        rrb.TimePanel(timeline="film_time", state="collapsed", fps=2.0),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _beside(views: Sequence[Any]) -> Any:
    return rrb.Horizontal(*views) if views else None


def _named(view: Any, name: str) -> Any:
    return rrb.Horizontal(view, name=name)


def _film(name: str) -> rrb.Spatial2DView:
    """The film of one side with the models of its test."""
    paths = ("film/frame", "film/test/**", "film/legend/test")
    return rrb.Spatial2DView(
        origin=entity(name, "film"), contents=[f"+ {entity(name, path)}" for path in paths], name=name
    )


def _finger(name: str) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=entity(name, "model"), name=f"{name}: displacement, mm", background=(38, 41, 48),
        line_grid=False,
    )  # fmt: skip


def _curves(names: Sequence[str], path: str, title: str) -> rrb.TimeSeriesView:
    """The same curve of both."""
    return rrb.TimeSeriesView(origin="/", contents=[f"+ {entity(n, path)}" for n in names], name=title)
