"""Recordings of the finger alone for rerun: undeformed with its dimensions, its predicted shapes, and its
vibrations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fe import Case
from fe.element import Integers
from fe.mesh.mirror import symmetry_support
from twin.bodies.body import Sketch
from twin.review.arrangement import alone, finger_view
from twin.review.scene import REST, colours, normals, rerun_file, round_up, still
from twin.targets import Array

SKIN, NODE = (206, 214, 221), (60, 72, 84)
POINT, MARK, DIMENSION = (255, 176, 64), (120, 200, 255), (240, 240, 240)
VIEWS = ("finger", "drawing")  # the tabs, in their order
ASIDE = 0.06  # of the finger's length: from the finger to the lines of its dimensions


@np.errstate(under="ignore")  # normals of nearly plane parts end in exact zeros
def write_undeformed(
    path: Path,
    *,
    case: Case,
    triangles: Integers,
    points: Mapping[str, Array],
    marks: Mapping[str, Array],
    sketch: Sketch | None,
    drawing: bytes,
) -> None:
    """Write the rerun file `path`, atomically.

    triangles (t, 3) node rows of the surface that is drawn; points {name: (3,) mm} on the finger; marks
    {name: (3,) mm} on the rig; sketch: its dimensions, None where a deck has none; drawing: a PNG.
    """
    with rerun_file(path, _views(case)) as recording:
        for name, entity in _entities(case, triangles, sketch).items():
            recording.log(f"finger/{name}", entity, static=True)
        size = 0.009 * float(np.ptp(case.nodes, axis=0).max())
        for name, places, colour in (("points", points, POINT), ("marks", marks, MARK)):
            if places:
                positions = list(places.values())
                dots = rr.Points3D(positions, labels=list(places), colors=colour, radii=size)
                recording.log(f"finger/{name}", dots, static=True)
        recording.log("drawing", rr.EncodedImage(contents=drawing, media_type="image/png"), static=True)


def _entities(
    case: Case, triangles: Integers, sketch: Sketch | None
) -> dict[str, rr.Mesh3D | rr.Points3D | rr.LineStrips3D]:
    """Entities of the finger; of a half model the computed half is solid and nothing is mirrored."""
    radius = 0.0025 * float(np.ptp(case.nodes, axis=0).max())
    nodes = rr.Points3D(
        case.nodes, radii=radius, colors=NODE, labels=[str(n) for n in case.labels], show_labels=False
    )  # a node's label is shown where it is selected
    lines = dimension_lines(case, sketch)
    ends = [np.array(line) for line in lines.values()]
    strips = rr.LineStrips3D(ends, labels=list(lines), colors=DIMENSION, radii=0.6 * radius)
    return {"surface": still(case.nodes, triangles, colour=SKIN), "nodes": nodes, "dimensions": strips}


def dimension_lines(case: Case, sketch: Sketch | None) -> dict[str, tuple[Array, Array]]:
    """Each dimension with its text: the two ends (3,) mm of its line beside the finger."""
    low, high = case.nodes.min(axis=0), case.nodes.max(axis=0)
    width = float(high[1] - low[1]) * (1.0 if symmetry_support(case) is None else 2.0)
    aside = ASIDE * float(high[0] - low[0])
    near, top, front = high[1] + aside, high[2] + aside, low[0] - aside
    lines = {
        f"length {high[0] - low[0]:.4g} mm": ((low[0], near, top), (high[0], near, top)),
        f"height {high[2] - low[2]:.4g} mm": ((front, near, low[2]), (front, near, high[2])),
        f"width {width:.4g} mm": ((front, high[1] - width, top), (front, high[1], top)),
    }
    line = top - aside / 2
    for arrow in () if sketch is None else sketch.side:
        lines[f"{arrow.text} mm"] = ((arrow.start[0], near, line), (arrow.end[0], near, line))
    return {text: (np.array(a), np.array(b)) for text, (a, b) in lines.items()}


def _views(case: Case) -> rrb.Blueprint:
    """The finger seen from the camera's side, and the drawing."""
    finger = finger_view("/finger", VIEWS[0], low=case.nodes.min(axis=0), high=case.nodes.max(axis=0))
    drawing = rrb.Spatial2DView(origin="/drawing", name=VIEWS[1])
    return alone(rrb.Tabs(finger, drawing, active_tab=0, name="look"), rrb.TimePanel(state="hidden"))


HELD, FOLLOWED, PERIOD = "pressure_Pa", "time", "part_of_period"  # the timeline of each
PHASES = 24  # states of a period


