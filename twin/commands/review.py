"""The review stage: what the runs of a project found -> review.rrd for rerun, report.html, pictures, VTU
files."""

from typing import Annotated, Any

import numpy as np
from typer import Option

from twin.bench.fits import fresh, stale_sentences
from twin.bench.workbench import Workbench
from twin.chain import STAGES
from twin.drawing.deformed import deformed_picture, write_vtu_series
from twin.messages import Say
from twin.project.folder import Project
from twin.report.facts import facts_of
from twin.report.page import write_report
from twin.report.sentences import markdown, ranking_rows
from twin.report.story import Story
from twin.review.recording import write_review
from twin.targets import Array

SERIES = 12  # deformed states in the VTU series


def run_review(
    project: Project,
    say: Say,
    *,
    clip: Annotated[bool, Option(
        "--clip", help="also write clip.mp4: film with the model before and after, for a talk")] = False,
) -> dict[str, Any]:
    """review.rrd and report.html from the newest runs. ValueError where nothing is calibrated yet."""
    if fresh(project, ("calibrate",), "generations.npz") is None:
        why = stale_sentences(project, ("calibrate",), "generations.npz")
        reason = why[0] if why else "no calibrated model in this project"
        raise ValueError(f"nothing to review: {reason}; run twin calibrate")
    with project.new_run("review") as run:
        story = Story.of(project, run, say)
        notes = [*_not_shown(project), *_recording(story, say)]
        notes += _deformed(story)
        write_report(run.path("report.html"), title=project.config.project.name, facts=facts_of(story, notes))
        notes += _clip(story, say) if clip else []
        run.summary["headline"] = story.headline
    for note in notes:
        say(note)
    size = run.path("review.rrd").stat().st_size / 1e6
    say(f"Wrote {project.shown(run.folder)}/report.html, and review.rrd ({size:.1f} MB).")
    say(f"Look: `rerun {run.path('review.rrd')}`")
    return {"stage": "review", "run": run.name, "notes": notes, "rrd_MB": round(size, 2)}


def _not_shown(project: Project) -> list[str]:
    """Sentences on stale runs, which are not shown: one for the newest run of each stage."""
    others = [stage.name for stage in STAGES if stage.name != "review"]
    return [sentence for name in others for sentence in stale_sentences(project, (name,))[:1]]


def _recording(story: Story, say: Say) -> list[str]:
    """Write review.rrd; returns its notes."""
    cameras = story.project.config.cameras
    film = story.project.path(cameras[0].film) if cameras else None
    film = film if film is not None and film.is_file() else None  # pictures are no video
    say.progress("review", 0, 2)
    notes = write_review(
        story.run.path("review.rrd"),
        film=film,
        frame_times_s=story.targets.time - story.targets.time[0],
        generations=story.generations,
        fields=story.fields,
        diagnosis_markdown=markdown(story),
        comparison=ranking_rows(story),
        pictures={name: png for name, (_, png) in story.history.pictures.items()},
        filmed=story.footage.filmed if story.footage else None,
        strains=story.strains,
    )
    say.progress("review", 1, 2)
    return [*notes, *filter(None, [story.not_filmed])]


def _deformed(story: Story) -> list[str]:
    """A picture and a VTU series of the deformed finger; returns what could not be done."""
    g, last, notes = story.generations, story.fields, []
    top = 0 if last is None else int(np.argmax(last.pressure))
    u, model, seen = (g.u[-1], g.u_points[-1], g.u_measured) if last is None else (
        last.u[top], last.u_points[top], last.u_measured[top])  # fmt: skip
    note = deformed_picture(
        story.run.path("deformed.png"),
        nodes=g.nodes,
        triangles=g.triangles,
        u=np.asarray(u, float),
        points=g.points + with_aside(seen, model),
    )
    notes += [note] if note else []
    cells = Workbench.of(story.project).case.connectivity
    if story.fields is None:
        times, u = [g.film_time_s], g.u[-1:]
    else:
        chosen = np.unique(np.linspace(0, len(story.fields.time_s) - 1, SERIES).round().astype(int))
        times, u = list(story.fields.time_s[chosen]), story.fields.u[chosen]
    write_vtu_series(
        story.run.folder, "deformed", nodes=g.nodes, cells=cells, times=times, fields={"U": u}
    )
    return notes


def with_aside(seen: Array, model: Array) -> Array:
    """Measured displacements (p, 3) mm with the model's U2 where none was: a camera that looks along y sees
    none. NaN stays where a marker was not seen."""
    return np.where(np.isnan(seen) & [False, True, False], model, seen)


def _clip(story: Story, say: Say) -> list[str]:
    """Write clip.mp4, for a talk; returns why it could not be made."""
    if story.footage is None:
        return [f"No clip: {story.not_filmed or 'this project has no film to lay the model on'}."]
    say.progress("clip", 0, 1)
    faster = story.footage.clip(story.run.path("clip.mp4"))
    say.progress("clip", 1, 1)
    say(f"Wrote {story.project.shown(story.run.folder)}/clip.mp4{faster}.")
    return []
