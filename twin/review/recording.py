"""Turns the history of a calibration and its film into one rerun file: film beside the simulated finger.

Timelines: `generation` (the best individual of every generation beside the frame at top pressure),
`film_time` (the models along the film) and `effect` (one model after the other at the film's worst moment).
The viewer shows one timeline at a time, so the film is logged on all. The layout travels inside the file.
"""

import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import av
import numpy as np
import rerun as rr

from twin.review.arrangement import arranged
from twin.review.filmed import Filmed
from twin.review.filmlayer import log_filmed, log_strains
from twin.review.scene import Scene, States, log_constants, log_states, rerun_file, scene_of
from twin.review.states import Array, Fields, Generations, Integers, Strains
from vision.film.scheduling import as_before
from vision.film.video import film_stream, opened

SERIES = ((86, 180, 233), (230, 159, 0), (0, 190, 140), (204, 121, 167), (240, 228, 66), (213, 94, 0))
REVIEW_WIDTH = 1280  # px: wider films are scaled down for review
LEGEND = (
    "*In 3D: white dots are measured markers, red arrows measured - model, {0} times as long on `generation` "
    "and {1} times on `film_time`; the colour is the displacement, 0 to {top:g} mm. `generation` stands at "
    "{time:.2f} s of the film. The errors of the table leave out what many values share: the scale, the "
    "places of the markers, the gauge. What is drawn over the film still has it.*"
)


@np.errstate(under="ignore")  # colours and normals of nearly plane parts end in exact zeros
def write_review(
    path: Path,
    *,
    film: Path | None,
    frame_times_s: Array,
    generations: Generations,
    fields: Fields | None,
    diagnosis_markdown: str,
    comparison: Sequence[Mapping[str, object]] = (),
    pictures: Mapping[str, bytes] | None = None,
    filmed: Filmed | None = None,
    strains: Strains | None = None,
) -> list[str]:
    """Write the rerun file `path`, atomically, and return notes: what it does not show, and why.

    film file or None; frame_times_s (t,) s of its frames; generations, fields as in `review.states`;
    diagnosis_markdown text; comparison rows of a table that is shown below it, all with the same keys;
    pictures PNG files by title; filmed the models to be drawn over the film, or None; strains of a speckled
    face, drawn over the film, too.
    ValueError where the frame at top pressure is not in the film.
    """
    video, stamps, scale, notes = _video(film, frame_times_s)
    if video is not None and not 0 <= generations.film_frame < len(stamps):
        raise ValueError(
            f"the first frame at top pressure is {generations.film_frame}, but {film} has {len(stamps)} "
            "frames: measure this film again"
        )
    times: Array = (
        frame_times_s if len(frame_times_s) == len(stamps) else np.asarray(stamps * 1e-9, dtype=float)
    )
    scene = scene_of(generations, fields)
    drawn = filmed if video is not None else None
    views = arranged(scene, has_film=video is not None, filmed=drawn, pictures=tuple(pictures or {}),
                     strains=strains)  # fmt: skip
    with rerun_file(path, views) as recording:
        if video is not None:
            recording.log("film/frame", video, static=True)
            _log_frames(recording, stamps, times=times, generations=generations, filmed=drawn)
        if drawn is not None:
            log_filmed(recording, drawn, generations, scale=scale)
        if strains is not None:
            log_strains(recording, strains, scale=scale)
        log_constants(recording, scene)
        _log_curves(recording, generations=generations, fields=fields)
        scales = _log_states(recording, scene, generations=generations, fields=fields, times=times)
        if fields is None and video is not None:
            notes.append(
                "along the film the best model of the genetic algorithm is shown, at top pressure only"
            )
        legend = LEGEND.format(*scales, time=generations.film_time_s, top=scene.top_mm)
        remarks = [f"*Note: {note}.*" for note in notes]
        text = [diagnosis_markdown.strip(), _table(comparison), legend, *remarks]
        document = rr.TextDocument("\n\n".join(filter(None, text)), media_type=rr.MediaType.MARKDOWN)
        recording.log("diagnosis", document, static=True)
        for number, data in enumerate((pictures or {}).values()):
            image = rr.EncodedImage(contents=data, media_type="image/png")
            recording.log(f"pictures/{number}", image, static=True)
    return notes


def encode_av1(film: Path) -> bytes:
    """A copy of the film (mp4, AV1, at most 1280 px wide), same time stamps: for review, not to measure."""
    # The encoder reads its log level when it starts, and prints a banner on stderr without it.
    os.environ.setdefault("SVT_LOG", "1")
    copy = io.BytesIO()  # a full disk is met by the one file that holds it
    with opened(film) as source, av.open(copy, "w", format="mp4") as target:
        video = source.streams.video[film_stream(film)[0]]
        # One thread: what several tell each other costs a fifth of the processor.
        options = {"preset": "12", "crf": "32", "svtav1-params": "lp=1"}
        stream = target.add_stream("libsvtav1", rate=video.average_rate, options=options)
        stream.width, stream.height = _review_size(video)
        stream.pix_fmt, stream.gop_size = "yuv420p", 20  # short groups of pictures scrub smoothly
        if video.time_base is not None:
            stream.codec_context.time_base = video.time_base
        with as_before():
            stream.codec_context.open()
        for frame in source.decode(video):
            small = frame.reformat(width=stream.width, height=stream.height, format="yuv420p")
            small.pts, small.time_base = frame.pts, frame.time_base
            small.pict_type = 0  # the encoder chooses its own key frames
            target.mux(stream.encode(small))
        target.mux(stream.encode(None))
    return copy.getvalue()


