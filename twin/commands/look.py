"""A picture of the finger as the model has it: dimensions, marks, points."""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from typer import Option

from fe.element import triangles
from fe.mesh.elementshapes import quality
from twin.bench.meshshapes import nearest_node, places_asked, shape_csv
from twin.bench.workbench import one_side, places_of, structure_of
from twin.calibrated.positions import position_of
from twin.coupons.pulltest import pull_tests
from twin.drawing.blueprint import dimensioned
from twin.drawing.meshpictures import as_read, labelled, shapes
from twin.messages import Say
from twin.project.folder import Project
from twin.review.finger import write_undeformed


def run_look(
    project: Project,
    say: Say,
    *,
    at: Annotated[Sequence[str], Option(
        help="a place x,y,z in mm: the nearest surface node is said and drawn; once for each")] = (),
) -> dict[str, Any]:
    """Drawings of the finger, unless they are there: finger.png and look.rrd, the undeformed finger with its
    dimensions; nodes.png, the labels around points; quality.png and quality.csv, the shapes of the elements;
    of a deck read.png, what was read of it."""
    places = places_asked(at)
    how: dict[str, Any] = {"tables": ("project", "model", "frame", "points"), "inputs": project.deck_files(),
                           "extra": {"at": [x.tolist() for x in places]}}  # fmt: skip
    structure = structure_of(project)
    nearest = [nearest_node(structure, x) for x in places]
    for _, sentence in nearest:
        say(sentence)
    for place in places_of(project, structure).values():
        say(place.sentence)
    for test in pull_tests(project.config.material_tests, project.root):
        say(test.sentence)
    done = project.done("look", **how)
    if done is not None and (done / "look.rrd").is_file():
        say(f"Already done: {project.shown(done / 'finger.png')}")
        return {"stage": "look", "status": "skipped", "run": project.shown(done)}
    sketch = None if structure.body is None else structure.body.sketch
    note = f"; {sketch.note}" if sketch is not None and sketch.note else ""
    named = {"finger": "finger", "deck": "finger"}.get(kind := project.config.model.kind, kind)
    points = {p.name: position_of(p, structure, mirrored=one_side(project)) for p in project.config.points}
    marks = {m.name: np.array(m.position_mm) for m in project.config.frame.markers}
    with project.new_run("look", **how) as run:
        picture = dimensioned(
            structure.case, outside=structure.outside, points=points, marks=marks, sketch=sketch,
            title=f"{project.config.project.name}: the {named} without load, in mm{note}",
        )  # fmt: skip
        run.write_bytes("finger.png", picture)
        write_undeformed(
            run.path("look.rrd"), case=structure.case, triangles=triangles(structure.outside), points=points,
            marks=marks, sketch=sketch, drawing=picture,
        )  # fmt: skip
        around = points | {f"at {text}": x for text, x in zip(at, places, strict=True)}
        run.write_bytes("nodes.png", labelled(structure.case, outside=structure.outside, points=around))
        measures = quality(structure.case)
        run.write_bytes("quality.png", shapes(structure.case, outside=structure.outside, measures=measures))
        run.write_text("quality.csv", shape_csv(structure))
        if project.config.model.deck is not None:
            title = f"{project.config.model.deck}: what the model takes from it"
            run.write_bytes("read.png", as_read(structure.case, title=title))
        x, _, z = np.ptp(structure.case.nodes, axis=0)
        run.summary.update(nodes=len(structure.case.nodes), points=len(points), marks=len(marks))
        run.summary["headline"] = f"{x:.4g} mm long, {z:.3g} mm high, {len(points)} points"
    say(f"Wrote {project.shown(run.path('finger.png'))}: the finger with its dimensions and points.")
    say(f"In 3D, with its nodes: rerun {run.path('look.rrd')}")
    say("nodes.png has the node labels around points, quality.png the shapes of the elements.")
    if project.config.model.deck is not None:
        say("read.png shows materials, layers, supports and the pressure, as they were read.")
    nodes = {"nodes": [label for label, _ in nearest]} if places else {}
    return {"stage": "look", "status": "done", "run": project.shown(run.folder)} | run.summary | nodes