@np.errstate(under="ignore")  # normals of nearly plane parts end in exact zeros
def write_shapes(
    path: Path, *, nodes: Array, triangles: Integers, u: Array, pressure: Array, time: Array, held: bool
) -> None:
    """Write the rerun file `path`, atomically.

    nodes (n, 3) mm at rest, triangles (t, 3) of the surface, u (s, n, 3) mm, pressure (s,) MPa, time (s,) s:
    of states that are held each by itself, scrubbed by the pressure, or follow each other in time.
    """
    used, flat = np.unique(triangles, return_inverse=True)
    rest, corners, moved = nodes[used], flat.reshape(-1, 3).astype(np.int64), u[:, used]
    both = np.concatenate([rest[None], rest + moved]).reshape(-1, 3)
    name = HELD if held else FOLLOWED
    view = finger_view("/finger", f"scrub {name}", low=both.min(axis=0), high=both.max(axis=0))
    panel = rrb.TimePanel(timeline=name, state="collapsed")
    with rerun_file(path, alone(rrb.Tabs(view, name="predict"), panel)) as recording:
        column = (
            rr.TimeColumn(name, sequence=(1e6 * pressure).round().astype(int))
            if held
            else rr.TimeColumn(name, duration=time)
        )
        _log_moving(recording, "finger", rest, corners, moved, column)


def _log_moving(
    recording: rr.RecordingStream, entity: str, rest: Array, corners: Integers, moved: Array,
    column: rr.TimeColumn,
) -> None:  # fmt: skip
    """Log a surface at rest (n, 3) mm, and moved by (s, n, 3) mm on a timeline, coloured by how far."""
    recording.log(f"{entity}/rest", still(rest, corners, colour=REST, inside=0.01), static=True)
    recording.log(f"{entity}/mesh", rr.Mesh3D.from_fields(triangle_indices=corners), static=True)
    place, size = (rest + moved).astype(np.float32), np.linalg.norm(moved, axis=-1)
    mesh = rr.Mesh3D.columns(
        vertex_positions=place.reshape(-1, 3),
        vertex_normals=np.concatenate([normals(state, corners) for state in place]),
        vertex_colors=colours(size, top=round_up(float(size.max()))).reshape(-1, 3),
    )
    recording.send_columns(f"{entity}/mesh", [column], mesh.partition([len(rest)] * len(place)))


@dataclass(frozen=True)
class Swinging:
    """A vibration to show: its title, places (n, 3) mm about which it moves, its motion (n, 3) mm at one end,
    triangles (t, 3) of the surface; places and motion (p, 3) mm of the markers."""

    title: str
    places: Array
    motion: Array
    triangles: Integers
    markers: Array
    moving: Array


@np.errstate(under="ignore")
def write_swinging(path: Path, vibrations: Sequence[Swinging]) -> None:
    """Write vibrations into the rerun file `path`, atomically: a tab for each, in which one period plays over
    and over."""
    phase = 2 * np.pi * np.arange(PHASES) / PHASES
    column, views = rr.TimeColumn(PERIOD, sequence=np.arange(PHASES)), []
    for k, one in enumerate(vibrations):
        ends = np.concatenate([one.places + one.motion, one.places - one.motion])
        views.append(finger_view(f"/vibration{k}", one.title, low=ends.min(axis=0), high=ends.max(axis=0)))
    panel = rrb.TimePanel(timeline=PERIOD, state="collapsed", fps=float(PHASES), play_state="playing",
                          loop_mode="all")  # fmt: skip
    with rerun_file(path, alone(rrb.Tabs(*views, name="modes"), panel)) as recording:
        for k, one in enumerate(vibrations):
            used, flat = np.unique(one.triangles, return_inverse=True)
            moved = np.cos(phase)[:, None, None] * one.motion[used]
            _log_moving(recording, f"vibration{k}", one.places[used], flat.reshape(-1, 3), moved, column)
            dots = one.markers + np.cos(phase)[:, None, None] * one.moving
            radius = 0.007 * float(np.ptp(one.places[:, 0]))
            style = rr.Points3D.from_fields(radii=radius, colors=POINT)
            recording.log(f"vibration{k}/markers", style, static=True)
            points = rr.Points3D.columns(positions=dots.reshape(-1, 3))
            recording.send_columns(f"vibration{k}/markers", [column],
                                   points.partition([len(one.markers)] * PHASES))  # fmt: skip