def _review_size(video: av.VideoStream) -> tuple[int, int]:
    """Width and height in px, both even, of the copy for review."""
    shrink = min(1.0, REVIEW_WIDTH / video.width)
    return 2 * round(video.width * shrink / 2), 2 * round(video.height * shrink / 2)


def _video(film: Path | None, times: Array) -> tuple[rr.AssetVideo | None, Integers, Array, list[str]]:
    """Film as an asset that the viewer shows without ffmpeg, its time stamps (t,) ns, its scale (2,) in
    pixels per pixel of the film, and notes.
    """
    scale = np.ones(2)
    if film is None:
        why = "no film in this project: the model is shown without it"
        return None, np.zeros(0, dtype=np.int64), scale, [why]
    notes = []
    with opened(film) as source:
        stream = source.streams.video[film_stream(film)[0]]
        small = np.array(_review_size(stream)) / (stream.width, stream.height)
    try:
        data, scale = encode_av1(film), small
    except av.codec.codec.UnknownCodecError:
        data = film.read_bytes()
        notes.append("PyAV has no AV1 encoder here: the viewer needs ffmpeg on PATH to show the film")
    video = rr.AssetVideo(contents=data, media_type="video/mp4")
    stamps = np.asarray(video.read_frame_timestamps_nanos(), dtype=np.int64)
    if len(stamps) != len(times):
        notes.append(
            f"the film has {len(stamps)} frames but {len(times)} times were given: its own clock is used"
        )
    return video, stamps, scale, notes


def _log_frames(
    recording: rr.RecordingStream,
    stamps: Integers,
    *,
    times: Array,
    generations: Generations,
    filmed: Filmed | None,
) -> None:
    """The frame of every value of every timeline."""
    at_top = np.full(len(generations.generation), stamps[generations.film_frame])
    columns = [(rr.TimeColumn("film_time", duration=times), stamps), (_generation(generations), at_top)]
    if filmed is not None:
        worst = np.full(len(filmed.models), stamps[filmed.frame[filmed.worst]])
        columns.append((rr.TimeColumn("effect", sequence=np.arange(len(worst))), worst))
    for column, frames in columns:
        recording.send_columns("film/frame", [column], rr.VideoFrameReference.columns_nanos(frames))


def _log_states(
    recording: rr.RecordingStream,
    scene: Scene,
    *,
    generations: Generations,
    fields: Fields | None,
    times: Array,
) -> tuple[int, int]:
    """Log the finger on both timelines; returns how much longer than the errors the arrows are on each."""
    measured = np.broadcast_to(generations.u_measured, generations.u_points.shape)
    states = States(generations.u, generations.u_points, measured)
    entities = log_states(recording, scene, _generation(generations), states=states)
    if fields is None:
        start = times[:1] if len(times) else np.array([generations.film_time_s])
        states = States(states.u[-1:], states.model[-1:], states.measured[-1:])
        film_time = rr.TimeColumn("film_time", duration=start)
        return entities, log_states(recording, scene, film_time, states=states)
    states = States(fields.u, fields.u_points, fields.u_measured)
    return entities, log_states(
        recording, scene, rr.TimeColumn("film_time", duration=fields.time_s), states=states
    )


def _log_curves(recording: rr.RecordingStream, *, generations: Generations, fields: Fields | None) -> None:
    """Log error and parameters over generations, error and pressure over film time, each with its name."""
    column = _generation(generations)
    curves = [("rms/best", "best of generation", column, generations.rms_mm)]
    curves += [
        (f"parameters/{rr.escape_entity_path_part(name)}", name, column, value)
        for name, value in zip(generations.names, generations.best.T)
    ]
    if fields is not None:
        column = rr.TimeColumn("film_time", duration=fields.time_s)
        curves.append(
            ("rms/calibrated", "calibrated model", column, _rms(fields.u_measured - fields.u_points))
        )
        curves.append(("parameters/pressure", "pressure, MPa", column, fields.pressure))
    for number, (entity, name, column, value) in enumerate(curves):
        style = rr.SeriesLines(colors=SERIES[number % len(SERIES)], widths=2.5, names=name)
        recording.log(entity, style, static=True)
        recording.send_columns(entity, [column], rr.Scalars.columns(scalars=value))


def _generation(generations: Generations) -> rr.TimeColumn:
    return rr.TimeColumn("generation", sequence=generations.generation)


def _rms(error: Array) -> Array:
    """Root mean square (s,) of the observed components of error (s,p,3); NaN where nothing is observed."""
    seen = np.isfinite(error)
    count = seen.sum(axis=(1, 2))
    total = (np.where(seen, error, 0.0) ** 2).sum(axis=(1, 2))
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def _table(rows: Sequence[Mapping[str, object]]) -> str:
    """A markdown table of rows; empty without rows."""
    if not rows:
        return ""
    names = list(rows[0])
    lines = [names, ["---"] * len(names), *([str(row[name]) for name in names] for row in rows)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
