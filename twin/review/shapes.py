"""The predicted shapes of the finger for rerun: a state at each pressure that is held, or along a course."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from twin.review.arrangement import alone, finger_view
from twin.review.rerunfile import rerun_file
from twin.review.scene import REST, colours, normals, round_up, still
from twin.review.states import Integers
from twin.targets import Array

HELD, FOLLOWED = "pressure_Pa", "time"  # the timeline of each


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
    place = (rest + moved).astype(np.float32)
    size = np.linalg.norm(moved, axis=-1)
    both = np.concatenate([rest[None], place]).reshape(-1, 3)
    name = HELD if held else FOLLOWED
    view = finger_view("/finger", f"scrub {name}", low=both.min(axis=0), high=both.max(axis=0))
    panel = rrb.TimePanel(timeline=name, state="collapsed")
    with rerun_file(path, alone(rrb.Tabs(view, name="predict"), panel)) as recording:
        recording.log("finger/rest", still(rest, corners, colour=REST, inside=0.01), static=True)
        recording.log("finger/mesh", rr.Mesh3D.from_fields(triangle_indices=corners), static=True)
        column = (
            rr.TimeColumn(name, sequence=(1e6 * pressure).round().astype(int))
            if held
            else rr.TimeColumn(name, duration=time)
        )
        mesh = rr.Mesh3D.columns(
            vertex_positions=place.reshape(-1, 3),
            vertex_normals=np.concatenate([normals(state, corners) for state in place]),
            vertex_colors=colours(size, top=round_up(float(size.max()))).reshape(-1, 3),
        )
        recording.send_columns("finger/mesh", [column], mesh.partition([len(rest)] * len(place)))
